//! What goes wrong in hours and through faults, and what the filter makes of it.

use super::*;
use crate::earth::{self, Geodetic};
use crate::effects::GpsLatency;
use crate::model::EffectSetting;
use crate::rotation::c_nb_from_euler;
use crate::sample::{FixVelocity, GnssFix};

fn at_rest() -> NavState {
    let place = Geodetic::from_degrees(47.4, 8.5, 500.0);
    NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(0.02, -0.03, 0.5))
}

fn started(model: &Model) -> Filter {
    let initial = Initial {
        t_s: 0.0,
        nav: at_rest(),
        position_sigma_m: [1.0; 3],
        velocity_sigma_m_per_s: [0.2; 3],
        attitude_sigma_rad: [0.01, 0.01, 0.05],
    };
    Filter::new(model, &initial)
}

fn sample(t_s: f64) -> ImuSample {
    let nav = at_rest();
    let to_body = nav.q_eb.inverse();
    ImuSample {
        t_s,
        gyro: to_body * earth::rotation_rate(),
        accel: to_body * -earth::gravity(&nav.r_e),
        temperature_degc: None,
    }
}

fn fix(t_s: f64, north_m: f64) -> GnssFix {
    let mut position = at_rest().geodetic();
    position.lat_rad += north_m / 6.37e6;
    GnssFix {
        t_s,
        position,
        velocity: FixVelocity::Horizontal([0.0, 0.0]),
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    }
}

/// Samples at 50 Hz and fixes at 5 Hz from one time to another, positions off to the north by `north_m`.
fn run(fusion: &mut Fusion, from_s: f64, to_s: f64, north_m: f64) -> Vec<FixOutcome> {
    let mut outcomes = Vec::new();
    let steps = ((to_s - from_s) * 50.0).round() as u32;
    for i in 1..=steps {
        let t_s = from_s + f64::from(i) * 0.02;
        fusion.push_imu(sample(t_s));
        if i % 10 == 0 {
            fusion.push_fix(fix(t_s, north_m));
        }
        outcomes.extend(std::iter::from_fn(|| fusion.poll()));
    }
    outcomes
}

fn north_of_start(filter: &Filter) -> f64 {
    (earth::c_en_at(&at_rest().r_e).transpose() * (filter.nav().r_e - at_rest().r_e)).x
}

#[test]
fn a_gap_counts_as_long_as_it_is_however_many_fixes_fall_into_it() {
    let sigma = |fixes_hz: f64| {
        let mut fusion = Fusion::without_window(started(&Model::default()));
        run(&mut fusion, 0.0, 10.0, 0.0);
        // Five seconds without samples, then one.
        let fixes = (5.0 * fixes_hz) as u32;
        (1..=fixes).for_each(|k| fusion.push_fix(fix(10.0 + f64::from(k) / fixes_hz, 0.0)));
        fusion.push_imu(sample(15.02));
        while fusion.poll().is_some() {}
        fusion.predicted().attitude_sigma().to_degrees()
    };
    // An unseen vehicle turns at 0.5 rad/s for 5 s.
    for rate in [0.1, 1.0, 5.0, 10.0] {
        assert!(sigma(rate) > 60.0, "{rate} Hz: {}", sigma(rate));
    }
}

#[test]
fn hours_without_gnss_are_recovered_from_with_the_first_fixes() {
    let mut fusion = Fusion::new(started(&Model::standard()));
    run(&mut fusion, 0.0, 30.0, 0.0);
    for i in 0..110_000_u32 {
        fusion.push_imu(sample(30.0 + f64::from(i) * 0.1));
        while fusion.poll().is_some() {}
    }
    assert!(fusion.filter().covariance().is_sound());
    let outcomes = run(&mut fusion, 11_030.0, 11_050.0, 40.0);
    assert!(
        matches!(outcomes[0].event, Some(FixEvent::Reacquired { after_s }) if after_s > 10_900.0),
        "{:?}",
        outcomes[0]
    );
    assert!(outcomes.iter().all(FixOutcome::used));
    assert!((north_of_start(fusion.filter()) - 40.0).abs() < 5.0);
    assert!(fusion.filter().covariance().is_sound());
}

#[test]
fn a_position_that_jumps_is_reported_and_not_followed_while_the_velocity_agrees() {
    for jump_m in [55.0, 500.0] {
        let mut fusion = Fusion::new(started(&Model::standard()));
        run(&mut fusion, 0.0, 60.0, 0.0);
        let before = fusion.filter().clone();
        let outcomes = run(&mut fusion, 60.0, 85.0, jump_m);
        assert!(north_of_start(fusion.filter()).abs() < 10.0, "{}", north_of_start(fusion.filter()));
        let events: Vec<_> = outcomes.iter().filter_map(|o| o.event).collect();
        assert_eq!(events.len(), 1, "{events:?}");
        assert!(matches!(events[0], FixEvent::PositionJump { offset_m } if (offset_m - jump_m).abs() < 10.0));
        let outcomes = run(&mut fusion, 85.0, 100.0, jump_m);
        let events: Vec<_> = outcomes.iter().filter_map(|o| o.event).collect();
        assert!(matches!(events[..], [FixEvent::PositionAccepted { .. }]), "{events:?}");
        let after = fusion.filter();
        assert!((north_of_start(after) - jump_m).abs() < 10.0);
        // Attitude and constants did not notice.
        assert!(after.nav().q_eb.angle_to(&before.nav().q_eb) < 0.1 * before.attitude_sigma());
        for state in index::GYRO_BIAS..index::GYRO_BIAS + after.layout().names().len() {
            let of = |f: &Filter| f.calibration().get(f.layout(), state);
            let sigma = before.covariance().sigma(state);
            assert!((of(after) - of(&before)).abs() < 0.3 * sigma, "{state}");
        }
    }
}

