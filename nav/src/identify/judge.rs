//! Is it true? The additions of a selection before held-out data, one effect left out at a time, and the model residual before and
//! after. All of it is measured by the likelihood that chose: the flights linearised about their smoothed trajectories.

use super::evidence::SCALES;
use super::flight::Flight;
use super::linear::innovations::{Drift, Innovations};
use super::noise::{Noise, NoiseEntry};
use super::pass::Innovation;
use super::select::{Added, Point, Search, Selection, Settings};
use super::survey::{Survey, is_informed};
use super::whereabouts;
use super::{Workers, map};

pub use super::linear::innovations::DRIFT_S;

/// The disagreement of a model with some data.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualMeasure {
    /// Mean normalised innovation squared per degree of freedom.
    pub nis_per_dof: f64,
    /// The same per channel; `None` where the fixes have none.
    pub channels: [Option<f64>; 6],
    /// RMS of the innovations per channel, m and m/s.
    pub rms: [Option<f64>; 6],
    /// Logarithm of the likelihood.
    pub log_likelihood: f64,
    /// RMS of the horizontal position after 5, 10, 30 s without fixes, m.
    pub drift_m: [Option<f64>; 3],
}

/// One line of the leave-one-out table.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Effect.
    pub name: &'static str,
    /// Evidence that is lost without it, nats.
    pub evidence: f64,
    /// Log-likelihood of the held-out data that is lost without it.
    pub held_out: f64,
}

/// A selection after judgement.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The selection without the effects that the held-out data did not confirm; values refitted to all data.
    pub selection: Selection,
    /// Effects that were taken out again.
    pub removed: Vec<&'static str>,
    /// Chosen and fitted on this: before, after.
    pub fit: [ResidualMeasure; 2],
    /// Took no part: before, after.
    pub held_out: [ResidualMeasure; 2],
    /// What each effect contributes.
    pub left_out: Vec<LeftOut>,
    /// Innovations of the first flight, before and after.
    pub innovations: [Vec<Innovation>; 2],
    /// The rest of the catalogue.
    pub survey: Survey,
    /// The noise: what was assumed, and what the flights say.
    pub noise: Vec<NoiseEntry>,
}

/// Flights against a model: innovations and drifts of each.
#[derive(Clone)]
struct Measured {
    innovations: Vec<Innovations>,
    drifts: Vec<Drift>,
}

impl Measured {
    fn new(search: &Search<'_>, point: &Point) -> Self {
        let (model, references, problems) = search.at(point);
        let noise = &point.noise;
        let (flights, options) = (search.flights, search.options());
        let each = map(search.workers(), 2 * flights.len(), |k| {
            let (flight, k) = (flights[k / 2], (k / 2, k % 2));
            let problem = &problems[k.0];
            if k.1 == 0 {
                (Some(problem.innovations(noise, &options)), None)
            } else {
                (None, Some(references[k.0].drift(flight, &model, problem, noise, &options)))
            }
        });
        let (innovations, drifts): (Vec<_>, Vec<_>) = each.into_iter().unzip();
        Self {
            innovations: innovations.into_iter().flatten().collect(),
            drifts: drifts.into_iter().flatten().collect(),
        }
    }

    fn log_likelihood(&self, part: usize) -> f64 {
        self.innovations.iter().map(|i| i.log_likelihood[part]).sum()
    }

    fn part(&self, part: usize) -> ResidualMeasure {
        let (mut sum, mut count, mut square) = ([0.0; 6], [0usize; 6], [0.0; 6]);
        let fixes = self.innovations.iter().flat_map(|i| &i.fixes);
        for innovation in fixes.filter(|i| i.part == Some(part)) {
            for c in 0..6 {
                if let Some(v) = whereabouts::channel(innovation, c) {
                    let group = if c < 3 { &innovation.position } else { &innovation.velocity };
                    sum[c] += v * v;
                    square[c] += group.innovation[c % 3].powi(2);
                    count[c] += 1;
                }
            }
        }
        let (nis, dof) = self.innovations.iter().fold((0.0, 0), |(nis, dof), i| {
            let (own, n) = i.nis[part];
            (nis + own, dof + n)
        });
        let mean = |total: f64, n: usize| (n > 0).then(|| total / n as f64);
        ResidualMeasure {
            nis_per_dof: nis / dof.max(1) as f64,
            channels: std::array::from_fn(|c| mean(sum[c], count[c])),
            rms: std::array::from_fn(|c| mean(square[c], count[c]).map(f64::sqrt)),
            log_likelihood: self.log_likelihood(part),
            drift_m: std::array::from_fn(|k| {
                let (total, n) = self.drifts.iter().fold((0.0, 0), |(a, n), d| (a + d[k].0, n + d[k].1));
                mean(total, n).map(f64::sqrt)
            }),
        }
    }
}

