//! The keeper against made-up autopilots.

use super::*;
use crate::link::frame::Sender;
use mavlink::dialects::ardupilotmega::COMMAND_ACK_DATA;

const VEHICLE: Sender = Sender { system_id: 1, component_id: 1 };

/// An autopilot: what it answers to a request for a message and a rate, and what rates it then sends.
struct Fake {
    keeper: RateKeeper,
    now_us: u64,
    sent: Vec<(u32, f64)>,
    told: Vec<RateNotice>,
    streams: Vec<u8>,
    rates: Vec<(u32, f64)>,
}

impl Fake {
    fn new(wanted: Vec<Wanted>) -> Self {
        let keeper = RateKeeper::new(1, Autopilot::Ardupilot, wanted, 0);
        Self { keeper, now_us: 0, sent: vec![], told: vec![], streams: vec![], rates: vec![] }
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
            RateAction::Send(MavMessage::COMMAND_LONG(m)) => {
                assert_eq!((m.param3, m.param4, m.param5, m.param6), (0.0, 0.0, 0.0, 0.0));
                assert_eq!(m.param2 % 1000.0, 0.0, "ArduPilot wants whole milliseconds");
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
    fake.run(5, |_, _| None);
    assert_eq!(fake.sent.len(), 3);
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
