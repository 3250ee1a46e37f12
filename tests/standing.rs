//! Where nothing can be learnt, nothing is: on the bench and without fixes the sigmas of G stay at their prior, and the
//! status says why.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::engine::snapshot::{Phase, Status, Summary};
use gaware::engine::{Engine, EngineOptions};
use gaware_nav::model::Model;
use gaware_nav::sample::Sample;
use gaware_sitl::scenario::scenario;

/// The prior sigma of the model that is used where none is given, deg/h/g (0.1 deg/s/g).
const PRIOR: f64 = 360.0;
/// A gyro that stands tells the sum of bias and G·f: against a bias sigma of 0.5 deg/s, column z loses 2 %.
const STANDING_SHARE: f64 = 0.97;

fn fly(name: &str, until_s: f64, mut keep: impl FnMut(&Sample) -> bool) -> Engine {
    let mut engine = Engine::new(Model::standard(), EngineOptions::default());
    for (sample, truth) in scenario(name).unwrap().flight(1) {
        if truth.t_s > until_s {
            break;
        }
        if keep(&sample) {
            engine.feed(&sample);
        }
    }
    engine
}

fn smallest_sigma(s: &Summary) -> f64 {
    s.estimate.g_sensitivity_deg_per_h_per_g.sigma.iter().flatten().copied().fold(f64::INFINITY, f64::min)
}

fn assert_nothing_learnt(s: &Summary) {
    support::assert_finite(&serde_json::to_value(s).unwrap(), "summary");
    assert!(smallest_sigma(s) >= STANDING_SHARE * PRIOR, "{:?}", s.estimate.g_sensitivity_deg_per_h_per_g);
    let c = &s.observability.conditions;
    assert!(!c.a.met && !c.b.met && !c.c.met, "{c:?}");
    let of_g: Vec<_> = s.observability.states.iter().filter(|s| s.name.starts_with('g')).collect();
    assert_eq!(of_g.len(), 9);
    assert!(of_g.iter().all(|s| s.status <= Status::Weak), "{of_g:?}");
}

/// A running engine shakes the accelerometers by 3 m/s² RMS and the gyros with them: that is no excitation.
#[test]
fn ten_minutes_of_vibration_on_the_bench_meet_no_condition() {
    let mut sum = (0.0, 0_u32);
    let engine = fly("bench_vibration", 600.0, |s| {
        if let Sample::Imu(imu) = s {
            let gravity = 9.81;
            sum = (sum.0 + (imu.accel.norm() - gravity).powi(2), sum.1 + 1);
        }
        true
    });
    assert!((sum.0 / f64::from(sum.1)).sqrt() > 1.0, "it shakes along gravity: {sum:?}");
    let summary = engine.summary();
    assert_nothing_learnt(&summary);
    assert_eq!(summary.phase, Phase::Running);
    assert!(summary.waiting_for.contains("stationary"), "{}", summary.waiting_for);
}

#[test]
fn ten_minutes_on_the_bench_teach_nothing_about_g() {
    let summary = fly("bench", 600.0, |_| true).summary();
    assert_nothing_learnt(&summary);
    assert_eq!(summary.phase, Phase::Running);
    assert!(summary.waiting_for.contains("stationary"), "{}", summary.waiting_for);
    assert!(summary.gnss.used > 2900, "{:?}", summary.gnss);
    let attitude = summary.estimate.attitude_deg;
    assert!(attitude.value[0].abs() < 3.0 && attitude.value[1].abs() < 3.0, "{attitude:?}");
}

#[test]
fn half_a_minute_on_the_bench_teaches_nothing_about_g() {
    let summary = fly("bench", 30.0, |_| true).summary();
    assert_nothing_learnt(&summary);
    assert!(summary.waiting_for.contains("stationary"), "{}", summary.waiting_for);
}

#[test]
fn a_flight_without_any_fix_teaches_nothing_and_says_so() {
    let summary = fly("fixed_wing", 120.0, |s| !matches!(s, Sample::Fix(_))).summary();
    assert_nothing_learnt(&summary);
    assert_eq!(summary.phase, Phase::WaitingForGnss);
    assert!(summary.waiting_for.contains("no GNSS fix"), "{}", summary.waiting_for);
}

#[test]
fn an_outage_teaches_nothing_diverges_in_nothing_and_ends_with_the_next_fix() {
    const OUTAGE_S: (f64, f64) = (100.0, 160.0);
    let outage = |s: &Sample| !matches!(s, Sample::Fix(f) if (OUTAGE_S.0..OUTAGE_S.1).contains(&f.t_s));
    let before = fly("fixed_wing", OUTAGE_S.0 - 0.1, outage).summary();
    let during = fly("fixed_wing", OUTAGE_S.1 - 0.1, outage).summary();
    let after = fly("fixed_wing", 300.0, outage).summary();
    for s in [&before, &during, &after] {
        support::assert_finite(&serde_json::to_value(s).unwrap(), "summary");
    }
    assert!(during.waiting_for.contains("no GNSS fix for 60 s"), "{}", during.waiting_for);
    // The last fix before the outage is applied a moment after its arrival.
    assert!(smallest_sigma(&during) > 0.97 * smallest_sigma(&before), "{during:?}");
    assert_eq!(after.waiting_for, "");
    assert!(smallest_sigma(&after) < 0.9 * smallest_sigma(&during), "{after:?}");
    assert!((0.5..1.5).contains(&after.consistency.nis_mean_per_dof), "{:?}", after.consistency);
}
