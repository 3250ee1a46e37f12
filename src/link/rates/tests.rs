//! The keeper against made-up autopilots.

use super::*;
use crate::link::frame::Sender;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MESSAGE_INTERVAL_DATA};

const VEHICLE: Sender = Sender { system_id: 1, component_id: 1 };

/// An autopilot: what it answers to a request for a message and a rate, and what rates it then sends.
struct Fake {
    keeper: RateKeeper,
    now_us: u64,
    sent: Vec<(u32, f64)>,
    told: Vec<RateNotice>,
    streams: Vec<u8>,
    rates: Vec<(u32, f64)>,
    /// Whether it says which intervals are set, …
    answers_queries: bool,
    /// … and of these messages that it does not have them; each request for one is put into the pilot's messages.
    missing: Vec<u32>,
    queries: usize,
}

impl Fake {
    fn new(wanted: Vec<Wanted>) -> Self {
        Self::of(Autopilot::Ardupilot, wanted)
    }

    fn of(autopilot: Autopilot, wanted: Vec<Wanted>) -> Self {
        Self {
            keeper: RateKeeper::new(1, autopilot, wanted, 0),
            now_us: 0,
            sent: vec![],
            told: vec![],
            streams: vec![],
            rates: vec![],
            answers_queries: true,
            missing: vec![],
            queries: 0,
        }
    }

    fn run(&mut self, seconds: u64, answer: impl Fn(u32, f64) -> Option<MavResult>) {
        for _ in 0..seconds * 100 {
            self.now_us += 10_000;
            let mut out = Vec::new();
            for (id, hz) in self.rates.clone() {
                let every = (100.0 / hz).round() as u64;
                if (self.now_us / 10_000).is_multiple_of(every.max(1)) {
                    let message = <MavMessage as mavlink::Message>::default_message_from_id(id).unwrap();
                    self.keeper.receive(self.now_us, &Frame::encode(VEHICLE, 0, &message), &mut out);
                }
            }
            if self.now_us.is_multiple_of(1_000_000) {
                let heartbeat = <MavMessage as mavlink::Message>::default_message_from_id(0).unwrap();
                self.keeper.receive(self.now_us, &Frame::encode(VEHICLE, 0, &heartbeat), &mut out);
            }
            self.keeper.poll(self.now_us, &mut out);
            for action in out {
                self.act(action, &answer);
            }
        }
    }

    fn act(&mut self, action: RateAction, answer: &impl Fn(u32, f64) -> Option<MavResult>) {
        match action {
            RateAction::Tell(notice) => self.told.push(notice),
            #[expect(deprecated, reason = "the old way")]
            RateAction::Send(MavMessage::REQUEST_DATA_STREAM(m)) => self.streams.push(m.req_stream_id as u8),
            RateAction::Send(MavMessage::COMMAND_LONG(m)) if m.command == GET_MESSAGE_INTERVAL => {
                self.queries += 1;
                if self.answers_queries {
                    self.tell_interval(&m, answer);
                }
            }
            RateAction::Send(MavMessage::COMMAND_LONG(m)) => {
                assert_eq!((m.param3, m.param4, m.param5, m.param6), (0.0, 0.0, 0.0, 0.0));
                assert!(m.param2 % 1000.0 == 0.0, "ArduPilot wants whole milliseconds");
                assert!(!self.missing.contains(&(m.param1 as u32)), "the pilot reads of it");
                let (id, hz) = (m.param1 as u32, 1e6 / f64::from(m.param2));
                self.sent.push((id, hz));
                if let Some(result) = answer(id, hz) {
                    if result == MavResult::MAV_RESULT_ACCEPTED {
                        self.rates.retain(|(other, _)| *other != id);
                        self.rates.push((id, hz));
                    }
                    let ack = COMMAND_ACK_DATA {
                        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                        result,
                        ..Default::default()
                    };
                    let frame = Frame::encode(VEHICLE, 0, &MavMessage::COMMAND_ACK(ack));
                    let mut out = Vec::new();
                    self.keeper.receive(self.now_us, &frame, &mut out);
                    out.into_iter().for_each(|a| self.act(a, answer));
                }
            }
            RateAction::Send(other) => panic!("{other:?}"),
        }
    }
}

