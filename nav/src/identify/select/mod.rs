//! Forward selection: the effect with the most evidence is added, until none has enough.

mod choose;
mod closer;
mod joint;
mod jumps;
mod scan;
mod search;
mod settle;
mod split;

use super::Workers;
use super::flight::Flight;
use super::noise::Noise;
use super::pass::Options;
use crate::effects::{Effect, REGISTRY};
use crate::model::{EffectSetting, Model};

pub(super) use choose::are_enough;
pub(super) use scan::Glance;
pub(super) use search::{Point, Search};
pub(super) use settle::open;

/// What the selection may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// What counts.
    pub options: Options,
    /// Evidence that an effect needs, nats, over the whole catalogue: the logarithm of the odds against chance.
    pub threshold: f64,
    /// Evidence with which the fit part proposes an effect, nats.
    pub proposal: f64,
    /// Effects within this evidence of the best are reported together with it, nats.
    pub margin: f64,
    /// At most so many effects are added.
    pub most_effects: usize,
    /// Whether the reported values allow for what calibration leaves in any unit ([`crate::model::Model::with_tolerances`]), though no flight need
    /// show it: they are marginal over scale factors, misalignments and the antenna's place within their tolerances.
    pub tolerances: bool,
    /// Effects that are not looked for, whatever the flights say: a study's.
    pub without: Without,
    /// Effects that are looked for beside those of the catalogue.
    pub beside: Beside,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            options: Options::default(),
            threshold: 3.3,
            proposal: 1.0,
            margin: 3.2,
            most_effects: 12,
            tolerances: true,
            without: Without::default(),
            beside: Beside::default(),
        }
    }
}

/// Effects of the catalogue that a search does without.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Without(u64);

impl Without {
    /// The same, and this effect too.
    #[must_use]
    pub fn and(self, name: &str) -> Self {
        let place = REGISTRY.iter().position(|e| e.name() == name).and_then(|k| u32::try_from(k).ok());
        Self(self.0 | place.and_then(|k| 1u64.checked_shl(k)).unwrap_or(0))
    }

    /// Whether it does without this one.
    pub fn contains(self, name: &str) -> bool {
        let alone = Self::default().and(name);
        alone != Self::default() && self.0 & alone.0 == alone.0
    }
}

/// At most so many effects are looked for beside those of the catalogue.
const MOST_BESIDE: usize = 24;

/// Effects that a search has beside those of the catalogue: a user's, or formulas.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside([Option<&'static dyn Effect>; MOST_BESIDE]);

impl Beside {
    /// The same, and these too; those beyond the place that there is are left out.
    #[must_use]
    pub fn and(mut self, effects: &[&'static dyn Effect]) -> Self {
        for effect in effects {
            if self.iter().all(|e| e.name() != effect.name())
                && let Some(free) = self.0.iter_mut().find(|e| e.is_none())
            {
                *free = Some(*effect);
            }
        }
        self
    }

    /// Each of them.
    pub fn iter(&self) -> impl Iterator<Item = &'static dyn Effect> {
        self.0.into_iter().flatten()
    }
}

impl PartialEq for Beside {
    fn eq(&self, other: &Self) -> bool {
        self.iter().map(Effect::name).eq(other.iter().map(Effect::name))
    }
}

/// So many other candidates are looked at closely by [`best_other`].
const MOST_OTHERS: usize = 2;

/// What comes this close to its limit has been stopped by it.
const AT_LIMIT: f64 = 0.99;

/// An effect that has been added, with the value that the flights say.
#[derive(Debug, Clone)]
pub struct Added {
    /// The effect with its present values (sigmas are those of the estimate).
    pub setting: EffectSetting,
    /// Prior mean and sigma of each parameter.
    pub prior: Vec<(f64, f64)>,
}

impl Added {
    /// Whether the flights would have it larger than it may be: then it stands for something else.
    pub fn is_at_limit(&self) -> bool {
        closer::sizes_within(self.setting.effect)
            .is_some_and(|(_, most)| self.setting.values.first().is_some_and(|v| *v > AT_LIMIT * most))
    }
}

/// One candidate with its evidence.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// With the values that fit best.
    pub setting: EffectSetting,
    /// Prior mean and sigma of each parameter.
    pub prior: Vec<(f64, f64)>,
    /// Logarithm of the odds that it is there.
    pub evidence: f64,
    /// What not knowing its instant or the width of its prior costs, nats: part of `evidence`.
    pub cost: f64,
}

/// What a step of the selection found.
#[derive(Debug, Clone)]
pub struct Step {
    /// Effects within the margin, best first.
    pub group: Vec<&'static str>,
    /// Evidence of the best.
    pub evidence: f64,
    /// Gain of the log-likelihood, each model with its own noise.
    pub log_likelihood_gain: f64,
    /// The same less half the number of parameters times the logarithm of the number of fixes.
    pub bic_gain: f64,
    /// Every candidate that was looked at: name, evidence.
    pub candidates: Vec<(&'static str, f64)>,
}

/// The result of the selection.
#[derive(Debug, Clone)]
pub struct Selection {
    /// The model that was given.
    pub base: Model,
    /// Noise fitted without any addition.
    pub base_noise: Noise,
    /// Noise with all of them.
    pub noise: Noise,
    /// What the given model leaves to be estimated, at the values that were found beside the effects added.
    pub given: Vec<Added>,
    /// Effects added, in the order found.
    pub added: Vec<Added>,
    /// How they were found; one per entry of `added`.
    pub steps: Vec<Step>,
    /// The candidates of the last look that found nothing: name, evidence.
    pub remaining: Vec<(&'static str, f64)>,
    /// Log-likelihood of the fit part before and after.
    pub log_likelihood: [f64; 2],
    /// What counted.
    pub options: Options,
}

impl Selection {
    /// The model with everything that was added, as known values.
    pub fn model(&self) -> Model {
        with(&self.base, &self.added)
    }

