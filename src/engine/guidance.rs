//! What to fly next: the maneuvers that bring the most per second from the present covariance.
//!
//! Each candidate's predicted flight is run through the covariance recursion (the information bound, as the planner does);
//! the gain is the decrease of the logarithm of the worst sigma over target. "Worst" is the fourth-power mean, so that of
//! several states equally far off each counts. States that no candidate makes known within `HORIZON_S` do not:
//! coordinated maneuvers would otherwise be chosen for the little they say of column y of G. A candidate is one maneuver or one
//! after another: what a climb does to the heading shows only in the turn behind it. One maneuver is run per slice of sample
//! time, so no sample waits long, and the result depends on nothing but the samples.

use super::snapshot::Guidance;
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::LocalFrame;
use gaware_mission::item::{Home, LatLon};
use gaware_mission::kinematics::Kinematics;
use gaware_mission::maneuver::{Entry, Maneuver, Words};
use gaware_mission::predictor::{BoundPredictor, NamedSigma, Predictor, Targets};
use gaware_nav::filter::Filter;
use nalgebra::Vector3;

/// One maneuver of a candidate is run every so often, s of sample time.
const SLICE_S: f64 = 0.03;
/// Pause between two rankings, s.
const PAUSE_S: f64 = 10.0;
/// Predicted flights are thinned to every so manyth sample (0.2 s): the covariance does not mind.
const THINNING: usize = 4;
/// States count that the best candidate, flown again and again, would make known within this time, s, …
const HORIZON_S: f64 = 600.0;
/// … or within this many times what the nearest one takes, …
const NEAREST: f64 = 2.0;
/// … but not those that would take longer than this: no flight lasts so long, s.
const OUT_OF_REACH_S: f64 = 3600.0;
/// Two maneuvers are asked for only where they are better than the best single one by this factor.
const BETTER_AS_PAIR: f64 = 1.05;
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

/// What is being asked for.
#[derive(Debug, Clone)]
struct Asked {
    /// One, or two to be flown one after the other.
    maneuvers: Vec<Maneuver>,
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
    left: Vec<Task>,
    /// Each maneuver that has been run, and where it led.
    firsts: Vec<(Maneuver, BoundPredictor)>,
    after: Vec<Candidate>,
}

/// What is still to be run in a ranking.
#[derive(Debug, Clone, Copy)]
enum Task {
    First(Maneuver),
    /// After the first one of this index.
    Second(usize, Maneuver),
}

/// Maneuvers one after the other, and the sigmas behind them.
#[derive(Debug, Clone)]
struct Candidate {
    maneuvers: Vec<Maneuver>,
    duration_s: f64,
    after: Vec<NamedSigma>,
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
        if let Some(task) = round.left.pop() {
            round.run(task, &self.options.airframe);
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
        let all = if self.options.manual { Maneuver::all(airframe) } else { Maneuver::automatic(airframe) };
        let seconds = (0..all.len()).flat_map(|first| all.iter().map(move |m| Task::Second(first, *m)));
        let mut left: Vec<Task> = all.iter().map(|m| Task::First(*m)).chain(seconds).collect();
        left.reverse();
        let predictor = self.predictor(filter);
        let entry = Entry::cruising(airframe, Vector3::zeros(), filter.nav().euler().z);
        Round { predictor, entry, fix_interval_s, left, firsts: Vec::new(), after: Vec::new() }
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
        let patience = PATIENCE.0 * asked.duration_s(&self.options.airframe) + PATIENCE.1;
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
        let excitable = within_reach(&before, &round.after);
        let now = worst(&before, &excitable);
        let gain = |c: &Candidate| (now / worst(&c.after, &excitable)).ln();
        let rate = |c: &Candidate| gain(c) / c.duration_s.max(1.0);
        let best_of = |n: usize| {
            let those = round.after.iter().filter(move |c| c.maneuvers.len() == n);
            those.max_by(|a, b| rate(a).total_cmp(&rate(b)))
        };
        let best = match (best_of(1), best_of(2)) {
            (Some(one), Some(two)) if rate(two) > BETTER_AS_PAIR * rate(one) => Some(two),
            (one, two) => one.or(two),
        };
        // Close to the targets half of the rest is worth it.
        let least = WORTH_FLYING.min(0.5 * now.ln());
        let worth = best.filter(|b| now > 1.0 && gain(b) > least);
        self.done = worth.is_none();
        let Some(best) = worth else {
            self.asked = None;
            return;
        };
        let present =
            self.asked.as_ref().and_then(|a| round.after.iter().find(|c| c.maneuvers == a.maneuvers));
        if present.is_some_and(|p| rate(best) < CHANGE_OF_MIND * rate(p)) {
            return;
        }
        let gain = (now, worst(&best.after, &excitable));
        self.asked = Some(Asked { maneuvers: best.maneuvers.clone(), since_s: t_s, before, excitable, gain });
    }

