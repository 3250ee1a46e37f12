//! The linear effects, one row each: what they act on, what drives them, their parameters with units and priors, and words. A new one is a
//! row here and a line in [`REGISTRY`](super::REGISTRY).

use super::linear::{Driver, LinearEffect, Sensor};
use super::parameters::group;
use super::{Excitation, Separation, Shape, unit};
use Driver::{Force, ForceSquared, Rate, Temperature, Vibration};

/// What calibration leaves of scale factors: 3000 ppm, consumer MEMS after factory calibration.
const SCALE_SIGMA: f64 = 3000.0 * unit::PPM.si;
/// The same of misalignments: 3 mrad.
const MISALIGNMENT_SIGMA: f64 = 3.0 * unit::MRAD.si;
/// Why pull-ups separate what goes with the specific force from what goes with the rates.
const FORCE_WITHOUT_RATES: &str = "specific force changes while the rates about roll and yaw do not";
const THREE_LOADS: &str = "three loads separate a linear from a quadratic response";
const AXIS_BY_AXIS: &str = "one axis after the other feels a force of its own";
const TEMPERATURE_REMEDY: &str =
    "run the autopilot's temperature calibration, or let it warm up before take-off";
const WARM_DRIFT: &str =
    "on a second flight that starts with a warm autopilot: the temperature comes back, a drift does not";

const fn apart(from: &'static str, fly: &'static [Excitation], why: &'static str) -> Separation {
    Separation { from, fly, why }
}

/// g-sensitivity of the gyros: δω = G f (the paper, eqs. (2), (5) and (21)). Nine coefficients, row = gyro axis, column = axis of specific
/// force; a diagonal G (the paper's 18 states) is the same effect with the off-diagonal sigmas zero. The prior is 0.1 deg/s/g, the figure of the
/// MPU-6000's data sheet.
pub static GYRO_G_SENSITIVITY: LinearEffect = LinearEffect {
    name: "gyro_g_sensitivity",
    description: "the gyros respond to specific force",
    cause: "MEMS gyros respond to linear acceleration: a property of the part, larger where the board is bent or its damping is stiff",
    remedy: "estimate it in flight and correct rates by G f, or mount the unit on softer, symmetric damping",
    acts_on: Sensor::Gyro,
    parameters: &[group(
        unit::DEG_PER_H_PER_G,
        Shape::Matrix,
        &["g11", "g12", "g13", "g21", "g22", "g23", "g31", "g32", "g33"],
        360.0 * unit::DEG_PER_H_PER_G.si,
    )],
    cells: &[
        (0, Force(0)),
        (0, Force(1)),
        (0, Force(2)),
        (1, Force(0)),
        (1, Force(1)),
        (1, Force(2)),
        (2, Force(0)),
        (2, Force(1)),
        (2, Force(2)),
    ],
    tolerance: None,
    separations: &[
        apart("gyro_misalignment", &[Excitation::PullUp], FORCE_WITHOUT_RATES),
        apart(
            "gyro_scale_factor",
            &[Excitation::VaryingSpeed, Excitation::PullUp],
            "specific force changes while the rates hardly do",
        ),
        apart("gyro_g2_sensitivity", &[Excitation::PullUp, Excitation::SteadyTurn], THREE_LOADS),
        apart(
            "gyro_bias_drift",
            &[Excitation::FigureEight],
            "flown early and again late: what returns with the load is no drift",
        ),
        apart(
            "gyro_bias_step",
            &[Excitation::FigureEight],
            "flown early and again late: what returns with the load is no step",
        ),
    ],
};

