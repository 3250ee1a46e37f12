//! Which effects of a compass a flight shows: score and information about all of them at once, and then evidence in closed form.
//!
//! Every compass has what calibration leaves of each effect; that is allowed for by a narrow prior and never named. An effect is named where
//! widening its prior to that of its definition is worth the odds, and where held-out blocks agree.

use super::super::evidence::{self, Fit, SCALES, log_mean_exp};
use super::CompassFinding;
use crate::effects::COMPASS;
use crate::identify::pass::Information;
use crate::model::EffectSetting;
use nalgebra::{DMatrix, DVector};

/// What is left of each effect of [`COMPASS`] by an ordinary calibration, 1-sigma, SI: 15 mG, .2 mG/A, 1.5°, 2 %, .1 s, .5°. ArduPilot's
/// calibrator is content with a fitness of 16 mG RMS (`COMPASS_CAL_FIT`), PX4's with a mean residual of .01 G (`mag_calibration.cpp`).
const TOLERANCES: [f64; 6] = [15e-7, 0.2e-7, 0.026, 0.02, 0.1, 0.0087];
/// What is named has at least these odds, nats: one in a thousand per effect of a compass without it.
const THRESHOLD: f64 = 7.0;
/// Another effect within this of the one chosen does as well, nats.
const MARGIN: f64 = 3.3;
/// No value is known better than this share of it: the current is reported with noise and between its reports the straight line is
/// taken (.8 % too small on a simulated flight of 100 to 400 mG of motor field), and messages round to 1 mG.
const KNOWN_TO: f64 = 0.01;
/// Every third block is held out.
const HELD_OUT_EVERY: usize = 3;
/// Fewer blocks than this do not show how errors are correlated; then this factor on variances is assumed.
const ENOUGH_BLOCKS: usize = 6;
const UNKNOWN_CORRELATION: f64 = 9.0;

/// Whether a block is held out.
pub(super) fn is_held_out(block: usize) -> bool {
    block % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
}

/// Prior sigmas of every parameter of [`COMPASS`], narrow and wide.
pub(super) struct Widths {
    /// Effect of each parameter.
    effect: Vec<usize>,
    narrow: Vec<f64>,
    wide: Vec<f64>,
}

impl Widths {
    /// `has_current`: whether the current is known; otherwise nothing is driven by it.
    pub(super) fn new(has_current: bool) -> Self {
        let mut own = Self { effect: Vec::new(), narrow: Vec::new(), wide: Vec::new() };
        for (e, (effect, tolerance)) in COMPASS.iter().zip(TOLERANCES).enumerate() {
            let is_there = if effect.name() == "mag_current" && !has_current { 0.0 } else { 1.0 };
            for group in effect.groups() {
                for _ in 0..group.shape.len() {
                    own.effect.push(e);
                    own.narrow.push(tolerance * is_there);
                    own.wide.push(group.prior_sigma * is_there);
                }
            }
        }
        own
    }

    pub(super) fn len(&self) -> usize {
        self.effect.len()
    }

    /// Prior sigmas with these effects wide, those of `scaled` by a factor.
    fn with(&self, named: &[usize], scaled: Option<(usize, f64)>) -> Vec<f64> {
        let one = |k: usize| {
            let e = self.effect[k];
            match scaled {
                Some((own, scale)) if own == e => (self.wide[k] * scale).max(self.narrow[k]),
                _ if named.contains(&e) => self.wide[k],
                _ => self.narrow[k],
            }
        };
        (0..self.len()).map(one).collect()
    }
}

/// Information about the model's own parameters and about those of the compass, the latter seen from zero.
struct About<'a> {
    prior: &'a [(f64, f64)],
    widths: &'a Widths,
    fit: Information,
    held_out: Information,
    all: Information,
    /// Factor on variances by which errors are correlated.
    correlated: f64,
}

/// One fit of a set of effects.
struct Fitted {
    columns: Vec<usize>,
    fit: Fit,
}

