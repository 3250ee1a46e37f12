//! A closer look at the candidates that have a chance: each at its own best values, with its own noise.

use super::super::linear::Problem;
use super::super::map;
use super::super::noise::Noise;
use super::settle::{STEPS, watching};
use super::{Added, Candidate, Point, Search, is_drift};
use crate::effects::Effect;
use crate::identify::watched::Watched;
use crate::math::{exp, ln};

/// Candidates this far behind the best are not looked at again, nats …
const MAX_DEFICIT_NATS: f64 = 15.0;
/// … nor those behind by more than this share of the best.
const MAX_DEFICIT_SHARE: f64 = 0.5;
/// At most so many candidates are looked at again.
const CLOSE_LOOKS: usize = 6;
/// So many formulas beside them that explain as much as the best, but for the price of the grammar: that makes them less likely, and a name of the
/// catalogue still stands alone only where none does ([`Search::step`]).
const FORMULAS: usize = 5;
/// Values and noise take turns at most so often …
const TURNS: usize = 3;
/// … and no more when a turn gains less than this, nats.
const MIN_TURN_GAIN_NATS: f64 = 0.3;
/// A drift may be stronger than the largest of the sizes to try, or weaker than the least, by this factor.
const BEYOND_SIZES: f64 = 3.0;

/// The logarithm of a size is looked for in steps of this, uphill …
const WIDE_STEP: f64 = 0.6;
/// … at most so many, …
const MOST_WIDE_STEPS: usize = 4;
/// … and then by a parabola through points so far apart.
const FINE_STEP: f64 = 0.3;
/// A likelihood that is flatter than this along the logarithm of a size says nothing about it.
const LEAST_CURVATURE: f64 = 0.2;

/// Whether a candidate is so far behind the best that it cannot be it.
fn is_far_behind(evidence: f64, top: f64) -> bool {
    evidence <= top - MAX_DEFICIT_NATS - MAX_DEFICIT_SHARE * top
}

/// A candidate as it looks from close by.
#[derive(Clone)]
struct Look {
    candidate: Candidate,
    point: Point,
    /// Whether the last turn gained nothing worth another one.
    done: bool,
}

