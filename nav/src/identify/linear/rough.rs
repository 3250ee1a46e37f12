//! What interpolation between samples misses where none is lost: a vehicle that turns faster than its samples follow.
//!
//! A pitch of 4 rad/s that a copter begins and ends within 0.1 s leaves 15 to 29 mrad for good when it is sampled every 40 ms (ArduPilot's simulation, four
//! logs with truth), and one such event was named as a formula with 30 to 131 nats. What half of the samples would have missed is known at every sample, and
//! how that grows with the interval (from a quarter of them to half) says what all of them miss (Richardson's extrapolation, for variances). White noise, which the sensors
//! and vibration have all the time, is taken off by its median: the model has it already.

use crate::identify::statistics::median;
use crate::sample::{ImuSample, SampleKind};
use nalgebra::Vector3;

/// Median of the mean of three squares of standard normal variables.
const MEDIAN: f64 = 0.789;
/// A step counts where its mean square is so many times that of white noise, which noise does not come to in a thousand hours; the maneuver above has 10⁶ and more …
const BEYOND_NOISE: f64 = 25.0;
/// … and its error by this much, rad and m/s: a tenth of a milliradian a sample.
const LEAST: [f64; 2] = [1e-4, 2e-3];
/// Mean squares over so many samples before and after.
const AROUND: usize = 1;

/// A step between two samples, and the variances of what is missed in it: attitude, rad², and velocity, (m/s)², in body axes.
pub(super) struct Step {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) missed: [Vector3<f64>; 2],
}

/// The steps of samples in order of time that miss something, where they are points.
pub(super) fn steps(samples: &[ImuSample], kind: SampleKind, usual_s: f64, hole_s: f64) -> Vec<Step> {
    if kind != SampleKind::Point || usual_s <= 0.0 {
        return Vec::new();
    }
    let of = [
        of_sensor(samples, |s| s.gyro, (usual_s, hole_s), LEAST[0]),
        of_sensor(samples, |s| s.accel, (usual_s, hole_s), LEAST[1]),
    ];
    let step = |(k, pair): (usize, &[ImuSample])| {
        let missed = [0, 1].map(|sensor: usize| of[sensor].get(k).copied().unwrap_or_default());
        let is_whole = pair[1].t_s - pair[0].t_s <= hole_s;
        (is_whole && missed != [Vector3::zeros(); 2]).then(|| Step {
            from_s: pair[0].t_s,
            to_s: pair[1].t_s,
            missed,
        })
    };
    samples.windows(2).enumerate().filter_map(step).collect()
}

/// Squares of what the sum over `2 · every` intervals misses when every second of three samples is left out, sample by sample; zero where samples are lost.
fn squares(
    samples: &[ImuSample],
    of: impl Fn(&ImuSample) -> Vector3<f64>,
    every: usize,
    (usual_s, hole_s): (f64, f64),
) -> Vec<Option<Vector3<f64>>> {
    let one = |k: usize| {
        let (before, here, after) =
            (samples.get(k.checked_sub(every)?)?, &samples[k], samples.get(k + every)?);
        let most_s = every as f64 * usual_s + (hole_s - usual_s);
        let is_whole = here.t_s - before.t_s <= most_s && after.t_s - here.t_s <= most_s;
        let bend = of(before) - of(here) * 2.0 + of(after);
        is_whole.then(|| (bend * (0.5 * every as f64 * usual_s)).map(|v| v * v))
    };
    (0..samples.len()).map(one).collect()
}

/// White noise in squares, mean over the axes: by the median.
fn noise(squares: &[Option<Vector3<f64>>]) -> f64 {
    median(squares.iter().flatten().map(|v| v.sum() / 3.0)).map_or(0.0, |m| m / MEDIAN)
}

