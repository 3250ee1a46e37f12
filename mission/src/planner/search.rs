//! The beam search.

use super::landing::Landing;
use super::place::placements;
use super::{Plan, PlanError, PlannedManeuver, Rejection, Request, SigmasAt};
use crate::fence::LocalFrame;
use crate::flight::Flyer;
use crate::item::{Mission, MissionItem, command};
use crate::kinematics::Kinematics;
use crate::maneuver::{Entry, Maneuver, Placement, join_items};
use crate::predictor::{NamedSigma, Predictor};
use crate::safety::Checker;
use nalgebra::{Rotation3, Vector2, Vector3};

/// A state counts as one that this airframe can excite if its maneuvers shrink its sigma to this share.
const EXCITED: f64 = 0.9;
/// Weight of the mean over all states beside the worst one: breaks ties, keeps the search going where the worst is stuck.
const MEAN_WEIGHT: f64 = 0.3;
/// Least gain in log score per second that is worth flying for.
const LEAST_GAIN_PER_S: f64 = 1e-5;
/// Most maneuvers in a plan.
const MOST_MANEUVERS: usize = 12;
/// Points of a climb-out that are checked.
const CLIMB_CHECKS: u32 = 50;
/// Pitch of a fixed wing's take-off, deg: ArduPlane's usual minimum.
const TAKE_OFF_PITCH_DEG: f32 = 12.0;
/// Spacing of the sigmas in the plan, s.
const REPORT_S: f64 = 1.0;

pub(super) struct Search<'a> {
    pub(super) request: &'a Request,
    pub(super) frame: LocalFrame,
    checker: Checker<'a>,
    placements: Vec<Placement>,
    winds: Vec<Vector3<f64>>,
}

/// A plan under construction.
#[derive(Clone)]
struct Node<'a, P> {
    /// One vehicle per wind; the first one flies in the wind given.
    flyers: Vec<Flyer<'a>>,
    predictor: P,
    items: Vec<MissionItem>,
    maneuvers: Vec<PlannedManeuver>,
    path: Vec<Kinematics>,
    log_score: f64,
    gain_per_s: f64,
}

/// A piece of flight that stays inside all limits in all winds.
pub(super) struct Flown<'a> {
    pub(super) flyers: Vec<Flyer<'a>>,
    pub(super) samples: Vec<Kinematics>,
}

impl<'a> Search<'a> {
    pub fn new(request: &'a Request) -> Result<Self, PlanError> {
        let frame = LocalFrame::new(request.home.place());
        let airframe = &request.airframe;
        let checker = Checker::new(airframe, &request.limits, frame)?;
        let start = frame.to_local(request.start);
        let placements =
            placements(&checker, airframe, &request.limits, frame, start, request.start_height_m);
        let wind = request.limits.wind();
        // The wind aloft is never the wind given: weaker, and turned either way.
        let turned = |deg: f64| Rotation3::from_axis_angle(&Vector3::z_axis(), deg.to_radians()) * wind;
        let winds = vec![wind, wind * 0.4, turned(25.0), turned(-25.0)];
        Ok(Self { request, frame, checker, placements, winds })
    }

