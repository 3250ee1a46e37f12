//! One axis of truncated samples: what the last second says of its mean and noise, and the values behind its counts.

use super::pair::Pair;
use crate::math::exp;
use std::f64::consts::TAU;

/// Smallest scatter assumed, steps. Below it the counts are constant and say nothing of where in a bin the mean lies.
const SCATTER_FLOOR: f64 = 0.25;
/// Scatter from which on the frequencies of the counts determine the mean, steps: at half a step the residual bias is
/// below 0.05 step.
const SCATTER_DITHERS: f64 = 0.5;
/// Scatter before the first samples have shown one, steps: every bin about flat.
const SCATTER_AT_START: f64 = 2.0;
/// Pull of the local mean toward the centre of the bin, and of the scatter toward its floor, so that they do not stay
/// where they were when the counts are constant.
const PULL: f64 = 0.02;
/// Slices of a bin in the numerical integral: half the smallest scatter in the dead zone.
const SLICES: u32 = 16;
/// Beyond so many sigma there is no noise.
const FAR: f64 = 4.0;
/// Where the mean of the centres follows that of the values less than this, it says too little.
const LEAST_SLOPE: f64 = 0.3;

/// Lower and upper limit of the values that truncation maps to this count, steps.
pub(super) fn bin(count: f64) -> (f64, f64) {
    if count > 0.0 {
        (count, count + 1.0)
    } else if count < 0.0 {
        (count - 1.0, count)
    } else {
        (-1.0, 1.0)
    }
}

/// Local mean and variance of one axis, steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Channel {
    mean: f64,
    variance: f64,
    pair: Pair,
}

impl Channel {
    /// Before anything but its first count is known.
    pub(super) fn starting(count: f64) -> Self {
        let (low, high) = bin(count);
        let variance = SCATTER_AT_START * SCATTER_AT_START;
        Self { mean: 0.5 * (low + high), variance, pair: Pair::starting(count) }
    }

    /// It moves: what its counts have shown of a mean that stays is over.
    pub(super) fn moves(&mut self) {
        self.pair.start_over();
    }

    /// By how much the values of a mean that stays are expected to lie from it, and the variance of that, steps and steps².
    pub(super) fn constant_error(&self) -> (f64, f64) {
        self.pair.constant_error(self.mean)
    }

    /// The value behind a count, the variance that rounding adds to it and the part of that which stays the same from sample to
    /// sample, steps and steps²; learns from it with weight `gain`.
    pub(super) fn update(&mut self, count: f64, gain: f64) -> (f64, f64, f64) {
        if !count.is_finite() {
            return (count, SCATTER_AT_START * SCATTER_AT_START, 0.0);
        }
        self.pair.take(count, gain);
        let (low, high) = bin(count);
        let (centre, flat) = (0.5 * (low + high), (high - low).powi(2) / 12.0);
        // Without dither the counts carry no mean: toward the centre of the bin and its flat variance.
        let dither =
            ((self.variance.sqrt() - SCATTER_FLOOR) / (SCATTER_DITHERS - SCATTER_FLOOR)).clamp(0.0, 1.0);
        if self.mean.abs() > 1.0 + FAR * self.variance.sqrt() {
            // The dead zone is out of reach: the centres are the values with an independent error.
            self.learn(centre, (centre - self.mean).powi(2) - flat, gain);
            return (centre, flat, (1.0 - dither) * flat);
        }
        let (w, wx, wxx) = moments(self.mean, self.variance, low, high);
        let expected = wx / w;
        let scatter = (wxx / w - expected * expected).max(0.0) + (expected - self.mean).powi(2);
        let (mut value, mut added) = (centre, flat);
        if dither > 0.0 {
            let zone = DeadZone::seen(self.mean, self.variance);
            let full = self.mean + zone.stretched(centre - self.mean + zone.shift);
            value += dither * (full - centre);
            added += dither * (zone.added - flat);
        }
        self.learn(centre + dither * (1.0 - PULL) * (expected - centre), scatter, gain);
        (value, added, (1.0 - dither) * flat)
    }

    fn learn(&mut self, value: f64, scatter: f64, gain: f64) {
        self.variance = (self.variance + gain * ((1.0 - PULL) * scatter - self.variance))
            .max(SCATTER_FLOOR * SCATTER_FLOOR);
        self.mean += gain * (value - self.mean);
    }
}