impl Search<'_> {
    /// Looks again at the best of a scan at `from`; best first, its evidence counted against `point`.
    pub(in crate::identify) fn close_looks(
        &self,
        scanned: &[Candidate],
        from: &Point,
        point: &Point,
    ) -> Vec<(Candidate, Point)> {
        let top = scanned.first().map_or(f64::NEG_INFINITY, |c| c.evidence);
        // What is less likely than nothing is not looked at again.
        if top < 0.0 {
            return Vec::new();
        }
        let (first, others) = scanned.split_at(CLOSE_LOOKS.min(scanned.len()));
        let explains = |c: &&Candidate| {
            let price = c.setting.effect.prior_cost();
            price > 0.0 && c.evidence + price >= top
        };
        let hopeful: Vec<&Candidate> = first
            .iter()
            .filter(|c| !is_far_behind(c.evidence, top))
            .chain(others.iter().filter(explains).take(FORMULAS))
            .collect();
        // The first turn sorts out most of them.
        let looks = map(self.workers, hopeful.len(), |k| self.look_closely(hopeful[k], from, point));
        let top = looks.iter().map(|l| l.candidate.evidence).fold(0.0, f64::max);
        let mut looks = map(self.workers, looks.len(), |k| {
            let look = looks[k].clone();
            if look.done || is_far_behind(look.candidate.evidence, top) {
                look
            } else {
                self.look_on(look, point)
            }
        });
        looks.sort_by(|a, b| b.candidate.evidence.total_cmp(&a.candidate.evidence));
        looks.into_iter().map(|l| (l.candidate, l.point)).collect()
    }

    /// One candidate at its own best values and, after a turn, noise, beginning at `from`. Evidence is counted against `before`.
    fn look_closely(&self, candidate: &Candidate, from: &Point, before: &Point) -> Look {
        let candidate = candidate.clone();
        let mut own = Added { setting: candidate.setting.clone(), prior: candidate.prior.clone() };
        if is_drift(own.setting.effect) {
            let problems = self.problems(from, &Watched::default());
            self.refine_size(&mut own, &from.added, (&problems, &from.noise));
        }
        let with: Vec<Added> = from.added.iter().cloned().chain([own]).collect();
        let (point, problems) = if candidate.setting.effect.is_source_mistake() {
            self.settle_anew(&with, &from.noise)
        } else {
            self.settle(&with, &from.noise, from, STEPS)
        };
        self.turn(Look { candidate, point, done: false }, problems, before).0
    }

    /// The same with more turns.
    fn look_on(&self, mut look: Look, before: &Point) -> Look {
        let mut problems = self.problems(&look.point, &watching(&look.point.added));
        for _ in 1..TURNS {
            if look.done {
                break;
            }
            (look, problems) = self.turn(look, problems, before);
        }
        look
    }

    /// Noise and values take turns: noise, and drifts, that stood for the effect go as the effect comes.
    fn turn(&self, look: Look, problems: Vec<Problem>, before: &Point) -> (Look, Vec<Problem>) {
        let Look { mut candidate, mut point, .. } = look;
        let noise = self.fit_noise(&problems, &point.noise).noise;
        let mut added = point.added.clone();
        self.resize(&mut added, (&problems, &noise));
        let (settled, problems) = self.settle_again(&added, &noise, &point, problems);
        let gain = settled.evidence - point.evidence;
        if gain > 0.0 {
            point = settled;
        }
        if let Some(last) = point.added.last() {
            candidate.setting = last.setting.clone();
            if is_drift(last.setting.effect) {
                candidate.prior.clone_from(&last.prior);
            }
        }
        // The average over prior widths and instants costs what it cost in the scan.
        candidate.evidence = point.evidence - before.evidence - candidate.cost;
        (Look { candidate, point, done: gain < MIN_TURN_GAIN_NATS }, problems)
    }

    /// Finds the size of every drift beside all others anew: what it stood for may have been named since.
    pub(super) fn resize(&self, added: &mut [Added], flown: (&[Problem], &Noise)) {
        for k in 0..added.len() {
            if is_drift(added[k].setting.effect) {
                let mut others = added.to_vec();
                let mut own = others.remove(k);
                self.refine_size(&mut own, &others, flown);
                added[k] = own;
            }
        }
    }

    /// The size of a drift beside others, found to within a few per cent, with the sigma by the likelihood's curvature.
    fn refine_size(&self, drift: &mut Added, others: &[Added], (problems, noise): (&[Problem], &Noise)) {
        let Some((least, most)) = sizes_within(drift.setting.effect) else { return };
        let within = |ln_size: f64| exp(ln_size).clamp(least, most);
        let value =
            |ln_size: f64| self.with_random_walk(problems, others, &drift.setting, within(ln_size), noise);
        let (at, curvature) = peak(value, ln(drift.setting.values[0]));
        let size = within(at);
        drift.setting.values = vec![size];
        drift.setting.sigmas = vec![size / curvature.sqrt()];
        drift.prior = vec![(size, 0.0)];
    }
}

/// Between which sizes an effect that is found by trying may lie. What walks faster than the largest is not a bias any more:
/// it would pass for whatever is missing.
pub(super) fn sizes_within(effect: &dyn Effect) -> Option<(f64, f64)> {
    let sizes = effect.sizes_to_try();
    Some((sizes.first()? / BEYOND_SIZES, sizes.last()? * BEYOND_SIZES))
}

/// Place and curvature of a maximum, by parabolas through three points.
fn peak(value: impl Fn(f64) -> f64, start: f64) -> (f64, f64) {
    let (mut at, mut here) = (start, value(start));
    let (mut down, mut up) = (value(at - WIDE_STEP), value(at + WIDE_STEP));
    for _ in 0..MOST_WIDE_STEPS {
        if up > here && up >= down {
            (at, down, here, up) = (at + WIDE_STEP, here, up, value(at + 2.0 * WIDE_STEP));
        } else if down > here {
            (at, down, here, up) = (at - WIDE_STEP, value(at - 2.0 * WIDE_STEP), down, here);
        } else {
            break;
        }
    }
    let vertex = |down: f64, here: f64, up: f64, step: f64| {
        let curvature = (2.0 * here - up - down) / (step * step);
        let by = if curvature > 0.0 { (up - down) / (2.0 * step * curvature) } else { 0.0 };
        (by.clamp(-step, step), curvature)
    };
    at += vertex(down, here, up, WIDE_STEP).0;
    let (by, curvature) = vertex(value(at - FINE_STEP), value(at), value(at + FINE_STEP), FINE_STEP);
    (at + by, curvature.max(LEAST_CURVATURE))
}
