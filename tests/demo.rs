//! The closed loop, end to end: plan, verified upload, flight, estimates against the hidden truth.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use gaware::demo::flight::{Ending, Flight, Stage};
use gaware::demo::ground::GroundSession;
use gaware::demo::{Prepared, Settings, result};
use gaware::engine::snapshot::Status;
use gaware::sinks::status::{Control, StatusView, VehicleView};
use gaware::sinks::terminal::headless;
use gaware_mission::airframe::Airframe;
use serde_json::Value;
use std::sync::LazyLock;

fn prepared(airframe: &str) -> Prepared {
    let mut settings = Settings::new(Airframe::example(airframe).unwrap(), Some(150.0));
    settings.beam = 1;
    Prepared::new(settings).unwrap()
}

fn flown(prepared: &Prepared, seed: u64) -> result::DemoResult {
    let mut flight = Flight::new(prepared.clone(), seed);
    flight.run();
    result::of(&mut flight, seed)
}

/// Flown once for all tests that look at it.
static FLIGHT_4: LazyLock<result::DemoResult> = LazyLock::new(|| flown(&prepared("quadrotor"), 4));

#[test]
fn estimates_of_three_vehicles_of_each_kind_agree_with_their_drawn_truth() {
    let mut errors = Vec::new();
    for (airframe, ending) in [("small_fixed_wing", Ending::Landed), ("quadrotor", Ending::Landed)] {
        let prepared = prepared(airframe);
        for seed in 1..=3 {
            let result = flown(&prepared, seed);
            assert_eq!(result.ending, ending, "{airframe} {seed}");
            assert_eq!(result.document["mission"]["uploaded"], true);
            assert_eq!(result.document["mission"]["items"], prepared.plan.mission.items.len());
            let known: Vec<_> = result.states.iter().filter(|s| s.status == Status::Observable).collect();
            assert!(known.iter().any(|s| s.name == "ba_z"), "{airframe} {seed}: {known:?}");
            errors.extend(
                result.states.iter().map(|s| (s.normalised_error, format!("{airframe} {seed}: {s:?}"))),
            );
        }
    }
    let share =
        |within: f64| errors.iter().filter(|e| e.0.abs() <= within).count() as f64 / errors.len() as f64;
    let worst = errors.iter().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap();
    println!("{} states, {:.3} within 2 sigma, worst {}", errors.len(), share(2.0), worst.1);
    assert!(share(2.0) >= 0.9 && worst.0.abs() < 3.5, "{:.3} within 2 sigma; {}", share(2.0), worst.1);
}

#[test]
fn the_same_seed_gives_the_same_document_and_another_one_another() {
    let prepared = prepared("quadrotor");
    assert_eq!(FLIGHT_4.document, flown(&prepared, 4).document);
    // What is hidden is drawn before it flies.
    let other = result::of(&mut Flight::new(prepared, 8), 8);
    assert_ne!(FLIGHT_4.document["truth"], other.document["truth"]);
}

