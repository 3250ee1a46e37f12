//! What to fly next: the maneuver that brings the most per second from the present covariance.
//!
//! Each candidate's predicted flight is run through the covariance recursion (the information bound, as the planner does);
//! the gain is the decrease of the logarithm of the worst sigma over target. "Worst" is the fourth-power mean, so that of
//! several states equally far off each counts. States that no candidate excites do not: coordinated maneuvers would otherwise
//! all be worth nothing while column y of G is dark. One candidate is run per slice of sample time, so no sample waits long,
//! and the result depends on nothing but the samples.

use super::snapshot::Guidance;
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::LocalFrame;
use gaware_mission::item::{Home, LatLon};
use gaware_mission::kinematics::Kinematics;
use gaware_mission::maneuver::{Entry, Maneuver};
use gaware_mission::predictor::{BoundPredictor, NamedSigma, Predictor, Targets};
use gaware_nav::filter::Filter;
use nalgebra::Vector3;

/// One candidate is run every so often, s of sample time.
const SLICE_S: f64 = 0.5;
/// Pause between two rankings, s.
const PAUSE_S: f64 = 5.0;
/// Predicted flights are thinned to every so manyth sample (0.1 s): the covariance does not mind.
const THINNING: usize = 2;
/// A candidate that reduces a state's sigma to below this share excites it.
const EXCITES: f64 = 0.97;
/// A maneuver that brings less than this, in the logarithm of the worst sigma, is not worth flying.
const WORTH_FLYING: f64 = 0.02;
/// Another maneuver must be better by this factor to replace the one that is being flown.
const CHANGE_OF_MIND: f64 = 1.5;
/// A maneuver is over when this share of its predicted gain has come …
const FLOWN: f64 = 0.8;
/// … or after this many times its duration, and some time to begin, s.
const PATIENCE: (f64, f64) = (2.0, 30.0);

/// What the guidance may ask for.
#[derive(Debug, Clone, PartialEq)]
pub struct GuidanceOptions {
    /// What flies, and its limits.
    pub airframe: Airframe,
    /// Whether maneuvers may be asked for that only a pilot can fly (sideslip).
    pub manual: bool,
}

/// The maneuver that is being asked for.
#[derive(Debug, Clone)]
struct Asked {
    maneuver: Maneuver,
    since_s: f64,
    before: Vec<NamedSigma>,
    excitable: Vec<bool>,
    /// Worst before and as predicted after.
    gain: (f64, f64),
}

/// A ranking under way.
#[derive(Debug, Clone)]
struct Round {
    predictor: BoundPredictor,
    entry: Entry,
    fix_interval_s: f64,
    left: Vec<Maneuver>,
    after: Vec<(Maneuver, Vec<NamedSigma>)>,
}

/// Asks, follows and asks again.
#[derive(Debug, Clone)]
pub struct Guide {
    options: GuidanceOptions,
    targets: Targets,
    next_s: f64,
    round: Option<Box<Round>>,
    asked: Option<Asked>,
    last_result: String,
    done: bool,
}

impl Guide {
    /// A guide who has seen nothing.
    pub fn new(options: GuidanceOptions, targets: &Targets) -> Self {
        let targets = *targets;
        Self {
            options,
            targets,
            next_s: f64::NEG_INFINITY,
            round: None,
            asked: None,
            last_result: String::new(),
            done: false,
        }
    }

    /// The time base starts anew; so does the maneuver.
    pub fn restart(&mut self) {
        (self.next_s, self.round, self.asked) = (f64::NEG_INFINITY, None, None);
    }

