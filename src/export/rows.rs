//! The rows of the tables: every column's name with its unit, its meaning, and where its value comes from.

use super::table::{Cell, Put, Row};
use crate::engine::events::{Event, Topic};
use crate::engine::snapshot::{Estimate3, Phase, Snapshot};
use gaware_nav::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample};

/// Name of the table that a single file has.
pub const STATES: &str = "states";

const BODY: [(&str, &str); 3] = [("x", "forward"), ("y", "right"), ("z", "down")];
const NED: [&str; 3] = ["north", "east", "down"];
const RPY: [&str; 3] = ["roll", "pitch", "yaw"];

/// Which log, and when.
pub struct Origin<'a> {
    /// Name of the log.
    pub log: &'a str,
    /// Seconds since the first sample of the log; goes on after a restart of the autopilot.
    pub elapsed_s: f64,
    /// Time on the autopilot's base, s; NaN where the row has none.
    pub t_s: f64,
}

impl Row for Origin<'_> {
    fn visit(&self, put: &mut Put<'_>) {
        put("log", "Name of the log", Cell::Text(self.log));
        put(
            "elapsed_s",
            "Time since the first sample, s; runs on over restarts of the autopilot",
            Cell::Number(self.elapsed_s),
        );
        put("t_s", "Time on the autopilot's base (since boot), s", Cell::Number(self.t_s));
    }
}

impl Row for ImuSample {
    fn visit(&self, put: &mut Put<'_>) {
        for (k, (axis, about)) in BODY.iter().enumerate() {
            let name = ["gyro_x_rad_per_s", "gyro_y_rad_per_s", "gyro_z_rad_per_s"][k];
            put(
                name,
                &format!("Angular rate about {axis} ({about}) as measured, rad/s"),
                Cell::Number(self.gyro[k]),
            );
        }
        for (k, (axis, about)) in BODY.iter().enumerate() {
            let name = ["accel_x_m_per_s2", "accel_y_m_per_s2", "accel_z_m_per_s2"][k];
            put(
                name,
                &format!("Specific force along {axis} ({about}) as measured, m/s²"),
                Cell::Number(self.accel[k]),
            );
        }
        put(
            "temperature_degc",
            "Temperature of the inertial unit, °C, where the log has it",
            Cell::Number(self.temperature_degc.unwrap_or(f64::NAN)),
        );
    }
}

impl Row for GnssFix {
    fn visit(&self, put: &mut Put<'_>) {
        put("lat_deg", "Latitude (WGS 84), deg", Cell::Number(self.position.lat_rad.to_degrees()));
        put("lon_deg", "Longitude (WGS 84), deg", Cell::Number(self.position.lon_rad.to_degrees()));
        put("height_m", "Height as the receiver counts it, m", Cell::Number(self.position.height_m));
        let velocity: &[f64] = match &self.velocity {
            FixVelocity::None => &[],
            FixVelocity::Horizontal(v) => v,
            FixVelocity::Full(v) => v,
        };
        let of = |values: Option<&[f64]>, k: usize| {
            Cell::Number(values.and_then(|v| v.get(k)).copied().unwrap_or(f64::NAN))
        };
        for (k, axis) in NED.iter().enumerate() {
            put(
                &format!("velocity_{axis}_m_per_s"),
                &format!("Velocity {axis}, m/s, where the fix has it"),
                of(Some(velocity), k),
            );
        }
        for (k, axis) in NED.iter().enumerate() {
            let sigma = self.position_sigma_m.as_ref().map(<[f64; 3]>::as_slice);
            put(
                &format!("position_sigma_{axis}_m"),
                &format!("The receiver's own 1-sigma of position {axis}, m"),
                of(sigma, k),
            );
        }
        for (k, axis) in NED.iter().enumerate() {
            let sigma = self.velocity_sigma_m_per_s.as_ref().map(<[f64; 3]>::as_slice);
            put(
                &format!("velocity_sigma_{axis}_m_per_s"),
                &format!("The receiver's own 1-sigma of velocity {axis}, m/s"),
                of(sigma, k),
            );
        }
        let (yaw, sigma) = self.yaw_rad.unwrap_or((f64::NAN, f64::NAN));
        put("yaw_deg", "Yaw of a receiver with two antennas, deg", Cell::Number(yaw.to_degrees()));
        put("yaw_sigma_deg", "Its 1-sigma, deg", Cell::Number(sigma.to_degrees()));
    }
}

impl Row for AttitudeHint {
    fn visit(&self, put: &mut Put<'_>) {
        for (name, value) in RPY.iter().zip(self.roll_pitch_yaw) {
            put(
                &format!("{name}_deg"),
                &format!("The autopilot's own {name}, deg"),
                Cell::Number(value.to_degrees()),
            );
        }
    }
}

impl Row for Event {
    fn visit(&self, put: &mut Put<'_>) {
        let topic = if self.topic == Topic::News { "event".to_owned() } else { word(&self.topic) };
        put("severity", "warning, notice or info", Cell::Text(&word(&self.severity)));
        put(
            "topic",
            "What it is about: instruction, result, phase, condition, state, warning, event",
            Cell::Text(&topic),
        );
        put("text", "The event in words", Cell::Text(&self.text));
    }
}

