//! Held-out data against each effect of a selection: what the effect gains there, and whether that is less than a true effect may
//! gain by chance.
//!
//! A difference of held-out log-likelihoods is a sum over blocks and has a standard error, that of their scatter (Vehtari, Gelman &
//! Gabry 2017, "Practical Bayesian model evaluation using leave-one-out cross-validation and WAIC", Statistics and Computing 27). Of few blocks that
//! scatter is badly known itself and falls short for models that predict nearly the same (Sivula, Magnusson, Matamoros & Vehtari
//! 2020, "Uncertainty in Bayesian leave-one-out cross-validation based model comparison"), so the variance that a Gaussian likelihood
//! has is the least that is taken. What is to be expected follows from the information that the held-out blocks hold on the effect: few
//! blocks may lie where hardly any of it is excited.

use super::evidence::SCALES;
use super::flight::Flight;
use super::linear::Problem;
use super::map;
use super::noise::Noise;
use super::pass::Information;
use super::select::{Added, Point, Search, Selection, Settings};
use super::{Workers, judge};
use crate::identify::watched::Watched;
use nalgebra::DVector;

/// Held-out log-likelihood that may be lost with what shows where it happens and hardly anywhere else (a jump), or in the
/// samples themselves (a sample reported twice).
pub(super) const MAX_LOSS_OF_LOCAL_NATS: f64 = -3.0;
/// How many of its own standard deviations the gain of a true effect may fall short by in the held-out blocks: chance does that to one true
/// effect in 740. (With two, one flight in eleven with four true effects would lose one of them.)
const MAX_SHORTFALL_SIGMAS: f64 = 3.0;

/// What a model gains over one without some effects: in the data that its values were fitted to, and in those held out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gain {
    /// Log-likelihood of the fit part.
    pub fit: f64,
    /// Number of parameters that the fit part determined, Σ 1 − σ²/σ₀² with the prior's σ₀.
    pub parameters: f64,
    /// Size of the held-out blocks as a share of the fit part; `None` where other flights judge.
    pub share: Option<f64>,
    /// Log-likelihood of each held-out block.
    pub blocks: Vec<f64>,
}

impl Gain {
    /// Of all held-out data.
    pub fn held_out(&self) -> f64 {
        self.blocks.iter().sum()
    }

    /// Standard error of that by the scatter of the blocks; `None` of fewer than two.
    pub fn standard_error(&self) -> Option<f64> {
        let n = self.blocks.len() as f64;
        let mean = self.held_out() / n;
        let square: f64 = self.blocks.iter().map(|b| (b - mean).powi(2)).sum();
        (self.blocks.len() > 1).then(|| (n / (n - 1.0) * square).sqrt())
    }

    /// Mean and 1-sigma of what a true effect of this gain in the fit part gains in held-out blocks of `share` times its size.
    ///
    /// With k parameters fitted, the gain of the fit part is by k/2 more than that of the true values; held-out blocks lose k/2 · share by the
    /// errors of the same fit. The gain g of the true values scatters by 2 g (it is that of a Gaussian likelihood), what was
    /// lost by as much again, and g is known from the fit part to within its own scatter.
    fn expected(&self, share: f64) -> (f64, f64) {
        let lost = 0.5 * self.parameters * share;
        let true_gain = (self.fit - 0.5 * self.parameters).max(0.0) * share;
        let variance = 2.0 * true_gain * (1.0 + share) + 2.0 * lost * (1.0 + 0.5 * share);
        let sigma = variance.sqrt().max(self.standard_error().unwrap_or(0.0));
        (true_gain - lost, sigma)
    }

    /// Held-out log-likelihood that a true effect may cost by chance. Blocks of the flights that chose have had their say in the evidence
    /// already; where other flights judge it may cost nothing.
    pub(super) fn tolerated(&self) -> f64 {
        let Some((mean, sigma)) = self.share.map(|share| self.expected(share)) else { return 0.0 };
        (mean - MAX_SHORTFALL_SIGMAS * sigma).min(0.0)
    }
}

/// One line of the leave-one-out table.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Effect.
    pub name: &'static str,
    /// Evidence that is lost without it, nats.
    pub evidence: f64,
    /// Log-likelihoods that are lost without it.
    pub gain: Gain,
}

impl LeftOut {
    /// Log-likelihood of the held-out data that is lost without it.
    pub fn held_out(&self) -> f64 {
        self.gain.held_out()
    }

