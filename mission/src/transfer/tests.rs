//! The verified upload over a bad link to small reference vehicles that behave as the two autopilots do.

mod link;
mod others;
mod single;
mod vehicle;

use super::verified::{Goal, Options, Outcome, VehicleState, VerifiedUpload};
use super::*;
use crate::change::{Exchange, Phase, VerifiedChange};
use crate::compare::differences;
use crate::item::{Autopilot, LatLon, Mission, MissionItem, command};
use link::{Faults, Random, Run};
use vehicle::Vehicle;

const ME: Address = Address { system: 1, component: 191 };
const VEHICLE: Address = Address { system: 1, component: 1 };
const ON_THE_GROUND: VehicleState =
    VehicleState { armed: false, mission_mode: false, flying_mission: false, in_flight: false };

/// A mission of a given length that differs in every item from those of other seeds.
fn mission(seed: u64, items: usize) -> Mission {
    let mut random = Random(seed ^ 0x5eed);
    let items = (0..items)
        .map(|k| {
            let place = LatLon { lat_deg: 47.3 + random.unit() * 0.1, lon_deg: 8.5 + random.unit() * 0.1 };
            match k % 4 {
                1 => MissionItem::action(
                    command::DO_CHANGE_SPEED,
                    [0.0, (14.0 + random.unit() * 8.0) as f32, -1.0, 0.0],
                ),
                2 => MissionItem::at(
                    command::NAV_LOITER_TURNS,
                    [2.0, 0.0, (random.unit() * 400.0 + 60.0) as f32, 0.0],
                    place,
                    80.0,
                ),
                _ => MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place, 100.0 + k as f32),
            }
        })
        .collect();
    Mission { home: None, items }
}

fn holds(autopilot: Autopilot, vehicle: &Vehicle, mission: &Mission) -> bool {
    let on_board = Mission::from_wire_items(autopilot, vehicle.stored());
    differences(autopilot, mission, &on_board).is_empty()
}

/// Whether what the outcome claims is what is on the vehicle, long after the last late duplicate.
fn check(autopilot: Autopilot, run: &Run, new: &Mission, old: &Mission, context: &str) {
    match run.upload.outcome() {
        Some(Outcome::Verified { .. }) => {
            assert!(holds(autopilot, &run.vehicle, new), "{context}: said verified");
            assert_eq!(run.vehicle.current, 0, "{context}: said verified");
        }
        Some(Outcome::RestoredPrevious { why }) => {
            assert!(holds(autopilot, &run.vehicle, old), "{context}: said restored, {why}");
        }
        Some(Outcome::Unknown { on_vehicle, .. }) => assert!(on_vehicle.contains("UNKNOWN"), "{context}"),
        Some(other) => panic!("{context}: {other}"),
        None => panic!("{context}: no outcome, {:?}", run.upload.phase()),
    }
}

fn two_hundred(autopilot: Autopilot, faults: Faults) -> (u32, u32, u32) {
    let (mut verified, mut restored, mut unknown) = (0, 0, 0);
    for seed in 0..200 {
        let (new, old) = (mission(seed, 3 + (seed % 14) as usize), mission(seed + 1000, (seed % 9) as usize));
        let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
        let mut run = Run::start(seed, faults, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
        run.until_outcome(600.0);
        run.settle();
        check(autopilot, &run, &new, &old, &format!("{autopilot:?}, seed {seed}"));
        match run.upload.outcome() {
            Some(Outcome::Verified { .. }) => verified += 1,
            Some(Outcome::RestoredPrevious { .. }) => restored += 1,
            _ => unknown += 1,
        }
    }
    (verified, restored, unknown)
}

#[test]
fn two_hundred_uploads_to_ardupilot_never_leave_a_mixed_mission() {
    let (verified, restored, unknown) = two_hundred(Autopilot::ArduPilot, Faults::BAD);
    println!("ArduPilot: {verified} verified, {restored} restored, {unknown} unknown");
    assert!(verified >= 180 && unknown <= 2, "{verified} verified, {restored} restored, {unknown} unknown");
}

#[test]
fn two_hundred_uploads_to_px4_never_leave_a_mixed_mission() {
    let (verified, restored, unknown) = two_hundred(Autopilot::Px4, Faults::BAD);
    println!("PX4: {verified} verified, {restored} restored, {unknown} unknown");
    assert!(verified >= 180 && unknown <= 2, "{verified} verified, {restored} restored, {unknown} unknown");
}

#[test]
fn on_a_link_that_hardly_works_every_ending_is_honest() {
    let hardly = Faults { loss: 0.55, duplication: 0.2, reordering: 0.4, delay_s: 0.3 };
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (verified, restored, unknown) = two_hundred(autopilot, hardly);
        println!("{autopilot:?}, bad link: {verified} verified, {restored} restored, {unknown} unknown");
        assert!(verified > 0 && restored > 0 && unknown > 0, "the link must show every ending");
    }
}