    /// Takes the running filter at sample time `t_s`. A vehicle that stands flies nothing: whatever it learns is not
    /// the maneuver's merit, and each ranking starts from there.
    pub fn push(&mut self, t_s: f64, filter: &Filter, fix_interval_s: f64, standing: bool) {
        if t_s < self.next_s {
            return;
        }
        self.next_s = t_s + SLICE_S;
        if !standing {
            self.follow(t_s, filter);
        }
        let Some(round) = &mut self.round else {
            self.round = Some(Box::new(self.begin(filter, fix_interval_s)));
            return;
        };
        if let Some(maneuver) = round.left.pop() {
            round.run(maneuver, &self.options.airframe);
            return;
        }
        if let Some(round) = self.round.take() {
            if standing {
                self.asked = None;
            }
            self.conclude(t_s, &round);
            self.next_s = t_s + PAUSE_S;
        }
    }

    fn begin(&self, filter: &Filter, fix_interval_s: f64) -> Round {
        let airframe = &self.options.airframe;
        let mut left =
            if self.options.manual { Maneuver::all(airframe) } else { Maneuver::automatic(airframe) };
        left.reverse();
        let predictor = self.predictor(filter);
        let entry = Entry::cruising(airframe, Vector3::zeros(), filter.nav().euler().z);
        Round { predictor, entry, fix_interval_s, left, after: Vec::new() }
    }

    fn predictor(&self, filter: &Filter) -> BoundPredictor {
        let place = filter.nav().geodetic();
        let here = LatLon { lat_deg: place.lat_rad.to_degrees(), lon_deg: place.lon_rad.to_degrees() };
        let (lat_e7, lon_e7) = here.to_e7();
        let home = Home { lat_e7, lon_e7, alt_m: place.height_m as f32 };
        BoundPredictor::from_filter(filter, LocalFrame::new(here), home, self.targets)
    }

    /// Ends the maneuver that has brought what it should, or that nobody flies.
    fn follow(&mut self, t_s: f64, filter: &Filter) {
        let Some(asked) = &self.asked else { return };
        let now = self.predictor(filter).sigmas();
        let waited = t_s - asked.since_s;
        let patience = PATIENCE.0 * asked.maneuver.duration_s(&self.options.airframe) + PATIENCE.1;
        let flown = asked.progress(&now) >= FLOWN;
        if !flown && waited < patience {
            return;
        }
        self.last_result = asked.result(&now, flown, &self.options.airframe);
        self.asked = None;
        self.round = None;
    }

    fn conclude(&mut self, t_s: f64, round: &Round) {
        let before = round.predictor.sigmas();
        let excitable: Vec<bool> = (0..before.len())
            .map(|i| {
                round.after.iter().any(|(_, after)| {
                    matches!((before.get(i), after.get(i)), (Some(b), Some(a)) if a.sigma < EXCITES * b.sigma)
                })
            })
            .collect();
        let now = worst(&before, &excitable);
        let rate = |(maneuver, after): &(Maneuver, Vec<NamedSigma>)| {
            let gain = (now / worst(after, &excitable)).ln();
            (gain, gain / maneuver.duration_s(&self.options.airframe).max(1.0))
        };
        let best = round.after.iter().max_by(|a, b| rate(a).1.total_cmp(&rate(b).1));
        let worth = best.filter(|b| now > 1.0 && rate(b).0 > WORTH_FLYING);
        self.done = worth.is_none();
        let Some(best) = worth else {
            self.asked = None;
            return;
        };
        let present = self.asked.as_ref().and_then(|a| round.after.iter().find(|r| r.0 == a.maneuver));
        if present.is_some_and(|p| rate(best).1 < CHANGE_OF_MIND * rate(p).1) {
            return;
        }
        let gain = (now, worst(&best.1, &excitable));
        self.asked = Some(Asked { maneuver: best.0, since_s: t_s, before, excitable, gain });
    }

    /// The maneuver that is being asked for.
    pub fn proposed(&self) -> Option<Maneuver> {
        self.asked.as_ref().map(|a| a.maneuver)
    }

