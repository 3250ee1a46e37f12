//! What to fly next: the maneuvers that bring the most per second from the present covariance.
//!
//! Each candidate's predicted flight is run through the covariance recursion (the information bound, as the planner does);
//! the gain is the decrease of the logarithm of the worst sigma over target. "Worst" is the fourth-power mean, so that of
//! several states equally far off each counts. States that no candidate makes observable within `HORIZON_S` do not:
//! coordinated maneuvers would otherwise be chosen for the little they say of column y of G. A candidate is one maneuver or one
//! after another: what a climb does to the heading shows only in the turn behind it. What would lead out of the band of heights is
//! no candidate: a descent near the ground is broken off each time and brings nothing. What has not brought what was predicted, for whatever
//! reason, is trusted less for a while (`trust`), so that the next best is asked for. A gain is a maneuver's merit only where the maneuver is recognised
//! in the motion (`motion`). What would be best is ranked in any flight, and asked for only while the situation allows it. One maneuver is run per slice of sample time, so no sample
//! waits long, and the result depends on nothing but the samples.

pub(super) mod motion;
mod round;
mod trust;

use super::snapshot::Guidance;
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::LocalFrame;
use gaware_mission::item::{Home, LatLon};
use gaware_mission::maneuver::{Entry, Maneuver, Words};
use gaware_mission::predictor::{BoundPredictor, NamedSigma, Predictor, Targets};
use gaware_nav::filter::Filter;
use gaware_nav::math::ln;
use motion::{Instant, Motion};
use nalgebra::Vector3;
use round::{Candidate, Round, within_reach, worst};
use trust::Trust;

/// One maneuver of a candidate is run every so often, s of sample time.
const SLICE_S: f64 = 0.03;
/// Pause between two rankings, s.
const PAUSE_S: f64 = 10.0;
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

/// Lowest height of maneuvers above the ground for wings and rotors, m: as `plan` has it.
const FLOOR_M: [f64; 2] = [40.0, 15.0];
/// Highest one, m: where most countries let unmanned aircraft fly without asking.
const CEILING_M: f64 = 120.0;

/// What the guidance may ask for.
#[derive(Debug, Clone, PartialEq)]
pub struct GuidanceOptions {
    /// What flies, and its limits.
    pub airframe: Airframe,
    /// Whether maneuvers may be asked for that only a pilot can fly (sideslip).
    pub manual: bool,
    /// Lowest and highest height above the ground where maneuvers may lead, m; they count once the vehicle was seen stationary there.
    pub band_m: [f64; 2],
}

impl GuidanceOptions {
    /// The usual band: wings keep `FLOOR_M` below them, rotors less, and no one leaves the height of open airspace.
    pub fn new(airframe: Airframe, manual: bool) -> Self {
        let floor_m = FLOOR_M[usize::from(!airframe.is_fixed_wing())];
        Self { airframe, manual, band_m: [floor_m, CEILING_M] }
    }
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
    /// What the maneuvers do by their prediction, and what the vehicle has done since.
    predicted: Vec<Motion>,
    flown: Motion,
}