#[test]
fn a_link_cut_ends_loudly_and_is_settled_after_it() {
    let mut loud = 0;
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        for seed in 0..60 {
            let (new, old) = (mission(seed, 12), mission(seed + 1000, 7));
            let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
            let mut run = Run::start(seed, Faults::BAD, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
            let cut = Random(seed + 77).unit() * 25.0;
            run.until(cut);
            run.cut = true;
            run.until_outcome(900.0);
            let context = format!("{autopilot:?}, seed {seed}, cut at {cut}");
            check(autopilot, &run, &new, &old, &context);
            loud += u32::from(matches!(run.upload.outcome(), Some(Outcome::Unknown { .. })));
            run.cut = false;
            run.link_restored();
            run.until_outcome(900.0);
            run.settle();
            check(autopilot, &run, &new, &old, &context);
            assert!(!matches!(run.upload.outcome(), Some(Outcome::Unknown { .. })), "{context}: not settled");
        }
    }
    assert!(loud > 20, "{loud} cuts hit an upload");
}

#[test]
fn an_interrupted_program_takes_up_its_upload() {
    let (new, old) = (mission(5, 10), mission(6, 6));
    // The program died in the middle: half of the new mission stands over the old one; or at the end, all of it does.
    let mut mixed = old.wire_items(Autopilot::ArduPilot);
    mixed[..4].copy_from_slice(&new.wire_items(Autopilot::ArduPilot)[..4]);
    let whole = new.wire_items(Autopilot::ArduPilot);
    for (on_board, goal, ends_new) in [
        (&mixed, Goal::Previous, false),
        (&mixed, Goal::Whole, false),
        (&mixed, Goal::New, true),
        (&whole, Goal::Previous, false),
        (&whole, Goal::Whole, true),
        (&whole, Goal::New, true),
    ] {
        let vehicle = Vehicle::new(Autopilot::ArduPilot, on_board.clone());
        let (upload, actions) = VerifiedUpload::resume(
            Peers::new(ME, VEHICLE),
            Autopilot::ArduPilot,
            Options::default(),
            (new.clone(), old.clone()),
            goal,
            Some(ON_THE_GROUND),
            0.0,
        );
        let mut run = Run::with(1, Faults::BAD, vehicle, upload, actions);
        run.until_outcome(300.0);
        let restored = matches!(run.upload.outcome(), Some(Outcome::RestoredPrevious { .. }));
        assert_eq!(restored, !ends_new, "{goal:?} {:?}", run.upload.outcome());
        assert!(holds(Autopilot::ArduPilot, &run.vehicle, if ends_new { &new } else { &old }), "{goal:?}");
    }
}

/// Item 11 stays the current one: armed, the vehicle would skip its take-off.
#[test]
fn a_vehicle_that_keeps_its_old_current_item_is_not_ready() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let mut vehicle = Vehicle::new(autopilot, mission(6, 14).wire_items(autopilot));
        vehicle.stubborn = true;
        let new = mission(5, 14);
        let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
        run.until_outcome(300.0);
        let said = run.upload.outcome().map(ToString::to_string).unwrap_or_default();
        assert!(said.contains("its current item stays 11"), "{autopilot:?}: {said}");
        assert!(holds(autopilot, &run.vehicle, &new));
        // It takes the wish later, after a restart for instance.
        run.vehicle.stubborn = false;
        run.link_restored();
        run.until_outcome(300.0);
        check(autopilot, &run, &new, &new, "taken at last");
        assert!(matches!(run.upload.outcome(), Some(Outcome::Verified { .. })), "{:?}", run.upload.outcome());
    }
}

#[test]
fn a_mission_the_vehicle_refuses_is_undone() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (mut new, old) = (mission(5, 10), mission(6, 12));
        new.items[6].command = vehicle::UNKNOWN_COMMAND;
        let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
        let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
        run.until_outcome(300.0);
        run.settle();
        check(autopilot, &run, &new, &old, "refused");
        let said = run.upload.outcome().map(ToString::to_string).unwrap_or_default();
        assert!(
            said.contains("refused item 7 (command 31999, command 31999): it does not support this command"),
            "{said}"
        );
    }
}

