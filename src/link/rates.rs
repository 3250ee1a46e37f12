//! Keeps the message rates that the estimator needs: asks, measures what arrives, asks again, and tells the user when
//! the autopilot gives less.
//!
//! Sans I/O; `now_us` is any monotonic clock. `SET_MESSAGE_INTERVAL` first; where the autopilot does not know it, the
//! old `REQUEST_DATA_STREAM`. An acknowledgement names the command but not the message, so only one request is open
//! at a time. Rates that were given and vanish (another station overwrote them, a reboot) are asked for again, ever
//! less often.

use super::frame::Frame;
use crate::sensors::{AUTOPILOT_COMPONENT, Autopilot, ImuSource};
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};
#[expect(deprecated, reason = "for firmware that knows nothing newer")]
use mavlink::dialects::ardupilotmega::{MavDataStream, REQUEST_DATA_STREAM_DATA};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::fmt;

const ACK_PATIENCE_US: u64 = 1_000_000;
const TRIES: u32 = 3;
const WINDOW_US: u64 = 4_000_000;
const FIRST_PAUSE_US: u64 = 5_000_000;
const LONGEST_PAUSE_US: u64 = 60_000_000;
/// Share of the wanted rate that counts as kept.
const ENOUGH: f64 = 0.7;
/// What to try after a refusal, Hz (0.8 × loop rate: Plane 40, Copter 320).
const LADDER: [u16; 7] = [320, 200, 100, 50, 40, 25, 10];

/// A rate that is wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Message id.
    pub message_id: u32,
    /// Rate, Hz.
    pub rate_hz: u16,
    /// Whether the inertial messages after it in the list are only asked for when this one cannot be had.
    pub alternative: bool,
}

/// What the estimator needs from this autopilot, inertial messages in order of preference.
pub fn needs(autopilot: Autopilot, imu_hz: u16, forced: Option<ImuSource>) -> Vec<Wanted> {
    let sources = match (forced, autopilot) {
        (Some(source), _) => vec![source],
        (None, Autopilot::Px4) => vec![ImuSource::ScaledImu, ImuSource::HighresImu],
        (None, _) => vec![ImuSource::HighresImu, ImuSource::RawImu],
    };
    let imu =
        sources.iter().map(|s| Wanted { message_id: s.message_id(), rate_hz: imu_hz, alternative: true });
    let rest =
        [(24, 10), (30, 10)].map(|(message_id, rate_hz)| Wanted { message_id, rate_hz, alternative: false });
    imu.chain(rest).collect()
}

/// What the user is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "rate_notice")]
pub enum RateNotice {
    /// The autopilot refused the rate that is wanted.
    Refused {
        /// Message id.
        message_id: u32,
        /// Rate wanted, Hz.
        rate_hz: u16,
        /// Rate it gives instead, Hz; nothing where it does not send the message at all.
        granted_hz: Option<u16>,
    },
    /// A message arrives more slowly than was agreed.
    Slow {
        /// Message id.
        message_id: u32,
        /// Agreed, Hz.
        rate_hz: u16,
        /// Measured, Hz.
        measured_hz: f64,
    },
    /// No command is answered; the old way of asking is tried.
    OldRequests,
}

impl fmt::Display for RateNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused { message_id, rate_hz, granted_hz: Some(granted) } => write!(
                f,
                "the autopilot gives message {message_id} at {granted} Hz only, {rate_hz} Hz are wanted (its main loop is too slow: SCHED_LOOP_RATE)"
            ),
            Self::Refused { message_id, rate_hz, granted_hz: None } => {
                write!(f, "the autopilot refuses to send message {message_id} ({rate_hz} Hz are wanted)")
            }
            Self::Slow { message_id, rate_hz, measured_hz } => write!(
                f,
                "message {message_id} arrives at {measured_hz:.1} Hz instead of {rate_hz} Hz; the link is too slow, or another station has changed the rate; asking again"
            ),
            Self::OldRequests => f.write_str(
                "the autopilot does not answer SET_MESSAGE_INTERVAL; asking by REQUEST_DATA_STREAM, which other stations may overwrite",
            ),
        }
    }
}

/// What is to be done.
#[allow(clippy::large_enum_variant, reason = "a few of them a second, never stored")]
#[derive(Debug, Clone, PartialEq)]
pub enum RateAction {
    /// To the autopilot.
    Send(MavMessage),
    /// To the user.
    Tell(RateNotice),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// To be asked for at this time.
    Due(u64),
    /// Agreed or taken for agreed at this time.
    Agreed(u64),
    /// Cannot be had, or not needed because another arrives.
    Off,
}