impl About<'_> {
    fn fitted(&self, of: &Information, sigma: &[f64]) -> Option<Fitted> {
        let before = self.prior.len();
        let (mut columns, mut sigmas, mut offsets) = (Vec::new(), Vec::new(), Vec::new());
        let all = self.prior.iter().copied().chain(sigma.iter().map(|s| (*s, 0.0)));
        for (k, (s, offset)) in all.enumerate().filter(|(_, p)| p.0 > 0.0) {
            columns.push(k);
            sigmas.push(s);
            offsets.push(if k < before { offset } else { 0.0 });
        }
        let tempered =
            Information { score: &of.score / self.correlated, matrix: &of.matrix / self.correlated };
        Some(Fitted { fit: evidence::fit(&tempered, &columns, &sigmas, &offsets)?, columns })
    }

    fn evidence(&self, named: &[usize], candidate: Option<usize>) -> f64 {
        let of = |sigma: Vec<f64>| self.fitted(&self.fit, &sigma).map_or(f64::NAN, |f| f.fit.evidence);
        match candidate {
            Some(e) => log_mean_exp(SCALES.map(|scale| of(self.widths.with(named, Some((e, scale)))))),
            None => of(self.widths.with(named, None)),
        }
    }

    /// Values of the whole set of parameters.
    fn values(&self, of: &Information, named: &[usize]) -> DVector<f64> {
        self.values_within(of, &self.widths.with(named, None))
    }

    fn values_within(&self, of: &Information, sigma: &[f64]) -> DVector<f64> {
        let mut out = DVector::zeros(self.prior.len() + self.widths.len());
        if let Some(found) = self.fitted(of, sigma) {
            found.columns.iter().zip(found.fit.step.iter()).for_each(|(k, v)| out[*k] = *v);
        }
        out
    }

    /// By how much these effects make the held-out blocks more likely than without any of one of them, what its tolerance allows for included, nats.
    fn held_out_gain(&self, named: &[usize], without: usize) -> f64 {
        let all = self.widths.with(named, None);
        let own = |(k, sigma): (usize, &f64)| if self.widths.effect[k] == without { 0.0 } else { *sigma };
        let others: Vec<f64> = all.iter().enumerate().map(own).collect();
        let gain = |sigma: &[f64]| {
            let v = self.values_within(&self.fit, sigma);
            (self.held_out.score.dot(&v) - 0.5 * v.dot(&(&self.held_out.matrix * &v))) / self.correlated
        };
        gain(&all) - gain(&others)
    }
}

/// What was chosen.
pub(super) struct Chosen {
    findings: Vec<CompassFinding>,
    removed: Vec<&'static str>,
    not_found: Vec<(&'static str, f64)>,
    named: Vec<f64>,
    fitted: Vec<f64>,
    pub(super) correlated: f64,
}

impl Chosen {
    /// Values of every parameter by all data; those of effects that were not named are 0.
    pub(super) fn named_values(&self) -> Vec<f64> {
        self.named.clone()
    }

    /// The same by the data that were not held out.
    pub(super) fn fit_values(&self) -> Vec<f64> {
        self.fitted.clone()
    }

    pub(super) fn findings(&self) -> Vec<CompassFinding> {
        self.findings.clone()
    }

    pub(super) fn removed(&self) -> Vec<&'static str> {
        self.removed.clone()
    }

    pub(super) fn not_found(&self) -> Vec<(&'static str, f64)> {
        self.not_found.clone()
    }
}

/// Blocks as one, with the information about the compass seen from zero instead of `values`.
fn sum<'i>(
    blocks: impl Iterator<Item = &'i Information>,
    before: usize,
    values: &[f64],
) -> Option<Information> {
    let mut sum: Option<Information> = None;
    for block in blocks {
        match &mut sum {
            Some(sum) => sum.add(block),
            None => sum = Some(block.clone()),
        }
    }
    let mut sum = sum?;
    let n = sum.score.len();
    let at = DVector::from_fn(n, |k, _| if k < before { 0.0 } else { values[k - before] });
    sum.score += &sum.matrix * at;
    Some(sum)
}

/// A step of all effects together, within their widest priors, from these values.
pub(super) fn step(
    blocks: &[Information],
    prior: &[(f64, f64)],
    widths: &Widths,
    values: &[f64],
) -> Option<Vec<f64>> {
    let all = sum(blocks.iter(), prior.len(), values)?;
    let about = About { prior, widths, fit: all.clone(), held_out: all.clone(), all, correlated: 1.0 };
    let every: Vec<usize> = (0..COMPASS.len()).collect();
    let found = about.values(&about.all, &every);
    Some((0..widths.len()).map(|k| found[prior.len() + k] - values[k]).collect())
}

/// By how much blocks of the flight scatter more than white noise would: the median ratio of the sandwich estimate to the curvature
/// (White 1982), over the parameters of the compass.
fn correlation(blocks: &[Information], prior: &[(f64, f64)], widths: &Widths) -> f64 {
    if blocks.len() < ENOUGH_BLOCKS {
        return UNKNOWN_CORRELATION;
    }
    let sigma: Vec<f64> = prior.iter().map(|p| p.0).chain(widths.wide.iter().copied()).collect();
    let open: Vec<usize> = (0..sigma.len()).filter(|k| sigma[*k] > 0.0).collect();
    let scaled = |m: &DMatrix<f64>| {
        DMatrix::from_fn(open.len(), open.len(), |i, j| {
            m[(open[i], open[j])] * sigma[open[i]] * sigma[open[j]]
        })
    };
    let mut total = DMatrix::zeros(open.len(), open.len());
    let mut meat = DMatrix::zeros(open.len(), open.len());
    for block in blocks {
        total += scaled(&block.matrix);
        let score = DVector::from_fn(open.len(), |i, _| block.score[open[i]] * sigma[open[i]]);
        meat += &score * score.transpose();
    }
    let Some(inverse) = (&total + DMatrix::identity(open.len(), open.len())).cholesky().map(|c| c.inverse())
    else {
        return UNKNOWN_CORRELATION;
    };
    let (scatter, curvature) = (&inverse * meat * &inverse, &inverse * total * &inverse);
    let own = (0..open.len()).filter(|i| open[*i] >= prior.len() && curvature[(*i, *i)] > 0.0);
    let mut ratios: Vec<f64> = own.map(|i| scatter[(i, i)] / curvature[(i, i)]).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(UNKNOWN_CORRELATION).max(1.0)
}