#[test]
fn a_refusal_names_item_command_parameter_value_and_whom_the_plan_was_made_for() {
    let (mut new, old) = (mission(5, 10), mission(6, 12));
    new.items[2].params[3] = f32::NAN;
    let vehicle = Vehicle::new(Autopilot::ArduPilot, old.wire_items(Autopilot::ArduPilot));
    let options = Options { planned_for: Some(Autopilot::Px4), ..Options::default() };
    let peers = Peers::new(ME, VEHICLE);
    let (upload, actions) =
        VerifiedUpload::start(peers, Autopilot::ArduPilot, options, new.clone(), Some(ON_THE_GROUND), 0.0);
    let mut run = Run::with(3, Faults::NONE, vehicle, upload, actions);
    run.until_outcome(300.0);
    check(Autopilot::ArduPilot, &run, &new, &old, "refused");
    let said = run.upload.outcome().map(ToString::to_string).unwrap_or_default();
    assert_eq!(
        said,
        "the previous mission is on the vehicle; the new one is not, because the vehicle refused item 3 (loiter turns, command 18): \
         parameter 4 is invalid, its value is not a number (NaN); the plan was made for PX4, this vehicle runs ArduPilot"
    );
}

/// What PX4's navigator says of a mission without a landing, with its component's byte before the id.
fn landing_missing() -> MissionMessage {
    MissionMessage::Event { id: 0x0181_1691, arguments: [0; events::ARGUMENTS] }
}

#[test]
fn a_mission_that_px4_rejects_after_accepting_it_is_undone() {
    // While it is read back, and after that.
    for after_s in [0.01, 2.5] {
        let (new, old) = (mission(5, 10), mission(6, 12));
        let mut vehicle = Vehicle::new(Autopilot::Px4, old.wire_items(Autopilot::Px4));
        vehicle.verdict = Some((after_s, landing_missing()));
        let mut run = Run::start(3, Faults::NONE, Autopilot::Px4, vehicle, new.clone(), Some(ON_THE_GROUND));
        run.until_outcome(300.0);
        run.settle();
        let said = run.upload.outcome().map(ToString::to_string).unwrap_or_default();
        assert!(
            said.contains("accepted it and then rejected it: a landing is required (MIS_TKO_LAND_REQ)"),
            "{said}"
        );
        check(Autopilot::Px4, &run, &new, &old, "rejected");
        assert!(!holds(Autopilot::Px4, &run.vehicle, &new));
    }
}

#[test]
fn an_event_from_before_the_upload_is_not_its_result() {
    let (new, old) = (mission(5, 10), mission(6, 12));
    let vehicle = Vehicle::new(Autopilot::Px4, old.wire_items(Autopilot::Px4));
    let mut run = Run::start(3, Faults::NONE, Autopilot::Px4, vehicle, new, Some(ON_THE_GROUND));
    run.until(0.2);
    assert_eq!(run.upload.phase(), Phase::BackingUp);
    let to = Address { system: 0, component: 0 };
    run.upload.receive(0.2, &Envelope { from: VEHICLE, to, message: landing_missing() });
    run.until_outcome(300.0);
    assert_eq!(run.upload.outcome(), Some(&Outcome::Verified { items: 10 }));
}

#[test]
fn a_vehicle_that_asks_for_item_0_for_ever_is_given_up() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (new, old) = (mission(5, 10), mission(6, 12));
        let mut vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
        vehicle.stuck = true;
        let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new, Some(ON_THE_GROUND));
        run.until_outcome(900.0);
        // ArduPilot has cut its mission to the announced length and takes no other either; PX4 still has its own.
        match run.upload.outcome() {
            Some(Outcome::Unknown { .. }) => assert_eq!(autopilot, Autopilot::ArduPilot),
            Some(Outcome::RestoredPrevious { why }) => {
                assert_eq!(autopilot, Autopilot::Px4);
                assert!(why.contains("asked for the same items again and again"), "{why}");
            }
            other => panic!("{autopilot:?}: {other:?}"),
        }
    }
}

