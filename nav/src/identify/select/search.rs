//! The flights at one model: effects at their values, the noise, the likelihood.

use super::super::flight::Flight;
use super::super::linear::forward::Run;
use super::super::linear::reference::Reference;
use super::super::linear::{self, About, Problem};
use super::super::noise::{self, Claims, Fitted, Limits, Metric, Noise, NoiseEntry};
use super::super::pass::{Information, Options};
use super::super::{Workers, map};
use super::settle::STEPS;
use super::{Added, Candidate, Settings, Step, with};
use crate::effects::{BiasWalk, Effect, REGISTRY};
use crate::identify::watched::Watched;
use crate::math::ln;
use crate::model::{EffectSetting, Model};
use std::sync::Arc;

/// The search over one set of flights.
#[derive(Clone)]
pub(in crate::identify) struct Search<'a> {
    pub(in crate::identify) flights: &'a [&'a Flight],
    /// The model that is assumed, with nothing in it to be estimated.
    pub(in crate::identify) base: Model,
    pub(in crate::identify) settings: Settings,
    /// Who does the work.
    pub(in crate::identify) workers: &'a dyn Workers,
    pub(super) limits: Limits,
    pub(super) claims: Claims,
    pub(super) metric: Metric,
    /// What the model itself leaves to be estimated.
    pub(in crate::identify) given: Vec<Added>,
    pub(super) references: Trajectories,
}

/// The trajectory of each flight.
pub(in crate::identify) type Trajectories = Arc<Vec<Reference>>;

/// A model at one point: the effects added with their values (those that the model leaves open first), the noise.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Point {
    pub(in crate::identify) added: Vec<Added>,
    pub(in crate::identify) noise: Noise,
    /// Marginal log-likelihood of the fit part, priors of the added effects included.
    pub(in crate::identify) evidence: f64,
    pub(in crate::identify) log_likelihood: f64,
    /// The trajectories that the flights were linearised about.
    pub(super) references: Trajectories,
}

/// Log-likelihood of the fit part, and information of fit part and held-out blocks, all flights together.
pub(super) fn together(runs: Vec<Run>) -> (f64, [Information; 2]) {
    let mut runs = runs.into_iter();
    let none = || (0.0, [Information::zeros(0), Information::zeros(0)]);
    let Some(first) = runs.next() else { return none() };
    let (mut log_likelihood, mut information) = (first.log_likelihood[0], first.information);
    for run in runs {
        log_likelihood += run.log_likelihood[0];
        information.iter_mut().zip(&run.information).for_each(|(sum, own)| sum.add(own));
    }
    (log_likelihood, information)
}

/// Splits a model into what is known and what is to be estimated.
fn split(base: &Model) -> (Model, Vec<Added>) {
    let (mut known, mut given) = (base.clone(), Vec::new());
    for setting in &mut known.effects {
        if setting.estimated() > 0 {
            let prior = setting.values.iter().copied().zip(setting.sigmas.iter().copied()).collect();
            setting.sigmas.fill(0.0);
            given.push(Added { setting: setting.clone(), prior });
        }
    }
    (known, given)
}

