//! How noisy the samples of a running vehicle are: vibration exceeds the sensor's own noise by far.
//!
//! What drives the errors of navigation is the spectral density of the noise at low frequency, S(0) = T Σ r_k for samples T
//! apart with autocovariance r_k. For white noise that is T r_0; samples that are means of neighbours (PX4 integrates by
//! trapezoids) or come from a low-pass have more than their scatter shows. The sixth difference Σ (−1)^k C(6, k) x_k removes
//! motion that is smooth over its span, and has variance 924 r_0 − 1584 r_1 + … (the autocorrelation of the binomial
//! coefficients is that of order twelve, (−1)^k C(12, 6 + k)). Taken over values one and two places apart it gives both r_0
//! and r_1 of noise that is correlated with its next neighbour alone:
//!
//! v_2 = 924 r_0, v_1 = 924 r_0 − 1584 r_1, S(0) = T (r_0 + 2 r_1) = T (v_2/924 + (v_2 − v_1)/792).
//!
//! Where the correlation does not end there (v_2 < v_4, the same four places apart) samples come from a low-pass, or the vehicle moves that fast: a
//! rate controller answers noisy gyros with motion of 10 to 30 Hz. At rates far above the corner a low-pass leaves so little in v_2 that the two
//! are not mixed up: the bound lies half way, in the logarithm, between white noise and what the low-pass leaves at this rate. Below its
//! corner a vehicle in turbulence moves more than its sensors are noisy, so the density is taken from what the filter leaves
//! near 50 Hz, divided by its gain there: two poles at 20 Hz (Butterworth), ArduPilot's default (`INS_GYRO_FILTER`,
//! `INS_ACCEL_FILTER`). Differences count samples, not stamps: jitter of the stamps is no noise of the values. Causal, and a
//! function of the samples alone.

use crate::math::{ln, sin};
use crate::sample::ImuSample;
use nalgebra::Vector3;

/// Memory of the running means, s.
pub(crate) const MEMORY_S: f64 = 5.0;
/// The same for how smooth the samples are, s.
const SLOW_MEMORY_S: f64 = 20.0;
/// Slices of the spectrum in a numerical integral.
const SLICES: u32 = 64;
/// Noise up to so many times the model's variance is left to the model.
const TOLERATED: f64 = 2.0;
/// Corner of the low-pass, and where it is looked through, Hz.
const LOW_PASS_HZ: (f64, f64) = (20.0, 50.0);
/// Samples without which there is no usual interval.
const SETTLED: u32 = 8;
/// A gap, in usual intervals, and at most, s: differences do not reach across it.
const GAP: (f64, f64) = (3.5, 0.5);
/// Places between the values of a difference.
const LAGS: [usize; 3] = [1, 2, 4];
/// Values that the widest difference spans.
const SPAN: usize = 6 * LAGS[2] + 1;
/// Coefficients of the sixth difference.
const SIXTH: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];
/// C(12, 6) and twice C(12, 7).
const SUMS: (f64, f64) = (924.0, 1584.0);
/// v_2/v_4 below which the correlation reaches beyond the next neighbour, at most: it is 1 for white noise and means of neighbours, 0.7
/// behind a low-pass of 20 Hz at 100 Hz, and 0.15 at 230 Hz, where PX4's own controller alone brings it to 0.7 (px4_plane_strong_noise).
const SMOOTH: f64 = 0.82;
/// Motion makes samples look smooth for a while; what they are at their roughest is forgotten so slowly, s.
const ROUGHEST_S: f64 = 60.0;

/// Gyro and accelerometer.
type Pair = [f64; 2];

/// Sixth differences of evenly spaced values.
#[derive(Debug, Clone, Default)]
struct Differences {
    values: [[Vector3<f64>; 2]; SPAN],
    filled: usize,
    next: usize,
    seconds: f64,
    /// Mean squares by the places apart …
    squares: [Pair; 3],
    /// … and the same with a longer memory.
    slow: [Pair; 3],
}

impl Differences {
    fn push(&mut self, values: [Vector3<f64>; 2], interval_s: f64) {
        self.values[self.next] = values;
        self.next = (self.next + 1) % SPAN;
        self.filled = (self.filled + 1).min(SPAN);
        if self.filled < SPAN {
            return;
        }
        let [share, slow_share] =
            [MEMORY_S, SLOW_MEMORY_S].map(|m| interval_s / self.seconds.clamp(interval_s, m));
        self.seconds += interval_s;
        for ((lag, squares), slow) in LAGS.iter().zip(&mut self.squares).zip(&mut self.slow) {
            for (sensor, square) in squares.iter_mut().enumerate() {
                let mut sum = Vector3::zeros();
                for (k, c) in SIXTH.iter().enumerate() {
                    // The newest value stands before `next`.
                    sum += self.values[(self.next + SPAN - 1 - lag * k) % SPAN][sensor] * *c;
                }
                let new = sum.norm_squared() / 3.0;
                *square += share * (new - *square);
                slow[sensor] += slow_share * (new - slow[sensor]);
            }
        }
    }

