//! Is it true? The additions of a selection before data that took no part in it, one effect left out at a time, and how far
//! the pure simulation drifts away without fixes.

use super::evidence::SCALES;
use super::flight::Flight;
use super::noise::{Noise, NoiseEntry};
use super::pass::{self, Innovation, Options, Pass};
use super::select::{Added, Search, Selection, Settings};
use super::survey::Survey;
use super::whereabouts;
use super::{Workers, map};
use crate::mechanization::{self, Increment};
use crate::model::Model;

/// Drift is told over these times, s.
pub const DRIFT_S: [f64; 3] = [5.0, 10.0, 30.0];
/// A drift starts this often, s.
const DRIFT_EVERY_S: f64 = 10.0;

/// The disagreement of a model with some data.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Mean squared normalised innovation per degree of freedom.
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
    pub fit: [Gap; 2],
    /// Took no part: before, after.
    pub held_out: [Gap; 2],
    /// What each effect contributes.
    pub left_out: Vec<LeftOut>,
    /// Innovations of the first flight, before and after.
    pub innovations: [Vec<Innovation>; 2],
    /// The rest of the catalogue.
    pub survey: Survey,
    /// The noise: what was assumed, and what the flights say.
    pub noise: Vec<NoiseEntry>,
}

fn gap(passes: &[Pass], drifts: &[[(f64, usize); 3]], part: usize) -> Gap {
    let (mut sum, mut count) = ([0.0; 6], [0usize; 6]);
    let mut square = [0.0; 6];
    for innovation in passes.iter().flat_map(|p| &p.innovations).filter(|i| i.part == Some(part)) {
        for c in 0..6 {
            if let Some(v) = whereabouts::channel(innovation, c) {
                let group = if c < 3 { &innovation.position } else { &innovation.velocity };
                sum[c] += v * v;
                square[c] += group.innovation[c % 3].powi(2);
                count[c] += 1;
            }
        }
    }
    let (nis, dof) = passes.iter().fold((0.0, 0), |(a, n), p| {
        let [(x, i), (y, j)] = p.nis[part];
        (a + x + y, n + i + j)
    });
    let mean = |total: f64, n: usize| (n > 0).then(|| total / n as f64);
    Gap {
        nis_per_dof: nis / dof.max(1) as f64,
        channels: std::array::from_fn(|c| mean(sum[c], count[c])),
        rms: std::array::from_fn(|c| mean(square[c], count[c]).map(f64::sqrt)),
        log_likelihood: passes.iter().map(|p| p.log_likelihood[part]).sum(),
        drift_m: std::array::from_fn(|k| {
            let (total, n) = drifts.iter().fold((0.0, 0), |(a, n), d| (a + d[k].0, n + d[k].1));
            mean(total, n).map(f64::sqrt)
        }),
    }
}

/// Squared horizontal errors after the times of [`DRIFT_S`] without fixes, with their number.
fn drift(flight: &Flight, model: &Model, noise: &Noise, options: &Options) -> [(f64, usize); 3] {
    struct Free {
        since_s: f64,
        nav: crate::mechanization::NavState,
        calibration: crate::filter::calibration::Calibration,
        done: usize,
    }
    let model_with_noise = noise.of(model);
    let mut out = [(0.0, 0); 3];
    let mut free: Vec<Free> = Vec::new();
    let mut next_start = flight.initial().t_s + options.settle_s;
    let mut fixes = flight.fixes().iter().peekable();
    let mut last: Option<crate::sample::ImuSample> = None;
    pass::follow(flight, model, noise, |filter, sample| {
        if let Some(before) = &last {
            let rates = flight.force_rates();
            for f in &mut free {
                let lag_s = f.calibration.rate_lag_s(&model_with_noise);
                let [a, b] = [before, sample].map(|s| {
                    f.calibration.around = rates.around(s.t_s, lag_s);
                    f.calibration.motion(&model_with_noise, s)
                });
                let inc = Increment::between(&a, &b, flight.stream().kind, sample.t_s - before.t_s);
                f.nav = mechanization::step(&f.nav, &inc);
            }
        }
        if sample.t_s >= next_start {
            next_start = sample.t_s + DRIFT_EVERY_S;
            free.push(Free {
                since_s: sample.t_s,
                nav: filter.nav,
                calibration: filter.calibration,
                done: 0,
            });
        }
        // A fix tells of the vehicle its delay ago.
        while let Some(fix) = fixes.next_if(|f| f.t_s <= sample.t_s) {
            for f in &mut free {
                let age = sample.t_s - f.since_s;
                if f.done < DRIFT_S.len() && age >= DRIFT_S[f.done] {
                    let c_ne = f.nav.geodetic().c_en().transpose();
                    let behind = sample.t_s - fix.t_s + filter.fix_delay_s;
                    let d = c_ne * (f.nav.r_e - f.nav.v_e * behind - fix.position.to_ecef());
                    out[f.done].0 += d.x * d.x + d.y * d.y;
                    out[f.done].1 += 1;
                    f.done += 1;
                }
            }
        }
        free.retain(|f| f.done < DRIFT_S.len());
        last = Some(*sample);
    });
    out
}

