//! How fast specific force and angular rate change, along a whole flight or around one instant: known only when the samples on both
//! sides of it are there. A receiver that rounds corners off needs it ([`GpsSmoothing`](crate::effects::GpsSmoothing)).

use crate::effects::{FixInstant, Kernel, LateRate, Older, Surroundings};
use crate::rotation::exp;
use crate::sample::{ImuSample, SampleKind};
use crate::vibration::{HighPass, Meter};
use nalgebra::{UnitQuaternion, Vector3};

/// Means over so long before and after an instant are compared, s.
const SPAN_S: f64 = Kernel::SPAN_S;

/// The angular rate itself is a mean over this time before and after an instant, s.
const RATE_SPAN_S: f64 = 0.02;

/// Variance per hertz of the rate's own rate of change where that of the rate is one, 1/s²: a difference of angles over 2 × 0.1 s.
pub const RATE_CHANGE_DENSITY: f64 = 0.5 / (SPAN_S * SPAN_S);

/// A rate that is compared with one of a while ago is a mean over this time before and after, s.
const LATE_SPAN_S: f64 = 0.01;
/// The power of vibration is a mean over this time before and after an instant, s: two lines that the sampling folds onto nearly the
/// same frequency beat.
const POWER_SPAN_S: f64 = 2.0;

/// The samples of so long before …
pub const BEFORE_S: f64 = 0.6;
/// … and of so long after the later of the instants that are compared determine what is known around it, s.
const BEYOND_S: f64 = RATE_SPAN_S + 0.03;

/// Samples further apart say nothing of what changes within [`SPAN_S`], s.
const MOST_APART_S: f64 = 0.06;

/// 1-sigma of [`ForceRates::at`] that white noise of this density makes of it, (m/s²)²/Hz to m/s³: the difference of two means
/// over 0.1 s.
pub fn noise(density: f64) -> f64 {
    (2.0 * density / SPAN_S).sqrt() / SPAN_S
}

/// So long after an instant the samples of what is known around it are there, s: a receiver with this kernel has measured until then, and sends later.
pub fn after_s(kernel: Kernel) -> f64 {
    let [after_s, _] = kernel.instants(kernel.ahead_s());
    after_s.max(SPAN_S) + BEYOND_S
}

/// The instants that are compared.
fn instants(t_s: f64) -> [f64; 3] {
    [t_s - SPAN_S, t_s, t_s + SPAN_S]
}

/// By how much a slope changes in a second, from the values at the three of them; zero where one is lacking.
fn second_difference(values: [Option<Vector3<f64>>; 3]) -> Vector3<f64> {
    match values {
        [Some(a), Some(b), Some(c)] => (c - b * 2.0 + a) / (SPAN_S * SPAN_S),
        _ => Vector3::zeros(),
    }
}

/// Second derivative of what changes by so much to these two instants, one after and one before that of which it is: the divided difference.
fn divided([after_s, before_s]: [f64; 2], changes: [Option<Vector3<f64>>; 2]) -> Option<Vector3<f64>> {
    let [after, before] = changes;
    Some((after? / after_s - before? / before_s) * (2.0 / (after_s - before_s)))
}

/// A change of velocity is put together of so many parts.
const PARTS: u32 = 4;

/// Times in order, and where each of as many equal parts of the span begins among them: an instant is found in a few steps.
#[derive(Debug, Clone, Default)]
struct Times {
    times_s: Vec<f64>,
    begins: Vec<usize>,
}

impl Times {
    fn new(times_s: Vec<f64>) -> Self {
        let mut own = Self { times_s, begins: Vec::new() };
        let parts = own.times_s.len();
        let mut begins = Vec::with_capacity(parts + 1);
        for (k, t_s) in own.times_s.iter().enumerate() {
            begins.resize(begins.len().max(own.part(*t_s) + 1), k);
        }
        begins.resize(parts + 1, parts);
        own.begins = begins;
        own
    }

    /// In which part an instant lies, or would: of two instants the later one is in no earlier part.
    fn part(&self, t_s: f64) -> usize {
        let [first, .., last] = self.times_s.as_slice() else { return 0 };
        let n = self.times_s.len();
        (((t_s - first) / (last - first) * n as f64) as usize).min(n - 1)
    }

    /// Number of the first that is not before an instant.
    fn next(&self, t_s: f64) -> usize {
        let part = self.part(t_s);
        let of = |k: usize| self.begins.get(k).copied().unwrap_or(self.times_s.len());
        let (low, high) = (of(part), of(part + 1));
        low + self.times_s.get(low..high).map_or(0, |own| own.partition_point(|t| *t < t_s))
    }

