//! Which parameters correct a barometer or an airspeed sensor, or are the drag of a multirotor.
//!
//! Pressure and airspeed in the logs come before what these parameters correct, so that the values found replace those on board; the ratio of ArduPilot's airspeed is
//! the exception. ArduPilot subtracts `BAROn_WCF_*` times ½ρv² by axis and direction (`AP_Baro/AP_Baro_Wind.cpp`: `wind_pressure_correction`) and `BAROn_THST_SCALE` times the
//! throttle (`AP_Baro/AP_Baro.cpp`: `thrust_pressure_correction`); PX4 adds `EKF2_PCOEF_*` times v²/2g to the height (`compensateBaroForDynamicPressure`). ArduPilot's airspeed is
//! √(ratio (p − offset)) (`AP_Airspeed/AP_Airspeed.cpp`), PX4's calibrated one scale times the indicated (`airspeed_selector/AirspeedValidator.cpp`).
//!
//! Both estimate the wind by −ρ/2 v²/`BCOEF` − v `MCOEF`: PX4 with √(ρ/ρ₀) `MCOEF`, as here (`fuseDrag`), ArduPilot with ρ/ρ₀ `MCOEF` (`FuseDragForces`). A coefficient of zero
//! turns its part off.

use crate::advice::on_board::{NO_AUTOPILOT, OnBoard};
use crate::compass::advice::SensorProposal;
use gaware_mission::item::Autopilot;
use gaware_nav::effects::{DRAG_QUADRATIC, SEA_LEVEL_DENSITY};
use gaware_nav::identify::aids::Finding;
use gaware_nav::identify::air::{AirFound, AirQuantity};
use gaware_nav::math::powf;

/// A change of less than this many sigmas is none.
const SIGNIFICANT: f64 = 2.0;
/// A coefficient that the flight did not narrow to this share of its prior is not proposed.
const INFORMED: f64 = 0.4;
const WIND: &str = "AP_Baro/AP_Baro_Wind.cpp: var_info; applied in wind_pressure_correction";
const THRUST: &str = "AP_Baro/AP_Baro.cpp: var_info; applied in thrust_pressure_correction";
const PITOT: &str =
    "AP_Airspeed/AP_Airspeed_Params.cpp: var_info; applied in AP_Airspeed/AP_Airspeed.cpp: read_airspeed";
const EKF2: &str =
    "modules/ekf2/params_barometer.yaml; applied in EKF/aid_sources/barometer/baro_height_control.cpp";
const HEIGHT_DELAY: &str =
    "AP_NavEKF2/AP_NavEKF2.cpp: var_info; applied in AP_NavEKF2_Measurements.cpp: readBaroData";
const SELECTOR: &str = "modules/airspeed_selector/airspeed_selector_params.yaml; applied in AirspeedValidator.cpp: update_CAS_TAS";
const DIFFERENTIAL: &str =
    "modules/sensors/module.yaml; applied in modules/sensors/sensors.cpp: diff_pres_poll";

const EK3_DRAG: &str =
    "AP_NavEKF3/AP_NavEKF3.cpp: var_info; applied in AP_NavEKF3_AirDataFusion.cpp: FuseDragForces";
const EKF2_DRAG: &str =
    "modules/ekf2/params_drag.yaml; applied in EKF/aid_sources/drag/drag_fusion.cpp: fuseDrag";

/// A new value: parameter, value, its 1-sigma, unit, limits, source.
struct Change(String, f64, f64, &'static str, (f64, f64), &'static str);

