//! How far the mission is, and what screens show of the vehicle: who flies, what, how long still, and what follows.

use super::{Ending, Flight, Milestone, Stage};
use crate::figures::counted;
use crate::pipeline::Estimator;
use crate::sinks::status::{Control, VehicleView};
use gaware_mission::item::command;
use gaware_mission::planner::PlannedManeuver;

impl<E: Estimator> Flight<E> {
    /// The autopilot has reached the item with this sequence number.
    pub(super) fn reached(&mut self, seq: usize) {
        let home_first = usize::from(self.autopilot.mission().len() > self.prepared.plan.mission.items.len());
        let item = seq + 1 - home_first;
        let t_s = self.now_s - self.took_off_s;
        self.log.items.push((item, t_s));
        let sigmas = self.sigmas();
        while let Some(planned) = self.prepared.plan.maneuvers.get(self.milestones.len()) {
            if item < self.last_place(planned) {
                return;
            }
            let flown = format!("flown: {}", planned.maneuver.words(&self.prepared.settings.airframe).short);
            let maneuver = self.milestones.len();
            self.milestones.push(Milestone { maneuver, t_s, sigmas: sigmas.clone() });
            self.tell(flown);
        }
    }

    /// The last item of a maneuver that is a place: autopilots report places as reached, not actions, and some maneuvers end with one.
    fn last_place(&self, planned: &PlannedManeuver) -> usize {
        let items = &self.prepared.plan.mission.items;
        let is_place = |item: &usize| item.checked_sub(1).and_then(|k| items.get(k)?.place()).is_some();
        planned.items.clone().rev().find(is_place).unwrap_or(*planned.items.end())
    }

    /// When the maneuver itself began, s after the take-off: at its first waypoint, or, as a circle is reported at its end only, when by the plan the
    /// way there is over.
    fn begun(&self, planned: &PlannedManeuver, by_plan_s: f64) -> Option<f64> {
        let items = &self.prepared.plan.mission.items;
        let first = planned.items.clone().find(|k| items.get(k - 1).is_some_and(|i| i.place().is_some()))?;
        let waypoint = items.get(first - 1).is_some_and(|i| i.command == command::NAV_WAYPOINT);
        if waypoint {
            return self.log.items.iter().find(|(item, _)| *item >= first).map(|(_, t_s)| *t_s);
        }
        (self.now_s - self.took_off_s >= by_plan_s).then_some(by_plan_s)
    }

    /// Who flies now, what, how long still, and what follows.
    pub fn vehicle_view(&self) -> VehicleView {
        let ground = |next: &str| VehicleView {
            control: Control::Ground,
            mode: "disarmed".to_owned(),
            next: next.to_owned(),
            ..VehicleView::default()
        };
        let items = self.prepared.plan.mission.items.len();
        let auto = |now: &str, next: &str| VehicleView {
            control: Control::Autopilot,
            mode: "mission, armed".to_owned(),
            now: now.to_owned(),
            next: next.to_owned(),
            ..VehicleView::default()
        };
        match &self.stage {
            Stage::Standing => ground(&format!("upload of the mission, {}", counted(items, "item"))),
            Stage::Uploading => ground("the upload is under way"),
            Stage::Ready(_) => ground("take-off"),
            Stage::Flying if self.prepared.lands() => self.maneuver_view(auto("approach and landing", "")),
            Stage::Flying => self.maneuver_view(auto("hold at the end of the mission", "")),
            Stage::Landing => auto("return and landing", ""),
            Stage::Over(Ending::Holding) => auto("hold at the end of the mission", ""),
            Stage::Over(_) => ground(""),
        }
    }

    /// The maneuver that is flown now; `after` where all of them have been.
    fn maneuver_view(&self, after: VehicleView) -> VehicleView {
        let plan = &self.prepared.plan;
        let words = |k: usize| {
            let planned = plan.maneuvers.get(k)?;
            Some(planned.maneuver.words(&self.prepared.settings.airframe).short.clone())
        };
        let k = self.milestones.len();
        let (Some(planned), Some(now)) = (plan.maneuvers.get(k), words(k)) else { return after };
        let before_s = k.checked_sub(1).and_then(|k| plan.maneuvers.get(k)).map_or(0.0, |m| m.end_s);
        // The plan counts the way to a maneuver with it; what is left of its time beside the maneuver's own is the way there.
        let whole_s = planned.end_s - before_s;
        let duration_s = planned.maneuver.duration_s(&self.prepared.settings.airframe).min(whole_s);
        let transit_s = whole_s - duration_s;
        // What takes longer than planned has no count.
        let left = |of_s: f64, since_s: f64| {
            Some(of_s - (self.now_s - self.took_off_s - since_s)).filter(|s| *s >= 0.0)
        };
        let since_s = self.milestones.last().map_or(0.0, |m| m.t_s);
        let begun = self.begun(planned, since_s + transit_s);
        VehicleView {
            control: Control::Autopilot,
            mode: "mission, armed".to_owned(),
            now: if begun.is_some() { now } else { format!("on the way to: {now}") },
            maneuver: k as u64 + 1,
            maneuvers: plan.maneuvers.len() as u64,
            duration_s,
            left_s: begun.and_then(|at_s| left(duration_s, at_s)),
            transit_left_s: if begun.is_some() { None } else { left(transit_s, since_s) },
            next: words(k + 1).unwrap_or(after.now),
        }
    }
}
