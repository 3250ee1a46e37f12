//! Is it true? The additions of a selection before held-out data, one effect left out at a time, and the model residual before and
//! after. All of it is measured by the likelihood that chose: the flights linearised about their smoothed trajectories.

use super::flight::Flight;
use super::holdout::{Gain, HoldoutTest, MAX_LOSS_OF_LOCAL_NATS, determined, differences, take_out};
use super::linear::innovations::{Drift, Innovations};
use super::noise::NoiseEntry;
use super::pass::Innovation;
use super::select::{Added, Point, Search, Selection, Settings};
use super::survey::{Survey, is_informed};
use super::{Workers, map};

pub use super::holdout::{Confirmed, LeftOut, confirm};
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
    /// Log-likelihood of each held-out block.
    held_out: Vec<f64>,
    /// Number of parameters that the fit part determined.
    parameters: f64,
}

impl Measured {
    fn new(search: &Search<'_>, point: &Point) -> Self {
        let (model, references, problems) = search.at(point);
        let noise = &point.noise;
        let (flights, options) = (search.flights, search.settings.options);
        let each = map(search.workers, 2 * flights.len(), |k| {
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
            held_out: search.part_by_block(&problems, noise, 1),
            parameters: determined(&point.added),
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
                if let Some(v) = innovation.channel(c) {
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

    /// What this model gains over another.
    fn gain_over(&self, other: &Self, share: Option<f64>) -> Gain {
        Gain {
            share,
            fit: self.own.log_likelihood(0) - other.own.log_likelihood(0),
            parameters: (self.own.parameters - other.own.parameters).max(0.0),
            blocks: differences(&self.own.held_out, &other.own.held_out),
        }
    }
}

impl HoldoutTest<'_> {
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
        // What makes the held-out data less likely than chance does is not reported as unmodelled.
        let local = left_out.iter().any(LeftOut::shows_elsewhere);
        let chance = all.gain_over(&before, test.share()).tolerated();
        let excused = if local { chance.min(MAX_LOSS_OF_LOCAL_NATS) } else { chance };
        let worse = all.held_out().log_likelihood < before.held_out().log_likelihood + excused;
        let least =
            left_out.iter().enumerate().min_by(|a, b| a.1.confirmation().total_cmp(&b.1.confirmation()));
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
    let added: Vec<Added> = selection.added.iter().map(as_wide_as_found).collect();
    let mut point = search.best(&added, &selection.noise);
    let survey = Survey::take(&search, &mut point);
    let noise = search.noise_entries(&point);
    selection.added = point.added.into_iter().skip(search.given.len()).collect();
    (survey, noise)
}

/// An effect with a prior no narrower than what was found of it (the width of the largest evidence: MacKay 1992, "Bayesian interpolation", section 4). A
/// unit that is mounted 5° off has misalignments of eight priors, and came out as 3.6° to 4.1° beside a G that took the rest, 4 sigma off.
fn as_wide_as_found(found: &Added) -> Added {
    let mut wide = found.clone();
    let mut at = 0;
    for group in found.setting.effect.groups() {
        let own = at..at + group.shape.len();
        at = own.end;
        let (Some(values), Some(priors)) = (found.setting.values.get(own.clone()), wide.prior.get_mut(own))
        else {
            continue;
        };
        let squares = values.iter().zip(&*priors).map(|(value, (mean, _))| (value - mean).powi(2));
        let rms = (squares.sum::<f64>() / values.len().max(1) as f64).sqrt();
        priors.iter_mut().filter(|(_, sigma)| *sigma > 0.0).for_each(|(_, sigma)| *sigma = sigma.max(rms));
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prior_is_no_narrower_than_what_was_found() {
        let effect = crate::effects::find("gyro_misalignment").unwrap();
        let found = |values: [f64; 6]| Added {
            setting: crate::model::EffectSetting {
                values: values.to_vec(),
                ..crate::model::EffectSetting::unknown(effect)
            },
            prior: vec![(0.0, 0.01); 6],
        };
        let sigma = |values| as_wide_as_found(&found(values)).prior[0].1;
        assert_eq!(sigma([0.005; 6]), 0.01);
        let turned = sigma([0.08, 0.0, -0.08, 0.0, 0.0, 0.0]);
        assert!((turned - (2.0 * 0.08_f64.powi(2) / 6.0).sqrt()).abs() < 1e-12, "{turned}");
    }

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
}