#[derive(Debug, Clone)]
struct Message {
    wanted: Wanted,
    /// What is asked for now; lower than wanted after refusals.
    rate_hz: u16,
    state: State,
    pause_us: u64,
    told_slow: bool,
    told_refused: bool,
    arrivals: VecDeque<u64>,
}

impl Message {
    fn refused(&self, granted_hz: Option<u16>) -> RateNotice {
        RateNotice::Refused { message_id: self.wanted.message_id, rate_hz: self.wanted.rate_hz, granted_hz }
    }
}

#[derive(Debug, Clone, Copy)]
struct Open {
    index: usize,
    sent_us: u64,
    tries: u32,
}

/// The keeper of the rates of one vehicle.
#[derive(Debug, Clone)]
pub struct RateKeeper {
    system_id: u8,
    autopilot: Autopilot,
    messages: Vec<Message>,
    open: Option<Open>,
    old_way: bool,
}

impl RateKeeper {
    /// A keeper that starts to ask at once.
    pub fn new(system_id: u8, autopilot: Autopilot, wanted: Vec<Wanted>, now_us: u64) -> Self {
        let mut first = true;
        let messages = wanted
            .into_iter()
            .map(|wanted| {
                let state = if wanted.alternative && !std::mem::take(&mut first) {
                    State::Off
                } else {
                    State::Due(now_us)
                };
                Message {
                    rate_hz: wanted.rate_hz,
                    wanted,
                    state,
                    pause_us: FIRST_PAUSE_US,
                    told_slow: false,
                    told_refused: false,
                    arrivals: VecDeque::new(),
                }
            })
            .collect();
        Self { system_id, autopilot, messages, open: None, old_way: false }
    }

    /// Asks for everything again, as after a reboot, which forgets the rates.
    pub fn restart(&mut self, now_us: u64) {
        let wanted = self.messages.iter().map(|m| m.wanted.clone()).collect();
        *self = Self::new(self.system_id, self.autopilot, wanted, now_us);
    }

    /// Takes a frame that has arrived.
    pub fn receive(&mut self, now_us: u64, frame: &Frame, out: &mut Vec<RateAction>) {
        if (frame.system_id, frame.component_id) != (self.system_id, AUTOPILOT_COMPONENT) {
            return;
        }
        if let Some(m) = self.messages.iter_mut().find(|m| m.wanted.message_id == frame.message_id) {
            m.arrivals.push_back(now_us);
            while m.arrivals.front().is_some_and(|t| t + WINDOW_US < now_us) {
                m.arrivals.pop_front();
            }
        }
        if frame.message_id != 77 {
            return;
        }
        if let (Some(open), Ok(MavMessage::COMMAND_ACK(ack))) = (self.open, frame.decode())
            && ack.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
        {
            self.open = None;
            self.answered(open.index, ack.result, now_us, out);
        }
    }

    fn answered(&mut self, index: usize, result: MavResult, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        match result {
            MavResult::MAV_RESULT_ACCEPTED => {
                m.state = State::Agreed(now_us);
                if m.rate_hz < m.wanted.rate_hz {
                    out.push(RateAction::Tell(m.refused(Some(m.rate_hz))));
                }
            }
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED | MavResult::MAV_RESULT_IN_PROGRESS => {
                m.state = State::Due(now_us + m.pause_us);
            }
            MavResult::MAV_RESULT_UNSUPPORTED if !m.wanted.alternative => self.use_old_way(now_us, out),
            _ => {
                let lower = LADDER.into_iter().find(|hz| *hz < m.rate_hz);
                match lower {
                    // A refusal means "too fast" or "not this message", without saying which.
                    Some(hz) if result != MavResult::MAV_RESULT_UNSUPPORTED => {
                        m.rate_hz = hz;
                        m.state = State::Due(now_us);
                    }
                    _ => self.give_up(index, now_us, out),
                }
            }
        }
    }

    /// Turns to the next alternative, where there is one.
    fn give_up(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let next = self
            .messages
            .iter()
            .enumerate()
            .skip(index + 1)
            .find(|(_, m)| m.wanted.alternative)
            .map(|(k, _)| k);
        let alternative = self.messages.get(index).is_some_and(|m| m.wanted.alternative);
        let (of, state) = match next {
            Some(next) if alternative => (next, State::Due(now_us)),
            // The last resort is asked for again later: a firmware may still be starting.
            _ => (index, State::Due(now_us + LONGEST_PAUSE_US)),
        };
        if let Some(m) = self.messages.get_mut(index) {
            if of != index {
                m.state = State::Off;
            } else if !std::mem::replace(&mut m.told_refused, true) {
                out.push(RateAction::Tell(m.refused(None)));
            }
            m.rate_hz = m.wanted.rate_hz;
        }
        if let Some(m) = self.messages.get_mut(of) {
            m.state = state;
        }
    }

