//! Noise that is no effect: fitted by the likelihood of the innovations, for every model alike.
//!
//! White noise of the inertial samples (vibration adds to it), of positions and velocities, the first-order
//! Gauss-Markov error of positions, and the scatter of the fixes' time stamps.

mod fit;

use super::flight::Flight;
use super::linear::Problem;
use super::pass::Options;
use super::statistics::median;
use super::{Workers, map};
use crate::math::{exp, ln};
use crate::model::Model;
use crate::rss;
use fit::slope;
use serde::Serialize;

pub use fit::{Fitted, Metric, fit};

/// The noise of one vehicle and receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Gyros, rad/s/√Hz.
    pub gyro: f64,
    /// Accelerometers, m/s²/√Hz.
    pub accel: f64,
    /// Factor on the sigmas of horizontal positions, the fix's own or the model's.
    pub position_scale: f64,
    /// Factor on the sigmas of heights.
    pub height_scale: f64,
    /// Factor on the sigmas of velocities.
    pub velocity_scale: f64,
    /// Gauss-Markov error of horizontal positions, stationary 1-sigma, m.
    pub gauss_markov_m: f64,
    /// Correlation time of the Gauss-Markov error, s.
    pub correlation_s: f64,
    /// Scatter of the fixes' time stamps, s.
    pub stamp_s: f64,
}

/// Number of figures.
pub const FIGURES: usize = 8;
/// Which figure stands where.
pub mod figure {
    /// Gyros.
    pub const GYRO: usize = 0;
    /// Accelerometers.
    pub const ACCEL: usize = 1;
    /// Horizontal positions.
    pub const POSITION: usize = 2;
    /// Heights.
    pub const HEIGHT: usize = 3;
    /// Velocities.
    pub const VELOCITY: usize = 4;
    /// Size of the Gauss-Markov error.
    pub const GAUSS_MARKOV: usize = 5;
    /// Its correlation time.
    pub const CORRELATION: usize = 6;
    /// Stamps.
    pub const STAMP: usize = 7;
}
/// Noise of the inertial samples may exceed what they show from sample to sample, or the model says, by this factor …
const INERTIAL_ABOVE: f64 = 3.0;
/// … and fall short of it by this one.
const INERTIAL_BELOW: f64 = 8.0;
/// White noise of the fixes as a factor on what they or the model claim. A receiver that is off by more is an effect's doing.
const CLAIMED: (f64, f64) = (0.05, 5.0);
/// However good fixes are, the model is not: sub-sample delays and filters leave centimetres. White noise is not fitted
/// below this, m and m/s.
const MODEL_FLOOR: (f64, f64) = (0.15, 0.04);
/// The Gauss-Markov error of positions is metres …
const GAUSS_MARKOV_M: (f64, f64) = (0.02, 4.0);
/// … and stays for tens of seconds to minutes; anything quicker is motion that the model does not explain.
const CORRELATION_S: (f64, f64) = (20.0, 300.0);

/// Stamps scatter by a loop of the autopilot: milliseconds.
const STAMP_S: (f64, f64) = (0.001, 0.02);

/// Limits of each figure: noise must not be able to pass for whatever is missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits([(f64, f64); FIGURES]);

impl Limits {
    /// Of a vehicle whose model is assumed to be about this.
    pub fn new(model: &Model, flights: &[&Flight]) -> Self {
        Self(Claims::new(model, flights).limits())
    }

    /// The nearest noise within the limits.
    fn within(&self, noise: &Noise) -> Noise {
        let v = noise.get();
        Noise::from_figures(&std::array::from_fn(|k| v[k].clamp(self.0[k].0, self.0[k].1)))
    }

    fn clamp(&self, at: &[f64; FIGURES]) -> [f64; FIGURES] {
        std::array::from_fn(|k| at[k].clamp(ln(self.0[k].0), ln(self.0[k].1)))
    }

    /// Which figures may move uphill.
    fn free(&self, at: &[f64; FIGURES], slope: &[f64; FIGURES]) -> [bool; FIGURES] {
        std::array::from_fn(|k| {
            let (low, high) = (ln(self.0[k].0) + 1e-9, ln(self.0[k].1) - 1e-9);
            !(at[k] <= low && slope[k] < 0.0 || at[k] >= high && slope[k] > 0.0)
        })
    }
}

