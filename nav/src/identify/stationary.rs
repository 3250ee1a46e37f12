//! Whether a recording shows a vehicle that stands: neither its fixes nor its samples know any motion. A multirotor that hovers has slow
//! fixes, but it turns and sways; a unit that is turned by hand does not go anywhere at all.

use super::statistics;
use crate::earth::Geodetic;
use crate::rss;
use crate::sample::{FixVelocity, GnssFix, ImuSample};
use nalgebra::Vector3;

/// A vehicle whose fixes are slower than this nine times in ten is slow, m/s …
const SLOW_M_PER_S: f64 = 1.0;
/// … as is one whose fixes without velocities stay this near to the first, m.
const NEAR_M: f64 = 30.0;
/// Samples are averaged over this time, s.
const BLOCK_S: f64 = 1.0;
/// Rates of a stand are compared with so many blocks before and after: biases of sensors that warm up change more slowly.
const NEIGHBOURS: usize = 10;
/// Mean rate, rad/s, and specific force, m/s², that differ by more show motion, as for the filter's stationarity
/// (`filter/aid/stationarity/detector`). On recorded flights nine blocks in ten of a stand differ by at most 3e-4 and 0.01.
const LIMIT: (f64, f64) = (5e-3, 0.15);
/// Mean rate that no bias explains, rad/s.
const TURNING: f64 = 0.1;
/// Differences of a stand are smaller than so many sigmas of the noise.
const SIGMAS: f64 = 5.0;
/// Share of the blocks, or of the fixes, that may move all the same: somebody carried the vehicle or bumped into it.
const SHARE: f64 = 0.1;

/// Whether the vehicle stands, by samples in order of time with this noise (variance per hertz of gyros and accelerometers) and fixes.
pub(super) fn stands(samples: &[ImuSample], fixes: &[GnssFix], noise: (f64, f64)) -> bool {
    is_slow(fixes) && is_still(samples, noise)
}

fn is_slow(fixes: &[GnssFix]) -> bool {
    let speed = |f: &GnssFix| match f.velocity {
        FixVelocity::None => None,
        FixVelocity::Horizontal([n, e]) => Some(rss(n, e)),
        FixVelocity::Full(v) => Some(Vector3::from(v).norm()),
    };
    let speeds: Vec<f64> = fixes.iter().filter_map(speed).collect();
    if speeds.is_empty() {
        let place = |p: &Geodetic| p.to_ecef();
        let first = fixes.first().map(|f| place(&f.position));
        return first.is_none_or(|first| fixes.iter().all(|f| (place(&f.position) - first).norm() < NEAR_M));
    }
    let fast = speeds.iter().filter(|v| **v >= SLOW_M_PER_S).count();
    fast as f64 <= SHARE * speeds.len() as f64
}

fn is_still(samples: &[ImuSample], noise: (f64, f64)) -> bool {
    let blocks = means(samples);
    let limits = [(LIMIT.0, noise.0), (LIMIT.1, noise.1)]
        .map(|(limit, variance)| limit.max(SIGMAS * (variance / BLOCK_S).sqrt()));
    let usual_force = median(&blocks, |b| b.1);
    let moves = |k: usize| {
        let (rate, force) = blocks[k];
        let near = &blocks[k.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS + 1).min(blocks.len())];
        rate.norm() > TURNING
            || (rate - median(near, |b| b.0)).amax() > limits[0]
            || (force - usual_force).amax() > limits[1]
    };
    let moving = (0..blocks.len()).filter(|k| moves(*k)).count();
    moving as f64 <= SHARE * blocks.len() as f64
}

/// Rate and specific force.
pub(super) type Block = (Vector3<f64>, Vector3<f64>);

pub(super) fn means(samples: &[ImuSample]) -> Vec<Block> {
    let Some(first) = samples.first() else { return Vec::new() };
    let block = |s: &ImuSample| ((s.t_s - first.t_s) / BLOCK_S).floor();
    let mean = |chunk: &[ImuSample]| {
        let sum = chunk
            .iter()
            .fold((Vector3::zeros(), Vector3::zeros()), |sum, s| (sum.0 + s.gyro, sum.1 + s.accel));
        (sum.0 / chunk.len() as f64, sum.1 / chunk.len() as f64)
    };
    samples.chunk_by(|a, b| block(a) == block(b)).map(mean).collect()
}

/// Axis by axis.
fn median(blocks: &[Block], of: impl Fn(&Block) -> Vector3<f64>) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| statistics::median(blocks.iter().map(|b| of(b)[axis])).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;

    /// Ten minutes at 50 Hz, whose gyros drift as in the simulation of ArduPilot (0.05 deg/s per minute) and whose receiver is noisy.
    fn recorded(sway: f64) -> (Vec<ImuSample>, Vec<GnssFix>) {
        let sample = |k: u32| {
            let t_s = f64::from(k) * 0.02;
            let noise = 2e-3 * sin(f64::from(k) * 12.9898);
            let rate = Vector3::new(sway * sin(0.9 * t_s), sway * cos(1.3 * t_s), 0.0);
            let drift = (0.05_f64 / 60.0).to_radians() * t_s;
            let gyro = rate + Vector3::repeat(noise + drift + 0.01);
            ImuSample {
                t_s,
                gyro,
                accel: Vector3::new(0.1, 0.0, -9.8 + 10.0 * noise),
                temperature_degc: None,
            }
        };
        let fix = |k: u32| GnssFix {
            t_s: f64::from(k) * 0.2,
            position: Geodetic::from_degrees(47.0, 8.0, 500.0),
            velocity: FixVelocity::Horizontal([0.4 * sin(f64::from(k) * 0.7), 0.4]),
            position_sigma_m: None,
            velocity_sigma_m_per_s: None,
            yaw_rad: None,
        };
        ((0..30_000).map(sample).collect(), (0..3000).map(fix).collect())
    }

    const NOISE: (f64, f64) = (4e-8, 4e-6);

    #[test]
    fn a_drifting_sensor_on_the_bench_stands() {
        let (samples, fixes) = recorded(0.0);
        assert!(stands(&samples, &fixes, NOISE));
    }

    /// A multirotor that sways by a degree.
    #[test]
    fn a_hover_below_walking_pace_is_flight() {
        let (samples, fixes) = recorded(0.02);
        assert!(is_slow(&fixes));
        assert!(!stands(&samples, &fixes, NOISE));
    }

    #[test]
    fn noise_is_no_motion() {
        let (mut samples, fixes) = recorded(0.0);
        let noise = |k: usize| 0.05 * sin(k as f64 * 78.233 + (k as f64).sqrt());
        samples.iter_mut().enumerate().for_each(|(k, s)| s.gyro.x += noise(k / 50));
        assert!(!stands(&samples, &fixes, NOISE));
        assert!(stands(&samples, &fixes, (4e-3, 4e-6)), "noise of 0.06 rad/s in one second");
    }

    /// Held in one attitude for half the time and in another for the rest.
    #[test]
    fn a_unit_that_was_turned_by_hand_moves() {
        let (mut samples, fixes) = recorded(0.0);
        let half = samples.len() / 2;
        samples[half..].iter_mut().for_each(|s| s.accel = Vector3::new(0.0, 9.8, 0.0));
        assert!(!stands(&samples, &fixes, NOISE));
    }

    #[test]
    fn nothing_at_all_stands() {
        assert!(stands(&[], &[], NOISE));
    }
}