/// Value and sigma of three axes, where there is an estimate.
fn estimate(put: &mut Put<'_>, running: bool, e: &Estimate3, names: [&str; 3], unit: &str, about: &str) {
    let given = |v: f64| Cell::Number(if running { v } else { f64::NAN });
    for ((name, value), sigma) in names.iter().zip(e.value).zip(e.sigma) {
        put(
            &format!("{name}_{unit}"),
            &format!("Estimated {about} ({name}), {}", spoken(unit)),
            given(value),
        );
        put(&format!("{name}_sigma_{unit}"), &format!("Its 1-sigma, {}", spoken(unit)), given(sigma));
    }
}

/// `deg_per_h_per_g` → `deg/h/g`.
fn spoken(unit: &str) -> String {
    unit.replace("_per_", "/")
}

/// A unit in a name.
fn in_name(unit: &str) -> String {
    unit.replace('/', "_per_").replace('²', "2").replace('°', "deg").replace('√', "sqrt_").to_lowercase()
}

impl Row for Snapshot {
    fn visit(&self, put: &mut Put<'_>) {
        let running = self.phase == Phase::Running;
        put(
            "phase",
            "waiting_for_imu, waiting_for_gnss, aligning, searching_heading or running; estimates are empty before running",
            Cell::Text(&word(&self.phase)),
        );
        put("stationary", "Whether the vehicle is recognised as stationary", Cell::Flag(self.stationary));
        motion(self, running, put);
        estimate(put, running, &self.estimate.attitude_deg, RPY, "deg", "attitude");
        estimate(
            put,
            running,
            &self.estimate.gyro_bias_deg_per_h,
            ["bg_x", "bg_y", "bg_z"],
            "deg_per_h",
            "gyro bias",
        );
        estimate(
            put,
            running,
            &self.estimate.accel_bias_mg,
            ["ba_x", "ba_y", "ba_z"],
            "mg",
            "accelerometer bias",
        );
        let g = &self.estimate.g_sensitivity_deg_per_h_per_g;
        for (row, (value, sigma)) in g.value.iter().zip(g.sigma).enumerate() {
            let names = [1, 2, 3].map(|column| format!("g{}{column}", row + 1));
            let row = Estimate3 { value: *value, sigma };
            estimate(
                put,
                running,
                &row,
                [&names[0], &names[1], &names[2]],
                "deg_per_h_per_g",
                "g-sensitivity, row = gyro axis, column = axis of specific force",
            );
        }
        innovations(self, running, put);
        for p in &self.estimate.effects {
            let effect = if p.effect.ends_with(&p.name) {
                p.effect.clone()
            } else {
                format!("{}_{}", p.effect, p.name)
            };
            let (name, unit) = (effect, in_name(&p.unit));
            put(
                &format!("{name}_{unit}"),
                &format!("Estimated {} of {}, {}", p.name, p.effect, p.unit),
                Cell::Number(p.value),
            );
            put(&format!("{name}_sigma_{unit}"), &format!("Its 1-sigma, {}", p.unit), Cell::Number(p.sigma));
        }
    }
}

fn motion(s: &Snapshot, running: bool, put: &mut Put<'_>) {
    let m = &s.motion;
    let given = |v: f64| Cell::Number(if running { v } else { f64::NAN });
    put("lat_deg", "Estimated latitude (WGS 84), deg", given(m.lat_deg));
    put("lon_deg", "Estimated longitude (WGS 84), deg", given(m.lon_deg));
    put("height_m", "Estimated height as the fixes count it, m", given(m.height_m));
    for (axis, sigma) in NED.iter().zip(m.position_sigma_m) {
        put(&format!("position_sigma_{axis}_m"), &format!("1-sigma of position {axis}, m"), given(sigma));
    }
    for (axis, v) in NED.iter().zip(m.velocity_ned_m_per_s) {
        put(&format!("velocity_{axis}_m_per_s"), &format!("Estimated velocity {axis}, m/s"), given(v));
    }
    for ((axis, about), f) in BODY.iter().zip(m.specific_force_g) {
        put(
            &format!("specific_force_{axis}_g"),
            &format!("Specific force along {axis} ({about}), bias removed, g"),
            given(f),
        );
    }
    for ((axis, about), w) in BODY.iter().zip(m.rate_deg_per_s) {
        put(
            &format!("rate_{axis}_deg_per_s"),
            &format!("Angular rate about {axis} ({about}), bias and G removed, deg/s"),
            given(w),
        );
    }
}

fn innovations(s: &Snapshot, running: bool, put: &mut Put<'_>) {
    let given = |v: f64| Cell::Number(if running { v } else { f64::NAN });
    let all = s.consistency.last_normalised_innovation;
    for (k, of) in ["position", "velocity"].iter().enumerate() {
        for (axis, value) in NED.iter().zip(all.iter().skip(3 * k)) {
            put(
                &format!("innovation_{of}_{axis}_sigma"),
                &format!(
                    "Normalised innovation of the last fix, {of} {axis}, in its own sigmas; 0 where the fix has none"
                ),
                given(*value),
            );
        }
    }
    put(
        "nis_mean_per_dof",
        "Mean normalised innovation squared per degree of freedom so far; 1 is right",
        given(s.consistency.nis_mean_per_dof),
    );
    put("fixes_used", "Fixes used so far", Cell::Number(s.gnss.used as f64));
    put("fixes_rejected", "Fixes rejected so far", Cell::Number(s.gnss.rejected as f64));
}

/// The word of an enumeration, as JSON has it.
fn word(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