impl<'a> Search<'a> {
    /// About the trajectories that the flights show with a model as it is.
    pub(in crate::identify) fn new(
        flights: &'a [&'a Flight],
        base: &Model,
        settings: &Settings,
        workers: &'a dyn Workers,
        noise: &Noise,
    ) -> Self {
        Self::about(flights, base, &[], settings, workers, noise)
    }

    /// About those that they show with these effects in it.
    pub(in crate::identify) fn about(
        flights: &'a [&'a Flight],
        base: &Model,
        added: &[Added],
        settings: &Settings,
        workers: &'a dyn Workers,
        noise: &Noise,
    ) -> Self {
        let (known, given) = split(base);
        let fixes = flights.iter().map(|f| f.fixes().len()).sum();
        let search = Self {
            flights,
            limits: Limits::new(base, flights),
            claims: Claims::new(base, flights),
            base: known,
            settings: *settings,
            workers,
            metric: Metric::new(fixes),
            given,
            references: Arc::default(),
        };
        let references = Arc::new(search.trajectories(&search.model(added), noise));
        Self { references, ..search }
    }

    /// The same search with other data counting.
    pub(in crate::identify) fn hearing(&self, options: Options) -> Self {
        Self { settings: Settings { options, ..self.settings }, ..self.clone() }
    }

    /// The model with these effects as known values.
    pub(super) fn model(&self, added: &[Added]) -> Model {
        with(&self.base, added)
    }

    /// The flights linearised about a model, about the trajectories of a point.
    pub(in crate::identify) fn problems(&self, point: &Point, watched: &Watched) -> Vec<Problem> {
        self.linearise(&point.references, &self.model(&point.added), watched).1
    }

    /// The model, its trajectories and the flights linearised about them at a point, with nothing watched.
    pub(in crate::identify) fn at(&self, point: &Point) -> (Model, Trajectories, Vec<Problem>) {
        let model = self.model(&point.added);
        let (references, problems) = self.linearise(&point.references, &model, &Watched::default());
        (model, references, problems)
    }

    /// The trajectories for this model, and the flights linearised about them.
    pub(super) fn linearise(
        &self,
        references: &Trajectories,
        model: &Model,
        watched: &Watched,
    ) -> (Trajectories, Vec<Problem>) {
        let linearised = map(self.workers, self.flights.len(), |k| {
            let reference = references[k].with(self.flights[k], model);
            let problem = Problem::new(self.flights[k], model, &reference, watched, self.workers);
            (reference, problem)
        });
        let (references, problems) = linearised.into_iter().unzip();
        (Arc::new(references), problems)
    }

    /// The random walk of the biases with these effects.
    pub(in crate::identify) fn walk(&self, added: &[Added]) -> BiasWalk {
        linear::walk(&self.model(added))
    }

    /// Log-likelihood and information at a point of however many watched parameters, for each of some random walks of the biases the runs
    /// of all flights: these are linearised on the way and not kept.
    pub(in crate::identify) fn run_through(
        &self,
        point: &Point,
        watched: &Watched,
        walks: &[BiasWalk],
        block_s: Option<f64>,
    ) -> Vec<Vec<Run>> {
        let (model, options) = (self.model(&point.added), &self.settings.options);
        let of_flights = map(self.workers, self.flights.len(), |k| {
            let reference = point.references[k].with(self.flights[k], &model);
            let about = About::new(self.flights[k], &model, &reference, watched);
            Problem::run_through(&about, walks, (&point.noise, options), block_s, self.workers)
        });
        let mut of_flights: Vec<_> = of_flights.into_iter().map(Vec::into_iter).collect();
        walks.iter().map(|_| of_flights.iter_mut().filter_map(Iterator::next).collect()).collect()
    }

    pub(super) fn trajectories(&self, model: &Model, noise: &Noise) -> Vec<Reference> {
        map(self.workers, self.flights.len(), |k| {
            Reference::find(self.flights[k], model, noise, self.workers)
        })
    }

    /// Log-likelihood of the fit part, and information of fit part and held-out blocks, all flights together.
    pub(in crate::identify) fn run(&self, problems: &[Problem], noise: &Noise) -> (f64, [Information; 2]) {
        together(map(self.workers, problems.len(), |k| problems[k].run(noise, &self.settings.options)))
    }

    /// Squared normalised innovations of the fit part, and their number.
    pub(in crate::identify) fn nis(&self, problems: &[Problem], noise: &Noise) -> (f64, usize) {
        let each =
            map(self.workers, problems.len(), |k| problems[k].run(noise, &self.settings.options).nis[0]);
        each.into_iter().fold((0.0, 0), |sum, own| (sum.0 + own.0, sum.1 + own.1))
    }

    /// Adds what the file of the unit says of several constants together to the information of the flights, and gives its logarithm.
    pub(in crate::identify) fn correlate(
        &self,
        added: &[Added],
        watched: &Watched,
        information: &mut Information,
    ) -> f64 {
        super::joint::correlate(self.base.joint.as_deref(), added, watched, information)
    }

    /// These effects, beside what the model leaves open, at the values that fit best.
    pub(in crate::identify) fn best(&self, added: &[Added], noise: &Noise) -> Point {
        let all: Vec<Added> = self.given.iter().chain(added).cloned().collect();
        self.settle(&all, noise, &self.empty(noise), STEPS).0
    }

    /// Log-likelihood with these effects at these values, block by block.
    pub(in crate::identify) fn by_block(&self, added: &[Added], noise: &Noise) -> Vec<f64> {
        let (_, problems) = self.settle(added, noise, &self.empty(noise), 0);
        self.part_by_block(&problems, noise, 0)
    }

    /// Log-likelihood of each block of one part (0: fit, 1: held out) of linearised flights.
    pub(in crate::identify) fn part_by_block(
        &self,
        problems: &[Problem],
        noise: &Noise,
        part: usize,
    ) -> Vec<f64> {
        problems.iter().flat_map(|p| p.by_block(noise, &self.settings.options, part)).collect()
    }

    /// Log-likelihood of one part (0: fit, 1: held out) of linearised flights.
    pub(in crate::identify) fn part_likelihood(
        &self,
        problems: &[Problem],
        noise: &Noise,
        part: usize,
    ) -> f64 {
        let run = |p: &Problem| p.run_walking(p.walk(), noise, &self.settings.options).log_likelihood[part];
        problems.iter().map(run).sum()
    }

    /// The effects that the model lacks or holds at a fixed value beside these, as they enter the search.
    pub(in crate::identify) fn lacking(&self, added: &[Added]) -> Vec<EffectSetting> {
        let Settings { without, beside, .. } = &self.settings;
        let is_added = |name: &str| added.iter().any(|a| a.setting.effect.name() == name);
        let of = |effect: &'static dyn Effect| {
            if effect.needs_temperature() && !self.flights.iter().any(|f| f.has_temperature()) {
                return None;
            }
            let known = |name: &str| self.base.get(name).is_some() && !is_added(name);
            if effect.needs_known().is_some_and(|name| !known(name)) {
                return None;
            }
            match self.base.get(effect.name()) {
                Some(known) if known.estimated() > 0 || effect.is_empty() => None,
                Some(known) => Some(known.clone()),
                None => {
                    Some(EffectSetting { sigmas: vec![0.0; effect.len()], ..EffectSetting::unknown(effect) })
                }
            }
        };
        let sought = REGISTRY.iter().copied().chain(beside.iter());
        sought.filter(|e| !without.contains(e.name()) && !is_added(e.name())).filter_map(of).collect()
    }

    /// What the samples themselves say for faults of the source.
    pub(super) fn evidence_of_samples(&self, added: &[Added]) -> f64 {
        let mistakes = added.iter().map(|a| a.setting.effect).filter(|e| e.is_source_mistake());
        mistakes.map(|e| self.flights.iter().map(|f| e.reported_by(f.reported())).sum::<f64>()).sum()
    }

    /// Before anything is known: the model as it is, about the first trajectories.
    pub(in crate::identify) fn empty(&self, noise: &Noise) -> Point {
        Point {
            added: self.given.clone(),
            noise: *noise,
            evidence: f64::NEG_INFINITY,
            log_likelihood: f64::NEG_INFINITY,
            references: self.references.clone(),
        }
    }

    /// Fits the noise to flights linearised at a model.
    pub(super) fn fit_noise(&self, problems: &[Problem], start: &Noise) -> Fitted {
        noise::fit(problems, *start, &self.limits, &self.metric, &self.settings.options, self.workers)
    }

    /// Every figure of the noise of a point, with what was claimed.
    pub(in crate::identify) fn noise_entries(&self, point: &Point) -> Vec<NoiseEntry> {
        let problems = self.problems(point, &Watched::default());
        let options = &self.settings.options;
        self.claims.entries(&problems, &point.noise, &self.limits, options, self.workers)
    }

    /// The same effects with noise no larger than claimed, where that of the point has grown so far that it may stand for another
    /// effect.
    pub(super) fn held(&self, point: &Point) -> Option<Point> {
        if !self.claims.has_grown(&point.noise) {
            return None;
        }
        let limits = self.claims.held(&self.limits);
        let problems = self.problems(point, &super::settle::watching(&point.added));
        let options = &self.settings.options;
        let fitted = noise::fit(&problems, point.noise, &limits, &self.metric, options, self.workers);
        Some(self.settle_again(&point.added, &fitted.noise, point, problems).0)
    }

    /// The model as it is, with the noise that suits it.
    pub(in crate::identify) fn start(&mut self, noise: &Noise) -> Point {
        let (mut point, mut problems) = self.settle(&self.given, noise, &self.empty(noise), 0);
        for _ in 0..2 {
            let fitted = self.fit_noise(&problems, &point.noise);
            self.metric = fitted.metric;
            (point, problems) = self.settle_again(&point.added, &fitted.noise, &point, problems);
        }
        self.references = point.references.clone();
        point
    }

    /// The effects of a point at the values, and with the noise, that suit this search's data; about the trajectories of `from`.
    pub(super) fn fitted(&self, point: &Point, from: &Point) -> Point {
        let (settled, problems) = self.settle(&point.added, &point.noise, from, STEPS);
        let noise = self.fit_noise(&problems, &settled.noise).noise;
        let mut added = settled.added.clone();
        self.resize(&mut added, (&problems, &noise));
        let (better, _) = self.settle_again(&added, &noise, &settled, problems);
        if better.evidence > settled.evidence { better } else { settled }
    }

    /// What a step of the selection shows.
    pub(super) fn step(
        &self,
        best: &Candidate,
        looks: &[(Candidate, Point)],
        remaining: &[(&'static str, f64)],
        gain: f64,
    ) -> Step {
        let fixes: usize = self.flights.iter().map(|f| f.fixes().len()).sum();
        let parameters = best.setting.effect.len() as f64;
        let reported = |l: &(Candidate, Point)| (l.0.setting.effect.name(), l.0.evidence);
        // A name of the catalogue stands alone only where no formula explains as much: what a formula pays for the grammar makes it less likely,
        // not its explanation worse.
        let (own_cost, margin) = (best.setting.effect.prior_cost(), self.settings.margin);
        let near = |l: &&(Candidate, Point)| {
            let more = (l.0.setting.effect.prior_cost() - own_cost).max(0.0);
            l.0.evidence > best.evidence - margin.max(more)
        };
        let other = |r: &&(&'static str, f64)| looks.iter().all(|l| l.0.setting.effect.name() != r.0);
        Step {
            group: looks.iter().filter(near).map(|l| l.0.setting.effect.name()).collect(),
            evidence: best.evidence,
            log_likelihood_gain: gain,
            bic_gain: gain - 0.5 * parameters * ln(fixes as f64),
            candidates: looks.iter().map(reported).chain(remaining.iter().filter(other).copied()).collect(),
        }
    }
}
