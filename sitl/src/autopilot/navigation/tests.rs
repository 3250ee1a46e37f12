//! The autopilot's own numbers with right and with wrong parameters, in both dialects.

use super::*;
use crate::autopilot::AutopilotConfig;
use crate::scenario::scenario;
use gaware_nav::effects::{self, Effect};
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::rotation::{euler_from_c_nb, wrap_pi};

fn injected(effect: &'static dyn Effect, values: &[f64]) -> EffectSetting {
    let mut setting = EffectSetting::unknown(effect);
    setting.values.copy_from_slice(values);
    setting.sigmas.fill(0.0);
    setting
}

/// Errors over a flight with turns, pull-ups and speed changes, from 60 to 250 s.
struct Flown {
    /// RMS of the test ratios of velocity and height.
    velocity: f64,
    height: f64,
    /// RMS error of roll and pitch, deg.
    tilt_deg: f64,
}

fn fly(flavour: Flavour, effect: EffectSetting, parameters: &[(&'static str, f64)]) -> Flown {
    let scenario = scenario("fixed_wing").unwrap();
    let mut model = Model::default();
    model.set(injected(&effects::GpsLatency, &[0.12]));
    model.set(effect);
    let loop_rate_hz = if flavour == Flavour::Px4 { 100.0 } else { 200.0 };
    let usual: &[(&'static str, f64)] = match flavour {
        Flavour::Px4 => &[("EKF2_GPS_DELAY", 120.0)],
        Flavour::ArduPilot => &[],
    };
    let config = AutopilotConfig {
        flavour,
        loop_rate_hz,
        navigates: true,
        parameters: usual.iter().chain(parameters).copied().collect(),
        ..AutopilotConfig::default()
    };
    let sensors = crate::sensors::SensorConfig { vertical_velocity: true, ..scenario.sensors.clone() };
    let mut autopilot = Autopilot::new(config, scenario.trajectory(), &model, sensors);
    autopilot.step(5.0);
    autopilot.release();
    let (mut squares, mut n) = ([0.0; 3], 0.0);
    for k in 60 * 5..250 * 5 {
        autopilot.step(f64::from(k) * 0.2 + 0.1);
        autopilot.take_output();
        let angles = euler_from_c_nb(&autopilot.truth().c_nb);
        let own = autopilot.navigation.as_ref().unwrap();
        let (roll, pitch, _) = own.state.attitude.euler_angles();
        squares[0] += own.ratios.velocity.powi(2);
        squares[1] += own.ratios.height.powi(2);
        squares[2] += wrap_pi(roll - angles.x).powi(2) + wrap_pi(pitch - angles.y).powi(2);
        n += 1.0;
    }
    let [velocity, height, tilt] = squares.map(|s: f64| (s / n).sqrt());
    Flown { velocity, height, tilt_deg: tilt.to_degrees() }
}

#[test]
fn with_right_parameters_the_attitude_is_good_and_no_innovation_comes_near_its_gate() {
    for flavour in [Flavour::ArduPilot, Flavour::Px4] {
        let flown = fly(flavour, injected(&effects::GpsLatency, &[0.12]), &[]);
        assert!(flown.tilt_deg < 1.5, "{flavour:?} {}", flown.tilt_deg);
        assert!((0.01..0.3).contains(&flown.velocity), "{flavour:?} {}", flown.velocity);
        assert!((0.01..0.3).contains(&flown.height), "{flavour:?} {}", flown.height);
    }
}

/// Each effect that a parameter corrects makes the innovations larger, and the right value of the parameter takes that away.
#[test]
fn the_right_parameter_makes_its_own_innovations_smaller() {
    let lever = [0.9, -0.5, -0.3];
    let scale = [0.03, -0.02, 0.03];
    let delay = [0.2];
    type Case = (&'static dyn Effect, Vec<f64>, [Vec<(&'static str, f64)>; 2]);
    let factor = |k: usize| 1.0 / (1.0 + scale[k]);
    let cases: [Case; 3] = [
        (
            &effects::GpsLatency,
            delay.to_vec(),
            [vec![("GPS1_DELAY_MS", 200.0)], vec![("EKF2_GPS_DELAY", 200.0)]],
        ),
        (
            &effects::GpsLeverArm,
            lever.to_vec(),
            [
                vec![("GPS1_POS_X", lever[0]), ("GPS1_POS_Y", lever[1]), ("GPS1_POS_Z", lever[2])],
                vec![
                    ("EKF2_GPS_POS_X", lever[0]),
                    ("EKF2_GPS_POS_Y", lever[1]),
                    ("EKF2_GPS_POS_Z", lever[2]),
                ],
            ],
        ),
        (
            &effects::ACCEL_SCALE_FACTOR,
            scale.to_vec(),
            [
                vec![
                    ("INS_ACCSCAL_X", factor(0)),
                    ("INS_ACCSCAL_Y", factor(1)),
                    ("INS_ACCSCAL_Z", factor(2)),
                ],
                vec![
                    ("CAL_ACC0_XSCALE", factor(0)),
                    ("CAL_ACC0_YSCALE", factor(1)),
                    ("CAL_ACC0_ZSCALE", factor(2)),
                ],
            ],
        ),
    ];
    for (effect, values, right) in cases {
        for (flavour, right) in [Flavour::ArduPilot, Flavour::Px4].into_iter().zip(right) {
            let wrong = fly(flavour, injected(effect, &values), &[]);
            let corrected = fly(flavour, injected(effect, &values), &right);
            let ratio = corrected.velocity / wrong.velocity;
            assert!(
                ratio < 0.9,
                "{} {flavour:?}: {} to {}",
                effect.name(),
                wrong.velocity,
                corrected.velocity
            );
        }
    }
}