    fn at(&self, k: usize) -> Option<f64> {
        self.times_s.get(k).copied()
    }
}

/// Samples with the impulse of specific force, and the angle, up to each.
#[derive(Debug, Clone, Default)]
pub struct ForceRates {
    times: Times,
    impulses: Vec<Vector3<f64>>,
    angles: Vec<Vector3<f64>>,
    /// Integral of the squares of what is fast in the specific force.
    powers: Vec<Vector3<f64>>,
}

impl ForceRates {
    /// Of samples in order of time.
    pub fn new(samples: &[ImuSample], kind: SampleKind) -> Self {
        let (mut times_s, mut impulses, mut angles) = (Vec::new(), Vec::new(), Vec::new());
        let (mut powers, mut power, mut high_pass) = (Vec::new(), Vector3::zeros(), HighPass::default());
        let (mut last, mut sum, mut angle) = (None::<&ImuSample>, Vector3::zeros(), Vector3::zeros());
        for sample in samples {
            let fast = high_pass.take(sample);
            if let Some(before) = last {
                power += fast.component_mul(&fast) * (sample.t_s - before.t_s);
                let start = if kind == SampleKind::Point { before } else { sample };
                let half = 0.5 * (sample.t_s - before.t_s);
                sum += (start.accel + sample.accel) * half;
                angle += (start.gyro + sample.gyro) * half;
            }
            times_s.push(sample.t_s);
            impulses.push(sum);
            angles.push(angle);
            powers.push(power);
            last = Some(sample);
        }
        Self { times: Times::new(times_s), impulses, angles, powers }
    }