/// What is proposed, why the rest is not, and which effects the parameters on board correct already.
pub(super) type Advice = (Vec<SensorProposal>, Vec<String>, Vec<&'static str>);

/// The advice for one sensor.
pub(super) fn of(found: &AirFound, on_board: &OnBoard) -> Advice {
    let (mut proposals, mut not, mut set) = (Vec::new(), Vec::new(), Vec::new());
    let is_off = found.kind == AirQuantity::Drag && uses_no_drag(on_board);
    for finding in &found.effects {
        let effect = finding.setting.effect.name();
        if !finding.others.is_empty() {
            not.push(format!(
                "{effect}: this flight does not separate it from {}",
                finding.others.join(", ")
            ));
            continue;
        }
        let changes = match on_board.autopilot {
            None => {
                not.push(NO_AUTOPILOT.to_owned());
                break;
            }
            Some(autopilot) if found.kind == AirQuantity::Drag => drag(found, finding, autopilot),
            Some(Autopilot::ArduPilot) => ardupilot(found.sensor, finding, on_board),
            Some(Autopilot::Px4) => px4(found.sensor, finding, on_board),
        };
        if effect == "airspeed_offset" && changes.iter().any(|c| recalibrates(&c.0, on_board)) {
            not.push(
                "ARSPD_SKIP_CAL, without which the calibration at the start writes ARSPD_OFFSET anew: better cover the tube while it calibrates"
                    .to_owned(),
            );
        }
        if changes.is_empty() {
            not.push(format!("{effect}: no parameter of this autopilot corrects it"));
        }
        if is_set(&changes, on_board) {
            set.push(effect);
            continue;
        }
        for Change(parameter, proposed, sigma, unit, limits, source) in changes {
            let Some(now) = on_board.get(&parameter) else {
                not.push(format!(
                    "{parameter} {proposed:.4}: the log's parameters do not have it{}",
                    hint(&parameter)
                ));
                continue;
            };
            if proposed == now {
                continue;
            }
            if is_off {
                not.push(format!(
                    "{parameter} {proposed:.4}: the autopilot estimates no wind by drag; with a coefficient above 0 it does"
                ));
            } else if !(limits.0..=limits.1).contains(&proposed) {
                not.push(format!("{parameter} {proposed:.3}: beyond {} to {}", limits.0, limits.1));
            } else if (proposed - now).abs() >= SIGNIFICANT * sigma {
                proposals.push(SensorProposal {
                    parameter,
                    on_board: now,
                    proposed: rounded(proposed),
                    unit,
                    effect,
                    source,
                });
            }
        }
    }
    (proposals, not, set)
}

/// Whether the parameters on board are what the flight finds, and not nothing: the sensor's samples are those before the correction.
fn is_set(changes: &[Change], on_board: &OnBoard) -> bool {
    let known = || changes.iter().map(|c| Some((c, on_board.get(&c.0)?)));
    let same = |(c, now): (&Change, f64)| (c.1 - now).abs() < SIGNIFICANT * c.2 || c.1 == now;
    known().all(|c| c.is_some_and(same)) && known().flatten().any(|(_, now)| now != 0.0)
}

/// The coefficients of drag: what a flight shows of an effect, and zero for the other one where it does not show that.
fn drag(found: &AirFound, finding: &Finding, autopilot: Autopilot) -> Vec<Change> {
    let (prefix, most, source, momentum) = match autopilot {
        Autopilot::ArduPilot => ("EK3_DRAG_", 1000.0, EK3_DRAG, powf(found.density.max(0.1), -0.5)),
        Autopilot::Px4 => ("EKF2_", 200.0, EKF2_DRAG, 1.0),
    };
    let (v, s) = (&finding.setting.values, &finding.setting.sigmas);
    let alone = found.effects.len() == 1;
    let body = |k: usize, v: f64, s: f64| {
        Change(format!("{prefix}BCOEF_{}", ["X", "Y"][k]), v, s, "kg/m²", (0.0, most), source)
    };
    let rotors = |v: f64, s: f64| Change(format!("{prefix}MCOEF"), v, s, "1/s", (0.0, 1.0), source);
    if finding.setting.effect.name() == DRAG_QUADRATIC.name {
        let known = (0..2).filter(|k| v[*k] > SIGNIFICANT * s[*k]);
        let known = known.map(|k| body(k, 1.0 / v[k], s[k] / v[k].powi(2)));
        known.chain(alone.then(|| rotors(0.0, 0.0))).collect()
    } else {
        let none = [0, 1].map(|k| body(k, 0.0, 0.0));
        let none = none.into_iter().filter(|_| alone);
        std::iter::once(rotors(momentum * v[0], momentum * s[0])).chain(none).collect()
    }
}

/// Whether ArduPilot's filter has no coefficient above 0, so that one would turn on what its owner has off. PX4 has a switch of its own for it.
fn uses_no_drag(on_board: &OnBoard) -> bool {
    let is_zero = |name: &str| on_board.get(&format!("EK3_DRAG_{name}")).is_some_and(|v| v == 0.0);
    on_board.autopilot == Some(Autopilot::ArduPilot)
        && ["MCOEF", "BCOEF_X", "BCOEF_Y"].into_iter().all(is_zero)
}

/// Whether ArduPilot finds this offset anew at each start (`AP_Airspeed/AP_Airspeed.cpp`: `calibrate`).
fn recalibrates(offset: &str, on_board: &OnBoard) -> bool {
    let skips = offset.replace("OFFSET", "SKIP_CAL");
    offset.ends_with("OFFSET") && on_board.get(&skips) == Some(0.0)
}

fn hint(parameter: &str) -> &'static str {
    if parameter.contains("_WCF_") { " (BAROn_WCF_ENABLE 1 and a restart make it appear)" } else { "" }
}

/// To four digits, which is how it is printed.
fn rounded(v: f64) -> f64 {
    format!("{v:.3e}").parse().unwrap_or(v)
}

