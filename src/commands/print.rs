//! The result in words and columns, for people.

use crate::engine::snapshot::{Phase, Summary};
use serde_json::{Map, Value};
use std::fmt::Write;

/// The summary as text, and the comparison with the truth where the document has one.
pub fn summary(s: &Summary, document: &Map<String, Value>) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_summary(&mut out, s, document);
    out
}

fn write_summary(out: &mut String, s: &Summary, document: &Map<String, Value>) -> std::fmt::Result {
    writeln!(
        out,
        "{:.1} s, {} · {} {} samples at {:.1} Hz, {} dropped · {} fixes, {} used, {} rejected",
        s.duration_s,
        s.autopilot,
        if s.imu.message.is_empty() { "no inertial message," } else { &s.imu.message },
        s.imu.samples,
        s.imu.rate_hz,
        s.imu.dropped,
        s.gnss.fixes,
        s.gnss.used,
        s.gnss.rejected
    )?;
    if !s.waiting_for.is_empty() {
        let what = if s.phase == Phase::Running { "at the end" } else { "no estimate" };
        writeln!(out, "{what}: {}", s.waiting_for)?;
    }
    for (name, unit, e) in [
        ("attitude", "deg", &s.estimate.attitude_deg),
        ("gyro bias", "deg/h", &s.estimate.gyro_bias_deg_per_h),
        ("accelerometer bias", "mg", &s.estimate.accel_bias_mg),
    ] {
        write!(out, "{name:>20}")?;
        for (value, sigma) in e.value.iter().zip(e.sigma) {
            write!(out, "{value:>12.3} ± {sigma:<9.3}")?;
        }
        writeln!(out, "{unit}")?;
    }
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    for (k, (values, sigmas)) in g.value.iter().zip(g.sigma).enumerate() {
        write!(out, "{:>20}", if k == 0 { "g-sensitivity" } else { "" })?;
        for (value, sigma) in values.iter().zip(sigmas) {
            write!(out, "{value:>12.1} ± {sigma:<9.1}")?;
        }
        writeln!(out, "{}", if k == 0 { "deg/h/g" } else { "" })?;
    }
    for p in &s.estimate.effects {
        let name =
            if p.effect.ends_with(&p.name) { p.effect.clone() } else { format!("{} {}", p.effect, p.name) };
        writeln!(out, "{name:>20}{:>12.4} ± {:<9.4}{}", p.value, p.sigma, p.unit)?;
    }
    for direction in &s.observability.unobservable_directions {
        writeln!(out, "not observable: {}", direction.text)?;
    }
    if let Some(truth) = document.get("truth_comparison") {
        let get = |name: &str| truth.get(name).cloned().unwrap_or_default();
        writeln!(
            out,
            "against the truth from {} s on: RMS {} deg in roll, pitch, yaw after a shift of {} s",
            get("from_s"),
            get("attitude_rms_deg"),
            get("time_shift_s")
        )?;
    }
    for warning in &s.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    Ok(())
}
