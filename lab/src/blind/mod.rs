//! Blind flights: an effect is injected in a simulated vehicle, the vehicle flies, the explanation names what it finds, and only
//! then the truth is looked at.
//!
//! Two families of flights exist: one on which thresholds were tuned, and one kept aside (other maneuvers, speeds, air,
//! vibration and seeds) for the figures that count. Beside every flight stands an oracle that knows the truth: where
//! not even it could name the effect, no one can be blamed.

mod document;
mod oracle;
pub mod sensors;
mod summary;

use gaware::explain::contract::Verdict;
use gaware::parallel::{Progress, map_runs_on};
use gaware_nav::effects::{self, Effect, REGISTRY};
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::select::{self, Selection, Settings};
use gaware_nav::identify::{Serial, beyond, judge, survey};
use gaware_nav::model::{EffectSetting, Model, QuantisationBelief};
use gaware_sitl::noise::{Noise, Purpose};
use serde::Serialize;

pub use document::{Flown, write as document};
pub use gaware_sitl::blind::{Blind, DURATION_S, Family, Kind, draw, draw_injected, fly, ground_truth};
pub use oracle::Seen;
pub(crate) use oracle::could_name;
pub use summary::{Share, Summary, confusion, summarise};

/// At most so many effects are injected in one flight.
pub const MOST_AT_ONCE: usize = 3;
/// So many candidates of a look are reported.
const MOST_TOLD: usize = 6;

/// What one blind flight gave.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Injected effects; none for a clean flight.
    pub hidden: Vec<&'static str>,
    /// How it was flown.
    pub kind: Kind,
    /// Seed.
    pub seed: u64,
    /// The groups that were named, in order.
    pub groups: Vec<Vec<&'static str>>,
    /// Evidence of each.
    pub evidence: Vec<f64>,
    /// Effects that the held-out data took out again.
    pub removed: Vec<&'static str>,
    /// What was injected, parameter by parameter, SI.
    pub sizes: Vec<Vec<f64>>,
    /// What stayed, with the held-out log-likelihood that is lost without it, nats.
    pub held_out: Vec<(&'static str, f64)>,
    /// What the oracle saw of each injected effect.
    pub oracle: Vec<Seen>,
    /// Errors of the parameters that were reported, in the sigmas that were reported with them, where the effect was named.
    pub errors_in_sigmas: Vec<f64>,
    /// Noise figures that were reported as implausible.
    pub noise: Vec<&'static str>,
    /// The verdict, where the injected effects were taken out of the catalogue.
    pub verdict: Option<Verdict>,
    /// The best candidates of every look with their evidence, the last look (which added nothing) included.
    pub looks: Vec<Vec<(&'static str, f64)>>,
}

/// One flight to be flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Job {
    /// Places in the registry.
    hidden: [Option<usize>; MOST_AT_ONCE],
    kind: Kind,
    seed: u64,
}

/// What to fly.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// Effects to inject; all when empty.
    pub effects: Vec<String>,
    /// How many effects are injected at once: 1 to [`MOST_AT_ONCE`].
    pub at_once: usize,
    /// Flights with something injected: spread evenly over effects, kinds of flight and seeds.
    pub flights: usize,
    /// Clean flights, half of each kind.
    pub clean: usize,
    /// First seed.
    pub first_seed: u64,
    /// Whether the injected effects are taken out of the catalogue: then something unknown is to be noticed.
    pub unknown: bool,
    /// Which flights.
    pub family: Family,
    /// So many flights at a time.
    pub threads: usize,
}

impl Campaign {
    /// The flights in an order of which every beginning is spread over the effects.
    fn jobs(&self) -> Vec<Job> {
        let chosen: Vec<usize> = (0..REGISTRY.len())
            .filter(|k| self.effects.is_empty() || self.effects.iter().any(|n| n == REGISTRY[*k].name()))
            .collect();
        let kind = |k: usize| if k.is_multiple_of(2) { Kind::Rich } else { Kind::Coordinated };
        let n = chosen.len().max(1);
        let hidden = (0..if chosen.is_empty() { 0 } else { self.flights }).map(|k| {
            let (round, first) = (k / n, k % n);
            // The partner moves on by one with every round, so that all pairs come in turn; when they have, so does the third.
            let others = (n - 1).max(1);
            let (turn, pairs) = (round / 2 % others, round / 2 / others);
            let third = (turn + 1 + pairs % (others - 1).max(1)) % others;
            let beside = |at_once: usize, turn: usize| {
                (self.at_once >= at_once && n >= at_once).then(|| chosen[(first + 1 + turn) % n])
            };
            Job {
                hidden: [Some(chosen[first]), beside(2, turn), beside(3, third)],
                kind: kind(first + round),
                seed: self.first_seed + (round / 2) as u64,
            }
        });
        let clean = (0..self.clean).map(|k| Job {
            hidden: [None; MOST_AT_ONCE],
            kind: kind(k),
            seed: self.first_seed + 5000 + (k / 2) as u64,
        });
        hidden.chain(clean).collect()
    }
}

/// Draws what a job injects.
fn hide(job: &Job) -> Vec<EffectSetting> {
    let effects: Vec<&'static dyn Effect> = job.hidden.iter().flatten().map(|k| REGISTRY[*k]).collect();
    let mut noise = Noise::numbered(seed_of(job), Purpose::HiddenTruth, 3);
    effects.into_iter().map(|e| draw(e, &mut noise)).collect()
}