    /// Nothing of what comes belongs to what came.
    fn cut(&mut self) {
        self.filled = 0;
    }

    /// Density at low frequency of noise that is correlated with its next neighbour at most.
    fn density(&self, interval_s: f64) -> Pair {
        let [one, two, _] = self.squares;
        std::array::from_fn(|k| (interval_s * (two[k] / SUMS.0 + (two[k] - one[k]) * 2.0 / SUMS.1)).max(0.0))
    }

    /// The same of noise behind the low-pass, which leaves so much of each mean square.
    fn density_behind(&self, low_pass: &LowPass, interval_s: f64) -> Pair {
        self.squares[low_pass.lag].map(|square| interval_s * square / (SUMS.0 * low_pass.left))
    }
}

/// How the low-pass looks at a rate.
#[derive(Debug, Clone, Copy, Default)]
struct LowPass {
    interval_s: f64,
    /// Index of the lag whose difference looks nearest to the wanted frequency.
    lag: usize,
    /// Share of white noise in that difference that is left.
    left: f64,
    /// v_2/v_4 below which samples come from it.
    smooth: f64,
}

impl LowPass {
    fn at(interval_s: f64) -> Self {
        let peak_hz = |lag: usize| 0.5 / (interval_s * lag as f64);
        let off = |lag: &usize| ln(peak_hz(*lag) / LOW_PASS_HZ.1).abs();
        let lag = (0..LAGS.len()).min_by(|a, b| off(&LAGS[*a]).total_cmp(&off(&LAGS[*b]))).unwrap_or(0);
        let gain = |hz: f64| 1.0 / (1.0 + (hz / LOW_PASS_HZ.0).powi(4));
        let (mut left, mut all) = ([0.0; 3], [0.0; 3]);
        for k in 0..SLICES {
            let hz = (f64::from(k) + 0.5) / f64::from(SLICES) * 0.5 / interval_s;
            // What lies above half the rate is folded down.
            let folded: f64 = (-3..=3).map(|turn| gain((hz + f64::from(turn) / interval_s).abs())).sum();
            for ((lag, left), all) in LAGS.iter().zip(&mut left).zip(&mut all) {
                let seen = sin(std::f64::consts::PI * hz * interval_s * *lag as f64).powi(12);
                *left += seen * folded;
                *all += seen;
            }
        }
        let [_, two, four]: [f64; 3] = std::array::from_fn(|k| left[k] / all[k]);
        let smooth = (two / four).sqrt().min(SMOOTH);
        Self { interval_s, lag, left: left[lag] / all[lag], smooth }
    }
}

/// Running estimate of white noise per hertz.
#[derive(Debug, Clone, Default)]
pub struct NoiseMeter {
    last_s: Option<f64>,
    interval_s: f64,
    intervals: u32,
    differences: Differences,
    low_pass: LowPass,
    /// v_2/v_4 at its largest.
    roughest: Pair,
}

impl NoiseMeter {
    /// Takes a sample.
    pub fn push(&mut self, sample: &ImuSample) {
        let dt = self.last_s.map(|last| sample.t_s - last);
        self.last_s = Some(sample.t_s);
        let Some(dt) = dt.filter(|dt| dt.is_finite()) else { return };
        let gap = dt <= 0.0 || dt >= GAP.1 || (self.intervals >= SETTLED && dt > GAP.0 * self.interval_s);
        if gap {
            self.differences.cut();
            return;
        }
        self.intervals = self.intervals.saturating_add(1);
        let share = (1.0 / f64::from(self.intervals)).max(dt / MEMORY_S);
        self.interval_s += share * (dt - self.interval_s);
        if self.intervals < SETTLED {
            return;
        }
        if (self.interval_s / self.low_pass.interval_s - 1.0).abs() > 0.02 || self.low_pass.left == 0.0 {
            self.low_pass = LowPass::at(self.interval_s);
        }
        self.differences.push([sample.gyro, sample.accel], self.interval_s);
        self.note_roughness(dt);
    }

