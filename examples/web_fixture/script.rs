//! A scripted flight of two minutes: every screen's fields move, the same way each time. Not a simulation; the
//! figures only have to be plausible. Used to look at the screens and to test them.

use gaware::engine::situation::{FlightMode, FlightReport, Inputs, describe};
use gaware::engine::snapshot::{
    Condition, Conditions, Consistency, Direction, Estimate3, GnssStatus, Guidance, ImuStatus, Motion, Phase,
    Snapshot, StateStatus, Status,
};
use gaware::sinks::status::RouteView;
use gaware_nav::math::{cos, exp, sin};
use gaware_nav::observability::words::VehicleKind;
use std::f64::consts::TAU;

/// Seconds between two snapshots.
pub const STEP_S: f64 = 0.1;
/// Prior sigma of each element of G, deg/h/g.
const PRIOR: f64 = 360.0;
/// Target of each element of G, deg/h/g.
const TARGET: f64 = 40.0;
/// When the maneuvers for columns x, z and y begin and end, s.
const LEGS: [(f64, f64); 3] = [(8.0, 40.0), (40.0, 72.0), (72.0, 104.0)];
/// Which column of G each maneuver is for.
const COLUMN: [usize; 3] = [0, 2, 1];
const TRUTH: [[f64; 3]; 3] = [[36.2, -11.8, 52.4], [-21.5, 44.0, 8.3], [5.1, -17.6, 61.0]];

/// Home, a planned path and a fence around where the flight begins.
pub fn route() -> RouteView {
    let at = |n: f64, e: f64| [47.3977 + n / 111_200.0, 8.5456 + e / 75_300.0];
    let ring = [(-400.0, -300.0), (-400.0, 1900.0), (1700.0, 1900.0), (1700.0, -300.0)];
    let path = (0..60).map(|k| {
        let a = f64::from(k) * 0.21;
        at(550.0 + 420.0 * sin(a), 700.0 + 500.0 * cos(0.5 * a))
    });
    RouteView {
        home: Some(at(0.0, 0.0)),
        path: path.collect(),
        fence: vec![ring.iter().map(|(n, e)| at(*n, *e)).collect()],
    }
}

/// The snapshot `t_s` seconds after the first sample.
pub fn snapshot(t_s: f64) -> Snapshot {
    let phase = phase(t_s);
    let mut s = Snapshot {
        schema: "gaware.snapshot/1".into(),
        sequence: (t_s / STEP_S).round() as u64 + 1,
        t_s: 100.0 + t_s,
        elapsed_s: t_s,
        autopilot: "ardupilot".into(),
        phase,
        waiting_for: waiting_for(phase).into(),
        imu: ImuStatus {
            message: "RAW_IMU".into(),
            samples: (t_s * 100.0) as u64,
            rate_hz: 99.6 + 0.4 * wave(t_s, 3.0),
            dropped: if t_s > 50.0 { 12 } else { 0 },
            ..ImuStatus::default()
        },
        gnss: GnssStatus {
            fixes: (t_s * 5.0) as u64,
            used: (t_s * 4.9) as u64,
            rejected: (t_s * 0.1) as u64,
            rate_hz: if phase == Phase::WaitingForImu { 0.0 } else { 5.0 },
            ..GnssStatus::default()
        },
        motion: motion(t_s),
        guidance: guidance(t_s),
        consistency: Consistency {
            nis_mean_per_dof: 1.03 + 0.12 * wave(t_s, 17.0),
            last_normalised_innovation: [0, 1, 2, 3, 4, 5].map(|i| noise(t_s, i)),
        },
        ..Snapshot::default()
    };
    estimates(t_s, &mut s);
    observability(t_s, &mut s);
    if t_s > 50.0 {
        s.warnings
            .push("RAW_IMU arrives at 99 Hz instead of 100: another station asks for rates as well".into());
    }
    settle(&mut s, FlightMode::Pilot, t_s < 8.0);
    s
}

/// Decides what may be said, as the engine does.
pub fn settle(s: &mut Snapshot, mode: FlightMode, on_ground: bool) {
    let report = FlightReport {
        has_heartbeat: true,
        armed: !on_ground,
        on_ground,
        mode,
        mode_name: if mode == FlightMode::Pilot { "FBWA" } else { "AUTO" }.to_owned(),
        kind: Some(VehicleKind::FixedWing),
        ..FlightReport::default()
    };
    let states = &s.observability.states;
    let open: Vec<&str> =
        states.iter().filter(|x| x.status != Status::Observable).map(|x| x.name.as_str()).collect();
    let names = open.join(", ");
    s.situation = describe(&Inputs {
        phase: s.phase,
        waiting_for: &s.waiting_for,
        fix_age_s: Some(0.2),
        rates_hz: [99.0, 5.0],
        airframe: Some(VehicleKind::FixedWing),
        vehicle: VehicleKind::FixedWing,
        done: s.guidance.done,
        open: (&names, open.len(), states.len()),
        instruction: [&s.guidance.instruction, &s.guidance.reason],
        flight: Some(&report),
        ..Inputs::default()
    });
    if !s.situation.kind.allows_maneuver() {
        s.guidance.instruction.clear();
    }
}

