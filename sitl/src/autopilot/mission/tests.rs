use super::*;
use gaware_mission::item::{Frame, LatLon, MissionItem, MissionKind, command};
use gaware_mission::rules::{Firmware, stored_item, table::ROWS};
use gaware_mission::transfer::{Action, Address, Envelope, MissionMessage, Peers, Upload};
use mavlink::MessageData;
use proptest::prelude::*;

const STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
const OTHER: MavHeader = MavHeader { system_id: 250, component_id: 1, sequence: 0 };

fn server(flavour: Flavour) -> MissionServer {
    MissionServer::new(flavour, Airframe::Multirotor, Item { z: 441.0, ..item(0, 1.0) })
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
    assert_eq!(items[1].param1, 2.0);
    assert!((items[1].z - 50.12).abs() < 1e-4);
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
    // It gives up without a word.
    assert!(s.tick(5.1).is_empty() && !s.is_uploading());
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
        for seq in 0..4 {
            let request = MISSION_REQUEST_INT_DATA { seq, ..Default::default() };
            let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(request), 1.0);
            assert!(matches!(&answers[0], MavMessage::MISSION_ITEM_INT(i)
                if i.seq == seq && (i.param1 == 3.0 || seq == 0) && i.x == 473_977_000 + i32::from(seq)));
        }
        let beyond = MISSION_REQUEST_INT_DATA { seq: 4, ..Default::default() };
        let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(beyond), 1.0);
        assert!(result(&answers).is_some());
        s.handle(&mut items, &STATION, &MavMessage::MISSION_CLEAR_ALL(Default::default()), 2.0);
        assert!(items.is_empty());
    }
}

/// `sanity_check_params`: a plan with `null` in parameter 4 of its circles was taken by the simulated autopilot and by no real one.
#[test]
fn ardupilot_refuses_nan_and_infinity_by_parameter() {
    use MavMissionResult::*;
    let results = [
        MAV_MISSION_INVALID_PARAM1,
        MAV_MISSION_INVALID_PARAM2,
        MAV_MISSION_INVALID_PARAM3,
        MAV_MISSION_INVALID_PARAM4,
    ];
    let commands = [
        (MavCmd::MAV_CMD_NAV_WAYPOINT, true),
        (MavCmd::MAV_CMD_NAV_TAKEOFF, true),
        (MavCmd::MAV_CMD_NAV_LAND, true),
        (MavCmd::MAV_CMD_NAV_LOITER_UNLIM, false),
        (MavCmd::MAV_CMD_NAV_LOITER_TURNS, false),
        (MavCmd::MAV_CMD_NAV_LOITER_TIME, false),
        (MavCmd::MAV_CMD_NAV_LOITER_TO_ALT, false),
        (MavCmd::MAV_CMD_DO_CHANGE_SPEED, false),
        (MavCmd::MAV_CMD_CONDITION_YAW, false),
    ];
    for (command, fourth) in commands {
        for (k, refused) in results.into_iter().enumerate() {
            for value in [f32::NAN, f32::INFINITY] {
                let mut sent_item = Item { command, param2: 0.0, ..item(0, 1.0) };
                match k {
                    0 => sent_item.param1 = value,
                    1 => sent_item.param2 = value,
                    2 => sent_item.param3 = value,
                    _ => sent_item.param4 = value,
                }
                let (mut s, mut items) = (server(Flavour::ArduPilot), Vec::new());
                s.handle(&mut items, &STATION, &count(2), 0.0);
                let answer = s.handle(&mut items, &STATION, &sent(sent_item), 0.1);
                let expected = (!(value.is_nan() && k == 3 && fourth)).then_some(refused);
                assert_eq!(result(&answer), expected, "{command:?}, parameter {}", k + 1);
            }
        }
    }
    let (mut s, mut items) = (server(Flavour::ArduPilot), Vec::new());
    s.handle(&mut items, &STATION, &count(2), 0.0);
    let answer = s.handle(&mut items, &STATION, &sent(Item { z: f32::NAN, ..item(0, 0.0) }), 0.1);
    assert_eq!(result(&answer), Some(MAV_MISSION_INVALID_PARAM7));
}