/// What the model, the samples and the receiver say of the noise before anything is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Claims {
    start: Noise,
    /// Sigmas of horizontal positions, heights and velocities, those of the fixes where they have any, m and m/s.
    position: f64,
    height: f64,
    velocity: f64,
    /// What a unit at rest showed: its noise is no less ([`at_rest`]).
    least: [f64; 2],
}

impl Claims {
    /// Of these flights.
    pub fn new(model: &Model, flights: &[&Flight]) -> Self {
        let middle = |claim: &dyn Fn(&crate::sample::GnssFix) -> f64| {
            median(flights.iter().flat_map(|f| f.received()).map(claim)).unwrap_or(1.0).max(1e-3)
        };
        let gnss = &model.gnss;
        Self {
            start: Noise::measured(model, flights),
            position: middle(&|f| f.position_sigma_m.unwrap_or(gnss.position_sigma_m)[0]),
            height: middle(&|f| f.position_sigma_m.unwrap_or(gnss.position_sigma_m)[2]),
            velocity: middle(&|f| f.velocity_sigma_m_per_s.unwrap_or(gnss.velocity_sigma_m_per_s)[0]),
            least: at_rest(model, flights),
        }
    }

    /// By how much each of gyro noise, accelerometer noise, GNSS position (white and Gauss-Markov error together) and GNSS velocity exceeds
    /// what was claimed, as factors.
    fn growth(&self, noise: &Noise) -> [f64; 4] {
        let own = &self.start;
        // Claims below what any model leaves are not held against the receiver.
        let total = |claimed: f64, scale: f64, floor: f64, gauss_markov: f64| {
            rss(claimed * scale, gauss_markov * noise.gauss_markov_m)
                / rss(claimed.max(floor), gauss_markov * own.gauss_markov_m)
        };
        let position = total(self.position, noise.position_scale, MODEL_FLOOR.0, 1.0);
        let height = total(self.height, noise.height_scale, MODEL_FLOOR.0, HEIGHT_GAUSS_MARKOV);
        let velocity = self.velocity * noise.velocity_scale / self.velocity.max(MODEL_FLOOR.1);
        [noise.gyro / own.gyro, noise.accel / own.accel, position.max(height), velocity]
    }

    /// Whether the noise has grown so far that it may stand for something else.
    pub(super) fn has_grown(&self, noise: &Noise) -> bool {
        self.growth(noise).iter().zip(GROWN).any(|(growth, most)| *growth > most)
    }

    /// Which of it a sensor that does what was claimed can have.
    fn plausible(&self, noise: &Noise) -> [bool; 4] {
        let growth = self.growth(noise);
        std::array::from_fn(|k| growth[k] < PLAUSIBLE[k])
    }

    /// Whether a sensor that does what was claimed cannot have it.
    pub(super) fn is_implausible(&self, noise: &Noise) -> bool {
        self.plausible(noise).contains(&false)
    }

    /// Limits within which noise is no larger than claimed.
    pub(super) fn held(&self, limits: &Limits) -> Limits {
        let claimed = self.start.get();
        let at_most = |k: usize| claimed[k].clamp(limits.0[k].0, limits.0[k].1);
        let held =
            |k: usize| if k == figure::CORRELATION { limits.0[k] } else { (limits.0[k].0, at_most(k)) };
        Limits(std::array::from_fn(held))
    }

    fn limits(&self) -> [(f64, f64); FIGURES] {
        let around = |v: f64, least: f64| (least.max(v / INERTIAL_BELOW), v * INERTIAL_ABOVE);
        let above = |floor: f64, claimed: f64| {
            let low = CLAIMED.0.max(floor / claimed);
            (low, CLAIMED.1.max(2.0 * low))
        };
        [
            around(self.start.gyro, self.least[0]),
            around(self.start.accel, self.least[1]),
            above(MODEL_FLOOR.0, self.position),
            above(MODEL_FLOOR.0, self.height),
            above(MODEL_FLOOR.1, self.velocity),
            GAUSS_MARKOV_M,
            CORRELATION_S,
            STAMP_S,
        ]
    }

