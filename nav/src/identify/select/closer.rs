//! A closer look at the candidates that have a chance: each at its own best values, with its own noise.

use super::super::linear::Problem;
use super::super::map;
use super::super::noise::Noise;
use super::settle::STEPS;
use super::{Added, Candidate, Point, Search};
use crate::effects::Effect;
use crate::filter::watch::Watched;

/// Candidates this far behind the best are not looked at again, nats …
const HOPELESS: f64 = 15.0;
/// … nor those behind by more than this share of the best.
const HOPELESS_SHARE: f64 = 0.5;
/// At most so many candidates are looked at again.
const CLOSE_LOOKS: usize = 6;
/// Without a candidate this good nobody is looked at again, nats.
const NOBODY: f64 = 0.0;
/// Values and noise take turns at most so often …
const TURNS: usize = 3;
/// … and no more when a turn gains less than this, nats.
const WORTH: f64 = 0.3;
/// A drift may be stronger than the largest of the sizes to try, or weaker than the least, by this factor.
const BEYOND_SIZES: f64 = 3.0;

impl Search<'_> {
    /// Looks again at the best of a scan; best first, its evidence counted against `point`.
    pub(super) fn close_looks(&self, scanned: &[Candidate], point: &Point) -> Vec<(Candidate, Point)> {
        let top = scanned.first().map_or(f64::NEG_INFINITY, |c| c.evidence);
        if top < NOBODY {
            return Vec::new();
        }
        let worth = |c: &&Candidate| c.evidence > top - HOPELESS - HOPELESS_SHARE * top;
        let chosen: Vec<&Candidate> = scanned.iter().filter(worth).take(CLOSE_LOOKS).collect();
        let mut looks = map(self.workers, chosen.len(), |k| self.look_closely(chosen[k], point));
        looks.sort_by(|a, b| b.0.evidence.total_cmp(&a.0.evidence));
        looks
    }

    /// One candidate at its own best values and noise.
    fn look_closely(&self, candidate: &Candidate, point: &Point) -> (Candidate, Point) {
        let mut refined = candidate.clone();
        if is_drift(candidate) {
            let problems = self.problems(point, &Watched::default());
            refined = self.refine_size(refined, &problems, point, &point.noise);
        }
        let with = |candidate: &Candidate| {
            let own = Added { setting: candidate.setting.clone(), prior: candidate.prior.clone() };
            point.added.iter().cloned().chain([own]).collect::<Vec<_>>()
        };
        let (mut better, mut problems) = if refined.setting.effect.is_source_mistake() {
            self.settle_anew(&with(&refined), &point.noise)
        } else {
            self.settle(&with(&refined), &point.noise, point, STEPS)
        };
        // Noise and values take turns: noise that stood for the effect goes as the effect comes.
        for _ in 0..TURNS {
            let noise = self.fit_noise(&problems, &better.noise).noise;
            let mut added = better.added.clone();
            refined = self.refine_size(refined, &problems, point, &noise);
            if let Some(last) = added.last_mut().filter(|_| is_drift(&refined)) {
                *last = Added { setting: refined.setting.clone(), prior: refined.prior.clone() };
            }
            let (settled, there) = self.settle_again(&added, &noise, &better, problems);
            let gain = settled.evidence - better.evidence;
            if gain > 0.0 {
                better = settled;
            }
            if gain < WORTH {
                break;
            }
            problems = there;
        }
        if let Some(last) = better.added.last() {
            refined.setting = last.setting.clone();
        }
        // The average over prior widths and instants costs what it cost in the scan.
        refined.evidence = better.evidence - point.evidence - refined.cost;
        (refined, better)
    }

    /// The size of a drift beside the effects of `point`, found to within a few per cent, with the sigma that the likelihood's curvature tells. Other
    /// candidates stay as they are.
    fn refine_size(
        &self,
        mut candidate: Candidate,
        problems: &[Problem],
        point: &Point,
        noise: &Noise,
    ) -> Candidate {
        let Some((least, most)) = sizes_within(candidate.setting.effect) else { return candidate };
        let within = |ln_size: f64| ln_size.exp().clamp(least, most);
        let value =
            |ln_size: f64| self.wandered(problems, &point.added, &candidate.setting, within(ln_size), noise);
        let (at, curvature) = peak(value, candidate.setting.values[0].ln());
        let at = within(at).ln();
        candidate.setting.values = vec![at.exp()];
        candidate.setting.sigmas = vec![at.exp() / curvature.sqrt()];
        candidate.prior = vec![(at.exp(), 0.0)];
        candidate
    }
}

/// Between which sizes an effect that is found by trying may lie. What walks faster than the largest is not a bias any more:
/// it would pass for whatever is missing.
pub(super) fn sizes_within(effect: &dyn Effect) -> Option<(f64, f64)> {
    let sizes = effect.sizes_to_try();
    Some((sizes.first()? / BEYOND_SIZES, sizes.last()? * BEYOND_SIZES))
}

fn is_drift(candidate: &Candidate) -> bool {
    sizes_within(candidate.setting.effect).is_some()
}

/// Place and curvature of a maximum, by parabolas through three points.
fn peak(value: impl Fn(f64) -> f64, start: f64) -> (f64, f64) {
    let (mut at, mut step) = (start, 0.8);
    let mut here = value(at);
    for _ in 0..4 {
        let (up, down) = (value(at + step), value(at - step));
        let curvature = (2.0 * here - up - down) / (step * step);
        if up > here && up > down {
            (at, here) = (at + step, up);
        } else if down > here {
            (at, here) = (at - step, down);
        } else {
            let by = if curvature > 0.0 { (up - down) / (2.0 * step * curvature) } else { 0.0 };
            at += by.clamp(-step, step);
            here = value(at);
            step *= 0.6;
        }
    }
    let (up, down) = (value(at + 0.3), value(at - 0.3));
    (at, ((2.0 * here - up - down) / 0.09).max(0.2))
}