/// Literals from `mission_cmd_to_mavlink_int`.
#[test]
fn ardupilot_reads_actions_back_in_frame_0_and_cuts_to_centimetres() {
    let speed = Item {
        command: MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        frame: MavFrame::MAV_FRAME_MISSION,
        param2: 21.5,
        param3: -1.0,
        ..item(1, 0.0)
    };
    let kept = ardupilot::keep(speed, true).expect("taken");
    assert_eq!((kept.frame as u32, kept.param2, kept.param3, kept.x, kept.z), (0, 21.5, -1.0, 0, 0.0));
    let kept = ardupilot::keep(Item { z: 16.05, ..item(1, 0.0) }, true).expect("taken");
    assert!((kept.z - 16.04).abs() < 1e-4, "{}", kept.z);
    for (wing, params) in [(true, [0.0, 9.0, 8.0, 0.0]), (false, [3.0, 0.0, 0.0, 0.0])] {
        let sent_item = Item { param2: 9.9, param3: 8.9, param4: f32::NAN, ..item(1, 3.9) };
        let kept = ardupilot::keep(sent_item, wing).expect("taken");
        assert_eq!([kept.param1, kept.param2, kept.param3, kept.param4], params);
    }
}

/// FIELD_NOTES, "PX4's own firmware, measured".
#[test]
fn px4_reads_back_what_was_measured() {
    let nan = f32::NAN;
    let cases = [
        (22, [12.0, 0.0, 0.0, nan], [0.0, 0.0, 0.0, nan]),
        (16, [1.5, 2.5, 3.5, nan], [1.5, 2.5, 0.0, nan]),
        (16, [0.0, 0.0, 0.0, -90.0], [0.0, 0.0, 0.0, 270.0]),
        (17, [0.0, 0.0, -70.5, nan], [0.0, 0.0, -70.5, nan]),
        (19, [30.5, 0.0, 70.5, nan], [30.5, 0.0, 70.5, 0.0]),
        (31, [0.0, -70.5, 0.0, nan], [0.0, -70.5, 0.0, 0.0]),
        (31, [0.0, -70.5, 0.0, 1.0], [0.0, -70.5, 0.0, 1.0]),
    ];
    for (number, p, kept) in cases {
        let command = match number {
            16 => MavCmd::MAV_CMD_NAV_WAYPOINT,
            17 => MavCmd::MAV_CMD_NAV_LOITER_UNLIM,
            19 => MavCmd::MAV_CMD_NAV_LOITER_TIME,
            22 => MavCmd::MAV_CMD_NAV_TAKEOFF,
            _ => MavCmd::MAV_CMD_NAV_LOITER_TO_ALT,
        };
        let [param1, param2, param3, param4] = p;
        let frame = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
        let sent_item = Item { command, frame, param1, param2, param3, param4, ..item(0, 0.0) };
        let got = px4::keep(sent_item).expect("taken");
        let params = [got.param1, got.param2, got.param3, got.param4];
        let same = params.iter().zip(kept).all(|(a, b)| (a - b).abs() < 1e-4 || a.is_nan() && b.is_nan());
        assert!(same, "{number}: {params:?}");
        assert_eq!(got.frame, MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT);
    }
    let speed = Item { command: MavCmd::MAV_CMD_DO_CHANGE_SPEED, ..item(0, 1.0) };
    assert_eq!(px4::keep(speed), Err(MavMissionResult::MAV_MISSION_UNSUPPORTED), "in a global frame");
    let turns = Item { command: MavCmd::MAV_CMD_NAV_LOITER_TURNS, ..item(0, 1.0) };
    assert_eq!(px4::keep(turns), Err(MavMissionResult::MAV_MISSION_UNSUPPORTED));
}

#[test]
fn ardupilot_rounds_large_radii_and_clamps_turns() {
    let turns =
        Item { command: MavCmd::MAV_CMD_NAV_LOITER_TURNS, param1: 300.0, param3: -307.2, ..item(1, 0.0) };
    let kept = ardupilot::keep(turns, true).expect("taken");
    assert_eq!((kept.param1, kept.param3), (255.0, -300.0));
}

fn fence_item(seq: u16, command: MavCmd, param1: f32) -> Item {
    Item {
        command,
        z: 12.5,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE,
        param2: 7.0,
        autocontinue: 1,
        ..item(seq, param1)
    }
}

/// A triangle and a circle.
fn fence() -> Vec<Item> {
    use MavCmd::*;
    let mut all: Vec<Item> =
        (0..3).map(|k| fence_item(k, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 3.0)).collect();
    all.push(fence_item(3, MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, 60.5));
    all
}

fn upload_fence(server: &mut MissionServer, mission: &mut Vec<Item>, fence: &[Item]) -> Vec<MavMessage> {
    let mission_type = MavMissionType::MAV_MISSION_TYPE_FENCE;
    let count = MISSION_COUNT_DATA { count: fence.len() as u16, mission_type, ..Default::default() };
    let mut answers = server.handle(mission, &STATION, &MavMessage::MISSION_COUNT(count), 0.0);
    while let Some((seq, _)) = asked(&answers) {
        answers = server.handle(mission, &STATION, &sent(fence[usize::from(seq)].clone()), 0.1);
    }
    answers
}

