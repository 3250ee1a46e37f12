use super::*;
use crate::earth::{self, Geodetic};
use crate::filter::layout::index;
use crate::rotation::c_nb_from_euler;
use crate::sample::{AttitudeHint, FixVelocity, Steps};
use nalgebra::Vector3;
use rand::RngExt;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

fn at_rest() -> NavState {
    let place = Geodetic::from_degrees(47.4, 8.5, 500.0);
    NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.02, -0.03, 0.5))
}

/// The fix and the hint of a vehicle at this place, with noise from the source of numbers.
fn feed_aids(
    estimator: &mut Estimator,
    t_s: f64,
    nav: &NavState,
    noise: &mut impl FnMut(f64) -> Vector3<f64>,
) {
    let off = noise(1.0);
    let place = nav.geodetic();
    let position =
        Geodetic { lat_rad: place.lat_rad + off.x / 6.37e6, lon_rad: place.lon_rad + off.y / 4.3e6, ..place };
    let velocity = FixVelocity::Full(noise(0.1).into());
    estimator.feed(&Sample::Fix(GnssFix {
        t_s,
        position,
        velocity,
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    }));
    estimator.feed(&Sample::Attitude(AttitudeHint { t_s, roll_pitch_yaw: [0.02, -0.03, 0.5] }));
}

/// A vehicle at rest whose link lets samples through in bursts for two minutes, up to 1.3 s apart, and fixes in between; `each` sees
/// the estimator after every fix.
fn with_short_gaps(seed: u64, mut each: impl FnMut(f64, &Estimator)) -> Estimator {
    let nav = at_rest();
    let to_body = nav.q_eb.inverse();
    let (gyro, accel) = (to_body * earth::rotation_rate(), to_body * -earth::gravity(&nav.r_e));
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut noise = |sigma: f64| Vector3::from_fn(|_, _| sigma * 3.46 * (random.random::<f64>() - 0.5));
    let mut estimator = Estimator::new(Model::standard());
    let mut next_s = 0.0;
    for i in 0..20_000_u32 {
        let t_s = f64::from(i) * 0.02;
        if t_s >= next_s {
            let (gyro, accel) = (gyro + noise(0.002), accel + noise(0.02));
            estimator.feed(&Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None }));
            let burst = noise(1.0);
            if (100.0..220.0).contains(&t_s) && burst.x > 0.0 {
                next_s = t_s + 0.7 + 0.35 * burst.y;
            }
        }
        if i % 10 == 0 {
            feed_aids(&mut estimator, t_s, &nav, &mut noise);
            each(t_s, &estimator);
        }
    }
    estimator
}

#[test]
fn many_short_gaps_while_stationary_leave_an_attitude_that_its_sigma_covers() {
    let nav = at_rest();
    for seed in 0..6 {
        let estimator = with_short_gaps(seed, |_, _| ());
        let filter = estimator.filter().expect("it runs");
        let wrong = crate::rotation::log(&(filter.nav().q_eb.inverse() * nav.q_eb));
        for k in 0..3 {
            let sigma = filter.covariance().sigma(index::ATTITUDE + k);
            assert!(
                wrong[k].abs() < 4.0 * sigma && sigma < 0.35,
                "seed {seed}, axis {k}: {} {sigma}",
                wrong[k]
            );
        }
    }
}

/// An uncertain tilt, which short gaps bring, makes no bias uncertain once the vehicle is aligned anew.
#[test]
fn what_was_known_of_the_biases_outlasts_many_short_gaps() {
    for seed in 0..3 {
        let sigmas = |e: &Estimator| {
            e.filter().map(|f| [0, 1, 2].map(|k| f.covariance().sigma(index::ACCEL_BIAS + k)))
        };
        let (mut before, mut anew) = ([0.0; 3], 0);
        let estimator = with_short_gaps(seed, |t_s, estimator| {
            if t_s < 100.0 {
                before = sigmas(estimator).unwrap_or(before);
            }
            anew += usize::from(estimator.filter().is_none() && t_s > 100.0);
        });
        assert!(anew > 0, "seed {seed}: never aligned anew");
        let after = sigmas(&estimator).expect("it runs");
        for (a, b) in after.iter().zip(before) {
            assert!(*a < 1.5 * b, "seed {seed}: {before:?} {after:?}");
        }
    }
}

/// Samples of a vehicle that stands, without a fix, for so long, s; the times go on from `from_s`.
fn stand(estimator: &mut Estimator, from_s: f64, for_s: f64, noise: &mut impl FnMut(f64) -> Vector3<f64>) {
    let nav = at_rest();
    let to_body = nav.q_eb.inverse();
    let (gyro, accel) = (to_body * earth::rotation_rate(), to_body * -earth::gravity(&nav.r_e));
    for i in 0..(for_s / 0.02) as u32 {
        let t_s = from_s + f64::from(i) * 0.02;
        let (gyro, accel) = (gyro + noise(0.002), accel + noise(0.02));
        estimator.feed(&Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None }));
        if i % 10 == 0 {
            estimator.feed(&Sample::Attitude(AttitudeHint { t_s, roll_pitch_yaw: [0.02, -0.03, 0.5] }));
        }
    }
}

