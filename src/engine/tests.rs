use super::situation::SituationKind;
use super::snapshot::{Phase, StateStatus, Status};
use super::*;
use gaware_nav::sample::RestartReason;
use gaware_sitl::scenario::{Scenario, scenario};

fn named(name: &str) -> Scenario {
    scenario(name).unwrap()
}

/// Feeds a scenario until `until_s`.
fn fly(scenario: &Scenario, seed: u64, until_s: f64) -> Engine {
    fly_with(Model::standard(), scenario, seed, until_s)
}

fn fly_with(model: Model, scenario: &Scenario, seed: u64, until_s: f64) -> Engine {
    let mut engine = Engine::new(model, EngineOptions::default());
    for (sample, _) in scenario.flight(seed).take_while(|(_, t)| t.t_s <= until_s) {
        engine.feed(&sample);
    }
    engine
}

fn is_g(state: &StateStatus) -> bool {
    state.unit == "deg/h/g"
}

#[test]
fn before_anything_came_priors_are_shown_and_nothing_is_claimed() {
    let now = Engine::new(Model::standard(), EngineOptions::default()).snapshot();
    assert_eq!(now.phase, Phase::WaitingForImu);
    assert_eq!(now.estimate.g_sensitivity_deg_per_h_per_g.sigma[1][2].round(), 360.0);
    assert_eq!(now.estimate.gyro_bias_deg_per_h.sigma[0].round(), 1800.0);
    assert!(now.observability.states.iter().all(|s| s.status == Status::Unobservable));
    assert_eq!(now.observability.states.len(), 16);
    // The latency, what a consumer unit's scale factors, axes and antenna are uncertain by, smoothing and skew of the receiver.
    assert_eq!(now.estimate.effects.len(), 21);
}

#[test]
fn on_a_shaking_bench_g_stays_at_its_prior_and_the_status_says_why() {
    for name in ["bench", "bench_vibration"] {
        let now = fly(&named(name), 3, 60.0).snapshot();
        assert_eq!(now.phase, Phase::Running, "{name}");
        for state in now.observability.states.iter().filter(|s| is_g(s)) {
            assert!(state.sigma_ratio > 0.95 && state.status == Status::Unobservable, "{name} {state:?}");
        }
        assert!(now.waiting_for.contains("nothing excites G"), "{name}: {}", now.waiting_for);
        let speed = now.motion.velocity_ned_m_per_s.map(f64::abs);
        assert!(speed.iter().all(|v| *v < 1.0), "{name} {speed:?}");
        assert!((now.imu.rate_hz - 200.0).abs() < 2.0 && (now.gnss.rate_hz - 5.0).abs() < 0.3);
    }
}

#[test]
fn without_any_fix_nothing_diverges_and_nothing_is_learned() {
    let mut bench = named("bench_vibration");
    bench.sensors.fix_rate_hz = 0.0;
    let now = fly(&bench, 1, 60.0).snapshot();
    assert_eq!(now.phase, Phase::WaitingForGnss);
    assert!(now.waiting_for.contains("no GNSS fix"));
    assert!(now.observability.states.iter().all(|s| s.sigma_ratio == 1.0));
    let [roll, pitch, yaw] = now.estimate.attitude_deg.value;
    assert!((roll - 1.0).abs() < 3.0 && (pitch - 2.0).abs() < 3.0 && yaw == 0.0, "{roll} {pitch}");
    assert!(now.estimate.attitude_deg.sigma[2] > 100.0);
}

#[test]
fn an_outage_is_reported_and_survived() {
    let mut flight = named("fixed_wing");
    flight.sensors.outages = vec![(60.0, 90.0)];
    let during = fly(&flight, 2, 89.0).snapshot();
    assert!(during.waiting_for.contains("no GNSS fix for 29 s"), "{}", during.waiting_for);
    let after = fly(&flight, 2, 130.0).snapshot();
    assert_eq!(after.waiting_for, "");
    assert!(after.motion.position_sigma_m.iter().all(|s| *s < 10.0), "{:?}", after.motion);
    assert!(after.gnss.used > 400, "{:?}", after.gnss);
}

