//! Parameters of effects at the border: units, layout in `model.toml`, names and prior sigmas.

/// A unit at the border: symbol for people, suffix for files, size in SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// As printed, for example `deg/h/g`.
    pub symbol: &'static str,
    /// As in file keys, for example `deg_per_h_per_g`.
    pub suffix: &'static str,
    /// One such unit in SI.
    pub si: f64,
}

/// Units of the parameters of effects.
pub mod unit {
    use super::Unit;
    use crate::earth::STANDARD_GRAVITY;
    const DEG_PER_H_SI: f64 = std::f64::consts::PI / 180.0 / 3600.0;

    /// Gyro bias.
    pub const DEG_PER_H: Unit = Unit { symbol: "deg/h", suffix: "deg_per_h", si: DEG_PER_H_SI };
    /// g-sensitivity.
    pub const DEG_PER_H_PER_G: Unit =
        Unit { symbol: "deg/h/g", suffix: "deg_per_h_per_g", si: DEG_PER_H_SI / STANDARD_GRAVITY };
    /// g²-sensitivity.
    pub const DEG_PER_H_PER_G2: Unit = Unit {
        symbol: "deg/h/g²",
        suffix: "deg_per_h_per_g2",
        si: DEG_PER_H_SI / (STANDARD_GRAVITY * STANDARD_GRAVITY),
    };
    /// Scale factor error.
    pub const PPM: Unit = Unit { symbol: "ppm", suffix: "ppm", si: 1e-6 };
    /// Misalignment.
    pub const MRAD: Unit = Unit { symbol: "mrad", suffix: "mrad", si: 1e-3 };
    /// Temperature drift of a gyro bias.
    pub const DEG_PER_H_PER_DEGC: Unit =
        Unit { symbol: "deg/h/°C", suffix: "deg_per_h_per_degc", si: DEG_PER_H_SI };
    /// Random walk of a gyro bias; √h = 60 √s.
    pub const DEG_PER_H_PER_RTH: Unit =
        Unit { symbol: "deg/h/√h", suffix: "deg_per_h_per_rth", si: DEG_PER_H_SI / 60.0 };
    /// Accelerometer bias.
    pub const MG: Unit = Unit { symbol: "mg", suffix: "mg", si: 1e-3 * STANDARD_GRAVITY };
    /// Non-linearity of an accelerometer.
    pub const MG_PER_G2: Unit = Unit { symbol: "mg/g²", suffix: "mg_per_g2", si: 1e-3 / STANDARD_GRAVITY };
    /// Temperature drift of an accelerometer bias.
    pub const MG_PER_DEGC: Unit =
        Unit { symbol: "mg/°C", suffix: "mg_per_degc", si: 1e-3 * STANDARD_GRAVITY };
    /// Random walk of an accelerometer bias.
    pub const MG_PER_RTH: Unit =
        Unit { symbol: "mg/√h", suffix: "mg_per_rth", si: 1e-3 * STANDARD_GRAVITY / 60.0 };
    /// Magnetic field.
    pub const MGAUSS: Unit = Unit { symbol: "mG", suffix: "mgauss", si: 1e-7 };
    /// Magnetic field of a current.
    pub const MGAUSS_PER_A: Unit = Unit { symbol: "mG/A", suffix: "mgauss_per_a", si: 1e-7 };
    /// Pressure.
    pub const PA: Unit = Unit { symbol: "Pa", suffix: "pa", si: 1.0 };
    /// Height by temperature.
    pub const M_PER_DEGC: Unit = Unit { symbol: "m/°C", suffix: "m_per_degc", si: 1.0 };
    /// Drag per mass by speed.
    pub const PER_S: Unit = Unit { symbol: "1/s", suffix: "per_s", si: 1.0 };
    /// Drag area per mass.
    pub const M2_PER_KG: Unit = Unit { symbol: "m²/kg", suffix: "m2_per_kg", si: 1.0 };
    /// A share.
    pub const PERCENT: Unit = Unit { symbol: "%", suffix: "percent", si: 0.01 };
    /// Angle.
    pub const DEG: Unit = Unit { symbol: "deg", suffix: "deg", si: std::f64::consts::PI / 180.0 };
    /// Time.
    pub const S: Unit = Unit { symbol: "s", suffix: "s", si: 1.0 };
    /// Length.
    pub const M: Unit = Unit { symbol: "m", suffix: "m", si: 1.0 };
    /// Metres per second.
    pub const M_PER_S: Unit = Unit { symbol: "m/s", suffix: "m_per_s", si: 1.0 };
}

/// How the values of a parameter group are laid out in `model.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One number.
    Scalar,
    /// Three numbers: x, y, z, or north, east, down.
    Vector,
    /// Three rows of three.
    Matrix,
    /// Three rows of three, the diagonal zero and not a parameter.
    MatrixWithoutDiagonal,
    /// xy, xz, yz.
    UpperTriangle,
    /// xx, yy, zz, xy, xz, yz.
    Symmetric,
}

impl Shape {
    /// Number of parameters.
    pub fn len(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vector | Self::UpperTriangle => 3,
            Self::MatrixWithoutDiagonal | Self::Symmetric => 6,
            Self::Matrix => 9,
        }
    }

    /// Never empty.
    pub fn is_empty(self) -> bool {
        false
    }
}

/// Parameters of one unit within an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterGroup {
    /// Unit at the border.
    pub unit: Unit,
    /// Layout in files.
    pub shape: Shape,
    /// A short name per parameter, as on screens: `g11`, `latency`.
    pub names: &'static [&'static str],
    /// Prior 1-sigma when the effect is estimated and nothing is known of its size, SI. Zero for a parameter that
    /// is no linear state (an instant, a noise density): it is only ever set, and found by searching over values.
    pub prior_sigma: f64,
}

/// A row of a table: parameters of one unit.
pub(super) const fn group(
    unit: Unit,
    shape: Shape,
    names: &'static [&'static str],
    prior_sigma: f64,
) -> ParameterGroup {
    ParameterGroup { unit, shape, names, prior_sigma }
}

impl ParameterGroup {
    /// Whether a filter can carry these parameters as states. Otherwise their Jacobian columns stay zero.
    pub fn is_state(&self) -> bool {
        self.prior_sigma > 0.0
    }
}