    fn note_roughness(&mut self, dt: f64) {
        if self.differences.seconds < MEMORY_S {
            return;
        }
        let [_, two, four] = self.differences.slow;
        for (k, roughest) in self.roughest.iter_mut().enumerate() {
            let now = if four[k] > 0.0 { two[k] / four[k] } else { 1.0 };
            *roughest = now.max(*roughest * (1.0 - dt / ROUGHEST_S));
        }
    }

    /// Mean interval between samples, s; 0 before the second sample.
    pub fn interval_s(&self) -> f64 {
        self.interval_s
    }

    /// Variance per hertz of gyro and accelerometer; zero while too little was seen.
    pub fn density(&self) -> (f64, f64) {
        if self.differences.seconds < 0.5 {
            return (0.0, 0.0);
        }
        let rough = self.differences.density(self.interval_s);
        let smooth = self.differences.density_behind(&self.low_pass, self.interval_s);
        let of = |k: usize| {
            let low_passed = self.roughest[k] < self.low_pass.smooth && self.differences.seconds >= MEMORY_S;
            if low_passed { smooth[k] } else { rough[k] }
        };
        (of(0), of(1))
    }

    /// Variance of one gyro and one accelerometer value as far as it is no smooth motion, (rad/s)² and (m/s²)²: vibration in
    /// full, also where little of it lies at low frequency.
    pub fn scatter(&self) -> (f64, f64) {
        let [one, two, _] = self.differences.squares;
        let of = |k: usize| one[k].max(two[k]) / SUMS.0;
        (of(0), of(1))
    }

    /// What to add to the variances per hertz (both gyro and accelerometer) that are known of, given these.
    pub fn excess(&self, gyro: f64, accel: f64) -> (f64, f64) {
        let over =
            |measured: f64, model: f64| if measured > TOLERATED * model { measured - model } else { 0.0 };
        let (measured, scatter) = (self.density(), self.scatter());
        // Vibration leaves little at low frequency; that it can be navigated through that well is not assumed.
        let measured =
            (measured.0.max(scatter.0 * self.interval_s), measured.1.max(scatter.1 * self.interval_s));
        (over(measured.0, gyro), over(measured.1, accel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantisation::Dequantiser;
    use crate::sample::{Quantisation, Steps};
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal, Uniform};

    /// Root of the density, rad/s/√Hz, of all that is made here.
    const DENSITY: f64 = 1e-4;
    /// Noise is made so much faster than samples are taken.
    const FINE: usize = 16;

    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Kind {
        White,
        /// Means of neighbours, as PX4's integration by trapezoids makes them.
        Trapezoids,
        /// Two poles at 20 Hz, as ArduPilot's filter.
        LowPassed,
        Truncated,
    }

    /// Noise of one axis at this rate.
    fn noise(kind: Kind, rate_hz: f64, n: usize, rng: &mut Xoshiro256PlusPlus) -> Vec<f64> {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let sigma = DENSITY * rate_hz.sqrt();
        match kind {
            Kind::White | Kind::Truncated => (0..n).map(|_| sigma * normal()).collect(),
            Kind::Trapezoids => {
                let white: Vec<f64> = (0..=n).map(|_| sigma * normal()).collect();
                white.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect()
            }
            Kind::LowPassed => {
                let dt = 1.0 / (rate_hz * FINE as f64);
                let omega = std::f64::consts::TAU * 20.0;
                let (mut x, mut v) = (0.0, 0.0);
                let fine = DENSITY / dt.sqrt();
                (0..n)
                    .map(|_| {
                        for _ in 0..FINE {
                            // Butterworth: x'' = ω² (u − x) − √2 ω x'.
                            v += dt * (omega * omega * (fine * normal() - x) - 2.0_f64.sqrt() * omega * v);
                            x += dt * v;
                        }
                        x
                    })
                    .collect()
            }
        }
    }

    /// What the meter says of the gyros over what is there, as a mean over the second half of two minutes.
    fn measured(kind: Kind, rate_hz: f64, jitter: f64, motion: impl Fn(f64) -> f64) -> f64 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7 + rate_hz as u64);
        let n = (120.0 * rate_hz) as usize;
        let [x, y, z] = [0; 3].map(|_| noise(kind, rate_hz, n, &mut rng));
        // A step of 0.8 sigma: whole numbers that noise still dithers.
        let step = 0.8 * DENSITY * rate_hz.sqrt();
        let quantisation = match kind {
            Kind::Truncated => Quantisation::Truncate(Steps { gyro: step, accel: 1.0 }),
            _ => Quantisation::None,
        };
        let mut dequantiser = Dequantiser::new(quantisation);
        let (mut meter, mut sum, mut count) = (NoiseMeter::default(), 0.0, 0);
        let scatter = Uniform::new(-0.5, 0.5).unwrap();
        for (i, ((x, y), z)) in x.iter().zip(&y).zip(&z).enumerate() {
            let t_s = i as f64 / rate_hz;
            let gyro = Vector3::new(*x, *y, *z).add_scalar(0.4 * step + motion(t_s));
            let (gyro, accel) = quantisation.apply(&gyro, &Vector3::zeros());
            let t_s = t_s + jitter * scatter.sample(&mut rng) / rate_hz;
            let sample = dequantiser.undo(&ImuSample { t_s, gyro, accel, temperature_degc: None });
            meter.push(&sample);
            if i > n / 2 {
                sum += meter.density().0;
                count += 1;
            }
        }
        (sum / f64::from(count)).sqrt() / DENSITY
    }

