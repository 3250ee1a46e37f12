//! What counts leave unknown of a mean that stays: the count that comes alone, or the two that take turns.
//!
//! Of normally distributed values a share p above an edge says that their mean lies σ Φ⁻¹(p) from it (the maximum of the likelihood of grouped samples,
//! Gjeddebaek 1949, "Contribution to the study of grouped observations"; Widrow & Kollár 2008, ch. 4, for why little noise is no dither), as far as σ is
//! known. Two counts alone do not show σ: noise of a tenth of a step makes the same shares as half a step nearer to the edge. Then the mean lies anywhere between
//! the edge (no noise) and where the values behind the counts put it (as much noise as two counts allow). A third count shows σ.

use super::channel::bin;

/// What was seen is remembered for so many memories of the samples: while a vehicle stands on one side.
const REMEMBERED: f64 = 30.0;
/// Two counts that have taken turns so often, by noise and not by a motion through the edge, show it: from none to surely.
const SHOWN: (f64, f64) = (2.0, 6.0);
/// What each third count adds to what is known of σ: it lies evenly between none and what the scatter says, which is a variance of 1/3; the number of
/// samples beyond z = 3 goes with the ninth power of it (d ln Φ(−z)/d ln σ ≈ z²), which is an information of 81.
const BY_A_THIRD: f64 = 81.0 / 3.0;

/// The counts of one axis at rest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    /// The lower and the upper one; equal where there is one alone.
    counts: [f64; 2],
    last: f64,
    /// For how long neither has come, in memories; how often they took turns, and how often a third came between them.
    absent: f64,
    turns: f64,
    thirds: f64,
}

impl Pair {
    pub(super) fn starting(count: f64) -> Self {
        Self { counts: [count; 2], last: count, absent: 0.0, turns: 0.0, thirds: 0.0 }
    }

    /// Forgets what was seen before the last count.
    pub(super) fn start_over(&mut self) {
        *self = Self::starting(self.last);
    }

    /// Takes a count that has this weight in the memory.
    pub(super) fn take(&mut self, count: f64, gain: f64) {
        let kept = 1.0 - gain / REMEMBERED;
        (self.turns, self.thirds) = (self.turns * kept, self.thirds * kept);
        let [low, high] = self.counts;
        if self.counts.contains(&count) {
            self.thirds += f64::from(u8::from(self.absent > 0.0));
            self.turns += f64::from(u8::from(count != self.last));
            self.absent = 0.0;
        } else if low == high && (count - low).abs() <= 1.0 {
            *self = Self { counts: [low.min(count), low.max(count)], turns: 1.0, ..Self::starting(count) };
        } else {
            self.absent += gain;
        }
        self.last = count;
        // It has moved on.
        if self.absent > 1.0 || (low < high && self.turns < 1.0 / REMEMBERED) {
            *self = Self::starting(count);
        }
    }

    /// By how much values behind the counts that have this mean are expected to lie from the mean, and the variance of that, steps and steps².
    pub(super) fn constant_error(&self, mean: f64) -> (f64, f64) {
        let [below, above] = self.counts.map(bin);
        let unknown = 1.0 / (1.0 + BY_A_THIRD * self.thirds);
        if self.counts[0] == self.counts[1] {
            return (0.0, unknown * (above.1 - above.0).powi(2) / 12.0);
        }
        let centre = |(low, high): (f64, f64)| 0.5 * (low + high);
        let off = mean.clamp(centre(below), centre(above)) - above.0;
        let shown = ((self.turns - SHOWN.0) / (SHOWN.1 - SHOWN.0)).clamp(0.0, 1.0);
        // An even distribution between edge and mean, as far as the edge is shown, or about the mean.
        let variance = shown / 12.0 + (1.0 - shown) / 3.0 + shown * (1.0 - shown) / 4.0;
        (unknown * shown * 0.5 * off, unknown * off * off * variance)
    }
}