/// The residuals of a model on the flights that chose it and, where there are any, on validation flights.
#[derive(Clone)]
struct Residuals {
    own: Measured,
    others: Option<Measured>,
}

impl Residuals {
    /// On held-out data: the validation flights, or the held-out blocks.
    fn held_out(&self) -> ResidualMeasure {
        self.others.as_ref().map_or_else(|| self.own.part(1), |others| others.part(0))
    }
}

/// Held-out log-likelihood that may be lost with what shows where it happens and hardly anywhere else (a jump), or in the
/// samples themselves (a sample reported twice).
const MAX_LOSS_OF_LOCAL_NATS: f64 = -3.0;
/// How many of its own standard deviations the gain of a true effect may fall short by in the held-out blocks.
const MAX_SHORTFALL_SIGMAS: f64 = 2.0;

/// Whether an effect shows where it happens, or in the samples, and hardly in the held-out blocks.
fn shows_elsewhere(left_out: &LeftOut) -> bool {
    crate::effects::find(left_out.name).is_some_and(|e| super::select::is_jump(e) || e.needs_neighbours())
}

/// Held-out log-likelihood that an effect may cost. Blocks of the same flight, one in `every`, have had their say in the evidence
/// already. A true effect gains in them its share g of what it gains elsewhere, with a variance of 2 g (the gain is that of
/// a Gaussian likelihood); so a weak one may lose there by chance, a strong one may not.
fn tolerated(left_out: &LeftOut, every: Option<u32>) -> f64 {
    if shows_elsewhere(left_out) {
        return MAX_LOSS_OF_LOCAL_NATS;
    }
    let Some(every) = every.filter(|e| *e > 1) else { return 0.0 };
    let gain = left_out.evidence.max(0.0) / f64::from(every - 1);
    (gain - MAX_SHORTFALL_SIGMAS * (2.0 * gain).sqrt()).min(0.0)
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

/// The flights that choose and those that judge.
struct HoldoutTest<'a> {
    search: Search<'a>,
    /// Validation flights; `None`: the held-out blocks judge.
    others: Option<Search<'a>>,
    noise: Noise,
}