    #[test]
    fn the_density_is_right_for_every_kind_of_sample() {
        use Kind::{LowPassed, Trapezoids, Truncated, White};
        let mut wrong = Vec::new();
        for (kind, rates) in [
            (White, vec![50.0, 100.0, 125.0, 200.0, 250.0, 400.0]),
            (Trapezoids, vec![50.0, 125.0, 250.0]),
            (LowPassed, vec![100.0, 125.0, 200.0, 250.0, 400.0]),
            (Truncated, vec![50.0, 100.0, 200.0]),
        ] {
            for rate_hz in rates {
                let ratio = measured(kind, rate_hz, 0.0, |_| 0.0);
                println!("{kind:?} at {rate_hz} Hz: {ratio:.3}");
                if (ratio - 1.0).abs() > 0.1 {
                    wrong.push(format!("{kind:?} at {rate_hz} Hz: {ratio:.3}"));
                }
            }
        }
        assert!(wrong.is_empty(), "{wrong:?}");
    }

    #[test]
    fn jittered_stamps_are_measured_as_well() {
        for jitter in [0.3, 0.8] {
            let ratio = measured(Kind::White, 100.0, jitter, |_| 0.0);
            assert!((ratio - 1.0).abs() < 0.1, "{jitter}: {ratio}");
        }
    }

    #[test]
    fn smooth_motion_is_no_noise() {
        // A swing of 30 deg/s in two seconds.
        let swing = |t: f64| 0.5 * sin(std::f64::consts::PI * t);
        // Turbulence at 5 and 10 Hz, of 1 and 0.1 deg/s.
        let lively = |t: f64| swing(t) + 0.017 * sin(31.4 * t) + 0.0017 * sin(62.8 * t + 1.0);
        for (kind, rate_hz) in [(Kind::White, 50.0), (Kind::White, 200.0), (Kind::LowPassed, 200.0)] {
            let ratio = measured(kind, rate_hz, 0.0, swing);
            assert!((ratio - 1.0).abs() < 0.15, "{kind:?} at {rate_hz} Hz: {ratio}");
        }
        let ratio = measured(Kind::LowPassed, 200.0, 0.0, lively);
        assert!((ratio - 1.0).abs() < 0.15, "in turbulence: {ratio}");
    }

    /// A controller that answers noise with motion: means of neighbours at 226 Hz, and motion between 10 and 30 Hz that brings v_2/v_4 to 0.65.
    #[test]
    fn motion_of_a_rate_controller_is_no_low_pass() {
        let shake = |t: f64| {
            let tone = |hz: f64, phase: f64| sin(std::f64::consts::TAU * hz * t + phase);
            DENSITY
                * 226.0_f64.sqrt()
                * (0.25 * tone(14.0, 0.3) + 0.25 * tone(19.0, 1.1) + 0.35 * tone(26.0, 2.0))
        };
        let ratio = measured(Kind::Trapezoids, 226.0, 0.0, shake);
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
    }

    #[test]
    fn quiet_samples_are_left_to_the_model_and_gaps_are_no_noise() {
        let mut meter = NoiseMeter::default();
        for i in 0..2000_u32 {
            let pause = if i > 1000 { 3.0 } else { 0.0 };
            let level = if i > 1000 { 0.7 } else { 0.0 };
            let t_s = f64::from(i) * 0.01 + pause;
            let gyro = Vector3::repeat(level);
            meter.push(&ImuSample { t_s, gyro, accel: gyro, temperature_degc: None });
        }
        assert_eq!(meter.excess(1e-8, 1e-5), (0.0, 0.0));
        assert!((meter.interval_s() - 0.01).abs() < 1e-6);
    }
}
