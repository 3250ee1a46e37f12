//! Root mean squares of correlated series, and the ratio of two of them with a confidence interval.
//!
//! Innovations of a filter with a wrong parameter are correlated over seconds, so the number of samples says little about the accuracy of
//! a mean square. Its variance is σ²(y)·τ/n for y = x², with the integrated autocorrelation time τ from the initial monotone sequence of
//! autocovariances (C. J. Geyer, "Practical Markov Chain Monte Carlo", Statist. Sci. 7 (1992) 473-483, section 3.3); n/τ is the effective
//! sample size. Two flights spend different shares of their time in turns, so a whole flight is compared by direct standardisation: both
//! mean squares are weighted with the same share of each regime (Fleiss, Levin, Paik, "Statistical Methods for Rates and Proportions",
//! 3rd ed., chapter 19). The ratio of two root mean squares has its interval on the logarithm (delta method), with Student's t and the
//! degrees of freedom of the weighted sum (F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110-114).

use gaware_nav::math::{exp, hypot, ln};
use schemars::JsonSchema;
use serde::Serialize;

/// With fewer effective samples than this nothing is decided.
pub const MIN_EFFECTIVE: f64 = 8.0;
/// A regime with fewer is left out of the sum of regimes.
const MIN_OF_REGIME: f64 = 4.0;
/// Nor is anything decided with fewer samples than this: a shorter series does not show its autocorrelation (Box, Jenkins, Reinsel, "Time
/// Series Analysis", 3rd ed., section 2.1.6).
const MIN_SAMPLES: usize = 50;
/// Effective samples per degree of freedom of a variance of squares. Squares of normal values have a kurtosis of 15: their variance has
/// n/7 degrees of freedom where it is independent of the mean; with n/4 the intervals here cover what they claim (see the tests).
const PER_FREEDOM: f64 = 4.0;
/// Autocovariances beyond this lag are not computed, samples.
const MAX_LAG: usize = 2000;

/// A mean square with its accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanSquare {
    /// Value.
    value: f64,
    /// Variance of the value.
    variance: f64,
    /// Samples.
    pub count: usize,
    /// Effective sample size, by the autocorrelation of the squares.
    pub effective: f64,
}

impl MeanSquare {
    /// Of the samples for which `within` holds; neighbours in `values` are neighbours in time. `None` where there are fewer than two.
    pub fn of(values: &[f64], within: impl Fn(usize) -> bool) -> Option<Self> {
        let squares: Vec<Option<f64>> =
            values.iter().enumerate().map(|(k, v)| within(k).then_some(v * v)).collect();
        let count = squares.iter().flatten().count();
        let n = count as f64;
        let mean = squares.iter().flatten().sum::<f64>() / n;
        if count < 2 || !mean.is_finite() {
            return None;
        }
        let about: Vec<Option<f64>> = squares.iter().map(|y| y.map(|y| y - mean)).collect();
        let spread = about.iter().flatten().map(|y| y * y).sum::<f64>() / n;
        // Correlation can only lower the number of independent samples.
        let long_run = long_run_variance(&about, count).max(spread);
        // The mean is of the same samples: that takes one of the effective ones.
        let share = if long_run > 0.0 { (spread / long_run - 1.0 / n).max(1.0 / n) } else { 1.0 };
        Some(Self { value: mean, variance: spread / (share * n), count, effective: share * n })
    }

    fn rms(&self) -> Rms {
        Rms {
            value: self.value.sqrt(),
            count: self.count,
            effective: self.effective,
            relative: if self.value > 0.0 { self.variance.sqrt() / self.value } else { 0.0 },
        }
    }
}

/// Sum of all autocovariances by Geyer's initial monotone sequence. Pairs of which one is missing do not count.
fn long_run_variance(about: &[Option<f64>], count: usize) -> f64 {
    let covariance = |lag: usize| {
        let pairs = about.iter().zip(about.iter().skip(lag)).filter_map(|(a, b)| Some((*a)? * (*b)?));
        pairs.sum::<f64>() / count as f64
    };
    let (mut sum, mut least) = (-covariance(0), f64::INFINITY);
    for m in 0..MAX_LAG.min(about.len()) / 2 {
        let pair = covariance(2 * m) + covariance(2 * m + 1);
        if pair <= 0.0 {
            break;
        }
        least = least.min(pair);
        sum += 2.0 * least;
    }
    sum.max(0.0)
}

/// A root mean square.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Rms {
    /// Value, in the unit of the series.
    pub value: f64,
    /// Samples.
    pub count: usize,
    /// Effective sample size, by the autocorrelation of the squares.
    pub effective: f64,
    /// Relative standard deviation of the mean square.
    #[serde(skip)]
    relative: f64,
}

