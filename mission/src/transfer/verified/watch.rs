//! What an upload notices on its way: the state of the vehicle, what PX4 says of the mission, and other stations.

use super::{QUIET_S, Step, VerifiedUpload};
use crate::item::MissionKind;
use crate::transfer::{Action, Envelope, MissionMessage, MissionResult, events};

/// Values of `MISSION_STATE`.
const MISSION_STATE_UNKNOWN: u8 = 0;
const MISSION_STATE_ACTIVE: u8 = 3;

impl VerifiedUpload {
    /// `MISSION_CURRENT` says whether a mission is active, on autopilots that fill that field.
    pub(super) fn notice_state(&mut self, envelope: &Envelope) {
        if let MissionMessage::Current { state, .. } = envelope.message
            && state != MISSION_STATE_UNKNOWN
            && self.peers.concerns(envelope)
            && let Some(vehicle) = &mut self.vehicle
        {
            vehicle.flying_mission = state == MISSION_STATE_ACTIVE;
        }
    }

    /// What PX4 says of the mission it has, or is about to have, accepted.
    pub(super) fn notice_verdict(&mut self, now: f64, envelope: &Envelope) {
        let MissionMessage::Event { id, arguments } = &envelope.message else { return };
        let listening = match &self.step {
            Step::Upload(u) => u.all_served(),
            Step::AwaitLate | Step::ReadBack(_) | Step::AwaitVerdict { .. } | Step::Quiet { .. } => {
                now < self.verdict_until
            }
            _ => false,
        };
        let about_mission = self.peers.kind == MissionKind::Mission;
        if listening
            && about_mission
            && self.peers.concerns(envelope)
            && let Some(words) = events::rejection(*id, arguments)
            && !self.rejections.contains(&words)
        {
            self.rejections.push(words);
        }
    }

    /// The vehicle asks another station for items, or acknowledges those.
    pub(super) fn notice_others(&mut self, now: f64, envelope: &Envelope) {
        let of_a_transfer = match envelope.message {
            MissionMessage::Request { .. } | MissionMessage::RequestInt { .. } => true,
            MissionMessage::Ack { result, .. } => result == MissionResult::ACCEPTED,
            _ => false,
        };
        let about_this_list = envelope.message.mission_type() == Some(self.peers.mission_type());
        let to_another = envelope.to.system != 0 && envelope.to != self.peers.me;
        if !self.touched
            || !of_a_transfer
            || !about_this_list
            || !to_another
            || envelope.from != self.peers.vehicle
        {
            return;
        }
        self.others = Some((envelope.to, now));
        if let Step::Quiet { until, at_most } = &mut self.step {
            *until = (now + QUIET_S).min(*at_most);
        }
    }

    pub(super) fn objection(&self) -> Option<String> {
        if self.options.even_while_flying {
            return None;
        }
        match self.vehicle {
            None => Some("nothing is known of the vehicle's mode yet (no heartbeat)".to_owned()),
            Some(state) => state.objection().map(str::to_owned),
        }
    }

    /// Whether more may be sent: not while the vehicle flies a mission or waits in that mode.
    pub(super) fn vehicle_allows(&self) -> bool {
        self.objection().is_none()
    }

    /// Stops sending items to a vehicle that was armed or put into its mission mode on the way. ArduPilot stores items one by one, also while
    /// it flies them (`MissionItemProtocol::handle_mission_item`), so it then holds a mixture; PX4 changes over with the last item only
    /// (`MavlinkMissionManager`) and keeps the previous mission.
    pub(super) fn interrupt(&mut self, now: f64) -> Vec<Action> {
        if self.options.even_while_flying || !self.touched {
            return Vec::new();
        }
        let armed_since = !self.armed_before && self.vehicle.is_some_and(|v| v.armed);
        let objection = self.objection();
        let actions = match &mut self.step {
            Step::Upload(upload) if armed_since || objection.is_some() => {
                let (done, all) = upload.progress();
                let what = objection.as_deref().unwrap_or("the vehicle is armed");
                self.why.get_or_insert_with(|| {
                    format!(
                        "{what}: that began during the upload, which was stopped after {done} of {all} items"
                    )
                });
                self.uploads_left = 0;
                upload.cancel()
            }
            Step::Restore(upload) if objection.is_some() => upload.cancel(),
            // In its mission mode it would jump to that item.
            Step::FirstItem(_) if objection.is_some() => return self.all_there(now),
            _ => return Vec::new(),
        };
        self.advance(now, actions)
    }
}