/// Variances of what one sensor misses in the step after each sample.
fn of_sensor(
    samples: &[ImuSample],
    of: impl Fn(&ImuSample) -> Vector3<f64>,
    spacing: (f64, f64),
    least: f64,
) -> Vec<Vector3<f64>> {
    let [half, quarter] = [1, 2].map(|every| squares(samples, &of, every, spacing));
    let [of_half, of_quarter] = [noise(&half), noise(&quarter)];
    let counts = |v: &Vector3<f64>| v.sum() / 3.0 > (BEYOND_NOISE * of_half).max(least * least);
    let (mut fine, mut coarse) = (0.0, 0.0);
    for (a, b) in half.iter().zip(&quarter) {
        if let (Some(a), Some(b)) = (a.filter(counts), b) {
            fine += (a.sum() / 3.0 - of_half).max(0.0);
            coarse += (b.sum() / 3.0 - of_quarter).max(0.0);
        }
    }
    if fine <= 0.0 {
        return Vec::new();
    }
    // Per second, half of the samples miss this share of what a quarter of them misses; all of them, of what half of them misses.
    let share = if coarse > 0.0 { (2.0 * fine / coarse).min(1.0) } else { 1.0 };
    let local = |k: usize| {
        let some = half.get(k.saturating_sub(AROUND)..(k + 2 + AROUND).min(half.len())).unwrap_or_default();
        let sum: Vector3<f64> = some.iter().flatten().sum();
        let mean = sum / some.iter().flatten().count().max(1) as f64;
        if counts(&mean) { mean.map(|v| 0.5 * share * (v - of_half).max(0.0)) } else { Vector3::zeros() }
    };
    (0..samples.len()).map(local).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{cos, sin};
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    /// A vehicle that pitches slowly, and by 0.2 rad within a tenth of a second at 20.07 s, sampled so often and with this noise.
    fn sampled(hz: f64, noise: f64) -> Vec<ImuSample> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut normal = || noise * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let one = |k: usize| {
            let t_s = k as f64 / hz;
            let phase = ((t_s - 20.07) / 0.1).clamp(0.0, 1.0);
            let pitch = 0.1 * sin(0.5 * t_s) + 2.0 * (1.0 - cos(phase * std::f64::consts::TAU));
            let gyro = Vector3::new(normal(), pitch + normal(), normal());
            ImuSample { t_s, gyro, accel: Vector3::z() * -9.8, temperature_degc: None }
        };
        (0..(40.0 * hz) as usize).map(one).collect()
    }

    fn found(hz: f64, noise: f64) -> Vec<Step> {
        steps(&sampled(hz, noise), SampleKind::Point, 1.0 / hz, 1.75 / hz)
    }

    #[test]
    fn what_is_too_quick_for_the_samples_is_missed_there_and_nowhere_else() {
        let steps = found(25.0, 1e-3);
        assert!(!steps.is_empty() && steps.iter().all(|s| s.to_s > 19.9 && s.from_s < 20.35));
        // Interpolation says 0.2 rad less or more.
        let samples = sampled(25.0, 0.0);
        let seen: f64 = samples.windows(2).map(|w| 0.5 * (w[0].gyro.y + w[1].gyro.y) / 25.0).sum();
        let fine: f64 =
            sampled(2500.0, 0.0).windows(2).map(|w| 0.5 * (w[0].gyro.y + w[1].gyro.y) / 2500.0).sum();
        let sigma = steps.iter().map(|s| s.missed[0].y).sum::<f64>().sqrt();
        let missed = (seen - fine).abs();
        assert!(missed > 5e-3 && missed < 3.0 * sigma && sigma < 30.0 * missed, "{missed} with {sigma}");
        assert!(steps.iter().all(|s| s.missed[1] == Vector3::zeros()));
    }

    #[test]
    fn a_motion_that_the_samples_follow_and_noise_miss_nothing() {
        assert!(found(400.0, 0.0).is_empty());
        // Noise alone, without the pulse.
        let quiet: Vec<ImuSample> = sampled(25.0, 0.02).into_iter().filter(|s| s.t_s < 19.0).collect();
        let few = steps(&quiet, SampleKind::Point, 0.04, 0.07).len();
        assert!(few <= quiet.len() / 50, "{few} of {}", quiet.len());
        assert!(steps(&sampled(25.0, 0.0), SampleKind::IntervalMean, 0.04, 0.07).is_empty());
    }
}
