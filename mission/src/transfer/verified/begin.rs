//! How a verified upload begins: from nothing, with a backup at hand, or where another run of the program was interrupted.

use super::{Goal, LATE_S, Options, Step, VehicleState, VerifiedUpload};
use crate::item::{Autopilot, Mission};
use crate::transfer::{Action, Download, Peers};

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
            touched: false,
            cancelled: false,
            why: None,
            late_until: f64::NEG_INFINITY,
            verdict_until: f64::NEG_INFINITY,
            rejections: Vec::new(),
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
    /// is wanted, from what was kept of both.
    pub fn resume(
        peers: Peers,
        autopilot: Autopilot,
        options: Options,
        mission: Mission,
        backup: Mission,
        goal: Goal,
        now: f64,
    ) -> (Self, Vec<Action>) {
        let (mut upload, _) =
            Self::start(peers, autopilot, Options { even_while_flying: true, ..options }, mission, None, now);
        upload.backup = Some(backup);
        upload.touched = true;
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