    /// Whether it shows where it happens, or in the samples, and hardly in the held-out blocks.
    pub(super) fn shows_elsewhere(&self) -> bool {
        crate::effects::find(self.name).is_some_and(|e| super::select::is_jump(e) || e.needs_neighbours())
    }

    /// Held-out log-likelihood that it may cost.
    fn tolerated(&self) -> f64 {
        if self.shows_elsewhere() { MAX_LOSS_OF_LOCAL_NATS } else { self.gain.tolerated() }
    }

    /// Whether the held-out data refute it.
    fn is_refuted(&self) -> bool {
        self.held_out() <= self.tolerated() || self.evidence <= 0.0
    }

    /// By how many sigmas the held-out data gain more than with a true effect on average; where other flights judge, what they gain.
    pub(super) fn confirmation(&self) -> f64 {
        let expected = self.gain.share.map(|share| self.gain.expected(share));
        expected.map_or_else(
            || self.held_out(),
            |(mean, sigma)| (self.held_out() - mean) / sigma.max(f64::MIN_POSITIVE),
        )
    }
}

/// A selection without the effects that the held-out data did not confirm.
#[derive(Debug, Clone)]
pub struct Confirmed {
    /// What is left of it.
    pub selection: Selection,
    /// Effects that were taken out again.
    pub removed: Vec<&'static str>,
    /// What each effect contributes.
    pub left_out: Vec<LeftOut>,
}

/// Effects at their best values.
struct Evaluated {
    /// Those that the model leaves open come first.
    all: Vec<Added>,
    evidence: f64,
    log_likelihood: f64,
    /// Log-likelihood of each held-out block.
    held_out: Vec<f64>,
}

impl Evaluated {
    /// Size of the held-out blocks as a share of the fit part, by the information that either (the argument) has on what sets this model apart from another
    /// without effect number `k`. `None` for an effect that has no values.
    fn share(&self, [fit, held_out]: &[Information; 2], other: &Self, k: usize) -> Option<f64> {
        let watched = Watched { effects: self.all.iter().map(|a| a.setting.clone()).collect() };
        let slots = watched.slots();
        slots.iter().any(|(effect, _)| *effect == k).then_some(())?;
        let apart = |&(effect, parameter): &(usize, usize)| {
            let own = &self.all[effect];
            let same = |o: &&Added| o.setting.effect.name() == own.setting.effect.name();
            let theirs = other.all.iter().find(same).map(|o| o.setting.values[parameter]);
            own.setting.values[parameter] - theirs.unwrap_or(own.prior[parameter].0)
        };
        let apart = DVector::from_iterator(slots.len(), slots.iter().map(apart));
        let [fit, held_out] = [fit, held_out].map(|i| apart.dot(&(&i.matrix * &apart)));
        (fit > 0.0).then(|| (held_out / fit).clamp(0.0, 1.0))
    }

    fn gain_over(&self, other: &Self, share: Option<f64>) -> Gain {
        Gain {
            fit: self.log_likelihood - other.log_likelihood,
            parameters: (determined(&self.all) - determined(&other.all)).max(0.0),
            share,
            blocks: differences(&self.held_out, &other.held_out),
        }
    }
}

/// Block by block.
pub(super) fn differences(with: &[f64], without: &[f64]) -> Vec<f64> {
    with.iter().zip(without).map(|(a, b)| a - b).collect()
}

/// Number of parameters that the data determined rather than the prior (MacKay 2003, section 28.1). A size that is found by trying
/// counts as one.
pub(super) fn determined(added: &[Added]) -> f64 {
    let one = |(sigma, (_, prior)): (&f64, &(f64, f64))| match (*sigma > 0.0, *prior > 0.0) {
        (true, true) => (1.0 - (sigma / prior).powi(2)).max(0.0),
        (true, false) => 1.0,
        _ => 0.0,
    };
    added.iter().flat_map(|a| a.setting.sigmas.iter().zip(&a.prior).map(one)).sum()
}

/// The flights that choose and those that judge.
pub(super) struct HoldoutTest<'a> {
    pub(super) search: Search<'a>,
    /// Validation flights; `None`: the held-out blocks judge.
    pub(super) others: Option<Search<'a>>,
    pub(super) noise: Noise,
}