#[test]
fn a_fence_is_a_list_of_its_own() {
    for (flavour, frame, z, param2) in [
        (Flavour::ArduPilot, MavFrame::MAV_FRAME_GLOBAL, 0.0, 0.0),
        (Flavour::Px4, MavFrame::MAV_FRAME_GLOBAL_INT, 12.5, 0.0),
    ] {
        let (mut s, mut items) = (server(flavour), Vec::new());
        upload(&mut s, &mut items, 3, 1.0);
        let mission = items.clone();
        let end = upload_fence(&mut s, &mut items, &fence());
        let accepted = matches!(&end[0], MavMessage::MISSION_ACK(a)
            if a.mission_type == MavMissionType::MAV_MISSION_TYPE_FENCE
                && a.mavtype == MavMissionResult::MAV_MISSION_ACCEPTED);
        assert!(accepted, "{flavour:?}: {end:?}");
        assert_eq!((items.clone(), s.fence().len(), s.fence_total()), (mission.clone(), 4, 6));
        let kept = s.fence()[3].clone();
        assert_eq!((kept.param1, kept.param2, kept.z, kept.frame), (60.5, param2, z, frame));
        assert_eq!(kept.autocontinue, 0, "{flavour:?}");

        // A count, a download and a clearing are of their type too.
        let mission_type = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let list = MISSION_REQUEST_LIST_DATA { mission_type, ..Default::default() };
        let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_LIST(list), 1.0);
        assert!(matches!(&answers[0], MavMessage::MISSION_COUNT(c)
            if c.count == 4 && c.mission_type == mission_type));
        let request = MISSION_REQUEST_INT_DATA { seq: 0, mission_type, ..Default::default() };
        let answers = s.handle(&mut items, &STATION, &MavMessage::MISSION_REQUEST_INT(request), 1.0);
        assert!(matches!(&answers[0], MavMessage::MISSION_ITEM_INT(i)
            if i.param1 == 3.0 && i.mission_type == mission_type));
        let clear = MISSION_CLEAR_ALL_DATA { mission_type, ..Default::default() };
        s.handle(&mut items, &STATION, &MavMessage::MISSION_CLEAR_ALL(clear), 1.0);
        assert_eq!((items, s.fence().len(), s.fence_total()), (mission, 0, 0));
    }
}

/// `AC_PolyFence_loader::validate_fence`, PX4's `handle_mission_item_both`: an invalid fence leaves the one on board alone.
#[test]
fn an_invalid_fence_is_refused_as_a_whole() {
    use MavCmd::*;
    let corner = |seq, n| fence_item(seq, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, n);
    let circle = |seq, r| fence_item(seq, MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, r);
    let error = MavMissionResult::MAV_MISSION_ERROR;
    let cases = [
        (Flavour::ArduPilot, vec![corner(0, 2.0), corner(1, 2.0)], error),
        (Flavour::ArduPilot, vec![corner(0, 3.0), corner(1, 3.0)], error),
        (Flavour::ArduPilot, vec![corner(0, 3.0), corner(1, 3.0), circle(2, 50.0)], error),
        (Flavour::ArduPilot, vec![circle(0, 0.0)], error),
        (Flavour::ArduPilot, vec![circle(0, f32::NAN)], error),
        (Flavour::ArduPilot, vec![corner(0, 256.0)], MavMissionResult::MAV_MISSION_INVALID_PARAM1),
        (Flavour::ArduPilot, vec![item(0, 1.0)], error),
        (Flavour::Px4, vec![corner(0, 2.0)], error),
    ];
    for (flavour, wrong, refused) in cases {
        let (mut s, mut items) = (server(flavour), Vec::new());
        upload_fence(&mut s, &mut items, &fence());
        let end = upload_fence(&mut s, &mut items, &wrong);
        assert_eq!(result(&end), Some(refused), "{flavour:?} {wrong:?}");
        assert_eq!(s.fence().len(), 4);
    }
}

