//! Is the vehicle stationary? Decided by the statistics of samples and fixes, with hysteresis.
//!
//! Zero-velocity detectors compare scatter and mean of the inertial samples with what their noise allows (Skog, Händel,
//! Nilsson & Rantakokko 2010, "Zero-velocity detection: an algorithm evaluation"). A smooth cruise looks the same to them, so
//! the fixes must say zero too. One moving sample ends it.

use crate::model::ImuModel;
use crate::rss;
use crate::sample::{FixVelocity, GnssFix, ImuSample};
use nalgebra::Vector3;

/// Samples are judged in blocks of this length, s.
const BLOCK_S: f64 = 0.5;
/// So many quiet blocks in a row make a stationary vehicle.
const BLOCKS: u32 = 8;
/// The mean that blocks are compared with fades over this time, s: a warming sensor is no motion.
const REFERENCE_S: f64 = 10.0;
/// Scatter within a block up to so many times the variance of the noise is noise.
const SCATTER: f64 = 3.0;
/// Means that differ by so many of their sigmas differ.
const MEAN_SIGMAS: f64 = 5.0;
/// A single sample this many sigmas off is motion.
const SAMPLE_SIGMAS: f64 = 6.5;
/// Means are compared only where noise leaves them better than this: rate, rad/s, and specific force, m/s². A hovering
/// multirotor turns and sways by more; the standard model's accelerometers leave 0.11.
const MEAN_LIMIT: (f64, f64) = (5e-3, 0.15);
/// Rate, rad/s, and distance of the specific force from gravity, m/s², of a stationary vehicle with large biases.
const AT_REST: (f64, f64) = (0.1, 1.0);
/// Speed of the fixes of a stationary vehicle, in their sigmas and at least, m/s.
const SPEED: (f64, f64) = (5.0, 0.3);
/// Fixes must have said zero within this time before it begins, s.
const FIX_AGE_S: f64 = 3.0;

/// Noise of one sample, variances of rate, (rad/s)², and specific force, (m/s²)².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SampleNoise {
    pub(crate) rate: f64,
    pub(crate) force: f64,
    /// The same without vibration.
    pub(crate) least: [f64; 2],
}

impl SampleNoise {
    /// What white noise (`extra`: of vibration, per hertz) and rounding leave in one sample.
    pub(crate) fn of(imu: &ImuModel, extra: (f64, f64), rounding: [Vector3<f64>; 2], dt: f64) -> Self {
        let of = |n: f64, extra: f64, rounding: f64| (n * n + extra) / dt + 3.0 * rounding;
        let [gyro, accel] = rounding.map(|r| r.max());
        Self {
            rate: of(imu.gyro_noise, extra.0, gyro),
            force: of(imu.accel_noise, extra.1, accel),
            least: [of(imu.gyro_noise, 0.0, gyro), of(imu.accel_noise, 0.0, accel)],
        }
    }
}

/// Sums over one block.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    from_s: f64,
    n: f64,
    sum: [Vector3<f64>; 2],
    squares: [Vector3<f64>; 2],
}

/// The detector.
#[derive(Debug, Clone, Default)]
pub(crate) struct Detector {
    block: Option<Block>,
    /// Mean that blocks are compared with, and over what time it was taken, s.
    reference: Option<([Vector3<f64>; 2], f64)>,
    quiet: u32,
    last_s: Option<f64>,
    zero_speed_s: Option<f64>,
    stationary: bool,
}

impl Detector {
    pub(crate) fn is_stationary(&self) -> bool {
        self.stationary
    }

    /// Nothing quiet has been seen yet.
    pub(crate) fn start_over(&mut self) {
        *self = Self { zero_speed_s: self.zero_speed_s, last_s: self.last_s, ..Self::default() };
    }

    /// Takes a fix and says whether the vehicle moves by it.
    pub(crate) fn push_fix(&mut self, fix: &GnssFix, velocity_sigma: [f64; 3]) {
        let sigma = fix.velocity_sigma_m_per_s.unwrap_or(velocity_sigma);
        let limit = |s: f64| (SPEED.0 * s).max(SPEED.1);
        let zero = match fix.velocity {
            FixVelocity::None => return,
            FixVelocity::Horizontal([n, e]) => rss(n, e) < limit(sigma[0].max(sigma[1])),
            FixVelocity::Full([n, e, d]) => {
                rss(n, e) < limit(sigma[0].max(sigma[1])) && d.abs() < limit(sigma[2])
            }
        };
        if zero {
            self.zero_speed_s = Some(fix.t_s);
        } else {
            self.zero_speed_s = None;
            self.start_over();
        }
    }

    /// Takes a sample.
    pub(crate) fn push_imu(&mut self, sample: &ImuSample, noise: &SampleNoise) {
        let gap = self.last_s.replace(sample.t_s).is_some_and(|last| sample.t_s - last > BLOCK_S);
        if gap || self.moves(sample, noise) {
            self.start_over();
        }
        let block = self.block.get_or_insert_with(|| Block { from_s: sample.t_s, ..Block::default() });
        if sample.t_s - block.from_s >= BLOCK_S && block.n > 0.0 {
            let (done, length_s) = (*block, sample.t_s - block.from_s);
            self.block = Some(Block { from_s: sample.t_s, ..Block::default() });
            self.judge(&done, length_s, noise, sample.t_s);
        }
        if let Some(block) = &mut self.block {
            block.n += 1.0;
            for (k, v) in [sample.gyro, sample.accel].into_iter().enumerate() {
                block.sum[k] += v;
                block.squares[k] += v.component_mul(&v);
            }
        }
    }

