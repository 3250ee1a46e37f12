//! The rows of the tables: every column's name with its unit, its meaning, and where its value comes from.

use super::table::{Cell, Put, Row};
use crate::engine::events::{Event, Topic};
use crate::engine::snapshot::{Estimate3, Phase, Snapshot};
use gaware_nav::sample::{AttitudeHint, GnssFix, ImuSample};

/// Name of the table that a single file has.
pub const STATES: &str = "states";

/// Three axes: in names, and in words.
type Axes = [(&'static str, &'static str); 3];
const BODY: Axes = [("x", "x (forward)"), ("y", "y (right)"), ("z", "z (down)")];
const NED: Axes = [("north", "north"), ("east", "east"), ("down", "down")];
const RPY: [&str; 3] = ["roll", "pitch", "yaw"];

/// A column for each axis, which stands for `{}`.
fn each(put: &mut Put<'_>, axes: &Axes, name: &str, about: &str, value: impl Fn(usize) -> f64) {
    for (k, (axis, words)) in axes.iter().enumerate() {
        put(&name.replace("{}", axis), &about.replace("{}", words), Cell::Number(value(k)));
    }
}

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
        let about = "Time since the first sample, s; runs on over restarts of the autopilot";
        put("elapsed_s", about, Cell::Number(self.elapsed_s));
        put("t_s", "Time on the autopilot's base (since boot), s", Cell::Number(self.t_s));
    }
}

impl Row for ImuSample {
    fn visit(&self, put: &mut Put<'_>) {
        let about = "Angular rate about {} as measured, rad/s";
        each(put, &BODY, "gyro_{}_rad_per_s", about, |k| self.gyro[k]);
        let about = "Specific force along {} as measured, m/s²";
        each(put, &BODY, "accel_{}_m_per_s2", about, |k| self.accel[k]);
        let about = "Temperature of the inertial unit, °C, where the log has it";
        put("temperature_degc", about, Cell::Number(self.temperature_degc.unwrap_or(f64::NAN)));
    }
}

impl Row for GnssFix {
    fn visit(&self, put: &mut Put<'_>) {
        put("lat_deg", "Latitude (WGS 84), deg", Cell::Number(self.position.lat_rad.to_degrees()));
        put("lon_deg", "Longitude (WGS 84), deg", Cell::Number(self.position.lon_rad.to_degrees()));
        put("height_m", "Height as the receiver counts it, m", Cell::Number(self.position.height_m));
        let (velocity, rows) = (self.velocity.components(), self.velocity.rows());
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let about = "Velocity {}, m/s, where the fix has it";
        each(put, &NED, "velocity_{}_m_per_s", about, |k| or_nan(velocity[..rows].get(k).copied()));
        let about = "The receiver's own 1-sigma of position {}, m";
        each(put, &NED, "position_sigma_{}_m", about, |k| or_nan(self.position_sigma_m.map(|s| s[k])));
        let (about, sigma) = ("The receiver's own 1-sigma of velocity {}, m/s", self.velocity_sigma_m_per_s);
        each(put, &NED, "velocity_sigma_{}_m_per_s", about, |k| or_nan(sigma.map(|s| s[k])));
        let (yaw, sigma) = self.yaw_rad.unwrap_or((f64::NAN, f64::NAN));
        put("yaw_deg", "Yaw of a receiver with two antennas, deg", Cell::Number(yaw.to_degrees()));
        put("yaw_sigma_deg", "Its 1-sigma, deg", Cell::Number(sigma.to_degrees()));
    }
}

impl Row for AttitudeHint {
    fn visit(&self, put: &mut Put<'_>) {
        let axes = RPY.map(|axis| (axis, axis));
        each(put, &axes, "{}_deg", "The autopilot's own {}, deg", |k| self.roll_pitch_yaw[k].to_degrees());
    }
}

impl Row for Event {
    fn visit(&self, put: &mut Put<'_>) {
        let topic = if self.topic == Topic::News { "event".to_owned() } else { word(&self.topic) };
        put("severity", "warning, notice or info", Cell::Text(&word(&self.severity)));
        let about = "What it is about: instruction, result, phase, condition, state, warning, event";
        put("topic", about, Cell::Text(&topic));
        put("text", "The event in words", Cell::Text(&self.text));
    }
}