/// Model and data as they stand to each other.
fn measure(
    flights: &[&Flight],
    model: &Model,
    noise: &Noise,
    options: &Options,
    workers: &dyn Workers,
) -> (Vec<Pass>, Vec<[(f64, usize); 3]>) {
    let passes = map(workers, flights.len(), |k| pass::run(flights[k], model, noise, options, None));
    let drifts = map(workers, flights.len(), |k| drift(flights[k], model, noise, options));
    (passes, drifts)
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
struct Court<'a> {
    search: Search<'a>,
    /// Flights that took no part; `None`: the held-out blocks judge.
    others: Option<Search<'a>>,
    noise: Noise,
}

impl<'a> Court<'a> {
    fn new(
        flights: &'a [&'a Flight],
        validate: &'a [&'a Flight],
        selection: &Selection,
        settings: &Settings,
        workers: &'a dyn Workers,
    ) -> Self {
        let whole = Settings { options: settings.options.all(), ..*settings };
        Self {
            search: about(flights, selection, settings, workers),
            others: (!validate.is_empty()).then(|| about(validate, selection, &whole, workers)),
            noise: selection.noise,
        }
    }

    /// The effects at their best values, their evidence, and the held-out likelihood.
    fn hear(&self, added: &[Added]) -> (Vec<Added>, f64, f64) {
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
            let (_, without, without_held_out) = self.hear(&fewer);
            LeftOut {
                name: gone.setting.effect.name(),
                evidence: evidence - without,
                held_out: held_out - without_held_out,
            }
        })
    }
}

/// Takes out what the held-out data do not confirm. `validate` are flights that took no part; without any, the held-out
/// blocks of `flights` judge.
pub fn confirm(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Confirmed {
    let mut selection = selection;
    let (mut removed, mut left_out) = (Vec::new(), Vec::new());
    if selection.added.is_empty() {
        return Confirmed { selection, removed, left_out };
    }
    let settings = &Settings { options: selection.options, ..*settings };
    let every = validate.is_empty().then_some(settings.options.held_out_every);
    let court = Court::new(flights, validate, &selection, settings, workers);
    while !selection.added.is_empty() {
        let (full, evidence, held_out) = court.hear(&selection.added);
        left_out = court.left_out(&full, evidence, held_out);
        selection.added = full;
        let worst = left_out
            .iter()
            .enumerate()
            .filter(|(_, l)| l.held_out <= tolerated(l, every) || l.evidence <= 0.0)
            .min_by(|a, b| a.1.held_out.total_cmp(&b.1.held_out))
            .map(|(k, _)| k);
        let Some(k) = worst else { break };
        removed.push(selection.added.remove(k).setting.effect.name());
        selection.steps.remove(k.min(selection.steps.len() - 1));
        left_out.clear();
    }
    selection.added.iter_mut().for_each(widen);
    selection.added = court.hear(&selection.added).0;
    Confirmed { selection, removed, left_out }
}

/// The width of the prior that suited the evidence best draws values toward zero; what is told of them must not.
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
    Search::about(flights, &selection.base, &selection.added, settings, workers, &selection.noise)
}

/// Judges a selection: what the held-out data confirm, and the gap before and after.
pub fn judge(
    flights: &[&Flight],
    validate: &[&Flight],
    selection: Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Judged {
    let Confirmed { mut selection, mut removed, mut left_out } =
        confirm(flights, validate, selection, settings, workers);
    let options = selection.options;
    // Both with the noise of the better model: what the lacking effect does must not hide in the noise.
    let measured = |model: &Model, noise: &Noise| {
        let own = measure(flights, model, noise, &options, workers);
        let held_out = if validate.is_empty() {
            gap(&own.0, &own.1, 1)
        } else {
            let (passes, drifts) = measure(validate, model, noise, &options.all(), workers);
            gap(&passes, &drifts, 0)
        };
        (own, held_out)
    };
    let (before, held_out_before) = measured(&selection.base, &selection.noise);
    let (after, held_out_after) = loop {
        let all = measured(&selection.model(), &selection.noise);
        // What makes the data that took no part less likely is not reported as missing.
        let excused = if left_out.iter().any(shows_elsewhere) { MAX_LOSS_OF_LOCAL_NATS } else { 0.0 };
        let worse = all.1.log_likelihood < held_out_before.log_likelihood + excused;
        let least = left_out.iter().enumerate().min_by(|a, b| a.1.held_out.total_cmp(&b.1.held_out));
        match least.map(|(k, _)| k).filter(|k| worse && *k < selection.added.len()) {
            Some(k) => {
                removed.push(selection.added.remove(k).setting.effect.name());
                selection.steps.remove(k.min(selection.steps.len() - 1));
                left_out.remove(k);
            }
            None => break all,
        }
    };
    let fit = [gap(&before.0, &before.1, 0), gap(&after.0, &after.1, 0)];
    let held_out = [held_out_before, held_out_after];
    let first = |passes: Vec<Pass>| passes.into_iter().next().map(|p| p.innovations).unwrap_or_default();
    let innovations = [first(before.0), first(after.0)];
    let (survey, noise) = take_survey(flights, &mut selection, settings, workers);
    Judged { selection, removed, fit, held_out, left_out, innovations, survey, noise }
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