#[test]
fn a_fence_goes_and_comes_back_as_a_mission_does() {
    let fence = |radius_m: f32| {
        let place = LatLon { lat_deg: 47.4, lon_deg: 8.5 };
        let circle =
            MissionItem::at(command::NAV_FENCE_CIRCLE_INCLUSION, [radius_m, 0.0, 0.0, 0.0], place, 0.0);
        Mission { home: None, items: vec![MissionItem { frame: crate::item::Frame::GLOBAL, ..circle }] }
    };
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let vehicle = Vehicle::with_fence(autopilot, fence(500.0).items);
        let peers = Peers::new(ME, VEHICLE).about(crate::item::MissionKind::Fence);
        let (upload, actions) = VerifiedUpload::start(
            peers,
            autopilot,
            Options::default(),
            fence(800.0),
            Some(ON_THE_GROUND),
            0.0,
        );
        let mut run = Run::with(7, Faults::BAD, vehicle, upload, actions);
        run.until_outcome(300.0);
        let said = run.upload.outcome().map(|o| o.about(crate::item::MissionKind::Fence)).unwrap_or_default();
        assert_eq!(said, "the new geofence of 1 items is on the vehicle, read back and compared");
        assert_eq!(run.vehicle.stored()[0].params[0], 800.0);
        assert_eq!(run.upload.backup(), Some(&fence(500.0)));
    }
}

#[test]
fn a_vehicle_without_a_fence_says_so_at_once() {
    let peers = Peers::new(ME, VEHICLE).about(crate::item::MissionKind::Fence);
    let (mut download, _) = Download::start(peers, 0.0);
    let ack = MissionMessage::Ack { result: MissionResult::UNSUPPORTED, mission_type: 1, opaque_id: 0 };
    download.receive(0.1, &Envelope { from: VEHICLE, to: ME, message: ack });
    let refused = TransferError::Refused { result: MissionResult::UNSUPPORTED, seq: None };
    assert_eq!(download.result(), Some(Err(&refused)));
}

#[test]
fn nothing_is_sent_to_a_vehicle_that_flies_a_mission() {
    let armed = VehicleState { armed: true, ..ON_THE_GROUND };
    let flying = VehicleState { mission_mode: true, flying_mission: true, ..armed };
    let waiting = VehicleState { mission_mode: true, ..armed };
    let loitering = VehicleState { in_flight: true, ..armed };
    for (state, word) in [
        (Some(flying), "flying a mission"),
        (Some(waiting), "armed"),
        (Some(loitering), "in the air"),
        (None, "heartbeat"),
    ] {
        let (upload, actions) = VerifiedUpload::start(
            Peers::new(ME, VEHICLE),
            Autopilot::ArduPilot,
            Options::default(),
            mission(1, 4),
            state,
            0.0,
        );
        assert!(actions.is_empty());
        let said = upload.outcome().map(ToString::to_string).unwrap_or_default();
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn a_vehicle_that_takes_off_during_the_backup_keeps_its_mission() {
    let (new, old) = (mission(5, 10), mission(6, 12));
    let vehicle = Vehicle::new(Autopilot::ArduPilot, old.wire_items(Autopilot::ArduPilot));
    let mut run = Run::start(3, Faults::NONE, Autopilot::ArduPilot, vehicle, new, Some(ON_THE_GROUND));
    run.until(1.0);
    assert_eq!(run.upload.phase(), Phase::BackingUp);
    run.vehicle_state(VehicleState {
        armed: true,
        mission_mode: true,
        flying_mission: true,
        ..ON_THE_GROUND
    });
    run.until_outcome(60.0);
    assert!(matches!(run.upload.outcome(), Some(Outcome::RestoredPrevious { .. })));
    assert_eq!(run.vehicle.counts_received, 0);
}

#[test]
fn a_mission_that_becomes_active_during_the_backup_is_left_alone() {
    let armed = VehicleState { armed: true, ..ON_THE_GROUND };
    let (new, old) = (mission(5, 10), mission(6, 12));
    let vehicle = Vehicle::new(Autopilot::Px4, old.wire_items(Autopilot::Px4));
    let mut run = Run::start(3, Faults::NONE, Autopilot::Px4, vehicle, new, Some(armed));
    run.until(0.5);
    let active = MissionMessage::Current { seq: 1, total: 12, state: 3, mission_id: 7 };
    run.upload
        .receive(0.5, &Envelope { from: VEHICLE, to: Address { system: 0, component: 0 }, message: active });
    run.until_outcome(60.0);
    let said = run.upload.outcome().map(ToString::to_string).unwrap_or_default();
    assert!(said.contains("flying a mission"), "{said}");
    assert_eq!(run.vehicle.counts_received, 0);
}

#[test]
fn cancelling_puts_the_previous_mission_back() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (new, old) = (mission(5, 10), mission(6, 12));
        let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
        let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new, Some(ON_THE_GROUND));
        while run.upload.phase() != Phase::Sending || run.progress < 4 {
            run.step();
        }
        run.cancel();
        run.until_outcome(300.0);
        run.settle();
        assert!(matches!(run.upload.outcome(), Some(Outcome::RestoredPrevious { .. })));
        assert!(holds(autopilot, &run.vehicle, &old));
    }
}