#[test]
fn who_ends_the_demonstration_is_told_so_and_screens_say_who_flies() {
    let mut flight = Flight::new(prepared("small_fixed_wing"), 1);
    let (mut views, mut told, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..300 {
        for _ in 0..10 {
            flight.turn();
        }
        flight.take_messages();
        let snapshot = flight.snapshot();
        views.push(flight.vehicle_view());
        told.extend(snapshot.news);
        warnings.extend(snapshot.warnings);
    }
    let starts = |t: &String| t.contains("arms and starts the mission");
    assert!(told.iter().any(starts) && !warnings.iter().any(starts), "{told:?} {warnings:?}");
    assert!(views.iter().any(|v| v.control == Control::Ground && v.next.contains("upload")), "{views:?}");
    let first = views.iter().find(|v| v.control == Control::Autopilot).unwrap();
    assert!(first.maneuver == 1 && first.maneuvers >= 1 && !first.now.is_empty(), "{first:?}");
    // First the way there is counted, then the maneuver by itself.
    assert!(first.left_s.is_none() && first.transit_left_s.is_some_and(|s| s > 0.0), "{first:?}");
    assert!(!first.next.is_empty());
    let result = result::of(&mut flight, 1);
    assert_eq!((&result.ending, &result.document["ending"]), (&Ending::Stopped, &"stopped".into()));
}

/// A maneuver whose last item is an action (full throttle ends by a change of speed) ends as all others do.
#[test]
fn every_maneuver_ends_and_the_landing_is_shown_as_such() {
    let prepared = prepared("small_fixed_wing");
    let mut flight = Flight::new(prepared.clone(), 1);
    let (mut views, mut standing) = (Vec::new(), 0);
    while !matches!(flight.stage(), Stage::Over(_)) {
        flight.turn();
        views.push(flight.vehicle_view());
        if views.len() % 100 == 0 {
            // The autopilot flies from take-off to landing: no order ever, and who flies is always said.
            let now = flight.snapshot();
            assert!(
                !now.situation.kind.allows_maneuver() && now.guidance.instruction.is_empty(),
                "{:?}",
                now.situation
            );
            let line = headless::line(&now, &StatusView::default());
            let flies = views.last().is_some_and(|v| v.control == Control::Autopilot);
            assert!(!flies || line.contains("(AUTO)"), "{line}");
            // As ArduPlane's own heartbeat has it, once a second: armed it does not fly before it moves, nor when it has landed.
            let stands = flies && line.contains("on the ground");
            standing += usize::from(stands);
            assert!(!flies || stands && standing <= 2 || line.contains("autopilot flies"), "{line}");
        }
    }
    // Two counts: never both, none longer than its own time, and none that stands still.
    let counted: Vec<_> = views.iter().filter_map(|v| v.left_s.map(|s| (v.maneuver, s, v))).collect();
    assert!(
        !counted.is_empty()
            && counted.iter().all(|(_, s, v)| *s <= v.duration_s && v.transit_left_s.is_none())
    );
    let falls = |pair: &[(u64, f64, &VehicleView)]| pair[0].0 != pair[1].0 || pair[1].1 < pair[0].1;
    assert!(counted.windows(2).all(falls));
    assert_eq!(flight.milestones().len(), prepared.plan.maneuvers.len(), "{:?}", prepared.plan.maneuvers);
    let in_the_air = views.iter().rfind(|v| v.control == Control::Autopilot).unwrap();
    assert_eq!(in_the_air.now, "approach and landing");
    assert_eq!(views.last().unwrap().control, Control::Ground);
}

#[test]
fn plan_and_proposals_keep_to_the_band_of_heights() {
    let mut settings = Settings::new(Airframe::example("small_fixed_wing").unwrap(), Some(120.0));
    (settings.beam, settings.band_m) = (1, [60.0, 110.0]);
    let plan = Prepared::new(settings).unwrap().plan;
    let maneuvers = plan.maneuvers.iter().flat_map(|m| m.items.clone());
    let heights: Vec<f32> =
        maneuvers.filter_map(|k| plan.mission.items.get(k)).filter_map(|i| i.place().map(|_| i.z)).collect();
    assert!(!heights.is_empty() && heights.iter().all(|h| (60.0..=110.0).contains(h)), "{heights:?}");
}

/// `truth` and `plan` have the shape of `estimate`.
#[test]
fn truth_and_plan_have_the_shape_of_the_estimate() {
    let document = &FLIGHT_4.document;
    let Value::Object(estimate) = &document["estimate"] else { panic!("no estimate") };
    for (group, fields) in estimate {
        for (part, field) in [("truth", "value"), ("plan", "sigma")] {
            let found = &document[part][group];
            match fields {
                Value::Array(list) => {
                    assert_eq!(found.as_array().unwrap().len(), list.len());
                    assert!(found[0][field].is_number());
                }
                _ => assert_eq!(
                    found[field].as_array().unwrap().len(),
                    fields[field].as_array().unwrap().len(),
                    "{part} {group}"
                ),
            }
        }
    }
}

/// All of G by hand, then a plan for what is left: latency and antenna. The flight begins with what the session found.
#[test]
fn a_session_by_hand_shows_all_of_g_and_the_flight_what_is_left() {
    let mut settings = Settings::new(Airframe::example("small_fixed_wing").unwrap(), Some(150.0));
    settings.beam = 1;
    let alone = Prepared::new(settings.clone()).unwrap();
    let mut session = GroundSession::new(&settings, 5);
    session.go_on(f64::INFINITY);
    assert!(session.is_over() && session.now_s() < 400.0);
    assert_eq!(
        (session.document()["observable"].as_u64(), session.document()["of"].as_u64()),
        (Some(9), Some(9))
    );
    let prepared = Prepared::new(settings.knowing(&session.unit().unwrap())).unwrap();
    let promised =
        |p: &Prepared| p.plan.promised().filter(|s| s.name.starts_with('g') && s.name.len() == 3).count();
    assert!(promised(&alone) < 9 && promised(&prepared) == 9, "{} {}", promised(&alone), promised(&prepared));
    let result = flown(&prepared, 5);
    for name in ["g11", "g22", "g33", "latency"] {
        let state = result.states.iter().find(|s| s.name == name).unwrap();
        assert!(state.status == Status::Observable && state.normalised_error.abs() < 4.0, "{state:?}");
    }
}
