//! A flight of a quarter of an hour in which everything happens that changes the words on a screen: waiting, a pilot, an
//! autopilot, long and short instructions, warnings that come and go, an upload, a lost link, the end.

use super::script;
use gaware::engine::situation::FlightMode;
use gaware::engine::snapshot::{Phase, Snapshot};
use gaware::sinks::status::{Control, MissionState, MissionView, VehicleView};
use gaware_nav::math::{cos, sin};
use std::f64::consts::TAU;

/// One round of maneuvers of the short script, s.
const ROUND_S: f64 = 103.0;
/// Everything is done from here on, s.
const DONE_S: f64 = 840.0;
/// The link is lost between these, s.
const LOST_S: (f64, f64) = (500.0, 560.0);
/// The autopilot flies between these, s.
const AUTOPILOT_S: (f64, f64) = (200.0, 470.0);

const NAMES: [&str; 4] = [
    "Steep turn left",
    "Straight and level, speed from 17 to 28 m/s and back",
    "Figure of eight with 45° of bank",
    "Climb, then descend along the same line",
];

/// Whether nothing arrives now.
pub fn link_lost(t_s: f64) -> bool {
    (LOST_S.0..LOST_S.1).contains(&t_s)
}

/// The snapshot of this time.
pub fn snapshot(t_s: f64) -> Snapshot {
    let at_s = match t_s {
        t if t < ROUND_S => t,
        t if t < DONE_S => 8.0 + (t - 8.0).rem_euclid(ROUND_S - 8.0),
        t => ROUND_S + 2.0 + (t - DONE_S),
    };
    let mut s = script::snapshot(at_s);
    s.elapsed_s = t_s;
    s.t_s = 100.0 + t_s;
    s.sequence = (t_s / script::STEP_S).round() as u64 + 1;
    s.imu.samples = (t_s * 100.0) as u64;
    let (n, e) = (550.0 + 600.0 * sin(TAU * t_s / 300.0), 700.0 * (1.0 - cos(TAU * t_s / 190.0)));
    s.motion.lat_deg = 47.3977 + n / 111_200.0;
    s.motion.lon_deg = 8.5456 + e / 75_300.0;
    let turn = TAU * t_s / 23.0;
    s.estimate.attitude_deg.value =
        [55.0 * sin(turn), 12.0 * cos(0.7 * turn), (17.0 * t_s).rem_euclid(360.0)];
    // Warnings come and go, one, two, many; long ones too.
    for k in 0..(t_s / 60.0) as usize % 7 {
        s.warnings.push(format!(
            "warning number {k} of this minute, with words enough that it takes two lines on a small screen"
        ));
    }
    if (600.0..612.0).contains(&t_s) {
        s.phase = Phase::WaitingForGnss;
        s.waiting_for = "no fix for 12 s: 4 satellites, no 3-D solution".into();
    }
    if (300.0..330.0).contains(&t_s) {
        s.guidance.instruction =
            format!("{} Then: {0} Then: Steep turn right, 55° bank, two circles", s.guidance.instruction);
    }
    if (700.0..720.0).contains(&t_s) {
        s.guidance.instruction.clear();
        s.guidance.reason.clear();
    }
    let mode =
        if (AUTOPILOT_S.0..AUTOPILOT_S.1).contains(&t_s) { FlightMode::Mission } else { FlightMode::Pilot };
    script::settle(&mut s, mode, !(8.0..=870.0).contains(&t_s));
    s
}

/// Who flies.
pub fn vehicle(t_s: f64) -> VehicleView {
    if !(AUTOPILOT_S.0..AUTOPILOT_S.1).contains(&t_s) {
        let control = if (8.0..=870.0).contains(&t_s) { Control::Pilot } else { Control::Ground };
        return VehicleView { control, mode: "FBWA".into(), ..VehicleView::default() };
    }
    let since = t_s - AUTOPILOT_S.0;
    let k = (since / 27.0) as usize;
    let name = |k: usize| NAMES.get(k % NAMES.len()).map_or(String::new(), |n| (*n).to_owned());
    VehicleView {
        control: Control::Autopilot,
        mode: "AUTO, armed".into(),
        now: name(k),
        maneuver: k as u64 + 1,
        maneuvers: 10,
        duration_s: 27.0,
        left_s: Some(27.0 - since.rem_euclid(27.0)),
        transit_left_s: None,
        next: name(k + 1),
    }
}

/// The planned mission: ready, uploaded, on board.
pub fn mission(t_s: f64) -> MissionView {
    let (state, text) = match t_s {
        t if t < 150.0 => (MissionState::Ready, "67 items of plan.plan are ready to be uploaded before take-off".to_owned()),
        t if t < 180.0 => (MissionState::Uploading, format!("uploading, {:.0} of 67", (t - 150.0) * 2.0)),
        t if t < 190.0 => (MissionState::Unknown, "the upload failed, and the mission on the vehicle is unknown: read it back before you fly, and restore the one before from mission-backup-17.plan".to_owned()),
        _ => (MissionState::OnVehicle, "67 items uploaded, read back and compared: they agree".to_owned()),
    };
    MissionView { state, name: "plan.plan".into(), items: 67, text }
}
