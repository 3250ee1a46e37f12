//! The upload of the planned mission.

use super::{BEFORE_TAKE_OFF_S, Ending, Flight, Stage};
use crate::pipeline::Estimator;
use gaware_mission::change::VerifiedChange;
use gaware_mission::transfer::verified::{Options, Outcome, VerifiedUpload};
use gaware_mission::transfer::{Address, Peers};

impl<E: Estimator> Flight<E> {
    pub(super) fn begin_upload(&mut self) {
        let Some(vehicle) = self.vehicle else { return };
        let sender = self.voice.sender();
        let me = Address { system: sender.system_id, component: sender.component_id };
        let (upload, actions) = VerifiedUpload::start(
            Peers::new(me, vehicle.address),
            vehicle.autopilot,
            // No other station is there.
            Options { confirm: false, ..Options::default() },
            self.prepared.plan.mission.clone(),
            Some(vehicle.state),
            self.now_s,
        );
        self.tell(format!("uploading {} mission items", self.prepared.plan.mission.items.len()));
        self.upload = Some(upload);
        self.stage = Stage::Uploading;
        self.transfer(actions);
    }

    pub(super) fn follow_upload(&mut self) {
        let Some(outcome) = self.upload.as_ref().and_then(|u| u.outcome()).cloned() else { return };
        self.upload = None;
        self.tell(outcome.to_string());
        match &outcome {
            Outcome::Verified { .. } => self.stage = Stage::Ready(self.now_s + BEFORE_TAKE_OFF_S),
            other => self.end(Ending::NotUploaded(other.to_string())),
        }
        self.outcome = Some(outcome);
    }
}