#[test]
fn the_same_samples_give_the_same_snapshots_to_the_last_bit() {
    let run = || {
        let mut engine = Engine::new(Model::standard(), EngineOptions::default());
        let mut lines = Vec::new();
        for (k, (sample, _)) in named("fixed_wing").flight(5).take(8000).enumerate() {
            engine.feed(&sample);
            if k % 400 == 0 {
                lines.push(serde_json::to_string(&engine.snapshot()).unwrap());
            }
        }
        lines.push(serde_json::to_string(&engine.summary()).unwrap());
        lines
    };
    assert_eq!(run(), run());
}

#[test]
fn asking_for_snapshots_changes_nothing() {
    let flight = named("fixed_wing");
    let mut asked = Engine::new(Model::standard(), EngineOptions::default());
    for (sample, _) in flight.flight(4).take_while(|(_, t)| t.t_s <= 40.0) {
        asked.feed(&sample);
        if matches!(sample, Sample::Fix(_)) {
            asked.snapshot();
        }
    }
    assert_eq!(asked.snapshot(), fly(&flight, 4, 40.0).snapshot());
}

#[test]
fn a_reboot_keeps_what_was_learned_of_the_vehicle() {
    let flight = named("fixed_wing");
    let mut engine = fly(&flight, 1, 150.0);
    let learned = engine.snapshot();
    engine.feed(&Sample::Restart(RestartReason::Reboot));
    let waiting = engine.snapshot();
    let (kept, known) =
        (waiting.estimate.g_sensitivity_deg_per_h_per_g, learned.estimate.g_sensitivity_deg_per_h_per_g);
    assert_eq!(kept.value, known.value);
    // What is kept is of the last fix, what was shown of a fraction of a second later: constants walk a little.
    for (kept, known) in kept.sigma.as_flattened().iter().zip(known.sigma.as_flattened()) {
        assert!((kept / known - 1.0).abs() < 1e-6, "{kept} {known}");
    }
    for (sample, _) in flight.flight(1).take_while(|(_, t)| t.t_s <= 10.0) {
        engine.feed(&sample);
    }
    let again = engine.snapshot();
    assert!((again.elapsed_s - 160.0).abs() < 0.1, "{}", again.elapsed_s);
    assert_eq!(again.phase, Phase::Running);
    for (old, new) in learned.observability.states.iter().zip(&again.observability.states) {
        if is_g(old) {
            assert!(new.sigma <= old.sigma * 1.01, "{old:?} {new:?}");
        }
    }
}

/// PX4's log of a whole flight ended half a second after a gap: all that it had shown was gone, though "biases and G are kept".
#[test]
fn what_was_learned_is_shown_also_where_a_log_ends_just_after_a_gap() {
    let flight = named("fixed_wing");
    let learned = fly(&flight, 1, 150.0).snapshot().estimate;
    let mut engine = Engine::new(Model::standard(), EngineOptions::default());
    for (sample, truth) in flight.flight(1).take_while(|(_, t)| t.t_s <= 153.5) {
        if !(150.0..153.0).contains(&truth.t_s) {
            engine.feed(&sample);
        }
    }
    let now = engine.snapshot();
    assert_eq!(now.phase, Phase::Aligning);
    let [kept, known] = [now.estimate, learned].map(|e| e.g_sensitivity_deg_per_h_per_g);
    for (kept, known) in kept.sigma.as_flattened().iter().zip(known.sigma.as_flattened()) {
        assert!((kept / known - 1.0).abs() < 1e-3, "{kept} {known}");
    }
    assert_eq!(engine.summary().estimate.g_sensitivity_deg_per_h_per_g, kept);
}