    pub(super) fn checker(&self) -> &Checker<'a> {
        &self.checker
    }

    pub fn run<P: Predictor>(self, predictor: P) -> Result<Plan, PlanError> {
        let fresh = predictor.clone();
        let root = self.root(predictor)?;
        let before = root.predictor.sigmas();
        let mut reasons = Vec::new();
        let first = self.expand(&root, &mut reasons);
        if first.is_empty() {
            return Err(PlanError::NothingFits { reasons });
        }
        let excited = self.excited(&root.predictor);
        let start_score = log_score(&before, &excited);
        let mut beam = self.prune(first, start_score, &excited);
        let mut best = root;
        best.log_score = start_score;
        for _ in 0..MOST_MANEUVERS {
            for node in &beam {
                let extra = node.flyers[0].t_s() - best.flyers[0].t_s();
                if best.log_score - node.log_score > LEAST_GAIN_PER_S * extra {
                    best = node.clone();
                }
            }
            let next: Vec<_> = beam
                .iter()
                .filter(|n| n.predictor.sigmas().iter().zip(&excited).any(|(s, e)| *e && s.ratio() > 1.0))
                .flat_map(|n| self.expand(n, &mut Vec::new()))
                .collect();
            if next.is_empty() {
                break;
            }
            beam = self.prune(next, start_score, &excited);
        }
        self.finish(best, fresh, &excited)
    }

    fn root<P: Predictor>(&self, predictor: P) -> Result<Node<'a, P>, PlanError> {
        let request = self.request;
        let start = self.frame.to_local(request.start);
        let position = Vector3::new(start.x, start.y, -request.start_height_m);
        let entry = Entry::cruising(&request.airframe, position, request.start_heading_deg.to_radians());
        let limit = request.budget_s;
        let flyers: Vec<_> = self
            .winds
            .iter()
            .map(|w| Flyer::new(&request.airframe, self.frame, *w, entry).within(limit))
            .collect();
        let mut root = Node {
            flyers,
            predictor,
            items: self.take_off(start)?,
            maneuvers: Vec::new(),
            path: Vec::new(),
            log_score: 0.0,
            gain_per_s: 0.0,
        };
        if request.take_off && request.airframe.is_fixed_wing() {
            self.join(&mut root).map_err(|e| PlanError::NoWayHome(e.to_string()))?;
        }
        self.end(&root.flyers).map_err(|e| PlanError::NoWayHome(e.to_string()))?;
        Ok(root)
    }

    /// A circle after the take-off: nobody knows exactly where a climb ends, and the first leg shall not begin there.
    fn join<P: Predictor>(&self, root: &mut Node<'a, P>) -> Result<(), Rejection> {
        let Some(place) = self.placements.first() else { return Ok(()) };
        let items = join_items(&self.request.airframe, place)?;
        let flown = self.fly(&root.flyers, &items)?;
        root.predictor.fly(&flown.samples, self.request.fix_interval_s);
        root.flyers = flown.flyers;
        root.path = flown.samples;
        root.items.extend(items);
        Ok(())
    }

    /// The take-off, if the mission begins with one. Its climb is a straight line from home to the start.
    fn take_off(&self, start: Vector2<f64>) -> Result<Vec<MissionItem>, PlanError> {
        let request = self.request;
        if !request.take_off {
            return Ok(Vec::new());
        }
        let along = |k: u32| start * (f64::from(k) / f64::from(CLIMB_CHECKS));
        let room = (0..=CLIMB_CHECKS).map(|k| self.checker.room_at(along(k))).fold(f64::INFINITY, f64::min);
        if room < 0.0 {
            return Err(PlanError::ClimbOut { by_m: -room });
        }
        let pitch = if request.airframe.is_fixed_wing() { TAKE_OFF_PITCH_DEG } else { 0.0 };
        let height = request.start_height_m as f32;
        let params = [pitch, 0.0, 0.0, f32::NAN];
        Ok(vec![MissionItem::at(command::NAV_TAKEOFF, params, request.start, height)])
    }

    /// Which states this airframe can excite at all: every automatic maneuver twice, wherever it fits. One alone may show
    /// nothing where another must come first.
    fn excited<P: Predictor>(&self, predictor: &P) -> Vec<bool> {
        let airframe = &self.request.airframe;
        let mut predictor = predictor.clone();
        let before = predictor.sigmas();
        let position = Vector3::new(0.0, 0.0, -self.request.start_height_m);
        for round in 0..2 {
            let entry = Entry::cruising(airframe, position, f64::from(round));
            for maneuver in Maneuver::automatic(airframe) {
                let path = maneuver.kinematics(airframe, &entry, &self.request.limits.wind());
                predictor.fly(&path, self.request.fix_interval_s);
            }
        }
        before.iter().zip(predictor.sigmas()).map(|(b, a)| a.sigma < EXCITED * b.sigma).collect()
    }

    /// The hold at the end: around the centre with the most room.
    pub(super) fn end_items(&self) -> Vec<MissionItem> {
        let airframe = &self.request.airframe;
        self.placements
            .first()
            .map(|p| {
                let radius = airframe.stored_radius_m(
                    airframe.planned_radius_m(airframe.speed_cruise_m_per_s + p.wind_m_per_s),
                );
                let place = self.frame.to_place(p.center_m);
                let params = [0.0, 0.0, radius as f32, f32::NAN];
                MissionItem::at(command::NAV_LOITER_UNLIM, params, place, p.height_m as f32)
            })
            .into_iter()
            .collect()
    }

    /// Flies items from here in every wind.
    pub(super) fn fly(&self, from: &[Flyer<'a>], items: &[MissionItem]) -> Result<Flown<'a>, Rejection> {
        self.checker.items(items)?;
        let mut flyers = from.to_vec();
        let mut nominal = Vec::new();
        for (k, flyer) in flyers.iter_mut().enumerate() {
            if k == 0 {
                nominal = flyer.fly(items)?.samples;
                self.checker.path(&nominal)?;
            } else {
                self.checker.places(&flyer.fly_places(items)?)?;
            }
        }
        Ok(Flown { flyers, samples: nominal })
    }

    /// The end from here; also whether it comes in time.
    fn end(&self, from: &[Flyer<'a>]) -> Result<Flown<'a>, Rejection> {
        self.fly(from, &self.end_items())
    }

    /// Every maneuver that can follow, and for those that cannot the reason of the last try.
    fn expand<P: Predictor>(&self, node: &Node<'a, P>, reasons: &mut Vec<String>) -> Vec<Node<'a, P>> {
        let mut found = Vec::new();
        for maneuver in Maneuver::automatic(&self.request.airframe) {
            let mut reason = None;
            let before = found.len();
            for place in &self.placements {
                match self.candidate(node, maneuver, place) {
                    Ok(next) => found.push(next),
                    Err(e) => reason = Some(format!("{maneuver:?}: {e}")),
                }
                let symmetric = matches!(maneuver, Maneuver::SteadyTurn(_));
                // One heading is enough where it changes nothing; where one fits, a second is variety enough.
                if symmetric || found.len() >= before + 2 {
                    break;
                }
            }
            if found.len() == before {
                reasons.extend(reason);
            }
        }
        found
    }

    fn candidate<P: Predictor>(
        &self,
        node: &Node<'a, P>,
        maneuver: Maneuver,
        place: &Placement,
    ) -> Result<Node<'a, P>, Rejection> {
        let items = maneuver.items(&self.request.airframe, place)?;
        let flown = self.fly(&node.flyers, &items)?;
        self.end(&flown.flyers)?;
        let mut next = node.clone();
        let start_s = node.flyers[0].t_s();
        next.maneuvers.push(PlannedManeuver {
            maneuver,
            start_s,
            end_s: flown.flyers[0].t_s(),
            items: node.items.len() + 1..=node.items.len() + items.len(),
        });
        next.predictor.fly(&flown.samples, self.request.fix_interval_s);
        next.flyers = flown.flyers;
        next.items.extend(items);
        next.path.extend(flown.samples);
        Ok(next)
    }

    /// Scores, sorts and keeps the best by gain per second, one for each first maneuver as long as there are others: plans of
    /// long and of short maneuvers are only comparable at their ends.
    fn prune<P: Predictor>(
        &self,
        mut nodes: Vec<Node<'a, P>>,
        start_score: f64,
        excited: &[bool],
    ) -> Vec<Node<'a, P>> {
        for node in &mut nodes {
            node.log_score = log_score(&node.predictor.sigmas(), excited);
            node.gain_per_s = (start_score - node.log_score) / node.flyers[0].t_s().max(1.0);
        }
        nodes.sort_by(|a, b| b.gain_per_s.total_cmp(&a.gain_per_s));
        let mut firsts = Vec::new();
        let (mut kept, mut rest) = (Vec::new(), Vec::new());
        for node in nodes {
            let first = node.maneuvers.first().map(|m| m.maneuver);
            if firsts.contains(&first) {
                rest.push(node);
            } else {
                firsts.push(first);
                kept.push(node);
            }
        }
        kept.extend(rest);
        kept.truncate(self.request.beam.max(1));
        kept
    }

    fn finish<P: Predictor>(
        &self,
        best: Node<'a, P>,
        mut fresh: P,
        excited: &[bool],
    ) -> Result<Plan, PlanError> {
        let mut no_landing = None;
        let landing = (self.request.landing && self.request.airframe.is_fixed_wing())
            .then(|| self.landing(&best.flyers).map_err(|e| no_landing = Some(e.to_string())).ok());
        let end = match landing.flatten() {
            Some(landing) => landing,
            None => {
                let end = self.end(&best.flyers).map_err(|e| PlanError::NoWayHome(e.to_string()))?;
                Landing { items: self.end_items(), samples: end.samples, flyers: end.flyers }
            }
        };
        let mut items = best.items;
        items.extend(end.items);
        self.checker.end(&items)?;
        let mut path = best.path;
        path.extend(end.samples);
        let before = fresh.sigmas();
        let mut sigmas = vec![SigmasAt { t_s: 0.0, sigmas: before.clone() }];
        sigmas.extend(report(&mut fresh, &path, self.request.fix_interval_s));
        let mut notes = self.notes(&before, &fresh.sigmas(), excited);
        notes.extend(no_landing.map(|e| format!("no room to land; the mission ends in a hold: {e}")));
        Ok(Plan {
            mission: Mission { home: Some(self.request.home), items },
            maneuvers: best.maneuvers,
            sigmas,
            duration_s: end.flyers[0].t_s(),
            path,
            frame: self.frame,
            notes,
        })
    }

    fn notes(&self, before: &[NamedSigma], after: &[NamedSigma], excited: &[bool]) -> Vec<String> {
        let names = |wanted: &dyn Fn(usize, &NamedSigma) -> bool| {
            let found = before.iter().enumerate().filter(|(k, s)| wanted(*k, s));
            found.map(|(_, s)| s.name.as_str()).collect::<Vec<_>>().join(", ")
        };
        let lit = |k: usize| excited.get(k).copied().unwrap_or(false);
        let dark = names(&|k, _| !lit(k));
        let unfinished = names(&|k, _| lit(k) && after.get(k).is_some_and(|s| s.ratio() > 1.0));
        let mut notes = Vec::new();
        if !dark.is_empty() {
            let wing = self.request.airframe.is_fixed_wing();
            let remedy = if wing { "; a pilot must fly sideslips for column y of G" } else { "" };
            notes.push(format!("maneuvers of the autopilot leave dark: {dark}{remedy}"));
        }
        if !unfinished.is_empty() {
            notes.push(format!("after this plan still short of the target: {unfinished}"));
        }
        notes
    }
}

/// Logarithm of the worst normalised sigma of the states that can be excited, and a part of their mean.
pub(super) fn log_score(sigmas: &[NamedSigma], excited: &[bool]) -> f64 {
    let logs = sigmas.iter().zip(excited).filter(|(_, e)| **e).map(|(s, _)| s.ratio().max(0.1).ln());
    let (mut worst, mut sum, mut count) = (f64::NEG_INFINITY, 0.0, 0.0);
    for log in logs {
        worst = worst.max(log);
        sum += log;
        count += 1.0;
    }
    if count > 0.0 { worst + MEAN_WEIGHT * sum / count } else { 0.0 }
}

/// Sigmas about once per second along a path.
fn report<P: Predictor>(predictor: &mut P, path: &[Kinematics], fix_interval_s: f64) -> Vec<SigmasAt> {
    let mut found = Vec::new();
    let mut piece = 0;
    for (k, sample) in path.iter().enumerate() {
        let begun = path.get(piece).map_or(0.0, |p| p.t_s);
        if sample.t_s - begun >= REPORT_S || k + 1 == path.len() {
            // Pieces share their ends: the predictor counts time from sample to sample.
            predictor.fly(path.get(piece..=k).unwrap_or_default(), fix_interval_s);
            found.push(SigmasAt { t_s: sample.t_s, sigmas: predictor.sigmas() });
            piece = k;
        }
    }
    found
}
