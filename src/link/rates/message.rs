//! One message whose rate is kept.

use super::{FIRST_PAUSE_US, LADDER, RateNotice, WINDOW_US, Wanted};
use crate::sensors::Autopilot;
use std::collections::VecDeque;

/// Where a message stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// To be asked for at this time.
    Due(u64),
    /// Agreed or taken for agreed at this time.
    Agreed(u64),
    /// Cannot be had, or not needed because another arrives.
    Off,
}

/// How a message came before anything was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Present {
    /// Not known yet.
    Unasked,
    /// Every so many µs, as the autopilot says.
    Interval(i32),
    /// It is not sent, as the autopilot says.
    Stopped,
    /// As fast as there is something to send; PX4 says the same of some messages that are not sent.
    Unlimited,
    /// The firmware does not have it.
    Missing,
    /// As measured, Hz.
    Measured(f64),
}

impl Present {
    /// From `MESSAGE_INTERVAL`: −1 is a message that is not sent, 0 one that cannot be (common.xml). PX4 answers with its stream's
    /// own number, 0 for one that does not run and −1 for one without a limit (`MavlinkReceiver::get_message_interval`).
    pub fn of(autopilot: Autopilot, interval_us: i32) -> Self {
        match (autopilot, interval_us) {
            (_, us) if us > 0 => Self::Interval(us),
            (Autopilot::Px4, 0) => Self::Stopped,
            (Autopilot::Px4, _) => Self::Unlimited,
            (_, 0) => Self::Missing,
            _ => Self::Stopped,
        }
    }
}

/// A message and what has become of it.
#[derive(Debug, Clone)]
pub(super) struct Message {
    pub wanted: Wanted,
    /// What is asked for now; lower than wanted after refusals.
    pub rate_hz: u16,
    pub state: State,
    pub present: Present,
    /// Whether it was asked for, so that it is to be given back.
    pub changed: bool,
    /// The firmware does not have it.
    pub missing: bool,
    /// Whether it has ever arrived.
    pub seen: bool,
    /// How often PX4 denied it in a row.
    pub denials: u32,
    pub pause_us: u64,
    pub reported_slow: bool,
    pub reported_refused: bool,
    pub arrivals: VecDeque<u64>,
}

impl Message {
    pub fn new(wanted: Wanted, state: State) -> Self {
        Self {
            rate_hz: wanted.rate_hz,
            wanted,
            state,
            present: Present::Unasked,
            changed: false,
            missing: false,
            seen: false,
            denials: 0,
            pause_us: FIRST_PAUSE_US,
            reported_slow: false,
            reported_refused: false,
            arrivals: VecDeque::new(),
        }
    }

    pub fn refused(&self, granted_hz: Option<u16>) -> RateNotice {
        RateNotice::Refused { message_id: self.wanted.message_id, rate_hz: self.wanted.rate_hz, granted_hz }
    }

    pub fn arrived(&mut self, now_us: u64) {
        self.seen = true;
        self.arrivals.push_back(now_us);
        self.forget(now_us);
    }

    pub fn forget(&mut self, now_us: u64) {
        while self.arrivals.front().is_some_and(|t| t + WINDOW_US < now_us) {
            self.arrivals.pop_front();
        }
    }

    /// Rate of arrival over the last seconds, Hz.
    pub fn measured_hz(&mut self, now_us: u64) -> f64 {
        self.forget(now_us);
        let span = self.arrivals.front().map_or(0, |t| now_us.saturating_sub(*t)).max(1_000_000);
        self.arrivals.len() as f64 * 1e6 / span as f64
    }

    /// Rate before anything was asked for, Hz; infinite without a limit, nothing where it is not known.
    pub fn present_hz(&self) -> Option<f64> {
        match self.present {
            Present::Unasked => None,
            Present::Interval(us) => Some(1e6 / f64::from(us)),
            Present::Stopped | Present::Missing => Some(0.0),
            Present::Unlimited => Some(f64::INFINITY),
            Present::Measured(hz) => Some(hz),
        }
    }

    /// What comes fast enough is not touched: no one gets less because of us.
    pub fn compare_with_present(&mut self, now_us: u64) {
        let least_hz = match self.present {
            // A measurement over a second counts one message more or less.
            Present::Measured(_) => 0.9 * f64::from(self.rate_hz),
            _ => f64::from(self.rate_hz),
        };
        let enough = self.present_hz().is_some_and(|hz| hz >= least_hz);
        self.state = if enough { State::Agreed(now_us) } else { State::Due(now_us) };
    }

    /// The next rate to try after a refusal, Hz; above the present one.
    pub fn next_lower(&self) -> Option<u16> {
        let present_hz = self.present_hz().unwrap_or(0.0);
        LADDER.into_iter().find(|hz| *hz < self.rate_hz && f64::from(*hz) > present_hz)
    }
}
