//! What is said of a plan: each state with its verdict, and notes.

use super::search::Search;
use super::{PlannedState, Reach};
use crate::predictor::NamedSigma;

impl Search<'_> {
    /// What the pilot should know beside the sigmas.
    pub(super) fn notes(&self, states: &[PlannedState]) -> Vec<String> {
        let names = |wanted: &dyn Fn(&PlannedState) -> bool| {
            states.iter().filter(|s| wanted(s)).map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ")
        };
        let unobservable = names(&|s| s.reach == Reach::Unobservable);
        let short = names(&|s| s.reach == Reach::Short);
        let unfinished = names(&|s| s.reach == Reach::Known && !s.known());
        let of_g = |s: &PlannedState| s.name.starts_with('g') && s.name[1..].parse::<u8>().is_ok();
        let mut notes = Vec::new();
        if !unobservable.is_empty() {
            let wing = self.request.airframe.is_fixed_wing();
            let remedy = if wing && states.iter().any(of_g) {
                "; a pilot must fly sideslips for column y of G"
            } else {
                ""
            };
            notes.push(format!("unobservable with maneuvers of the autopilot: {unobservable}{remedy}"));
        }
        if !short.is_empty() {
            let minutes = self.request.budget_s / 60.0;
            notes.push(format!(
                "excited, but too weakly to reach the target within {minutes:.0} min of any maneuver: {short}"
            ));
        }
        let by_hand = names(&|s| of_g(s) && !s.known());
        if !by_hand.is_empty() {
            notes.push(format!(
                "by the information bound this flight does not make {by_hand} observable; six sides by hand on the ground do, in five minutes (gaware ground)"
            ));
        }
        if !unfinished.is_empty() {
            notes.push(format!("after this plan still short of the target: {unfinished}; allow more time"));
        }
        notes
    }
}

/// Each state at the end of the plan.
pub(super) fn verdicts(after: &[NamedSigma], reach: &[Reach]) -> Vec<PlannedState> {
    let state = |(s, reach): (&NamedSigma, &Reach)| PlannedState {
        name: s.name.to_string(),
        unit: s.unit.to_string(),
        sigma: s.sigma,
        target: s.target,
        reach: *reach,
    };
    after.iter().zip(reach).map(state).collect()
}
