//! Forward selection: the effect with the most evidence is added, until none has enough.

use super::evidence::{self, SCALES, log_mean_exp};
use super::flight::Flight;
use super::noise::{self, Noise};
use super::pass::{self, Information, Options};
use super::{Workers, map};
use crate::effects::{Effect, REGISTRY};
use crate::filter::watch::Watched;
use crate::model::{EffectSetting, Model};
use crate::sample::{Quantisation, Steps};

/// What the selection may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// What counts.
    pub options: Options,
    /// Evidence that an effect needs, nats, over the whole catalogue: the logarithm of the odds against chance.
    pub threshold: f64,
    /// Effects within this evidence of the best are told together with it, nats.
    pub margin: f64,
    /// At most so many effects are added.
    pub most_effects: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { options: Options::default(), threshold: 6.0, margin: 5.0, most_effects: 5 }
    }
}

/// Spacing of the instants at which jumps are looked for, s: gyro, position.
const JUMP_SPACING_S: [f64; 2] = [2.0, 1.0];
/// Jumps this close to either end of the flight are not looked for, s.
const JUMP_MARGIN_S: f64 = 10.0;
/// Candidates this far behind the best are not looked at again, nats.
const HOPELESS: f64 = 15.0;
/// At most so many candidates are looked at again.
const CLOSE_LOOKS: usize = 4;
/// Gauss-Newton steps of a close look.
const STEPS: usize = 2;

/// An effect that has been added, with the value that the flights say.
#[derive(Debug, Clone)]
pub struct Added {
    /// The effect with its present values (sigmas are those of the estimate).
    pub setting: EffectSetting,
    /// Prior mean and sigma of each parameter.
    pub prior: Vec<(f64, f64)>,
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

/// The effects that a model lacks or holds at a fixed value, as they enter the search.
fn lacking(base: &Model, flights: &[&Flight], added: &[Added]) -> Vec<EffectSetting> {
    REGISTRY
        .iter()
        .filter(|e| added.iter().all(|a| a.setting.effect.name() != e.name()))
        .filter_map(|effect| {
            let temperature = effect.name().ends_with("_temperature");
            if temperature && !flights.iter().any(|f| f.has_temperature()) {
                return None;
            }
            match base.get(effect.name()) {
                Some(known) if known.estimated() > 0 || effect.is_empty() => None,
                Some(known) => Some(known.clone()),
                None => {
                    Some(EffectSetting { sigmas: vec![0.0; effect.len()], ..EffectSetting::unknown(*effect) })
                }
            }
        })
        .collect()
}

pub(super) fn is_jump(effect: &dyn Effect) -> bool {
    effect.groups().first().is_some_and(|g| !g.is_state()) && effect.groups().len() > 1
}

fn is_linear(effect: &dyn Effect) -> bool {
    effect.groups().iter().any(|g| g.is_state()) && !is_jump(effect)
}

/// Prior sigma of each parameter from the effect's definition; 0 for what is no state.
fn prior_sigmas(effect: &dyn Effect) -> Vec<f64> {
    effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len())).collect()
}

/// The search over one set of flights.
pub(super) struct Search<'a> {
    pub(super) flights: &'a [&'a Flight],
    pub(super) base: &'a Model,
    pub(super) settings: Settings,
    pub(super) workers: &'a dyn Workers,
}

/// A model at one point: the effects added with their values, the noise.
#[derive(Debug, Clone)]
pub(super) struct Point {
    pub(super) added: Vec<Added>,
    pub(super) noise: Noise,
    /// Marginal log-likelihood of the fit part, priors of the added effects included.
    pub(super) evidence: f64,
    pub(super) log_likelihood: f64,
}