impl Fake {
    fn tell_interval(&mut self, m: &COMMAND_LONG_DATA, answer: &impl Fn(u32, f64) -> Option<MavResult>) {
        let id = m.param1 as u32;
        let set = self.rates.iter().find(|(other, _)| *other == id).map(|(_, hz)| (1e6 / hz) as i32);
        let interval_us = if self.missing.contains(&id) { 0 } else { set.unwrap_or(-1) };
        let message = MESSAGE_INTERVAL_DATA { message_id: id as u16, interval_us };
        let frame = Frame::encode(VEHICLE, 0, &MavMessage::MESSAGE_INTERVAL(message));
        let mut out = Vec::new();
        self.keeper.receive(self.now_us, &frame, &mut out);
        out.into_iter().for_each(|a| self.act(a, answer));
    }
}

/// What a request of these says: message and interval, µs.
fn intervals(messages: &[MavMessage]) -> Vec<(u32, f32)> {
    let of = |m: &MavMessage| match m {
        MavMessage::COMMAND_LONG(m) if m.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
            (m.param1 as u32, m.param2)
        }
        other => panic!("{other:?}"),
    };
    messages.iter().map(of).collect()
}

const YES: fn(u32, f64) -> Option<MavResult> = |_, _| Some(MavResult::MAV_RESULT_ACCEPTED);

fn wanted(list: &[(u32, u16)]) -> Vec<Wanted> {
    list.iter()
        .map(|(message_id, rate_hz)| Wanted {
            message_id: *message_id,
            rate_hz: *rate_hz,
            alternative: !matches!(message_id, 24 | 30),
        })
        .collect()
}

