//! PX4 integrates its inertial samples by trapezoids, so that each shares half of its noise with the next, and what arrives is noisier or
//! quieter than any model says. A g-sensitivity that is not there must not be found in such a stream.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use gaware_nav::consistency::error;
use gaware_nav::estimator::Estimator;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::index;
use gaware_nav::mechanization::NavState;
use gaware_nav::model::Model;
use gaware_nav::sample::{ImuSample, Quantisation, Sample};
use gaware_sitl::scenario::scenario;
use gaware_sitl::sensors::{Flight, draw_vehicle};
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::{Flown, Scripted};
use gaware_sitl::truth::Trajectory;

/// Errors over sigmas of the nine elements of G, and of the attitude, at the end of a flight without g-sensitivity.
fn flown(rate_hz: f64, louder: f64, seed: u64) -> (Vec<f64>, f64) {
    let base = scenario("fixed_wing").unwrap();
    let mut model = Model::standard();
    model.gnss = base.model.gnss.clone();
    let mut vehicle = draw_vehicle(&model, seed);
    vehicle.imu.gyro_noise = louder * model.imu.gyro_noise;
    vehicle.imu.accel_noise = louder * model.imu.accel_noise;
    for setting in &mut vehicle.effects {
        // No fix is older than nothing.
        let impossible = setting.effect.fix_delay_s(&setting.values, 0.0) < 0.0;
        if impossible || setting.effect.name() == "gyro_g_sensitivity" {
            setting.values.fill(0.0);
        }
    }
    let mut sensors = base.sensors.clone();
    sensors.imu_rate_hz = rate_hz;
    sensors.attitude_rate_hz = 2.0;
    sensors.attitude_sigma_rad = [0.05, 0.05, 0.14];
    sensors.quantisation = Quantisation::None;
    sensors.message = "HIGHRES_IMU".into();
    let mut estimator = Estimator::new(model);
    let trajectory = Flown::with_step(FixedWing::new(true).paused(5.0, 20.0), 0.02);
    let (mut truth, mut before) = (trajectory.clone(), None::<ImuSample>);
    Flight::new(Box::new(trajectory), &vehicle, sensors, seed).for_each(|(sample, _)| {
        let sample = match sample {
            Sample::Imu(now) => {
                let last = before.replace(now).unwrap_or(now);
                // The mean of an interval stands at its middle.
                Sample::Imu(ImuSample {
                    t_s: 0.5 * (last.t_s + now.t_s),
                    gyro: 0.5 * (last.gyro + now.gyro),
                    accel: 0.5 * (last.accel + now.accel),
                    ..now
                })
            }
            other => other,
        };
        let _ = estimator.feed(&sample);
    });
    let filter = estimator.filter().unwrap();
    let at = truth.truth_at(filter.t_s());
    let nav = NavState::from_ned(at.place, &at.v_n, &at.c_nb);
    let off = error(filter, &nav, &Calibration::new(&vehicle));
    let sigma = |state: usize| filter.covariance().sigma(state);
    let names = filter.layout().names();
    let g = names.iter().enumerate().filter(|(_, n)| n.effect == "gyro_g_sensitivity");
    let g = g.map(|(k, _)| off[index::GYRO_BIAS + k] / sigma(index::GYRO_BIAS + k)).collect();
    let attitude = (6..9).map(|k| (off[k] / sigma(k)).powi(2)).sum::<f64>() / 3.0;
    (g, attitude)
}

#[test]
fn no_g_sensitivity_is_found_in_trapezoidal_means_at_any_noise() {
    for (rate_hz, louder) in [(125.0, 0.5), (125.0, 10.0), (250.0, 3.0)] {
        let flights: Vec<_> = (1..=4).map(|seed| flown(rate_hz, louder, seed)).collect();
        let g: Vec<f64> = flights.iter().flat_map(|f| f.0.iter().copied()).collect();
        let mean_square = g.iter().map(|z| z * z).sum::<f64>() / g.len() as f64;
        let worst = g.iter().fold(0.0_f64, |w, z| w.max(z.abs()));
        let attitude = flights.iter().map(|f| f.1).sum::<f64>() / flights.len() as f64;
        println!(
            "{rate_hz} Hz, noise x {louder}: G mean square {mean_square:.2}, worst {worst:.2}, attitude {attitude:.2}"
        );
        assert_eq!(g.len(), 36);
        assert!(worst < 3.5 && mean_square < 1.6, "{rate_hz} Hz, {louder}: {g:.2?}");
        assert!(attitude < 2.5, "{rate_hz} Hz, {louder}: {attitude}");
    }
}
