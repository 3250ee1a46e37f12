//! From the value of an effect to the value of a parameter. Pure; the order of the corrections is the autopilot's own (see
//! [`super::table`]): temperature, offset, factor, rotation.

use super::on_board::OnBoard;
use super::table::{Mapping, Rule};
use gaware_mission::item::Autopilot;
use gaware_nav::math::hypot;
use schemars::JsonSchema;
use serde::Serialize;

/// Delay of a second-order Butterworth low-pass at low frequency, s: √2/(2π) over its cut-off frequency.
pub(super) const fn low_pass_delay_s(cut_off_hz: f64) -> f64 {
    std::f64::consts::SQRT_2 / std::f64::consts::TAU / cut_off_hz
}
/// ArduPilot's low-pass of the accelerometers, Hz.
const LOW_PASS: &str = "INS_ACCEL_FILTER";
/// Delay of the samples at the usual cut-off of 20 Hz, s: the uncertainty where the cut-off is not known.
const USUAL_DELAY_S: f64 = low_pass_delay_s(20.0);

/// How a parameter is to change, where its value on board is not known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "operation", content = "value")]
pub enum Change {
    /// Set to this.
    Set(f64),
    /// Add this to the value on board.
    Add(f64),
    /// Multiply the value on board by this.
    Multiply(f64),
    /// Set to the place of the inertial unit plus this, m.
    UnitPlus(f64),
}

/// What a rule gives for one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived {
    /// How the parameter is to change.
    pub change: Change,
    /// The new value; `None` where it needs values that the log lacks.
    pub value: Option<f64>,
    /// 1-sigma of the new value, or of the change where that is not known.
    pub sigma: f64,
    /// Parameters that the value depends on and the log lacks.
    pub needs: Vec<&'static str>,
    /// What else is to be said.
    pub note: Option<String>,
}

/// Applies a rule to parameter `k` of an effect with this value and sigma, SI.
pub fn derive(mapping: &Mapping, k: usize, value: f64, sigma: f64, on_board: &OnBoard) -> Derived {
    let name = mapping.parameters.get(k).copied().unwrap_or_default();
    match mapping.rule {
        Rule::Delay => delay(mapping.autopilot, value, sigma, on_board),
        Rule::Antenna { unit } => {
            let place = unit.get(k).copied().unwrap_or_default();
            let value_on = |unit: f64| (unit + value, sigma);
            combined(Change::UnitPlus(value), sigma, on_board, [Some(place), None], |[unit, _]| {
                value_on(unit)
            })
        }
        Rule::Factor => {
            let factor = 1.0 / (1.0 + value);
            let spread = sigma * factor * factor;
            combined(Change::Multiply(factor), spread, on_board, [Some(name), None], |[old, _]| {
                (old * factor, old.abs() * spread)
            })
        }
        Rule::Offset { factor } => scaled(name, k, factor, (value, sigma), on_board),
        Rule::Temperature { scale, factor, .. } => {
            scaled(name, k, factor, (value * scale, sigma * scale), on_board)
        }
    }
}

/// What is subtracted before a factor: `old + v / factor`.
fn scaled(
    name: &'static str,
    k: usize,
    factor: Option<[&'static str; 3]>,
    (value, sigma): (f64, f64),
    on_board: &OnBoard,
) -> Derived {
    let factor = factor.and_then(|names| names.get(k).copied());
    combined(Change::Add(value), sigma, on_board, [Some(name), factor], |[old, factor]| {
        (old + value / factor, sigma / factor.abs())
    })
}

/// The new value where the log holds what it depends on; a factor that no parameter stands for is 1.
fn combined(
    change: Change,
    sigma: f64,
    on_board: &OnBoard,
    names: [Option<&'static str>; 2],
    new: impl Fn([f64; 2]) -> (f64, f64),
) -> Derived {
    let held = names.map(|name| name.map_or(Some(1.0), |name| on_board.get(name)));
    let needs = names.iter().zip(&held).filter(|(_, v)| v.is_none()).filter_map(|(n, _)| *n).collect();
    match held {
        [Some(a), Some(b)] if b != 0.0 => {
            let (value, sigma) = new([a, b]);
            Derived { change, value: Some(value), sigma, needs, note: None }
        }
        _ => Derived { change, value: None, sigma, needs, note: None },
    }
}

/// ArduPilot's filter integrates samples before the low-pass, the log holds them behind it: seen from the log a fix is less late by
/// the delay of the low-pass (`AP_InertialSensor/AP_InertialSensor_Backend.cpp:251,328`).
fn delay(autopilot: Autopilot, latency_s: f64, sigma_s: f64, on_board: &OnBoard) -> Derived {
    let (samples_s, sigma_s, note) = match (autopilot, on_board.get(LOW_PASS).filter(|hz| *hz > 0.0)) {
        (Autopilot::Px4, _) => (0.0, sigma_s, None),
        (Autopilot::ArduPilot, _) if on_board.unfiltered => (0.0, sigma_s, None),
        (Autopilot::ArduPilot, Some(hz)) => {
            let samples_s = low_pass_delay_s(hz);
            let note = format!(
                "{:.1} ms of it are the delay of the logged samples ({LOW_PASS} {hz} Hz)",
                samples_s * 1e3
            );
            (samples_s, sigma_s, Some(note))
        }
        (Autopilot::ArduPilot, None) => {
            let note = format!(
                "{LOW_PASS} is not in the log: the delay of the logged samples, {:.0} ms at 20 Hz, is not added and is part of the sigma",
                USUAL_DELAY_S * 1e3
            );
            (0.0, hypot(sigma_s, USUAL_DELAY_S), Some(note))
        }
    };
    let value = (latency_s + samples_s) * 1e3;
    Derived { change: Change::Set(value), value: Some(value), sigma: sigma_s * 1e3, needs: Vec::new(), note }
}
