//! How far the mission is, and what screens show of the vehicle: who flies, what, how long still, and what follows.

use super::{Ending, Flight, Milestone, Stage};
use crate::figures::counted;
use crate::pipeline::Estimator;
use crate::sinks::status::{Control, VehicleView};
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
        let since_s = self.milestones.last().map_or(0.0, |m| m.t_s);
        let before_s = k.checked_sub(1).and_then(|k| plan.maneuvers.get(k)).map_or(0.0, |m| m.end_s);
        let reached = self.log.items.iter().map(|(item, _)| *item).max().unwrap_or(0);
        let now = if reached + 1 < *planned.items.start() { format!("on the way to: {now}") } else { now };
        let duration_s = planned.end_s - before_s;
        let flown_s = self.now_s - self.took_off_s - since_s;
        VehicleView {
            control: Control::Autopilot,
            mode: "mission, armed".to_owned(),
            now,
            maneuver: k as u64 + 1,
            maneuvers: plan.maneuvers.len() as u64,
            duration_s,
            left_s: Some((duration_s - flown_s).max(0.0)),
            next: words(k + 1).unwrap_or(after.now),
        }
    }
}