/// g²-sensitivity of the gyros: δω_i = k_i f_i² (IEEE Std 1431, the g² term of the drift model; own axis only). Under vibration the mean of f²
/// is f̄² + σ², so it also stands for the vibration rectification of a gyro. The prior is 0.01 deg/s/g²: a tenth of the linear one at 1 g; data sheets
/// that state it (ADXRS646: 1e-4 deg/s/g²) stay below.
pub static GYRO_G2_SENSITIVITY: LinearEffect = LinearEffect {
    name: "gyro_g2_sensitivity",
    description: "the gyros respond to the square of specific force",
    cause: "MEMS gyros rectify strong or vibrating acceleration",
    remedy: "reduce vibration at the unit; keep the values in the model",
    acts_on: Sensor::Gyro,
    parameters: &[group(
        unit::DEG_PER_H_PER_G2,
        Shape::Vector,
        &["g2_x", "g2_y", "g2_z"],
        36.0 * unit::DEG_PER_H_PER_G2.si,
    )],
    cells: &[(0, ForceSquared(0)), (1, ForceSquared(1)), (2, ForceSquared(2))],
    tolerance: None,
    separations: &[
        apart("gyro_misalignment", &[Excitation::PullUp], FORCE_WITHOUT_RATES),
        apart("gyro_scale_factor", &[Excitation::PullUp], FORCE_WITHOUT_RATES),
    ],
};

/// Scale-factor errors of the gyros: δω_i = s_i ω_i (Groves 2013, eq. 4.17).
pub static GYRO_SCALE_FACTOR: LinearEffect = LinearEffect {
    name: "gyro_scale_factor",
    description: "the gyros read too much or too little in proportion to the rate",
    cause: "factory calibration of the gyros, their temperature, or a driver with the wrong sensitivity",
    remedy: "calibrate the gyros on a rate table, or correct rates by the values found",
    acts_on: Sensor::Gyro,
    parameters: &[group(unit::PPM, Shape::Vector, &["sg_x", "sg_y", "sg_z"], SCALE_SIGMA)],
    cells: &[(0, Rate(0)), (1, Rate(1)), (2, Rate(2))],
    tolerance: Some(SCALE_SIGMA),
    separations: &[apart(
        "gyro_misalignment",
        &[Excitation::FigureEight, Excitation::Sideslip],
        "rotation about one axis at a time",
    )],
};

/// Scale-factor errors of the accelerometers: δf_i = s_i f_i (Groves 2013, eq. 4.16).
pub static ACCEL_SCALE_FACTOR: LinearEffect = LinearEffect {
    name: "accel_scale_factor",
    description: "the accelerometers read too much or too little in proportion to the specific force",
    cause: "factory calibration of the accelerometers, or an accelerometer calibration in positions that were not level",
    remedy: "repeat the six-position accelerometer calibration",
    acts_on: Sensor::Accel,
    parameters: &[group(unit::PPM, Shape::Vector, &["sa_x", "sa_y", "sa_z"], SCALE_SIGMA)],
    cells: &[(0, Force(0)), (1, Force(1)), (2, Force(2))],
    tolerance: Some(SCALE_SIGMA),
    separations: &[
        apart("accel_nonlinearity", &[Excitation::SteadyTurn, Excitation::PullUp], THREE_LOADS),
        apart("accel_misalignment", &[Excitation::Sideslip, Excitation::VaryingSpeed], AXIS_BY_AXIS),
    ],
};

/// Misalignment (cross coupling) of the sensitive axes of the gyros (Groves 2013, eq. 4.17, off-diagonal part).
pub static GYRO_MISALIGNMENT: LinearEffect = LinearEffect {
    name: "gyro_misalignment",
    description: "each gyro also reads a part of the rate about the other axes",
    cause: "the gyro axes are not square to each other or to the body: tolerance of the part or a tilted mounting",
    remedy: "correct rates by the matrix found, or calibrate on a rate table",
    acts_on: Sensor::Gyro,
    parameters: &[group(
        unit::MRAD,
        Shape::MatrixWithoutDiagonal,
        &["mg_xy", "mg_xz", "mg_yx", "mg_yz", "mg_zx", "mg_zy"],
        MISALIGNMENT_SIGMA,
    )],
    cells: &[(0, Rate(1)), (0, Rate(2)), (1, Rate(0)), (1, Rate(2)), (2, Rate(0)), (2, Rate(1))],
    tolerance: Some(MISALIGNMENT_SIGMA),
    separations: &[],
};

