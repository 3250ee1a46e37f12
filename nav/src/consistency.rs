//! Errors against a known truth in the filter's own coordinates, and their normalised square (NEES).

use crate::filter::Filter;
use crate::filter::calibration::Calibration;
use crate::filter::layout::index;
use crate::mechanization::NavState;
use nalgebra::{DMatrix, DVector};

/// Truth minus estimate in the filter's error coordinates, one entry per state; Gauss-Markov states are left zero.
pub fn error(filter: &Filter, nav: &NavState, truth: &Calibration) -> Vec<f64> {
    let layout = filter.layout();
    // The covariance is expressed about what the filter is linearised about: so is the error.
    let (mean, about, constants) = filter.linearised();
    let mut out = vec![0.0; layout.len()];
    out.iter_mut().zip(about.displacement_of(nav).entries()).for_each(|(out, x)| *out = x);
    for (i, _) in layout.names().iter().enumerate() {
        let state = index::GYRO_BIAS + i;
        out[state] = truth.get(layout, state) - constants.get(layout, state);
    }
    let known = index::GYRO_BIAS + layout.names().len();
    out.iter_mut().zip(mean).take(known).for_each(|(out, x)| *out -= x);
    out
}

/// A variance that has lost less than this share is no measurement of its constant.
const LEAST_LOST: f64 = 0.1;

/// By how many sigmas an estimate has moved from the value that it began from: by the root of what its variance has lost since, which is that of the
/// innovation of all measurements together. Variances before and after.
pub fn departure(moved: f64, before: f64, after: f64) -> f64 {
    moved.abs() / (before - after).max(LEAST_LOST * before).sqrt()
}

/// eᵀ P⁻¹ e over the given states; `None` where their covariance is singular.
pub fn nees(filter: &Filter, error: &[f64], states: &[usize]) -> Option<f64> {
    let p = filter.covariance();
    // Scaled to correlations first: positions and g-sensitivities differ by nine orders of magnitude.
    let sigma: Vec<f64> = states.iter().map(|s| p.sigma(*s)).collect();
    if sigma.iter().any(|s| s.is_nan() || *s <= 0.0) {
        return None;
    }
    let correlation = DMatrix::from_fn(states.len(), states.len(), |i, j| {
        p.at(states[i], states[j]) / (sigma[i] * sigma[j])
    });
    let e = DVector::from_fn(states.len(), |i, _| error[states[i]] / sigma[i]);
    Some(e.dot(&correlation.cholesky()?.solve(&e)))
}

/// The band that holds the mean of `runs` NEES values per degree of freedom in 95 of 100 cases (Bar-Shalom 2001,
/// section 5.4; Wilson & Hilferty's approximation of the χ² quantile).
pub fn nees_band_95(dof: usize, runs: usize) -> [f64; 2] {
    let k = (dof * runs).max(1) as f64;
    [-1.959_964, 1.959_964].map(|z: f64| {
        let a = 2.0 / (9.0 * k);
        (1.0 - a + z * a.sqrt()).powi(3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_matches_tables() {
        // χ²(0.025, 100) = 74.222, χ²(0.975, 100) = 129.561.
        let [low, high] = nees_band_95(10, 10);
        assert!((low - 0.74222).abs() < 2e-4 && (high - 1.29561).abs() < 2e-4, "{low} {high}");
    }
}