/// A range that ends below the load of a turn is noticed after a while: what the samples at its end have taught by then goes.
#[test]
fn what_a_faulty_sensor_taught_before_it_was_found_is_dropped() {
    let flight = named("fixed_wing");
    let (from_s, found_s) = (124.5, 126.5);
    let before = fly(&flight, 1, from_s - 2.0);
    let learned = before.snapshot().estimate;
    let off = |engine: &Engine| {
        let now = engine.snapshot().estimate;
        let axis = |new: f64, old: f64, sigma: f64| (new - old).abs() / sigma;
        let (bias, old) = (now.accel_bias_mg, learned.accel_bias_mg);
        let biases = (0..3).map(|k| axis(bias.value[k], old.value[k], old.sigma[k]));
        let effects = now.effects.iter().zip(&learned.effects).map(|(n, o)| axis(n.value, o.value, o.sigma));
        biases.chain(effects).fold(0.0, f64::max)
    };
    let mut taught = 0.0_f64;
    for limit in [-16.5, -16.0, -15.0, -14.0, -12.75] {
        let mut engine = before.clone();
        for (mut sample, t) in flight.flight(1).skip_while(|(_, t)| t.t_s <= from_s - 2.0) {
            match &mut sample {
                _ if t.t_s > found_s => break,
                Sample::Imu(imu) if imu.t_s > from_s => imu.accel.z = imu.accel.z.max(limit),
                _ => {}
            }
            engine.feed(&sample);
        }
        taught = taught.max(off(&engine));
        engine.feed(&Sample::Restart(RestartReason::SensorFault));
        assert!(off(&engine) < 1.5, "{limit}: {}", off(&engine));
    }
    assert!(taught > 2.0, "nothing was learned from the fault: {taught}");
}

#[test]
fn impossible_values_are_rejected_counted_and_reported() {
    let mut engine = fly(&named("bench"), 1, 5.0);
    let before = engine.snapshot();
    let t_s = before.t_s + 0.005;
    let [x, y] = [f64::NAN, 1e300];
    for gyro in [[x, 0.0, 0.0], [0.0, y, 0.0]] {
        engine.feed(&Sample::Imu(ImuSample {
            t_s,
            gyro: gyro.into(),
            accel: [0.0, 0.0, -9.8].into(),
            temperature_degc: None,
        }));
    }
    let after = engine.snapshot();
    assert_eq!(after.imu.dropped, before.imu.dropped + 2);
    assert_eq!(after.estimate, before.estimate);
    assert_eq!(after.warnings.len(), 1);
}

/// Feeds the flight from 60 to 62 s with every fix a second time, so much after the first.
fn repeated(delay_s: f64) -> (Snapshot, Snapshot) {
    let flight = named("fixed_wing");
    let mut engine = fly(&flight, 3, 60.0);
    let before = engine.snapshot();
    let mut again = std::collections::VecDeque::new();
    for (sample, truth) in
        flight.flight(3).skip_while(|(_, t)| t.t_s <= 60.0).take_while(|(_, t)| t.t_s <= 64.0)
    {
        engine.feed(&sample);
        if matches!(sample, Sample::Fix(_)) {
            again.push_back((truth.t_s + delay_s, sample));
        }
        while let Some((_, late)) = again.pop_front_if(|(due, _)| *due <= truth.t_s) {
            engine.feed(&late);
        }
    }
    (before, engine.snapshot())
}

#[test]
fn only_a_fix_that_really_is_late_is_called_late() {
    for (delay_s, warned) in [(0.5, false), (1.9, true)] {
        let (before, after) = repeated(delay_s);
        let late = after.warnings.iter().any(|w| w.contains("1.5 s after their time"));
        assert_eq!(late, warned, "{delay_s}: {:?}", after.warnings);
        let (fixes, passed) =
            (after.gnss.fixes - before.gnss.fixes, after.gnss.rejected - before.gnss.rejected);
        assert!(fixes > 20 && 2 * passed > fixes - 10, "every one is counted: {:?}", after.gnss);
    }
}

