//! What no named effect explains: the sparse combination of products of motion that comes closest.
//!
//! Orthogonal matching pursuit (Tropp & Gilbert 2007) on score and information: every term is a disturbance of one sensor
//! axis, propagated through the filter like an effect, so that what the filter's own states can absorb counts for
//! nothing.

use super::flight::Flight;
use super::linear::Problem;
use super::linear::reference::Reference;
use super::noise::Noise;
use super::pass::{Information, Options};
use super::{Workers, evidence, map};
use crate::filter::watch::{Regressors, Term, Watched};
use crate::model::Model;

/// One regressor with its name and unit.
#[derive(Debug, Clone, Copy)]
pub struct Regressor {
    /// As in the report: `f_x*f_z`.
    pub name: &'static str,
    /// Divides the unit of the channel.
    pub per: &'static str,
    value: fn(&Regressors) -> f64,
    /// A size of the regressor in flight, to judge coefficients by.
    typical: f64,
}

macro_rules! regressor {
    ($name:literal, $per:literal, $typical:literal, $value:expr) => {
        Regressor { name: $name, per: $per, value: $value, typical: $typical }
    };
}

/// Every regressor.
pub const REGRESSORS: [Regressor; 30] = [
    regressor!("f_x", "/(m/s2)", 3.0, |r| r.force.x),
    regressor!("f_y", "/(m/s2)", 3.0, |r| r.force.y),
    regressor!("f_z", "/(m/s2)", 10.0, |r| r.force.z),
    regressor!("f_x*f_x", "/(m/s2)^2", 10.0, |r| r.force.x * r.force.x),
    regressor!("f_y*f_y", "/(m/s2)^2", 10.0, |r| r.force.y * r.force.y),
    regressor!("f_z*f_z", "/(m/s2)^2", 100.0, |r| r.force.z * r.force.z),
    regressor!("f_x*f_y", "/(m/s2)^2", 10.0, |r| r.force.x * r.force.y),
    regressor!("f_x*f_z", "/(m/s2)^2", 30.0, |r| r.force.x * r.force.z),
    regressor!("f_y*f_z", "/(m/s2)^2", 30.0, |r| r.force.y * r.force.z),
    regressor!("w_x", "/(rad/s)", 0.5, |r| r.rate.x),
    regressor!("w_y", "/(rad/s)", 0.3, |r| r.rate.y),
    regressor!("w_z", "/(rad/s)", 0.3, |r| r.rate.z),
    regressor!("w_x*w_y", "/(rad/s)^2", 0.1, |r| r.rate.x * r.rate.y),
    regressor!("w_x*w_z", "/(rad/s)^2", 0.1, |r| r.rate.x * r.rate.z),
    regressor!("w_y*w_z", "/(rad/s)^2", 0.1, |r| r.rate.y * r.rate.z),
    regressor!("w_x*f_x", "/(rad/s*m/s2)", 1.5, |r| r.rate.x * r.force.x),
    regressor!("w_x*f_y", "/(rad/s*m/s2)", 1.5, |r| r.rate.x * r.force.y),
    regressor!("w_x*f_z", "/(rad/s*m/s2)", 5.0, |r| r.rate.x * r.force.z),
    regressor!("w_y*f_x", "/(rad/s*m/s2)", 1.0, |r| r.rate.y * r.force.x),
    regressor!("w_y*f_y", "/(rad/s*m/s2)", 1.0, |r| r.rate.y * r.force.y),
    regressor!("w_y*f_z", "/(rad/s*m/s2)", 3.0, |r| r.rate.y * r.force.z),
    regressor!("w_z*f_x", "/(rad/s*m/s2)", 1.0, |r| r.rate.z * r.force.x),
    regressor!("w_z*f_y", "/(rad/s*m/s2)", 1.0, |r| r.rate.z * r.force.y),
    regressor!("w_z*f_z", "/(rad/s*m/s2)", 3.0, |r| r.rate.z * r.force.z),
    regressor!("T", "/degC", 10.0, |r| r.temperature_above_25_degc),
    regressor!("speed", "/(m/s)", 20.0, |r| r.speed),
    regressor!("speed*speed", "/(m/s)^2", 400.0, |r| r.speed * r.speed),
    regressor!("t", "/s", 100.0, |r| r.elapsed_s),
    regressor!("t*t", "/s^2", 1e4, |r| r.elapsed_s * r.elapsed_s),
    regressor!("sin(t/5)", "", 1.0, |r| (r.elapsed_s / 5.0).sin()),
];