/// Coefficients of the flow that the flight shows: place among the parameters, value, sigma.
fn coefficients(finding: &Finding) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
    let setting = &finding.setting;
    let priors = setting.effect.groups().iter().map(|g| g.prior_sigma);
    let all = setting.values.iter().zip(&setting.sigmas).zip(priors).enumerate();
    all.filter(|(_, ((_, s), prior))| **s < INFORMED * prior).map(|(k, ((v, s), _))| (k, *v, *s))
}

fn ardupilot(sensor: u8, finding: &Finding, on_board: &OnBoard) -> Vec<Change> {
    let (value, sigma) = (finding.setting.values[0], finding.setting.sigmas[0]);
    let barometer = |what: &str| format!("BARO{}_{what}", sensor + 1);
    let pitot = |what: &str| {
        format!("ARSPD{}_{what}", if sensor == 0 { String::new() } else { (sensor + 1).to_string() })
    };
    let ratio = on_board.get(&pitot("RATIO"));
    match finding.setting.effect.name() {
        "baro_dynamic_pressure" => {
            let names = [&["FWD"][..], &["BCK"], &["RGT"], &["LFT"], &["UP", "DN"]];
            let all = coefficients(finding).flat_map(|(k, v, s)| names[k].iter().map(move |n| (*n, v, s)));
            let one = |(n, v, s): (&str, f64, f64)| {
                Change(barometer(&format!("WCF_{n}")), v, s, "", (-1.0, 1.0), WIND)
            };
            let mut changes: Vec<Change> = all.map(one).collect();
            let enable = barometer("WCF_ENABLE");
            if on_board.get(&enable) == Some(0.0) {
                changes.insert(0, Change(enable, 1.0, 0.0, "", (0.0, 1.0), WIND));
            }
            changes
        }
        "baro_thrust" => vec![Change(barometer("THST_SCALE"), value, sigma, "Pa", (-300.0, 300.0), THRUST)],
        "baro_delay" => {
            let name = if on_board.has("EK3_HGT_DELAY") { "EK3_HGT_DELAY" } else { "EK2_HGT_DELAY" };
            vec![Change(name.to_owned(), 1e3 * value, 1e3 * sigma, "ms", (0.0, 250.0), HEIGHT_DELAY)]
        }
        "airspeed_scale" => ratio
            .map(|old| {
                let new = old / (1.0 + value).powi(2);
                Change(pitot("RATIO"), new, 2.0 * new * sigma, "", (0.5, 10.0), PITOT)
            })
            .into_iter()
            .collect(),
        "airspeed_offset" => ratio
            .zip(on_board.get(&pitot("OFFSET")))
            .map(|(ratio, old)| {
                // In the sensor's own pressure, of which the ratio makes the square of the airspeed.
                let own = 2.0 / (SEA_LEVEL_DENSITY * ratio.max(0.1));
                Change(pitot("OFFSET"), old + value * own, sigma * own, "Pa", (-2e3, 2e3), PITOT)
            })
            .into_iter()
            .collect(),
        _ => Vec::new(),
    }
}

fn px4(sensor: u8, finding: &Finding, on_board: &OnBoard) -> Vec<Change> {
    let (value, sigma) = (finding.setting.values[0], finding.setting.sigmas[0]);
    match finding.setting.effect.name() {
        // The estimator uses one barometer, and has no parameter per instance.
        "baro_dynamic_pressure" if sensor == 0 => {
            let names = ["XP", "XN", "YP", "YN", "Z"];
            let one = |(k, v, s): (usize, f64, f64)| {
                Change(format!("EKF2_PCOEF_{}", names[k]), v, s, "", (-0.5, 0.5), EKF2)
            };
            coefficients(finding).map(one).collect()
        }
        "baro_delay" if sensor == 0 => {
            vec![Change("EKF2_BARO_DELAY".to_owned(), 1e3 * value, 1e3 * sigma, "ms", (0.0, 300.0), EKF2)]
        }
        "airspeed_scale" => {
            let new = 1.0 / (1.0 + value);
            vec![Change(format!("ASPD_SCALE_{}", sensor + 1), new, new * sigma, "", (0.5, 2.0), SELECTOR)]
        }
        "airspeed_offset" => {
            let old = on_board.get("SENS_DPRES_OFF").unwrap_or(0.0);
            vec![Change("SENS_DPRES_OFF".to_owned(), old + value, sigma, "Pa", (-2e3, 2e3), DIFFERENTIAL)]
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::rounded;

    #[test]
    fn four_digits_are_printed_as_four() {
        for (value, printed) in
            [(-0.533_700_4, "-0.5337"), (1987.46, "1987"), (0.0, "0"), (3.0e-7, "0.0000003")]
        {
            assert_eq!(rounded(value).to_string(), printed);
        }
    }
}