impl<'a> HoldoutTest<'a> {
    fn new(
        flights: &'a [&'a Flight],
        validate: &'a [&'a Flight],
        selection: &Selection,
        settings: &Settings,
        workers: &'a dyn Workers,
    ) -> Self {
        let settings = Settings { options: selection.options, ..*settings };
        let whole = Settings { options: settings.options.all(), ..settings };
        Self {
            search: about(flights, selection, &settings, workers),
            others: (!validate.is_empty()).then(|| about(validate, selection, &whole, workers)),
            noise: selection.noise,
        }
    }

    /// One block in so many judges; `None` where other flights do.
    fn every(&self) -> Option<u32> {
        self.others.is_none().then_some(self.search.options().held_out_every)
    }

    /// The effects at their best values, their evidence, and the held-out likelihood.
    fn evaluate(&self, added: &[Added]) -> (Vec<Added>, f64, f64) {
        let all: Vec<Added> = self.search.given.iter().chain(added).cloned().collect();
        let (point, problems) = self.search.settle(&all, &self.noise, &self.search.empty(&self.noise), 1);
        let held_out = match &self.others {
            Some(others) => others.likelihood(&point.added, &self.noise),
            None => self.search.part_likelihood(&problems, &self.noise, 1),
        };
        let given = self.search.given.len();
        (point.added.into_iter().skip(given).collect(), point.evidence, held_out)
    }

    fn left_out(&self, added: &[Added], evidence: f64, held_out: f64) -> Vec<LeftOut> {
        map(self.search.workers(), added.len(), |k| {
            let mut fewer = added.to_vec();
            let gone = fewer.remove(k);
            let (_, without, without_held_out) = self.evaluate(&fewer);
            LeftOut {
                name: gone.setting.effect.name(),
                evidence: evidence - without,
                held_out: held_out - without_held_out,
            }
        })
    }

    /// Takes out of a selection what the held-out data do not confirm.
    fn confirmed(&self, mut selection: Selection) -> Confirmed {
        let (mut removed, mut left_out) = (Vec::new(), Vec::new());
        if selection.added.is_empty() {
            return Confirmed { selection, removed, left_out };
        }
        let every = self.every();
        while !selection.added.is_empty() {
            let (full, evidence, held_out) = self.evaluate(&selection.added);
            left_out = self.left_out(&full, evidence, held_out);
            selection.added = full;
            let worst = left_out
                .iter()
                .enumerate()
                .filter(|(_, l)| l.held_out <= tolerated(l, every) || l.evidence <= 0.0)
                .min_by(|a, b| a.1.held_out.total_cmp(&b.1.held_out))
                .map(|(k, _)| k);
            let Some(k) = worst else { break };
            removed.push(take_out(&mut selection, k));
            left_out.clear();
        }
        selection.added.iter_mut().for_each(widen);
        selection.added = self.evaluate(&selection.added).0;
        Confirmed { selection, removed, left_out }
    }

    /// These effects at their best values against the flights that chose, and at the same values against the validation flights
    /// where there are any.
    fn measured(&self, added: &[Added]) -> Residuals {
        let point = self.search.best(added, &self.noise);
        let others = self.others.as_ref().map(|others| {
            let (same, _) = others.settle(&point.added, &self.noise, &others.empty(&self.noise), 0);
            Measured::new(others, &same)
        });
        Residuals { own: Measured::new(&self.search, &point), others }
    }
}

/// Takes effect number `k` out of a selection; returns its name.
fn take_out(selection: &mut Selection, k: usize) -> &'static str {
    selection.steps.remove(k.min(selection.steps.len() - 1));
    selection.added.remove(k).setting.effect.name()
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

/// The width of the prior that suited the evidence best draws values toward zero; what is reported of them must not.
fn widen(added: &mut Added) {
    let own =
        added.setting.effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len()));
    for ((_, sigma), own) in added.prior.iter_mut().zip(own).filter(|(p, _)| p.1 > 0.0) {
        *sigma = own * SCALES[0];
    }
}

/// A search over flights about the trajectories that a selection shows.
pub(super) fn about<'a>(
    flights: &'a [&'a Flight],
    selection: &Selection,
    settings: &Settings,
    workers: &'a dyn Workers,
) -> Search<'a> {
    let all: Vec<Added> = selection.given.iter().chain(&selection.added).cloned().collect();
    let mut search = Search::about(flights, &selection.base, &all, settings, workers, &selection.noise);
    search.given.clone_from(&selection.given);
    search
}

/// Judges a selection: what the held-out data confirm, and the model residual before and after. An effect whose values are no better
/// known than its prior says keeps no name: it stands among what was tested, with its limit.
pub fn judge(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Judged {
    let mut removed = Vec::new();
    let mut judged = judge_all(flights, validate, selection, settings, workers);
    loop {
        let unknown = uninformed(&judged.selection.added);
        if unknown.is_empty() {
            break;
        }
        removed.append(&mut judged.removed);
        judged = judge_all(flights, validate, judged.selection.without(&unknown), settings, workers);
    }
    removed.append(&mut judged.removed);
    Judged { removed, ..judged }
}

/// Effects of whose values the flights say no more than their prior.
fn uninformed(added: &[Added]) -> Vec<&'static str> {
    added.iter().filter(|a| !is_informed(a)).map(|a| a.setting.effect.name()).collect()
}