    /// Of the samples around an instant, oldest first: enough of them before for a velocity of a while ago, and after for the second
    /// derivatives. `None` where some are missing.
    pub fn around_instant<'a>(
        samples: impl Iterator<Item = &'a ImuSample>,
        t_s: f64,
        kind: SampleKind,
    ) -> Option<Self> {
        let near = |s: &&ImuSample| s.t_s > t_s - BEFORE_S && s.t_s < t_s + 2.0 * (SPAN_S + BEYOND_S);
        let near: Vec<ImuSample> = samples.filter(near).copied().collect();
        let gap = near.windows(2).any(|w| matches!(w, [a, b] if b.t_s - a.t_s > MOST_APART_S));
        (!gap).then(|| Self::new(&near, kind))
    }

    fn up_to(&self, sums: &[Vector3<f64>], t_s: f64) -> Option<Vector3<f64>> {
        let next = self.times.next(t_s);
        let before = next.checked_sub(1)?;
        let (t0, t1) = (self.times.at(before)?, self.times.at(next)?);
        let share = (t_s - t0) / (t1 - t0);
        Some(sums.get(before)?.lerp(sums.get(next)?, share))
    }

    /// Mean of what was summed up, over so long before and after an instant.
    fn mean(&self, sums: &[Vector3<f64>], t_s: f64, span_s: f64) -> Option<Vector3<f64>> {
        Some((self.up_to(sums, t_s + span_s)? - self.up_to(sums, t_s - span_s)?) / (2.0 * span_s))
    }

    /// From the axes of an instant to those where the angle was `here`.
    fn turn(&self, at_s: f64, here: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
        Some(exp(&(self.up_to(&self.angles, at_s)? - here)))
    }

    /// The velocity `lag_s` before an instant, from the samples in between, and the acceleration there. `shown` and `force` are the specific force at the instant
    /// as the sample has it and as it is.
    pub fn older(&self, lag_s: f64, x: &FixInstant, shown: &Vector3<f64>, force: &Vector3<f64>) -> Older {
        if lag_s == 0.0 {
            return x.older;
        }
        let rest = x.a_n - x.c_nb * force;
        let then = || {
            let here = self.up_to(&self.angles, x.t_s)?;
            let change = self.change(x.t_s, -lag_s, &(force - shown))?;
            let then_s = x.t_s - lag_s;
            let then = self.mean(&self.impulses, then_s, RATE_SPAN_S)? + force - shown
                + self.smoothed(then_s, x.antenna.kernel);
            let acceleration = x.c_nb * (self.turn(then_s, &here)? * then) + rest;
            Some(Older { lag_s, change: x.c_nb * change - rest * lag_s, acceleration })
        };
        then().unwrap_or(x.older)
    }

    /// Rate of change of the specific force in body axes, m/s³; zero where samples on one side are lacking.
    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        second_difference(instants(t_s).map(|t| self.up_to(&self.impulses, t)))
    }

    /// What the velocity changes by from an instant to another, in the body axes of the first, m/s: from the samples in between, which the specific force exceeds by so much (m/s²),
    /// part by part in the axes of its middle.
    fn change(&self, t_s: f64, by_s: f64, beyond: &Vector3<f64>) -> Option<Vector3<f64>> {
        let step_s = by_s / f64::from(PARTS);
        let (here, mut from) = (self.up_to(&self.angles, t_s)?, self.up_to(&self.impulses, t_s)?);
        let part = |k: u32| {
            let begun_s = t_s + step_s * f64::from(k);
            let to = self.up_to(&self.impulses, begun_s + step_s)?;
            let impulse = to - std::mem::replace(&mut from, to);
            Some(self.turn(begun_s + 0.5 * step_s, &here)? * (impulse + beyond * step_s))
        };
        (0..PARTS).map(part).sum()
    }

    /// Third derivative of the velocity in the body axes of an instant as the skew of a receiver's kernel has it, m/s⁴: the divided difference over its instants, less that over as
    /// many about the middle. Zero where samples on one side are lacking.
    pub fn skewed(&self, t_s: f64, kernel: Kernel) -> Vector3<f64> {
        let over = |ahead_s: f64| {
            let instants = kernel.instants(ahead_s);
            divided(instants, instants.map(|by| self.change(t_s, by, &Vector3::zeros())))
        };
        let ahead_s = kernel.ahead_s();
        let ahead_s = ahead_s.abs().max(RATE_SPAN_S).copysign(ahead_s);
        let change = || Some(over(ahead_s)? - over(0.0)?);
        change().unwrap_or_default() / (Kernel::BY_AHEAD * ahead_s)
    }

    /// By how much the acceleration of a receiver that smooths differs from that of the instant, in body axes, m/s². Zero where samples on one side are lacking.
    pub fn smoothed(&self, t_s: f64, kernel: Kernel) -> Vector3<f64> {
        let here = self.up_to(&self.angles, t_s);
        let force = |t: f64| Some(self.turn(t, &here?)? * self.mean(&self.impulses, t, RATE_SPAN_S)?);
        let own = force(t_s);
        let instants = kernel.instants(kernel.ahead_s());
        let changes = instants.map(|by| Some(force(t_s + by)? - own?));
        divided(instants, changes).unwrap_or_default() * kernel.smoothing_s2
    }

    /// What the samples show around an instant. `lag_s`: the reported rate is so much older than the specific force.
    pub fn around(&self, t_s: f64, lag_s: f64) -> Surroundings {
        let rate = |t_s: f64| self.mean(&self.angles, t_s, LATE_SPAN_S);
        // The true rate of now is reported later.
        let change = || Some(rate(t_s)? - rate(t_s + lag_s)?);
        let late = if lag_s == 0.0 { None } else { change() };
        Surroundings {
            rate_derivatives: self.of_rate_at(t_s + lag_s),
            late: late.map_or_else(LateRate::default, |change| LateRate { lag_s, change }),
            vibration: self.mean(&self.powers, t_s, POWER_SPAN_S).unwrap_or_default(),
        }
    }

    /// First and second derivative of the angular rate, rad/s² and rad/s³; zero where samples on one side are lacking.
    pub fn of_rate_at(&self, t_s: f64) -> [Vector3<f64>; 2] {
        let rate = |t: f64| self.mean(&self.angles, t, RATE_SPAN_S);
        match instants(t_s).map(rate) {
            [Some(a), Some(b), Some(c)] => {
                [(c - a) / (2.0 * SPAN_S), second_difference([Some(a), Some(b), Some(c)])]
            }
            _ => [Vector3::zeros(); 2],
        }
    }
}

/// The rate's time constant when its slope is taken from the samples before alone, s.
const SLOPE_S: f64 = 0.02;

/// The same in flight, from the samples so far: derivatives are a time constant late, and a rate of a while ago is a series about
/// now.
#[derive(Debug, Clone, Copy, Default)]
pub struct Recent {
    last: Option<(f64, Vector3<f64>)>,
    slope: Vector3<f64>,
    meter: Meter,
}

impl Recent {
    /// Takes the next sample.
    pub fn take(&mut self, sample: &ImuSample) {
        if let Some((t_s, gyro)) = self.last.replace((sample.t_s, sample.gyro)) {
            let dt = sample.t_s - t_s;
            if dt > 0.0 {
                self.slope += ((sample.gyro - gyro) / dt - self.slope) * (dt / (dt + SLOPE_S));
            }
        }
        self.meter.take(sample);
    }

