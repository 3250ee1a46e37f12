use super::*;
use proptest::prelude::*;

const STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
const OTHER: MavHeader = MavHeader { system_id: 250, component_id: 1, sequence: 0 };

fn server(flavour: Flavour) -> MissionServer {
    MissionServer::new(flavour, Item { z: 441.0, ..item(0, 1.0) })
}

fn item(seq: u16, param1: f32) -> Item {
    Item {
        seq,
        command: MavCmd::MAV_CMD_NAV_WAYPOINT,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        param1,
        x: 473_977_000 + i32::from(seq),
        y: 85_456_000,
        z: 50.126,
        ..Default::default()
    }
}

fn count(n: u16) -> MavMessage {
    MavMessage::MISSION_COUNT(MISSION_COUNT_DATA { count: n, ..Default::default() })
}

fn sent(i: Item) -> MavMessage {
    MavMessage::MISSION_ITEM_INT(i)
}

fn result(answers: &[MavMessage]) -> Option<MavMissionResult> {
    answers.iter().find_map(|m| if let MavMessage::MISSION_ACK(a) = m { Some(a.mavtype) } else { None })
}

/// The sequence number asked for, and whether with `MISSION_REQUEST_INT`.
fn asked(answers: &[MavMessage]) -> Option<(u16, bool)> {
    answers.iter().find_map(|m| match m {
        MavMessage::MISSION_REQUEST(r) => Some((r.seq, false)),
        MavMessage::MISSION_REQUEST_INT(r) => Some((r.seq, true)),
        _ => None,
    })
}

fn upload(server: &mut MissionServer, items: &mut Vec<Item>, n: u16, param1: f32) -> Vec<MavMessage> {
    let mut answers = server.handle(items, &STATION, &count(n), 0.0);
    while let Some((seq, _)) = asked(&answers) {
        answers = server.handle(items, &STATION, &sent(item(seq, param1)), 0.1);
    }
    answers
}