/// Root mean squares of two flights in one regime.
pub fn pair(before: &MeanSquare, after: &MeanSquare) -> [Rms; 2] {
    [before.rms(), after.rms()]
}

/// Root mean squares of two flights over the regimes that both have, with the same weight of a regime in both: its share of all samples.
/// `None` where no regime has enough samples in both.
pub fn standardised(regimes: &[[MeanSquare; 2]]) -> Option<[Rms; 2]> {
    let enough =
        |pair: &&[MeanSquare; 2]| pair.iter().all(|m| m.effective >= MIN_OF_REGIME && m.count >= MIN_SAMPLES);
    let used: Vec<&[MeanSquare; 2]> = regimes.iter().filter(enough).collect();
    let samples = |pair: &[MeanSquare; 2]| pair.iter().map(|m| m.count as f64).sum::<f64>();
    let all: f64 = used.iter().map(|p| samples(p)).sum();
    let sum_of = |flight: fn(&[MeanSquare; 2]) -> &MeanSquare| {
        let (mut total, mut squares) =
            (MeanSquare { value: 0.0, variance: 0.0, count: 0, effective: 0.0 }, 0.0);
        for pair in &used {
            let (m, weight) = (flight(pair), samples(pair) / all);
            let variance = weight * weight * m.variance;
            total.value += weight * m.value;
            total.variance += variance;
            total.count += m.count;
            squares += variance * variance / m.effective;
        }
        total.effective =
            if squares > 0.0 { total.variance * total.variance / squares } else { total.count as f64 };
        total.rms()
    };
    (!used.is_empty()).then(|| [sum_of(|[before, _]| before), sum_of(|[_, after]| after)])
}

/// How a quantity changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Smaller, beyond chance.
    Smaller,
    /// No difference beyond chance.
    Unchanged,
    /// Larger, beyond chance.
    Larger,
    /// Too few effective samples.
    Undecided,
}

/// The ratio of two root mean squares, after over before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Ratio {
    /// Ratio.
    pub value: f64,
    /// Its confidence interval; none where there are too few samples for one.
    pub interval: Option<[f64; 2]>,
    /// Whether the interval excludes 1, and on which side.
    pub change: Change,
}

/// Compares with an interval that covers the true ratio with probability `1 - alpha`. `None` where one of them is zero.
pub fn ratio(before: &Rms, after: &Rms, alpha: f64) -> Option<Ratio> {
    if before.value <= 0.0 || after.value <= 0.0 {
        return None;
    }
    let value = after.value / before.value;
    let sigma = 0.5 * hypot(before.relative, after.relative);
    let effective = before.effective.min(after.effective);
    let half = student(effective / PER_FREEDOM, alpha) * sigma;
    let enough = effective >= MIN_EFFECTIVE && before.count.min(after.count) >= MIN_SAMPLES;
    let interval = enough.then(|| [value * exp(-half), value * exp(half)]);
    let change = match interval {
        None => Change::Undecided,
        Some([_, high]) if high < 1.0 => Change::Smaller,
        Some([low, _]) if low > 1.0 => Change::Larger,
        Some(_) => Change::Unchanged,
    };
    Some(Ratio { value, interval, change })
}

/// The two-sided quantile of Student's t, by its expansion about the normal one (Abramowitz & Stegun 26.7.5); to 1 % from 5 degrees of freedom.
fn student(freedom: f64, alpha: f64) -> f64 {
    let (z, n) = (normal(alpha), freedom.max(2.0));
    let (z3, z5) = (z.powi(3), z.powi(5));
    z + (z3 + z) / (4.0 * n) + (5.0 * z5 + 16.0 * z3 + 3.0 * z) / (96.0 * n * n)
}

