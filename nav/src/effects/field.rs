//! Effects on magnetometers, as data: each parameter multiplies drivers and adds them to axes of the measured field.
//!
//! The field that a compass reports in body axes is m = exp(θ)ᵀ b + S b + h + k I + τ ω×b + δ ∂b/∂δ, with the Earth's field b in body axes (Groves
//! 2013, section 6.1.2; Renaudin, Afzal & Lachapelle 2010, "Complete triaxis magnetometer calibration in the magnetic domain"). They stand beside the
//! [`REGISTRY`](super::REGISTRY): a vehicle has several compasses, and each of them has its own.

use super::parameters::group;
use super::{Effect, ParameterGroup, Shape, unit};
use crate::rotation::{exp, left_jacobian, skew};
use nalgebra::Vector3;

/// A compass and what its effects depend on, at one instant. Tesla, body axes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FieldInstant {
    /// The Earth's field.
    pub field: Vector3<f64>,
    /// Its derivative by the declination, per rad.
    pub by_declination: Vector3<f64>,
    /// Angular rate, rad/s.
    pub rate: Vector3<f64>,
    /// Current of the battery, A; 0 where it is not known.
    pub current_a: f64,
}

/// What a parameter multiplies; the number is the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldDriver {
    /// 1.
    One,
    /// The Earth's field.
    Field(usize),
    /// Current of the battery.
    Current,
    /// How the field of a while ago differs from that of now, per second.
    Lag(usize),
    /// How the field differs where its declination does.
    Declination(usize),
}

impl FieldDriver {
    /// Its value.
    pub fn value(self, x: &FieldInstant) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Field(k) => x.field[k],
            Self::Current => x.current_a,
            Self::Lag(k) => x.rate.cross(&x.field)[k],
            Self::Declination(k) => x.by_declination[k],
        }
    }
}

/// An effect on the field that a compass reports.
pub trait FieldEffect {
    /// What it adds to the Earth's field, T.
    fn field(&self, p: &[f64], x: &FieldInstant) -> Vector3<f64>;

    /// ∂field/∂p at these values; the slice comes zeroed, one column per parameter.
    fn field_jacobian(&self, p: &[f64], x: &FieldInstant, columns: &mut [Vector3<f64>]);
}

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct CompassEffect {
    /// Its fixed name.
    pub name: &'static str,
    /// One line for people.
    pub description: &'static str,
    /// What usually causes it.
    pub cause: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
    /// Units, names, layout and prior of the parameters.
    pub parameters: &'static [ParameterGroup],
    /// Axis, parameter and driver; none for the effect that turns the field.
    pub cells: &'static [(usize, usize, FieldDriver)],
}

impl Effect for CompassEffect {
    of_row!();

    fn on_field(&self) -> Option<&dyn FieldEffect> {
        Some(self)
    }
}

impl CompassEffect {
    /// By what an effect turns the field with these values; nothing for the others.
    fn turn(&self, p: &[f64]) -> Option<Vector3<f64>> {
        self.cells.is_empty().then(|| Vector3::from_fn(|k, _| p.get(k).copied().unwrap_or(0.0)))
    }
}

impl FieldEffect for CompassEffect {
    fn field(&self, p: &[f64], x: &FieldInstant) -> Vector3<f64> {
        if let Some(turn) = self.turn(p) {
            return exp(&turn).inverse() * x.field - x.field;
        }
        let mut out = Vector3::zeros();
        for (axis, parameter, driver) in self.cells {
            out[*axis] += p.get(*parameter).copied().unwrap_or(0.0) * driver.value(x);
        }
        out
    }

    fn field_jacobian(&self, p: &[f64], x: &FieldInstant, columns: &mut [Vector3<f64>]) {
        if let Some(turn) = self.turn(p) {
            // Φ ↦ exp(Φ) b changes by −exp(Φ) [b×] J_r(Φ), with J_r(Φ) = J_l(−Φ) (Solà 2018, arXiv:1711.02508, eq. 190); Φ = −θ.
            let back = exp(&turn).to_rotation_matrix().into_inner().transpose();
            let by = back * skew(&x.field) * left_jacobian(&turn);
            columns.iter_mut().zip(by.column_iter()).for_each(|(column, own)| column.copy_from(&own));
        }
        for (axis, parameter, driver) in self.cells {
            if let Some(column) = columns.get_mut(*parameter) {
                column[*axis] += driver.value(x);
            }
        }
    }
}

use FieldDriver::{Current, Declination, Field, Lag, One};

/// A constant field of the vehicle itself. The prior is 150 mG: what uncalibrated compasses beside batteries and wires show, a third of the
/// Earth's field.
pub static MAG_HARD_IRON: CompassEffect = CompassEffect {
    name: "mag_hard_iron",
    description: "the vehicle's own constant field adds to the Earth's",
    cause: "magnetised parts, or an offset that was calibrated elsewhere",
    remedy: "calibrate the compass away from metal, or apply the offsets found",
    parameters: &[group(unit::MGAUSS, Shape::Vector, &["mh_x", "mh_y", "mh_z"], 150.0 * unit::MGAUSS.si)],
    cells: &[(0, 0, One), (1, 1, One), (2, 2, One)],
};