    /// What to show; `filter` is the running one, `standing` whether the vehicle does not move.
    pub fn guidance(&self, filter: Option<&Filter>, standing: bool) -> Guidance {
        let base = Guidance { last_result: self.last_result.clone(), ..Guidance::default() };
        let Some(filter) = filter else {
            return base;
        };
        let Some(asked) = &self.asked else {
            let reason = if self.done { "everything that this airframe can excite is known" } else { "" };
            return Guidance { done: self.done, reason: reason.to_owned(), ..base };
        };
        let airframe = &self.options.airframe;
        let words = asked.maneuver.words(airframe);
        let now = self.predictor(filter).sigmas();
        let instruction = if standing && airframe.is_fixed_wing() {
            format!("Take off and climb to a safe height. Then: {}", words.long)
        } else {
            words.long
        };
        let progress = if standing { 0.0 } else { asked.progress(&now) };
        Guidance { instruction, reason: asked.reason(&now, words.purpose), progress, ..base }
    }
}

impl Round {
    fn run(&mut self, maneuver: Maneuver, airframe: &Airframe) {
        let flight: Vec<Kinematics> = maneuver
            .kinematics(airframe, &self.entry, &Vector3::zeros())
            .into_iter()
            .step_by(THINNING)
            .collect();
        let mut predictor = self.predictor.clone();
        predictor.fly(&flight, self.fix_interval_s);
        self.after.push((maneuver, predictor.sigmas()));
    }
}

impl Asked {
    /// Share of the predicted gain that has come so far.
    fn progress(&self, now: &[NamedSigma]) -> f64 {
        let predicted = (self.gain.0 / self.gain.1).ln();
        let so_far = (self.gain.0 / worst(now, &self.excitable)).ln();
        if predicted > 0.0 { (so_far / predicted).clamp(0.0, 1.0) } else { 1.0 }
    }

    fn reason(&self, now: &[NamedSigma], purpose: &str) -> String {
        let open = now.iter().zip(&self.excitable).filter(|(_, e)| **e).map(|(s, _)| s);
        match open.max_by(|a, b| a.ratio().total_cmp(&b.ratio())) {
            Some(s) => format!(
                "{} is known to {} {}, the target is {}; good for {purpose}",
                s.name,
                Figures(s.sigma),
                s.unit,
                Figures(s.target)
            ),
            None => format!("good for {purpose}"),
        }
    }

    fn result(&self, now: &[NamedSigma], flown: bool, airframe: &Airframe) -> String {
        if !flown && self.progress(now) < 0.1 {
            return format!("not flown: {}", self.maneuver.words(airframe).short);
        }
        let pairs = self.before.iter().zip(now).zip(&self.excitable).filter(|(_, e)| **e).map(|(p, _)| p);
        let Some((before, after)) = pairs.max_by(|x, y| toward_target(x).total_cmp(&toward_target(y))) else {
            return String::new();
        };
        format!(
            "since \"{}\": {} from {} to {} {}",
            self.maneuver.words(airframe).short,
            before.name,
            Figures(before.sigma),
            Figures(after.sigma),
            before.unit
        )
    }
}

/// How far a state has come toward its target, in the logarithm.
fn toward_target((before, after): &(&NamedSigma, &NamedSigma)) -> f64 {
    (before.ratio().max(1.0) / after.ratio().max(1.0)).ln()
}

/// Fourth-power mean of sigma over target, at least 1 each: close to the largest, with every laggard in it.
fn worst(sigmas: &[NamedSigma], counts: &[bool]) -> f64 {
    let ratios: Vec<f64> =
        sigmas.iter().zip(counts).filter(|(_, c)| **c).map(|(s, _)| s.ratio().max(1.0)).collect();
    if ratios.is_empty() {
        return 1.0;
    }
    (ratios.iter().map(|r| r.powi(4)).sum::<f64>() / ratios.len() as f64).powf(0.25)
}

/// A number with three significant figures.
struct Figures(f64);

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digits = match self.0.abs() {
            v if v >= 100.0 => 0,
            v if v >= 10.0 => 1,
            v if v >= 1.0 => 2,
            _ => 3,
        };
        write!(f, "{:.digits$}", self.0)
    }
}
