//! One ranking: what each maneuver, and each after another, would make observable from the present covariance.

use super::motion::Motion;
use gaware_mission::airframe::Airframe;
use gaware_mission::kinematics::Kinematics;
use gaware_mission::maneuver::{Entry, Maneuver};
use gaware_mission::predictor::{BoundPredictor, NamedSigma, Predictor, TrackStep};
use gaware_nav::math::{ln, powf};
use nalgebra::Vector3;
use std::sync::Arc;

/// Predicted flights are thinned to every so manyth sample (0.2 s): the covariance does not mind.
const THINNING: usize = 4;
/// States count that the best candidate, flown again and again, would make observable within this time, s, …
const HORIZON_S: f64 = 600.0;
/// … or within this many times what the nearest one takes, …
const NEAREST: f64 = 2.0;
/// … but not those that would take longer than this: no flight lasts so long, s.
const OUT_OF_REACH_S: f64 = 3600.0;
/// A level turn wavers by this much, m.
const WAVER_M: f64 = 3.0;

/// A ranking under way.
#[derive(Debug, Clone)]
pub(super) struct Round {
    pub predictor: BoundPredictor,
    entry: Entry,
    fix_interval_s: f64,
    /// How far down and up maneuvers may lead from here, m; `None` where no one knows.
    space_m: Option<[f64; 2]>,
    left: Vec<Task>,
    /// Each maneuver that has been run.
    firsts: Vec<First>,
    pub after: Vec<Candidate>,
}

/// What is still to be run in a ranking.
#[derive(Debug, Clone, Copy)]
enum Task {
    First(Maneuver),
    /// After the first one of this index, the one of that index.
    Second(usize, usize),
}

/// Maneuvers one after the other, and the sigmas behind them.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub maneuvers: Vec<Maneuver>,
    pub duration_s: f64,
    pub after: Vec<NamedSigma>,
}

/// A maneuver that has been run alone.
#[derive(Debug, Clone)]
struct First {
    maneuver: Maneuver,
    /// It is flown again after each of the others.
    flight: CandidateFlight,
    /// Where it led; `None` where that is outside the space.
    behind: Option<Behind>,
}

/// The predicted flight of a maneuver.
#[derive(Debug, Clone)]
struct CandidateFlight {
    track: Arc<[TrackStep]>,
    /// Lowest, highest and last height above the entry, m.
    low_m: f64,
    high_m: f64,
    end_m: f64,
}

/// Where a maneuver leads.
#[derive(Debug, Clone)]
struct Behind {
    predictor: BoundPredictor,
    /// Height gained, m.
    up_m: f64,
}

impl Round {
    /// All maneuvers, alone and one after the other.
    pub fn new(
        predictor: BoundPredictor,
        entry: Entry,
        fix_interval_s: f64,
        space_m: Option<[f64; 2]>,
        all: &[Maneuver],
    ) -> Self {
        let count = all.len();
        let seconds = (0..count).flat_map(|first| (0..count).map(move |second| Task::Second(first, second)));
        let mut left: Vec<Task> = all.iter().map(|m| Task::First(*m)).chain(seconds).collect();
        left.reverse();
        Self { predictor, entry, fix_interval_s, space_m, left, firsts: Vec::new(), after: Vec::new() }
    }

    /// Runs one maneuver; false when none is left.
    pub fn step(&mut self, airframe: &Airframe) -> bool {
        let Some(task) = self.left.pop() else { return false };
        match task {
            Task::First(maneuver) => {
                let flight = self.flight(maneuver, airframe);
                let behind = self.fly(&self.predictor, 0.0, &flight);
                if let Some(behind) = &behind {
                    self.note(vec![maneuver], behind, airframe);
                }
                self.firsts.push(First { maneuver, flight, behind });
            }
            Task::Second(first, second) => {
                let (Some(First { maneuver: one, behind: Some(from), .. }), Some(next)) =
                    (self.firsts.get(first), self.firsts.get(second))
                else {
                    return true;
                };
                if let Some(behind) = self.fly(&from.predictor, from.up_m, &next.flight) {
                    self.note(vec![*one, next.maneuver], &behind, airframe);
                }
            }
        }
        true
    }

    /// What a maneuver does by its prediction.
    pub fn motion(&self, maneuver: Maneuver, airframe: &Airframe) -> Option<Motion> {
        Motion::predicted(&maneuver.kinematics(airframe, &self.entry, &Vector3::zeros()))
    }

    fn flight(&self, maneuver: Maneuver, airframe: &Airframe) -> CandidateFlight {
        let flight = maneuver.kinematics(airframe, &self.entry, &Vector3::zeros());
        let heights = || flight.iter().map(Kinematics::height_m);
        let (low_m, high_m) = (heights().fold(0.0, f64::min), heights().fold(0.0, f64::max));
        let end_m = heights().next_back().unwrap_or(0.0);
        let thin: Vec<Kinematics> = flight.into_iter().step_by(THINNING).collect();
        CandidateFlight { track: self.predictor.track(&thin).into(), low_m, high_m, end_m }
    }

