//! Explanations of ground sessions: a unit turned by hand, with a receiver, without one, and together with a flight.

use super::*;
use crate::explain::contract::Verdict;
use gaware_nav::effects::unit::{DEG_PER_H_PER_G, PPM};
use gaware_nav::effects::{self, Effect};
use gaware_nav::sample::ImuStream;
use gaware_sitl::sensors::{Flight as Simulated, SensorConfig};
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::hand::Hand;

/// Six sides by hand of a unit with these errors; with the fixes of a receiver or with the place alone.
fn session(hidden: &[EffectSetting], receiver: bool) -> Vec<Sample> {
    let mut unit = Model::default();
    unit.imu.gyro_bias = [4e-3, -2e-3, 3e-3];
    unit.imu.accel_bias = [0.06, -0.1, 0.04];
    hidden.iter().for_each(|h| unit.set(h.clone()));
    let sensors = SensorConfig {
        imu_rate_hz: 50.0,
        fix_rate_hz: 5.0,
        message: "HIGHRES_IMU".into(),
        attitude_rate_hz: 5.0,
        attitude_sigma_rad: [0.02, 0.02, 0.1],
        ..SensorConfig::default()
    };
    let path = Flown::with_step(Hand::six_sides(24.0), 0.02);
    let place = gaware_sitl::truth::Trajectory::truth_at(&mut path.clone(), 0.0).place;
    let flown = Simulated::new(Box::new(path), &unit, sensors, 7).map(|(sample, _)| sample);
    let kept = flown.filter(|s| receiver || !matches!(s, Sample::Fix(_)));
    (!receiver).then_some(Sample::Place(place)).into_iter().chain(kept).collect()
}

fn explained(logs: &[Vec<Sample>]) -> Explained {
    samples(logs, &[], &Model::default(), &Settings { tolerances: true, ..Settings::default() }, &|_| {})
}

fn known(effect: &'static dyn Effect, values: &[f64]) -> EffectSetting {
    EffectSetting::known(effect, values).unwrap()
}

/// Values and sigmas of an effect that was named, SI.
fn found<'a>(e: &'a Explained, name: &str) -> &'a EffectSetting {
    assert!(e.explanation.effects.iter().any(|x| x.names == [name]), "{}", e.explanation.summary);
    e.model.get(name).unwrap()
}

const G: [f64; 9] = [120.0, -40.0, 210.0, 65.0, -180.0, 30.0, -95.0, 150.0, -260.0];

#[test]
fn g_and_scale_of_a_unit_turned_by_hand_are_named_with_and_without_a_receiver() {
    let g = known(&effects::GYRO_G_SENSITIVITY, &G.map(|v| v * DEG_PER_H_PER_G.si));
    let scale = known(&effects::ACCEL_SCALE_FACTOR, &[2500.0, -4000.0, 3000.0].map(|v| v * PPM.si));
    for receiver in [true, false] {
        let e = explained(&[session(&[g.clone(), scale.clone()], receiver)]);
        assert_eq!(e.explanation.verdict, Verdict::Explained, "{}", e.explanation.summary);
        for (name, truth, unit, finest) in [
            ("gyro_g_sensitivity", &g.values, DEG_PER_H_PER_G.si, 12.0),
            ("accel_scale_factor", &scale.values, PPM.si, 800.0),
        ] {
            let own = found(&e, name);
            for (k, truth) in truth.iter().enumerate() {
                let (value, sigma) = (own.values[k] / unit, own.sigmas[k] / unit);
                assert!(
                    sigma < finest && (value - truth / unit).abs() < 4.0 * sigma,
                    "{name} {k}: {value} ± {sigma}"
                );
            }
        }
    }
}

#[test]
fn a_clean_unit_turned_by_hand_has_nothing_named() {
    for receiver in [true, false] {
        let e = explained(&[session(&[], receiver)]).explanation;
        assert_eq!(e.verdict, Verdict::NothingMissing, "{receiver}: {}", e.summary);
    }
}

#[test]
fn a_reversed_gyro_axis_is_named_on_the_ground() {
    let reversed: Vec<Sample> = session(&[], false)
        .into_iter()
        .map(|s| match s {
            Sample::Imu(mut imu) => {
                imu.gyro.x = -imu.gyro.x;
                Sample::Imu(imu)
            }
            other => other,
        })
        .collect();
    let e = explained(&[reversed]);
    let named: Vec<_> = e.explanation.effects.iter().flat_map(|x| x.names.clone()).collect();
    let is_mistake = |n: &&str| effects::find(n).is_some_and(|x| x.is_source_mistake());
    assert!(named.iter().any(is_mistake), "{}", e.explanation.summary);
}

/// Rest in one attitude says nothing, with or without a receiver, and says so.
#[test]
fn a_unit_that_nobody_turned_is_too_little() {
    let still: Vec<Sample> = session(&[], false)
        .into_iter()
        .filter(|s| !matches!(s, Sample::Imu(imu) if imu.t_s > 28.0))
        .collect();
    let e = explained(&[still]).explanation;
    assert_eq!(e.verdict, Verdict::TooLittleData);
    assert!(e.summary.contains("six sides"), "{}", e.summary);
    let stream = ImuStream { message: "HIGHRES_IMU".into(), ..ImuStream::default() };
    let empty = explained(&[vec![Sample::Stream(stream)]]).explanation;
    assert_eq!(empty.verdict, Verdict::TooLittleData);
}
