//! Noise that is no effect: fitted by the likelihood of the innovations, for every model alike.
//!
//! White noise of the inertial samples (vibration adds to it), of positions and velocities, the slow wander of
//! positions (a first-order Gauss-Markov process), and the scatter of the fixes' time stamps.

use super::flight::Flight;
use super::pass::{self, Options};
use super::{Workers, map};
use crate::model::Model;

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
    /// Wander of horizontal positions, stationary 1-sigma, m.
    pub wander_m: f64,
    /// Correlation time of the wander, s.
    pub correlation_s: f64,
    /// Scatter of the fixes' time stamps, s.
    pub stamp_s: f64,
}

/// Number of figures.
const FIGURES: usize = 8;
/// Noise of the inertial samples may exceed what they show from sample to sample, or the model says, by this factor …
const INERTIAL_ABOVE: f64 = 3.0;
/// … and fall short of it by this one.
const INERTIAL_BELOW: f64 = 8.0;
/// White noise of the fixes as a factor on what they or the model claim. A receiver that is off by more is an effect's doing.
const CLAIMED: (f64, f64) = (0.05, 5.0);
/// However good fixes are, the model is not: sub-sample delays and filters leave centimetres. White noise is not fitted
/// below this, m and m/s.
const MODEL_FLOOR: (f64, f64) = (0.15, 0.04);
/// Positions wander by metres …
const WANDER_M: (f64, f64) = (0.02, 4.0);
/// … within tens of seconds to minutes; anything quicker is motion that the model does not understand.
const CORRELATION_S: (f64, f64) = (20.0, 300.0);

/// Stamps scatter by a loop of the autopilot: milliseconds.
const STAMP_S: (f64, f64) = (0.001, 0.02);

/// Limits of each figure in the order of [`Noise::get`]: noise must not be able to pass for whatever is missing.
fn limits(model: &Model, flights: &[&Flight]) -> [(f64, f64); FIGURES] {
    let start = Noise::measured(model, flights);
    let around = |v: f64| (v / INERTIAL_BELOW, v * INERTIAL_ABOVE);
    let middle = |claim: &dyn Fn(&crate::sample::GnssFix) -> f64| {
        let mut all: Vec<f64> = flights.iter().flat_map(|f| f.fixes()).map(claim).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(1.0).max(1e-3)
    };
    let gnss = &model.gnss;
    let position = middle(&|f| f.position_sigma_m.unwrap_or(gnss.position_sigma_m)[0]);
    let height = middle(&|f| f.position_sigma_m.unwrap_or(gnss.position_sigma_m)[2]);
    let velocity = middle(&|f| f.velocity_sigma_m_per_s.unwrap_or(gnss.velocity_sigma_m_per_s)[0]);
    let above = |floor: f64, claimed: f64| {
        let low = CLAIMED.0.max(floor / claimed);
        (low, CLAIMED.1.max(2.0 * low))
    };
    [
        around(start.gyro),
        around(start.accel),
        above(MODEL_FLOOR.0, position),
        above(MODEL_FLOOR.0, height),
        above(MODEL_FLOOR.1, velocity),
        WANDER_M,
        CORRELATION_S,
        STAMP_S,
    ]
}

/// Heights wander more than horizontal positions.
const HEIGHT_WANDER: f64 = 1.6;
/// A step of the search must gain this much.
const WORTH: f64 = 0.3;

impl Noise {
    /// A start: the model's figures, and what the samples show if that is more.
    pub fn measured(model: &Model, flights: &[&Flight]) -> Self {
        let most = |f: fn(&Flight) -> f64| flights.iter().map(|x| f(x)).fold(0.0, f64::max);
        let gnss = &model.gnss;
        let wanders = gnss.position_correlation_s > 0.0 && gnss.position_wander_sigma_m[0] > 0.0;
        Self {
            gyro: model.imu.gyro_noise.max(0.5 * most(|f| f.measured_noise().0).sqrt()),
            accel: model.imu.accel_noise.max(0.5 * most(|f| f.measured_noise().1).sqrt()),
            position_scale: 1.0,
            height_scale: 1.0,
            velocity_scale: 1.0,
            wander_m: if wanders { gnss.position_wander_sigma_m[0] } else { 0.7 },
            correlation_s: if wanders { gnss.position_correlation_s } else { 60.0 },
            stamp_s: 0.003,
        }
    }

    fn get(&self) -> [f64; FIGURES] {
        [
            self.gyro,
            self.accel,
            self.position_scale,
            self.height_scale,
            self.velocity_scale,
            self.wander_m,
            self.correlation_s,
            self.stamp_s,
        ]
    }

    fn scaled(&self, figure: usize, factor: f64, limits: &[(f64, f64); FIGURES]) -> Self {
        let mut v = self.get();
        let (low, high) = limits[figure];
        v[figure] = (v[figure] * factor).clamp(low, high);
        Self {
            gyro: v[0],
            accel: v[1],
            position_scale: v[2],
            height_scale: v[3],
            velocity_scale: v[4],
            wander_m: v[5],
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
        model.gnss.position_wander_sigma_m = [self.wander_m, self.wander_m, self.wander_m * HEIGHT_WANDER];
        model
    }
}

/// Fits the noise by a pattern search on logarithms: steps of a factor, halved (as exponents) `sweeps` times.
///
/// Every sweep tries all figures up and down at once, takes the best of each as one common step where that is better
/// than the best single one, and goes on from there. Returns the noise and its log-likelihood.
pub fn fit(
    flights: &[&Flight],
    model: &Model,
    start: Noise,
    options: &Options,
    sweeps: usize,
    workers: &dyn Workers,
) -> (Noise, f64) {
    let value = |noise: &Noise| -> f64 {
        flights.iter().map(|f| pass::run(f, model, noise, options, None).log_likelihood[0]).sum()
    };
    let mut best = (start, value(&start));
    let limits = limits(model, flights);
    let mut factor: f64 = 2.0;
    let figures = FIGURES;
    for sweep in 0..sweeps {
        let tries: Vec<Noise> = (0..2 * figures)
            .map(|k| best.0.scaled(k / 2, if k % 2 == 0 { factor } else { 1.0 / factor }, &limits))
            .collect();
        let values = map(workers, tries.len(), |k| value(&tries[k]));
        let mut together = best.0;
        let mut single = best;
        for figure in 0..figures {
            let (up, down) = (values[2 * figure], values[2 * figure + 1]);
            let (gain, by) = if up > down { (up - best.1, factor) } else { (down - best.1, 1.0 / factor) };
            if gain > WORTH {
                together = together.scaled(figure, by, &limits);
                if best.1 + gain > single.1 {
                    single = (best.0.scaled(figure, by, &limits), best.1 + gain);
                }
            }
        }
        if single.0 == best.0 {
            if sweep > 0 && factor < 1.15 {
                break;
            }
            factor = factor.sqrt();
            continue;
        }
        let joint = (together, value(&together));
        best = if joint.1 > single.1 { joint } else { single };
    }
    best
}