impl Search<'_> {
    /// Log-likelihood and information, all flights together.
    fn run(&self, model: &Model, noise: &Noise, watched: Option<&Watched>) -> (f64, Option<Information>) {
        let mut sum: Option<Information> = None;
        let mut log_likelihood = 0.0;
        let passes = map(self.workers, self.flights.len(), |k| {
            let pass = pass::run(self.flights[k], model, noise, &self.settings.options, watched);
            (pass.log_likelihood[0], pass.information)
        });
        for (value, information) in passes {
            log_likelihood += value;
            if let Some([fit, _]) = information {
                match &mut sum {
                    Some(s) => s.add(&fit),
                    None => sum = Some(fit),
                }
            }
        }
        (log_likelihood, sum)
    }

    /// Moves the added effects to the values that fit best and says how good that is.
    pub(super) fn settle(&self, added: &[Added], noise: &Noise, steps: usize) -> Point {
        let mut added = added.to_vec();
        let mut point =
            Point { added: added.clone(), noise: *noise, evidence: f64::NEG_INFINITY, log_likelihood: 0.0 };
        for k in 0..=steps {
            let model = with(self.base, &added);
            let watched =
                Watched { effects: added.iter().map(|a| a.setting.clone()).collect(), ..Watched::default() };
            let (log_likelihood, information) = self.run(&model, noise, Some(&watched));
            let Some(information) = information else { return point };
            let slots = watched.slots();
            let sigma: Vec<f64> = slots.iter().map(|(e, p)| added[*e].prior[*p].1).collect();
            let offset: Vec<f64> =
                slots.iter().map(|(e, p)| added[*e].prior[*p].0 - added[*e].setting.values[*p]).collect();
            let columns: Vec<usize> = (0..slots.len()).collect();
            let Some(fit) = evidence::fit(&information, &columns, &sigma, &offset) else { return point };
            let evidence = log_likelihood + fit.evidence;
            for (i, (e, p)) in slots.iter().enumerate() {
                added[*e].setting.sigmas[*p] = fit.covariance[(i, i)].max(0.0).sqrt();
            }
            // A step too far is not taken over.
            let better = evidence > point.evidence || k == 0;
            if better {
                point = Point { added: added.clone(), noise: *noise, evidence, log_likelihood };
            }
            if k == steps || !better {
                break;
            }
            let small = slots
                .iter()
                .enumerate()
                .all(|(i, (e, p))| fit.step[i].abs() < 0.1 * added[*e].setting.sigmas[*p]);
            if small {
                break;
            }
            for (i, (e, p)) in slots.iter().enumerate() {
                added[*e].setting.values[*p] += fit.step[i];
            }
        }
        point
    }

    fn jump_times(&self) -> [Vec<f64>; 2] {
        // Jumps are events of one flight; with several flights they are looked for in the first alone.
        let Some(flight) = self.flights.first().filter(|_| self.flights.len() == 1) else {
            return [vec![], vec![]];
        };
        let from = flight.initial().t_s + self.settings.options.settle_s;
        let to = flight.initial().t_s + flight.duration_s() - JUMP_MARGIN_S;
        JUMP_SPACING_S.map(|spacing| {
            let n = ((to - from) / spacing).max(0.0) as usize;
            (0..n).map(|k| from + k as f64 * spacing).collect()
        })
    }

    /// A jump can be seen only where it happens: where all the data speak of one, its block must not be held out. This is
    /// all that the held-out data ever have to say to the choice.
    fn phase_for_jumps(&self, noise: &Noise) -> u32 {
        let options = self.settings.options;
        let [gyro, fix] = self.jump_times();
        if options.held_out_every < 2 || fix.is_empty() {
            return options.phase;
        }
        let watched = Watched { gyro_jumps_s: gyro, fix_jumps_s: fix, ..Watched::default() };
        let whole = Search { settings: Settings { options: options.all(), ..self.settings }, ..*self };
        let (_, Some(information)) = whole.run(self.base, noise, Some(&watched)) else {
            return options.phase;
        };
        let (gyro, fix) = information.jumps.split_at(watched.gyro_jumps_s.len());
        let best =
            [(gyro, &watched.gyro_jumps_s, "gyro_bias_step"), (fix, &watched.fix_jumps_s, "gps_bias_step")]
                .into_iter()
                .filter_map(|(jumps, times, name)| {
                    let sigma = prior_sigmas(crate::effects::find(name)?)[1];
                    let (evidence, at, _) = evidence::jump(jumps, sigma)?;
                    Some((evidence, *times.get(at)?))
                })
                .max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, at_s)) = best.filter(|b| b.0 > self.settings.threshold) else { return options.phase };
        let start_s = self.flights.first().map_or(0.0, |f| f.initial().t_s);
        // The jump lies up to one spacing before or after; two seconds later it must still be in the fit part.
        let held = |phase: u32| {
            let o = Options { phase, ..options };
            [-1.0, 0.0, 1.0, 2.0].iter().filter(|d| o.part(at_s - start_s + *d) == Some(1)).count()
        };
        (0..options.held_out_every).min_by_key(|p| held(*p)).unwrap_or(options.phase)
    }

    /// Every candidate, linearised about the present point; best first.
    fn scan(&self, point: &Point) -> Vec<Candidate> {
        let lacking = lacking(self.base, self.flights, &point.added);
        let linear: Vec<&EffectSetting> = lacking.iter().filter(|s| is_linear(s.effect)).collect();
        let jumping: Vec<&EffectSetting> = lacking.iter().filter(|s| is_jump(s.effect)).collect();
        let times = self.jump_times();
        let has = |name: &str| jumping.iter().any(|s| s.effect.name() == name);
        let watched = Watched {
            effects: point
                .added
                .iter()
                .map(|a| a.setting.clone())
                .chain(linear.iter().map(|s| (*s).clone()))
                .collect(),
            terms: Vec::new(),
            gyro_jumps_s: if has("gyro_bias_step") { times[0].clone() } else { vec![] },
            fix_jumps_s: if has("gps_bias_step") { times[1].clone() } else { vec![] },
        };
        let model = with(self.base, &point.added);
        let (_, information) = self.run(&model, &point.noise, Some(&watched));
        let Some(information) = information else { return Vec::new() };
        let mut candidates: Vec<Candidate> =
            linear.iter().filter_map(|s| self.linear(s, point, &watched, &information)).collect();
        candidates.extend(self.jumps(&jumping, &watched, &information));
        candidates.extend(self.searched(&lacking, point, &model));
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        candidates
    }

    fn linear(
        &self,
        setting: &EffectSetting,
        point: &Point,
        watched: &Watched,
        information: &Information,
    ) -> Option<Candidate> {
        let slots = watched.slots();
        let index = watched.effects.iter().position(|s| s.effect.name() == setting.effect.name())?;
        let old: Vec<usize> = (0..slots.len()).filter(|k| slots[*k].0 < point.added.len()).collect();
        let new: Vec<usize> = (0..slots.len()).filter(|k| slots[*k].0 == index).collect();
        let own = prior_sigmas(setting.effect);
        let old_sigma: Vec<f64> = old.iter().map(|k| point.added[slots[*k].0].prior[slots[*k].1].1).collect();
        let old_offset: Vec<f64> = old
            .iter()
            .map(|k| {
                let (e, p) = slots[*k];
                point.added[e].prior[p].0 - point.added[e].setting.values[p]
            })
            .collect();
        let without = evidence::fit(information, &old, &old_sigma, &old_offset)?;
        let columns: Vec<usize> = old.iter().chain(&new).copied().collect();
        let fits: Vec<(f64, evidence::Fit)> = SCALES
            .iter()
            .filter_map(|scale| {
                let sigma: Vec<f64> =
                    old_sigma.iter().copied().chain(new.iter().map(|k| own[slots[*k].1] * scale)).collect();
                let offset: Vec<f64> =
                    old_offset.iter().copied().chain(std::iter::repeat_n(0.0, new.len())).collect();
                evidence::fit(information, &columns, &sigma, &offset).map(|f| (*scale, f))
            })
            .collect();
        let evidence = log_mean_exp(fits.iter().map(|f| f.1.evidence)) - without.evidence;
        let (scale, best) = fits.into_iter().max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence))?;
        let mut found = setting.clone();
        let prior = setting.values.iter().zip(&own).map(|(v, s)| (*v, s * scale)).collect();
        for (i, k) in new.iter().enumerate() {
            found.values[slots[*k].1] += best.step[old.len() + i];
        }
        Some(Candidate { setting: found, prior, evidence })
    }

    fn jumps(
        &self,
        jumping: &[&EffectSetting],
        watched: &Watched,
        information: &Information,
    ) -> Vec<Candidate> {
        let gyro = watched.gyro_jumps_s.len();
        jumping
            .iter()
            .filter_map(|setting| {
                let (times, jumps) = match setting.effect.name() {
                    "gyro_bias_step" => (&watched.gyro_jumps_s, &information.jumps[..gyro]),
                    _ => (&watched.fix_jumps_s, &information.jumps[gyro..]),
                };
                let own = prior_sigmas(setting.effect);
                let (evidence, at, size) = evidence::jump(jumps, own[1])?;
                let mut found = (*setting).clone();
                found.values = vec![*times.get(at)?, size.x, size.y, size.z];
                let scale = size.amax().max(0.1 * own[1]);
                let prior = found
                    .values
                    .iter()
                    .zip(&own)
                    .map(|(v, s)| if *s > 0.0 { (0.0, scale) } else { (*v, 0.0) });
                Some(Candidate { prior: prior.collect(), setting: found, evidence })
            })
            .collect()
    }

    /// Effects without states: drifts of several sizes, truncation.
    fn searched(&self, lacking: &[EffectSetting], point: &Point, model: &Model) -> Vec<Candidate> {
        let mut tries: Vec<(usize, EffectSetting)> = Vec::new();
        for (i, setting) in lacking.iter().enumerate() {
            if setting.effect.is_empty() && self.truncates_already(model) {
                continue;
            }
            if setting.effect.is_empty() {
                tries.push((i, setting.clone()));
            }
            for size in setting.effect.sizes_to_try() {
                tries.push((i, EffectSetting { values: vec![*size], ..setting.clone() }));
            }
        }
        let values = map(self.workers, tries.len(), |k| {
            let mut with = model.clone();
            with.set(tries[k].1.clone());
            self.run_serial(&with, &point.noise) - point.log_likelihood
        });
        let mut out = Vec::new();
        for i in 0..lacking.len() {
            let own: Vec<(f64, &EffectSetting)> =
                tries.iter().zip(&values).filter(|((j, _), _)| *j == i).map(|((_, s), v)| (*v, s)).collect();
            let Some((_, best)) = own.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let prior = best.values.iter().map(|v| (*v, 0.0)).collect();
            let evidence = log_mean_exp(own.iter().map(|o| o.0));
            out.push(Candidate { setting: (*best).clone(), prior, evidence });
        }
        out
    }

    fn run_serial(&self, model: &Model, noise: &Noise) -> f64 {
        self.flights
            .iter()
            .map(|f| pass::run(f, model, noise, &self.settings.options, None).log_likelihood[0])
            .sum()
    }

    fn truncates_already(&self, model: &Model) -> bool {
        self.flights.iter().all(
            |f| matches!(model.quantisation_of(f.stream()), Quantisation::Truncate(s) if s == Steps::RAW_IMU),
        )
    }

    /// One candidate at its own best values and noise; the evidence counts against `point`.
    fn look_closely(&self, candidate: &Candidate, point: &Point) -> (Candidate, Point) {
        let mut added = point.added.clone();
        added.push(Added { setting: candidate.setting.clone(), prior: candidate.prior.clone() });
        // Noise and values take turns: noise that stood for the effect goes as the effect comes.
        let mut better = self.settle(&added, &point.noise, STEPS);
        for sweeps in [3, 2] {
            let model = with(self.base, &better.added);
            let (noise, _) =
                noise::fit(self.flights, &model, better.noise, &self.settings.options, sweeps, self.workers);
            let settled = self.settle(&better.added, &noise, STEPS);
            if settled.evidence < better.evidence + 1.0 {
                if settled.evidence > better.evidence {
                    better = settled;
                }
                break;
            }
            better = settled;
        }
        let mut refined = candidate.clone();
        if let Some(last) = better.added.last() {
            refined.setting = last.setting.clone();
        }
        // The average over prior widths and instants costs what it cost in the scan.
        let best_scale = SCALES.len() as f64;
        let cost = match candidate.setting.effect {
            e if is_jump(e) => best_scale.ln() + self.instants(e).ln(),
            e if is_linear(e) => best_scale.ln(),
            e => (e.sizes_to_try().len().max(1) as f64).ln(),
        };
        refined.evidence = better.evidence - point.evidence - cost;
        (refined, better)
    }

    fn instants(&self, effect: &dyn Effect) -> f64 {
        let [gyro, fix] = self.jump_times();
        (if effect.name() == "gyro_bias_step" { gyro.len() } else { fix.len() }).max(1) as f64
    }

    /// A jump's instant, found to within a fix.
    fn refine_jump(&self, candidate: &Candidate, point: &Point) -> Candidate {
        let gyro = candidate.setting.effect.name() == "gyro_bias_step";
        let spacing = JUMP_SPACING_S[usize::from(!gyro)];
        let step = if gyro { 0.25 } else { 0.1 };
        let around = candidate.setting.values[0];
        let n = (spacing * 1.5 / step) as i32;
        let times: Vec<f64> = (-n..=n).map(|k| around + f64::from(k) * step).collect();
        let watched = Watched {
            gyro_jumps_s: if gyro { times.clone() } else { vec![] },
            fix_jumps_s: if gyro { vec![] } else { times.clone() },
            ..Watched::default()
        };
        let model = with(self.base, &point.added);
        let (_, Some(information)) = self.run(&model, &point.noise, Some(&watched)) else {
            return candidate.clone();
        };
        let sigma = prior_sigmas(candidate.setting.effect)[1];
        let Some((_, at, size)) = evidence::jump(&information.jumps, sigma) else { return candidate.clone() };
        let mut found = candidate.clone();
        found.setting.values = vec![times[at], size.x, size.y, size.z];
        found.prior[0].0 = times[at];
        found
    }

    /// The size of a drift, found to within a few per cent, with the sigma that the likelihood's curvature tells.
    fn refine_size(&self, candidate: &Candidate, point: &Point) -> Candidate {
        let model = with(self.base, &point.added);
        let value = |ln_size: f64| {
            let mut with = model.clone();
            with.set(EffectSetting { values: vec![ln_size.exp()], ..candidate.setting.clone() });
            self.run_serial(&with, &point.noise)
        };
        let (mut at, mut step) = (candidate.setting.values[0].ln(), 0.8);
        let mut here = value(at);
        for _ in 0..4 {
            let (up, down) = (value(at + step), value(at - step));
            let curvature = (2.0 * here - up - down) / (step * step);
            if up > here && up > down {
                (at, here) = (at + step, up);
            } else if down > here {
                (at, here) = (at - step, down);
            } else {
                let move_by = if curvature > 0.0 { (up - down) / (2.0 * step * curvature) } else { 0.0 };
                at += move_by.clamp(-step, step);
                here = value(at);
                step *= 0.6;
            }
        }
        let (up, down) = (value(at + 0.3), value(at - 0.3));
        let curvature = ((2.0 * here - up - down) / 0.09).max(0.2);
        let mut found = candidate.clone();
        found.setting.values = vec![at.exp()];
        found.setting.sigmas = vec![at.exp() / curvature.sqrt()];
        found.prior = vec![(at.exp(), 0.0)];
        found
    }

    fn close_looks(&self, scanned: &[Candidate], point: &Point) -> Vec<(Candidate, Point)> {
        let top = scanned.first().map_or(0.0, |c| c.evidence);
        let mut looks: Vec<(Candidate, Point)> = Vec::new();
        let worth = |c: &&Candidate| c.evidence > top - HOPELESS - 0.3 * top.max(0.0) && c.evidence > 0.0;
        for candidate in scanned.iter().filter(worth).take(CLOSE_LOOKS) {
            let refined = match candidate.setting.effect {
                e if is_jump(e) => self.refine_jump(candidate, point),
                e if !e.sizes_to_try().is_empty() => self.refine_size(candidate, point),
                _ => candidate.clone(),
            };
            // Whoever is far behind with the noise of the leader need not look for a noise of its own.
            let leader = looks.iter().map(|l| &l.1).max_by(|a, b| a.evidence.total_cmp(&b.evidence));
            if let Some(leader) = leader {
                let mut added = point.added.clone();
                added.push(Added { setting: refined.setting.clone(), prior: refined.prior.clone() });
                let here = self.settle(&added, &leader.noise, STEPS);
                let lead = leader.evidence - point.evidence;
                if here.evidence < leader.evidence - HOPELESS - 0.1 * lead.max(0.0) {
                    continue;
                }
            }
            looks.push(self.look_closely(&refined, point));
        }
        looks.sort_by(|a, b| b.0.evidence.total_cmp(&a.0.evidence));
        looks
    }
}

