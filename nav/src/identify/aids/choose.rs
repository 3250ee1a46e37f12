//! Which effects of a sensor a flight shows: score and information about all of them at once, and then evidence in closed form.
//!
//! Every sensor has what calibration leaves of each effect; that is allowed for by a narrow prior and never named. An effect is named where
//! widening its prior to that of its definition is worth the odds, and where held-out blocks agree. What is named has to hold alone: its values are
//! those of a fit without the tolerances of the others, which no parameter corrects, while the sigma counts the bias that they bring.

use super::Finding;
use crate::effects::Effect;
use crate::identify::evidence::{self, Column, Fit, SCALES, log_mean_exp};
use crate::identify::pass::Information;
use crate::identify::statistics::median;
use crate::model::EffectSetting;
use crate::rss;
use nalgebra::{DMatrix, DVector};

/// What is named has at least these odds, nats (very strong evidence: Kass & Raftery 1995). Against the tolerance of an effect they ask for 3.6 sigma of it. On 320 simulated flights none
/// of 580 sensors in order had a name, and 3 of 840 a wrong one alone; on 128 of them 4 nats gave one each, and with 7 (4.2 sigma) 12 of 89 right names were missing.
pub(in crate::identify) const THRESHOLD: f64 = 5.0;
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
pub(in crate::identify) fn is_held_out(block: usize) -> bool {
    block % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
}

/// Prior sigmas of every parameter of the effects of a sensor, narrow and wide, and of what goes with one of them without being named.
#[derive(Clone)]
pub(in crate::identify) struct Widths {
    pub(in crate::identify) catalogue: &'static [&'static dyn Effect],
    /// Effect of each parameter.
    effect: Vec<usize>,
    narrow: Vec<f64>,
    wide: Vec<f64>,
    /// How many parameters are the effects' own; those of `with` follow.
    own: usize,
    /// Effects that are not named.
    closed: Vec<usize>,
    /// Effects of which no parameter is known better than this, 1-sigma, SI.
    known_to: Vec<(usize, f64)>,
}

impl Widths {
    /// `tolerances`: what is never named, 1-sigma, SI, per effect; 0 closes what goes beyond it. `is_there`: whether what drives an effect is known.
    pub(in crate::identify) fn new(
        catalogue: &'static [&'static dyn Effect],
        tolerances: &[f64],
        is_there: impl Fn(&str) -> bool,
    ) -> Self {
        let (effect, narrow, wide, closed) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut out = Self { catalogue, effect, narrow, wide, own: 0, closed, known_to: Vec::new() };
        for (e, (effect, tolerance)) in catalogue.iter().zip(tolerances).enumerate() {
            let open = f64::from(u8::from(is_there(effect.name())));
            for group in effect.groups() {
                out.effect.extend(std::iter::repeat_n(e, group.shape.len()));
                out.narrow.extend(std::iter::repeat_n(tolerance * open, group.shape.len()));
                out.wide.extend(std::iter::repeat_n(group.prior_sigma * open, group.shape.len()));
            }
        }
        out.own = out.effect.len();
        out
    }

    /// With one more parameter that is open where this effect is named, of this 1-sigma.
    pub(in crate::identify) fn along(mut self, effect: &str, sigma: f64) -> Self {
        self.effect.extend(self.catalogue.iter().position(|e| e.name() == effect));
        self.narrow.push(0.0);
        self.wide.push(sigma);
        self
    }

    /// With one more parameter that is always open and never named.
    pub(in crate::identify) fn always(mut self, sigma: f64) -> Self {
        self.effect.push(usize::MAX);
        self.narrow.push(sigma);
        self.wide.push(sigma);
        self
    }

    /// What the measurement is compared with is no better than this for one effect, 1-sigma.
    pub(in crate::identify) fn known_to(mut self, effect: &str, sigma: f64) -> Self {
        self.know(effect, sigma);
        self
    }

    /// The same, in the place of what was said before.
    pub(in crate::identify) fn know(&mut self, effect: &str, sigma: f64) {
        let own = self.catalogue.iter().position(|e| e.name() == effect);
        self.known_to.retain(|k| Some(k.0) != own);
        self.known_to.extend(own.map(|e| (e, sigma)));
    }

    /// What no parameter of an effect is known better than, 1-sigma, SI.
    pub(super) fn least(&self, effect: usize) -> f64 {
        self.known_to.iter().find(|k| k.0 == effect).map_or(0.0, |k| k.1)
    }

    /// Whether an effect with these values is within what it is compared with is known to: a delay that gusts may pretend is no delay.
    pub(super) fn is_within_what_is_known(&self, effect: usize, values: &[f64]) -> bool {
        const SIGMAS: f64 = 3.0;
        let least = self.least(effect);
        let mut own = values.iter().zip(&self.effect).filter(|(_, e)| **e == effect);
        least > 0.0 && own.all(|(v, _)| v.abs() < SIGMAS * least)
    }

    /// This effect is not named from here on.
    pub(in crate::identify) fn close(&mut self, effect: usize) {
        self.closed.push(effect);
    }

    pub(in crate::identify) fn len(&self) -> usize {
        self.effect.len()
    }

    /// Prior sigmas with these effects wide, those of `scaled` by a factor.
    pub(in crate::identify) fn with(&self, named: &[usize], scaled: Option<(usize, f64)>) -> Vec<f64> {
        let one = |k: usize| {
            let e = self.effect[k];
            match scaled {
                Some((own, scale)) if own == e && k < self.own => (self.wide[k] * scale).max(self.narrow[k]),
                Some((own, _)) if own == e => self.wide[k],
                _ if named.contains(&e) => self.wide[k],
                _ => self.narrow[k],
            }
        };
        (0..self.len()).map(one).collect()
    }

    /// Prior sigmas with these effects wide and the others not there at all.
    fn only(&self, named: &[usize]) -> Vec<f64> {
        let open = |k: usize| self.effect[k] == usize::MAX || named.contains(&self.effect[k]);
        (0..self.len()).map(|k| if open(k) { self.wide[k] } else { 0.0 }).collect()
    }
}