/// How the vehicle is now.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flying {
    /// Its motion.
    pub here: Instant,
    /// Between two fixes, s.
    pub fix_interval_s: f64,
    /// Whether it does not move.
    pub stationary: bool,
    /// Whether a maneuver may be asked for.
    pub allowed: bool,
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
    /// States that stay unknown because no maneuver shows them.
    unobservable: Vec<String>,
    trust: Trust,
    /// Height above the ellipsoid where the vehicle stood, m.
    ground_m: Option<f64>,
    /// Whether something might be asked for last time.
    allowed: bool,
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
            unobservable: Vec::new(),
            trust: Trust::default(),
            ground_m: None,
            allowed: false,
        }
    }

    /// The time base starts anew; so does the maneuver.
    pub fn restart(&mut self) {
        (self.next_s, self.round, self.asked) = (f64::NEG_INFINITY, None, None);
    }

    /// Whether the guide has something to do at this sample time.
    pub(super) fn is_due(&self, t_s: f64) -> bool {
        t_s >= self.next_s
    }

    /// Takes the running filter when it is due. Where nothing may be asked for the ranking goes on: it says what is known.
    pub(super) fn push(&mut self, filter: &Filter, now: &Flying) {
        let t_s = now.here.t_s;
        self.next_s = t_s + SLICE_S;
        if now.stationary {
            let here = now.here.height_m;
            // A multirotor that hovers stands as well, but higher up.
            self.ground_m = Some(self.ground_m.map_or(here, |g| g.min(here)));
        }
        if !std::mem::replace(&mut self.allowed, now.allowed) && now.allowed {
            self.round = None;
        }
        if now.allowed {
            self.follow(now.here, filter);
        } else {
            self.asked = None;
        }
        let Some(round) = &mut self.round else {
            self.round = Some(Box::new(self.begin(filter, now.fix_interval_s)));
            return;
        };
        if round.step(&self.options.airframe) {
            return;
        }
        if let Some(round) = self.round.take() {
            self.conclude(now, &round);
            self.next_s = t_s + PAUSE_S;
        }
    }

    /// Height above the place where the vehicle stood, m.
    pub(super) fn height_m(&self, filter: &Filter) -> Option<f64> {
        self.ground_m.map(|g| filter.nav().geodetic().height_m - g)
    }

    /// Lowest height of maneuvers, m.
    pub(super) fn floor_m(&self) -> f64 {
        self.options.band_m[0]
    }

    /// Whether everything is known that the airframe can excite.
    pub(super) fn is_done(&self) -> bool {
        self.done
    }

    fn begin(&self, filter: &Filter, fix_interval_s: f64) -> Round {
        let airframe = &self.options.airframe;
        let all = if self.options.manual { Maneuver::all(airframe) } else { Maneuver::automatic(airframe) };
        let entry = Entry::cruising(airframe, Vector3::zeros(), filter.nav().euler().z);
        let space_m = self.height_m(filter).map(|h| round::space(self.options.band_m, h));
        Round::new(self.predictor(filter), entry, fix_interval_s, space_m, &all)
    }

    fn predictor(&self, filter: &Filter) -> BoundPredictor {
        let place = filter.nav().geodetic();
        let here = LatLon { lat_deg: place.lat_rad.to_degrees(), lon_deg: place.lon_rad.to_degrees() };
        let (lat_e7, lon_e7) = here.to_e7();
        let home = Home { lat_e7, lon_e7, alt_m: place.height_m as f32 };
        BoundPredictor::from_filter(filter, LocalFrame::new(here), home, self.targets)
    }

    /// Ends the maneuver that has brought what it should, or that no one flies.
    fn follow(&mut self, here: Instant, filter: &Filter) {
        let t_s = here.t_s;
        let Some(asked) = &mut self.asked else { return };
        asked.flown.take(here);
        let Some(asked) = &self.asked else { return };
        let now = self.predictor(filter).sigmas();
        let waited = t_s - asked.since_s;
        let patience = PATIENCE.0 * asked.duration_s(&self.options.airframe) + PATIENCE.1;
        let (gained, recognised) = (asked.gained(&now), asked.is_recognised());
        let known = gained >= FLOWN;
        if !known && waited < patience {
            return;
        }
        let short = asked.words(&self.options.airframe).short;
        self.last_result = match (recognised, known) {
            (true, _) => asked.result(&now, &short),
            // Other motion has taught what was wanted.
            (false, true) => String::new(),
            (false, false) => format!("not flown: {short}"),
        };
        if recognised || !known {
            self.trust.learn(t_s, &asked.maneuvers, if known { 1.0 } else { gained });
        }
        self.asked = None;
        self.round = None;
    }

    fn conclude(&mut self, flying: &Flying, round: &Round) {
        let t_s = flying.here.t_s;
        let before = round.predictor.sigmas();
        let excitable = within_reach(&before, &round.after);
        let now = worst(&before, &excitable);
        let gain = |c: &Candidate| ln(now / worst(&c.after, &excitable));
        let rate = |c: &Candidate| self.trust.of(t_s, &c.maneuvers) * gain(c) / c.duration_s.max(1.0);
        let best_of = |n: usize| {
            let those = round.after.iter().filter(move |c| c.maneuvers.len() == n);
            those.max_by(|a, b| rate(a).total_cmp(&rate(b)))
        };
        let best = match (best_of(1), best_of(2)) {
            (Some(one), Some(two)) if rate(two) > BETTER_AS_PAIR * rate(one) => Some(two),
            (one, two) => one.or(two),
        };
        // Close to the targets half of the rest is worth it.
        let least = WORTH_FLYING.min(0.5 * ln(now));
        let worth = best.filter(|b| now > 1.0 && gain(b) > least);
        self.done = worth.is_none();
        let open = before.iter().filter(|s| s.ratio() > 1.0).map(|s| s.name.to_string());
        self.unobservable = if self.done { open.collect() } else { Vec::new() };
        let Some(best) = worth.filter(|_| flying.allowed) else {
            self.asked = None;
            return;
        };
        let present =
            self.asked.as_ref().and_then(|a| round.after.iter().find(|c| c.maneuvers == a.maneuvers));
        if present.is_some_and(|p| rate(best) < CHANGE_OF_MIND * rate(p)) {
            return;
        }
        let gain = (now, worst(&best.after, &excitable));
        let maneuvers = best.maneuvers.clone();
        let predicted = maneuvers.iter().filter_map(|m| round.motion(*m, &self.options.airframe)).collect();
        let flown = Motion::from(flying.here);
        self.asked = Some(Asked { maneuvers, since_s: t_s, before, excitable, gain, predicted, flown });
    }

    /// The maneuvers that are being asked for, to be flown one after the other.
    pub fn proposed(&self) -> &[Maneuver] {
        self.asked.as_ref().map_or(&[], |a| &a.maneuvers)
    }

    /// What to show; `filter` is the running one.
    pub fn guidance(&self, filter: Option<&Filter>) -> Guidance {
        let base = Guidance { last_result: self.last_result.clone(), ..Guidance::default() };
        let Some(filter) = filter else {
            return base;
        };
        let Some(asked) = &self.asked else {
            return Guidance { done: self.done, reason: self.why_nothing(), ..base };
        };
        let airframe = &self.options.airframe;
        let words = asked.words(airframe);
        let now = self.predictor(filter).sigmas();
        let reason = asked.reason(&now, &words.purpose);
        Guidance { instruction: words.long, reason, progress: asked.progress(&now), ..base }
    }
}

