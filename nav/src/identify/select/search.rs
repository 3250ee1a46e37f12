//! The flights at one model: effects at their values, the noise, the likelihood.

use super::super::evidence;
use super::super::flight::Flight;
use super::super::linear::Problem;
use super::super::linear::reference::Reference;
use super::super::noise::{self, Fitted, Limits, Metric, Noise};
use super::super::pass::{Information, Options};
use super::super::{Workers, map};
use super::{Added, Candidate, Settings, Step, with};
use crate::filter::watch::Watched;
use crate::model::{EffectSetting, Model};
use std::sync::Arc;

/// Gauss-Newton steps when values are looked for.
pub(in crate::identify) const STEPS: usize = 3;
/// A trajectory that turns by less than this when it is found anew is good enough to linearise about, rad.
const STRAIGHT: f64 = 0.01;
/// One that turns by more than this was no place to linearise about: it is looked for from the start, rad.
const CROOKED: f64 = 0.1;
/// A trajectory is found anew at most so often.
const MOST_BENDS: usize = 3;
/// A step shorter than this share of the sigma ends the search for values.
const SMALL: f64 = 0.1;

/// The search over one set of flights.
#[derive(Clone)]
pub(in crate::identify) struct Search<'a> {
    pub(in crate::identify) flights: &'a [&'a Flight],
    /// The model that is believed, with nothing in it to be estimated.
    pub(super) base: Model,
    pub(super) settings: Settings,
    pub(super) workers: &'a dyn Workers,
    pub(super) limits: Limits,
    pub(super) metric: Metric,
    /// What the model itself leaves to be estimated.
    pub(in crate::identify) given: Vec<Added>,
    references: Trajectories,
}

/// The trajectory of each flight.
type Trajectories = Arc<Vec<Reference>>;

