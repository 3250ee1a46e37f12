//! Single transfers, message by message.

use super::*;

fn envelope(message: MissionMessage) -> Envelope {
    Envelope { from: VEHICLE, to: ME, message }
}

fn acked(result: MissionResult) -> Envelope {
    envelope(MissionMessage::Ack { result, mission_type: 0, opaque_id: 99 })
}

fn upload() -> Upload {
    let items = mission(1, 3).wire_items(Autopilot::ArduPilot);
    Upload::start(Peers::new(ME, VEHICLE), items, 0.0).0
}

fn request(seq: u16) -> Envelope {
    envelope(MissionMessage::Request { seq, mission_type: 0 })
}

#[test]
fn the_count_is_repeated_five_times_and_then_given_up() {
    let mut upload = upload();
    let mut sent = 0;
    while let Some(deadline) = upload.deadline() {
        sent += upload.tick(deadline).len();
    }
    assert_eq!(sent, 5);
    assert_eq!(upload.result(), Some(&Err(TransferError::NoReply)));
}

#[test]
fn a_plain_request_is_answered_with_an_integer_item() {
    let mut upload = upload();
    let actions = upload.receive(0.1, &request(1));
    assert!(matches!(&actions[0],
        Action::Send(MissionMessage::ItemInt { seq: 1, item, .. }) if item.frame == crate::item::Frame(6)));
}

#[test]
fn strangers_and_other_mission_types_are_not_heard() {
    let mut upload = upload();
    let gimbal = Envelope { from: Address { system: 1, component: 154 }, ..request(0) };
    let other_station = Envelope { to: Address { system: 255, component: 190 }, ..request(0) };
    let fence = envelope(MissionMessage::RequestInt { seq: 0, mission_type: 1 });
    for stranger in [gimbal, other_station, fence] {
        assert!(upload.receive(0.1, &stranger).is_empty());
    }
}

#[test]
fn items_are_never_sent_on_our_own_timer() {
    let mut upload = upload();
    upload.receive(0.1, &request(0));
    let silence = upload.deadline().expect("still running");
    assert!(upload.tick(silence - 0.01).is_empty());
    assert!(upload.tick(silence).is_empty());
    assert_eq!(upload.result(), Some(&Err(TransferError::Silent { done: 1, total: 4 })));
}

#[test]
fn invalid_sequence_in_passing_does_not_end_an_upload() {
    let mut upload = upload();
    for (seq, in_passing) in [
        (0, MissionResult::INVALID_SEQUENCE),
        (1, MissionResult::ACCEPTED),
        (2, MissionResult::ERROR),
        (3, MissionResult::INVALID_SEQUENCE),
    ] {
        assert_eq!(upload.receive(0.1, &request(seq)).len(), 2);
        if seq < 3 {
            upload.receive(0.1, &acked(in_passing));
            assert_eq!(upload.result(), None, "{seq}");
        }
    }
    upload.receive(0.2, &acked(MissionResult::ACCEPTED));
    assert_eq!(upload.result(), Some(&Ok(99)), "with PX4's opaque id");
}

#[test]
fn a_refused_item_is_named() {
    let mut upload = upload();
    upload.receive(0.1, &request(2));
    upload.receive(0.1, &acked(MissionResult::INVALID_PARAM1));
    let Some(Err(error)) = upload.result() else { panic!("refused") };
    assert_eq!(error.to_string(), "the vehicle refused: an item has an invalid parameter 1");
    assert!(!error.is_transient());
}

#[test]
fn a_busy_vehicle_is_reported_as_such() {
    let mut upload = upload();
    upload.receive(0.1, &acked(MissionResult::DENIED));
    while let Some(deadline) = upload.deadline() {
        upload.tick(deadline);
    }
    let Some(Err(error)) = upload.result() else { panic!("refused") };
    assert!(error.to_string().contains("another station may be transferring"), "{error}");
}