    /// One maneuver from this covariance, `up_m` above the entry, if it stays in the space.
    fn fly(&self, from: &BoundPredictor, up_m: f64, flight: &CandidateFlight) -> Option<Behind> {
        if let Some([down, up]) = self.space_m
            && (up_m + flight.low_m < -down || up_m + flight.high_m > up)
        {
            return None;
        }
        let mut predictor = from.clone();
        predictor.follow(&flight.track, self.fix_interval_s);
        Some(Behind { predictor, up_m: up_m + flight.end_m })
    }

    fn note(&mut self, maneuvers: Vec<Maneuver>, behind: &Behind, airframe: &Airframe) {
        let duration_s = maneuvers.iter().map(|m| m.duration_s(airframe)).sum();
        self.after.push(Candidate { maneuvers, duration_s, after: behind.predictor.sigmas() });
    }
}

/// How far down and up from this height maneuvers may lead, m. Whoever is outside the band comes back to it first.
pub(super) fn space([floor_m, ceiling_m]: [f64; 2], height_m: f64) -> [f64; 2] {
    let height_m = height_m.clamp(floor_m, ceiling_m.max(floor_m));
    [height_m - floor_m + WAVER_M, ceiling_m - height_m + WAVER_M]
}

/// Which states the candidates, flown again and again, can make observable soon enough to count.
pub(super) fn within_reach(before: &[NamedSigma], candidates: &[Candidate]) -> Vec<bool> {
    let rate = |i: usize, b: &NamedSigma| {
        let of =
            |c: &Candidate| c.after.get(i).map_or(0.0, |a| ln(b.sigma / a.sigma) / c.duration_s.max(1.0));
        candidates.iter().map(of).fold(0.0, f64::max)
    };
    let time_s = |(i, b): (usize, &NamedSigma)| match (ln(b.ratio().max(1.0)), rate(i, b)) {
        (_, rate) if rate <= 0.0 => f64::INFINITY,
        (far, rate) => far / rate,
    };
    let times: Vec<f64> = before.iter().enumerate().map(time_s).collect();
    let nearest = times.iter().copied().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
    let longest = HORIZON_S.max(NEAREST * nearest).min(OUT_OF_REACH_S);
    // What is known already would only dilute the mean.
    times.into_iter().map(|t| t > 0.0 && t <= longest).collect()
}

/// Fourth-power mean of sigma over target, at least 1 each: close to the largest, with every laggard in it.
pub(super) fn worst(sigmas: &[NamedSigma], counts: &[bool]) -> f64 {
    let ratios: Vec<f64> =
        sigmas.iter().zip(counts).filter(|(_, c)| **c).map(|(s, _)| s.ratio().max(1.0)).collect();
    if ratios.is_empty() {
        return 1.0;
    }
    powf(ratios.iter().map(|r| r.powi(4)).sum::<f64>() / ratios.len() as f64, 0.25)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_mission::fence::LocalFrame;
    use gaware_mission::item::{Home, LatLon};
    use gaware_mission::predictor::Targets;
    use gaware_nav::model::Model;

    /// What is a candidate with this space.
    fn candidates(space_m: [f64; 2]) -> Vec<Vec<Maneuver>> {
        let airframe = Airframe::example("small_fixed_wing").unwrap();
        let entry = Entry::cruising(&airframe, Vector3::zeros(), 0.0);
        let start = Maneuver::Climb.kinematics(&airframe, &entry, &Vector3::zeros())[0];
        let home = Home { lat_e7: 474_000_000, lon_e7: 85_000_000, alt_m: 450.0 };
        let frame = LocalFrame::new(LatLon { lat_deg: 47.4, lon_deg: 8.5 });
        let predictor =
            BoundPredictor::from_priors(&Model::standard(), &start, frame, home, Targets::default());
        let all = [Maneuver::Climb, Maneuver::Descent, Maneuver::FigureEight];
        let mut round = Round::new(predictor, entry, 0.2, Some(space_m), &all);
        while round.step(&airframe) {}
        round.after.into_iter().map(|c| c.maneuvers).collect()
    }

    #[test]
    fn near_the_ground_a_descent_must_come_after_a_climb() {
        let low = candidates(space([40.0, 120.0], 45.0));
        assert!(low.iter().all(|c| c[0] != Maneuver::Descent), "{low:?}");
        assert!(low.contains(&vec![Maneuver::Climb, Maneuver::Descent]));
        let high = candidates(space([40.0, 120.0], 100.0));
        assert!(high.iter().all(|c| c[0] != Maneuver::Climb), "{high:?}");
        assert!(high.contains(&vec![Maneuver::Descent, Maneuver::Climb]));
        // Whoever climbs out after a take-off is asked for what fits at the floor.
        assert_eq!(space([40.0, 120.0], 3.0), space([40.0, 120.0], 40.0));
    }
}