    /// Every figure as it was claimed and as the flights have it.
    pub(super) fn entries(
        &self,
        problems: &[Problem],
        noise: &Noise,
        limits: &Limits,
        options: &Options,
        workers: &dyn Workers,
    ) -> Vec<NoiseEntry> {
        let sigmas = sigmas(problems, noise, limits, options, workers);
        let plausible = self.plausible(noise);
        let deg = 1f64.to_radians();
        let (start, v) = (self.start.get(), noise.get());
        let table = [
            ("gyro", "deg/s/√Hz", figure::GYRO, deg.recip(), 0),
            ("accel", "m/s²/√Hz", figure::ACCEL, 1.0, 1),
            ("gnss_position", "m", figure::POSITION, self.position, 2),
            ("gnss_height", "m", figure::HEIGHT, self.height, 2),
            ("gnss_position_wander", "m", figure::GAUSS_MARKOV, 1.0, 2),
            ("gnss_position_correlation", "s", figure::CORRELATION, 1.0, FINDINGS.len()),
            ("gnss_velocity", "m/s", figure::VELOCITY, self.velocity, 3),
            ("gnss_stamp", "s", figure::STAMP, 1.0, FINDINGS.len()),
        ];
        table
            .into_iter()
            .map(|(name, unit, k, size, group)| NoiseEntry {
                name,
                unit,
                assumed: start[k] * size,
                fitted: v[k] * size,
                sigma: v[k] * size * sigmas[k],
                plausible: plausible.get(group).copied().unwrap_or(true),
                finding: FINDINGS.get(group).copied().filter(|_| !plausible[group]),
            })
            .collect()
    }
}

/// One figure of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoiseEntry {
    /// `gnss_position`.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// As model, samples or receiver claim.
    pub assumed: f64,
    /// As the flights have it.
    pub fitted: f64,
    /// 1-sigma of that.
    pub sigma: f64,
    /// Whether a sensor that does what was claimed can have it.
    pub plausible: bool,
    /// `gnss_position_noise`, where it is not plausible.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finding: Option<&'static str>,
}

/// What noise that is not plausible is called: gyros, accelerometers, positions, velocities.
const FINDINGS: [&str; 4] = ["gyro_noise", "accel_noise", "gnss_position_noise", "gnss_velocity_noise"];
/// Noise beyond these multiples of what was claimed is not plausible. That of the samples is fitted to up to three times what
/// they show; receivers are right about their errors within a factor of two or so.
const PLAUSIBLE: [f64; 4] = [2.95, 2.95, 2.4, 3.0];
/// From these multiples on noise may stand for an effect, which is then looked for with the noise as claimed, too.
const GROWN: [f64; 4] = [2.0, 2.0, 1.6, 1.6];
/// Curvature is measured over this change of a logarithm.
const CURVED_OVER: f64 = 0.1;
/// No figure of the noise is assumed to be known worse than this, as a logarithm.
const UNKNOWN_FIGURE: f64 = 1.0;

/// 1-sigma of the logarithm of each figure, by the curvature of the likelihood (all figures together; those at a limit alone).
fn sigmas(
    problems: &[Problem],
    noise: &Noise,
    limits: &Limits,
    options: &Options,
    workers: &dyn Workers,
) -> [f64; FIGURES] {
    let at = noise.get().map(ln);
    let slopes: Vec<[f64; FIGURES]> = map(workers, FIGURES + 1, |k| {
        let mut there = at;
        if k > 0 {
            there[k - 1] += CURVED_OVER;
        }
        slope(problems, &Noise::from_figures(&there.map(exp)), options, &super::Serial).1
    });
    let curvature = |i: usize, j: usize| {
        let one = |i: usize, j: usize| (slopes[0][j] - slopes[i + 1][j]) / CURVED_OVER;
        0.5 * (one(i, j) + one(j, i))
    };
    let least = UNKNOWN_FIGURE.powi(-2);
    let free = limits.free(&at, &slopes[0]);
    let open: Vec<usize> = (0..FIGURES).filter(|k| free[*k] && curvature(*k, *k) > 0.0).collect();
    let matrix = nalgebra::DMatrix::from_fn(open.len(), open.len(), |i, j| {
        curvature(open[i], open[j]) + if i == j { least } else { 0.0 }
    });
    let alone = |k: usize| (curvature(k, k).max(0.0) + least).sqrt().recip();
    let together = matrix.cholesky().map(|c| c.inverse());
    std::array::from_fn(|k| match (&together, open.iter().position(|o| *o == k)) {
        (Some(inverse), Some(i)) => inverse[(i, i)].max(0.0).sqrt(),
        _ => alone(k),
    })
}