/// Names of the channels of a term.
pub const CHANNELS: [&str; 6] = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"];
/// A disturbance of this size is the prior, rad/s and m/s².
const DISTURBANCE: [f64; 2] = [3e-3, 0.1];
/// A term must gain this much evidence beyond the logarithm of the number of terms.
const WORTH: f64 = 5.0;
/// More terms than this describe nothing any more.
const MOST_TERMS: usize = 4;

/// One term found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// `gyro_y`.
    pub channel: &'static str,
    /// `f_x*f_z`.
    pub term: &'static str,
    /// Coefficient, SI.
    pub coefficient: f64,
    /// 1-sigma.
    pub sigma: f64,
    /// Unit of both.
    pub unit: String,
}

/// All terms, in the order of the columns of the watch.
pub fn all() -> Vec<Term> {
    (0..6).flat_map(|channel| REGRESSORS.iter().map(move |r| Term { channel, regressor: r.value })).collect()
}

/// The best few terms that a model lacks, over all flights. The flights are linearised about what the model shows.
pub fn find(
    flights: &[&Flight],
    model: &Model,
    noise: &Noise,
    options: &Options,
    workers: &dyn Workers,
) -> Vec<Found> {
    let watched = Watched { terms: all(), ..Watched::default() };
    let runs = map(workers, flights.len(), |k| {
        let reference = Reference::find(flights[k], model, noise);
        let [fit, _] = Problem::new(flights[k], model, &reference, &watched).run(noise, options).information;
        fit
    });
    let mut sum = Information::zeros(watched.terms.len(), 0);
    runs.iter().for_each(|fit| sum.add(fit));
    pursue(&sum, 0)
}

/// The best few terms; `first` is the column of the first term.
pub fn pursue(information: &Information, first: usize) -> Vec<Found> {
    let count = 6 * REGRESSORS.len();
    let sigma = |k: usize| DISTURBANCE[k / REGRESSORS.len() / 3] / REGRESSORS[k % REGRESSORS.len()].typical;
    let fit = |chosen: &[usize]| {
        let columns: Vec<usize> = chosen.iter().map(|k| first + k).collect();
        let sigmas: Vec<f64> = chosen.iter().map(|k| sigma(*k)).collect();
        evidence::fit(information, &columns, &sigmas, &vec![0.0; chosen.len()])
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut have = 0.0;
    while chosen.len() < MOST_TERMS {
        let tried = (0..count).filter(|k| !chosen.contains(k)).filter_map(|k| {
            let with: Vec<usize> = chosen.iter().copied().chain([k]).collect();
            fit(&with).map(|f| (k, f.evidence))
        });
        let Some((k, evidence)) = tried.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if evidence - have < WORTH + (count as f64).ln() {
            break;
        }
        chosen.push(k);
        have = evidence;
    }
    let Some(fit) = fit(&chosen) else { return Vec::new() };
    chosen
        .iter()
        .enumerate()
        .map(|(i, k)| {
            let (channel, regressor) = (k / REGRESSORS.len(), &REGRESSORS[k % REGRESSORS.len()]);
            let base = if channel < 3 { "rad/s" } else { "m/s2" };
            Found {
                channel: CHANNELS[channel],
                term: regressor.name,
                coefficient: fit.step[i],
                sigma: fit.covariance[(i, i)].max(0.0).sqrt(),
                unit: format!("{base}{}", regressor.per),
            }
        })
        .collect()
}