/// The same of the accelerometers (Groves 2013, eq. 4.16): an upper triangle only, since a common rotation of the whole triad is a rotation of
/// the body axes themselves and no flight could separate it from attitude.
pub static ACCEL_MISALIGNMENT: LinearEffect = LinearEffect {
    name: "accel_misalignment",
    description: "the accelerometers also read a part of the specific force along the other axes",
    cause: "the accelerometer axes are not square to each other: tolerance of the part",
    remedy: "correct specific force by the matrix found",
    acts_on: Sensor::Accel,
    parameters: &[group(unit::MRAD, Shape::UpperTriangle, &["ma_xy", "ma_xz", "ma_yz"], MISALIGNMENT_SIGMA)],
    cells: &[(0, Force(1)), (0, Force(2)), (1, Force(2))],
    tolerance: Some(MISALIGNMENT_SIGMA),
    separations: &[apart(
        "accel_nonlinearity",
        &[Excitation::Sideslip, Excitation::VaryingSpeed],
        AXIS_BY_AXIS,
    )],
};

/// Second-order non-linearity of the accelerometers: δf_i = k_i f_i² (IEEE Std 1293, the K2 term; own axis only).
///
/// It also stands for vibration rectification: where f = f̄ + v with zero-mean vibration v, the mean of δf is
/// k (f̄² + σ_v²). The square is taken by the sensor itself, before the autopilot filters and decimates: a simulator must evaluate it at the
/// force *with* the vibration. A filter that evaluates it at the received samples sees f̄² and only that part of σ_v² that the autopilot's
/// low-pass let through; the rest looks like an accelerometer bias that moves with the throttle.
///
/// The prior is 1 mg/g²: 0.5 % of ±16 g full scale (MPU-6000) is 0.3 mg/g², rectification of consumer parts reaches a few.
pub static ACCEL_NONLINEARITY: LinearEffect = LinearEffect {
    name: "accel_nonlinearity",
    description: "the accelerometers respond to the square of specific force, vibration included",
    cause: "second-order response of the accelerometers, with vibration also a bias",
    remedy: "reduce vibration at the unit, or use a part with a larger range",
    acts_on: Sensor::Accel,
    parameters: &[group(unit::MG_PER_G2, Shape::Vector, &["ka_x", "ka_y", "ka_z"], unit::MG_PER_G2.si)],
    cells: &[(0, ForceSquared(0)), (1, ForceSquared(1)), (2, ForceSquared(2))],
    tolerance: None,
    separations: &[],
};

/// Temperature drift of the gyro biases: δω_i = s_i (T − 25 °C) (Groves 2013, sec. 4.4.1). The bias of the model is the one at 25 °C; where a
/// source brings no temperature the effect adds nothing and cannot be estimated. The prior is 0.03 deg/s/°C: data sheets say ±0.005 (ICM-42688-P) to
/// ±20 deg/s from -40 to 85 °C, that is 0.16 (MPU-6000).
pub static GYRO_TEMPERATURE: LinearEffect = LinearEffect {
    name: "gyro_temperature",
    description: "the gyro biases move with temperature",
    cause: "the gyro biases are not compensated for temperature",
    remedy: TEMPERATURE_REMEDY,
    acts_on: Sensor::Gyro,
    parameters: &[group(
        unit::DEG_PER_H_PER_DEGC,
        Shape::Vector,
        &["tg_x", "tg_y", "tg_z"],
        100.0 * unit::DEG_PER_H_PER_DEGC.si,
    )],
    cells: &[(0, Temperature), (1, Temperature), (2, Temperature)],
    tolerance: None,
    separations: &[
        apart("gyro_bias_drift", &[Excitation::FigureEight], WARM_DRIFT),
        apart(
            "gyro_bias_step",
            &[Excitation::FigureEight],
            "on a second flight that starts with a warm autopilot: the temperature comes back, a step does not",
        ),
    ],
};

