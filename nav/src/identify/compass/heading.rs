//! The heading of a compass against that of the trajectory.

use super::{BLOCK_S, Instant};
use crate::math::{atan2, cos, sin};
use crate::rotation::{euler_from_c_nb, wrap_pi};
use crate::rss;
use nalgebra::{Rotation3, Vector3};

/// Points of a plot.
const POINTS: usize = 400;

/// The heading of a compass, levelled by our roll and pitch and with the declination of the world model, less ours, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heading {
    /// Mean.
    pub mean: f64,
    /// 1-sigma of the mean: by our own heading, and by how the difference scatters.
    pub sigma: f64,
    /// 1-sigma of our own heading alone.
    pub own_sigma: f64,
    /// RMS, the mean included.
    pub rms: f64,
    /// Difference that 95 % stay below.
    pub most: f64,
}

/// The field in level axes (forward, right), T: as reported, as corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// As reported.
    pub reported: [f64; 2],
    /// As corrected.
    pub corrected: [f64; 2],
}

impl Heading {
    pub(super) fn of(instants: &[Instant], field_n: &Vector3<f64>, own_sigma: f64) -> Self {
        let declination = atan2(field_n.y, field_n.x);
        // A field that seems turned to the right is a heading that is too small.
        let off = |i: &Instant| {
            let shown = i.c_nb * i.measured;
            wrap_pi(declination - atan2(shown.y, shown.x))
        };
        let offs: Vec<(f64, f64)> = instants.iter().map(|i| (i.elapsed_s, off(i))).collect();
        let mean = circular(offs.iter().map(|o| o.1));
        let mut sizes: Vec<f64> = offs.iter().map(|o| o.1.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let count = offs.len().max(1) as f64;
        let rms = (sizes.iter().map(|s| s * s).sum::<f64>() / count).sqrt();
        let means: Vec<f64> = offs
            .chunk_by(|a, b| (a.0 / BLOCK_S) as u64 == (b.0 / BLOCK_S) as u64)
            .map(|block| wrap_pi(circular(block.iter().map(|o| o.1)) - mean))
            .collect();
        let blocks = means.len() as f64;
        let scatter = if blocks > 1.0 {
            (means.iter().map(|m| m * m).sum::<f64>() / (blocks - 1.0) / blocks).sqrt()
        } else {
            std::f64::consts::PI
        };
        let most = sizes.get(sizes.len() * 95 / 100).copied().unwrap_or_default();
        Self { mean, sigma: rss(own_sigma, scatter), own_sigma, rms, most }
    }
}

fn circular(angles: impl Iterator<Item = f64>) -> f64 {
    let (s, c) = angles.fold((0.0, 0.0), |(s, c), a| (s + sin(a), c + cos(a)));
    atan2(s, c)
}

/// The horizontal field in the axes of the levelled vehicle, thinned.
pub(super) fn circle(reported: &[Instant], corrected: &[Instant]) -> Vec<Level> {
    let level = |i: &Instant| {
        let angles = euler_from_c_nb(&i.c_nb);
        let shown = Rotation3::from_euler_angles(angles.x, angles.y, 0.0) * i.measured;
        [shown.x, shown.y]
    };
    let every = reported.len().div_ceil(POINTS).max(1);
    let both = reported.iter().zip(corrected).step_by(every);
    both.map(|(r, c)| Level { reported: level(r), corrected: level(c) }).collect()
}