/// The same with every effect that is confirmed.
fn judge_all(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Judged {
    let test = HoldoutTest::new(flights, validate, &selection, settings, workers);
    let Confirmed { mut selection, mut removed, mut left_out } = test.confirmed(selection);
    // Both with the noise of the better model: what an unmodelled effect does must not be absorbed by the noise.
    let before = test.measured(&[]);
    let after = loop {
        let all = if selection.added.is_empty() { before.clone() } else { test.measured(&selection.added) };
        // What makes the held-out data less likely is not reported as unmodelled.
        let excused = if left_out.iter().any(shows_elsewhere) { MAX_LOSS_OF_LOCAL_NATS } else { 0.0 };
        let worse = all.held_out().log_likelihood < before.held_out().log_likelihood + excused;
        let least = left_out.iter().enumerate().min_by(|a, b| a.1.held_out.total_cmp(&b.1.held_out));
        match least.map(|(k, _)| k).filter(|k| worse && *k < selection.added.len()) {
            Some(k) => {
                removed.push(take_out(&mut selection, k));
                left_out.remove(k);
            }
            None => break all,
        }
    };
    let (survey, noise) = take_survey(flights, &mut selection, settings, workers);
    let fit = [before.own.part(0), after.own.part(0)];
    let held_out = [before.held_out(), after.held_out()];
    let first = |m: Measured| m.innovations.into_iter().next().map(|i| i.fixes).unwrap_or_default();
    Judged {
        selection,
        removed,
        fit,
        held_out,
        left_out,
        innovations: [first(before.own), first(after.own)],
        survey,
        noise,
    }
}

/// Puts the reported values and sigmas into a selection, by all data: those of the survey, whose sigmas hold under misfit.
pub fn take_survey(
    flights: &[&Flight],
    selection: &mut Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> (Survey, Vec<NoiseEntry>) {
    let everything = Settings { options: selection.options.all(), ..*settings };
    let search = about(flights, selection, &everything, workers);
    let mut point = search.best(&selection.added, &selection.noise);
    let survey = Survey::take(&search, &mut point);
    let noise = search.noise_entries(&point);
    selection.added = point.added.into_iter().skip(search.given.len()).collect();
    (survey, noise)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_their_prior_keep_no_name() {
        let added = |name: &str, prior: &[f64], sigmas: &[f64]| {
            let effect = crate::effects::find(name).unwrap();
            let setting = crate::model::EffectSetting {
                sigmas: sigmas.to_vec(),
                ..crate::model::EffectSetting::unknown(effect)
            };
            Added { setting, prior: prior.iter().map(|p| (0.0, *p)).collect() }
        };
        let all = [
            added("vibration_rectification", &[0.4; 3], &[0.4, 0.39, 0.9]),
            added("gyro_scale_factor", &[0.02; 3], &[0.019, 0.001, 0.02]),
            // The instant of a jump is searched for and has no prior.
            added("gps_bias_step", &[0.0, 10.0, 10.0, 10.0], &[0.0, 9.8, 10.0, 10.0]),
            added("gyro_bias_step", &[0.0, 0.01, 0.01, 0.01], &[0.0, 0.01, 1e-4, 0.01]),
            added("accel_bias_drift", &[0.0], &[0.02]),
        ];
        assert_eq!(uninformed(&all), ["vibration_rectification", "gps_bias_step"]);
    }

    #[test]
    fn bad_luck_in_the_held_out_blocks_excuses_weak_effects_only() {
        let worth = |name, evidence| LeftOut { name, evidence, held_out: 0.0 };
        let blocks = |name, evidence| tolerated(&worth(name, evidence), Some(6));
        assert_eq!(tolerated(&worth("gps_latency", 6.0), None), 0.0);
        assert!((blocks("gps_latency", 10.0) + 2.0).abs() < 1e-12);
        assert!(blocks("gps_latency", 20.0) > blocks("gps_latency", 10.0));
        assert_eq!(blocks("gps_latency", 500.0), 0.0);
        assert_eq!(blocks("gps_latency", -1.0), 0.0);
        assert_eq!(blocks("gyro_bias_step", 500.0), MAX_LOSS_OF_LOCAL_NATS);
    }
}