/// A receiver that is deceived: before its velocity is followed, its position must not be taken for a change of tilt or bias.
#[test]
fn while_the_velocity_fails_its_test_the_position_of_the_same_fixes_is_not_followed() {
    let mut fusion = Fusion::without_window(started(&Model::default()));
    run(&mut fusion, 0.0, 10.0, 0.0);
    let mut outcomes = Vec::new();
    for i in 1..=200_u32 {
        let since_s = f64::from(i) * 0.02;
        fusion.push_imu(sample(10.0 + since_s));
        if i.is_multiple_of(10) {
            let velocity = FixVelocity::Horizontal([3.0, 0.0]);
            fusion.push_fix(GnssFix { velocity, ..fix(10.0 + since_s, 3.0 * since_s) });
        }
        outcomes.extend(std::iter::from_fn(|| fusion.poll()));
    }
    let again = outcomes.iter().position(|o| o.velocity.recovered).expect("started anew");
    assert!(outcomes[..again].iter().all(|o| !o.velocity.used));
    assert!(outcomes[3..=again].iter().all(|o| !o.position.used), "positions of the same fixes");
    assert!(outcomes[again].position.recovered);
    assert!(outcomes[again + 1..].iter().all(|o| o.position.used && o.velocity.used));
}

#[test]
fn what_is_not_finite_leaves_no_trace() {
    let mut fusion = Fusion::new(started(&Model::standard()));
    run(&mut fusion, 0.0, 5.0, 0.0);
    let nan = f64::NAN;
    for bad in [
        ImuSample { t_s: nan, ..sample(5.1) },
        ImuSample { gyro: Vector3::repeat(nan), ..sample(5.1) },
        ImuSample { accel: Vector3::repeat(f64::INFINITY), ..sample(5.1) },
        ImuSample { temperature_degc: Some(nan), ..sample(5.1) },
    ] {
        fusion.push_imu(bad);
        fusion.filter_mut().propagate(&bad);
        fusion.filter_mut().propagate_to(5.05, &bad);
    }
    for bad in [
        GnssFix { t_s: nan, ..fix(5.1, 0.0) },
        GnssFix { velocity: FixVelocity::Full([nan; 3]), ..fix(5.1, 0.0) },
        GnssFix { position_sigma_m: Some([nan; 3]), ..fix(5.1, 0.0) },
        GnssFix { yaw_rad: Some((nan, 0.1)), ..fix(5.1, 0.0) },
    ] {
        fusion.push_fix(bad);
        assert!(!fusion.filter_mut().update(&bad).used());
    }
    let outcomes = run(&mut fusion, 5.0, 10.0, 0.0);
    assert!(outcomes.len() > 20 && outcomes.iter().all(FixOutcome::used));
    assert!(!fusion.filter().has_failed() && fusion.filter().covariance().is_sound());
}

#[test]
fn a_covariance_that_broke_is_noticed_and_counts_as_a_rejection() {
    let mut filter = started(&Model::standard());
    filter.propagate(&sample(0.0));
    filter.p.add_variance(index::POSITION, -100.0);
    let outcome = filter.update(&fix(0.0, 0.0));
    assert!(!outcome.position.used && outcome.position.log_likelihood < -100.0, "{outcome:?}");
    assert!(filter.has_failed());
}

#[test]
fn constants_that_go_on_keep_the_wander_with_its_covariance() {
    let mut fusion = Fusion::new(started(&Model::standard()));
    run(&mut fusion, 0.0, 20.0, 0.0);
    run(&mut fusion, 20.0, 22.0, 3.0);
    let old = fusion.filter();
    let initial = Initial {
        t_s: 30.0,
        nav: at_rest(),
        position_sigma_m: [1.0; 3],
        velocity_sigma_m_per_s: [0.2; 3],
        attitude_sigma_rad: [0.1; 3],
    };
    let fresh = old.restarted(&initial, 0.0);
    let w = old.layout().gauss_markov().unwrap();
    assert!(Vector3::from_column_slice(&old.x[w..]).norm() > 0.1);
    assert_eq!(fresh.x[w..], old.x[w..]);
}

