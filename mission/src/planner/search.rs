//! The beam search.

use super::landing::Landing;
use super::outcome::verdicts;
use super::place::placements;
use super::{PROMISED_SHARE, Plan, PlanError, PlannedManeuver, Reach, Rejection, Request, SigmasAt};
use crate::fence::LocalFrame;
use crate::flight::Flyer;
use crate::item::{Mission, MissionItem, command};
use crate::kinematics::Kinematics;
use crate::maneuver::{Entry, Maneuver, Placement, Side, join_items};
use crate::predictor::{NamedSigma, Predictor};
use crate::safety::Checker;
use gaware_nav::math::ln;
use nalgebra::{Rotation3, Vector3};

/// A state counts as one that this airframe can excite if its maneuvers can shrink its sigma to this share.
const EXCITED: f64 = 0.9;
/// Weight of the mean over all states beside the worst one: breaks ties, keeps the search going where the worst is stuck.
const MEAN_WEIGHT: f64 = 0.3;
/// Least gain in log score per second that is worth flying for.
const LEAST_GAIN_PER_S: f64 = 1e-5;
/// A maneuver that takes less than this share off the sigma of a state that stays short of its target is not flown for it: after ten equal ones the
/// next takes a twentieth.
const WORTH_FLYING: f64 = 0.05;
/// After two equal maneuvers a third is flown only where it takes this share off the sigma of some state.
const WORTH_REPEATING: f64 = 0.1;
/// Most maneuvers in a plan.
const MOST_MANEUVERS: usize = 40;
/// Predicted flights are thinned to every so manyth sample where only the order of magnitude counts.
const THINNING: usize = 4;
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
    /// Smallest sigmas before its last maneuver: those of sensors grow again where a maneuver brings in the tolerances of others.
    before: Vec<f64>,
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

    /// Whether any maneuver fits.
    pub fn begins<P: Predictor>(&self, predictor: P) -> bool {
        self.root(predictor).is_ok_and(|root| !self.expand(&root, &mut Vec::new()).is_empty())
    }

    pub fn run<P: Predictor>(self, predictor: P) -> Result<Plan, PlanError> {
        let fresh = predictor.clone();
        let root = self.root(predictor)?;
        let before = root.predictor.sigmas();
        let mut reasons = Vec::new();
        let first = self.expand(&root, &mut reasons);
        if first.is_empty() {
            if !reasons.is_empty() && reasons.iter().all(|(_, r)| r.is_late()) {
                return Err(PlanError::NoTime { budget_s: self.request.budget_s });
            }
            let words = |m: Maneuver| m.words(&self.request.airframe).short;
            let reasons = reasons.into_iter().map(|(m, r)| format!("{}: {r}", words(m))).collect();
            return Err(PlanError::NothingFits { reasons });
        }
        let reach = self.reach(&root, &first);
        let start_score = log_score(&before, &reach);
        let mut beam = self.prune(first, start_score, &reach);
        let mut best = root;
        best.log_score = start_score;
        // The shortest plan that makes everything known that can be.
        let mut done: Option<Node<'a, P>> = None;
        for _ in 0..MOST_MANEUVERS {
            for node in &beam {
                let extra = node.t_s() - best.t_s();
                if best.log_score - node.log_score > LEAST_GAIN_PER_S * extra {
                    best = node.clone();
                }
                if self.is_done(node, &reach) && done.as_ref().is_none_or(|d| node.t_s() < d.t_s()) {
                    done = Some(node.clone());
                }
            }
            let latest_s = done.as_ref().map_or(f64::INFINITY, Node::t_s);
            let next: Vec<_> = beam
                .iter()
                .filter(|n| n.t_s() < latest_s && !self.is_done(n, &reach))
                .flat_map(|n| self.expand(n, &mut Vec::new()))
                .collect();
            if next.is_empty() {
                break;
            }
            beam = self.prune(next, start_score, &reach);
        }
        self.finish(done.unwrap_or(best), fresh, &reach)
    }

    /// Why not even the hold at the end can be reached.
    fn no_way_home(&self, why: &Rejection) -> PlanError {
        if why.is_late() {
            return PlanError::NoTime { budget_s: self.request.budget_s };
        }
        PlanError::NoWayHome(why.to_string())
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
            items: self.begin(start)?,
            maneuvers: Vec::new(),
            path: Vec::new(),
            log_score: 0.0,
            gain_per_s: 0.0,
            before: Vec::new(),
        };
        if request.take_off && request.airframe.is_fixed_wing() {
            self.join(&mut root).map_err(|e| self.no_way_home(&e))?;
        }
        self.end(&root.flyers).map_err(|e| self.no_way_home(&e))?;
        Ok(root)
    }

    /// A circle after the take-off: no one knows exactly where a climb ends, and the first leg shall not begin there.
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

    /// What the maneuvers that fit here can do with each state in the time there is: each of them flown again and again, both sides of a
    /// turn in turn, and all in turn, for one alone may show nothing where another must come first.
    fn reach<P: Predictor>(&self, root: &Node<'a, P>, firsts: &[Node<'a, P>]) -> Vec<Reach> {
        let before = root.predictor.sigmas();
        let left_s = self.request.budget_s - root.t_s();
        let flown: Vec<Vec<Kinematics>> = firsts
            .iter()
            .map(|n| n.path.iter().skip(root.path.len()).step_by(THINNING).copied().collect())
            .collect();
        let mut best: Vec<f64> = before.iter().map(|s| s.sigma).collect();
        let each = flown.iter().map(std::slice::from_ref);
        let sides: Vec<Vec<Kinematics>> = firsts
            .iter()
            .zip(&flown)
            .filter(|(n, _)| n.maneuvers.last().is_some_and(|m| m.maneuver.is_spiral()))
            .map(|(_, path)| path.clone())
            .collect();
        for round in each.chain([sides.as_slice(), flown.as_slice()]) {
            let mut predictor = root.predictor.clone();
            let mut t_s = 0.0;
            for path in round.iter().cycle() {
                let (Some(begin), Some(end)) = (path.first(), path.last()) else { break };
                t_s += (end.t_s - begin.t_s).max(1.0);
                if t_s > left_s {
                    break;
                }
                predictor.fly(path, self.request.fix_interval_s);
            }
            for (best, now) in best.iter_mut().zip(predictor.sigmas()) {
                *best = best.min(now.sigma);
            }
        }
        let judge = |(before, best): (&NamedSigma, f64)| match best {
            best if best <= PROMISED_SHARE * before.target => Reach::Known,
            best if best < EXCITED * before.sigma => Reach::Short,
            _ => Reach::Unobservable,
        };
        before.iter().zip(best).map(judge).collect()
    }

    /// The hold at the end: around the centre with the most space.
    pub(super) fn end_items(&self) -> Vec<MissionItem> {
        let airframe = &self.request.airframe;
        self.placements
            .first()
            .map(|p| {
                let radius = airframe.stored_radius_m(
                    airframe.planned_radius_m(airframe.speed_cruise_m_per_s + p.wind_m_per_s),
                );
                let place = self.frame.to_place(p.center_m);
                let params = [0.0, 0.0, radius as f32, airframe.autopilot.free_heading()];
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
    fn expand<P: Predictor>(
        &self,
        node: &Node<'a, P>,
        reasons: &mut Vec<(Maneuver, Rejection)>,
    ) -> Vec<Node<'a, P>> {
        let mut found = Vec::new();
        let all = node.predictor.maneuvers(&self.request.airframe).into_iter();
        for maneuver in all.filter(|m| keeps_balance(*m, &node.maneuvers)) {
            let mut reason = None;
            let before = found.len();
            for place in &self.placements {
                match self.candidate(node, maneuver, place) {
                    Ok(next) => found.push(next),
                    Err(e) => reason = Some((maneuver, e)),
                }
                // One heading is enough where it changes nothing; where one fits, a second is variety enough.
                if maneuver.is_symmetric() || found.len() >= before + 2 {
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
        let least =
            |(k, now): (usize, &NamedSigma)| node.before.get(k).map_or(now.sigma, |b| b.min(now.sigma));
        next.before = node.predictor.sigmas().iter().enumerate().map(least).collect();
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
        if next.repeats_in_vain() || next.is_in_vain() {
            return Err(Rejection::InVain);
        }
        Ok(next)
    }

    /// Scores, sorts and keeps the best by gain per second, one for each first maneuver as long as there are others: plans of
    /// long and of short maneuvers are only comparable at their ends.
    fn prune<P: Predictor>(
        &self,
        mut nodes: Vec<Node<'a, P>>,
        start_score: f64,
        reach: &[Reach],
    ) -> Vec<Node<'a, P>> {
        for node in &mut nodes {
            let sigmas = node.predictor.sigmas();
            node.log_score = log_score(&sigmas, reach);
            node.gain_per_s = (start_score - node.log_score) / node.t_s().max(1.0);
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
        reach: &[Reach],
    ) -> Result<Plan, PlanError> {
        let mut no_landing = None;
        let required = self.landing_required();
        let landing = (self.request.landing || required)
            .then(|| self.landing(&best.flyers).map_err(|e| no_landing = Some(e.to_string())).ok());
        let end = match landing.flatten() {
            Some(landing) => landing,
            None if required => return Err(PlanError::NoLanding(no_landing.unwrap_or_default())),
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
        let after = fresh.sigmas();
        let states = verdicts(&after, reach);
        let mut notes = self.notes(&states);
        notes
            .extend(no_landing.map(|e| format!("not enough space to land; the mission ends in a hold: {e}")));
        Ok(Plan {
            mission: Mission { home: Some(self.request.home), items },
            maneuvers: best.maneuvers,
            sigmas,
            duration_s: end.flyers[0].t_s(),
            path,
            frame: self.frame,
            states,
            notes,
        })
    }

    /// Whether more time is of no use: everything is known that can be, and what stays short of its target has stopped to get better.
    fn is_done<P: Predictor>(&self, node: &Node<'a, P>, reach: &[Reach]) -> bool {
        if !self.request.within_reach_only && reach.contains(&Reach::Short) {
            return false;
        }
        let sigmas = node.predictor.sigmas();
        let better =
            |k: usize, now: f64| node.before.get(k).is_some_and(|before| now < (1.0 - WORTH_FLYING) * before);
        sigmas.iter().zip(reach).enumerate().all(|(k, (s, r))| match r {
            Reach::Known => s.ratio() <= PROMISED_SHARE,
            Reach::Short => !node.predictor.is_short_of_use() || !better(k, s.sigma),
            Reach::Unobservable => true,
        })
    }
}

impl<P> Node<'_, P> {
    /// Time of the nominal flight so far, s.
    fn t_s(&self) -> f64 {
        self.flyers.first().map_or(0.0, Flyer::t_s)
    }

    /// Whether its last maneuver brings nothing of sensors: an error of one is named or it is not.
    fn is_in_vain(&self) -> bool
    where
        P: Predictor,
    {
        let open = |(now, before): &(&NamedSigma, &f64)| **before > PROMISED_SHARE * now.target;
        let sigmas = self.predictor.sigmas();
        let mut open = sigmas.iter().zip(&self.before).filter(open);
        !self.predictor.is_short_of_use() && !open.any(better_by(WORTH_FLYING))
    }

    /// Whether its last maneuver is the third of a kind in a row and brings little.
    fn repeats_in_vain(&self) -> bool
    where
        P: Predictor,
    {
        let [.., a, b, c] = self.maneuvers.as_slice() else { return false };
        let equal = a.maneuver == b.maneuver && b.maneuver == c.maneuver;
        equal && !self.predictor.sigmas().iter().zip(&self.before).any(better_by(WORTH_REPEATING))
    }
}

/// Whether a sigma has become smaller by this share.
fn better_by(share: f64) -> impl Fn((&NamedSigma, &f64)) -> bool {
    move |(now, before)| now.sigma <= (1.0 - share) * before
}

/// Whether turns stay divided between both sides: turns to one side alone tie what the side force does to the gyros to what the load
/// does.
fn keeps_balance(next: Maneuver, flown: &[PlannedManeuver]) -> bool {
    let Some(side) = next.side() else { return true };
    let more: f64 = flown.iter().filter_map(|m| m.maneuver.side()).map(Side::sign).sum();
    more * side.sign() <= 0.0
}

/// Logarithm of the worst normalised sigma of the states that can become known, and a part of the mean of all that can be excited: what
/// nothing can make known must not mask what one maneuver does better than another.
pub(super) fn log_score(sigmas: &[NamedSigma], reach: &[Reach]) -> f64 {
    let (mut worst, mut sum, mut count) = (f64::NEG_INFINITY, 0.0, 0.0);
    for (state, reach) in sigmas.iter().zip(reach).filter(|(_, r)| **r != Reach::Unobservable) {
        let log = ln(state.ratio().max(PROMISED_SHARE));
        if *reach == Reach::Known {
            worst = worst.max(log);
        }
        sum += log;
        count += 1.0;
    }
    let mean = if count > 0.0 { sum / count } else { 0.0 };
    MEAN_WEIGHT * mean + if worst.is_finite() { worst } else { mean }
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
