//! One time base: the autopilot's boot time in microseconds, whatever a message counts in.
//!
//! Messages carry boot time in µs or ms (32 bits, which wrap after 49.7 days) or Unix time; which of them is told by
//! magnitude. The clock of the inertial samples is the master: it decides what a reboot or a jump is, and everything
//! else is put on it.

use gaware_nav::sample::RestartReason;

/// Stamps above this are Unix time (2001-09-09); no autopilot has been up for 31 years.
const UNIX_FROM_US: u64 = 1_000_000_000_000_000;
/// Stamps above this (the year 2128) are no time at all.
const SENSELESS_FROM_US: u64 = 5_000_000_000_000_000;
/// Stamps that go back no more than this are late or reordered, not a reboot.
const REORDER_US: i64 = 1_000_000;
/// After so long without a sample the motion state is worthless, whatever the reason.
const GAP_US: i64 = 10_000_000;
/// A Unix offset that moves by more than this is a clock that was set.
const OFFSET_STEP_US: i64 = 500_000;
const MS_WRAP_US: u64 = (1 << 32) * 1000;

/// A time stamp as a message carries it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// 64 bits of microseconds, since boot or since 1970.
    Usec(u64),
    /// 32 bits of milliseconds since boot.
    BootMs(u32),
}

/// What the clock says of an inertial sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The next sample.
    Accept,
    /// The same stamp again.
    Duplicate,
    /// Slightly older than the last one.
    Backward,
    /// Far from the last one; a reboot or a jump only if the next sample agrees.
    Unconfirmed,
    /// The next sample after a fresh start.
    Restart(RestartReason),
}

/// The clock of one vehicle.
#[derive(Debug, Clone, Default)]
pub struct VehicleClock {
    now_us: Option<u64>,
    suspect: Option<(RestartReason, u64)>,
    /// Unix time minus boot time, and whether the autopilot itself told it.
    unix_offset: Option<(i64, bool)>,
    last_boot_us: u64,
}

impl VehicleClock {
    /// Time of the latest inertial sample, µs.
    pub fn now_us(&self) -> Option<u64> {
        self.now_us
    }

    /// Takes the pair of times that `SYSTEM_TIME` carries.
    pub fn learn(&mut self, unix_us: u64, boot_ms: u32) {
        let boot = self.unwrap_ms(boot_ms);
        self.last_boot_us = boot;
        if !(UNIX_FROM_US..SENSELESS_FROM_US).contains(&unix_us) {
            return;
        }
        let offset = unix_us as i64 - boot as i64;
        match self.unix_offset {
            Some((old, true)) if (offset - old).abs() <= OFFSET_STEP_US => {}
            // An offset that inertial samples are anchored on must not move under them.
            Some((_, false)) if self.now_us.is_some() => {}
            _ => self.unix_offset = Some((offset, true)),
        }
    }

    /// An inertial stamp on the base; the first Unix one anchors the base where nothing told the boot time. Nothing for
    /// a stamp that is no time.
    pub fn place_imu(&mut self, stamp: Stamp) -> Option<u64> {
        match (self.place(stamp), stamp) {
            (None, Stamp::Usec(unix)) if unix < SENSELESS_FROM_US => {
                self.unix_offset = Some((unix as i64 - self.last_boot_us as i64, false));
                Some(self.last_boot_us)
            }
            (placed, _) => placed,
        }
    }

    /// Any stamp on the base, where that is possible.
    pub fn place(&self, stamp: Stamp) -> Option<u64> {
        match stamp {
            Stamp::Usec(t) if t < UNIX_FROM_US => Some(t),
            Stamp::Usec(t) if t >= SENSELESS_FROM_US => None,
            Stamp::Usec(t) => self.unix_offset.and_then(|(offset, _)| t.checked_add_signed(-offset)),
            Stamp::BootMs(ms) => Some(self.unwrap_ms(ms)),
        }
    }

    /// The stamp of a fix on the base, only if it is near the inertial samples. Unix time of a receiver that nobody
    /// related to boot time is anchored on its arrival: the constant error joins the GNSS latency.
    pub fn place_fix(&mut self, stamp: Stamp) -> Option<u64> {
        let now = self.now_us?;
        let near = |t: &u64| (*t as i64 - now as i64).abs() <= GAP_US;
        match (self.place(stamp).filter(near), stamp, self.unix_offset) {
            (Some(t), ..) => Some(t),
            (None, Stamp::Usec(unix), None | Some((_, false)))
                if (UNIX_FROM_US..SENSELESS_FROM_US).contains(&unix) =>
            {
                self.unix_offset = Some((unix as i64 - now as i64, false));
                Some(now)
            }
            _ => None,
        }
    }