/// A position that came from a fix is as wrong as that fix: fixes with the same correlated error, however many, do not make it known.
#[test]
fn a_position_from_a_fix_shares_its_correlated_error() {
    let mut model = Model::default();
    model.gnss.position_correlation_s = 1e5;
    model.gnss.position_wander_sigma_m = [2.0; 3];
    let mut filter = started(&model);
    filter.place_by_fix();
    let mut fusion = Fusion::without_window(filter);
    run(&mut fusion, 0.0, 20.0, 0.0);
    let sigma = fusion.filter().ned_sigmas()[0];
    assert!(sigma.iter().all(|s| (1.9..2.2).contains(s)), "{sigma}");
    assert!(north_of_start(fusion.filter()).abs() < 0.1);
}

#[test]
fn no_fix_is_taken_for_older_than_possible() {
    let mut model = Model::standard();
    let mut latency = EffectSetting::unknown(&GpsLatency);
    for (assumed, applied) in [(-0.3, 0.0), (0.2, 0.2), (5.0, 1.0)] {
        latency.values[0] = assumed;
        model.set(latency.clone());
        assert_eq!(started(&model).fix_delay_s(0.0), applied);
    }
}

#[test]
fn a_reset_leaves_a_vertical_velocity_alone_that_no_fix_measures() {
    let mut filter = started(&Model::standard());
    filter.propagate(&sample(0.0));
    let c_en = at_rest().geodetic().c_en();
    filter.set_nav(NavState { v_e: c_en * Vector3::new(0.0, 0.0, 1.5), ..at_rest() });
    let moving = GnssFix { velocity: FixVelocity::Horizontal([20.0, -5.0]), ..fix(0.0, 0.0) };
    filter.reset_velocity(&moving);
    filter.find_estimate();
    assert!((filter.nav().v_n() - Vector3::new(20.0, -5.0, 1.5)).norm() < 1e-6);
    assert!((filter.ned_sigmas()[1].z - 0.2).abs() < 0.01, "{}", filter.ned_sigmas()[1]);
}

#[test]
fn a_dual_antenna_heading_is_used_in_flight() {
    let mut filter = started(&Model::standard());
    filter.propagate(&sample(0.0));
    let before = filter.heading_sigma();
    let outcome = filter.update(&GnssFix { yaw_rad: Some((0.52, 0.01)), ..fix(0.0, 0.0) });
    assert!(outcome.yaw.used);
    assert!(filter.heading_sigma() < 0.3 * before);
    assert!((filter.nav().euler().z - 0.52).abs() < 0.005, "{}", filter.nav().euler().z);
}

#[test]
fn a_vehicle_at_rest_is_held_and_learns_what_its_gyros_show() {
    let mut fusion = Fusion::new(started(&Model::standard())).recognising_rest();
    run(&mut fusion, 0.0, 120.0, 0.0);
    let filter = fusion.filter();
    assert!(filter.is_stationary());
    let latency = filter.layout().find("latency").unwrap();
    assert!(filter.covariance().sigma(latency) > 0.95 * filter.initial_sigmas()[latency]);
    // Heading and tilt are no better known than at the start; the vertical accelerometer bias is, as far as gravity can tell it
    // from a scale factor error.
    assert!(filter.heading_sigma() > 0.95 * 0.05);
    let vertical = filter.covariance().sigma(index::ACCEL_BIAS + 2);
    let scale = 0.003 * crate::earth::STANDARD_GRAVITY;
    assert!((0.95 * scale..1.05 * scale).contains(&vertical), "{vertical}");
    let mut exact = Fusion::new(started(&Model::calibrated())).recognising_rest();
    run(&mut exact, 0.0, 120.0, 0.0);
    assert!(exact.filter().covariance().sigma(index::ACCEL_BIAS + 2) < 0.1 * 0.2);
    // It goes as soon as it moves, and nothing of the motion is lost.
    let turned = |t_s: f64| ImuSample { gyro: sample(t_s).gyro + Vector3::new(0.0, 0.0, 0.3), ..sample(t_s) };
    let yaw = filter.nav().euler().z;
    for i in 1..=100 {
        fusion.push_imu(turned(120.0 + f64::from(i) * 0.02));
        while fusion.poll().is_some() {}
    }
    assert!(!fusion.filter().is_stationary());
    let now = fusion.predicted_nav().1.euler().z;
    assert!((now - yaw - 0.6).abs() < 0.02, "{yaw} {now}");
}

/// Evidence for a walk is a ratio: filters of which one stood recognised earlier are compared by it, and quiet gyros speak against a walk.
#[test]
fn gyros_at_rest_speak_against_a_walk_however_long_each_filter_has_known_of_the_rest() {
    let evidence = |walk_deg_per_h_per_rth: f64| {
        let mut fusion = Fusion::new(started(&Model::standard())).recognising_rest();
        let gyro = walk_deg_per_h_per_rth * crate::effects::unit::DEG_PER_H_PER_RTH.si;
        fusion.set_walk(crate::effects::BiasWalk { gyro, accel: 0.0 });
        run(&mut fusion, 0.0, 120.0, 0.0);
        fusion.filter_mut().take_rest_evidence()
    };
    assert_eq!(evidence(0.0), 0.0);
    assert!(evidence(4000.0) < -3.0, "{}", evidence(4000.0));
}
