//! `TIMESYNC`: how far the autopilot's clock is from ours, and how slow the link is.
//!
//! Sans I/O; times are of a monotonic clock, ns. Slow round trips are dropped, because their delay is not symmetric.

use mavlink::dialects::ardupilotmega::{MavMessage, TIMESYNC_DATA};

/// While fewer exchanges than this have succeeded, one is tried every second.
const EAGER: u32 = 10;
const EAGER_PERIOD_NS: i64 = 1_000_000_000;
const CALM_PERIOD_NS: i64 = 10_000_000_000;
/// An offset that differs this much from the estimate is another clock: the autopilot rebooted.
const STEP_NS: i64 = 1_000_000_000;

/// The exchange with one autopilot.
#[derive(Debug, Clone, Default)]
pub struct Timesync {
    outstanding_ns: Option<i64>,
    next_ns: Option<i64>,
    accepted: u32,
    dropped: u32,
    offset_ns: Option<i64>,
    best_round_trip_ns: i64,
}

impl Timesync {
    /// Nothing known.
    pub fn new() -> Self {
        Self::default()
    }

    /// The request to send, when one is due.
    pub fn poll(&mut self, now_ns: i64) -> Option<MavMessage> {
        if self.next_ns.is_some_and(|t| now_ns < t) {
            return None;
        }
        let period_ns = if self.accepted < EAGER { EAGER_PERIOD_NS } else { CALM_PERIOD_NS };
        self.next_ns = Some(now_ns.saturating_add(period_ns));
        self.outstanding_ns = Some(now_ns);
        Some(message(0, now_ns))
    }

    /// Takes a `TIMESYNC` of the autopilot; gives the answer where it was a request.
    pub fn receive(&mut self, now_ns: i64, m: &TIMESYNC_DATA) -> Option<MavMessage> {
        if m.tc1 == 0 {
            return Some(message(now_ns, m.ts1));
        }
        if self.outstanding_ns == Some(m.ts1) {
            self.outstanding_ns = None;
            // Any 64-bit numbers may stand in the message.
            let sum = i128::from(m.ts1) + i128::from(now_ns) - 2 * i128::from(m.tc1);
            if let Ok(offset) = i64::try_from(sum / 2) {
                self.accept(now_ns.saturating_sub(m.ts1), offset);
            }
        }
        None
    }

    fn accept(&mut self, round_trip_ns: i64, offset_ns: i64) {
        match self.offset_ns {
            Some(old) if (i128::from(offset_ns) - i128::from(old)).abs() < i128::from(STEP_NS) => {
                if round_trip_ns > 2 * self.best_round_trip_ns + 1_000_000 {
                    self.dropped += 1;
                    // A link that has become slow for good must not keep an old offset for ever.
                    self.best_round_trip_ns += self.best_round_trip_ns / 8 + 100_000;
                    return;
                }
                self.best_round_trip_ns = self.best_round_trip_ns.min(round_trip_ns);
                self.offset_ns = Some(old + (offset_ns - old) / 8);
                self.accepted += 1;
            }
            _ => {
                self.offset_ns = Some(offset_ns);
                self.best_round_trip_ns = round_trip_ns;
                self.accepted = 1;
            }
        }
    }

    /// Forgets everything, as after a reboot of the autopilot.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Our clock minus the autopilot's, ns.
    pub fn offset_ns(&self) -> Option<i64> {
        self.offset_ns
    }

    /// Fastest round trip, ns.
    pub fn round_trip_ns(&self) -> Option<i64> {
        self.offset_ns.map(|_| self.best_round_trip_ns)
    }

    /// Exchanges dropped because they were slow.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}

fn message(tc1: i64, ts1: i64) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1, target_system: 0, target_component: 0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// An autopilot whose clock is 100 s behind ours, answering after the two delays.
    fn exchange(sync: &mut Timesync, now: i64, there: i64, back: i64) {
        let Some(MavMessage::TIMESYNC(request)) = sync.poll(now) else { panic!("no request") };
        let answer =
            TIMESYNC_DATA { tc1: now + there - 100_000 * MS, ts1: request.ts1, ..Default::default() };
        assert_eq!(sync.receive(now + there + back, &answer), None);
    }

    #[test]
    fn the_offset_is_found_and_slow_round_trips_do_not_move_it() {
        let mut sync = Timesync::new();
        exchange(&mut sync, 1_000_000 * MS, 2 * MS, 2 * MS);
        assert_eq!(sync.offset_ns(), Some(100_000 * MS));
        exchange(&mut sync, 1_002_000 * MS, 2 * MS, 90 * MS);
        assert_eq!(sync.offset_ns(), Some(100_000 * MS));
        assert_eq!(sync.dropped(), 1);
    }

    #[test]
    fn an_answer_to_somebody_else_is_ignored() {
        let mut sync = Timesync::new();
        sync.poll(5 * MS);
        sync.receive(9 * MS, &TIMESYNC_DATA { tc1: 77, ts1: 6 * MS, ..Default::default() });
        assert_eq!(sync.offset_ns(), None);
    }

    #[test]
    fn the_autopilots_own_request_is_answered() {
        let request = TIMESYNC_DATA { tc1: 0, ts1: 42, ..Default::default() };
        assert_eq!(Timesync::new().receive(7, &request), Some(message(7, 42)));
    }

    #[test]
    fn senseless_numbers_are_survived() {
        let mut sync = Timesync::new();
        sync.poll(i64::MAX - 1);
        sync.receive(i64::MAX, &TIMESYNC_DATA { tc1: i64::MIN, ts1: i64::MAX - 1, ..Default::default() });
        assert_eq!(sync.offset_ns(), None);
    }

    #[test]
    fn a_reboot_takes_the_new_offset_at_once() {
        let mut sync = Timesync::new();
        exchange(&mut sync, 1_000_000 * MS, 2 * MS, 2 * MS);
        let Some(MavMessage::TIMESYNC(request)) = sync.poll(1_010_000 * MS) else { panic!("no request") };
        let answer = TIMESYNC_DATA { tc1: 3_000 * MS, ts1: request.ts1, ..Default::default() };
        sync.receive(1_010_004 * MS, &answer);
        assert_eq!(sync.offset_ns(), Some((1_010_002 - 3_000) * MS));
    }
}
