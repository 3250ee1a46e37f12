//! The result in words and columns, for people.

use crate::advice::start;
use crate::engine::snapshot::{Phase, Summary};
use crate::figures::two_figures;
use crate::pipeline::truth_comparison;
use serde_json::{Map, Value};
use std::fmt::Write;

/// The summary as text, and the comparison with the truth where the document has one.
pub fn summary(s: &Summary, document: &Map<String, Value>) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_summary(&mut out, s, document);
    out
}

/// Values with their sigmas for three axes, 80 columns wide.
fn row<'a>(
    out: &mut String,
    name: &str,
    values: impl Iterator<Item = (&'a f64, f64)>,
    digits: usize,
) -> std::fmt::Result {
    write!(out, "{name:>22}")?;
    for (value, sigma) in values {
        write!(out, " {value:>9.digits$} ± {sigma:<6.digits$}")?;
    }
    writeln!(out)
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
    for text in start::texts(document) {
        writeln!(out, "first value: {text}")?;
    }
    for (name, digits, e) in [
        ("attitude, deg", 3, &s.estimate.attitude_deg),
        ("gyro bias, deg/h", 2, &s.estimate.gyro_bias_deg_per_h),
        ("accelerometer bias, mg", 2, &s.estimate.accel_bias_mg),
    ] {
        row(out, name, e.value.iter().zip(e.sigma), digits)?;
    }
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    for (k, (values, sigmas)) in g.value.iter().zip(g.sigma).enumerate() {
        row(out, if k == 0 { "g-sensitivity, deg/h/g" } else { "" }, values.iter().zip(sigmas), 1)?;
    }
    if !s.turn.text.is_empty() {
        writeln!(out, "{}", s.turn.text)?;
    }
    for p in &s.estimate.effects {
        let name =
            if p.effect.ends_with(&p.name) { p.effect.clone() } else { format!("{} {}", p.effect, p.name) };
        let digits = if p.sigma > 0.0 { two_figures(p.sigma) } else { 4 };
        writeln!(out, "{name:>30} {:>12.digits$} ± {:<10.digits$} {}", p.value, p.sigma, p.unit)?;
    }
    for direction in &s.observability.unobservable_directions {
        writeln!(out, "not observable: {}", direction.text)?;
    }
    if let Some(truth) = document.get("truth_comparison") {
        let get = |name: &str| truth.get(name).and_then(Value::as_f64).unwrap_or_default();
        if let Some([roll, pitch, yaw]) = truth_comparison::figures(truth, "attitude_rms_deg") {
            writeln!(
                out,
                "against the truth from {:.0} s on: RMS {roll:.3}, {pitch:.3}, {yaw:.3} deg in roll, pitch, yaw after a shift of {:.1} ms",
                get("from_s"),
                1e3 * get("time_shift_s")
            )?;
        }
        if let Some(shares) = truth_comparison::shares(truth) {
            writeln!(out, "{shares}")?;
        }
    }
    for warning in &s.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::snapshot::{Estimate3, EstimateMatrix, ParameterEstimate};

    #[test]
    fn figures_fit_a_terminal_of_80_columns() {
        let three = Estimate3 { value: [-1234.567; 3], sigma: [500.123; 3] };
        let mut s = Summary { phase: Phase::Running, ..Summary::default() };
        s.estimate.attitude_deg = Estimate3 { value: [-179.999; 3], sigma: [0.123; 3] };
        (s.estimate.gyro_bias_deg_per_h, s.estimate.accel_bias_mg) = (three, three);
        s.estimate.g_sensitivity_deg_per_h_per_g =
            EstimateMatrix { value: [[-4321.0; 3]; 3], sigma: [[360.0; 3]; 3] };
        let wide = ParameterEstimate {
            effect: "gyro_misalignment".to_owned(),
            name: "mg_xy".to_owned(),
            unit: "deg/h/g2".to_owned(),
            value: -12345.6789,
            sigma: 2999.9987,
        };
        let small = ParameterEstimate {
            effect: "gps_smoothing".to_owned(),
            name: "skew".to_owned(),
            unit: "s³".to_owned(),
            value: 1.234e-4,
            sigma: 6.1e-6,
        };
        s.estimate.effects = vec![wide, small];
        let text = summary(&s, &Map::new());
        let figures: Vec<&str> = text.lines().filter(|l| l.contains('±')).collect();
        assert_eq!(figures.len(), 8, "{text}");
        for line in figures {
            assert!(line.chars().count() <= 80, "{} columns: {line}", line.chars().count());
        }
        assert!(text.contains("-12346 ± 3000       deg/h/g2"), "{text}");
        assert!(text.contains("0.0001234 ± 0.0000061  s³"), "{text}");
    }
}
