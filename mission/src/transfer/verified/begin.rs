//! How a verified upload begins: from nothing, with a backup at hand, or where another run of the program was interrupted.

use super::{Goal, LATE_S, Options, Step, VehicleState, VerifiedUpload};
use crate::change::VerifiedChange;
use crate::item::{Autopilot, Mission};
use crate::transfer::{Action, Download, Peers};

/// How often an upload waits for the end of another station's.
const QUIETS: u32 = 10;

impl VerifiedUpload {
    /// Starts with the backup; send what is returned. A vehicle that is flying a mission, or whose state is not known, is
    /// refused here and again right before the upload.
    pub fn start(
        peers: Peers,
        autopilot: Autopilot,
        options: Options,
        mission: Mission,
        vehicle: Option<VehicleState>,
        now: f64,
    ) -> (Self, Vec<Action>) {
        let (download, actions) = Download::start(peers, now);
        let mut upload = Self {
            uploads_left: options.upload_attempts,
            restores_left: options.restore_attempts,
            downloads_left: options.download_attempts,
            peers,
            autopilot,
            options,
            mission,
            backup: None,
            vehicle,
            armed_before: false,
            others: None,
            begun_at_first: false,
            confirmed: 0,
            abandoned: false,
            touched: false,
            cancelled: false,
            why: None,
            late_until: f64::NEG_INFINITY,
            verdict_until: f64::NEG_INFINITY,
            rejections: Vec::new(),
            quiets_left: QUIETS,
            step: Step::BackUp(download),
        };
        match upload.objection() {
            Some(why) => {
                upload.finish_untouched(why);
                (upload, Vec::new())
            }
            None => (upload, actions),
        }
    }

    /// As [`Self::start`], with a backup that was read just before.
    pub fn start_with_backup(
        peers: Peers,
        autopilot: Autopilot,
        options: Options,
        mission: Mission,
        backup: Mission,
        vehicle: Option<VehicleState>,
        now: f64,
    ) -> (Self, Vec<Action>) {
        let (mut upload, _) = Self::start(peers, autopilot, options, mission, vehicle, now);
        upload.backup = Some(backup);
        let actions = if upload.outcome().is_some() { Vec::new() } else { upload.begin_upload(now) };
        (upload, actions)
    }

    /// Takes up an upload that was interrupted by the end of this program: checks what is on board and brings the mission that
    /// is wanted, from what was kept of both, the new mission and the one before. Nothing is sent to a vehicle that flies a mission.
    pub fn resume(
        peers: Peers,
        autopilot: Autopilot,
        options: Options,
        (mission, backup): (Mission, Mission),
        goal: Goal,
        vehicle: Option<VehicleState>,
        now: f64,
    ) -> (Self, Vec<Action>) {
        let (mut upload, _) = Self::start(peers, autopilot, options, mission, vehicle, now);
        upload.backup = Some(backup);
        upload.touched = true;
        upload.armed_before = vehicle.is_some_and(|v| v.armed);
        upload.cancelled = goal == Goal::Previous;
        if goal != Goal::New {
            upload.uploads_left = 0;
        }
        upload.why = Some("the upload was interrupted".to_owned());
        // What the program before has asked is not known.
        upload.late_until = now + LATE_S;
        let actions = upload.check(now);
        (upload, actions)
    }
}
