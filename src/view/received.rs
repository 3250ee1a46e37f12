//! What only whoever receives the frames knows: what has come so far, and that nothing comes any more.

use crate::engine::situation::{SILENT_S, Situation, SituationKind, no_data};
use crate::engine::snapshot::{Phase, Snapshot};
use crate::link::status::LinkStatus;
use crate::sensors::{Autopilot, Converter};

/// Why there is nothing to estimate from, in words that say what to do.
pub fn lacking(links: &[LinkStatus], converter: &Converter) -> String {
    let bytes: u64 = links.iter().map(|l| l.received_bytes).sum();
    let frames: u64 = links.iter().map(|l| l.framer.frames).sum();
    let systems = converter.systems().words();
    match (bytes, frames) {
        (0, _) => "nothing was received: is the autopilot powered, is this its port, and does it speak MAVLink there?".to_owned(),
        (_, 0) => format!("{bytes} bytes were received and no MAVLink frame among them: is the baud rate right?"),
        _ if systems.is_empty() => {
            format!("{frames} MAVLink frames were received and no heartbeat of an autopilot among them")
        }
        _ => format!("no inertial data were received; messages came from: {systems}"),
    }
}

/// Adds it to a snapshot. `silent_s`: since the last frame of the vehicle.
pub fn complete(snapshot: &mut Snapshot, links: &[LinkStatus], converter: &Converter, silent_s: f64) {
    if snapshot.phase == Phase::WaitingForImu {
        snapshot.waiting_for = lacking(links, converter);
        if snapshot.situation.kind == SituationKind::Starting {
            snapshot.situation.text.clone_from(&snapshot.waiting_for);
        }
    }
    if silent_s > SILENT_S {
        let mode = std::mem::take(&mut snapshot.situation.mode);
        snapshot.situation = Situation { mode, ..no_data(silent_s) };
        snapshot.guidance.instruction.clear();
    }
}

/// Which parameters make a vehicle send what is needed, where it is not asked: in ArduPilot RAW_IMU belongs to the stream RAW_SENS and GPS_RAW_INT to
/// EXT_STAT (`GCS_MAVLink`, `ap_message STREAM_…_msgs`), called SRn_ until 4.6 and MAVn_, from 1, since 4.7; PX4 sends HIGHRES_IMU at 50 Hz and
/// GPS_RAW_INT in the mode "onboard" (`Mavlink::configure_streams_to_default`).
pub fn to_set(autopilot: Autopilot) -> &'static str {
    match autopilot {
        Autopilot::Ardupilot => {
            "set SR0_RAW_SENS 50 and SR0_EXT_STAT 5 for USB, SR1_ for TELEM1, SR2_ for TELEM2 (since 4.7: MAV1_, MAV2_, MAV3_)"
        }
        Autopilot::Px4 => {
            "set USB_MAV_MODE (USB) or MAV_n_MODE (TELEM) to Onboard, and MAV_n_RATE to what the port carries"
        }
        Autopilot::Unknown => {
            "set it up to send RAW_IMU or HIGHRES_IMU at 50 Hz and GPS_RAW_INT at 5 Hz on this port"
        }
    }
}
