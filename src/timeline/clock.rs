//! One time base: the autopilot's boot time in microseconds, whatever a message counts in.
//!
//! Messages carry boot time in µs (64 bits, from some firmware only the lower 32, which wrap after 71.6 min) or ms (32 bits,
//! which wrap after 49.7 days), or Unix time; which of them is decided by magnitude.

/// Stamps above this are Unix time (2001-09-09); no autopilot has been up for 31 years.
const UNIX_FROM_US: u64 = 1_000_000_000_000_000;
/// Stamps above this (the year 2128) are no time at all.
const SENSELESS_FROM_US: u64 = 5_000_000_000_000_000;
/// Stamps further apart than this do not belong together, µs; after so long without a sample the motion state is
/// worthless, whatever the reason.
pub const GAP_US: u64 = 10_000_000;
/// A Unix offset that moves by more than this is a clock that was set.
const OFFSET_STEP_US: i64 = 500_000;
const MS_WRAP_US: u64 = (1 << 32) * 1000;
const US_WRAP_US: u64 = 1 << 32;

/// A time stamp as a message carries it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// Microseconds, since boot or since 1970.
    Usec(u64),
    /// 32 bits of milliseconds since boot.
    BootMs(u32),
}

impl Stamp {
    /// From seconds of boot time; nothing for a value that is no time.
    pub fn from_seconds(t_s: f64) -> Option<Self> {
        let t_us = (t_s * 1e6).round();
        (t_us >= 0.0 && t_us < UNIX_FROM_US as f64).then_some(Self::Usec(t_us as u64))
    }

    /// Microseconds as the message counts them.
    pub fn raw_us(self) -> u64 {
        match self {
            Self::Usec(t) => t,
            Self::BootMs(t) => u64::from(t) * 1000,
        }
    }
}

/// Puts stamps on the time base. It is given inertial sample is the latest, and decides nothing about order.
#[derive(Debug, Clone, Default)]
pub struct Clock {
    now_us: Option<u64>,
    /// Unix time minus boot time, and whether the autopilot itself reported it.
    unix_offset: Option<(i64, bool)>,
    /// A Unix stamp of a fix that fits no offset, waiting for a second one.
    unix_suspect: Option<i64>,
    last_boot_us: u64,
    /// A stamp beyond 32 bits of microseconds was seen: small ones have not wrapped.
    wide: bool,
}

impl Clock {
    /// Time of the latest inertial sample, µs.
    pub fn now_us(&self) -> Option<u64> {
        self.now_us
    }

    /// Takes the time of the latest inertial sample.
    pub fn advance(&mut self, t_us: u64) {
        self.now_us = Some(t_us);
    }

    /// The time base starts anew at this inertial sample.
    pub fn restart(&mut self, t_us: u64) {
        *self = Self { now_us: Some(t_us), last_boot_us: t_us, ..Self::default() };
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

    /// An inertial stamp on the base; the first Unix one anchors the base where nothing gave the boot time. Nothing for
    /// a stamp that is no time.
    pub fn place_imu(&mut self, stamp: Stamp) -> Option<u64> {
        if let Stamp::Usec(t) = stamp {
            self.wide |= (US_WRAP_US..UNIX_FROM_US).contains(&t);
        }
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
            Stamp::Usec(t) if t < UNIX_FROM_US => Some(self.unwrap_us(t)),
            Stamp::Usec(t) if t >= SENSELESS_FROM_US => None,
            Stamp::Usec(t) => self.unix_offset.and_then(|(offset, _)| t.checked_add_signed(-offset)),
            Stamp::BootMs(ms) => Some(self.unwrap_ms(ms)),
        }
    }

    /// The stamp of a fix on the base, only if it is near the inertial samples. Unix time of a receiver that nothing
    /// relates to boot time is anchored on its arrival: the constant error joins the GNSS latency.
    pub fn place_fix(&mut self, stamp: Stamp, now: u64) -> Option<u64> {
        let near = |t: &u64| t.abs_diff(now) <= GAP_US;
        if let Some(t) = self.place(stamp).filter(near) {
            self.unix_suspect = None;
            return Some(t);
        }
        let Stamp::Usec(unix) = stamp else { return None };
        if !(UNIX_FROM_US..SENSELESS_FROM_US).contains(&unix) {
            return None;
        }
        let offset = unix as i64 - now as i64;
        let suspect = self.unix_suspect.replace(offset);
        // One stamp out of place must not move the base for all that follow.
        let confirmed = suspect.is_some_and(|s| s.abs_diff(offset) <= GAP_US);
        match self.unix_offset {
            None => {}
            Some((_, false)) if confirmed => {}
            _ => return None,
        }
        self.unix_offset = Some((offset, false));
        self.unix_suspect = None;
        Some(now)
    }

