use super::*;
use crate::link::frame::Sender;
use mavlink::dialects::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType,
};

const HERE: Origin = Origin { link: 0, peer: None };
const THERE: Origin = Origin { link: 1, peer: None };

fn framed(message: &MavMessage) -> Frame {
    Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, message)
}

fn heartbeat(mavtype: MavType) -> Frame {
    let autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
    framed(&MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype, autopilot, ..Default::default() }))
}

fn plane() -> Frame {
    heartbeat(MavType::MAV_TYPE_FIXED_WING)
}

fn version(uid: u64) -> Frame {
    framed(&MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA { uid, ..Default::default() }))
}

/// Pinned to a plane that has given this hardware id.
fn pinned(uid: u64) -> Pin {
    let mut pin = Pin::new(Vehicle::from_heartbeat(&plane()).expect("a vehicle"), HERE, 0.0);
    assert!(pin.take(0.1, HERE, &version(uid)));
    pin
}

fn conflict(pin: &mut Pin) -> (String, bool) {
    pin.take_conflict().map(|c| (c.words, c.separable)).unwrap_or_default()
}

#[test]
fn one_id_from_two_places_is_two_vehicles_whatever_their_hardware_id() {
    for uid in [0, 7] {
        let mut pin = pinned(uid);
        assert!(!pin.take(1.0, THERE, &plane()), "nothing of the other one is heard");
        assert_eq!(pin.take_conflict(), None, "the port of this one may have changed");
        assert!(pin.take(1.2, HERE, &plane()));
        let (words, separable) = conflict(&mut pin);
        assert!(words.contains("heard from two places, link 1 and link 2"), "{words}");
        assert!(separable && pin.may_send(), "what is on the first one can be put back");
        assert!(!pin.take(1.3, THERE, &plane()) && pin.take(1.4, HERE, &plane()));
        assert_eq!(pin.take_conflict(), None, "said once");
    }
}

#[test]
fn two_hardware_ids_from_one_place_end_all_sending() {
    let mut pin = pinned(7);
    assert!(!pin.take(0.2, HERE, &version(8)));
    let (words, separable) = conflict(&mut pin);
    assert!(words.contains("hardware ids 07 and 08"), "{words}");
    assert!(!separable && !pin.may_send());
}

#[test]
fn a_type_that_changes_ends_all_sending() {
    let mut pin = pinned(0);
    assert!(!pin.take(1.0, HERE, &heartbeat(MavType::MAV_TYPE_QUADROTOR)));
    let (words, separable) = conflict(&mut pin);
    assert!(words.contains("is a quadrotor (ArduPilot) now and was a fixed wing (ArduPilot)"), "{words}");
    assert!(!separable);
}

#[test]
fn after_a_silence_the_hardware_id_is_asked_for_before_anything_is_sent() {
    let mut pin = pinned(7);
    assert!(pin.take(5.0, HERE, &plane()));
    assert!(!pin.take(30.0, HERE, &plane()), "it may be another one");
    assert!(!pin.may_send());
    assert_eq!(pin.ask(30.0), Some(HERE));
    assert_eq!(pin.ask(30.1), None, "not all the time");
    assert!(pin.take(30.2, HERE, &version(7)));
    assert!(pin.may_send());
    // The other one.
    assert!(!pin.take(60.0, HERE, &plane()));
    assert!(!pin.take(60.2, HERE, &version(8)));
    let (words, separable) = conflict(&mut pin);
    assert!(words.contains("another vehicle is on the link now"), "{words}");
    assert!(!separable && !pin.may_send());
}

#[test]
fn a_vehicle_whose_port_has_changed_is_followed_when_its_hardware_id_says_so() {
    for (uid, followed) in [(7, true), (8, false), (0, false)] {
        let mut pin = pinned(7);
        for t in [1.0, 3.0, 5.0, 7.0] {
            assert!(!pin.take(t, THERE, &plane()), "{t}");
        }
        assert_eq!(pin.take_conflict(), None);
        assert_eq!(pin.ask(7.0), Some(THERE));
        assert_eq!(pin.take(7.1, THERE, &version(uid)), followed);
        assert_eq!(pin.take_conflict().is_none(), followed);
        assert_eq!(pin.origin(), if followed { THERE } else { HERE });
    }
}