impl Guide {
    /// Why nothing is asked for.
    fn why_nothing(&self) -> String {
        match (self.done, self.unobservable.is_empty()) {
            (false, _) => String::new(),
            (true, true) => "everything is known".to_owned(),
            (true, false) => format!(
                "everything that this airframe can excite is known; no maneuver of it shows {}{}",
                self.unobservable.join(", "),
                if self.options.manual { "" } else { " (unless a pilot flies sideslips)" },
            ),
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

    /// Whether the maneuver was flown.
    fn is_recognised(&self) -> bool {
        self.flown.share_of(&self.predicted) >= 1.0
    }

    /// How far the maneuver is: no farther than its motion shows, whatever else has been learned.
    fn progress(&self, now: &[NamedSigma]) -> f64 {
        self.gained(now).min(self.flown.share_of(&self.predicted))
    }

    /// Share of the predicted gain that has come so far.
    fn gained(&self, now: &[NamedSigma]) -> f64 {
        let predicted = ln(self.gain.0 / self.gain.1);
        let so_far = ln(self.gain.0 / worst(now, &self.excitable));
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

    /// What the maneuver brought.
    fn result(&self, now: &[NamedSigma], short: &str) -> String {
        let pairs = self.before.iter().zip(now).zip(&self.excitable).filter(|(_, e)| **e).map(|(p, _)| p);
        let Some((before, after)) = pairs.max_by(|x, y| toward_target(x).total_cmp(&toward_target(y))) else {
            return String::new();
        };
        format!(
            "since \"{short}\": {} from {} to {} {}",
            before.name,
            Figures(before.sigma),
            Figures(after.sigma),
            before.unit
        )
    }
}

/// The instruction for the pilot.
struct Instruction {
    short: String,
    long: String,
    purpose: String,
}

/// How far a state has come toward its target, in the logarithm.
fn toward_target((before, after): &(&NamedSigma, &NamedSigma)) -> f64 {
    ln(before.ratio().max(1.0) / after.ratio().max(1.0))
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