#[test]
fn what_is_given_is_not_asked_for_again() {
    let mut fake = Fake::new(wanted(&[(27, 100), (24, 10), (30, 10)]));
    fake.run(60, |_, _| Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(fake.sent, vec![(27, 100.0), (24, 10.0), (30, 10.0)]);
    assert!(fake.told.is_empty());
}

#[test]
fn a_refused_rate_is_lowered_and_told() {
    let mut fake = Fake::new(wanted(&[(27, 200)]));
    fake.run(20, |_, hz| {
        Some(if hz > 40.0 { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED })
    });
    assert_eq!(fake.rates, vec![(27, 40.0)]);
    assert_eq!(fake.told, [RateNotice::Refused { message_id: 27, rate_hz: 200, granted_hz: Some(40) }]);
}

#[test]
fn of_what_the_loops_of_ardupilot_grant_nearly_all_is_taken() {
    // `GCS_MAVLINK::cap_message_interval`: 1.25 loops, cut to whole milliseconds.
    for (loop_hz, rate_hz) in
        [(50.0, 40), (100.0, 50), (200.0, 166), (250.0, 200), (300.0, 250), (400.0, 333)]
    {
        let mut fake = Fake::new(wanted(&[(105, 400)]));
        let cap_hz = 1e3 / f64::floor(1250.0 / loop_hz);
        fake.run(20, |_, hz| {
            Some(if hz > cap_hz { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED })
        });
        let granted: Vec<u32> = fake.rates.iter().map(|(_, hz)| *hz as u32).collect();
        assert_eq!(granted, [rate_hz], "{loop_hz}");
    }
}

#[test]
fn an_unsupported_message_gives_way_to_the_next() {
    let mut fake = Fake::new(wanted(&[(105, 100), (27, 100)]));
    fake.run(20, |id, _| {
        Some(if id == 105 { MavResult::MAV_RESULT_UNSUPPORTED } else { MavResult::MAV_RESULT_ACCEPTED })
    });
    assert_eq!(fake.sent, vec![(105, 100.0), (27, 100.0)]);
}

#[test]
fn a_message_refused_at_every_rate_gives_way_without_noise() {
    let mut fake = Fake::new(wanted(&[(105, 100), (27, 100)]));
    fake.run(20, |id, _| {
        Some(if id == 105 { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED })
    });
    assert_eq!(fake.rates, vec![(27, 100.0)]);
    assert!(fake.told.is_empty(), "{:?}", fake.told);
}

#[test]
fn silence_leads_to_the_old_requests_after_three_tries() {
    let mut fake = Fake::new(wanted(&[(27, 50), (30, 10)]));
    fake.answers_queries = false;
    fake.run(7, |_, _| None);
    assert_eq!((fake.queries, fake.sent.len()), (2, 3));
    assert_eq!(fake.told[0], RateNotice::OldRequests);
    assert_eq!(fake.streams, vec![1, 10]);
}

#[test]
fn an_overwritten_rate_is_asked_for_again_ever_less_often() {
    let mut fake = Fake::new(wanted(&[(27, 100)]));
    fake.run(10, |_, _| Some(MavResult::MAV_RESULT_ACCEPTED));
    // Another station turns it down to 4 Hz, and the autopilot says yes to us without doing it.
    fake.rates = vec![(27, 4.0)];
    let keep_slow = |_: u32, _: f64| Some(MavResult::MAV_RESULT_IN_PROGRESS);
    let before = fake.sent.len();
    fake.run(300, keep_slow);
    let asked = fake.sent.len() - before;
    assert!((3..=60).contains(&asked), "{asked}");
    assert!(
        matches!(fake.told[..], [RateNotice::Slow { message_id: 27, rate_hz: 100, .. }]),
        "{:?}",
        fake.told
    );
}

#[test]
fn a_reboot_asks_for_everything_again() {
    let mut fake = Fake::new(wanted(&[(27, 100), (30, 10)]));
    fake.run(10, |_, _| Some(MavResult::MAV_RESULT_ACCEPTED));
    fake.rates.clear();
    fake.keeper.restart(fake.now_us);
    fake.run(10, |_, _| Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(fake.sent.len(), 4);
}

#[test]
fn what_comes_fast_enough_is_not_asked_for_and_never_slowed_down() {
    // PX4's onboard link sends ATTITUDE at 100 Hz and fixes as they come.
    let mut fake = Fake::of(Autopilot::Px4, needs(Autopilot::Px4, 100, None));
    fake.rates = vec![(30, 100.0), (24, 50.0)];
    fake.run(20, YES);
    assert_eq!(fake.sent.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [26]);
    assert_eq!(intervals(&fake.keeper.give_back()), [(26, 0.0)], "only what was changed is given back");
    // Nor does a refused request end below what came before.
    let mut plane = Fake::new(wanted(&[(27, 200)]));
    plane.rates = vec![(27, 50.0)];
    plane.run(20, |_, hz| {
        Some(if hz > 50.0 { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED })
    });
    assert!(plane.sent.iter().all(|(_, hz)| *hz > 50.0), "{:?}", plane.sent);
    assert_eq!(plane.told, [RateNotice::Refused { message_id: 27, rate_hz: 200, granted_hz: Some(50) }]);
}

#[test]
fn fast_messages_of_firmware_that_does_not_say_so_are_measured_first() {
    let mut fake = Fake::new(wanted(&[(27, 100), (30, 10)]));
    fake.answers_queries = false;
    fake.rates = vec![(27, 50.0), (30, 25.0)];
    fake.run(20, YES);
    assert_eq!(fake.sent, [(27, 100.0)]);
    assert_eq!(intervals(&fake.keeper.give_back()), [(27, 20_000.0)]);
}

#[test]
fn a_message_that_the_firmware_does_not_have_is_never_asked_for() {
    let mut fake = Fake::new(needs(Autopilot::Ardupilot, 100, None));
    fake.missing = vec![105];
    fake.run(10, YES);
    assert_eq!(fake.rates[0], (27, 100.0));
    let asked = fake.queries;
    fake.keeper.restart(fake.now_us);
    fake.run(200, YES);
    assert_eq!(fake.queries, asked + 3, "remembered over a reboot");
    // Firmware that cannot even say so is older than the message.
    let mut old = Fake::new(needs(Autopilot::Ardupilot, 100, None));
    (old.answers_queries, old.missing) = (false, vec![105]);
    old.run(10, YES);
    assert_eq!(old.rates[0], (27, 100.0));
    assert!(old.told.is_empty(), "{:?}", old.told);
}

#[test]
fn px4_is_asked_for_a_rate_that_gives_what_is_wanted() {
    let mut px4 = RateKeeper::new(1, Autopilot::Px4, wanted(&[(26, 200)]), 0);
    let asked = |keeper: &mut RateKeeper, interval_us| {
        let mut out = Vec::new();
        keeper.poll(0, &mut out);
        let message = MESSAGE_INTERVAL_DATA { message_id: 26, interval_us };
        keeper.receive(0, &Frame::encode(VEHICLE, 0, &MavMessage::MESSAGE_INTERVAL(message)), &mut out);
        out.clear();
        keeper.poll(0, &mut out);
        let sent = out.into_iter().filter_map(|a| match a {
            RateAction::Send(m) => Some(m),
            RateAction::Tell(_) => None,
        });
        intervals(&sent.collect::<Vec<_>>())
    };
    // A sample every 4 ms: with 5 ms every second one would be sent, with 2 ms each.
    assert_eq!(asked(&mut px4, 0), [(26, 2000.0)]);
    let mut slower = RateKeeper::new(1, Autopilot::Px4, wanted(&[(26, 100)]), 0);
    assert_eq!(asked(&mut slower, 0), [(26, 6000.0)]);
}

/// PX4 denies a stream of which it has nothing new at that moment; what arrives is there.
#[test]
fn a_denial_of_px4_proves_nothing_of_a_message_that_arrives() {
    let mut fake = Fake::of(Autopilot::Px4, wanted(&[(26, 50), (105, 50), (30, 10)]));
    fake.rates = vec![(26, 25.0), (30, 4.0)];
    fake.run(3, |_, _| Some(MavResult::MAV_RESULT_DENIED));
    assert!(fake.sent.iter().all(|(id, _)| *id != 105), "{:?}", fake.sent);
    // And it is asked for its rate again.
    fake.run(20, YES);
    assert!(
        fake.rates.contains(&(26, 50.0)) || fake.rates.iter().any(|(id, hz)| *id == 26 && *hz >= 50.0),
        "{:?}",
        fake.rates
    );
    assert!(fake.told.iter().all(|n| !matches!(n, RateNotice::Refused { .. })), "{:?}", fake.told);
}

#[test]
fn everything_that_was_changed_is_given_back() {
    let mut fake = Fake::new(wanted(&[(27, 100), (24, 10), (30, 10)]));
    fake.rates = vec![(27, 2.0), (30, 4.0)];
    fake.run(10, YES);
    assert_eq!(
        intervals(&fake.keeper.give_back()),
        [(27, 500_000.0), (24, -1.0), (30, 250_000.0)],
        "as before, and what was not sent is stopped"
    );
}

/// A simulated PX4 and the keeper on a perfect wire, with what is said to the user.
struct PerfectWire {
    autopilot: gaware_sitl::autopilot::Autopilot,
    keeper: RateKeeper,
    framer: crate::link::framer::Framer,
    told: Vec<RateNotice>,
}

impl PerfectWire {
    fn px4(faults: &[&str]) -> Self {
        use gaware_sitl::autopilot::{Autopilot as Simulated, AutopilotConfig, Flavour};
        let faults = faults.iter().map(|f| f.parse().unwrap()).collect();
        let config =
            AutopilotConfig { flavour: Flavour::Px4, loop_rate_hz: 250.0, faults, ..Default::default() };
        let scenario = gaware_sitl::scenario::scenario("multirotor").unwrap();
        Self {
            autopilot: Simulated::playing(config, &scenario),
            keeper: RateKeeper::new(1, Autopilot::Px4, needs(Autopilot::Px4, 200, None), 0),
            framer: crate::link::framer::Framer::new(),
            told: Vec::new(),
        }
    }

    /// Runs to this time; the messages that arrive in its last second, per id.
    fn run(&mut self, until_s: u32) -> impl Fn(u32) -> usize + use<> {
        let mut arrived = Vec::new();
        let from = (self.autopilot.now_s() * 100.0).round() as u32;
        for step in from..until_s * 100 {
            let (now_us, mut out) = (u64::from(step) * 10_000, Vec::new());
            self.autopilot.step(f64::from(step) * 0.01);
            for frame in self.autopilot.take_output() {
                self.framer.push(&frame.bytes);
            }
            while let Some(frame) = self.framer.next_frame() {
                arrived.extend((step + 100 >= until_s * 100).then_some(frame.message_id));
                self.keeper.receive(now_us, &frame, &mut out);
            }
            self.keeper.poll(now_us, &mut out);
            for action in out {
                match action {
                    RateAction::Send(m) => self.autopilot.receive(Frame::encode(STATION, 0, &m).raw()),
                    RateAction::Tell(notice) => self.told.push(notice),
                }
            }
        }
        move |id| arrived.iter().filter(|other| **other == id).count()
    }
}

const STATION: Sender = Sender { system_id: 1, component_id: 191 };

/// PX4's MAVLink instance is stopped and started: its defaults hold (`HIGHRES_IMU` at 50 Hz, no `SCALED_IMU`), and at first it denies what it
/// has not sent yet.
#[test]
fn after_a_restart_of_its_instance_px4_sends_the_preferred_samples_again() {
    for gap_s in [1, 3, 8, 30] {
        let mut wire = PerfectWire::px4(&[&format!("instance-restart@20-{}", 20 + gap_s)]);
        assert!(wire.run(20)(26) >= 140, "before");
        let hz = wire.run(20 + gap_s + 90);
        assert!(hz(26) >= 140, "away for {gap_s} s: SCALED_IMU at {} Hz, HIGHRES_IMU at {}", hz(26), hz(105));
        assert!(hz(105) <= 60, "what was asked for in its place is given back: {} Hz", hz(105));
        assert!(!wire.told.contains(&RateNotice::OldRequests), "PX4 knows no REQUEST_DATA_STREAM");
    }
}
