//! Which message inertial samples are taken from.
//!
//! Candidates are counted over seconds of message time. The best one by the autopilot's habits wins, provided that it
//! comes at half the rate of the fastest at least; a change of mind takes several seconds in a row, so that a stream
//! that stutters does not cost a restart of the filter.

use super::{ardupilot, px4};
use gaware_nav::sample::{ImuStream, Quantisation, SampleKind, Steps};
use gaware_wire::heartbeat::{ARDUPILOT, PX4};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Firmware of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Autopilot {
    /// ArduPilot.
    Ardupilot,
    /// PX4.
    Px4,
    /// Any other, or no heartbeat.
    #[default]
    Unknown,
}

impl Autopilot {
    /// By the number of a heartbeat.
    pub(super) fn of(number: u8) -> Self {
        match number {
            ARDUPILOT => Self::Ardupilot,
            PX4 => Self::Px4,
            _ => Self::Unknown,
        }
    }

    /// `ardupilot`, `px4` or `unknown`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ardupilot => "ardupilot",
            Self::Px4 => "px4",
            Self::Unknown => "unknown",
        }
    }

    /// Candidates, best first.
    fn preference(self) -> &'static [ImuSource] {
        match self {
            Self::Px4 => px4::PREFERENCE,
            Self::Ardupilot | Self::Unknown => ardupilot::PREFERENCE,
        }
    }

    /// What taking samples from this message means for the result; nothing for an unspoilt source.
    pub fn consequence(self, source: ImuSource) -> Option<&'static str> {
        match self {
            Self::Ardupilot => ardupilot::consequence(source),
            Self::Px4 => px4::consequence(source),
            Self::Unknown => Some("the firmware is unknown, units and truncation are taken as ArduPilot's"),
        }
    }
}

impl fmt::Display for Autopilot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A message with inertial samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum ImuSource {
    /// 105.
    HighresImu,
    /// 27.
    RawImu,
    /// 26.
    ScaledImu,
    /// 116.
    ScaledImu2,
    /// 129.
    ScaledImu3,
}

/// The name is of no message with inertial samples.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0} is no inertial message; choose HIGHRES_IMU, RAW_IMU, SCALED_IMU, SCALED_IMU2 or SCALED_IMU3")]
pub struct UnknownSource(String);

impl std::str::FromStr for ImuSource {
    type Err = UnknownSource;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        let wanted = s.to_ascii_uppercase();
        Self::ALL.into_iter().find(|m| m.name() == wanted).ok_or_else(|| UnknownSource(s.to_owned()))
    }
}

impl ImuSource {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::HighresImu, Self::RawImu, Self::ScaledImu, Self::ScaledImu2, Self::ScaledImu3];

    /// Name of the message.
    pub fn name(self) -> &'static str {
        match self {
            Self::HighresImu => "HIGHRES_IMU",
            Self::RawImu => "RAW_IMU",
            Self::ScaledImu => "SCALED_IMU",
            Self::ScaledImu2 => "SCALED_IMU2",
            Self::ScaledImu3 => "SCALED_IMU3",
        }
    }

    /// Id of the message.
    pub fn message_id(self) -> u32 {
        match self {
            Self::HighresImu => 105,
            Self::RawImu => 27,
            Self::ScaledImu => 26,
            Self::ScaledImu2 => 116,
            Self::ScaledImu3 => 129,
        }
    }

    /// What the engine learns about its samples.
    pub fn stream(self) -> ImuStream {
        let quantisation = match self {
            Self::HighresImu => Quantisation::None,
            _ => Quantisation::Truncate(Steps::RAW_IMU),
        };
        ImuStream { message: self.name().to_owned(), kind: SampleKind::Point, quantisation }
    }

    fn index(self) -> usize {
        Self::ALL.iter().position(|s| *s == self).unwrap_or(0)
    }
}

impl fmt::Display for ImuSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

const WINDOW_US: u64 = 1_000_000;
/// Stamps further from the window than this are another boot, or stand behind a gap.
const APART_US: u64 = 10 * WINDOW_US;
/// Windows in a row that must prefer another source before it takes over.
const PATIENCE: u32 = 3;

/// Result of a window that has just closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Another source from now on.
    pub change: Option<ImuSource>,
    /// Rate of the source in use over the window, Hz; nothing while none is.
    pub rate_hz: Option<f64>,
}

/// Chooses among the messages that arrive.
#[derive(Debug, Clone, Default)]
pub struct SourceChoice {
    forced: Option<ImuSource>,
    current: Option<ImuSource>,
    counts: [u32; 5],
    window_start_us: Option<u64>,
    rival: Option<(ImuSource, u32)>,
}

impl SourceChoice {
    /// Nothing chosen yet; a forced source is taken whatever else arrives.
    pub fn new(forced: Option<ImuSource>) -> Self {
        Self { forced, ..Self::default() }
    }

    /// The source in use.
    pub fn current(&self) -> Option<ImuSource> {
        self.current
    }

    /// Counts a message of a candidate; reports when a window of message time has closed.
    pub fn count(&mut self, source: ImuSource, t_us: u64, autopilot: Autopilot) -> Option<Window> {
        let start = *self.window_start_us.get_or_insert(t_us);
        // After a reboot or a gap the window has no meaning. Frames that a link has delayed by seconds are older than it, too.
        if t_us.abs_diff(start) > APART_US {
            self.window_start_us = Some(t_us);
            self.counts = [0; 5];
        }
        let closed = (t_us.saturating_sub(start) >= WINDOW_US && self.window_start_us == Some(start))
            .then(|| self.close(t_us, t_us.saturating_sub(start), autopilot));
        if let Some(n) = self.counts.get_mut(source.index()) {
            *n += 1;
        }
        closed
    }

