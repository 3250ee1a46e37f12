//! Integer samples: what rounding and truncation do to a value, and the best guess of the value behind a count.
//!
//! Rounding acts like white noise of 1/√12 step once the sensor noise exceeds half a step (Widrow & Kollár 2008,
//! ch. 4). Truncation toward zero does not: away from zero it shifts every value by half a step toward zero, and
//! around zero it has a dead zone two steps wide.

use crate::sample::{ImuSample, Quantisation, Steps};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Time over which [`Dequantiser`] learns the local mean and scatter, s. Long against the correlation of filtered
/// sensor noise, short against a maneuver.
const MEMORY_S: f64 = 1.0;
/// At slow rates the memory is this many samples instead: fewer would not determine a mean within a step.
const MEMORY_SAMPLES: f64 = 32.0;
/// Smallest scatter assumed, steps. Below it the counts are constant and say nothing of where in a bin the mean lies.
const SCATTER_FLOOR: f64 = 0.25;
/// Scatter from which on the frequencies of the counts determine the mean, steps: at half a step the residual bias is
/// below 0.05 step.
const SCATTER_DITHERS: f64 = 0.5;
/// Scatter before the first samples have shown one, steps: every bin about flat.
const SCATTER_AT_START: f64 = 2.0;
/// How long the error of a count that nothing dithers stays the same, s: what it takes a vehicle that stands or rolls
/// along to change its rate by a step.
const PERSISTENCE_S: f64 = 2.0;
/// 1-sigma of the constant error that is left where noise dithers the counts, steps (measured, see [`Dequantiser`]).
const DITHERED_ERROR: f64 = 0.02;
/// Pull of the local mean toward the centre of the bin, and of the scatter toward its floor, so that they do not stay
/// where they were when the counts are constant.
const PULL: f64 = 0.02;
/// Slices of a bin in the numerical integral: half the smallest scatter in the dead zone.
const SLICES: u32 = 16;
/// Beyond so many sigma there is no noise.
const FAR: f64 = 4.0;
/// Where the mean of the centres follows that of the values less than this, it says too little.
const LEAST_SLOPE: f64 = 0.3;

impl Quantisation {
    /// What the source makes of a real sample.
    pub fn apply(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let with = |steps: &Steps, f: fn(f64) -> f64| {
            (gyro.map(|v| f(v / steps.gyro) * steps.gyro), accel.map(|v| f(v / steps.accel) * steps.accel))
        };
        match self {
            Self::None => (*gyro, *accel),
            Self::Round(steps) => with(steps, f64::round),
            Self::Truncate(steps) => with(steps, f64::trunc),
        }
    }

    /// The sample with each count replaced by the centre of the values that lead to it.
    pub fn undo(&self, sample: &ImuSample) -> ImuSample {
        match self {
            Self::None | Self::Round(_) => *sample,
            Self::Truncate(steps) => ImuSample {
                gyro: sample.gyro.map(|v| centre(v, steps.gyro)),
                accel: sample.accel.map(|v| centre(v, steps.accel)),
                ..*sample
            },
        }
    }

    /// Variances that the rounding adds to each gyro and accelerometer value, (rad/s)² and (m/s²)².
    pub fn variance(&self) -> (f64, f64) {
        match self {
            Self::None => (0.0, 0.0),
            Self::Round(s) | Self::Truncate(s) => (s.gyro * s.gyro / 12.0, s.accel * s.accel / 12.0),
        }
    }
}

/// Centre of the values that truncation maps to the count nearest to `value`.
fn centre(value: f64, step: f64) -> f64 {
    let count = (value / step).round();
    if count == 0.0 { 0.0 } else { value + 0.5 * step * count.signum() }
}