/// Value and sigma of three axes, where there is an estimate.
fn estimate(put: &mut Put<'_>, running: bool, e: &Estimate3, names: [&str; 3], unit: &str, about: &str) {
    let given = |v: f64| Cell::Number(if running { v } else { f64::NAN });
    let words = spoken(unit);
    for ((name, value), sigma) in names.iter().zip(e.value).zip(e.sigma) {
        put(&format!("{name}_{unit}"), &format!("Estimated {about} ({name}), {words}"), given(value));
        put(&format!("{name}_sigma_{unit}"), &format!("Its 1-sigma, {words}"), given(sigma));
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
        let (running, e) = (self.phase == Phase::Running, &self.estimate);
        let about = "waiting_for_imu, waiting_for_gnss, aligning, searching_heading or running; estimates are empty before running";
        put("phase", about, Cell::Text(&word(&self.phase)));
        put("stationary", "Whether the vehicle is recognised as stationary", Cell::Flag(self.stationary));
        motion(self, running, put);
        estimate(put, running, &e.attitude_deg, RPY, "deg", "attitude");
        let names = ["bg_x", "bg_y", "bg_z"];
        estimate(put, running, &e.gyro_bias_deg_per_h, names, "deg_per_h", "gyro bias");
        let names = ["ba_x", "ba_y", "ba_z"];
        estimate(put, running, &e.accel_bias_mg, names, "mg", "accelerometer bias");
        let g = &e.g_sensitivity_deg_per_h_per_g;
        for (row, (value, sigma)) in g.value.iter().zip(g.sigma).enumerate() {
            let names = [1, 2, 3].map(|column| format!("g{}{column}", row + 1));
            let row = Estimate3 { value: *value, sigma };
            let about = "g-sensitivity, row = gyro axis, column = axis of specific force";
            estimate(put, running, &row, names.each_ref().map(String::as_str), "deg_per_h_per_g", about);
        }
        innovations(self, running, put);
        for p in &e.effects {
            let whole = p.effect.ends_with(&p.name);
            let name = if whole { p.effect.clone() } else { format!("{}_{}", p.effect, p.name) };
            let (unit, about) =
                (in_name(&p.unit), format!("Estimated {} of {}, {}", p.name, p.effect, p.unit));
            put(&format!("{name}_{unit}"), &about, Cell::Number(p.value));
            put(&format!("{name}_sigma_{unit}"), &format!("Its 1-sigma, {}", p.unit), Cell::Number(p.sigma));
        }
    }
}

fn motion(s: &Snapshot, running: bool, put: &mut Put<'_>) {
    let (m, given) = (&s.motion, |v: f64| if running { v } else { f64::NAN });
    put("lat_deg", "Estimated latitude (WGS 84), deg", Cell::Number(given(m.lat_deg)));
    put("lon_deg", "Estimated longitude (WGS 84), deg", Cell::Number(given(m.lon_deg)));
    put("height_m", "Estimated height as the fixes count it, m", Cell::Number(given(m.height_m)));
    each(put, &NED, "position_sigma_{}_m", "1-sigma of position {}, m", |k| given(m.position_sigma_m[k]));
    let (about, v) = ("Estimated velocity {}, m/s", m.velocity_ned_m_per_s);
    each(put, &NED, "velocity_{}_m_per_s", about, |k| given(v[k]));
    let about = "Specific force along {}, bias removed, g";
    each(put, &BODY, "specific_force_{}_g", about, |k| given(m.specific_force_g[k]));
    let about = "Angular rate about {}, bias and G removed, deg/s";
    each(put, &BODY, "rate_{}_deg_per_s", about, |k| given(m.rate_deg_per_s[k]));
}

fn innovations(s: &Snapshot, running: bool, put: &mut Put<'_>) {
    let given = |v: f64| if running { v } else { f64::NAN };
    let all = s.consistency.last_normalised_innovation;
    for (first, of) in [(0, "position"), (3, "velocity")] {
        let about = format!(
            "Normalised innovation of the last fix, {of} {{}}, in its own sigmas; 0 where the fix has none"
        );
        each(put, &NED, &format!("innovation_{of}_{{}}_sigma"), &about, |k| given(all[first + k]));
    }
    let about = "Mean normalised innovation squared per degree of freedom so far; 1 is right";
    put("nis_mean_per_dof", about, Cell::Number(given(s.consistency.nis_mean_per_dof)));
    put("fixes_used", "Fixes used so far", Cell::Number(s.gnss.used as f64));
    put("fixes_rejected", "Fixes rejected so far", Cell::Number(s.gnss.rejected as f64));
}

/// The word of an enumeration, as JSON has it.
fn word(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