    /// The selection without these effects.
    #[must_use]
    pub fn without(mut self, names: &[&str]) -> Self {
        let keep: Vec<bool> = self.added.iter().map(|a| !names.contains(&a.setting.effect.name())).collect();
        let mut kept = keep.iter();
        self.steps.retain(|_| kept.next().copied().unwrap_or(true));
        let mut kept = keep.iter();
        self.added.retain(|_| kept.next().copied().unwrap_or(true));
        self
    }
}

/// The model with these effects as known values.
pub fn with(base: &Model, added: &[Added]) -> Model {
    let mut model = base.clone();
    for a in added {
        let mut setting = a.setting.clone();
        setting.sigmas.fill(0.0);
        model.set(setting);
    }
    model
}

/// Whether it is an event: an instant that is searched for, and a size.
pub fn is_jump(effect: &dyn Effect) -> bool {
    effect.event().is_some()
}

/// Whether it walks: how fast is found by trying.
pub fn is_drift(effect: &dyn Effect) -> bool {
    !effect.sizes_to_try().is_empty()
}

pub(super) fn is_linear(effect: &dyn Effect) -> bool {
    effect.groups().iter().any(|g| g.is_state()) && !is_jump(effect)
}

/// Prior sigma of each parameter from the effect's definition; 0 for what is no state.
pub(super) fn prior_sigmas(effect: &dyn Effect) -> Vec<f64> {
    effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len())).collect()
}

/// The noise that suits a model best, looked for from `start` on, and the log-likelihood of the fit part with it.
pub fn best_noise(
    flights: &[&Flight],
    model: &Model,
    start: &Noise,
    settings: &Settings,
    workers: &dyn Workers,
) -> (Noise, f64) {
    let point = Search::new(flights, model, settings, workers, start).start(start);
    (point.noise, point.log_likelihood)
}

/// The best of the candidates that are not `known`, each with its own values and noise.
pub fn best_other(
    flights: &[&Flight],
    base: &Model,
    start: &Noise,
    known: &[&str],
    settings: &Settings,
    workers: &dyn Workers,
) -> Option<Candidate> {
    let mut search = Search::new(flights, base, settings, workers, start);
    let point = search.start(start);
    let mut scanned = search.scan(&point, None);
    scanned.retain(|c| !known.contains(&c.setting.effect.name()));
    scanned.truncate(MOST_OTHERS);
    search.close_looks(&scanned, &point, &point).into_iter().next().map(|l| l.0)
}

/// Fits the noise and adds effects until none has enough evidence.
///
/// The fit part proposes; then all data judge what was proposed. By the chain rule of probability the evidence of
/// all data is that of the fit part and how well the held-out blocks were predicted with it, so an effect that they speak against
/// loses its place, and one of a group that they speak against leaves it. Values are in the end those of the fit part.
pub fn select(flights: &[&Flight], base: &Model, settings: &Settings, workers: &dyn Workers) -> Selection {
    let measured = Noise::measured(base, flights);
    let mut search = Search::new(flights, base, settings, workers, &measured);
    let mut start = search.start(&measured);
    if search.turn_phase_to_jump(&start) {
        start = search.start(&start.noise);
    }
    let everything = search.settings.options.all();
    let mut chosen = search.choose(start.clone(), settings.proposal.min(settings.threshold));
    let mut point = start.clone();
    if !chosen.found.is_empty() {
        chosen = search.hearing(everything).confirm(chosen);
        if search.turn_phase_to_jumps_of(&chosen.point) {
            start = search.start(&start.noise);
        }
        point = search.fitted(&chosen.point, &start);
    }
    let added = point.added.split_off(search.given.len());
    Selection {
        options: search.settings.options,
        base: base.clone(),
        base_noise: start.noise,
        noise: point.noise,
        log_likelihood: [start.log_likelihood, point.log_likelihood],
        given: point.added,
        added,
        steps: chosen.found.into_iter().map(|f| f.step).collect(),
        remaining: chosen.remaining,
    }
}

#[cfg(test)]
mod tests {
    use super::Without;

    #[test]
    fn what_is_taken_out_of_the_catalogue_takes_nothing_else_out() {
        let without = Without::default().and("gps_lever_arm");
        assert!(without.contains("gps_lever_arm"));
        assert!(!without.contains("gps_latency") && !without.contains("formula:gyro~current"));
        assert!(
            !Without::default().contains("gps_lever_arm") && !Without::default().contains("formula:gyro~w_x")
        );
    }
}