/// The same of the accelerometers: δf_i = s_i (T − 25 °C). The prior is 0.5 mg/°C: data sheets say ±0.15 (ICM-42688-P) to ±35 mg from 0 to
/// 70 °C, that is 0.5 (MPU-6000, x and y).
pub static ACCEL_TEMPERATURE: LinearEffect = LinearEffect {
    name: "accel_temperature",
    description: "the accelerometer biases move with temperature",
    cause: "the accelerometer biases are not compensated for temperature",
    remedy: TEMPERATURE_REMEDY,
    acts_on: Sensor::Accel,
    parameters: &[group(
        unit::MG_PER_DEGC,
        Shape::Vector,
        &["ta_x", "ta_y", "ta_z"],
        0.5 * unit::MG_PER_DEGC.si,
    )],
    cells: &[(0, Temperature), (1, Temperature), (2, Temperature)],
    tolerance: None,
    separations: &[apart("accel_bias_drift", &[Excitation::FigureEight], WARM_DRIFT)],
};

/// Vibration rectification: δf_i = k_i σ_i², a bias that goes with the power of the vibration on the axis (IEEE Std 1293, "vibration
/// rectification error"; data sheets give it in mg/g²).
///
/// Unlike [`ACCEL_NONLINEARITY`] it does not respond to the steady force: it comes from what the mounting and the sensor's loop make of fast
/// motion. σ² is the variance of the samples above a few hertz, as they were received: where the autopilot filters them first, k is per received power
/// and larger than the data sheet's. The prior is 10 mg/g²: data sheets say 0.1 (quartz) to some tens (ADXL355: 0.4 g at 7.5 g RMS is 7).
pub static VIBRATION_RECTIFICATION: LinearEffect = LinearEffect {
    name: "vibration_rectification",
    description: "the accelerometer biases move with the power of vibration",
    cause: "asymmetric response of the accelerometers or of their mounting to strong vibration",
    remedy: "mount the unit on softer dampers and balance propellers",
    acts_on: Sensor::Accel,
    parameters: &[group(
        unit::MG_PER_G2,
        Shape::Vector,
        &["kv_x", "kv_y", "kv_z"],
        10.0 * unit::MG_PER_G2.si,
    )],
    cells: &[(0, Vibration(0)), (1, Vibration(1)), (2, Vibration(2))],
    tolerance: None,
    separations: &[
        apart(
            "accel_nonlinearity",
            &[Excitation::VaryingSpeed, Excitation::PullUp],
            "throttle changes the vibration, a pull-up the steady force",
        ),
        apart(
            "accel_bias_drift",
            &[Excitation::VaryingSpeed],
            "the bias comes back with the throttle, a drift does not",
        ),
        apart(
            "accel_temperature",
            &[Excitation::VaryingSpeed],
            "the bias follows the throttle at once, the temperature slowly",
        ),
    ],
};

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;
    use crate::earth::STANDARD_GRAVITY;
    use crate::effects::testing::{check_jacobians, instant};
    use crate::effects::{Effect, Instant, Surroundings};
    use nalgebra::Vector3;

    #[test]
    fn every_row_has_a_cell_for_each_parameter_and_right_jacobians() {
        let rows = [
            &GYRO_G_SENSITIVITY,
            &GYRO_G2_SENSITIVITY,
            &GYRO_SCALE_FACTOR,
            &ACCEL_SCALE_FACTOR,
            &GYRO_MISALIGNMENT,
            &ACCEL_MISALIGNMENT,
            &ACCEL_NONLINEARITY,
            &GYRO_TEMPERATURE,
            &ACCEL_TEMPERATURE,
            &VIBRATION_RECTIFICATION,
        ];
        for row in rows {
            assert_eq!(row.cells.len(), row.len(), "{}", row.name);
            check_jacobians(row);
        }
    }

    #[test]
    fn g_sensitivity_adds_g_times_f() {
        let p = [1e-4, 0.0, 0.0, 0.0, 0.0, 2e-4, 0.0, 0.0, 0.0];
        let added = GYRO_G_SENSITIVITY.gyro(&p, &instant([0.0; 3], [2.0, 0.0, -9.8]));
        assert!((added - Vector3::new(2e-4, -19.6e-4, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn a_thousand_ppm_is_a_thousandth() {
        let x = instant([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]);
        let gyro = GYRO_SCALE_FACTOR.gyro(&[1e-3, 0.0, 0.0], &x);
        assert!((gyro - Vector3::new(1e-4, 0.0, 0.0)).norm() < 1e-15);
        let accel = ACCEL_SCALE_FACTOR.accel(&[0.0, 0.0, 1e-3], &x);
        assert!((accel - Vector3::new(0.0, 0.0, 3e-3)).norm() < 1e-15);
    }

    #[test]
    fn misalignment_couples_row_with_column() {
        let x = instant([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]);
        let added = GYRO_MISALIGNMENT.gyro(&[0.0, 1e-3, 0.0, 0.0, 0.0, 0.0], &x);
        assert!((added - Vector3::new(3e-4, 0.0, 0.0)).norm() < 1e-15);
        let added = ACCEL_MISALIGNMENT.accel(&[0.0, 0.0, 1e-3], &x);
        assert!((added - Vector3::new(0.0, 3e-3, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn g2_sensitivity_does_not_know_the_sign_of_the_force() {
        let p = [1e-5, 2e-5, 3e-5];
        let up = GYRO_G2_SENSITIVITY.gyro(&p, &instant([0.0; 3], [1.0, -2.0, 10.0]));
        let down = GYRO_G2_SENSITIVITY.gyro(&p, &instant([0.0; 3], [-1.0, 2.0, -10.0]));
        assert_eq!(up, down);
        assert!((up - Vector3::new(1e-5, 8e-5, 3e-3)).norm() < 1e-15);
    }

    #[test]
    fn nonlinearity_is_one_milli_g_at_one_g() {
        let p = [unit::MG_PER_G2.si, 0.0, 0.0];
        let added = ACCEL_NONLINEARITY.accel(&p, &instant([0.0; 3], [-STANDARD_GRAVITY, 5.0, 5.0]));
        assert!((added - Vector3::new(1e-3 * STANDARD_GRAVITY, 0.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn vibration_of_zero_mean_leaves_a_mean_however_few_samples_are_kept() {
        let (p, amplitude) = ([1e-3; 3], 3.0);
        for keep in [1_u32, 7, 13] {
            let (mut sum, mut n) = (0.0, 0.0);
            for k in (0..13_000_u32).step_by(keep as usize) {
                let v = amplitude * sin(f64::from(k) * 0.7);
                sum += ACCEL_NONLINEARITY.accel(&p, &instant([0.0; 3], [v, 0.0, 0.0])).x;
                n += 1.0;
            }
            let expected = 1e-3 * amplitude * amplitude / 2.0;
            assert!((sum / n / expected - 1.0).abs() < 0.02, "every {keep}: {}", sum / n);
        }
    }

    #[test]
    fn temperature_adds_slope_times_degrees_above_25() {
        let x = instant([0.0; 3], [0.0, 0.0, -9.8]);
        let at = |t: f64| Instant { temperature_above_25_degc: t, ..x };
        assert_eq!(GYRO_TEMPERATURE.gyro(&[1e-4, 0.0, 0.0], &at(10.0)), Vector3::new(1e-3, 0.0, 0.0));
        assert_eq!(ACCEL_TEMPERATURE.accel(&[0.0, 2e-3, 0.0], &at(-5.0)), Vector3::new(0.0, -1e-2, 0.0));
        assert_eq!(GYRO_TEMPERATURE.gyro(&[1e-4; 3], &at(0.0)), Vector3::zeros());
    }

    #[test]
    fn rectification_is_ten_milli_g_at_one_g_of_vibration_whatever_the_steady_force() {
        let p = [10.0 * unit::MG_PER_G2.si, 0.0, 0.0];
        let power = STANDARD_GRAVITY * STANDARD_GRAVITY;
        let around = Surroundings { vibration: Vector3::new(power, power, 0.0), ..Surroundings::default() };
        for force in [0.0, -30.0] {
            let x = Instant { around, ..instant([0.1; 3], [force; 3]) };
            let added = VIBRATION_RECTIFICATION.accel(&p, &x);
            assert!((added - Vector3::new(0.01 * STANDARD_GRAVITY, 0.0, 0.0)).norm() < 1e-12, "{added}");
        }
    }
}
