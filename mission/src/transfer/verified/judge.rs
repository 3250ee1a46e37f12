//! What to do with what was read back.

use super::first_item::FirstItem;
use super::words::{self, summary};
use super::{LATE_S, LONGEST_QUIET_S, Outcome, QUIET_S, Step, VerifiedUpload};
use crate::compare::differences;
use crate::item::{Mission, MissionKind};
use crate::transfer::{Action, OnBoard};

/// What was verified is read so often again before another station's mission is taken for one.
const CONFIRMATIONS: u32 = 2;

impl VerifiedUpload {
    /// Compares what was read with both missions and decides.
    pub(super) fn judge(&mut self, now: f64, got: &Mission) -> Vec<Action> {
        let wrong = differences(self.autopilot, &self.mission, got);
        if !self.rejections.is_empty() {
            let said = self.rejections.join("; ");
            let why = format!("the vehicle accepted it and then rejected it: {said}");
            self.why.get_or_insert(why);
            self.uploads_left = 0;
        } else if wrong.is_empty() && !self.cancelled {
            return self.all_there(now);
        } else if self.confirmed > 0 && !self.cancelled {
            return self.not_there_any_more(now, got);
        }
        if let Some(waiting) = self.wait_for_others(now) {
            return waiting;
        }
        let why = self
            .why
            .get_or_insert_with(|| format!("what was read back is not what was sent ({})", summary(&wrong)))
            .clone();
        let backup = self.backup.clone().unwrap_or_default();
        if self.is_of_others(got, &backup) {
            self.finish_foreign(got);
            return Vec::new();
        }
        if self.uploads_left > 0 && !self.cancelled && self.vehicle_allows() {
            return self.begin_upload(now);
        }
        self.put_back(now, got, &backup, why)
    }

    /// Every item is there: after the time in which PX4 may reject it the first item is made the current one; and after a quiet in which
    /// another station may have sent its own mission, it is read once more.
    pub(super) fn all_there(&mut self, now: f64) -> Vec<Action> {
        if now < self.verdict_until {
            self.step = Step::AwaitVerdict { until: self.verdict_until };
        } else if !std::mem::replace(&mut self.begun_at_first, true) {
            return self.begin_at_first(now);
        } else if self.confirmed == 0 && self.options.confirm {
            self.confirmed = 1;
            self.step = Step::Quiet { until: now + QUIET_S, at_most: now + LONGEST_QUIET_S };
        } else {
            self.step = Step::Finished(Outcome::Verified { items: self.mission.items.len() });
        }
        Vec::new()
    }

    /// A vehicle that flies, or of which nothing is known, keeps the index that it has.
    fn begin_at_first(&mut self, now: f64) -> Vec<Action> {
        let free = self.vehicle.is_some_and(|v| v.objection().is_none());
        if self.peers.kind != MissionKind::Mission || self.mission.items.is_empty() || !free {
            return self.all_there(now);
        }
        let (first, actions) = FirstItem::start(self.mission.first_index(self.autopilot), now);
        self.step = Step::FirstItem(first);
        actions
    }

    /// It was there whole, and is not any more.
    fn not_there_any_more(&mut self, now: f64, got: &Mission) -> Vec<Action> {
        if self.confirmed < CONFIRMATIONS {
            self.confirmed += 1;
            // Not what a late answer makes of it.
            self.late_until = now + LATE_S;
            return self.check(now);
        }
        self.finish_foreign(got);
        Vec::new()
    }

    /// While another station sends items there is nothing to judge.
    fn wait_for_others(&mut self, now: f64) -> Option<Vec<Action>> {
        let (_, heard) = self.others?;
        if now >= heard + QUIET_S || self.quiets_left == 0 {
            return None;
        }
        self.quiets_left -= 1;
        self.step = Step::Quiet { until: heard + QUIET_S, at_most: now + LONGEST_QUIET_S };
        Some(Vec::new())
    }

    /// Whether what was read came from elsewhere: no item of it is of the two missions, and it is not as long as what was sent, which
    /// a vehicle that stores items otherwise would have; or another station was heard, and some items are of neither.
    fn is_of_others(&self, got: &Mission, backup: &Mission) -> bool {
        if self.options.over_others {
            return false;
        }
        let on_board = OnBoard::judge(self.autopilot, &self.mission, backup, got);
        match on_board {
            OnBoard::Other { items } => self.others.is_some() || items != self.mission.items.len(),
            OnBoard::Mixture { foreign, .. } => self.others.is_some() && foreign > 0,
            _ => false,
        }
    }

    fn finish_foreign(&mut self, got: &Mission) {
        let kind = self.peers.kind;
        let whose = match self.others {
            Some((by, _)) => {
                format!("station {} (component {}) has sent a {kind} meanwhile", by.system, by.component)
            }
            None => format!("another station must have sent a {kind} meanwhile"),
        };
        let on_vehicle = format!(
            "the {kind} on the vehicle is NOT the one that was sent, nor the previous one: {} items were read back, and {whose}",
            got.items.len()
        );
        let what_to_do = format!(
            "Nothing was put over it. Find out who else uploads, then upload again and read the {kind} back"
        );
        self.step = Step::Finished(Outcome::Foreign { on_vehicle, what_to_do });
    }

    /// Puts the backup back, where the vehicle may be changed.
    fn put_back(&mut self, now: f64, got: &Mission, backup: &Mission, why: String) -> Vec<Action> {
        if differences(self.autopilot, backup, got).is_empty() {
            self.finish_untouched(why);
            return Vec::new();
        }
        let on_board = OnBoard::judge(self.autopilot, &self.mission, backup, got);
        if let Some(objection) = self.objection() {
            self.stranded(&format!("{why}; {objection}. On board is now {on_board}"), words::HELD);
            return Vec::new();
        }
        if self.restores_left == 0 {
            let first = summary(&differences(self.autopilot, backup, got));
            let detail =
                format!("{} items were read back that are neither mission ({first})", got.items.len());
            self.stranded(&detail, words::LINK);
            return Vec::new();
        }
        self.restores_left -= 1;
        self.send(now, true)
    }

    pub(super) fn stranded(&mut self, detail: &str, what_to_do: &str) {
        let (new, old) = (self.mission.items.len(), self.backup.as_ref().map_or(0, |b| b.items.len()));
        let on_vehicle = format!(
            "UNKNOWN {} ON THE VEHICLE: it may hold the new one ({new} items), the previous one ({old} items) \
             or a mixture of both; {detail}",
            self.peers.kind.to_string().to_uppercase()
        );
        let what_to_do = what_to_do.to_owned();
        self.step = Step::Finished(Outcome::Unknown { on_vehicle, what_to_do });
    }
}
