//! Keeps the message rates that the estimator needs: reads what is set, asks where that is too slow, measures what
//! arrives, asks again, reports when the autopilot gives less, and gives the rates back at the end.
//!
//! Sans I/O; `now_us` is any monotonic clock. Before anything is changed `GET_MESSAGE_INTERVAL` reads the interval that is set:
//! a message that comes fast enough is not touched, one that this firmware does not have is never asked for (ArduPilot puts every
//! `SET_MESSAGE_INTERVAL` of one into the pilot's messages), and the rest can be put back. Then `SET_MESSAGE_INTERVAL`;
//! where the autopilot does not know it, the old `REQUEST_DATA_STREAM`. An acknowledgement names the command but not the
//! message, so only one request is open at a time. Rates that were given and vanish (another station overwrote them, a
//! reboot, a restart of the autopilot's link) are asked for again, ever less often; so is what was preferred to the
//! inertial message in use. Silence of a vehicle that is not received at all is no answer.

mod message;
mod notice;
mod request;

use super::frame::Frame;
use crate::sensors::{AUTOPILOT_COMPONENT, Autopilot, ImuSource};
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use message::{Message, Present, State};
pub use notice::RateNotice;
use request::{Target, is_inertial, to_give_back};

const ACK_PATIENCE_US: u64 = 1_000_000;
const TRIES: u32 = 3;
/// An interval that is not answered is asked for this often: the answer is no condition for what follows.
const QUERY_TRIES: u32 = 2;
const WINDOW_US: u64 = 4_000_000;
const FIRST_PAUSE_US: u64 = 5_000_000;
const LONGEST_PAUSE_US: u64 = 60_000_000;
/// PX4 says of a message without a limit as of one that was stopped that its interval is −1: whether it arrives decides.
const WATCH_US: u64 = 1_000_000;
/// Share of the wanted rate that counts as kept.
const ENOUGH: f64 = 0.7;
/// What to try after a refusal, Hz: ArduPilot's shortest interval is 1.25 of its loops, cut to whole milliseconds
/// (`GCS_MAVLINK::cap_message_interval`). Loops of 50 Hz grant 40, of 200 Hz 166, of 300 Hz 250, of 400 Hz 333.
const LADDER: [u16; 9] = [320, 250, 200, 166, 100, 50, 40, 25, 10];
/// `HIGHRES_IMU`: in no data stream, and unknown to firmware that cannot say which intervals are set.
const HIGHRES_IMU: u32 = 105;
const GPS_RAW_INT: u32 = 24;
/// Superseded by `REQUEST_MESSAGE`, which says less where there is no such message; every firmware in use knows it.
#[expect(deprecated, reason = "see above")]
const GET_MESSAGE_INTERVAL: MavCmd = MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL;
const COMMAND_ACK: u32 = 77;
const MESSAGE_INTERVAL: u32 = 244;

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
    let rest = [(GPS_RAW_INT, 10), (30, 10)].map(|(message_id, rate_hz)| Wanted {
        message_id,
        rate_hz,
        alternative: false,
    });
    imu.chain(rest).collect()
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

/// The request that is open.
#[derive(Debug, Clone, Copy)]
struct Open {
    index: usize,
    sent_us: u64,
    tries: u32,
    asks: Asks,
}

/// What a request is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asks {
    /// Which interval is set.
    Interval,
    /// The rate that is wanted.
    Rate,
    /// That a message come as it did before.
    Return,
}

/// The keeper of the rates of one vehicle.
#[derive(Debug, Clone)]
pub struct RateKeeper {
    target: Target,
    messages: Vec<Message>,
    open: Option<Open>,
    /// The firmware does not say which intervals are set.
    no_queries: bool,
    old_way: bool,
    /// When the vehicle was last received.
    heard_us: u64,
}

impl RateKeeper {
    /// A keeper that starts to ask at once.
    pub fn new(system_id: u8, autopilot: Autopilot, wanted: Vec<Wanted>, now_us: u64) -> Self {
        let mut first = true;
        let message = |wanted: Wanted| {
            let waits = wanted.alternative && !std::mem::take(&mut first);
            Message::new(wanted, if waits { State::Off } else { State::Due(now_us) })
        };
        let messages = wanted.into_iter().map(message).collect();
        let target = Target { system_id, autopilot };
        Self { target, messages, open: None, no_queries: false, old_way: false, heard_us: 0 }
    }