#[test]
fn an_estimate_that_the_model_cannot_explain_is_reported_and_a_large_one_that_it_expects_is_not() {
    let flight = named("fixed_wing");
    let truth = flight.model.get("gyro_g_sensitivity").unwrap();
    // deg/h/g in rad/s per m/s².
    let unit = truth.effect.groups()[0].unit.si;
    for (off, reported) in [(2000.0, true), (0.0, false)] {
        // With tolerances other states leave their priors as well, and g33 does not.
        let mut model = Model::calibrated();
        let mut expected = truth.clone();
        expected.values.iter_mut().for_each(|v| *v += off * unit);
        expected.sigmas.fill(50.0 * unit);
        model.set(expected);
        let mut engine = Engine::new(model, EngineOptions::default());
        flight.flight(4).for_each(|(sample, _)| engine.feed(&sample));
        let summary = engine.summary();
        // Scale factors and misalignments may take their share: which elements are named depends on the flight.
        let of_g = summary.implausible.iter().find(|name| name.starts_with('g'));
        assert_eq!(of_g.is_some(), reported, "{:?}", summary.implausible);
        let warned = of_g.is_some_and(|name| summary.warnings.iter().any(|w| w.contains(name.as_str())));
        assert_eq!(warned, reported, "{:?}", summary.warnings);
    }
}

#[test]
fn the_search_for_the_heading_shows_its_own_sigma() {
    let mut bench = named("bench");
    bench.sensors.attitude_rate_hz = 0.0;
    let now = fly(&bench, 1, 20.0).snapshot();
    assert_eq!(now.phase, Phase::SearchingHeading);
    // The members themselves are 15° wide.
    assert!(now.estimate.attitude_deg.sigma[2] > 30.0, "{:?}", now.estimate.attitude_deg);
}

#[test]
fn the_bench_meets_no_condition_and_says_what_is_missing() {
    let now = fly(&named("bench_vibration"), 2, 60.0).snapshot().observability;
    for condition in [&now.conditions.a, &now.conditions.b, &now.conditions.c] {
        assert!(!condition.met && condition.progress == 0.0 && !condition.missing.is_empty());
    }
    let texts: Vec<_> = now.unobservable_directions.iter().map(|d| d.text.as_str()).collect();
    assert!(texts.iter().any(|t| t.starts_with("column y of G: ")), "{texts:?}");
    assert!(texts.iter().any(|t| t.starts_with("column x of G: ")), "{texts:?}");
    let tied = now.unobservable_directions.iter().find(|d| d.states.contains_key("g23")).unwrap();
    assert!(tied.states.contains_key("bg_y") && tied.text.contains("only as a sum"), "{tied:?}");
}

#[test]
fn coordinated_flight_leaves_column_y_unobservable_and_sideslip_does_not() {
    let column_y = |name: &str| {
        // With tolerances five minutes of sideslips are not enough: this is about the maneuver.
        let now = fly_with(Model::calibrated(), &named(name), 1, 300.0).snapshot().observability;
        let unobservable = now.unobservable_directions.iter().any(|d| d.states.contains_key("g22"));
        let asks =
            now.unobservable_directions.iter().any(|d| d.text.contains("accelerate along the sideways axis"));
        let best = now.states.iter().find(|s| s.name == "g22").map(|s| s.sigma_ratio);
        (unobservable, asks, best)
    };
    let (unobservable, asks, ratio) = column_y("fixed_wing_coordinated");
    assert!(unobservable && asks && ratio > Some(0.5), "{ratio:?}");
    let (unobservable, asks, ratio) = column_y("fixed_wing");
    assert!(!unobservable && !asks && ratio < Some(0.5), "{ratio:?}");
}

/// An engine for the small fixed wing, with everything it is asked to fly and how each ended.
fn guided(name: &str, manual: bool, until_s: f64) -> (Engine, Vec<String>, Vec<String>) {
    let airframe = Airframe::example("small_fixed_wing").unwrap();
    let mut engine = Engine::new(Model::standard(), EngineOptions::for_airframe(airframe, manual));
    let (mut asked, mut results) = (Vec::new(), Vec::new());
    for (sample, _) in named(name).flight(1).take_while(|(_, t)| t.t_s <= until_s) {
        engine.feed(&sample);
        if matches!(sample, Sample::Fix(_)) {
            let now = engine.snapshot().guidance;
            assert!((0.0..=1.0).contains(&now.progress));
            assert!(now.instruction.is_empty() || now.reason.len() > 10, "{now:?}");
            for (list, text) in [(&mut asked, now.instruction), (&mut results, now.last_result)] {
                if !text.is_empty() && list.last() != Some(&text) {
                    list.push(text);
                }
            }
        }
    }
    (engine, asked, results)
}