/// The evidence of every effect that the model lacks, with this noise and nothing added; best first.
pub fn odds(
    flights: &[&Flight],
    base: &Model,
    noise: &Noise,
    settings: &Settings,
    workers: &dyn Workers,
) -> Vec<Candidate> {
    let search = Search { flights, base, settings: *settings, workers };
    let point = search.settle(&[], noise, 0);
    search.scan(&point)
}

/// Fits the noise and adds effects until none has enough evidence.
pub fn select(flights: &[&Flight], base: &Model, settings: &Settings, workers: &dyn Workers) -> Selection {
    let start = Noise::measured(base, flights);
    let (noise, _) = noise::fit(flights, base, start, &settings.options, 8, workers);
    let mut search = Search { flights, base, settings: *settings, workers };
    search.settings.options.phase = search.phase_for_jumps(&noise);
    let mut point = search.settle(&[], &noise, 0);
    let base_point = point.clone();
    let fixes: usize = flights.iter().map(|f| f.fixes().len()).sum();
    let mut steps = Vec::new();
    let mut remaining = Vec::new();
    while steps.len() < settings.most_effects {
        let scanned = search.scan(&point);
        remaining = scanned.iter().map(|c| (c.setting.effect.name(), c.evidence)).collect();
        if scanned.first().is_none_or(|c| c.evidence < 0.5 * settings.threshold) {
            break;
        }
        let looks = search.close_looks(&scanned, &point);
        let Some((best, next)) = looks.first().cloned() else { break };
        if best.evidence < settings.threshold {
            break;
        }
        let parameters = best.setting.effect.len() as f64;
        let gain = next.log_likelihood - point.log_likelihood;
        steps.push(Step {
            group: looks
                .iter()
                .filter(|l| l.0.evidence > best.evidence - settings.margin)
                .map(|l| l.0.setting.effect.name())
                .collect(),
            evidence: best.evidence,
            log_likelihood_gain: gain,
            bic_gain: gain - 0.5 * parameters * (fixes as f64).ln(),
            candidates: looks
                .iter()
                .map(|l| (l.0.setting.effect.name(), l.0.evidence))
                .chain(remaining.iter().skip(looks.len()).copied())
                .collect(),
        });
        point = next;
    }
    if !point.added.is_empty() {
        // What the effects did to the noise is gone with them; one more look at it from where it ended.
        let options = &search.settings.options;
        let (noise, _) = noise::fit(flights, &with(base, &point.added), point.noise, options, 5, workers);
        let settled = search.settle(&point.added, &noise, STEPS);
        if settled.evidence > point.evidence {
            point = settled;
        }
    }
    Selection {
        options: search.settings.options,
        base: base.clone(),
        base_noise: base_point.noise,
        noise: point.noise,
        log_likelihood: [base_point.log_likelihood, point.log_likelihood],
        added: point.added,
        steps,
        remaining,
    }
}