    /// Asks for everything again, as after a reboot, which forgets the rates. What the firmware does not have it has not got
    /// after a reboot either.
    pub fn restart(&mut self, now_us: u64) {
        let wanted = self.messages.iter().map(|m| m.wanted.clone()).collect();
        let missing: Vec<bool> = self.messages.iter().map(|m| m.missing).collect();
        let no_queries = self.no_queries;
        *self = Self::new(self.target.system_id, self.target.autopilot, wanted, now_us);
        self.no_queries = no_queries;
        for (index, missing) in missing.into_iter().enumerate() {
            if missing {
                self.has_not(index, now_us, &mut Vec::new());
            }
        }
    }

    /// Takes a frame that has arrived.
    pub fn receive(&mut self, now_us: u64, frame: &Frame, out: &mut Vec<RateAction>) {
        if (frame.system_id, frame.component_id) != (self.target.system_id, AUTOPILOT_COMPONENT) {
            return;
        }
        self.heard_us = now_us;
        if let Some(m) = self.messages.iter_mut().find(|m| m.wanted.message_id == frame.message_id) {
            m.arrived(now_us);
        }
        match frame.message_id {
            COMMAND_ACK => {
                if let (Some(open), Ok(MavMessage::COMMAND_ACK(ack))) = (self.open, frame.decode()) {
                    self.acknowledged(open, ack.command, ack.result, now_us, out);
                }
            }
            MESSAGE_INTERVAL => {
                if let Ok(MavMessage::MESSAGE_INTERVAL(m)) = frame.decode() {
                    self.interval(u32::from(m.message_id), m.interval_us, now_us, out);
                }
            }
            _ => {}
        }
    }

    fn acknowledged(
        &mut self,
        open: Open,
        command: MavCmd,
        result: MavResult,
        now_us: u64,
        out: &mut Vec<RateAction>,
    ) {
        match (open.asks, command) {
            (Asks::Return, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) => self.open = None,
            (Asks::Rate, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) => {
                self.open = None;
                self.answered(open.index, result, now_us, out);
            }
            // The answer itself is a message of its own; it may come before or after this.
            (Asks::Interval, GET_MESSAGE_INTERVAL) if result == MavResult::MAV_RESULT_UNSUPPORTED => {
                self.open = None;
                self.cannot_be_queried(now_us, out);
            }
            _ => {}
        }
    }

    /// The interval that is set for a message, µs.
    fn interval(&mut self, message_id: u32, interval_us: i32, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(open) = self.open.filter(|o| o.asks == Asks::Interval) else { return };
        let Some(m) = self.messages.get_mut(open.index) else { return };
        if m.wanted.message_id != message_id {
            return;
        }
        self.open = None;
        m.present = Present::of(self.target.autopilot, interval_us);
        match m.present {
            Present::Missing => self.has_not(open.index, now_us, out),
            Present::Unlimited if m.arrivals.is_empty() => m.state = State::Due(now_us + WATCH_US),
            _ => m.compare_with_present(now_us),
        }
    }

    /// The firmware answers no query: what arrives counts, and what only newer firmware has is left alone.
    fn cannot_be_queried(&mut self, now_us: u64, out: &mut Vec<RateAction>) {
        self.no_queries = true;
        if self.target.autopilot != Autopilot::Px4 {
            let modern = |m: &Message| m.wanted.message_id == HIGHRES_IMU && m.state != State::Off;
            if let Some(index) = self.messages.iter().position(modern) {
                self.has_not(index, now_us, out);
            }
        }
    }

    /// The firmware does not have this message.
    fn has_not(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let was_off = self.messages.get(index).is_none_or(|m| m.state == State::Off);
        if let Some(m) = self.messages.get_mut(index) {
            m.missing = true;
        }
        if !was_off {
            self.give_up(index, now_us, out);
        }
    }

