//! What the autopilot's logger could not write in flight: estimates see a part of the flight only, and what is missing looks like an effect.

use super::{HealthLog, in_spans};

/// Where a larger share of a flight is missing, no value of it is used: ArduPilot flights of twelve minutes that lost 10 to 13 % were explained as those
/// that lost nothing, with 20 % a value was 3.5 sigma off, with 30 to 43 % the flight was not explained or by effects that are not there (docs/explain.md, "A log that lost entries").
pub const LOSSY: f64 = 0.15;

/// What to do about it.
pub const LOG_LESS: &str =
    "log less (LOG_BITMASK without raw IMU, SDLOG_PROFILE with fewer topics), or write to a faster card";

/// What was lost in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Losses {
    /// Share of the entries (ArduPilot counts them) or of the time (PX4 reports its pauses), 0 to 1.
    pub share: f64,
    /// When it began, s since the first inertial sample.
    pub from_s: f64,
    /// Pauses of the logger and the longest, s, where it reports these.
    pub pauses: Option<(usize, f64)>,
}

impl Losses {
    /// In a sentence without a full stop.
    pub fn words(&self) -> String {
        let percent = match 100.0 * self.share {
            p if p < 1.0 => format!("{p:.2} %"),
            p => format!("{p:.0} %"),
        };
        match self.pauses {
            Some((count, longest)) => format!(
                "the logger could not write for {percent} of the flight ({count} pauses, the longest {longest:.2} s, the first at {:.1} s)",
                self.from_s
            ),
            None => {
                format!(
                    "the logger lost {percent} of its entries in flight: more is logged than it can write"
                )
            }
        }
    }
}

impl HealthLog {
    /// Whether the logger says what it loses.
    pub fn tells_losses(&self) -> bool {
        !self.lost.is_empty() || !self.pauses.is_empty()
    }

    /// What the logger lost in flight; `None` where it lost nothing or does not say.
    ///
    /// What was lost before the first report is the start of the log: 58 logs of strangers lost up to 11 entries there and none later (2026-11-27).
    pub fn losses(&self) -> Option<Losses> {
        let flown = self.flown();
        let in_flight = |t: f64| in_spans(&flown, t);
        let grown = |a: f64, b: f64| if b > a { b - a } else { 0.0 };
        let steps = self.lost.windows(2).map(|w| {
            let (_, [lost_before, kept_before]) = w[0];
            let (t_us, [lost, kept]) = w[1];
            (self.s(t_us), grown(lost_before, lost), grown(kept_before, kept))
        });
        let steps: Vec<(f64, f64, f64)> = steps.filter(|(t, ..)| in_flight(*t)).collect();
        let (lost, kept) = steps.iter().fold((0.0, 0.0), |sum, (_, l, k)| (sum.0 + l, sum.1 + k));
        if let Some((from_s, ..)) = steps.iter().find(|(_, lost, _)| *lost > 0.0) {
            return Some(Losses { share: lost / (lost + kept), from_s: *from_s, pauses: None });
        }
        let pauses = self.pauses.iter().map(|(t, s)| (self.s(*t), *s));
        let pauses: Vec<(f64, f64)> = pauses.filter(|(t, s)| *s > 0.0 && in_flight(*t)).collect();
        let (from_s, _) = *pauses.first()?;
        let whole_s = match &flown {
            Some(spans) => spans.iter().map(|(a, b)| b - a).sum(),
            None => self.end_s(),
        };
        let seconds: f64 = pauses.iter().map(|p| p.1).sum();
        let longest = pauses.iter().map(|p| p.1).fold(0.0, f64::max);
        let share = (seconds / f64::max(whole_s, seconds)).min(1.0);
        Some(Losses { share, from_s, pauses: Some((pauses.len(), longest)) })
    }
}