    /// Judges the time of an inertial sample that [`Self::place_imu`] has put on the base.
    pub fn judge(&mut self, t_us: u64) -> Verdict {
        let Some(now) = self.now_us else {
            self.now_us = Some(t_us);
            return Verdict::Accept;
        };
        let reason = match t_us as i64 - now as i64 {
            0 => return Verdict::Duplicate,
            d if (-REORDER_US..0).contains(&d) => return Verdict::Backward,
            d if (1..=GAP_US).contains(&d) => {
                self.now_us = Some(t_us);
                self.suspect = None;
                return Verdict::Accept;
            }
            d if d < 0 => RestartReason::Reboot,
            _ => RestartReason::ClockJump,
        };
        let confirmed = matches!(self.suspect, Some((r, t)) if r == reason
            && (1..=GAP_US).contains(&(t_us as i64 - t as i64)));
        if !confirmed {
            self.suspect = Some((reason, t_us));
            return Verdict::Unconfirmed;
        }
        *self = Self { now_us: Some(t_us), last_boot_us: t_us, ..Self::default() };
        Verdict::Restart(reason)
    }

    /// 32-bit milliseconds as the instant nearest to what is known of the time.
    fn unwrap_ms(&self, ms: u32) -> u64 {
        let t = u64::from(ms) * 1000;
        let reference = self.now_us.unwrap_or(self.last_boot_us);
        let turns = (reference + MS_WRAP_US / 2).saturating_sub(t) / MS_WRAP_US;
        t + turns * MS_WRAP_US
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t_us: u64) -> VehicleClock {
        let mut clock = VehicleClock::default();
        assert_eq!(clock.judge(t_us), Verdict::Accept);
        clock
    }

    #[test]
    fn a_reboot_needs_a_second_witness() {
        let mut clock = at(100_000_000);
        assert_eq!(clock.judge(3_000_000), Verdict::Unconfirmed);
        assert_eq!(clock.judge(100_020_000), Verdict::Accept);
        assert_eq!(clock.judge(3_020_000), Verdict::Unconfirmed);
        assert_eq!(clock.judge(3_040_000), Verdict::Restart(RestartReason::Reboot));
        assert_eq!(clock.judge(3_060_000), Verdict::Accept);
    }

    #[test]
    fn a_jump_forward_restarts_too() {
        let mut clock = at(1_000_000);
        assert_eq!(clock.judge(50_000_000), Verdict::Unconfirmed);
        assert_eq!(clock.judge(50_020_000), Verdict::Restart(RestartReason::ClockJump));
    }

    #[test]
    fn late_and_repeated_samples_are_told_apart() {
        let mut clock = at(5_000_000);
        assert_eq!(clock.judge(5_000_000), Verdict::Duplicate);
        assert_eq!(clock.judge(4_995_000), Verdict::Backward);
        assert_eq!(clock.judge(5_005_000), Verdict::Accept);
    }

    #[test]
    fn milliseconds_wrap_without_a_restart() {
        let last = u32::MAX - 3;
        let mut clock = at(u64::from(last) * 1000);
        let t = clock.place_imu(Stamp::BootMs(16)).unwrap();
        assert_eq!(t, (u64::from(last) + 20) * 1000);
        assert_eq!(clock.judge(t), Verdict::Accept);
    }

    #[test]
    fn unix_time_of_a_receiver_lands_on_boot_time() {
        let mut clock = at(60_000_000);
        clock.learn(1_700_000_000_000_000, 60_000);
        assert_eq!(clock.place_fix(Stamp::Usec(1_700_000_000_100_000)), Some(60_100_000));
        let mut blind = at(60_000_000);
        assert_eq!(blind.place_fix(Stamp::Usec(1_700_000_000_100_000)), Some(60_000_000));
        assert_eq!(blind.place_fix(Stamp::Usec(1_700_000_000_300_000)), Some(60_200_000));
    }

    #[test]
    fn a_fix_from_before_a_reboot_is_not_placed() {
        assert_eq!(at(900_000_000).place_fix(Stamp::Usec(2_000_000)), None);
    }

    #[test]
    fn inertial_unix_time_becomes_boot_time() {
        let mut clock = VehicleClock::default();
        clock.learn(0, 5_000);
        assert_eq!(clock.place_imu(Stamp::Usec(1_700_000_000_000_000)), Some(5_000_000));
        assert_eq!(clock.place_imu(Stamp::Usec(1_700_000_000_020_000)), Some(5_020_000));
    }
}