#[test]
fn rally_points_keep_whole_metres_on_ardupilot() {
    for (flavour, z) in [(Flavour::ArduPilot, 50.0), (Flavour::Px4, 50.126)] {
        let (mut s, mut items) = (server(flavour), Vec::new());
        let mission_type = MavMissionType::MAV_MISSION_TYPE_RALLY;
        let count = MISSION_COUNT_DATA { count: 1, mission_type, ..Default::default() };
        s.handle(&mut items, &STATION, &MavMessage::MISSION_COUNT(count), 0.0);
        let point = Item { command: MavCmd::MAV_CMD_NAV_RALLY_POINT, mission_type, ..item(0, 0.0) };
        let end = s.handle(&mut items, &STATION, &sent(point), 0.0);
        assert_eq!(result(&end), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
        assert_eq!((s.rally_points()[0].z, items.len()), (z, 0));
    }
}

/// What PX4 makes of a rally point's frame shows only at the return: the read-back says `_INT` whatever was sent.
#[test]
fn px4_returns_to_the_rally_points_that_are_uploaded() {
    for flavour in [Flavour::ArduPilot, Flavour::Px4] {
        let (mut s, mut items) = (server(flavour), Vec::new());
        let place = LatLon { lat_deg: 47.3977, lon_deg: 8.5456 };
        let at = |z| MissionItem::at(command::NAV_RALLY_POINT, [0.0; 4], place, z);
        let me = Address { system: STATION.system_id as u8, component: STATION.component_id };
        let peers = Peers::new(me, Address { system: 1, component: 1 }).about(MissionKind::Rally);
        let (mut upload, _) = Upload::start(peers, vec![at(40.0), at(60.0)], 0.0);
        let mission_type = MavMissionType::MAV_MISSION_TYPE_RALLY;
        let count = MISSION_COUNT_DATA { count: 2, mission_type, ..Default::default() };
        s.handle(&mut items, &STATION, &MavMessage::MISSION_COUNT(count), 0.0);
        for seq in 0..2 {
            let message = MissionMessage::RequestInt { seq, mission_type: mission_type as u8 };
            let actions = upload.receive(0.0, &Envelope { from: peers.vehicle, to: me, message });
            let [Action::Send(MissionMessage::ItemInt { item, .. }), ..] = actions.as_slice() else {
                panic!("{actions:?}")
            };
            s.handle(&mut items, &STATION, &sent(Item { seq, ..on_wire(item, mission_type) }), 0.0);
        }
        let read_back = s.rally_points().iter().map(|i| i.frame as u8).collect::<Vec<_>>();
        assert_eq!(read_back, if flavour == Flavour::Px4 { [6; 2] } else { [3; 2] });
        assert_eq!(s.take_texts(), Vec::<&str>::new(), "{flavour:?}");
    }
}

/// `GCS::get_prot_for_mission_type` knows three lists; PX4 clears all of them at once.
#[test]
fn clearing_everything_at_once_is_for_px4() {
    for (flavour, answer, left) in [
        (Flavour::ArduPilot, MavMissionResult::MAV_MISSION_UNSUPPORTED, 4),
        (Flavour::Px4, MavMissionResult::MAV_MISSION_ACCEPTED, 0),
    ] {
        let (mut s, mut items) = (server(flavour), Vec::new());
        upload_fence(&mut s, &mut items, &fence());
        let mission_type = MavMissionType::MAV_MISSION_TYPE_ALL;
        let clear = MISSION_CLEAR_ALL_DATA { mission_type, ..Default::default() };
        let end = s.handle(&mut items, &STATION, &MavMessage::MISSION_CLEAR_ALL(clear), 1.0);
        assert_eq!((result(&end), s.fence().len()), (Some(answer), left));
    }
}

/// A fence may go up while a mission does on ArduPilot, whose lists are transferred independently; PX4 does one at a time.
#[test]
fn two_lists_at_once() {
    for (flavour, first) in
        [(Flavour::ArduPilot, None), (Flavour::Px4, Some(MavMissionResult::MAV_MISSION_ERROR))]
    {
        let (mut s, mut items) = (server(flavour), Vec::new());
        s.handle(&mut items, &STATION, &count(2), 0.0);
        s.handle(&mut items, &STATION, &sent(item(0, 1.0)), 0.0);
        let mission_type = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let count = MISSION_COUNT_DATA { count: 1, mission_type, ..Default::default() };
        let answer = s.handle(&mut items, &STATION, &MavMessage::MISSION_COUNT(count), 0.0);
        assert_eq!(result(&answer), first, "{flavour:?}");
        let end = s.handle(&mut items, &STATION, &sent(item(1, 1.0)), 0.0);
        assert_eq!(result(&end), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
    }
}

/// `handle_mission_item_both`: the index follows the mark, stays without one, and nothing happens where the mission is the same.
#[test]
fn px4_takes_the_current_item_from_the_mark_of_another_mission_alone() {
    let (mut s, mut items) = (server(Flavour::Px4), Vec::new());
    let mut upload = |param1: f32, marked: Option<u16>| {
        let mut answers = s.handle(&mut items, &STATION, &count(4), 0.0);
        while let Some((seq, _)) = asked(&answers) {
            let current = u8::from(marked == Some(seq));
            answers = s.handle(&mut items, &STATION, &sent(Item { current, ..item(seq, param1) }), 0.1);
        }
        s.take_cursor()
    };
    assert_eq!(upload(1.0, None), Some(Cursor::Stays));
    assert_eq!(upload(2.0, Some(0)), Some(Cursor::At(0)));
    assert_eq!(upload(2.0, Some(0)), None);
    s.handle(&mut items, &STATION, &MavMessage::MISSION_CLEAR_ALL(Default::default()), 2.0);
    assert_eq!(s.take_cursor(), Some(Cursor::At(0)));
}

/// An item of the table as the wire has it.
fn on_wire(item: &MissionItem, mission_type: MavMissionType) -> Item {
    let mut payload: Vec<u8> = item.params.iter().flat_map(|p| p.to_le_bytes()).collect();
    payload.extend([item.x, item.y].iter().flat_map(|v| v.to_le_bytes()));
    payload.extend(item.z.to_le_bytes());
    payload.extend([0, 0]);
    payload.extend(item.command.to_le_bytes());
    payload.extend([1, 1, item.frame.0, 0, u8::from(item.autocontinue), mission_type as u8]);
    Item::deser(mavlink::MavlinkVersion::V2, &payload).expect("known to the dialect")
}

fn from_wire(item: &Item) -> MissionItem {
    MissionItem {
        command: item.command as u16,
        frame: Frame(item.frame as u8),
        autocontinue: item.autocontinue != 0,
        params: [item.param1, item.param2, item.param3, item.param4],
        x: item.x,
        y: item.y,
        z: item.z,
    }
}

proptest! {
    /// The table by which an upload is compared and the simulated autopilots were written from the same sources, apart from each other: they
    /// keep, cut and drop the same fields of every command, in all three lists.
    #[test]
    fn what_is_kept_is_what_the_table_says(
        params in proptest::array::uniform4(-400.0f32..400.0),
        place in (-900_000_000i32..900_000_000, -1_800_000_000i32..1_800_000_000),
        z in -300.0f32..3000.0,
        autocontinue: bool,
        frame in 0u8..12,
    ) {
        for row in ROWS.iter().filter(|r| !r.note.contains("only") && r.frames.take(Frame(frame))) {
            for firmware in row.firmware {
                let (flavour, airframe) = match firmware {
                    Firmware::ArduPlane => (Flavour::ArduPilot, Airframe::FixedWing),
                    Firmware::ArduCopter => (Flavour::ArduPilot, Airframe::Multirotor),
                    Firmware::Px4 => (Flavour::Px4, Airframe::FixedWing),
                };
                let mut params = params;
                let list = match row.list {
                    MissionKind::Mission => List::Mission,
                    MissionKind::Fence => List::Fence,
                    MissionKind::Rally => List::Rally,
                };
                // The number of corners, and the kinds of a region of interest.
                match row.command {
                    command::NAV_FENCE_POLYGON_VERTEX_INCLUSION | command::NAV_FENCE_POLYGON_VERTEX_EXCLUSION => {
                        params[0] = params[0].abs().trunc().clamp(3.0, 255.0);
                    }
                    command::DO_SET_ROI => params[0] = 0.0,
                    _ => {}
                }
                let (command, (x, y)) = (row.command, place);
                let sent = MissionItem { command, frame: Frame(frame), autocontinue, params, x, y, z };
                let kept = Storage { flavour, airframe }.keep(list, on_wire(&sent, list.mission_type()));
                let context = format!("{firmware:?} {sent:?}");
                let Ok(kept) = kept else {
                    prop_assert!(!row.taken, "{context}: refused by the vehicle, {kept:?}");
                    continue;
                };
                prop_assert!(row.taken, "{context}: refused by the table");
                let (stored, kept) = (stored_item(&sent, *firmware), from_wire(&kept));
                let near = |a: f32, b: f32| (a - b).abs() <= 1e-4;
                let same = stored.params.iter().zip(kept.params).all(|(a, b)| near(*a, b)) && near(stored.z, kept.z);
                let of = |i: &MissionItem| (i.x, i.y, i.frame, i.autocontinue);
                prop_assert!(same && of(&stored) == of(&kept), "{context}: {stored:?}, vehicle: {kept:?}");
            }
        }
    }

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