/// Scale factors and soft iron: a symmetric distortion of the field. The prior is 10 %: ArduPilot accepts scale factors from .85 to 1.3
/// (`AP_Compass/AP_Compass_config.h`).
pub static MAG_SOFT_IRON: CompassEffect = CompassEffect {
    name: "mag_soft_iron",
    description: "the compass reads too much or too little, or iron bends the field",
    cause: "soft iron near the compass, or scale factors of its axes",
    remedy: "calibrate the compass about all axes, or apply the scale factors found",
    parameters: &[group(
        unit::PERCENT,
        Shape::Symmetric,
        &["ms_xx", "ms_yy", "ms_zz", "ms_xy", "ms_xz", "ms_yz"],
        0.1,
    )],
    cells: &[
        (0, 0, Field(0)),
        (1, 1, Field(1)),
        (2, 2, Field(2)),
        (0, 3, Field(1)),
        (1, 3, Field(0)),
        (0, 4, Field(2)),
        (2, 4, Field(0)),
        (1, 5, Field(2)),
        (2, 5, Field(1)),
    ],
};

/// A compass that is turned against the inertial unit: m = exp(θ)ᵀ b. Taken as linear, a compass that is turned by 30° seems to be turned by 28.6° with
/// 13 % of soft iron. The prior is 6°: what a mast or a foam pad gives.
pub static MAG_ROTATION: CompassEffect = CompassEffect {
    name: "mag_rotation",
    description: "the compass is turned against the inertial unit",
    cause: "a compass or an autopilot that is not mounted square",
    remedy: "turn the compass to the axes of the autopilot, or set a custom orientation",
    parameters: &[group(unit::DEG, Shape::Vector, &["mr_x", "mr_y", "mr_z"], 6.0 * unit::DEG.si)],
    cells: &[],
};

/// The field of the motors' wires in proportion to the current. The prior is 5 mG/A: at 20 A 100 mG.
pub static MAG_CURRENT: CompassEffect = CompassEffect {
    name: "mag_current",
    description: "the motors' current moves the compass",
    cause: "wires that carry the motors' current near the compass",
    remedy: "twist the wires or move the compass away from them; else calibrate the motor compensation",
    parameters: &[group(
        unit::MGAUSS_PER_A,
        Shape::Vector,
        &["mc_x", "mc_y", "mc_z"],
        5.0 * unit::MGAUSS_PER_A.si,
    )],
    cells: &[(0, 0, Current), (1, 1, Current), (2, 2, Current)],
};

/// Samples that are older than their stamps: m = b + τ ω×b. The prior is .1 s: an autopilot reads compasses at 10 Hz and more.
pub static MAG_DELAY: CompassEffect = CompassEffect {
    name: "mag_delay",
    description: "the compass is read late",
    cause: "averaging and polling of the compass, and stamps of sending",
    remedy: "none is needed below .1 s; the autopilots' filters allow for it",
    parameters: &[group(unit::S, Shape::Scalar, &["m_delay"], 0.1)],
    cells: &[(0, 0, Lag(0)), (1, 0, Lag(1)), (2, 0, Lag(2))],
};

/// A declination that is not that of the world model. The prior is 1°: NOAA's error model of the world magnetic model has .3 to .5° at middle latitudes
/// for what crust and disturbances add.
pub static MAG_DECLINATION: CompassEffect = CompassEffect {
    name: "mag_declination",
    description: "the declination differs from the world model's",
    cause: "a local anomaly, a power line or a steel structure below",
    remedy: "fly elsewhere, or set the declination by hand",
    parameters: &[group(unit::DEG, Shape::Scalar, &["m_declination"], unit::DEG.si)],
    cells: &[(0, 0, Declination(0)), (1, 0, Declination(1)), (2, 0, Declination(2))],
};

/// Every effect on a compass, the simplest first.
pub static COMPASS: &[&dyn Effect] =
    &[&MAG_HARD_IRON, &MAG_CURRENT, &MAG_ROTATION, &MAG_SOFT_IRON, &MAG_DELAY, &MAG_DECLINATION];

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns are the derivatives of what a row adds.
    #[test]
    fn columns_are_what_the_parameters_add() {
        let x = FieldInstant {
            field: Vector3::new(2e-5, -1e-5, 4e-5),
            by_declination: Vector3::new(1e-5, 2e-5, 0.0),
            rate: Vector3::new(0.3, -0.2, 0.5),
            current_a: 17.0,
        };
        for effect in COMPASS {
            let on = effect.on_field().unwrap();
            for start in [0.0, 0.3] {
                let at = vec![start; effect.len()];
                let mut columns = vec![Vector3::zeros(); effect.len()];
                on.field_jacobian(&at, &x, &mut columns);
                for (k, column) in columns.iter().enumerate() {
                    let step = 1e-5;
                    let [mut more, mut less] = [at.clone(), at.clone()];
                    (more[k], less[k]) = (start + step, start - step);
                    let by = (on.field(&more, &x) - on.field(&less, &x)) / (2.0 * step);
                    assert!((by - column).norm() < 1e-9 * (1e-5 + column.norm()), "{} {k}", effect.name());
                    assert!(column.norm() > 0.0, "{} {k}", effect.name());
                }
            }
        }
    }

    /// The sign conventions that corrections rely on.
    #[test]
    fn turned_and_late_compasses_have_the_right_sign() {
        let b = Vector3::new(2e-5, -1e-5, 4e-5);
        let x = FieldInstant { field: b, rate: Vector3::new(0.0, 0.0, 1.0), ..Default::default() };
        let turn = Vector3::new(1e-4, -2e-4, 3e-4);
        // A compass turned by θ has axes exp(θ): it shows the transposed rotation of the field.
        let shown = crate::rotation::exp(&turn).inverse() * b;
        let found = b + MAG_ROTATION.field(turn.as_slice(), &x);
        assert!((shown - found).norm() < 1e-7 * b.norm() * 10.0, "{shown} {found}");
        // Of a while ago, with the body turning right: the field in body axes turned left since.
        let dt = 1e-4;
        let before = crate::rotation::exp(&(x.rate * dt)) * b;
        assert!((before - b - MAG_DELAY.field(&[dt], &x)).norm() < 1e-7 * b.norm());
    }
}