/// A seed of its own for every flight: no two share their noise.
fn seed_of(job: &Job) -> u64 {
    let number = |k: Option<usize>| k.map_or(0, |k| k as u64 + 1);
    let kind = if job.kind == Kind::Rich { 0 } else { 20_011 };
    let numbers = number(job.hidden[0]) + 97 * number(job.hidden[1]) + (number(job.hidden[2]) << 42);
    job.seed.wrapping_mul(1_000_003) + numbers + kind
}

/// What is assumed before the flight, as `explain` begins: nothing of what is injected.
pub(crate) fn belief(hidden: &[EffectSetting]) -> Model {
    let mut base = Model::default().with_receiver();
    // What only a tape measure separates has been measured.
    for other in hidden.iter().filter_map(|s| s.effect.needs_known()).filter_map(effects::find) {
        base.set(EffectSetting { sigmas: vec![0.0; other.len()], ..EffectSetting::unknown(other) });
    }
    if hidden.iter().any(|s| s.effect.truncates_samples()) {
        base.imu.quantisation = QuantisationBelief::None;
    }
    base
}

fn errors_in_sigmas(hidden: &[EffectSetting], selection: &Selection) -> Vec<f64> {
    let told = |h: &EffectSetting| {
        let added = selection.added.iter().find(|a| a.setting.effect.name() == h.effect.name())?;
        let informed = survey::informed(added);
        let s = &added.setting;
        let errors = (0..s.values.len()).filter(|k| s.sigmas[*k] > 0.0 && informed[*k]);
        Some(errors.map(|k| (s.values[k] - h.values[k]) / s.sigmas[k]).collect::<Vec<f64>>())
    };
    hidden.iter().filter_map(told).flatten().collect()
}

/// Injects, flies, explains, compares with the ground truth. `None` where the flight says too little, which none of these do.
fn one(job: &Job, family: Family, settings: &Settings) -> Option<Outcome> {
    let hidden = hide(job);
    let seed = seed_of(job);
    let blind = fly(&hidden, job.kind, family, seed);
    let base = belief(&hidden);
    let flight = Flight::prepare(&blind.samples, &base).ok()?;
    let selection = select::select(&[&flight], &base, settings, &Serial);
    let oracle = oracle::could_name(&flight, &base, &hidden, &selection, settings);
    let selection = beyond::select(&[&flight], &base, selection, settings, &Serial);
    let looks = selection.steps.iter().map(|s| &s.candidates).chain([&selection.remaining]);
    let looks = looks.map(|l| l.iter().take(MOST_TOLD).copied().collect()).collect();
    let judge::Confirmed { mut selection, removed, left_out } =
        judge::confirm(&[&flight], &[], selection, settings, &Serial);
    let (_, noise) = judge::take_survey(&[&flight], &mut selection, settings, &Serial);
    Some(Outcome {
        hidden: hidden.iter().map(|h| h.effect.name()).collect(),
        kind: job.kind,
        seed,
        verdict: None,
        groups: selection.steps.iter().map(|s| s.group.clone()).collect(),
        evidence: selection.steps.iter().map(|s| s.evidence).collect(),
        removed,
        held_out: left_out.iter().map(|l| (l.name, l.held_out())).collect(),
        oracle,
        errors_in_sigmas: errors_in_sigmas(&hidden, &selection),
        noise: noise.iter().filter_map(|n| n.finding).collect(),
        sizes: hidden.into_iter().map(|h| h.values).collect(),
        looks,
    })
}

/// The same where the search knows nothing of what was injected: what is named is wrong, and the verdict says whether that was noticed.
fn one_unknown(job: &Job, family: Family, settings: &Settings) -> Option<Outcome> {
    let hidden = hide(job);
    let seed = seed_of(job);
    let blind = fly(&hidden, job.kind, family, seed);
    let without = hidden.iter().fold(settings.without, |w, h| w.and(h.effect.name()));
    let base = belief(&hidden);
    let flight = Flight::prepare(&blind.samples, &base).ok()?;
    // What the oracle sees does not depend on the catalogue of the search.
    let known = select::select(&[&flight], &base, settings, &Serial);
    let oracle = oracle::could_name(&flight, &base, &hidden, &known, settings);
    let settings = Settings { without, ..*settings };
    let explained = gaware::explain::samples(&[blind.samples], &[], &base, &settings, &|_| {});
    let explanation = &explained.explanation;
    Some(Outcome {
        hidden: hidden.iter().map(|h| h.effect.name()).collect(),
        kind: job.kind,
        seed,
        groups: explanation.effects.iter().map(|e| e.names.clone()).collect(),
        evidence: explanation.effects.iter().map(|e| e.evidence.log_odds).collect(),
        removed: explanation.removed.clone(),
        held_out: Vec::new(),
        oracle,
        errors_in_sigmas: Vec::new(),
        noise: explanation.noise.iter().filter_map(|n| n.finding).collect(),
        sizes: hidden.into_iter().map(|h| h.values).collect(),
        looks: Vec::new(),
        verdict: Some(explanation.verdict),
    })
}

/// Flies a campaign.
pub fn run(campaign: &Campaign, settings: &Settings, progress: &dyn Progress) -> Vec<Outcome> {
    let jobs = campaign.jobs();
    map_runs_on(campaign.threads, jobs.len(), progress, |k| {
        let one = if campaign.unknown { one_unknown } else { one };
        one(&jobs[k], campaign.family, settings)
    })
    .into_iter()
    .flatten()
    .collect()
}

#[cfg(test)]
mod tests;
