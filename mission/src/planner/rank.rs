//! Ranking of maneuvers by what they bring per second: the live guidance asks this from the present covariance.

use super::Reach;
use super::search::log_score;
use crate::airframe::Airframe;
use crate::maneuver::{Entry, Maneuver};
use crate::predictor::{NamedSigma, Predictor};
use nalgebra::Vector3;

/// A maneuver with its predicted gain.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Which.
    pub maneuver: Maneuver,
    /// Decrease of the logarithm of the worst sigma over target (and, at less weight, of the mean), per second.
    pub gain_per_s: f64,
    /// Time to fly it, s.
    pub duration_s: f64,
    /// The state furthest from its target before.
    pub worst_before: Option<NamedSigma>,
    /// The same state after.
    pub worst_after: Option<NamedSigma>,
    /// All states after.
    pub after: Vec<NamedSigma>,
}

/// The maneuvers by gain per second, best first, each flown from the same entry.
pub fn rank<P: Predictor>(
    maneuvers: &[Maneuver],
    airframe: &Airframe,
    entry: &Entry,
    wind_ned: &Vector3<f64>,
    predictor: &P,
    fix_interval_s: f64,
) -> Vec<Ranked> {
    let before = predictor.sigmas();
    let all = vec![Reach::Known; before.len()];
    let worst = (0..before.len()).max_by(|a, b| {
        let ratio = |i: usize| before.get(i).map_or(0.0, NamedSigma::ratio);
        ratio(*a).total_cmp(&ratio(*b))
    });
    let score = log_score(&before, &all);
    let mut ranked: Vec<Ranked> = maneuvers
        .iter()
        .map(|maneuver| {
            let mut predictor = predictor.clone();
            predictor.fly(&maneuver.kinematics(airframe, entry, wind_ned), fix_interval_s);
            let after = predictor.sigmas();
            let duration_s = maneuver.duration_s(airframe);
            Ranked {
                maneuver: *maneuver,
                gain_per_s: (score - log_score(&after, &all)) / duration_s.max(1.0),
                duration_s,
                worst_before: worst.and_then(|i| before.get(i)).cloned(),
                worst_after: worst.and_then(|i| after.get(i)).cloned(),
                after,
            }
        })
        .collect();
    ranked.sort_by(|a, b| b.gain_per_s.total_cmp(&a.gain_per_s));
    ranked
}
