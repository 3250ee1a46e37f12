//! From score and information to evidence: the marginal likelihood of parameters with a Gaussian prior, in closed form
//! (MacKay 2003, section 28.1), with the prior's width averaged over a few scales so that a small effect of an unknown
//! size need not pay for a wide prior.

use super::pass::Information;
use crate::math::{exp, ln};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Widths of the prior that are averaged over, as factors on the sigma of the effect's definition.
pub const SCALES: [f64; 5] = [2.0, 1.0, 0.5, 0.2, 0.08];

/// A column of the information that may move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// Its place in the information.
    pub at: usize,
    /// Prior sigma.
    pub sigma: f64,
    /// Prior mean less the point of linearisation.
    pub offset: f64,
}

impl Column {
    /// Those of these priors (sigma and offset) that let their column move.
    pub fn open(priors: impl IntoIterator<Item = (f64, f64)>) -> Vec<Self> {
        let all = priors.into_iter().enumerate().map(|(at, (sigma, offset))| Self { at, sigma, offset });
        all.filter(|c| c.sigma > 0.0).collect()
    }

    /// The same with a prior this many times as wide.
    pub fn wider(self, by: f64) -> Self {
        Self { sigma: self.sigma * by, ..self }
    }
}

/// Parameters fitted to score and information.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Step from the point of linearisation, SI.
    pub step: DVector<f64>,
    /// Posterior covariance.
    pub covariance: DMatrix<f64>,
    /// Logarithm of the marginal likelihood, relative to the likelihood at the point of linearisation.
    pub evidence: f64,
    /// Gain of the likelihood itself.
    pub gain: f64,
    /// What of the likelihood at the point of linearisation noise of the samples may have made: counted in the evidence, at most 0.
    pub imitated: f64,
}

/// Fits columns of the information.
pub fn fit(information: &Information, columns: &[Column]) -> Option<Fit> {
    let n = columns.len();
    let b = DVector::from_fn(n, |i, _| information.score[columns[i].at]);
    let lambda = DMatrix::from_fn(n, n, |i, j| information.matrix[(columns[i].at, columns[j].at)]);
    let beside = DVector::from_fn(n, |i, _| information.imitated[columns[i].at]);
    if beside.iter().all(|d| *d == 0.0) {
        return fit_dense(&b, &lambda, columns);
    }
    // A score b + Λ θ of mean Λ θ and variance Λ + D about no effect at all: the information is Λ (Λ + D)⁻¹ Λ.
    let total = DMatrix::from_fn(n, n, |i, j| {
        lambda[(i, j)] + if i == j { beside[i] + least(lambda[(i, i)]) } else { 0.0 }
    });
    let total = total.cholesky()?;
    let (score, share) = (total.solve(&b), total.solve(&lambda));
    let from = DVector::from_fn(n, |i, _| -columns[i].offset);
    let along = &score + &share * &from * 0.5;
    let imitated = -from.component_mul(&beside).dot(&along);
    let fit = fit_dense(&(&lambda * score), &(&lambda * share), columns)?;
    let gain = b.dot(&fit.step) - 0.5 * fit.step.dot(&(lambda * &fit.step));
    Some(Fit { evidence: fit.evidence + imitated, gain, imitated, ..fit })
}

/// What keeps a matrix regular where nothing excites a parameter.
fn least(diagonal: f64) -> f64 {
    if diagonal > 0.0 { 1e-9 * diagonal } else { 1.0 }
}

fn fit_dense(b: &DVector<f64>, lambda: &DMatrix<f64>, columns: &[Column]) -> Option<Fit> {
    let n = b.len();
    let sigma = |i: usize| columns[i].sigma;
    if n == 0 {
        return Some(Fit {
            step: DVector::zeros(0),
            covariance: DMatrix::zeros(0, 0),
            evidence: 0.0,
            gain: 0.0,
            imitated: 0.0,
        });
    }
    // In units of the prior: A = I + D Λ D.
    let a = DMatrix::from_fn(n, n, |i, j| lambda[(i, j)] * sigma(i) * sigma(j) + f64::from(u8::from(i == j)));
    let o = DVector::from_fn(n, |i, _| columns[i].offset / sigma(i));
    let rhs = DVector::from_fn(n, |i, _| b[i] * sigma(i) + o[i]);
    let cholesky = a.cholesky()?;
    let x = cholesky.solve(&rhs);
    let ln_det: f64 = 2.0 * cholesky.l_dirty().diagonal().iter().map(|d| ln(*d)).sum::<f64>();
    let evidence = 0.5 * rhs.dot(&x) - 0.5 * o.dot(&o) - 0.5 * ln_det;
    let inverse = cholesky.inverse();
    let step = DVector::from_fn(n, |i, _| x[i] * sigma(i));
    let covariance = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * sigma(i) * sigma(j));
    let gain = b.dot(&step) - 0.5 * step.dot(&(lambda * &step));
    Some(Fit { step, covariance, evidence, gain, imitated: 0.0 })
}

/// The logarithm of the mean of exponentials.
pub fn log_mean_exp(values: impl IntoIterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !top.is_finite() {
        return f64::NEG_INFINITY;
    }
    top + ln(values.iter().map(|v| exp(v - top)).sum::<f64>() / values.len() as f64)
}

/// A jump whose instant is unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Evidence, averaged over the instants and the widths of the prior.
    pub evidence: f64,
    /// That of the best instant and width alone.
    pub alone: f64,
    /// The best instant, s.
    pub t_s: f64,
    /// RMS distance of the instants from it, each as likely as its evidence says, and what happened between two fixes, s.
    pub sigma_s: f64,
    /// The best width, as a factor on the prior sigma.
    pub scale: f64,
    /// The size that fits best there.
    pub size: Vector3<f64>,
}

/// Each instant's own evidence, averaged over the instants (s, with score and information of the size). `None` without instants.
pub fn jump(jumps: &[(f64, Vector3<f64>, Matrix3<f64>)], sigma: f64) -> Option<Jump> {
    let one = |(t_s, b, lambda): &(f64, Vector3<f64>, Matrix3<f64>), scale: f64| {
        let fit = fit_dense(
            &DVector::from_column_slice(b.as_slice()),
            &DMatrix::from_column_slice(3, 3, lambda.as_slice()),
            &[0, 1, 2].map(|at| Column { at, sigma: sigma * scale, offset: 0.0 }),
        )?;
        let size = Vector3::from_column_slice(fit.step.as_slice());
        Some(Jump { evidence: fit.evidence, alone: fit.evidence, t_s: *t_s, sigma_s: 0.0, scale, size })
    };
    let all: Vec<Jump> = jumps.iter().flat_map(|at| SCALES.iter().filter_map(|s| one(at, *s))).collect();
    let best = *all.iter().max_by(|a, b| a.alone.total_cmp(&b.alone))?;
    let moment = |power: i32| {
        all.iter().map(|j| exp(j.alone - best.alone) * (j.t_s - best.t_s).powi(power)).sum::<f64>()
    };
    let interval_s = jumps.windows(2).find(|w| w[1].0 == best.t_s).map_or(0.0, |w| w[1].0 - w[0].0);
    // It happened anywhere between two fixes.
    let sigma_s = (moment(2) / moment(0) + interval_s * interval_s / 3.0).sqrt();
    Some(Jump { evidence: log_mean_exp(all.iter().map(|j| j.alone)), sigma_s, ..best })
}