/// Noise of gyros and accelerometers that units at rest between turns by hand showed, rad/s/√Hz and m/s²/√Hz; nothing where none did. What a fit makes of the means
/// over a few such rests is a matter of chance: 0.0012 of 0.0085 deg/s/√Hz where the place is unknown, 0.0008 of 0.006 m/s²/√Hz with a receiver.
fn at_rest(model: &Model, flights: &[&Flight]) -> [f64; 2] {
    let shown = flights.iter().filter_map(|f| f.noise_at_rest(model));
    let least = shown.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1])]);
    least.unwrap_or_default().map(f64::sqrt)
}

/// The Gauss-Markov error of heights is this much larger than that of horizontal positions.
pub(super) const HEIGHT_GAUSS_MARKOV: f64 = 1.6;

impl Noise {
    /// What is left of the Gauss-Markov error of the fixes after a time, s.
    #[inline]
    pub(super) fn decay(&self, dt: f64) -> f64 {
        exp(-dt / self.correlation_s)
    }

    /// A start: the model's figures, and what the samples show if that is more.
    pub fn measured(model: &Model, flights: &[&Flight]) -> Self {
        let most = |f: fn(&Flight) -> f64| flights.iter().map(|x| f(x)).fold(0.0, f64::max);
        let (gnss, least) = (&model.gnss, at_rest(model, flights));
        let has_gauss_markov = gnss.position_correlation_s > 0.0 && gnss.position_wander_sigma_m[0] > 0.0;
        Self {
            gyro: model.imu.gyro_noise.max(0.5 * most(|f| f.measured_noise().0).sqrt()).max(least[0]),
            accel: model.imu.accel_noise.max(0.5 * most(|f| f.measured_noise().1).sqrt()).max(least[1]),
            position_scale: 1.0,
            height_scale: 1.0,
            velocity_scale: 1.0,
            gauss_markov_m: if has_gauss_markov { gnss.position_wander_sigma_m[0] } else { 0.7 },
            correlation_s: if has_gauss_markov { gnss.position_correlation_s } else { 60.0 },
            stamp_s: 0.003,
        }
    }

    /// All figures in the order of [`figure`].
    pub(super) fn get(&self) -> [f64; FIGURES] {
        [
            self.gyro,
            self.accel,
            self.position_scale,
            self.height_scale,
            self.velocity_scale,
            self.gauss_markov_m,
            self.correlation_s,
            self.stamp_s,
        ]
    }

    /// From all figures in the order of [`figure`].
    pub(super) fn from_figures(v: &[f64; FIGURES]) -> Self {
        Self {
            gyro: v[0],
            accel: v[1],
            position_scale: v[2],
            height_scale: v[3],
            velocity_scale: v[4],
            gauss_markov_m: v[5],
            correlation_s: v[6],
            stamp_s: v[7],
        }
    }

    /// How far the first guess of the noise may be off, as a factor on squared innovations.
    pub(crate) fn tolerance(&self) -> f64 {
        4.0
    }

    /// The model with this noise.
    #[must_use]
    pub fn of(&self, model: &Model) -> Model {
        let mut model = model.clone();
        model.imu.gyro_noise = self.gyro;
        model.imu.accel_noise = self.accel;
        for k in 0..3 {
            let scale = if k < 2 { self.position_scale } else { self.height_scale };
            model.gnss.position_sigma_m[k] *= scale;
            model.gnss.velocity_sigma_m_per_s[k] *= self.velocity_scale;
        }
        model.gnss.position_correlation_s = self.correlation_s;
        model.gnss.position_wander_sigma_m =
            [self.gauss_markov_m, self.gauss_markov_m, self.gauss_markov_m * HEIGHT_GAUSS_MARKOV];
        model
    }
}