    /// What the samples show so far.
    pub fn around(&self) -> Surroundings {
        Surroundings {
            rate_derivatives: [self.slope, Vector3::zeros()],
            late: LateRate::default(),
            vibration: self.meter.power(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;

    /// Two seconds of samples that are this specific force, at 100 Hz.
    fn rates_of(force: impl Fn(f64) -> Vector3<f64>) -> ForceRates {
        let sample = |i: i32| {
            let t_s = f64::from(i) * 0.01;
            ImuSample { t_s, gyro: Vector3::zeros(), accel: force(t_s), temperature_degc: None }
        };
        ForceRates::new(&(0..200).map(sample).collect::<Vec<_>>(), SampleKind::Point)
    }

    proptest::proptest! {
        /// However unevenly the samples came, and before the first and after the last.
        #[test]
        fn the_next_sample_is_found(steps in proptest::collection::vec(0.0..5.0f64, 0..60), at in -1.0..2.0f64) {
            let times_s: Vec<f64> =
                steps.iter().scan(3.0, |t, step| { *t += step.powi(4); Some(*t) }).collect();
            let [first, last] = [times_s.first(), times_s.last()].map(|t| t.copied().unwrap_or(3.0));
            let times = Times::new(times_s);
            let on_samples = times.times_s.iter().copied();
            for t_s in on_samples.chain([first + at * (last - first), f64::NAN]) {
                proptest::prop_assert_eq!(times.next(t_s), times.times_s.partition_point(|t| *t < t_s));
            }
        }
    }

    #[test]
    fn a_ramp_has_its_slope_and_the_ends_have_none() {
        let slope = Vector3::new(1.0, -3.0, 20.0);
        let samples: Vec<ImuSample> = (0..100)
            .map(|i| {
                let t_s = f64::from(i) * 0.02;
                ImuSample { t_s, gyro: Vector3::zeros(), accel: slope * t_s, temperature_degc: None }
            })
            .collect();
        let rates = ForceRates::new(&samples, SampleKind::Point);
        assert!((rates.at(1.003) - slope).norm() < 1e-9, "{}", rates.at(1.003));
        assert_eq!(rates.of_rate_at(1.003), [Vector3::zeros(); 2]);
        assert_eq!(rates.at(0.05), Vector3::zeros());
        assert_eq!(rates.at(3.0), Vector3::zeros());
        assert_eq!(ForceRates::default().at(0.0), Vector3::zeros());
    }

    /// A receiver that interpolates between two epochs 0.2 s apart, in gusts of 3 Hz: a delay moves its velocity by the mean of the accelerations
    /// of both, which is not that of the instant between them.
    #[test]
    fn a_delay_moves_the_velocity_of_a_receiver_that_smooths_by_what_it_smooths() {
        let force = |t: f64| Vector3::new(1.0 + sin(19.0 * t), 0.0, -9.8 + 5.0 * cos(19.0 * t));
        let rates = rates_of(force);
        for t_s in [0.503, 1.1] {
            let mean = (force(t_s - 0.1) + force(t_s + 0.1)) * 0.5;
            let kernel = Kernel { smoothing_s2: 0.5 * 0.1 * 0.1, skew_s3: 0.0 };
            let smoothed = force(t_s) + rates.smoothed(t_s, kernel);
            assert!((smoothed - mean).norm() < 0.05 * (force(t_s) - mean).norm(), "{smoothed} {mean}");
        }
        assert_eq!(rates.smoothed(0.05, Kernel { smoothing_s2: 0.005, skew_s3: 0.0 }), Vector3::zeros());
    }

    /// A receiver that takes three tenths of one epoch and seven of the next, 0.2 s later, or the other way round, in gusts of 3 Hz.
    #[test]
    fn a_receiver_that_interpolates_unevenly_is_known_exactly() {
        let (w, lift) = (19.0, 5.0);
        let force = |t: f64| Vector3::new(0.0, 0.0, lift * cos(w * t));
        let velocity = |t: f64| Vector3::new(0.0, 0.0, lift / w * sin(w * t));
        let rates = rates_of(force);
        for newer in [0.7, 0.3, 0.95] {
            let middle_s = 0.1 * (1.0 - 2.0 * newer);
            let both = |of: &dyn Fn(f64) -> Vector3<f64>, t: f64| {
                of(t + middle_s + 0.1) * newer + of(t + middle_s - 0.1) * (1.0 - newer)
            };
            let smoothing_s2 = 0.5 * (0.01 - middle_s * middle_s);
            let kernel = Kernel { smoothing_s2, skew_s3: smoothing_s2 * middle_s / 1.5 };
            for t_s in [0.503, 0.58, 1.1] {
                let smoothed = rates.at(t_s) * smoothing_s2 + rates.skewed(t_s, kernel) * kernel.skew_s3;
                let off = (velocity(t_s) + smoothed - both(&velocity, t_s)).norm();
                assert!(off < 0.01 * lift / w, "{off}");
                let by_delay = force(t_s) + rates.smoothed(t_s, kernel);
                assert!((by_delay - both(&force, t_s)).norm() < 0.05 * lift, "{by_delay}");
            }
            assert_eq!(rates.skewed(0.05, kernel), Vector3::zeros());
        }
    }

    /// A vehicle that rolls into a turn: the velocity of 0.18 s ago, against the path itself.
    #[test]
    fn the_velocity_of_a_while_ago_is_that_of_the_path() {
        let roll = |t: f64| 0.8 * (1.0 + sin(3.0 * t));
        let velocity = |t: f64| Vector3::new(30.0 + 2.0 * t, 4.0 * sin(2.0 * t), -1.5 * cos(4.0 * t));
        let acceleration = |t: f64| Vector3::new(2.0, 8.0 * cos(2.0 * t), 6.0 * sin(4.0 * t));
        let gravity = Vector3::new(0.0, 0.0, 9.81);
        let c_nb = |t: f64| crate::rotation::c_nb_from_euler(roll(t), 0.0, 0.0);
        let force = |t: f64| c_nb(t).transpose() * (acceleration(t) - gravity);
        let (bias, lag_s) = (Vector3::new(0.3, -0.2, 0.4), 0.18);
        let samples: Vec<ImuSample> = (0..400)
            .map(|i| {
                let t_s = f64::from(i) * 0.005;
                let gyro = Vector3::new(2.4 * cos(3.0 * t_s), 0.0, 0.0);
                ImuSample { t_s, gyro, accel: force(t_s) + bias, temperature_degc: None }
            })
            .collect();
        let rates = ForceRates::new(&samples, SampleKind::Point);
        for t_s in [0.4, 0.9, 1.4] {
            let x = FixInstant {
                t_s,
                a_n: acceleration(t_s),
                smoothed_a_n: acceleration(t_s),
                c_nb: c_nb(t_s),
                ..crate::effects::testing::fix_instant()
            };
            let older = rates.older(lag_s, &x, &(force(t_s) + bias), &force(t_s));
            let exact = velocity(t_s - lag_s) - velocity(t_s);
            assert!((older.change - exact).norm() < 5e-3, "{t_s}: {} {exact}", older.change);
            let off = older.acceleration - acceleration(t_s - lag_s);
            assert!(off.norm() < 0.1, "{t_s}: {off}");
        }
    }

    /// Gyros that are more than a sample late: what the samples show around an instant is the true rate.
    #[test]
    fn a_rate_that_is_late_is_found_among_the_samples() {
        let rate = |t: f64| Vector3::new(0.8 * sin(2.0 * t), 0.0, 0.3 * cos(3.0 * t));
        let slope = |t: f64| Vector3::new(1.6 * cos(2.0 * t), 0.0, -0.9 * sin(3.0 * t));
        let late_s = 0.027;
        let samples: Vec<ImuSample> = (0..300)
            .map(|i| {
                let t_s = f64::from(i) * 0.02;
                ImuSample { t_s, gyro: rate(t_s - late_s), accel: Vector3::zeros(), temperature_degc: None }
            })
            .collect();
        let rates = ForceRates::new(&samples, SampleKind::Point);
        for t_s in [1.0, 2.31, 4.007] {
            let around = rates.around(t_s, late_s);
            assert!((around.late.change - (rate(t_s - late_s) - rate(t_s))).norm() < 2e-3, "{around:?}");
            assert!((around.rate_derivatives[0] - slope(t_s)).norm() < 0.05, "{around:?}");
        }
        // In flight there are only those before.
        let mut recent = Recent::default();
        samples.iter().take_while(|s| s.t_s <= 2.0).for_each(|s| recent.take(s));
        let off = recent.around().rate_derivatives[0] - slope(2.0 - late_s);
        assert!(off.norm() < 0.1, "{off}");
    }
}