/// Chooses. `blocks`: score and information of each block at `values`; `prior`: sigma and offset of the model's own parameters.
pub(super) fn choose(
    blocks: &[Information],
    prior: &[(f64, f64)],
    widths: &Widths,
    values: &[f64],
) -> Chosen {
    let before = prior.len();
    let part =
        |held: bool| blocks.iter().enumerate().filter(move |(k, _)| is_held_out(*k) == held).map(|b| b.1);
    let zeros = || Information::zeros(before + widths.len());
    let about = About {
        prior,
        widths,
        fit: sum(part(false), before, values).unwrap_or_else(zeros),
        held_out: sum(part(true), before, values).unwrap_or_else(zeros),
        all: sum(blocks.iter(), before, values).unwrap_or_else(zeros),
        correlated: correlation(blocks, prior, widths),
    };
    let every: Vec<usize> = (0..COMPASS.len()).collect();
    let mut named: Vec<usize> = Vec::new();
    let mut evidences: Vec<f64> = Vec::new();
    loop {
        let base = about.evidence(&named, None);
        let gain = |e: &usize| (*e, about.evidence(&named, Some(*e)) - base);
        let rest = every.iter().filter(|e| !named.contains(e)).map(gain);
        match rest.max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((e, gain)) if gain > THRESHOLD => {
                named.push(e);
                evidences.push(gain);
            }
            _ => break,
        }
    }
    let mut removed = Vec::new();
    while let Some((k, _)) = named
        .iter()
        .enumerate()
        .map(|(k, e)| (k, about.held_out_gain(&named, *e)))
        .filter(|(_, gain)| *gain <= 0.0)
        .min_by(|a, b| a.1.total_cmp(&b.1))
    {
        removed.push(COMPASS[named.remove(k)].name());
        evidences.remove(k);
    }
    let base = about.evidence(&named, None);
    let not_found = every
        .iter()
        .filter(|e| !named.contains(e) && !removed.contains(&COMPASS[**e].name()))
        .map(|e| (COMPASS[*e].name(), about.evidence(&named, Some(*e)) - base))
        .collect();
    let all_values = about.values(&about.all, &named);
    let of = |v: &DVector<f64>| -> Vec<f64> {
        (0..widths.len())
            .map(|k| if named.contains(&widths.effect[k]) { v[before + k] } else { 0.0 })
            .collect()
    };
    let findings =
        named.iter().zip(&evidences).map(|(e, evidence)| finding(&about, &named, *e, *evidence)).collect();
    Chosen {
        findings,
        removed,
        not_found,
        named: of(&all_values),
        fitted: of(&about.values(&about.fit, &named)),
        correlated: about.correlated,
    }
}

fn finding(about: &About<'_>, named: &[usize], e: usize, evidence: f64) -> CompassFinding {
    let before = about.prior.len();
    let mut setting = EffectSetting::unknown(COMPASS[e]);
    if let Some(found) = about.fitted(&about.all, &about.widths.with(named, None)) {
        let first = about.widths.effect.iter().position(|own| *own == e).unwrap_or_default();
        for p in 0..setting.effect.len() {
            if let Some(i) = found.columns.iter().position(|k| *k == before + first + p) {
                setting.values[p] = found.fit.step[i];
                let curvature = found.fit.covariance[(i, i)].max(0.0).sqrt();
                setting.sigmas[p] = curvature.hypot(KNOWN_TO * setting.values[p]);
            }
        }
    }
    let others_named: Vec<usize> = named.iter().copied().filter(|o| *o != e).collect();
    let own = about.evidence(&others_named, Some(e));
    let as_good = |o: &usize| !named.contains(o) && about.evidence(&others_named, Some(*o)) > own - MARGIN;
    let others = (0..COMPASS.len()).filter(as_good).map(|o| COMPASS[o].name()).collect();
    CompassFinding { setting, evidence, held_out_gain: about.held_out_gain(named, e), others }
}
