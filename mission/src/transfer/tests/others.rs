//! What comes between: a vehicle that is armed on the way, and another station.

use super::*;

const FLYING: VehicleState =
    VehicleState { armed: true, mission_mode: true, flying_mission: true, in_flight: false };
const ARMED: VehicleState = VehicleState { armed: true, ..ON_THE_GROUND };
/// Another station.
const STATION: Address = Address { system: 255, component: 190 };

/// An upload of which some items are on the vehicle.
fn half_way(autopilot: Autopilot, new: &Mission, old: &Mission) -> Run {
    let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
    let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
    while run.upload.phase() != Phase::Sending || run.progress < 4 {
        run.step();
    }
    run
}

fn said(run: &Run) -> String {
    run.upload.outcome().map(ToString::to_string).unwrap_or_default()
}

#[test]
fn a_vehicle_put_into_its_mission_during_the_upload_gets_no_further_item() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (new, old) = (mission(5, 10), mission(6, 12));
        let mut run = half_way(autopilot, &new, &old);
        run.vehicle_state(FLYING);
        let sent = run.items_sent;
        run.until_outcome(300.0);
        run.settle();
        assert_eq!(run.items_sent, sent, "{autopilot:?}: no item goes out any more");
        match run.upload.outcome() {
            // It changes over with the last item only.
            Some(Outcome::RestoredPrevious { why }) => {
                assert_eq!(autopilot, Autopilot::Px4);
                assert!(why.contains("began during the upload, which was stopped after"), "{why}");
                assert!(holds(autopilot, &run.vehicle, &old));
            }
            Some(Outcome::Unknown { on_vehicle, what_to_do }) => {
                assert_eq!(autopilot, Autopilot::ArduPilot);
                assert!(on_vehicle.contains("On board is now A MIXTURE: items 1 to"), "{on_vehicle}");
                assert!(what_to_do.contains("Leave the mission mode and disarm"), "{what_to_do}");
            }
            other => panic!("{autopilot:?}: {other:?}"),
        }
        // Its heartbeats bring nothing into it, until it is on the ground again.
        let before = run.vehicle.counts_received;
        run.link_restored();
        run.until(run.now + 30.0);
        assert_eq!(run.vehicle.counts_received, before, "{autopilot:?}");
        run.vehicle_state(ON_THE_GROUND);
        run.link_restored();
        run.until_outcome(300.0);
        run.settle();
        assert!(matches!(run.upload.outcome(), Some(Outcome::RestoredPrevious { .. })), "{}", said(&run));
        assert!(holds(autopilot, &run.vehicle, &old));
    }
}

#[test]
fn arming_during_the_upload_brings_the_previous_mission_back() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let (new, old) = (mission(5, 10), mission(6, 12));
        let mut run = half_way(autopilot, &new, &old);
        run.vehicle_state(ARMED);
        run.until_outcome(300.0);
        run.settle();
        assert!(said(&run).contains("the vehicle is armed: that began during the upload"), "{}", said(&run));
        check(autopilot, &run, &new, &old, "armed");
        assert!(holds(autopilot, &run.vehicle, &old));
    }
}

#[test]
fn a_vehicle_that_flies_its_mission_after_a_link_loss_is_left_alone() {
    let (new, old) = (mission(5, 10), mission(6, 12));
    let mut run = half_way(Autopilot::ArduPilot, &new, &old);
    run.cut = true;
    run.until_outcome(900.0);
    assert!(matches!(run.upload.outcome(), Some(Outcome::Unknown { .. })));
    run.cut = false;
    let before = run.vehicle.counts_received;
    run.vehicle_state(FLYING);
    run.link_restored();
    run.until(run.now + 60.0);
    assert_eq!(run.vehicle.counts_received, before);
    assert!(matches!(run.upload.outcome(), Some(Outcome::Unknown { .. })));
}

#[test]
fn a_mission_that_another_station_sent_meanwhile_is_not_called_ours_and_is_left_alone() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        for named in [true, false] {
            let (new, old, theirs) = (mission(5, 10), mission(6, 12), mission(9, 7));
            let vehicle = Vehicle::new(autopilot, old.wire_items(autopilot));
            let mut run = Run::start(3, Faults::NONE, autopilot, vehicle, new.clone(), Some(ON_THE_GROUND));
            while !holds(autopilot, &run.vehicle, &new) {
                run.step();
            }
            // All of it has been read back when the other one comes.
            run.until(run.now + 2.5);
            assert_eq!(run.upload.outcome(), None, "a quiet follows");
            run.vehicle.replace_stored(theirs.wire_items(autopilot));
            if named {
                let message = MissionMessage::RequestInt { seq: 6, mission_type: 0 };
                run.upload.receive(run.now, &Envelope { from: VEHICLE, to: STATION, message });
            }
            run.until_outcome(300.0);
            run.settle();
            let Some(Outcome::Foreign { on_vehicle, .. }) = run.upload.outcome() else {
                panic!("{autopilot:?}: {:?}", run.upload.outcome())
            };
            assert!(on_vehicle.contains("7 items were read back"), "{on_vehicle}");
            let station = "station 255 (component 190) has sent a mission meanwhile";
            assert_eq!(on_vehicle.contains(station), named, "{on_vehicle}");
            assert!(holds(autopilot, &run.vehicle, &theirs), "{autopilot:?}: nothing is put over it");
        }
    }
}

#[test]
fn nothing_is_sent_once_it_is_not_certain_who_answers() {
    let (new, old) = (mission(5, 10), mission(6, 12));
    let mut run = half_way(Autopilot::ArduPilot, &new, &old);
    run.upload.abandon("two vehicles answer as system 1");
    assert!(said(&run).contains("two vehicles answer as system 1"), "{}", said(&run));
    let sent = run.items_sent;
    run.link_restored();
    run.until(60.0);
    assert_eq!(run.items_sent, sent);
    assert!(matches!(run.upload.outcome(), Some(Outcome::Unknown { .. })));
}