    /// Whether one sample alone shows motion.
    fn moves(&self, sample: &ImuSample, noise: &SampleNoise) -> bool {
        let Some((reference, _)) = &self.reference else { return false };
        let far = |v: &Vector3<f64>, mean: &Vector3<f64>, variance: f64| {
            (v - mean).iter().any(|d| d * d > SAMPLE_SIGMAS * SAMPLE_SIGMAS * variance)
        };
        far(&sample.gyro, &reference[0], noise.rate) || far(&sample.accel, &reference[1], noise.force)
    }

    fn judge(&mut self, block: &Block, length_s: f64, noise: &SampleNoise, now_s: f64) {
        let mean = block.sum.map(|s| s / block.n);
        let variances = [noise.rate, noise.force];
        // Differences from the block's mean; small sums of squares cancel, so from the reference's frame.
        let spread = [0, 1].map(|k| block.squares[k] / block.n - mean[k].component_mul(&mean[k]));
        let scatters =
            block.n >= 10.0 && (0..2).any(|k| spread[k].iter().any(|v| *v > SCATTER * variances[k]));
        // What is known of vibration remembers the motion before: a vehicle that was put down by hand is as quiet as this block is. Without that it took 3 to 18 s
        // until it was seen to be at rest, by how much the hands had shaken it (independent recordings, 2026-11-30).
        let variances = [0, 1].map(|k| variances[k].min(spread[k].max().max(noise.least[k])));
        let gravity = crate::earth::STANDARD_GRAVITY;
        let rests = mean[0].norm() < AT_REST.0 && (mean[1].norm() - gravity).abs() < AT_REST.1;
        let differs = self.reference.as_ref().is_some_and(|(reference, over_s)| {
            (0..2).any(|k| {
                let variance = variances[k] / block.n * (1.0 + length_s / over_s);
                (mean[k] - reference[k]).iter().any(|d| d * d > MEAN_SIGMAS * MEAN_SIGMAS * variance)
            })
        });
        let limits = [MEAN_LIMIT.0, MEAN_LIMIT.1];
        let blurred = (0..2).any(|k| MEAN_SIGMAS * (variances[k] / block.n).sqrt() > limits[k]);
        if scatters || differs || blurred || !rests {
            self.start_over();
            return;
        }
        let (reference, over_s) = self.reference.get_or_insert((mean, 0.0));
        let share = length_s / (*over_s + length_s);
        (0..2).for_each(|k| reference[k] += (mean[k] - reference[k]) * share);
        *over_s = (*over_s + length_s).min(REFERENCE_S);
        self.quiet += 1;
        let still = self.zero_speed_s.is_some_and(|t| now_s - t < FIX_AGE_S);
        self.stationary = self.stationary || (self.quiet >= BLOCKS && still);
    }
}

#[cfg(test)]
mod tests {
    use crate::math::sin;

    use super::*;
    use crate::earth::{Geodetic, STANDARD_GRAVITY};
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand_distr::{Distribution, StandardNormal};

    const NOISE: SampleNoise = SampleNoise { rate: 1.5e-6, force: 2e-3, least: [1.5e-6, 2e-3] };

    fn fix(t_s: f64, north: f64) -> GnssFix {
        GnssFix {
            t_s,
            position: Geodetic::from_degrees(47.0, 8.0, 400.0),
            velocity: FixVelocity::Horizontal([north, 0.0]),
            position_sigma_m: None,
            velocity_sigma_m_per_s: None,
            yaw_rad: None,
        }
    }

    /// Runs 60 s at 50 Hz and returns since when it is called stationary at the end, and how often that began.
    fn run(speed: f64, rate: impl Fn(f64) -> f64) -> (Option<f64>, u32) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut normal =
            |sigma: f64| sigma * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let mut detector = Detector::default();
        let (mut since, mut times) = (None, 0);
        for i in 0..3000 {
            let t_s = f64::from(i) * 0.02;
            if i % 10 == 0 {
                detector.push_fix(&fix(t_s, speed), [0.1, 0.1, 0.2]);
            }
            let gyro = Vector3::from_fn(|_, _| normal(NOISE.rate.sqrt())) + Vector3::z() * rate(t_s);
            let accel = Vector3::from_fn(|_, _| normal(NOISE.force.sqrt())) - Vector3::z() * STANDARD_GRAVITY;
            detector.push_imu(&ImuSample { t_s, gyro, accel, temperature_degc: None }, &NOISE);
            match (detector.is_stationary(), since) {
                (true, None) => (since, times) = (Some(t_s), times + 1),
                (false, _) => since = None,
                _ => {}
            }
        }
        (since, times)
    }

    #[test]
    fn a_vehicle_at_rest_is_recognised_once_within_seconds() {
        let (since, times) = run(0.0, |_| 0.01);
        assert!(since.is_some_and(|s| s < 6.0), "{since:?}");
        assert_eq!(times, 1);
    }

    #[test]
    fn a_smooth_cruise_is_not_stationary() {
        assert_eq!(run(20.0, |_| 0.0), (None, 0));
    }

    #[test]
    fn a_sway_of_a_hovering_vehicle_is_not_stationary() {
        assert_eq!(run(0.0, |t| 0.01 * sin(2.0 * t)), (None, 0));
    }

    #[test]
    fn a_turn_ends_it_within_a_second() {
        let turning = |from_s: f64| move |t: f64| if t > from_s { 0.004 } else { 0.0 };
        let (since, _) = run(0.0, turning(59.2));
        assert_eq!(since, None);
    }
}