#[test]
fn a_stationary_aircraft_is_asked_for_nothing() {
    let (engine, asked, results) = guided("bench", true, 30.0);
    let now = engine.snapshot();
    assert_eq!(now.situation.kind, SituationKind::Ground);
    assert!(asked.is_empty() && results.is_empty() && engine.proposed().is_empty(), "{asked:?} {results:?}");
}

/// The autopilot of a log flew its mission: what the filter learns meanwhile is no maneuver's merit, and no order contradicts the mission.
#[test]
fn while_the_autopilot_flies_nothing_is_asked_for_and_nothing_is_claimed() {
    use super::situation::{FlightMode, FlightReport};
    let airframe = Airframe::example("small_fixed_wing").unwrap();
    let report = |mode| FlightReport { has_heartbeat: true, armed: true, mode, ..FlightReport::default() };
    let mut engine = Engine::new(Model::standard(), EngineOptions::for_airframe(airframe, true));
    let mut asked = [0, 0];
    for (sample, t) in named("fixed_wing").flight(1).take_while(|(_, t)| t.t_s <= 240.0) {
        let pilot = t.t_s > 200.0;
        engine.set_flight(&report(if pilot { FlightMode::Pilot } else { FlightMode::Return }));
        engine.feed(&sample);
        if matches!(sample, Sample::Fix(_)) {
            let now = engine.snapshot();
            asked[usize::from(pilot)] += u32::from(!now.guidance.instruction.is_empty());
            assert!(pilot || now.guidance.last_result.is_empty(), "{:?}", now.guidance);
        }
    }
    assert!(asked[0] == 0 && asked[1] > 20, "{asked:?}");
}

/// Fixes stop in mid-maneuver: the order goes, the outage comes first, and with the fixes the orders come back.
#[test]
fn without_fixes_nothing_is_asked_for_and_that_comes_first() {
    let airframe = Airframe::example("small_fixed_wing").unwrap();
    let mut engine = Engine::new(Model::standard(), EngineOptions::for_airframe(airframe, true));
    let mut flight = named("fixed_wing");
    flight.sensors.outages = vec![(100.0, 130.0)];
    let mut last = std::collections::BTreeMap::new();
    for (sample, t) in flight.flight(1).take_while(|(_, t)| t.t_s <= 170.0) {
        engine.feed(&sample);
        if matches!(sample, Sample::Imu(_)) && ((t.t_s * 200.0) as u64).is_multiple_of(200) {
            last.insert(t.t_s as u64, engine.snapshot());
        }
    }
    for (t_s, now) in last.range(105..130) {
        let said = &now.situation;
        assert_eq!((said.kind, said.headline.as_str()), (SituationKind::NoGnss, "No GNSS"), "{t_s}");
        assert!(now.guidance.instruction.is_empty() && said.text.starts_with("No GNSS fix for"), "{said:?}");
    }
    let orders =
        |from, to| last.range(from..to).filter(|(_, s)| s.situation.kind == SituationKind::Maneuver).count();
    assert!(orders(60, 100) > 10 && orders(140, 170) > 10, "{} {}", orders(60, 100), orders(140, 170));
}

#[test]
fn what_was_flown_is_noticed_and_its_gain_is_reported() {
    let (_, asked, results) = guided("fixed_wing", true, 300.0);
    assert!(results.iter().any(|r| r.contains(" from ") && r.contains("deg/h")), "{asked:?} {results:?}");
    assert!(asked.len() >= 2, "{asked:?}");
}

#[test]
fn sideslip_is_asked_for_only_where_a_pilot_flies() {
    let (_, asked, _) = guided("fixed_wing_coordinated", true, 300.0);
    assert!(asked.iter().any(|a| a.contains("rudder")), "{asked:?}");
    let (_, asked, _) = guided("fixed_wing_coordinated", false, 300.0);
    assert!(!asked.is_empty() && asked.iter().all(|a| !a.contains("rudder")), "{asked:?}");
}