/// Samples of a vehicle at rest and its fixes, five in a second; with this heading, where someone says one.
fn rest_with_fixes(estimator: &mut Estimator, from_s: f64, to_s: f64, hinted_yaw: Option<f64>) {
    let nav = at_rest();
    let to_body = nav.q_eb.inverse();
    let (gyro, accel) = (to_body * earth::rotation_rate(), to_body * -earth::gravity(&nav.r_e));
    for i in (from_s * 50.0) as u32..(to_s * 50.0) as u32 {
        let t_s = f64::from(i) * 0.02;
        estimator.feed(&Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None }));
        if i % 10 != 0 {
            continue;
        }
        let velocity = FixVelocity::Full([0.0; 3]);
        let (position_sigma_m, velocity_sigma_m_per_s) = (None, None);
        let position = nav.geodetic();
        estimator.feed(&Sample::Fix(GnssFix {
            t_s,
            position,
            velocity,
            position_sigma_m,
            velocity_sigma_m_per_s,
            yaw_rad: None,
        }));
        if let Some(yaw) = hinted_yaw {
            estimator.feed(&Sample::Attitude(AttitudeHint { t_s, roll_pitch_yaw: [0.02, -0.03, yaw] }));
        }
    }
}

/// PX4 publishes an attitude about a second after its first samples, when fixes are there already.
#[test]
fn a_heading_that_comes_late_ends_the_search_for_it() {
    let mut estimator = Estimator::new(Model::standard());
    rest_with_fixes(&mut estimator, 0.0, 3.0, None);
    assert_eq!(estimator.stage(), Stage::SearchingHeading);
    let [roll, pitch, yaw] = estimator.euler_sigma().unwrap().into();
    assert!(yaw > 1.7 && roll.max(pitch) < 0.05, "nothing is known of the heading: {roll} {pitch} {yaw}");
    rest_with_fixes(&mut estimator, 3.0, 4.0, Some(0.5));
    assert_eq!(estimator.stage(), Stage::Running);
    let (heading, sigma) = (estimator.filter().unwrap().nav().euler().z, estimator.euler_sigma().unwrap().z);
    assert!((heading - 0.5).abs() < 0.01 && sigma < 0.15, "{heading} ± {sigma}");
}

/// It begins by its home position, takes off before the first fix, and says so once: its motion waits for a fix, its constants are kept.
#[test]
fn a_vehicle_that_leaves_its_home_before_the_first_fix_says_so_once() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut noise = |sigma: f64| Vector3::from_fn(|_, _| sigma * 3.46 * (random.random::<f64>() - 0.5));
    let mut estimator = Estimator::new(Model::standard());
    estimator.feed(&Sample::Place(at_rest().geodetic()));
    estimator.set_flight(false, false);
    stand(&mut estimator, 0.0, 40.0, &mut noise);
    assert_eq!(estimator.on_ground_without_fixes(), Some(true), "place and heading are known");
    let sigma = |e: &Estimator| e.filter().map(|f| f.covariance().sigma(index::GYRO_BIAS));
    let known = sigma(&estimator).expect("it runs");
    estimator.take_events();
    estimator.set_flight(true, true);
    stand(&mut estimator, 40.0, 5.0, &mut noise);
    let left: Vec<_> =
        estimator.take_events().into_iter().filter(|e| *e == EstimatorEvent::PlaceLeft).collect();
    assert_eq!(left.len(), 1);
    assert!(estimator.filter().is_none(), "its motion waits for a fix");
    feed_aids(&mut estimator, 45.0, &at_rest(), &mut noise);
    stand(&mut estimator, 45.02, 2.0, &mut noise);
    feed_aids(&mut estimator, 47.02, &at_rest(), &mut noise);
    stand(&mut estimator, 47.04, 2.0, &mut noise);
    assert!(sigma(&estimator).is_some_and(|s| s < 1.5 * known), "{known} {:?}", sigma(&estimator));
    // A home position after a fix is no better place.
    estimator.feed(&Sample::Place(Geodetic::from_degrees(-30.0, 8.0, 0.0)));
    assert!(estimator.place_fix().is_none_or(|f| f.position.lat_rad > 0.0));
}

/// Half a count that is added where none is missing was 1500 ppm of a scale factor known to 240.
#[test]
fn integers_that_are_rounded_where_others_truncate_are_recognised() {
    let steps = Steps::RAW_IMU;
    for (turned, rounds) in [(f64::round as fn(f64) -> f64, true), (f64::trunc, false)] {
        let nav = at_rest();
        let force = nav.q_eb.inverse() * -earth::gravity(&nav.r_e);
        let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
        let mut noise = |sigma: f64| Vector3::from_fn(|_, _| sigma * 3.46 * (random.random::<f64>() - 0.5));
        let mut live = Estimator::new(Model::standard());
        let quantisation = Quantisation::Truncate(steps);
        live.feed(&Sample::Stream(ImuStream { quantisation, ..ImuStream::default() }));
        for i in 0..6000_u32 {
            let t_s = f64::from(i) * 0.02;
            // Three counts of noise: zero is passed often.
            let gyro = noise(3.0 * steps.gyro).map(|v| turned(v / steps.gyro) * steps.gyro);
            let accel = (force + noise(3.0 * steps.accel)).map(|v| turned(v / steps.accel) * steps.accel);
            live.feed(&Sample::Imu(ImuSample { t_s, gyro, accel, temperature_degc: None }));
            if i % 10 == 0 {
                feed_aids(&mut live, t_s, &nav, &mut noise);
            }
        }
        let found = live.take_events().contains(&EstimatorEvent::Rounding { rounds: true });
        assert_eq!((found, live.stage()), (rounds, Stage::Running));
        assert_eq!(matches!(live.dequantiser.quantisation(), Quantisation::Round(_)), rounds);
    }
}