#[test]
fn ardupilot_asks_the_old_way_and_keeps_home() {
    let (mut s, mut items) = (server(Flavour::ArduPilot), Vec::new());
    let first = s.handle(&mut items, &STATION, &count(3), 0.0);
    assert_eq!(asked(&first), Some((0, false)));
    let end = upload(&mut s, &mut items, 3, 2.4);
    assert_eq!(result(&end), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
    assert_eq!(items.len(), 3);
    assert_eq!(items[0].z, 441.0);
    // Rounded as stored: whole seconds, centimetres, and the frame without _INT.
    assert_eq!((items[1].param1, items[1].z), (2.0, 50.12));
    assert_eq!(items[1].frame, MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT);
}

#[test]
fn ardupilot_leaves_a_mixed_mission_when_the_station_falls_silent() {
    let (mut s, mut items) = (server(Flavour::ArduPilot), Vec::new());
    upload(&mut s, &mut items, 5, 1.0);
    s.handle(&mut items, &STATION, &count(4), 0.0);
    for seq in 0..2 {
        s.handle(&mut items, &STATION, &sent(item(seq, 9.0)), 0.0);
    }
    assert_eq!(asked(&s.tick(1.0)), Some((2, false)));
    assert!(s.tick(1.5).is_empty());
    assert_eq!(asked(&s.tick(2.0)), Some((2, false)));
    assert_eq!(result(&s.tick(8.0)), Some(MavMissionResult::MAV_MISSION_OPERATION_CANCELLED));
    let params: Vec<f32> = items.iter().skip(1).map(|i| i.param1).collect();
    assert_eq!(params, vec![9.0, 1.0, 1.0]);
}

#[test]
fn px4_keeps_the_old_mission_until_the_new_one_is_whole() {
    let (mut s, mut items) = (server(Flavour::Px4), Vec::new());
    let end = upload(&mut s, &mut items, 3, 1.5);
    let before = items.clone();
    assert!(
        matches!(&end[0], MavMessage::MISSION_ACK(a) if a.opaque_id == s.opaque_id(&items) && a.opaque_id != 0)
    );
    s.handle(&mut items, &STATION, &count(2), 0.0);
    s.handle(&mut items, &STATION, &sent(item(0, 9.0)), 0.0);
    assert_eq!(asked(&s.tick(0.25)), Some((1, true)));
    assert_eq!(result(&s.tick(5.1)), Some(MavMissionResult::MAV_MISSION_OPERATION_CANCELLED));
    assert_eq!(items, before);
    assert_eq!(items[0].param1, 1.5);
}

#[test]
fn px4_acknowledges_again_when_its_ack_was_lost() {
    let (mut s, mut items) = (server(Flavour::Px4), Vec::new());
    upload(&mut s, &mut items, 3, 1.0);
    let again = s.handle(&mut items, &STATION, &sent(item(2, 1.0)), 1.0);
    assert_eq!(result(&again), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
    let stray = s.handle(&mut items, &STATION, &sent(item(1, 1.0)), 1.0);
    assert_eq!(result(&stray), Some(MavMissionResult::MAV_MISSION_ERROR));
}

#[test]
fn a_wrong_sequence_is_told_in_passing() {
    for (flavour, told) in
        [(Flavour::ArduPilot, Some(MavMissionResult::MAV_MISSION_INVALID_SEQUENCE)), (Flavour::Px4, None)]
    {
        let (mut s, mut items) = (server(flavour), Vec::new());
        s.handle(&mut items, &STATION, &count(2), 0.0);
        assert_eq!(result(&s.handle(&mut items, &STATION, &sent(item(1, 0.0)), 0.1)), told);
        let next = s.handle(&mut items, &STATION, &sent(item(0, 0.0)), 0.2);
        assert_eq!(asked(&next).map(|(seq, _)| seq), Some(1));
    }
}

#[test]
fn a_second_station_and_bad_items_are_refused() {
    let (mut s, mut items) = (server(Flavour::ArduPilot), Vec::new());
    s.handle(&mut items, &STATION, &count(2), 0.0);
    let denied = s.handle(&mut items, &OTHER, &count(2), 0.1);
    assert_eq!(result(&denied), Some(MavMissionResult::MAV_MISSION_DENIED));
    let local = Item { frame: MavFrame::MAV_FRAME_LOCAL_NED, ..item(0, 0.0) };
    let refused = s.handle(&mut items, &STATION, &sent(local), 0.2);
    assert_eq!(result(&refused), Some(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME));
    assert!(!s.is_uploading());
    let large = s.handle(&mut items, &STATION, &count(5000), 0.3);
    assert_eq!(result(&large), Some(MavMissionResult::MAV_MISSION_NO_SPACE));
}

#[test]
fn what_was_uploaded_can_be_read_back() {
    for flavour in [Flavour::ArduPilot, Flavour::Px4] {
        let (mut s, mut items) = (server(flavour), Vec::new());
        upload(&mut s, &mut items, 4, 3.0);
        let list = MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA::default());
        let answers = s.handle(&mut items, &STATION, &list, 1.0);
        assert!(
            matches!(&answers[0], MavMessage::MISSION_COUNT(c) if c.count == 4 && c.target_system == 255)
        );
        for seq in 1..4 {
            let request = MISSION_REQUEST_INT_DATA { seq, ..Default::default() };
            let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(request), 1.0);
            assert!(matches!(&answers[0], MavMessage::MISSION_ITEM_INT(i)
                if i.seq == seq && i.param1 == 3.0 && i.x == 473_977_000 + i32::from(seq)));
        }
        let beyond = MISSION_REQUEST_INT_DATA { seq: 4, ..Default::default() };
        let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(beyond), 1.0);
        assert!(result(&answers).is_some());
        s.handle(&mut items, &STATION, &MavMessage::MISSION_CLEAR_ALL(Default::default()), 2.0);
        assert!(items.is_empty());
    }
}

#[test]
fn ardupilot_rounds_large_radii_and_clamps_turns() {
    let turns =
        Item { command: MavCmd::MAV_CMD_NAV_LOITER_TURNS, param1: 300.0, param3: -307.2, ..item(1, 0.0) };
    let kept = rounded(turns);
    assert_eq!((kept.param1, kept.param3), (255.0, -310.0));
}

proptest! {
    /// Whatever arrives in whatever order, nothing breaks, and PX4 never holds a mixed mission.
    #[test]
    fn any_order_of_messages_is_survived(steps in proptest::collection::vec((0u8..4, 0u16..5, 0.0..3.0f64), 1..60)) {
        for flavour in [Flavour::ArduPilot, Flavour::Px4] {
            let (mut s, mut items) = (server(flavour), Vec::new());
            upload(&mut s, &mut items, 4, 1.0);
            let (mut now, mut generation) = (0.0, 1.0f32);
            for (what, seq, wait) in &steps {
                now += wait;
                s.tick(now);
                match what {
                    0 => {
                        if !s.is_uploading() {
                            generation += 1.0;
                        }
                        s.handle(&mut items, &STATION, &count(4), now);
                    }
                    1 => _ = s.handle(&mut items, &STATION, &sent(item(*seq, generation)), now),
                    2 => _ = s.handle(&mut items, &OTHER, &sent(item(*seq, 99.0)), now),
                    _ => {
                        let request = MISSION_REQUEST_INT_DATA { seq: *seq, ..Default::default() };
                        s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(request), now);
                    }
                }
                if flavour == Flavour::Px4 {
                    prop_assert!(items.windows(2).all(|w| w[0].param1 == w[1].param1));
                    prop_assert_eq!(items.len(), 4);
                }
                prop_assert!(items.iter().all(|i| i.param1 != 99.0));
            }
        }
    }
}