/// A model at one point: the effects added with their values (those that the model leaves open first), the noise.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Point {
    pub(in crate::identify) added: Vec<Added>,
    pub(in crate::identify) noise: Noise,
    /// Marginal log-likelihood of the fit part, priors of the added effects included.
    pub(in crate::identify) evidence: f64,
    pub(in crate::identify) log_likelihood: f64,
    /// The trajectories that the flights were linearised about.
    references: Trajectories,
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
    pub(in crate::identify) fn new(
        flights: &'a [&'a Flight],
        base: &Model,
        settings: &Settings,
        workers: &'a dyn Workers,
        noise: &Noise,
    ) -> Self {
        let (known, given) = split(base);
        let fixes = flights.iter().map(|f| f.fixes().len()).sum();
        let search = Self {
            flights,
            limits: Limits::new(base, flights),
            base: known,
            settings: *settings,
            workers,
            metric: Metric::new(fixes),
            given,
            references: Arc::default(),
        };
        let references = Arc::new(search.trajectories(&search.base, noise));
        Self { references, ..search }
    }

    /// The same search about the trajectories of a model with these effects.
    pub(in crate::identify) fn about(self, added: &[Added], noise: &Noise) -> Self {
        let model = self.model(added);
        Self { references: Arc::new(self.trajectories(&model, noise)), ..self }
    }

    /// The same search with other data counting.
    pub(super) fn hearing(&self, options: Options) -> Self {
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

    /// The trajectories for this model, and the flights linearised about them.
    fn linearise(
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

    /// The trajectories that the flights show with a model; `None` where they are those that it was linearised about.
    fn straightened(&self, point: &Point, problems: &[Problem]) -> Option<Trajectories> {
        let better =
            map(self.workers, problems.len(), |k| point.references[k].smoothed(&problems[k], &point.noise));
        let bends = better.iter().zip(point.references.iter()).map(|(b, r)| b.bend(r));
        let bend = bends.fold(0.0, f64::max);
        let anew = || self.trajectories(&self.model(&point.added), &point.noise);
        (bend > STRAIGHT).then(|| Arc::new(if bend > CROOKED { anew() } else { better }))
    }

    fn trajectories(&self, model: &Model, noise: &Noise) -> Vec<Reference> {
        map(self.workers, self.flights.len(), |k| {
            Reference::find(self.flights[k], model, noise, self.workers)
        })
    }

    /// Log-likelihood and information, all flights together.
    pub(super) fn run(&self, problems: &[Problem], noise: &Noise) -> (f64, Information) {
        let mut runs =
            map(self.workers, problems.len(), |k| problems[k].run(noise, &self.settings.options)).into_iter();
        let Some(first) = runs.next() else { return (0.0, Information::zeros(0, 0)) };
        let [mut information, _] = first.information;
        let mut log_likelihood = first.log_likelihood[0];
        for run in runs {
            log_likelihood += run.log_likelihood[0];
            information.add(&run.information[0]);
        }
        (log_likelihood, information)
    }

    /// These effects, beside what the model leaves open, at the values that fit best.
    pub(in crate::identify) fn best(&self, added: &[Added], noise: &Noise) -> Point {
        let all: Vec<Added> = self.given.iter().chain(added).cloned().collect();
        self.settle(&all, noise, &self.nowhere(noise), STEPS).0
    }

    /// Log-likelihood of one part (0: fit, 1: held out) with these effects.
    pub(in crate::identify) fn likelihood(&self, added: &[Added], noise: &Noise, part: usize) -> f64 {
        let (_, problems) = self.settle(added, noise, &self.nowhere(noise), 0);
        problems.iter().map(|p| p.run(noise, &self.settings.options).log_likelihood[part]).sum()
    }

    /// Who does the work.
    pub(in crate::identify) fn workers(&self) -> &'a dyn Workers {
        self.workers
    }

    /// Moves the added effects to the values that fit best and says how good that is; with the flights linearised there.
    /// Starts from the trajectories of `from`.
    pub(in crate::identify) fn settle(
        &self,
        added: &[Added],
        noise: &Noise,
        from: &Point,
        steps: usize,
    ) -> (Point, Vec<Problem>) {
        let (mut point, mut problems) = self.climb(added, noise, &from.references, steps);
        for _ in 0..MOST_BENDS {
            let Some(references) = self.straightened(&point, &problems) else { break };
            (point, problems) = self.climb(&point.added, noise, &references, steps);
        }
        (point, problems)
    }

    /// The same from trajectories that are found with these effects.
    pub(super) fn settle_anew(&self, added: &[Added], noise: &Noise) -> (Point, Vec<Problem>) {
        let references = Arc::new(self.trajectories(&self.model(added), noise));
        self.climb(added, noise, &references, 0)
    }

    fn climb(
        &self,
        added: &[Added],
        noise: &Noise,
        references: &Trajectories,
        steps: usize,
    ) -> (Point, Vec<Problem>) {
        let mut added = added.to_vec();
        let mut best: Option<(Point, Vec<Problem>)> = None;
        for k in 0..=steps {
            let watched =
                Watched { effects: added.iter().map(|a| a.setting.clone()).collect(), ..Watched::default() };
            let references = best.as_ref().map_or(references, |b| &b.0.references);
            let (references, problems) = self.linearise(references, &self.model(&added), &watched);
            let (log_likelihood, information) = self.run(&problems, noise);
            let Some(fit) = fit_added(&information, &watched, &mut added) else { break };
            let evidence = log_likelihood + fit.evidence + self.told_by_samples(&added);
            // A step too far is not taken over.
            if best.as_ref().is_some_and(|b| evidence <= b.0.evidence) {
                break;
            }
            let point = Point { added: added.clone(), noise: *noise, evidence, log_likelihood, references };
            best = Some((point, problems));
            if k == steps || !step(&fit, &watched, &mut added) {
                break;
            }
        }
        best.unwrap_or_else(|| (self.nowhere(noise), Vec::new()))
    }

    /// What the samples themselves say for mistakes of the source.
    fn told_by_samples(&self, added: &[Added]) -> f64 {
        let mistakes = added.iter().map(|a| a.setting.effect).filter(|e| e.is_source_mistake());
        mistakes.map(|e| self.flights.iter().map(|f| e.told_by(f.told())).sum::<f64>()).sum()
    }

    /// Before anything is known: the model as it is, about the first trajectories.
    pub(in crate::identify) fn nowhere(&self, noise: &Noise) -> Point {
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

    /// The model as it is, with the noise that suits it.
    pub(super) fn start(&mut self, noise: &Noise) -> Point {
        let (mut point, mut problems) = self.settle(&self.given, noise, &self.nowhere(noise), 0);
        for _ in 0..2 {
            let fitted = self.fit_noise(&problems, &point.noise);
            self.metric = fitted.metric;
            (point, problems) = self.settle(&point.added, &fitted.noise, &point, STEPS);
        }
        self.references = point.references.clone();
        point
    }

    /// The effects of a point at the values, and with the noise, that suit this search's data; about the trajectories of `from`.
    pub(super) fn fitted(&self, point: &Point, from: &Point) -> Point {
        let (settled, problems) = self.settle(&point.added, &point.noise, from, STEPS);
        let noise = self.fit_noise(&problems, &settled.noise).noise;
        let (better, _) = self.settle(&settled.added, &noise, &settled, STEPS);
        if better.evidence > settled.evidence { better } else { settled }
    }

    /// What a step of the selection tells.
    pub(super) fn step(
        &self,
        best: &Candidate,
        looks: &[(Candidate, Point)],
        remaining: &[(&'static str, f64)],
        gain: f64,
    ) -> Step {
        let fixes: usize = self.flights.iter().map(|f| f.fixes().len()).sum();
        let parameters = best.setting.effect.len() as f64;
        let told = |l: &(Candidate, Point)| (l.0.setting.effect.name(), l.0.evidence);
        let other = |r: &&(&'static str, f64)| looks.iter().all(|l| l.0.setting.effect.name() != r.0);
        Step {
            group: looks
                .iter()
                .map(told)
                .filter(|l| l.1 > best.evidence - self.settings.margin)
                .map(|l| l.0)
                .collect(),
            evidence: best.evidence,
            log_likelihood_gain: gain,
            bic_gain: gain - 0.5 * parameters * (fixes as f64).ln(),
            candidates: looks.iter().map(told).chain(remaining.iter().filter(other).copied()).collect(),
        }
    }
}

/// Prior sigma and distance from the prior mean of each watched parameter.
pub(in crate::identify) fn priors(added: &[Added], watched: &Watched) -> (Vec<f64>, Vec<f64>) {
    let own =
        |(e, p): (usize, usize)| added.get(e).map(|a| (a.prior[p].1, a.prior[p].0 - a.setting.values[p]));
    watched.slots().into_iter().filter_map(own).unzip()
}

/// Columns whose prior lets them move.
fn open(sigma: &[f64]) -> Vec<usize> {
    (0..sigma.len()).filter(|k| sigma[*k] > 0.0).collect()
}

fn fit_added(information: &Information, watched: &Watched, added: &mut [Added]) -> Option<evidence::Fit> {
    let (sigma, offset) = priors(added, watched);
    let columns = open(&sigma);
    let pick = |v: &[f64]| -> Vec<f64> { columns.iter().map(|k| v[*k]).collect() };
    let fit = evidence::fit(information, &columns, &pick(&sigma), &pick(&offset))?;
    let slots = watched.slots();
    for (i, k) in columns.iter().enumerate() {
        let (e, p) = slots[*k];
        set(&mut added[e].setting, p, fit.covariance[(i, i)]);
    }
    Some(fit)
}

fn set(setting: &mut EffectSetting, parameter: usize, variance: f64) {
    setting.sigmas[parameter] = variance.max(0.0).sqrt();
}

/// Takes the step of a fit; `false` where it is not worth taking.
fn step(fit: &evidence::Fit, watched: &Watched, added: &mut [Added]) -> bool {
    let (sigma, _) = priors(added, watched);
    let slots = watched.slots();
    let columns = open(&sigma);
    let moves = || columns.iter().enumerate().map(|(i, k)| (slots[*k], fit.step[i]));
    if moves().all(|((e, p), by)| by.abs() < SMALL * added[e].setting.sigmas[p]) {
        return false;
    }
    let all: Vec<_> = moves().collect();
    all.into_iter().for_each(|((e, p), by)| added[e].setting.values[p] += by);
    true
}