fn wave(t_s: f64, period_s: f64) -> f64 {
    sin(TAU * t_s / period_s)
}

/// Something like white noise, the same for the same time and channel.
fn noise(t_s: f64, channel: u32) -> f64 {
    let mut x = ((t_s / STEP_S).round() as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ u64::from(channel + 1) << 40;
    let mut sum = 0.0;
    for _ in 0..4 {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        sum += (x >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
    }
    sum * 1.7
}

fn phase(t_s: f64) -> Phase {
    match t_s {
        t if t < 1.5 => Phase::WaitingForImu,
        t if t < 3.0 => Phase::WaitingForGnss,
        t if t < 5.0 => Phase::Aligning,
        t if t < 8.0 => Phase::SearchingHeading,
        _ => Phase::Running,
    }
}

fn waiting_for(phase: Phase) -> &'static str {
    match phase {
        Phase::WaitingForImu => "no RAW_IMU yet; asked the autopilot for 100 Hz",
        Phase::WaitingForGnss => "no fix yet: 7 satellites, no 3-D solution",
        Phase::Aligning => "levelling: keep still for two more seconds",
        Phase::SearchingHeading => "heading not known: fly straight and accelerate",
        Phase::Running => "",
    }
}

/// How far the maneuver of leg `i` has come, 0 to 1.
fn done(t_s: f64, i: usize) -> f64 {
    LEGS.get(i).map_or(0.0, |(start, end)| ((t_s - start) / (end - start)).clamp(0.0, 1.0))
}

fn motion(t_s: f64) -> Motion {
    let speed = 24.0 + 5.0 * wave(t_s, 16.0) * f64::from(u8::from(t_s < 40.0));
    let turning = (40.0..72.0).contains(&t_s);
    let heading = if turning { 0.6 + TAU * (t_s - 40.0) / 16.0 } else { 0.6 };
    let (mut north, mut east) = (0.0, 0.0);
    for step in 0..(t_s / STEP_S) as u32 {
        let at = f64::from(step) * STEP_S;
        let h = if (40.0..72.0).contains(&at) { 0.6 + TAU * (at - 40.0) / 16.0 } else { 0.6 };
        north += 24.0 * cos(h) * STEP_S;
        east += 24.0 * sin(h) * STEP_S;
    }
    let n = |c| 0.035 * noise(t_s, c);
    let f = match t_s {
        t if t < 8.0 => [0.0, 0.0, -1.0],
        t if t < 40.0 => [0.32 * wave(t, 16.0), 0.02, -1.0],
        t if t < 72.0 => [0.03, 0.03, -1.74],
        t if t < 104.0 => [0.02, 0.22 * wave(t, 8.0), -1.0],
        _ => [0.01, 0.0, -1.0],
    };
    Motion {
        lat_deg: 47.3977 + north / 111_200.0,
        lon_deg: 8.5456 + east / 75_300.0,
        height_m: 620.0 + 12.0 * wave(t_s, 41.0),
        velocity_ned_m_per_s: [speed * cos(heading), speed * sin(heading), -0.4],
        specific_force_g: [f[0] + n(10), f[1] + n(11), f[2] + n(12)],
        rate_deg_per_s: [0.4, if turning { 12.0 } else { 0.0 }, if turning { 18.0 } else { 0.2 }],
        position_sigma_m: [0.8, 0.8, 1.4],
    }
}

fn guidance(t_s: f64) -> Guidance {
    let (instruction, reason, last, i) = match t_s {
        t if t < 8.0 => ("", "", "", 9),
        t if t < 40.0 => (
            "Straight and level, throttle full to idle and back, twice",
            "Changes the forward acceleration: separates g11, g21 and g31 from the gyro biases.",
            "",
            0,
        ),
        t if t < 72.0 => (
            "Steep turn right, 55° bank, two circles",
            "Loads the vertical axis to 1.7 g: separates column z of G from bg_z.",
            "The throttle steps brought column x from 360 to 28 deg/h/g.",
            1,
        ),
        t if t < 104.0 => (
            "Wings level, full rudder left, then right, twice",
            "Column y is unobservable in coordinated flight: sideslip makes g12, g22 and g32 observable.",
            "The steep turn brought column z from 360 to 24 deg/h/g.",
            2,
        ),
        _ => ("", "", "Sideslip brought column y from 360 to 33 deg/h/g.", 9),
    };
    Guidance {
        instruction: instruction.into(),
        reason: reason.into(),
        progress: done(t_s, i),
        last_result: last.into(),
        done: t_s >= 104.0,
    }
}

/// Sigma of column `c` of G, deg/h/g.
fn sigma(t_s: f64, c: usize) -> f64 {
    let leg = COLUMN.iter().position(|x| *x == c).unwrap_or(0);
    let floor = [28.0, 24.0, 33.0].get(leg).copied().unwrap_or(30.0);
    let early = 1.0 - 0.15 * (t_s / 120.0).min(1.0);
    floor + (PRIOR - floor) * early * exp(-5.5 * done(t_s, leg))
}

fn estimates(t_s: f64, s: &mut Snapshot) {
    let e = &mut s.estimate;
    e.attitude_deg = Estimate3 {
        value: [if (40.0..72.0).contains(&t_s) { 54.2 } else { 1.3 }, 3.1, 34.4],
        sigma: [0.21, 0.19, 0.8],
    };
    e.gyro_bias_deg_per_h = Estimate3 { value: [312.0, -128.0, 44.0], sigma: [21.0, 20.0, 33.0] };
    e.accel_bias_mg = Estimate3 { value: [3.1, -8.2, 12.5], sigma: [1.2, 1.3, 0.8] };
    let g = &mut e.g_sensitivity_deg_per_h_per_g;
    for (row, truth) in TRUTH.iter().enumerate() {
        for (column, truth) in truth.iter().enumerate() {
            let sd = sigma(t_s, column) * (1.0 + 0.07 * row as f64);
            let known = 1.0 - (sd / PRIOR).min(1.0);
            g.sigma[row][column] = sd;
            g.value[row][column] = truth * known + 0.3 * sd * wave(t_s + 7.0 * row as f64, 37.0) * known;
        }
    }
}

fn status(ratio: f64, sigma: f64, target: f64) -> Status {
    match ratio {
        _ if sigma <= target => Status::Observable,
        r if r > 0.9 => Status::Unobservable,
        r if r > 0.4 => Status::Weak,
        _ => Status::Converging,
    }
}

fn observability(t_s: f64, s: &mut Snapshot) {
    let condition = |progress: f64, missing: &str| Condition {
        met: progress >= 1.0,
        progress,
        missing: if progress >= 1.0 { String::new() } else { missing.to_owned() },
    };
    s.observability.conditions = Conditions {
        a: condition(
            (0.5 * done(t_s, 0) + done(t_s, 1)).min(1.0),
            "a second direction of specific force: turn or pull up",
        ),
        b: condition(
            (done(t_s, 0) + done(t_s, 1) + done(t_s, 2)) / 3.0,
            "specific force y does not change yet: sideslip",
        ),
        c: condition(
            (done(t_s, 0) + done(t_s, 1) + done(t_s, 2)) / 3.0,
            "a third independent change of specific force",
        ),
    };
    let mut states = Vec::new();
    for (row, sigmas) in s.estimate.g_sensitivity_deg_per_h_per_g.sigma.iter().enumerate() {
        for (column, sd) in sigmas.iter().enumerate() {
            states.push(StateStatus {
                name: format!("g{}{}", row + 1, column + 1),
                status: status(sd / PRIOR, *sd, TARGET),
                sigma_ratio: sd / PRIOR,
                sigma: *sd,
                target: TARGET,
                unit: "deg/h/g".into(),
            });
        }
    }
    let settled = (t_s / 60.0).min(1.0);
    for (prefix, prior, end, target, unit) in
        [("bg", 1800.0, 18.0, 60.0, "deg/h"), ("ba", 20.0, 1.1, 2.0, "mg"), ("att", 5.0, 0.2, 0.5, "deg")]
    {
        for (axis, slow) in [("x", 1.0), ("y", 1.05), ("z", 1.6)] {
            let sd = end * slow + (prior - end) * exp(-6.0 * settled);
            states.push(StateStatus {
                name: format!("{prefix}_{axis}"),
                status: status(sd / prior, sd, target),
                sigma_ratio: sd / prior,
                sigma: sd,
                target,
                unit: unit.into(),
            });
        }
    }
    s.observability.states = states;
    if (8.0..72.0).contains(&t_s) {
        s.observability.unobservable_directions.push(Direction {
            states: [("g33".to_owned(), 0.7), ("bg_z".to_owned(), -0.7)].into(),
            text: "g33 and bg_z only as a sum: pull up, or bank beyond 45°".into(),
        });
    }
    if (8.0..90.0).contains(&t_s) {
        s.observability.unobservable_directions.push(Direction {
            states: [("g22".to_owned(), 1.0)].into(),
            text: "g12, g22, g32 not at all: needs sideslip".into(),
        });
        s.observability.disagreement =
            "Condition (a) is stricter than the covariance: the turn was too short for a segment of constant attitude.".into();
    }
}