    /// The maneuvers that are being asked for, to be flown one after the other.
    pub fn proposed(&self) -> &[Maneuver] {
        self.asked.as_ref().map_or(&[], |a| &a.maneuvers)
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
        let words = asked.words(airframe);
        let now = self.predictor(filter).sigmas();
        let instruction = if standing && airframe.is_fixed_wing() {
            format!("Take off and climb to a safe height. Then: {}", words.long)
        } else {
            words.long
        };
        let progress = if standing { 0.0 } else { asked.progress(&now) };
        Guidance { instruction, reason: asked.reason(&now, &words.purpose), progress, ..base }
    }
}

impl Round {
    fn run(&mut self, task: Task, airframe: &Airframe) {
        let (mut predictor, before, maneuver) = match task {
            Task::First(maneuver) => (self.predictor.clone(), None, maneuver),
            Task::Second(first, maneuver) => {
                let Some((before, predictor)) = self.firsts.get(first) else { return };
                (predictor.clone(), Some(*before), maneuver)
            }
        };
        let flight: Vec<Kinematics> = maneuver
            .kinematics(airframe, &self.entry, &Vector3::zeros())
            .into_iter()
            .step_by(THINNING)
            .collect();
        predictor.fly(&flight, self.fix_interval_s);
        let maneuvers: Vec<Maneuver> = before.into_iter().chain([maneuver]).collect();
        let duration_s = maneuvers.iter().map(|m| m.duration_s(airframe)).sum();
        self.after.push(Candidate { maneuvers, duration_s, after: predictor.sigmas() });
        if before.is_none() {
            self.firsts.push((maneuver, predictor));
        }
    }
}

impl Asked {
    fn duration_s(&self, airframe: &Airframe) -> f64 {
        self.maneuvers.iter().map(|m| m.duration_s(airframe)).sum()
    }

    fn words(&self, airframe: &Airframe) -> Instruction {
        let words: Vec<_> = self.maneuvers.iter().map(|m| m.words(airframe)).collect();
        let joined =
            |of: fn(&Words) -> &str, between: &str| words.iter().map(of).collect::<Vec<_>>().join(between);
        let mut purposes: Vec<&str> = words.iter().map(|w| w.purpose).collect();
        purposes.dedup();
        Instruction {
            short: joined(|w| &w.short, ", then "),
            long: joined(|w| &w.long, " Then: "),
            purpose: purposes.join("; "),
        }
    }

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
            return format!("not flown: {}", self.words(airframe).short);
        }
        let pairs = self.before.iter().zip(now).zip(&self.excitable).filter(|(_, e)| **e).map(|(p, _)| p);
        let Some((before, after)) = pairs.max_by(|x, y| toward_target(x).total_cmp(&toward_target(y))) else {
            return String::new();
        };
        format!(
            "since \"{}\": {} from {} to {} {}",
            self.words(airframe).short,
            before.name,
            Figures(before.sigma),
            Figures(after.sigma),
            before.unit
        )
    }
}

/// What to tell the pilot.
struct Instruction {
    short: String,
    long: String,
    purpose: String,
}

/// Which states the candidates, flown again and again, can make known soon enough to count.
fn within_reach(before: &[NamedSigma], candidates: &[Candidate]) -> Vec<bool> {
    let rate = |i: usize, b: &NamedSigma| {
        let of =
            |c: &Candidate| c.after.get(i).map_or(0.0, |a| (b.sigma / a.sigma).ln() / c.duration_s.max(1.0));
        candidates.iter().map(of).fold(0.0, f64::max)
    };
    let time_s = |(i, b): (usize, &NamedSigma)| match (b.ratio().max(1.0).ln(), rate(i, b)) {
        (_, rate) if rate <= 0.0 => f64::INFINITY,
        (far, rate) => far / rate,
    };
    let times: Vec<f64> = before.iter().enumerate().map(time_s).collect();
    let nearest = times.iter().copied().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
    let longest = HORIZON_S.max(NEAREST * nearest).min(OUT_OF_REACH_S);
    // What is known already would only dilute the mean.
    times.into_iter().map(|t| t > 0.0 && t <= longest).collect()
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