    fn answered(&mut self, index: usize, result: MavResult, now_us: u64, out: &mut Vec<RateAction>) {
        let px4 = self.target.autopilot == Autopilot::Px4;
        let Some(m) = self.messages.get_mut(index) else { return };
        m.forget(now_us);
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
            // ArduPilot's refusal means "too fast".
            MavResult::MAV_RESULT_DENIED if !px4 => match m.next_lower() {
                Some(hz) => {
                    m.rate_hz = hz;
                    m.state = State::Due(now_us);
                }
                None => self.give_up(index, now_us, out),
            },
            // What arrives is there, whatever the answer.
            _ if px4 && !m.arrivals.is_empty() => m.state = State::Agreed(now_us),
            // PX4 says so of a stream with nothing new as well as of none.
            MavResult::MAV_RESULT_DENIED if m.denials < TRIES => {
                m.denials += 1;
                m.state = State::Due(now_us + WATCH_US);
            }
            MavResult::MAV_RESULT_DENIED => {
                m.denials = 0;
                self.give_up(index, now_us, out);
            }
            _ => {
                m.missing = true;
                self.give_up(index, now_us, out);
            }
        }
    }

    /// Turns to the next alternative, where there is one.
    fn give_up(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let px4 = self.target.autopilot == Autopilot::Px4;
        let usable = |(k, m): &(usize, &Message)| *k > index && m.wanted.alternative && !m.missing;
        let next = self.messages.iter().enumerate().find(usable).map(|(k, _)| k);
        let Some(m) = self.messages.get_mut(index) else { return };
        m.rate_hz = m.wanted.rate_hz;
        if let (true, Some(next)) = (m.wanted.alternative, next) {
            // What has come before may come again, and PX4 denies what it has not yet.
            m.state =
                if m.missing || !(px4 || m.seen) { State::Off } else { State::Due(now_us + m.pause_us) };
            m.pause_us = (2 * m.pause_us).min(LONGEST_PAUSE_US);
            if let Some(other) = self.messages.get_mut(next).filter(|m| m.state == State::Off) {
                other.state = State::Due(now_us);
            }
            return;
        }
        // The last resort is asked for again later, unless the firmware does not have it: it may still be starting.
        m.state = if m.missing { State::Off } else { State::Due(now_us + LONGEST_PAUSE_US) };
        if !std::mem::replace(&mut m.reported_refused, true) {
            let granted = m.present_hz().filter(|hz| *hz >= 1.0).map(|hz| hz.round() as u16);
            out.push(RateAction::Tell(m.refused(granted)));
        }
    }

    fn use_old_way(&mut self, now_us: u64, out: &mut Vec<RateAction>) {
        if !std::mem::replace(&mut self.old_way, true) {
            out.push(RateAction::Tell(RateNotice::OldRequests));
        }
        self.open = None;
        for m in &mut self.messages {
            m.state = if m.wanted.message_id == HIGHRES_IMU { State::Off } else { State::Due(now_us) };
        }
    }

    /// What is due now.
    pub fn poll(&mut self, now_us: u64, out: &mut Vec<RateAction>) {
        if let Some(open) = self.open {
            if now_us < open.sent_us + ACK_PATIENCE_US {
                return;
            }
            self.open = None;
            if !self.unanswered(open, now_us, out) {
                return;
            }
        }
        for index in 0..self.messages.len() {
            self.check(index, now_us, out);
            if self.open.is_some() {
                return;
            }
        }
        let due = |m: &Message| matches!(m.state, State::Due(t) if t <= now_us);
        if self.old_way {
            for index in 0..self.messages.len() {
                if self.messages.get(index).is_some_and(due) {
                    self.ask_old_way(index, now_us, out);
                }
            }
            return;
        }
        while let Some(index) = self.messages.iter().position(due) {
            if self.attend(index, now_us, out) {
                return;
            }
        }
    }

    /// No one has answered; true where the round goes on.
    fn unanswered(&mut self, open: Open, now_us: u64, out: &mut Vec<RateAction>) -> bool {
        let heard = u32::from(self.heard_us >= open.sent_us);
        match open.asks {
            Asks::Interval if open.tries + heard <= QUERY_TRIES => {
                self.query(open.index, open.tries + heard, now_us, out);
                return false;
            }
            Asks::Interval => {
                self.cannot_be_queried(now_us, out);
                return true;
            }
            Asks::Return => return true,
            Asks::Rate => {}
        }
        let Some(m) = self.messages.get_mut(open.index) else { return true };
        // Unanswered and yet arriving fast enough is as good as agreed.
        if m.measured_hz(now_us) >= ENOUGH * f64::from(m.rate_hz) {
            m.state = State::Agreed(now_us);
            return true;
        }
        if open.tries + heard <= TRIES {
            self.ask(open.index, open.tries + heard, now_us, out);
        } else if self.target.autopilot == Autopilot::Px4 {
            // It knows no other way.
            self.give_up(open.index, now_us, out);
        } else {
            self.use_old_way(now_us, out);
        }
        false
    }

    /// Takes the next step for a message that is due; true where a request is open then.
    fn attend(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) -> bool {
        let Some(m) = self.messages.get_mut(index) else { return true };
        match m.present {
            Present::Unasked if !self.no_queries => self.query(index, 1, now_us, out),
            Present::Unasked | Present::Unlimited => {
                m.present = Present::Measured(m.measured_hz(now_us));
                m.compare_with_present(now_us);
                return false;
            }
            _ => self.ask(index, 1, now_us, out),
        }
        true
    }

    fn check(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        let State::Agreed(since) = m.state else { return };
        if now_us < since + WINDOW_US {
            return;
        }
        let measured_hz = m.measured_hz(now_us);
        // A receiver gives fixes at its own pace, whatever was asked for.
        let enough = if m.wanted.message_id == GPS_RAW_INT { 0.5 } else { ENOUGH * f64::from(m.rate_hz) };
        if measured_hz >= enough {
            m.reported_slow = false;
            m.pause_us = FIRST_PAUSE_US;
            if m.wanted.alternative {
                self.release_after(index, now_us, out);
            }
            return;
        }
        if measured_hz == 0.0 && m.wanted.alternative && !self.old_way && !m.reported_slow {
            // Accepted and never sent: the firmware knows the message but was built without it.
            m.reported_slow = true;
            self.give_up(index, now_us, out);
            return;
        }
        if !std::mem::replace(&mut m.reported_slow, true) {
            let message_id = m.wanted.message_id;
            out.push(RateAction::Tell(RateNotice::Slow { message_id, rate_hz: m.rate_hz, measured_hz }));
        }
        m.state = State::Due(now_us + m.pause_us);
        m.pause_us = (2 * m.pause_us).min(LONGEST_PAUSE_US);
    }

    /// A preferred inertial message comes: what was asked for in its place comes as before from now on.
    fn release_after(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let (target, old_way) = (self.target, self.old_way);
        for (k, m) in self.messages.iter_mut().enumerate().skip(index + 1) {
            if !m.wanted.alternative || m.state == State::Off {
                continue;
            }
            m.state = State::Off;
            if std::mem::take(&mut m.changed) {
                out.push(RateAction::Send(to_give_back(&target, m, old_way)));
                self.open = Some(Open { index: k, sent_us: now_us, tries: 1, asks: Asks::Return });
                return;
            }
        }
    }

    fn query(&mut self, index: usize, tries: u32, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get(index) else { return };
        out.push(RateAction::Send(self.target.query(m.wanted.message_id, tries)));
        self.open = Some(Open { index, sent_us: now_us, tries, asks: Asks::Interval });
    }

    fn ask(&mut self, index: usize, tries: u32, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        m.changed = true;
        let (id, inertial) = (m.wanted.message_id, is_inertial(m.wanted.message_id));
        out.push(RateAction::Send(self.target.set_rate(id, m.rate_hz, inertial, tries)));
        self.open = Some(Open { index, sent_us: now_us, tries, asks: Asks::Rate });
    }

    fn ask_old_way(&mut self, index: usize, now_us: u64, out: &mut Vec<RateAction>) {
        let Some(m) = self.messages.get_mut(index) else { return };
        if !m.changed {
            m.present = Present::Measured(m.measured_hz(now_us));
            m.changed = true;
        }
        m.state = State::Agreed(now_us);
        // A stream is asked for no more slowly than it comes.
        let rate_hz = m.present_hz().map_or(m.rate_hz, |hz| m.rate_hz.max(hz.round() as u16));
        out.push(RateAction::Send(self.target.stream(m.wanted.message_id, rate_hz)));
    }

    /// The rate that is asked for, Hz; 0 where this message was not asked for.
    pub fn asked_hz(&self, message_id: u32) -> f64 {
        let asked = self.messages.iter().find(|m| m.wanted.message_id == message_id && m.changed);
        asked.map_or(0.0, |m| f64::from(m.rate_hz))
    }

    /// Puts every rate that was changed back to what it was; to be sent one at a time.
    pub fn give_back(&self) -> Vec<MavMessage> {
        let changed = self.messages.iter().filter(|m| m.changed);
        changed.map(|m| to_give_back(&self.target, m, self.old_way)).collect()
    }
}

#[cfg(test)]
mod tests;