/// The two-sided quantile of the normal distribution (Abramowitz & Stegun 26.2.23, error below 4.5e-4).
fn normal(alpha: f64) -> f64 {
    let t = (-2.0 * ln(alpha / 2.0)).sqrt();
    t - (2.515_517 + t * (0.802_853 + 0.010_328 * t))
        / (1.0 + t * (1.432_788 + t * (0.189_269 + 0.001_308 * t)))
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::cos;

    use super::*;

    /// Normal numbers, the same on every machine (SplitMix64 and Box-Muller).
    struct Noise(u64);

    impl Noise {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            (((z ^ (z >> 31)) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        }

        fn normal(&mut self) -> f64 {
            (-2.0 * ln(self.uniform())).sqrt() * cos(std::f64::consts::TAU * self.uniform())
        }

        /// First-order autoregressive, unit variance.
        fn series(&mut self, n: usize, correlation: f64) -> Vec<f64> {
            let mut x = self.normal();
            let innovation = (1.0 - correlation * correlation).sqrt();
            (0..n)
                .map(|_| {
                    x = correlation * x + innovation * self.normal();
                    x
                })
                .collect()
        }
    }

    fn rms(values: &[f64]) -> Rms {
        MeanSquare::of(values, |_| true).unwrap().rms()
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (freedom, alpha, table) in
            [(1e9, 0.05, 1.960), (10.0, 0.05, 2.228), (7.0, 0.05, 2.365), (20.0, 0.01, 2.845)]
        {
            assert!((student(freedom, alpha) - table).abs() < 0.012 * table, "{freedom} {alpha}");
        }
    }

    /// The interval covers the true ratio as often as it claims: for white series, for such that are correlated over 10 and 40 samples, and
    /// for short ones, of which only those count that decide anything. 500 runs: 0.95 ± 0.01.
    #[test]
    fn intervals_cover_the_truth_as_often_as_they_claim() {
        let mut noise = Noise(1);
        for (correlation, lengths) in [
            (0.0, [3000, 2000]),
            (0.9, [3000, 2000]),
            (0.9, [200, 200]),
            (0.975, [3000, 2000]),
            (0.975, [400, 400]),
        ] {
            let (mut missed, runs) = (0, 500);
            for _ in 0..runs {
                let [a, b] = lengths.map(|n| noise.series(n, correlation));
                let b: Vec<f64> = b.iter().map(|v| 0.7 * v).collect();
                let [a, b] = [a, b].map(|v| rms(&v));
                let found = ratio(&a, &b, 0.05).unwrap();
                missed += u32::from(found.interval.is_some_and(|[low, high]| !(low..=high).contains(&0.7)));
            }
            let share = f64::from(missed) / f64::from(runs);
            assert!(share <= 0.075, "{share} at a correlation of {correlation}, {lengths:?} samples");
        }
    }

    #[test]
    fn correlated_samples_count_for_fewer() {
        let mut noise = Noise(2);
        let white = rms(&noise.series(4000, 0.0));
        let slow = rms(&noise.series(4000, 0.95));
        // τ of squares of an AR(1) series: (1 + φ²)/(1 - φ²).
        assert!(white.effective > 3000.0, "{white:?}");
        assert!((4000.0 / slow.effective / 19.5 - 1.0).abs() < 0.35, "{slow:?}");
    }

    #[test]
    fn no_difference_is_named_where_there_is_none_and_few_samples_decide_nothing() {
        let mut noise = Noise(3);
        let mut wrong = 0;
        for _ in 0..200 {
            let [a, b] = [(); 2].map(|()| rms(&noise.series(1500, 0.9)));
            wrong += usize::from(ratio(&a, &b, 0.05).unwrap().change != Change::Unchanged);
        }
        assert!(wrong <= 18, "{wrong} of 200");
        let [a, b] = [(); 2].map(|()| rms(&noise.series(100, 0.99)));
        let few = ratio(&a, &b, 0.05).unwrap();
        assert_eq!(
            (few.change, few.interval),
            (Change::Undecided, None),
            "what decides nothing shows no interval"
        );
        assert_eq!(MeanSquare::of(&[1.0, 2.0], |k| k == 0), None);
    }

    /// Turns have three times the innovations of level flight, in both flights alike; one flight turns for a fifth of the time, the other
    /// for four fifths.
    #[test]
    fn more_turns_are_no_larger_innovations() {
        let mut noise = Noise(4);
        let mut flight = |turning: usize| {
            let within = move |k: usize| k % 1000 < turning;
            let series = noise.series(6000, 0.8);
            let values: Vec<f64> =
                series.iter().enumerate().map(|(k, v)| if within(k) { 3.0 * v } else { *v }).collect();
            [
                MeanSquare::of(&values, within),
                MeanSquare::of(&values, |k| !within(k)),
                MeanSquare::of(&values, |_| true),
            ]
            .map(Option::unwrap)
        };
        let (before, after) = (flight(200), flight(800));
        let plain = ratio(&before[2].rms(), &after[2].rms(), 0.05).unwrap();
        assert_eq!(plain.change, Change::Larger);
        let [b, a] = standardised(&[[before[0], after[0]], [before[1], after[1]]]).unwrap();
        let found = ratio(&b, &a, 0.05).unwrap();
        assert_eq!(found.change, Change::Unchanged, "{found:?}");
        assert!(found.interval.is_some_and(|[low, high]| high / low < 1.5), "{found:?}");
        assert_eq!(standardised(&[]), None);
    }
}