    fn use_old_way(&mut self, now_us: u64, out: &mut Vec<RateAction>) {
        if !std::mem::replace(&mut self.old_way, true) {
            out.push(RateAction::Tell(RateNotice::OldRequests));
        }
        self.open = None;
        for m in &mut self.messages {
            // Streams hold several messages, HIGHRES_IMU is in none of them.
            m.state = if m.wanted.message_id == 105 { State::Off } else { State::Due(now_us) };
        }
    }

    /// What is due now.
    pub fn poll(&mut self, now_us: u64, out: &mut Vec<RateAction>) {
        if let Some(open) = self.open {
            if now_us < open.sent_us + ACK_PATIENCE_US {
                return;
            }
            self.open = None;
            match self.messages.get_mut(open.index) {
                // Unanswered and yet arriving fast enough is as good as agreed.
                Some(m) if rate(&m.arrivals, now_us) >= ENOUGH * f64::from(m.rate_hz) => {
                    m.state = State::Agreed(now_us);
                }
                _ if open.tries >= TRIES => return self.use_old_way(now_us, out),
                _ => return self.ask(open.index, open.tries + 1, now_us, out),
            }
        }
        for index in 0..self.messages.len() {
            self.check(index, now_us, out);
        }
        let due = |m: &Message| matches!(m.state, State::Due(t) if t <= now_us);
        if self.old_way {
            for index in 0..self.messages.len() {
                if self.messages.get(index).is_some_and(due) {
                    self.ask_old_way(index, now_us, out);
                }
            }
        } else if let Some(index) = self.messages.iter().position(due) {
            self.ask(index, 1, now_us, out);
        }
    }

    fn check(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        let State::Agreed(since) = m.state else { return };
        if now_us < since + WINDOW_US {
            return;
        }
        while m.arrivals.front().is_some_and(|t| t + WINDOW_US < now_us) {
            m.arrivals.pop_front();
        }
        let measured_hz = rate(&m.arrivals, now_us);
        // A receiver gives fixes at its own pace, whatever was asked for.
        let enough = if m.wanted.message_id == 24 { 0.5 } else { ENOUGH * f64::from(m.rate_hz) };
        if measured_hz >= enough {
            m.told_slow = false;
            m.pause_us = FIRST_PAUSE_US;
            return;
        }
        if measured_hz == 0.0 && m.wanted.alternative && !self.old_way && !m.told_slow {
            // Accepted and never sent: the firmware knows the message but was built without it.
            m.told_slow = true;
            self.give_up(index, now_us, out);
            return;
        }
        if !std::mem::replace(&mut m.told_slow, true) {
            let message_id = m.wanted.message_id;
            out.push(RateAction::Tell(RateNotice::Slow { message_id, rate_hz: m.rate_hz, measured_hz }));
        }
        m.state = State::Due(now_us + m.pause_us);
        m.pause_us = (2 * m.pause_us).min(LONGEST_PAUSE_US);
    }

    fn ask(&mut self, index: usize, tries: u32, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get(index) else { return };
        // ArduPilot wants whole milliseconds and zeros in the parameters it does not use.
        let exact_us = 1e6 / f64::from(m.rate_hz.max(1));
        let interval_us = if self.autopilot == Autopilot::Px4 {
            exact_us.round()
        } else {
            (exact_us / 1e3).floor().max(1.0) * 1e3
        };
        out.push(RateAction::Send(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system: self.system_id,
            target_component: AUTOPILOT_COMPONENT,
            confirmation: tries.saturating_sub(1) as u8,
            param1: m.wanted.message_id as f32,
            param2: interval_us as f32,
            ..Default::default()
        })));
        self.open = Some(Open { index, sent_us: now_us, tries });
    }

    #[expect(deprecated, reason = "for firmware that knows nothing newer")]
    fn ask_old_way(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        let stream = match m.wanted.message_id {
            24 => MavDataStream::MAV_DATA_STREAM_EXTENDED_STATUS,
            30 => MavDataStream::MAV_DATA_STREAM_EXTRA1,
            _ => MavDataStream::MAV_DATA_STREAM_RAW_SENSORS,
        };
        out.push(RateAction::Send(MavMessage::REQUEST_DATA_STREAM(REQUEST_DATA_STREAM_DATA {
            target_system: self.system_id,
            target_component: AUTOPILOT_COMPONENT,
            req_stream_id: stream,
            req_message_rate: m.rate_hz,
            start_stop: 1,
        })));
        m.state = State::Agreed(now_us);
    }
}

fn rate(arrivals: &VecDeque<u64>, now_us: u64) -> f64 {
    let span = arrivals.front().map_or(0, |t| now_us.saturating_sub(*t)).max(1_000_000);
    arrivals.len() as f64 * 1e6 / span as f64
}

#[cfg(test)]
mod tests;