/// Lower and upper limit of the values that truncation maps to this count, steps.
fn bin(count: f64) -> (f64, f64) {
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
struct Channel {
    mean: f64,
    variance: f64,
}

impl Channel {
    /// The value behind a count, the variance that rounding adds to it and the part of that which stays the same from sample to
    /// sample, steps and steps²; learns from it with weight `gain`.
    fn update(&mut self, count: f64, gain: f64) -> (f64, f64, f64) {
        if !count.is_finite() {
            return (count, SCATTER_AT_START * SCATTER_AT_START, 0.0);
        }
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
        const STEP: f64 = 0.25;
        // As in `moments`; Simpson's rule on either side of zero.
        let mut weight = (-0.5 * (-1.0 - mean).powi(2) / variance).exp() / (variance * TAU).sqrt();
        let mut ratio = ((STEP * (1.0 + mean) - 0.5 * STEP * STEP) / variance).exp();
        let change = (-STEP * STEP / variance).exp();
        let at: [f64; 9] = std::array::from_fn(|_| {
            let density = weight;
            weight *= ratio;
            ratio *= change;
            density
        });
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

/// Sums of 1, x and x² over the middles of the slices of a bin, weighted by a normal distribution up to a factor.
///
/// Neighbouring weights of equally spaced points differ by a ratio that itself changes by a constant ratio: two exponentials a
/// bin instead of one a slice. From the end that is nearer to the mean, whose weight is taken as 1: far from the mean no weight
/// that matters underflows.
fn moments(mean: f64, variance: f64, low: f64, high: f64) -> (f64, f64, f64) {
    let width = (high - low) / f64::from(SLICES);
    let (start, step) =
        if mean < 0.5 * (low + high) { (low + 0.5 * width, width) } else { (high - 0.5 * width, -width) };
    let (mut ratio, change) =
        ((-(step * (start - mean) + 0.5 * step * step) / variance).exp(), (-step * step / variance).exp());
    let (mut weight, mut w, mut wx, mut wxx) = (1.0, 0.0, 0.0, 0.0);
    for k in 0..SLICES {
        let x = start + f64::from(k) * step;
        w += weight;
        wx += weight * x;
        wxx += weight * x * x;
        weight *= ratio;
        ratio *= change;
    }
    (w, wx, wxx)
}

/// Gives truncated samples back their values, using what the last second says of mean and noise.
///
/// Where the sensor noise is about a step, truncation masks a mean rate inside the dead zone, but the *frequencies* of the
/// counts still determine it. Each axis carries a local mean and variance, found by expectation maximisation over a
/// fading memory (Dempster, Laird & Rubin 1977, interval-censored normal samples). Each count is replaced by the centre of
/// its bin and, as far as the noise reaches the dead zone, by the value whose centres would have that mean: right in the
/// mean for a motion within the noise, however fast. (The mean of the normal distribution inside the bin is not: it draws
/// such motion toward the local mean, at a noise of 1.2 steps by 6 % and in the dead zone by 15 %.) Where the
/// noise is too small to dither the counts they determine no mean, and this is [`Quantisation::undo`]. Deterministic: equal
/// samples give equal results.
///
/// Largest bias for constant rates from -3 to 3 steps and white noise, in steps: centre of the bin 0.29, 0.19, 0.11,
/// 0.03 and this 0.04, 0.01, 0.01, 0.01 for a noise of 0.5, 0.7, 1 and 2 steps. At 0.1 step neither helps (0.7).
#[derive(Debug, Clone)]
pub struct Dequantiser {
    quantisation: Quantisation,
    channels: Option<[Channel; 6]>,
    last_t_s: f64,
    variance: [Vector3<f64>; 2],
    persistent: [Vector3<f64>; 2],
}

impl Dequantiser {
    /// For a source that turns values into integers this way.
    pub fn new(quantisation: Quantisation) -> Self {
        let (gyro, accel) = quantisation.variance();
        let variance = [Vector3::repeat(gyro), Vector3::repeat(accel)];
        Self {
            quantisation,
            channels: None,
            last_t_s: f64::NEG_INFINITY,
            variance,
            persistent: [Vector3::zeros(); 2],
        }
    }

    /// The rounding it undoes.
    pub fn quantisation(&self) -> Quantisation {
        self.quantisation
    }

    /// The sample with each count replaced by the expected value behind it.
    pub fn undo(&mut self, sample: &ImuSample) -> ImuSample {
        let Quantisation::Truncate(steps) = self.quantisation else { return *sample };
        let dt = sample.t_s - self.last_t_s;
        self.last_t_s = sample.t_s;
        let gain = if dt.is_finite() && dt > 0.0 { (dt / MEMORY_S).min(1.0 / MEMORY_SAMPLES) } else { 0.0 };
        let counts = |v: &Vector3<f64>, step: f64| v.map(|x| (x / step).round());
        let (gyro, accel) = (counts(&sample.gyro, steps.gyro), counts(&sample.accel, steps.accel));
        let at_start = |count: f64| {
            let (low, high) = bin(count);
            Channel { mean: 0.5 * (low + high), variance: SCATTER_AT_START * SCATTER_AT_START }
        };
        let channels = self
            .channels
            .get_or_insert_with(|| [gyro.x, gyro.y, gyro.z, accel.x, accel.y, accel.z].map(at_start));
        let mut back = *sample;
        let (gyro_channels, accel_channels) = channels.split_at_mut(3);
        for k in 0..3 {
            let (value, variance, persistent) = gyro_channels[k].update(gyro[k], gain);
            back.gyro[k] = value * steps.gyro;
            self.variance[0][k] = variance * steps.gyro * steps.gyro;
            self.persistent[0][k] = persistent * steps.gyro * steps.gyro;
            let (value, variance, persistent) = accel_channels[k].update(accel[k], gain);
            back.accel[k] = value * steps.accel;
            self.variance[1][k] = variance * steps.accel * steps.accel;
            self.persistent[1][k] = persistent * steps.accel * steps.accel;
        }
        back
    }

    /// Variances that the rounding adds to the sample undone last, (rad/s)² and (m/s²)², per axis.
    pub fn variance(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.variance[0], self.variance[1])
    }

    /// Variances of the part of the error that stays the same from sample to sample, (rad/s)² and (m/s²)², per axis: what
    /// no mean over a vehicle at rest takes away.
    pub fn constant_error(&self) -> [Vector3<f64>; 2] {
        let Quantisation::Truncate(steps) = self.quantisation else { return [Vector3::zeros(); 2] };
        let left = [steps.gyro, steps.accel].map(|s| (DITHERED_ERROR * s).powi(2));
        [0, 1].map(|k| self.persistent[k].add_scalar(left[k]))
    }

    /// What the rounding of the sample undone last adds to the variance per hertz of samples `interval_s` apart, mean
    /// over the axes, (rad/s)²/Hz and (m/s²)²/Hz. An error that stays for a while counts with the time it stays: samples that nothing dithers
    /// know less than their number says.
    pub fn noise_density(&self, interval_s: f64) -> (f64, f64) {
        self.noise_density_lasting(interval_s, &[Vector3::zeros(); 2])
    }

    /// The same where it is known for how long the gyros and accelerometers keep the counts of that sample, s.
    pub fn noise_density_lasting(&self, interval_s: f64, lasts_s: &[Vector3<f64>; 2]) -> (f64, f64) {
        let least = PERSISTENCE_S.max(interval_s);
        let density = |k: usize| {
            let (all, persistent) = (self.variance[k].mean(), self.persistent[k].mean());
            let lasting = self.persistent[k].component_mul(&lasts_s[k].map(|s| s.max(least))).mean();
            (all - persistent) * interval_s + lasting
        };
        (density(0), density(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    const STEP: Quantisation = Quantisation::Truncate(Steps { gyro: 1.0, accel: 1.0 });

    /// What `n` samples at 50 Hz of a rate with white noise (steps) show, for centre of the bin and dequantiser.
    struct Shown {
        bias: [f64; 2],
        /// Variance that quantisation adds to 5 s means, per sample.
        added: f64,
        predicted: f64,
    }

    fn show(rate: impl Fn(f64) -> f64, sigma: f64, seed: u64) -> Shown {
        const WARM_UP: u32 = 500;
        const BLOCK: u32 = 250;
        const BLOCKS: u32 = 60;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut dequantiser = Dequantiser::new(STEP);
        let n = f64::from(BLOCK * BLOCKS);
        let (mut sums, mut predicted, mut block, mut squares) = ([0.0; 2], 0.0, 0.0, 0.0);
        for k in 0..WARM_UP + BLOCK * BLOCKS {
            let t_s = f64::from(k) * 0.02;
            let noise: f64 = StandardNormal.sample(&mut rng);
            let truth = rate(t_s);
            let gyro = Vector3::repeat((truth + sigma * noise).trunc());
            let sample = ImuSample { t_s, gyro, accel: Vector3::zeros(), temperature_degc: None };
            let back = [STEP.undo(&sample).gyro.x, dequantiser.undo(&sample).gyro.x];
            if k >= WARM_UP {
                for (sum, value) in sums.iter_mut().zip(back) {
                    *sum += value - truth - sigma * noise;
                }
                predicted += dequantiser.variance().0.x;
                block += back[1] - truth;
                if (k - WARM_UP + 1).is_multiple_of(BLOCK) {
                    squares += block * block / f64::from(BLOCK);
                    block = 0.0;
                }
            }
        }
        let added = squares / f64::from(BLOCKS) - sigma * sigma;
        Shown { bias: sums.map(|s| s / n), added, predicted: predicted / n }
    }

    /// Mean rates from -3 to 3 steps.
    fn rates() -> impl Iterator<Item = (f64, u64)> {
        (0..=24_u32).map(|i| (f64::from(i) * 0.25 - 3.0, u64::from(i)))
    }

    #[test]
    fn a_dithered_mean_in_the_dead_zone_is_found_again() {
        for sigma in [0.5, 0.7, 1.0, 1.5, 2.0, 3.0] {
            let (mut worst, mut rms) = (0.0_f64, [0.0; 2]);
            for (rate, seed) in rates() {
                let shown = show(|_| rate, sigma, seed);
                worst = worst.max(shown.bias[1].abs());
                for (sum, bias) in rms.iter_mut().zip(shown.bias) {
                    *sum += bias * bias;
                }
            }
            assert!(worst < 0.06, "sigma {sigma}: {worst}");
            if sigma <= 1.0 {
                assert!(rms[1].sqrt() < 0.3 * rms[0].sqrt(), "sigma {sigma}: {rms:?}");
            }
        }
    }

    #[test]
    fn noise_behind_a_low_pass_dithers_as_well() {
        // One step RMS, 20 Hz first-order low-pass, 200 Hz: neighbours are half alike.
        let keep = (-std::f64::consts::TAU * 20.0 * 0.005_f64).exp();
        for rate in [0.3, 0.8, -1.2] {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
            let mut dequantiser = Dequantiser::new(STEP);
            let (mut noise, mut sums, n) = (0.0, [0.0; 2], 60_000_u32);
            for k in 0..n {
                let white: f64 = StandardNormal.sample(&mut rng);
                noise = keep * noise + (1.0 - keep * keep).sqrt() * white;
                let sample = ImuSample {
                    t_s: f64::from(k) * 0.005,
                    gyro: Vector3::repeat((rate + noise).trunc()),
                    accel: Vector3::zeros(),
                    temperature_degc: None,
                };
                sums[0] += STEP.undo(&sample).gyro.x - rate - noise;
                sums[1] += dequantiser.undo(&sample).gyro.x - rate - noise;
            }
            let [centre, this] = sums.map(|s| (s / f64::from(n)).abs());
            assert!(this < 0.02 && this < 0.5 * centre, "{rate}: {centre} {this}");
        }
    }

    #[test]
    fn without_dither_it_is_no_worse_than_the_centre_of_the_bin() {
        for sigma in [0.1, 0.2, 0.3] {
            let mut sums = [0.0; 2];
            for (rate, seed) in rates() {
                for (sum, bias) in sums.iter_mut().zip(show(|_| rate, sigma, seed).bias) {
                    *sum += bias * bias;
                }
            }
            assert!(sums[1] < sums[0], "sigma {sigma}: {sums:?}");
        }
        // After a turn the mean must not stay at the edge of the dead zone.
        let shown = show(|t| if t < 5.0 { 40.0 } else { 0.0 }, 0.1, 1);
        assert!(shown.bias[1].abs() < 0.02, "{:?}", shown.bias);
    }

    #[test]
    fn large_motion_passes_as_through_the_centres() {
        for (amplitude, period) in [(5.0, 10.0), (20.0, 5.0), (100.0, 2.0)] {
            let shown = show(|t| 0.3 + amplitude * (std::f64::consts::TAU * t / period).sin(), 1.0, 7);
            assert!(shown.bias[1].abs() < 0.02, "{amplitude}: {:?}", shown.bias);
        }
    }

    /// Share of a swing of 0.4 step in half a second that arrives, where noise dithers it.
    fn arriving(rate: f64, sigma: f64) -> f64 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut dequantiser = Dequantiser::new(STEP);
        let (mut along, mut all) = (0.0, 0.0);
        for k in 0..400_000_u32 {
            let t_s = f64::from(k) * 0.02;
            let swing = 0.4 * (std::f64::consts::TAU * 2.0 * t_s).sin();
            let noise: f64 = StandardNormal.sample(&mut rng);
            let gyro = Vector3::repeat((rate + swing + sigma * noise).trunc());
            let sample = ImuSample { t_s, gyro, accel: Vector3::zeros(), temperature_degc: None };
            along += (dequantiser.undo(&sample).gyro.x - rate) * swing;
            all += swing * swing;
        }
        along / all
    }

    /// The mean of the normal distribution inside the bin lacks 6 to 15 % of it at 1.2 steps and 8 to 21 % at 1 step.
    #[test]
    fn fast_motion_within_the_noise_passes_in_full() {
        for sigma in [1.0, 1.2, 2.0] {
            for rate in [0.0, 0.6, 1.5, 5.0] {
                let share = arriving(rate, sigma);
                // Measured with an uncertainty of 0.006 times sigma.
                assert!((share - 1.0).abs() < 0.02 * sigma, "rate {rate}, noise {sigma}: {share}");
            }
        }
    }

    #[test]
    fn the_variance_told_is_the_one_means_show() {
        for sigma in [0.5, 1.0, 2.0] {
            let (mut added, mut predicted) = (0.0, 0.0);
            for (rate, seed) in rates() {
                let shown = show(|_| rate, sigma, seed);
                added += shown.added / 25.0;
                predicted += shown.predicted / 25.0;
            }
            // Measured at sigma 2 with an uncertainty of 0.15.
            assert!((predicted - added).abs() < 0.05 + 0.1 * sigma * sigma, "{sigma}: {predicted} {added}");
        }
        // Counts that have stood still for minutes: anything from -1 to 1.
        let mut dequantiser = Dequantiser::new(STEP);
        for k in 0..20_000_u32 {
            dequantiser.undo(&ImuSample {
                t_s: f64::from(k) * 0.02,
                gyro: Vector3::zeros(),
                accel: Vector3::zeros(),
                temperature_degc: None,
            });
        }
        assert!((dequantiser.variance().0.x - 1.0 / 3.0).abs() < 0.01, "{:?}", dequantiser.variance());
    }

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
                        let weight = (-0.5 * (x - mean).powi(2) / variance).exp();
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

    #[test]
    fn a_shock_after_a_minute_of_rest_leaves_numbers() {
        let mut dequantiser = Dequantiser::new(STEP);
        for k in 0..3100_u32 {
            let rate = if k < 3000 { 0.0 } else { 30_000.0 };
            let sample = ImuSample {
                t_s: f64::from(k) * 0.02,
                gyro: Vector3::repeat(rate),
                accel: Vector3::repeat(-rate),
                temperature_degc: None,
            };
            let back = dequantiser.undo(&sample);
            assert!(
                (back.gyro - sample.gyro).amax() <= 1.0 && (back.accel - sample.accel).amax() <= 1.0,
                "{k}"
            );
        }
    }

    #[test]
    fn sources_that_do_not_truncate_pass_unchanged() {
        let sample = ImuSample {
            t_s: 1.0,
            gyro: Vector3::new(0.4e-3, 1.0, -1.0),
            accel: Vector3::new(0.0, 0.1, -9.8),
            temperature_degc: None,
        };
        for q in [Quantisation::None, Quantisation::Round(Steps::RAW_IMU)] {
            assert_eq!(Dequantiser::new(q).undo(&sample), sample);
        }
    }

    proptest! {
        #[test]
        fn undoing_truncation_leaves_at_most_half_a_step_outside_the_dead_zone(v in -1.0..1.0f64) {
            let q = Quantisation::Truncate(Steps::RAW_IMU);
            let (gyro, accel) = q.apply(&Vector3::repeat(v), &Vector3::repeat(v));
            let back = q.undo(&ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None });
            let limit = if v.abs() < Steps::RAW_IMU.gyro { Steps::RAW_IMU.gyro } else { 0.5 * Steps::RAW_IMU.gyro };
            prop_assert!((back.gyro.x - v).abs() <= limit * 1.000_001);
        }
    }

    #[test]
    fn truncation_goes_toward_zero() {
        let q = Quantisation::Truncate(Steps { gyro: 1.0, accel: 1.0 });
        let (g, _) = q.apply(&Vector3::new(1.9, -1.9, 0.9), &Vector3::zeros());
        assert_eq!(g, Vector3::new(1.0, -1.0, 0.0));
    }
}