/// What the dead zone does to the centres of the counts of normally distributed values, steps.
///
/// Beside it the centres are the values with an error that noise makes as good as independent (Widrow & Kollár 2008, ch. 4);
/// in it the centre is half a step too low above zero and half a step too high below.
#[derive(Debug, Clone, Copy)]
struct DeadZone {
    /// Mean of the values less that of the centres.
    shift: f64,
    /// By how much the mean of the centres follows that of the values.
    slope: f64,
    /// 1-sigma of the centres.
    scatter: f64,
    /// Variance that values brought back have beyond the noise.
    added: f64,
}

impl DeadZone {
    /// From values with this mean and variance, steps and steps².
    fn seen(mean: f64, variance: f64) -> Self {
        // Simpson's rule on either side of zero.
        let mut at = [0.0; 9];
        let first = exp(-0.5 * (-1.0 - mean).powi(2) / variance) / (variance * TAU).sqrt();
        at.iter_mut().zip(weights(first, (-1.0, 0.25), mean, variance)).for_each(|(at, w)| *at = w);
        let share =
            |k: usize| (at[k] + 4.0 * at[k + 1] + 2.0 * at[k + 2] + 4.0 * at[k + 3] + at[k + 4]) / 12.0;
        let (below, above) = (share(0), share(4));
        let shift = 0.5 * (above - below);
        let slope = (1.0 - 0.5 * (2.0 * at[4] - at[0] - at[8])).max(LEAST_SLOPE);
        let centres = mean - shift;
        let spread =
            (mean * mean + variance + 1.0 / 12.0 - 0.25 * (below + above) - centres * centres).max(0.0);
        let added = (spread / (slope * slope) - variance).max(0.0);
        Self { shift, slope, scatter: spread.sqrt(), added }
    }

    /// How far a value is from the mean of the values whose centre is so far from the mean of the centres. What no noise of
    /// this scatter reaches has moved, and is not stretched.
    fn stretched(&self, off: f64) -> f64 {
        let reach = FAR * self.scatter + 1.0;
        off + off.clamp(-reach, reach) * (1.0 / self.slope - 1.0)
    }
}

/// Weights of a normal distribution at equally spaced points from `start` on, where the weight is `first`.
///
/// Neighbouring weights differ by a ratio that itself changes by a constant ratio: two exponentials for all points instead of
/// one for each.
fn weights(first: f64, (start, step): (f64, f64), mean: f64, variance: f64) -> impl Iterator<Item = f64> {
    let ratio = exp(-(step * (start - mean) + 0.5 * step * step) / variance);
    let change = exp(-step * step / variance);
    std::iter::successors(Some((first, ratio)), move |(w, ratio)| Some((w * ratio, ratio * change)))
        .map(|(weight, _)| weight)
}

/// Sums of 1, x and x² over the middles of the slices of a bin, weighted by a normal distribution up to a factor.
///
/// From the end that is nearer to the mean, whose weight is taken as 1: far from the mean no weight that matters underflows.
fn moments(mean: f64, variance: f64, low: f64, high: f64) -> (f64, f64, f64) {
    let width = (high - low) / f64::from(SLICES);
    let (start, step) =
        if mean < 0.5 * (low + high) { (low + 0.5 * width, width) } else { (high - 0.5 * width, -width) };
    let (mut w, mut wx, mut wxx) = (0.0, 0.0, 0.0);
    for (k, weight) in (0..SLICES).zip(weights(1.0, (start, step), mean, variance)) {
        let x = start + f64::from(k) * step;
        w += weight;
        wx += weight * x;
        wxx += weight * x * x;
    }
    (w, wx, wxx)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_moments_of_a_bin_are_those_of_the_normal_distribution_at_every_distance() {
        for variance in [0.0625_f64, 0.5, 4.0, 1e4] {
            for mean in [-1e6, -3.0, -0.9, 0.0, 0.4, 1.3, 2.0, 5.0] {
                for (low, high) in [(-1.0, 1.0), (1.0, 2.0), (-4.0, -3.0)] {
                    let (w, wx, wxx) = moments(mean, variance, low, high);
                    assert!(w >= 1.0 && w.is_finite() && wxx.is_finite(), "{mean} {variance}");
                    if mean < -10.0 {
                        continue;
                    }
                    let width = (high - low) / f64::from(SLICES);
                    let (mut e, mut ex) = (0.0, 0.0);
                    for k in 0..SLICES {
                        let x = low + (f64::from(k) + 0.5) * width;
                        let weight = exp(-0.5 * (x - mean).powi(2) / variance);
                        e += weight;
                        ex += weight * x;
                    }
                    if e > 1e-200 {
                        assert!((wx / w - ex / e).abs() < 1e-9, "{mean} {variance} {low}");
                    }
                }
            }
        }
    }
}