    /// 32-bit milliseconds as the instant nearest to what is known of the time.
    fn unwrap_ms(&self, ms: u32) -> u64 {
        let t = u64::from(ms) * 1000;
        nearest(t, MS_WRAP_US, self.now_us.unwrap_or(self.last_boot_us))
    }

    /// Microseconds; where they may be the lower 32 bits of a wrapped counter and then fit the latest sample, unwrapped.
    fn unwrap_us(&self, t: u64) -> u64 {
        let Some(now) = self.now_us.filter(|_| !self.wide && t < US_WRAP_US) else { return t };
        let unwrapped = nearest(t, US_WRAP_US, now);
        if unwrapped.abs_diff(now) <= GAP_US { unwrapped } else { t }
    }
}

/// `t` plus as many turns of a counter as bring it nearest to `reference`.
fn nearest(t: u64, turn: u64, reference: u64) -> u64 {
    t + (reference + turn / 2).saturating_sub(t) / turn * turn
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t_us: u64) -> Clock {
        let mut clock = Clock::default();
        clock.advance(t_us);
        clock
    }

    #[test]
    fn milliseconds_wrap_after_49_days() {
        let last = u32::MAX - 3;
        let mut clock = at(u64::from(last) * 1000);
        assert_eq!(clock.place_imu(Stamp::BootMs(16)), Some((u64::from(last) + 20) * 1000));
    }

    #[test]
    fn microseconds_of_32_bits_wrap_after_71_minutes_and_those_of_64_do_not() {
        let mut clock = at(US_WRAP_US - 3_000);
        assert_eq!(clock.place_imu(Stamp::Usec(2_000)), Some(US_WRAP_US + 2_000));
        clock.advance(US_WRAP_US + 2_000);
        assert_eq!(clock.place_imu(Stamp::Usec(7_000)), Some(US_WRAP_US + 7_000));
        assert_eq!(clock.place_imu(Stamp::BootMs(4_294_974)), Some(4_294_974_000), "milliseconds agree");
        // Seconds after a reboot far from a wrap are no wrap.
        assert_eq!(at(2_000_000_000).place_imu(Stamp::Usec(3_000_000)), Some(3_000_000));
        let mut wide = at(US_WRAP_US - 3_000);
        assert_eq!(wide.place_imu(Stamp::Usec(US_WRAP_US + 2_000)), Some(US_WRAP_US + 2_000));
        wide.advance(US_WRAP_US + 2_000);
        assert_eq!(wide.place_imu(Stamp::Usec(7_000)), Some(7_000), "a reboot");
    }

    #[test]
    fn unix_time_of_a_receiver_lands_on_boot_time() {
        let mut clock = at(60_000_000);
        clock.learn(1_700_000_000_000_000, 60_000);
        assert_eq!(clock.place_fix(Stamp::Usec(1_700_000_000_100_000), 60_000_000), Some(60_100_000));
        let mut blind = at(60_000_000);
        assert_eq!(blind.place_fix(Stamp::Usec(1_700_000_000_100_000), 60_000_000), Some(60_000_000));
        assert_eq!(blind.place_fix(Stamp::Usec(1_700_000_000_300_000), 60_000_000), Some(60_200_000));
    }

    #[test]
    fn one_unix_stamp_out_of_place_does_not_move_the_base() {
        let mut clock = at(60_000_000);
        let unix = 1_700_000_000_000_000;
        assert_eq!(clock.place_fix(Stamp::Usec(unix), 60_000_000), Some(60_000_000));
        assert_eq!(clock.place_fix(Stamp::Usec(unix + 900_000_000_000), 60_200_000), None);
        assert_eq!(clock.place_fix(Stamp::Usec(unix + 400_000), 60_400_000), Some(60_400_000));
        // A receiver whose clock was set: the second stamp confirms the first.
        assert_eq!(clock.place_fix(Stamp::Usec(unix + 900_000_000_000), 60_600_000), None);
        assert_eq!(clock.place_fix(Stamp::Usec(unix + 900_000_200_000), 60_800_000), Some(60_800_000));
    }

    #[test]
    fn a_fix_from_before_a_reboot_is_not_placed() {
        assert_eq!(at(900_000_000).place_fix(Stamp::Usec(2_000_000), 900_000_000), None);
    }

    #[test]
    fn inertial_unix_time_becomes_boot_time() {
        let mut clock = Clock::default();
        clock.learn(0, 5_000);
        assert_eq!(clock.place_imu(Stamp::Usec(1_700_000_000_000_000)), Some(5_000_000));
        assert_eq!(clock.place_imu(Stamp::Usec(1_700_000_000_020_000)), Some(5_020_000));
    }

    #[test]
    fn what_is_no_time_is_no_stamp() {
        for t in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
            assert_eq!(Stamp::from_seconds(t), None, "{t}");
        }
        assert_eq!(Stamp::from_seconds(1.5), Some(Stamp::Usec(1_500_000)));
        assert_eq!(Clock::default().place_imu(Stamp::Usec(u64::MAX)), None);
    }
}