    fn close(&mut self, t_us: u64, length_us: u64, autopilot: Autopilot) -> Window {
        let counts = std::mem::take(&mut self.counts);
        self.window_start_us = Some(t_us);
        let of = |s: ImuSource| counts.get(s.index()).copied().unwrap_or(0);
        let fastest = counts.iter().copied().max().unwrap_or(0);
        let usable = |s: &&ImuSource| of(**s) > 0 && 2 * of(**s) >= fastest;
        let best = match self.forced {
            Some(s) => (of(s) > 0).then_some(s),
            None => autopilot.preference().iter().find(usable).copied(),
        };
        let change = best.filter(|b| self.decide(*b));
        self.current = change.or(self.current);
        Window { change, rate_hz: self.current.map(|s| f64::from(of(s)) * 1e6 / length_us as f64) }
    }

    fn decide(&mut self, best: ImuSource) -> bool {
        if self.current == Some(best) {
            self.rival = None;
            return false;
        }
        let windows = match self.rival {
            Some((s, n)) if s == best => n + 1,
            _ => 1,
        };
        self.rival = Some((best, windows));
        self.current.is_none() || windows >= PATIENCE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ImuSource::{HighresImu, RawImu, ScaledImu};

    /// Feeds the sources at their rates from `from` for `seconds`; returns the changes with their second.
    fn fly(
        choice: &mut SourceChoice,
        autopilot: Autopilot,
        from: u64,
        seconds: u64,
        rates: &[(ImuSource, u64)],
    ) -> Vec<(u64, ImuSource)> {
        let mut changes = Vec::new();
        for ms in 0..seconds * 1000 {
            for (source, hz) in rates {
                if ms % (1000 / hz) == 0 {
                    let t_us = (from * 1000 + ms) * 1000;
                    let change = choice.count(*source, t_us, autopilot).and_then(|w| w.change);
                    changes.extend(change.map(|s| (t_us / 1_000_000 - from, s)));
                }
            }
        }
        changes
    }

    #[test]
    fn each_autopilot_has_its_preference() {
        let rates = [(HighresImu, 50), (RawImu, 50), (ScaledImu, 50)];
        for (autopilot, best) in [(Autopilot::Ardupilot, HighresImu), (Autopilot::Px4, ScaledImu)] {
            let mut choice = SourceChoice::new(None);
            assert_eq!(fly(&mut choice, autopilot, 5, 10, &rates), vec![(1, best)]);
        }
    }

    #[test]
    fn a_better_message_that_trickles_does_not_win() {
        let mut choice = SourceChoice::new(None);
        let changes = fly(&mut choice, Autopilot::Ardupilot, 0, 10, &[(HighresImu, 2), (RawImu, 200)]);
        assert_eq!(changes, vec![(1, RawImu)]);
    }

    #[test]
    fn the_source_changes_only_after_three_seconds_without_it() {
        let mut choice = SourceChoice::new(None);
        fly(&mut choice, Autopilot::Ardupilot, 0, 5, &[(RawImu, 50), (ScaledImu, 50)]);
        assert_eq!(choice.current(), Some(RawImu));
        let changes = fly(&mut choice, Autopilot::Ardupilot, 5, 10, &[(ScaledImu, 50)]);
        assert_eq!(changes.len(), 1);
        assert_eq!(changes[0].1, ScaledImu);
        assert!((3..=4).contains(&changes[0].0), "{changes:?}");
    }

    #[test]
    fn coarser_stamps_of_a_second_unit_do_not_make_it_the_source() {
        let mut choice = SourceChoice::new(None);
        let mut changes = Vec::new();
        for second in 1..20_u64 {
            let t_us = second * 1_000_000 + 700;
            for (source, t) in [(RawImu, t_us), (ImuSource::ScaledImu2, t_us / 1000 * 1000)] {
                changes.extend(choice.count(source, t, Autopilot::Ardupilot).and_then(|w| w.change));
            }
        }
        assert_eq!(changes, vec![RawImu]);
    }

    #[test]
    fn frames_that_come_late_do_not_make_another_source_of_the_same_unit_the_better_one() {
        let mut choice = SourceChoice::new(None);
        let mut changes = Vec::new();
        for n in 0..3000_u64 {
            // Every third frame has been on its way for up to two seconds.
            let late = if n % 3 == 0 { n % 20 * 100_000 } else { 0 };
            let t_us = (10_000_000 + n * 20_000).saturating_sub(late);
            let source = if n % 2 == 0 { ScaledImu } else { HighresImu };
            changes.extend(choice.count(source, t_us, Autopilot::Px4).and_then(|w| w.change));
        }
        assert_eq!(changes, vec![ScaledImu]);
    }

    #[test]
    fn the_users_word_counts() {
        let mut choice = SourceChoice::new(Some(ScaledImu));
        let changes = fly(&mut choice, Autopilot::Ardupilot, 0, 5, &[(HighresImu, 200), (ScaledImu, 10)]);
        assert_eq!(changes, vec![(1, ScaledImu)]);
    }
}