impl<'a> HoldoutTest<'a> {
    pub(super) fn new(
        flights: &'a [&'a Flight],
        validate: &'a [&'a Flight],
        selection: &Selection,
        settings: &Settings,
        workers: &'a dyn Workers,
    ) -> Self {
        let settings = Settings { options: selection.options, ..*settings };
        let whole = Settings { options: settings.options.all(), ..settings };
        Self {
            search: judge::about(flights, selection, &settings, workers),
            others: (!validate.is_empty()).then(|| judge::about(validate, selection, &whole, workers)),
            noise: selection.noise,
        }
    }

    /// Size of the held-out blocks as a share of the fit part, by time; `None` where other flights judge.
    pub(super) fn share(&self) -> Option<f64> {
        let every = self.search.settings.options.held_out_every;
        (self.others.is_none() && every > 1).then(|| f64::from(every - 1).recip())
    }

    /// The effects at their best values, their evidence, and the held-out likelihood; the flights linearised there.
    fn evaluate(&self, added: &[Added]) -> (Evaluated, Vec<Problem>) {
        let all: Vec<Added> = self.search.given.iter().chain(added).cloned().collect();
        let (point, problems) = self.search.settle(&all, &self.noise, &self.search.empty(&self.noise), 1);
        let held_out = match &self.others {
            Some(others) => others.by_block(&point.added, &self.noise),
            None => self.search.part_by_block(&problems, &self.noise, 1),
        };
        let Point { added: all, evidence, log_likelihood, .. } = point;
        (Evaluated { all, evidence, log_likelihood, held_out }, problems)
    }

    /// The effects without those that the model leaves open.
    fn added(&self, evaluated: Evaluated) -> Vec<Added> {
        evaluated.all.into_iter().skip(self.search.given.len()).collect()
    }

    fn left_out(&self, full: &Evaluated, problems: Vec<Problem>) -> Vec<LeftOut> {
        let given = self.search.given.len();
        let by_time = self.share();
        let information = by_time.map(|_| self.search.run(&problems, &self.noise).1);
        drop(problems);
        map(self.search.workers, full.all.len() - given, |k| {
            let mut fewer = full.all[given..].to_vec();
            let gone = fewer.remove(k);
            let (without, _) = self.evaluate(&fewer);
            let by_information = information.as_ref().and_then(|i| full.share(i, &without, given + k));
            let share = by_information.or(by_time);
            LeftOut {
                name: gone.setting.effect.name(),
                evidence: full.evidence - without.evidence,
                gain: full.gain_over(&without, share),
            }
        })
    }

    /// Takes out of a selection what the held-out data do not confirm.
    pub(super) fn confirmed(&self, mut selection: Selection) -> Confirmed {
        let (mut removed, mut left_out) = (Vec::new(), Vec::new());
        if selection.added.is_empty() {
            return Confirmed { selection, removed, left_out };
        }
        while !selection.added.is_empty() {
            let (full, problems) = self.evaluate(&selection.added);
            left_out = self.left_out(&full, problems);
            selection.added = self.added(full);
            let refuted = left_out.iter().enumerate().filter(|(_, l)| l.is_refuted());
            let worst = refuted.min_by(|a, b| a.1.confirmation().total_cmp(&b.1.confirmation()));
            let Some((k, _)) = worst else { break };
            removed.push(take_out(&mut selection, k));
            left_out.clear();
        }
        selection.added.iter_mut().for_each(widen);
        selection.added = self.added(self.evaluate(&selection.added).0);
        Confirmed { selection, removed, left_out }
    }
}

/// Takes effect number `k` out of a selection; returns its name.
pub(super) fn take_out(selection: &mut Selection, k: usize) -> &'static str {
    selection.steps.remove(k.min(selection.steps.len() - 1));
    selection.added.remove(k).setting.effect.name()
}

/// The width of the prior that suited the evidence best draws values toward zero; what is reported of them must not.
fn widen(added: &mut Added) {
    let own =
        added.setting.effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len()));
    for ((_, sigma), own) in added.prior.iter_mut().zip(own).filter(|(p, _)| p.1 > 0.0) {
        *sigma = own * SCALES[0];
    }
}