#[test]
fn a_download_asks_again_and_ignores_what_is_late() {
    let (mut download, _) = Download::start(Peers::new(ME, VEHICLE), 0.0);
    let count = envelope(MissionMessage::Count { count: 2, mission_type: 0, opaque_id: 5 });
    let actions = download.receive(0.05, &count);
    assert_eq!(actions, [Action::Send(MissionMessage::RequestInt { seq: 0, mission_type: 0 })]);
    assert_eq!(download.deadline(), Some(0.05 + 0.25));
    assert_eq!(download.tick(0.3), [Action::Send(MissionMessage::RequestInt { seq: 0, mission_type: 0 })]);
    let items = mission(1, 2).items;
    let item = |seq: u16| {
        let item = items[usize::from(seq)];
        envelope(MissionMessage::ItemInt { seq, current: false, item, mission_type: 0 })
    };
    download.receive(0.4, &item(0));
    assert!(download.receive(0.4, &item(0)).is_empty(), "a late duplicate");
    let last = download.receive(0.5, &item(1));
    assert!(matches!(last[1], Action::Send(MissionMessage::Ack { result: MissionResult::ACCEPTED, .. })));
    let got = download.result().and_then(Result::ok).expect("complete");
    assert_eq!((got.items.len(), got.opaque_id), (2, 5));
}

#[test]
fn a_slow_link_stretches_the_wait_for_items() {
    let (mut download, _) = Download::start(Peers::new(ME, VEHICLE), 0.0);
    download.receive(0.4, &envelope(MissionMessage::Count { count: 2, mission_type: 0, opaque_id: 0 }));
    assert_eq!(download.deadline(), Some(0.4 + 0.8));
}

#[test]
fn clearing_ends_with_the_acknowledgement() {
    let (mut clear, actions) = Clear::start(Peers::new(ME, VEHICLE), 0.0);
    assert_eq!(actions, [Action::Send(MissionMessage::ClearAll { mission_type: 0 })]);
    assert_eq!(clear.tick(1.5).len(), 1);
    clear.receive(1.7, &acked(MissionResult::ACCEPTED));
    assert_eq!(clear.result(), Some(&Ok(())));
}

#[test]
fn a_late_answer_about_the_list_before_is_not_taken_for_what_is_on_board() {
    let new = Mission { home: None, items: mission(1, 1).items };
    let count = |count| envelope(MissionMessage::Count { count, mission_type: 0, opaque_id: 0 });
    let item = new.wire_items(Autopilot::Px4)[0];
    let (mut upload, _) = VerifiedUpload::start(
        Peers::new(ME, VEHICLE),
        Autopilot::Px4,
        Options { confirm: false, ..Options::default() },
        new,
        Some(ON_THE_GROUND),
        0.0,
    );
    // The vehicle is asked twice what it has, and answers twice that it has nothing; the second answer is late.
    let again = upload.deadline().expect("the question is repeated");
    upload.tick(again);
    upload.receive(again + 0.1, &count(0));
    upload.receive(again + 0.2, &request(0));
    upload.receive(again + 0.3, &acked(MissionResult::ACCEPTED));
    upload.receive(again + 0.4, &count(0));
    assert_eq!(upload.outcome(), None, "that answer is older than the upload");
    let asks = upload.tick(again + 2.2);
    assert!(matches!(asks[..], [Action::Send(MissionMessage::RequestList { .. })]), "{asks:?}");
    upload.receive(again + 2.3, &count(1));
    let on_board = MissionMessage::ItemInt { seq: 0, current: false, item, mission_type: 0 };
    upload.receive(again + 2.4, &envelope(on_board));
    let asks = upload.tick(again + 10.0);
    assert_eq!(asks, [Action::Send(MissionMessage::SetCurrent { seq: 0 })]);
    let current = MissionMessage::Current { seq: 0, total: 1, state: 0, mission_id: 0 };
    upload.receive(again + 10.1, &envelope(current));
    assert_eq!(upload.outcome(), Some(&Outcome::Verified { items: 1 }));
}