/// Information about the model's own parameters and about those of the sensor, the latter seen from zero.
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
    columns: Vec<Column>,
    fit: Fit,
}

impl About<'_> {
    fn fitted(&self, of: &Information, sigma: &[f64]) -> Option<Fitted> {
        let columns = Column::open(self.prior.iter().copied().chain(sigma.iter().map(|s| (*s, 0.0))));
        let tempered = Information {
            score: &of.score / self.correlated,
            matrix: &of.matrix / self.correlated,
            imitated: of.imitated.clone(),
        };
        Some(Fitted { fit: evidence::fit(&tempered, &columns)?, columns })
    }

    fn evidence(&self, named: &[usize], candidate: Option<usize>) -> f64 {
        let of = |sigma: Vec<f64>| self.fitted(&self.fit, &sigma).map_or(f64::NAN, |f| f.fit.evidence);
        match candidate {
            Some(e) => log_mean_exp(SCALES.map(|scale| of(self.widths.with(named, Some((e, scale)))))),
            None => of(self.widths.with(named, None)),
        }
    }

    /// Values of the whole set of parameters within these prior sigmas.
    fn values(&self, of: &Information, sigma: &[f64]) -> DVector<f64> {
        let mut out = DVector::zeros(self.prior.len() + self.widths.len());
        if let Some(found) = self.fitted(of, sigma) {
            found.columns.iter().zip(found.fit.step.iter()).for_each(|(c, v)| out[c.at] = *v);
        }
        out
    }

    /// By how much these effects make the held-out blocks more likely than without one of them, nats.
    fn held_out_gain(&self, named: &[usize], without: usize) -> f64 {
        let others: Vec<usize> = named.iter().copied().filter(|e| *e != without).collect();
        let gain = |named: &[usize]| {
            let v = self.values(&self.fit, &self.widths.only(named));
            (self.held_out.score.dot(&v) - 0.5 * v.dot(&(&self.held_out.matrix * &v))) / self.correlated
        };
        gain(named) - gain(&others)
    }

    /// Of these the effects that the fitted blocks ask for, the clearest first, each with its evidence.
    fn asked_for(&self, of: &[usize]) -> Vec<(usize, f64)> {
        let mut named: Vec<(usize, f64)> = Vec::new();
        loop {
            let so_far: Vec<usize> = named.iter().map(|n| n.0).collect();
            let base = self.evidence(&so_far, None);
            let gain = |e: &usize| (*e, self.evidence(&so_far, Some(*e)) - base);
            let rest = of.iter().filter(|e| !so_far.contains(e)).map(gain);
            match rest.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some(best) if best.1 > THRESHOLD => named.push(best),
                _ => return named,
            }
        }
    }

    /// The effects that are named, with their evidence, and those that are refuted: without such a one the others are asked again, since it may stand for one of them.
    fn chosen(&self, of: &[usize], confirm: &Confirm<'_>) -> (Vec<(usize, f64)>, Vec<usize>) {
        let mut refuted: Vec<usize> = Vec::new();
        loop {
            let left: Vec<usize> = of.iter().copied().filter(|e| !refuted.contains(e)).collect();
            let chosen = self.asked_for(&left);
            let named: Vec<usize> = chosen.iter().map(|n| n.0).collect();
            match self.not_held_out(&named, confirm.held_out_error).or_else(|| (confirm.unfounded)(&named)) {
                Some(e) => refuted.push(e),
                None => return (chosen, refuted),
            }
        }
    }

    /// The effect of these that held-out blocks ask for least, where they do not ask for it.
    fn not_held_out(&self, named: &[usize], error: &HeldOutError<'_>) -> Option<usize> {
        let gains = named.iter().map(|e| (*e, self.held_out_gain(named, *e)));
        let (weakest, gain) = gains.min_by(|a, b| a.1.total_cmp(&b.1))?;
        // Both: the gain knows what the flight leaves open, the residual is what a corrected sensor would show.
        let own = self.own_values(&self.fit, named);
        let holds = gain > 0.0 && error(&own, &own) < error(&vec![0.0; own.len()], &own);
        (!holds).then_some(weakest)
    }

    /// Variance of what is fitted by the tolerances of the effects that are not: each moves the values by the bias that leaving it out brings.
    fn by_tolerances(&self, found: &Fitted, named: &[usize]) -> DVector<f64> {
        let mut variance = DVector::zeros(found.columns.len());
        let left_out =
            |u: &usize| self.widths.effect[*u] != usize::MAX && !named.contains(&self.widths.effect[*u]);
        for u in (0..self.widths.len()).filter(left_out) {
            let together = DVector::from_fn(found.columns.len(), |i, _| {
                self.all.matrix[(found.columns[i].at, self.prior.len() + u)] / self.correlated
            });
            let moved = &found.fit.covariance * together * self.widths.narrow[u];
            variance += moved.component_mul(&moved);
        }
        variance
    }

    /// Values and 1-sigma of an effect that is one of those named; nothing where there is no fit.
    fn values_of(&self, named: &[usize], e: usize) -> Vec<(f64, f64)> {
        let Some(found) = self.fitted(&self.all, &self.widths.only(named)) else { return Vec::new() };
        let by_tolerances = self.by_tolerances(&found, named);
        let own = |i: usize| found.columns[i].at.checked_sub(self.prior.len()).map(|k| self.widths.effect[k]);
        let own = (0..found.columns.len()).filter(|i| own(*i) == Some(e));
        let least = self.widths.least(e).powi(2);
        let one = |i: usize| {
            (found.fit.step[i], (found.fit.covariance[(i, i)].max(0.0) + by_tolerances[i] + least).sqrt())
        };
        own.map(one).take(self.widths.catalogue[e].len()).collect()
    }

    /// 1-sigma of the sensor's first parameter with its effect open beside those named.
    fn first_sigma(&self, named: &[usize]) -> f64 {
        let open: Vec<usize> = named.iter().copied().chain([0]).collect();
        let found = self.fitted(&self.all, &self.widths.with(&open, None));
        let sigma = found.and_then(|f| {
            let at = f.columns.iter().position(|c| c.at == self.prior.len())?;
            Some(f.fit.covariance[(at, at)].max(0.0).sqrt())
        });
        sigma.unwrap_or(0.0)
    }

    /// Covariance of the sensor's own parameters, within the tolerances of the effects that are not named.
    fn own_covariance(&self, named: &[usize]) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.widths.len(), self.widths.len());
        let Some(found) = self.fitted(&self.all, &self.widths.with(named, None)) else { return out };
        let own = found
            .columns
            .iter()
            .enumerate()
            .filter_map(|(i, c)| Some((i, c.at.checked_sub(self.prior.len())?)));
        for (i, a) in own.clone() {
            own.clone().for_each(|(j, b)| out[(a, b)] = found.fit.covariance[(i, j)]);
        }
        out
    }

    /// Values of the sensor's own parameters by these data, those of other effects at zero.
    fn own_values(&self, of: &Information, named: &[usize]) -> Vec<f64> {
        self.own_part(of, &self.widths.only(named))
    }

    /// Values of the sensor's own parameters by these data within these prior sigmas.
    fn own_part(&self, of: &Information, sigma: &[f64]) -> Vec<f64> {
        let v = self.values(of, sigma);
        (0..self.widths.len()).map(|k| v[self.prior.len() + k]).collect()
    }
}

