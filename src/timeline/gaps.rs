//! Gaps in a stream of samples: what is longer than its usual interval, and how many samples that cost.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Spacings of which the usual one is the median.
const SPACINGS: usize = 32;
/// So many spacings determine the usual one.
const ENOUGH: usize = 8;
/// Before that, and at most, µs.
const GAP_AT_START_US: u64 = 1_000_000;
/// A gap is longer than this, µs …
const GAP_FROM_US: u64 = 100_000;
/// … and than so many usual intervals.
const GAP_INTERVALS: f64 = 3.5;
/// Where messages are missing by their running numbers, a sample is lost from so many intervals on.
const LOST_INTERVALS: f64 = 1.5;

/// What is missing of a stream.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Gaps {
    /// Gaps: pauses of more than 0.1 s and more than 3.5 usual intervals.
    pub count: u64,
    /// Their length in all, s.
    pub seconds: f64,
    /// The longest, s.
    pub longest_s: f64,
}

/// Measures the usual interval and counts what is missing.
#[derive(Debug, Clone, Default)]
pub struct GapMeter {
    spacings: Vec<u64>,
    next: usize,
    usual_us: Option<u64>,
    gaps: Gaps,
    lost: u64,
}

impl GapMeter {
    /// Whether samples so far apart have a gap between them.
    pub fn is_gap(&self, spacing_us: u64) -> bool {
        spacing_us > self.limit_us()
    }

    fn limit_us(&self) -> u64 {
        self.usual_us
            .map_or(GAP_AT_START_US, |usual| ((GAP_INTERVALS * usual as f64) as u64).max(GAP_FROM_US))
    }

    /// Takes the spacing of two samples in a row, µs, and how many messages are missing between them by their running numbers.
    pub fn push(&mut self, spacing_us: u64, missing: u64) {
        let gap = self.is_gap(spacing_us);
        if gap {
            self.pause(spacing_us);
        }
        if let Some(usual) = self.usual_us.filter(|u| *u > 0) {
            let intervals = spacing_us as f64 / usual as f64;
            if gap || (missing > 0 && intervals > LOST_INTERVALS) {
                let lost = (intervals.round() as u64).saturating_sub(1);
                self.lost += if gap { lost } else { lost.min(missing) };
            }
        }
        if !gap {
            self.learn(spacing_us);
        }
    }

    /// A pause across which samples are not expected to continue: a reboot, a logger that was switched off.
    pub fn pause(&mut self, spacing_us: u64) {
        let seconds = spacing_us as f64 * 1e-6;
        self.gaps.count += 1;
        self.gaps.seconds += seconds;
        self.gaps.longest_s = self.gaps.longest_s.max(seconds);
    }

    fn learn(&mut self, spacing_us: u64) {
        if self.spacings.len() < SPACINGS {
            self.spacings.push(spacing_us);
        } else if let Some(oldest) = self.spacings.get_mut(self.next) {
            *oldest = spacing_us;
        }
        self.next = (self.next + 1) % SPACINGS;
        if self.spacings.len() >= ENOUGH && self.next.is_multiple_of(ENOUGH) {
            let mut sorted = self.spacings.clone();
            sorted.sort_unstable();
            self.usual_us = sorted.get(sorted.len() / 2).copied();
        }
    }

    /// Another stream follows: its interval is not known yet.
    pub fn new_stream(&mut self) {
        self.spacings.clear();
        self.next = 0;
        self.usual_us = None;
    }

    /// The usual interval, s, once it is known.
    pub fn interval_s(&self) -> Option<f64> {
        self.usual_us.map(|us| us as f64 * 1e-6)
    }

    /// The gaps so far.
    pub fn gaps(&self) -> Gaps {
        self.gaps
    }

    /// Samples lost so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pause_is_a_gap_and_costs_its_samples() {
        let mut meter = GapMeter::default();
        (0..100).for_each(|_| meter.push(5_000, 0));
        meter.push(1_400_000, 0);
        (0..100).for_each(|_| meter.push(5_000, 0));
        meter.push(2_000_000, 7);
        let gaps = meter.gaps();
        assert_eq!((gaps.count, meter.lost()), (2, 279 + 399));
        assert!((gaps.seconds - 3.4).abs() < 1e-9 && (gaps.longest_s - 2.0).abs() < 1e-9, "{gaps:?}");
    }

    #[test]
    fn a_longer_interval_is_a_loss_only_where_messages_are_missing() {
        let mut meter = GapMeter::default();
        (0..100).for_each(|_| meter.push(5_000, 0));
        meter.push(10_000, 0);
        assert_eq!(meter.lost(), 0, "the scheduler left one out");
        meter.push(10_000, 1);
        assert_eq!((meter.lost(), meter.gaps().count), (1, 0));
    }

    #[test]
    fn slow_streams_have_no_gaps() {
        let mut meter = GapMeter::default();
        (0..100).for_each(|_| meter.push(500_000, 0));
        assert_eq!(meter.gaps().count, 0);
        assert_eq!(meter.interval_s(), Some(0.5));
    }
}