/// Takes out what the held-out data do not confirm. `validate` are validation flights; without any, the held-out
/// blocks of `flights` judge.
pub fn confirm(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Confirmed {
    HoldoutTest::new(flights, validate, &selection, settings, workers).confirmed(selection)
}

#[cfg(test)]
mod tests {
    use crate::math::ln;

    use super::*;
    use crate::testing::Normal;

    /// One flight of a Gaussian model with ten held-out blocks that make a sixth of it: the gain of an effect with as many
    /// parameters, each of them `size` sigmas of the whole flight from zero, and its evidence with a prior of three.
    fn gain(parameters: usize, size: f64, normal: &mut Normal) -> (Gain, f64) {
        let (fit, block): (f64, f64) = (5.0 / 6.0, 1.0 / 60.0);
        let values: Vec<f64> = (0..parameters).map(|_| size + normal.next() / fit.sqrt()).collect();
        let mut one = || {
            let score = |v: &f64| v * (size * block + normal.next() * block.sqrt()) - 0.5 * v * v * block;
            values.iter().map(score).sum::<f64>()
        };
        let blocks = (0..10).map(|_| one()).collect();
        let gain = 0.5 * fit * values.iter().map(|v| v * v).sum::<f64>();
        let evidence = gain - 0.5 * parameters as f64 * ln(1.0 + 9.0 * fit);
        (Gain { fit: gain, parameters: parameters as f64, share: Some(0.2), blocks }, evidence)
    }

    /// Of weak true effects that have the evidence for a name, whatever their number of parameters, the held-out blocks refute
    /// one in a hundred. (By the evidence alone, without what the parameters cost, they took out 17 % of those with nine.)
    #[test]
    fn a_weak_true_effect_is_not_lost_by_the_scatter_of_the_held_out_blocks() {
        let mut normal = Normal(1);
        for (parameters, square) in
            [(1, 10.0), (1, 35.0), (3, 10.0), (3, 35.0), (9, 20.0), (9, 35.0), (9, 80.0)]
        {
            let size = (square / parameters as f64).sqrt();
            let (mut named, mut lost) = (0, 0);
            for _ in 0..2000 {
                let (gain, evidence) = gain(parameters, size, &mut normal);
                if evidence > 3.3 {
                    named += 1;
                    lost += usize::from(gain.held_out() <= gain.tolerated());
                }
            }
            let share = lost as f64 / named as f64;
            assert!(named > 300 && share < 0.01, "{parameters} parameters, {square}: {lost} of {named}");
        }
    }

    #[test]
    fn a_strong_effect_that_the_held_out_blocks_do_not_show_is_refuted() {
        let blocks = vec![0.3, -0.5, 0.2, -0.1, 0.0, -0.2];
        let strong = Gain { fit: 500.0, parameters: 3.0, share: Some(0.2), blocks };
        assert_eq!(strong.tolerated(), 0.0);
        assert!(strong.held_out() < 0.0);
        let weak = Gain { fit: 8.0, ..strong.clone() };
        assert!((-6.0..-3.0).contains(&weak.tolerated()), "{}", weak.tolerated());
        // Other flights owe nothing to the evidence.
        assert_eq!(Gain { share: None, ..weak.clone() }.tolerated(), 0.0);
        // Blocks in which the effect hardly acts neither confirm nor refute it.
        let dull = Gain { share: Some(0.01), ..strong };
        assert!(dull.held_out() > dull.tolerated(), "{}", dull.tolerated());
    }

    /// Blocks that scatter more than a Gaussian likelihood does say less.
    #[test]
    fn the_scatter_of_the_blocks_counts_where_it_is_larger() {
        let calm = Gain { fit: 20.0, parameters: 3.0, share: Some(0.2), blocks: vec![-0.4; 10] };
        let wild =
            Gain { blocks: vec![-9.4, 8.6, -5.4, 4.6, -0.4, -0.4, 3.6, -4.4, 6.6, -7.4], ..calm.clone() };
        assert!((calm.held_out() - wild.held_out()).abs() < 1e-9);
        assert!(calm.standard_error().unwrap() < 1e-9 && wild.standard_error().unwrap() > 15.0);
        assert!(wild.tolerated() < 3.0 * calm.tolerated());
    }

    #[test]
    fn what_shows_elsewhere_has_a_bound_of_its_own() {
        let left_out = |name, blocks| LeftOut {
            name,
            evidence: 500.0,
            gain: Gain { fit: 500.0, parameters: 3.0, share: Some(0.2), blocks },
        };
        assert!(!left_out("gyro_bias_step", vec![-1.0, -1.5]).is_refuted());
        assert!(left_out("gyro_bias_step", vec![-1.0, -2.5]).is_refuted());
        assert!(left_out("gps_latency", vec![-1.0, 0.5]).is_refuted());
    }
}