/// RMS residual of the held-out blocks with the first values corrected, where the second ones say what else there is (the wind).
type HeldOutError<'a> = dyn Fn(&[f64], &[f64]) -> f64 + 'a;

/// What is asked of effects beside their evidence on the fitted blocks.
pub(in crate::identify) struct Confirm<'a> {
    pub(in crate::identify) held_out_error: &'a HeldOutError<'a>,
    /// Of effects named together the one that a noise which does without it explains best, where that is no worse by [`THRESHOLD`].
    pub(in crate::identify) unfounded: &'a dyn Fn(&[usize]) -> Option<usize>,
}

/// What was chosen.
pub(in crate::identify) struct Chosen {
    pub(in crate::identify) findings: Vec<Finding>,
    /// Effects that held-out data or the odds against another noise did not confirm.
    pub(in crate::identify) removed: Vec<&'static str>,
    /// Effects that were tested and are not significant, with the evidence for each.
    pub(in crate::identify) not_found: Vec<(&'static str, f64)>,
    /// Values of every parameter by all data; those of effects that were not named are 0.
    pub(in crate::identify) named: Vec<f64>,
    /// The same by the data that were not held out.
    pub(in crate::identify) fitted: Vec<f64>,
    /// Values of every parameter by all data and by those that were not held out, with those of effects that were not named within their tolerances.
    pub(in crate::identify) within: [Vec<f64>; 2],
    /// 1-sigma of the first parameter within its widest prior.
    pub(in crate::identify) first_sigma: f64,
    /// Factor on variances by which errors are correlated.
    pub(in crate::identify) correlated: f64,
    /// Covariance of every parameter, within the tolerances of the effects that are not named.
    pub(in crate::identify) covariance: DMatrix<f64>,
}

/// Blocks as one, with the information about the sensor seen from zero instead of `values`.
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
pub(in crate::identify) fn step(
    blocks: &[Information],
    prior: &[(f64, f64)],
    widths: &Widths,
    values: &[f64],
) -> Option<Vec<f64>> {
    let all = sum(blocks.iter(), prior.len(), values)?;
    let about = About { prior, widths, fit: all.clone(), held_out: all.clone(), all, correlated: 1.0 };
    let every: Vec<usize> = (0..widths.catalogue.len()).collect();
    let found = about.own_values(&about.all, &every);
    Some(found.iter().zip(values).map(|(new, old)| new - old).collect())
}

/// 1-sigma of each parameter as it would be reported where its effect alone were named; nothing of effects that are not there. `prior`: that of the parameters
/// before those of the sensor.
pub(in crate::identify) fn sigmas_alone(
    information: Information,
    prior: &[(f64, f64)],
    widths: &Widths,
) -> Vec<(usize, f64)> {
    let (fit, held_out) = (information.clone(), information.clone());
    let about = About { prior, widths, fit, held_out, all: information, correlated: 1.0 };
    let is_there = |e: &usize| (0..widths.own).any(|k| widths.effect[k] == *e && widths.wide[k] > 0.0);
    let of_one = |e: usize| about.values_of(&[e], e).into_iter().map(move |(_, sigma)| (e, sigma));
    (0..widths.catalogue.len()).filter(is_there).flat_map(of_one).collect()
}

/// By how much blocks of the flight scatter more than white noise would: the median ratio of the sandwich estimate to the curvature
/// (White 1982), over the parameters of the sensor.
fn correlation(blocks: &[Information], prior: &[(f64, f64)], widths: &Widths) -> f64 {
    if blocks.len() < ENOUGH_BLOCKS {
        return UNKNOWN_CORRELATION;
    }
    let sigmas = prior.iter().map(|p| p.0).chain(widths.wide.iter().copied());
    let open = Column::open(sigmas.map(|sigma| (sigma, 0.0)));
    let scaled = |m: &DMatrix<f64>| {
        DMatrix::from_fn(open.len(), open.len(), |i, j| {
            m[(open[i].at, open[j].at)] * open[i].sigma * open[j].sigma
        })
    };
    let mut total = DMatrix::zeros(open.len(), open.len());
    let mut meat = DMatrix::zeros(open.len(), open.len());
    for block in blocks {
        total += scaled(&block.matrix);
        let score = DVector::from_fn(open.len(), |i, _| block.score[open[i].at] * open[i].sigma);
        meat += &score * score.transpose();
    }
    let Some(inverse) = (&total + DMatrix::identity(open.len(), open.len())).cholesky().map(|c| c.inverse())
    else {
        return UNKNOWN_CORRELATION;
    };
    let (scatter, curvature) = (&inverse * meat * &inverse, &inverse * total * &inverse);
    let own = (0..open.len()).filter(|i| open[*i].at >= prior.len() && curvature[(*i, *i)] > 0.0);
    let ratios = own.map(|i| scatter[(i, i)] / curvature[(i, i)]);
    median(ratios).unwrap_or(UNKNOWN_CORRELATION).max(1.0)
}

/// Chooses. `blocks`: score and information of each block at `values`; `prior`: sigma and offset of the model's own parameters.
pub(in crate::identify) fn choose(
    blocks: &[Information],
    prior: &[(f64, f64)],
    widths: &Widths,
    values: &[f64],
    confirm: &Confirm<'_>,
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
    let every: Vec<usize> = (0..widths.catalogue.len()).filter(|e| !widths.closed.contains(e)).collect();
    let (chosen, refuted) = about.chosen(&every, confirm);
    let (named, evidences): (Vec<usize>, Vec<f64>) = chosen.into_iter().unzip();
    let removed: Vec<&'static str> = refuted.iter().map(|e| widths.catalogue[*e].name()).collect();
    let base = about.evidence(&named, None);
    let not_found = every
        .iter()
        .filter(|e| !named.contains(e) && !removed.contains(&widths.catalogue[**e].name()))
        .map(|e| (widths.catalogue[*e].name(), about.evidence(&named, Some(*e)) - base))
        .collect();
    let findings =
        named.iter().zip(&evidences).map(|(e, evidence)| finding(&about, &named, *e, *evidence)).collect();
    Chosen {
        findings,
        removed,
        not_found,
        named: about.own_values(&about.all, &named),
        fitted: about.own_values(&about.fit, &named),
        within: [&about.all, &about.fit].map(|of| about.own_part(of, &widths.with(&named, None))),
        first_sigma: about.first_sigma(&named),
        correlated: about.correlated,
        covariance: about.own_covariance(&named),
    }
}

fn finding(about: &About<'_>, named: &[usize], e: usize, evidence: f64) -> Finding {
    let catalogue = about.widths.catalogue;
    let mut setting = EffectSetting::unknown(catalogue[e]);
    for (p, (value, sigma)) in about.values_of(named, e).into_iter().enumerate() {
        setting.values[p] = value;
        setting.sigmas[p] = rss(sigma, KNOWN_TO * value);
    }
    let others_named: Vec<usize> = named.iter().copied().filter(|o| *o != e).collect();
    let own = about.evidence(&others_named, Some(e));
    let as_good = |o: &usize| !named.contains(o) && about.evidence(&others_named, Some(*o)) > own - MARGIN;
    let others = (0..catalogue.len()).filter(as_good).map(|o| catalogue[o].name()).collect();
    Finding { setting, evidence, held_out_gain: about.held_out_gain(named, e), others }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::effects::{COMPASS, FieldInstant};
    use nalgebra::Vector3;

    const TOLERANCES: [f64; 6] = [15e-7, 0.2e-7, 0.026, 0.02, 0.1, 0.0087];
    const SIGMA_T: f64 = 1e-6;

    /// A draw of mean 0 and sigma 1.
    fn normal(state: &mut u64) -> f64 {
        let mut uniform = || {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// Blocks of a nearly level flight, each with another heading and current, and its instants with what is in excess of the field.
    fn level_flight(truth: &[f64], seed: &mut u64) -> Vec<(FieldInstant, Vector3<f64>, usize)> {
        let mut all = Vec::new();
        for block in 0..9 {
            for k in 0..40 {
                let yaw = 0.7 * f64::from(block) + 0.02 * f64::from(k);
                let turn = Vector3::new(0.05 * normal(seed), 0.05 * normal(seed), 0.0);
                let level = Vector3::new(2e-5 * cos(yaw), -2e-5 * sin(yaw), 4e-5);
                let field = level + level.cross(&turn);
                let x = FieldInstant {
                    field,
                    by_declination: Vector3::new(-field.y, field.x, 0.0),
                    rate: Vector3::new(0.02 * normal(seed), 0.02 * normal(seed), 0.05),
                    current_a: 12.0 + 3.0 * normal(seed),
                };
                let mut shown = Vector3::from_fn(|_, _| SIGMA_T * normal(seed));
                let mut at = 0;
                for effect in COMPASS {
                    shown += effect.on_field().unwrap().field(&truth[at..at + effect.len()], &x);
                    at += effect.len();
                }
                all.push((x, shown, block as usize));
            }
        }
        all
    }

    fn columns(x: &FieldInstant) -> Vec<Vector3<f64>> {
        let one = |e: &&dyn Effect| {
            let mut own = vec![Vector3::zeros(); e.len()];
            e.on_field().unwrap().field_jacobian(&vec![0.0; e.len()], x, &mut own);
            own
        };
        COMPASS.iter().flat_map(one).collect()
    }

    /// What is named is applied alone: the tolerances of the others, which were fitted with it once, are in no parameter. In level flight an
    /// offset downward and a scale factor of the vertical axis all but cancel, and one of them without the other is worse than none.
    #[test]
    fn what_is_named_alone_makes_held_out_data_better_and_its_values_hold() {
        let widths = Widths::new(COMPASS, &TOLERANCES, |_| true);
        let (mut seed, mut named, mut within, mut values) = (7, 0, 0, 0);
        for run in 0..40 {
            let mut truth: Vec<f64> = widths.narrow.iter().map(|s| s * normal(&mut seed)).collect();
            // Beyond the tolerance: soft iron in every second run.
            let beyond = widths.effect.iter().map(|e| if *e == 3 && run % 2 == 0 { 0.08 } else { 0.0 });
            truth.iter_mut().zip(beyond).for_each(|(t, b)| *t += b * normal(&mut seed));
            let flight = level_flight(&truth, &mut seed);
            let mut blocks = vec![Information::zeros(widths.len()); 9];
            for (x, shown, block) in &flight {
                let columns = columns(x);
                for axis in 0..3 {
                    let row: Vec<f64> = columns.iter().map(|c| c[axis]).collect();
                    blocks[*block].take(&row, shown[axis], 1.0 / SIGMA_T.powi(2));
                }
            }
            blocks.iter_mut().for_each(Information::finish);
            let error = |v: &[f64]| {
                let held = flight.iter().filter(|f| is_held_out(f.2));
                held.map(|(x, shown, _)| {
                    let ours = columns(x).iter().zip(v).fold(Vector3::zeros(), |sum, (c, v)| sum + c * *v);
                    (shown - ours).norm_squared()
                })
                .sum::<f64>()
            };
            let confirm = Confirm { held_out_error: &|values, _| error(values), unfounded: &|_| None };
            let chosen = choose(&blocks, &[], &widths, &vec![0.0; widths.len()], &confirm);
            if chosen.findings.is_empty() {
                continue;
            }
            named += 1;
            let alone = error(&chosen.fitted);
            assert!(alone < error(&vec![0.0; widths.len()]), "run {run}: {:?}", chosen.findings);
            for f in &chosen.findings {
                let e = COMPASS.iter().position(|e| e.name() == f.setting.effect.name()).unwrap();
                let first = widths.effect.iter().position(|own| *own == e).unwrap();
                for (p, (value, sigma)) in f.setting.values.iter().zip(&f.setting.sigmas).enumerate() {
                    values += 1;
                    within += usize::from((value - truth[first + p]).abs() < 3.0 * sigma);
                }
            }
        }
        assert!(named >= 8, "{named}");
        assert!(within * 100 >= values * 95, "{within} of {values} within 3 sigma");
    }
}
