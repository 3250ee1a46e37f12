//! Which parameters correct a compass.
//!
//! ArduPilot corrects m = s M (r + ofs) + mot·I (`AP_Compass/AP_Compass_Backend.cpp`: `correct_field`) after the rotations of `rotate_field`, with
//! M of `COMPASS_DIA` and `COMPASS_ODI` and s of `COMPASS_SCALE`. PX4 corrects m = R S (r + comp·P − off) (`lib/sensor_calibration/Magnetometer.hpp`: `Correct`) with S of
//! `CAL_MAGn_*SCALE` and `CAL_MAGn_*ODIAG`. A field m = A b + h + k I becomes b by sM ← A⁻¹sM, ofs ← ofs − (sM)⁻¹h, mot ← A⁻¹(mot − k), in PX4 comp ← comp − (RS)⁻¹k.

use super::{CompassEntry, MGAUSS, Status};
use crate::advice::on_board::{NO_AUTOPILOT, OnBoard};
use crate::compass::world::WorldField;
use gaware_mission::item::Autopilot;
use gaware_nav::identify::compass::{CompassFinding, CompassFound, Orientation};
use gaware_nav::rotation::wrap_180;
use nalgebra::{Matrix3, Rotation3, Vector3};
use schemars::JsonSchema;
use serde::Serialize;

/// A change of less than this many sigmas is none.
const SIGNIFICANT: f64 = 2.0;
/// A compass that is this bad after all corrections is not to be used, deg.
const UNUSABLE_DEG: f64 = 15.0;
/// A declination set by hand that differs by more than this, deg.
const DECLINATION_DEG: f64 = 1.5;
/// `COMPASS_OFFS_MAX` is 1800 mG (`AP_Compass/AP_Compass.cpp`).
const MOST_OFFSET_MGAUSS: f64 = 1800.0;
/// `COMPASS_MAX_SCALE_FACTOR` and its inverse (`AP_Compass/AP_Compass.h`).
const SCALE: (f64, f64) = (0.76, 1.3);

const ARDUPILOT_SOURCE: &str =
    "AP_Compass/AP_Compass.cpp: var_info; applied in AP_Compass/AP_Compass_Backend.cpp: correct_field";
const ARDUPILOT_TURN: &str =
    "AP_Compass/AP_Compass.cpp: var_info; applied in AP_Compass/AP_Compass_Backend.cpp: rotate_field";
const PX4_TURN: &str = "lib/sensor_calibration/Magnetometer.cpp: ParametersLoad, set_rotation; applied in Magnetometer.hpp: Correct";
const PX4_SOURCE: &str =
    "lib/sensor_calibration/module.yaml; applied in lib/sensor_calibration/Magnetometer.hpp: Correct";

/// A parameter that is to change.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SensorProposal {
    /// Its name.
    pub parameter: String,
    /// Its value on board.
    pub on_board: f64,
    /// The new value.
    pub proposed: f64,
    /// Unit.
    pub unit: &'static str,
    /// The effect it corrects.
    pub effect: &'static str,
    /// Where in the autopilot's sources it is declared and applied.
    pub source: &'static str,
}

/// What is proposed, and why the rest is not.
type Advice = (Vec<SensorProposal>, Vec<String>);

/// What an autopilot applies to one compass.
#[derive(Debug, Clone, Copy)]
struct OnBoardField {
    /// M, or S of PX4.
    scale: Matrix3<f64>,
    /// Added to the raw field, mG.
    offset: Vector3<f64>,
    /// Added per ampere, mG.
    current: Vector3<f64>,
}

/// Names of the parameters of a compass.
struct Names {
    /// One factor for all axes; PX4 has none.
    factor: String,
    offset: [String; 3],
    diagonal: [String; 3],
    off_diagonal: [String; 3],
    current: [String; 3],
}

/// Where ArduPilot keeps the parameters of its compass of this number: by priority since 4.1 (`AP_Compass.cpp`: `_get_state(Priority)`).
fn ardupilot_place(compass: u8, on_board: &OnBoard) -> usize {
    let own = usize::from(compass);
    let wanted = on_board.get(&format!("COMPASS_PRIO{}_ID", own + 1)).filter(|id| *id != 0.0);
    let ids = ["COMPASS_DEV_ID", "COMPASS_DEV_ID2", "COMPASS_DEV_ID3"].map(|name| on_board.get(name));
    wanted.and_then(|id| ids.iter().position(|own| *own == Some(id))).unwrap_or(own)
}

fn ardupilot_number(place: usize) -> String {
    if place == 0 { String::new() } else { (place + 1).to_string() }
}

fn ardupilot_names(place: usize) -> Names {
    let n = ardupilot_number(place);
    let three = |what: &str| ["X", "Y", "Z"].map(|axis| format!("COMPASS_{what}{n}_{axis}"));
    Names {
        factor: format!("COMPASS_SCALE{n}"),
        offset: three("OFS"),
        diagonal: three("DIA"),
        off_diagonal: three("ODI"),
        current: three("MOT"),
    }
}

fn px4_names(place: usize) -> Names {
    let three = |what: &str| ["X", "Y", "Z"].map(|axis| format!("CAL_MAG{place}_{axis}{what}"));
    Names {
        factor: String::new(),
        offset: three("OFF"),
        diagonal: three("SCALE"),
        off_diagonal: three("ODIAG"),
        current: three("COMP"),
    }
}

fn vector(on_board: &OnBoard, names: &[String; 3]) -> Option<Vector3<f64>> {
    let [x, y, z] = [0, 1, 2].map(|k| on_board.get(&names[k]));
    Some(Vector3::new(x?, y?, z?))
}

fn symmetric(diagonal: &Vector3<f64>, off: &Vector3<f64>) -> Matrix3<f64> {
    let (d, o) = (diagonal, off);
    Matrix3::new(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z)
}

/// What the autopilot applies, in the units of its parameters.
fn applied(names: &Names, on_board: &OnBoard, by_current: bool, advice: &mut Advice) -> Option<OnBoardField> {
    let Some(offset) = vector(on_board, &names.offset) else {
        advice.1.push(format!("the log has no {}", names.offset[0]));
        return None;
    };
    let diagonal = vector(on_board, &names.diagonal).filter(|d| *d != Vector3::zeros());
    let off = vector(on_board, &names.off_diagonal).unwrap_or_default();
    Some(OnBoardField {
        scale: symmetric(&diagonal.unwrap_or(Vector3::repeat(1.0)), &off),
        offset,
        current: vector(on_board, &names.current).filter(|_| by_current).unwrap_or_default(),
    })
}

/// What the flight found of a compass, in body axes: A, h (mG) and k (mG/A).
struct Errors {
    by_field: Matrix3<f64>,
    constant: Vector3<f64>,
    current: Vector3<f64>,
}

impl Errors {
    fn of(effects: &[CompassFinding]) -> Self {
        let mut own =
            Self { by_field: Matrix3::identity(), constant: Vector3::zeros(), current: Vector3::zeros() };
        for f in effects {
            let v = &f.setting.values;
            match f.setting.effect.name() {
                "mag_hard_iron" => own.constant = Vector3::from_column_slice(&v[..3]) / MGAUSS,
                "mag_current" => own.current = Vector3::from_column_slice(&v[..3]) / MGAUSS,
                "mag_soft_iron" => {
                    own.by_field +=
                        symmetric(&Vector3::new(v[0], v[1], v[2]), &Vector3::new(v[3], v[4], v[5]));
                }
                _ => {}
            }
        }
        own
    }
}

/// The corrections after which the field is the Earth's. `rotation`: from the sensor's axes, in which they act, to the body's.
fn corrected(now: &OnBoardField, errors: &Errors, rotation: &Matrix3<f64>) -> Option<OnBoardField> {
    let back = now.scale.try_inverse()? * rotation.transpose();
    let scale = rotation.transpose() * errors.by_field.try_inverse()? * rotation * now.scale;
    Some(OnBoardField {
        scale: (scale + scale.transpose()) * 0.5,
        offset: now.offset - back * errors.constant,
        current: now.current - back * errors.current,
    })
}

/// The advice for one compass.
pub(super) fn of(found: &CompassFound, on_board: &OnBoard, world: &WorldField) -> Advice {
    let mut advice = (Vec::new(), Vec::new());
    if let Some(turned) = &found.orientation {
        orientation(found.compass, turned, on_board, &mut advice);
        return advice;
    }
    let unseparated = found.effects.iter().any(|f| !f.others.is_empty());
    match on_board.autopilot {
        None if !found.effects.is_empty() => {
            advice.1.push(NO_AUTOPILOT.to_owned());
        }
        _ if unseparated => {
            let all =
                found.effects.iter().flat_map(|f| f.others.iter().copied().chain([f.setting.effect.name()]));
            let names: Vec<&str> = all.collect();
            advice.1.push(format!("this flight does not separate {}: turn about all axes", names.join(", ")));
        }
        Some(Autopilot::ArduPilot) => ardupilot(found, on_board, world, &mut advice),
        Some(Autopilot::Px4) => px4(found, on_board, &mut advice),
        None => {}
    }
    advice
}

fn ardupilot(found: &CompassFound, on_board: &OnBoard, world: &WorldField, advice: &mut Advice) {
    declination(on_board, world, advice);
    if found.effects.is_empty() {
        return;
    }
    let names = ardupilot_names(ardupilot_place(found.compass, on_board));
    let kind = on_board.get("COMPASS_MOTCT");
    // 0: off, 1: by throttle, 2: by current.
    let by_current = kind == Some(2.0);
    let Some(mut now) = applied(&names, on_board, by_current, advice) else { return };
    // One factor for all axes is applied before the matrix, where it is within these limits (`Compass::have_scale_factor`).
    let factor = on_board.get(&names.factor).filter(|s| (SCALE.0..=SCALE.1).contains(s)).unwrap_or(1.0);
    now.scale *= factor;
    let errors = Errors::of(&found.effects);
    let Some(new) = corrected(&now, &errors, &Matrix3::identity()) else { return };
    let Some(unbent) = errors.by_field.try_inverse() else { return };
    // The motor compensation is added behind the matrix.
    let new =
        OnBoardField { scale: new.scale / factor, current: unbent * (now.current - errors.current), ..new };
    for finding in &found.effects {
        match finding.setting.effect.name() {
            "mag_hard_iron" if new.offset.amax() > MOST_OFFSET_MGAUSS => {
                advice.1.push(format!("{}: beyond ±{MOST_OFFSET_MGAUSS:.0} mG", names.offset[0]));
            }
            "mag_hard_iron" => {
                propose(finding, on_board, &names.offset, &new.offset, ("mG", MGAUSS, ARDUPILOT_SOURCE), advice);
            }
            "mag_soft_iron" => scales(finding, on_board, &names, &new.scale, ARDUPILOT_SOURCE, advice),
            "mag_current" if kind == Some(1.0) => advice.1.push(
                "COMPASS_MOTCT is 1: the motor compensation goes by throttle, and the effect was found by current"
                    .to_owned(),
            ),
            "mag_current" => {
                let unit = ("mG/A", MGAUSS, ARDUPILOT_SOURCE);
                propose(finding, on_board, &names.current, &new.current, unit, advice);
                let off = kind.filter(|_| !by_current && on_board.has(&names.current[0]));
                advice.0.extend(off.map(|on_board| SensorProposal {
                    parameter: "COMPASS_MOTCT".to_owned(),
                    on_board,
                    proposed: 2.0,
                    unit: "",
                    effect: finding.setting.effect.name(),
                    source: ARDUPILOT_SOURCE,
                }));
            }
            other => advice.1.push(format!("{other}: no parameter corrects it; {}", finding.setting.effect.remedy())),
        }
    }
}

/// The number of a compass's parameters, which is not that of its messages: known where one alone is calibrated.
fn px4_place(on_board: &OnBoard, advice: &mut Advice) -> Option<usize> {
    let places: Vec<usize> =
        (0..4).filter(|n| on_board.get(&format!("CAL_MAG{n}_ID")).is_some_and(|id| id != 0.0)).collect();
    if let [place] = places[..] {
        return Some(place);
    }
    advice.1.push(format!(
        "the vehicle has {} calibrated compasses, and the log does not say which of CAL_MAGn_* this one's are",
        places.len()
    ));
    None
}

fn px4(found: &CompassFound, on_board: &OnBoard, advice: &mut Advice) {
    if found.effects.is_empty() {
        return;
    }
    let Some(place) = px4_place(on_board, advice) else { return };
    let names = px4_names(place);
    let kind = on_board.get("CAL_MAG_COMP_TYP");
    // 0: off, 1: by throttle, 2: by the current of battery 1, in kA; G/kA is mG/A.
    let by_current = kind == Some(2.0);
    let Some(mut now) = applied(&names, on_board, by_current, advice) else { return };
    // PX4 subtracts its offset, in G.
    now.offset *= -1e3;
    let Some(rotation) = px4_rotation(place, on_board) else {
        advice.1.push(format!(
            "CAL_MAG{place}_ROT or SENS_BOARD_ROT is none about the vertical axis or upside down"
        ));
        return;
    };
    let Some(new) = corrected(&now, &Errors::of(&found.effects), &rotation) else { return };
    for finding in &found.effects {
        match finding.setting.effect.name() {
            "mag_hard_iron" => {
                let value = -new.offset * 1e-3;
                propose(finding, on_board, &names.offset, &value, ("G", 1e3 * MGAUSS, PX4_SOURCE), advice);
            }
            "mag_soft_iron" => scales(finding, on_board, &names, &new.scale, PX4_SOURCE, advice),
            "mag_current" if by_current => {
                propose(
                    finding,
                    on_board,
                    &names.current,
                    &new.current,
                    ("G/kA", MGAUSS, PX4_SOURCE),
                    advice,
                );
            }
            "mag_current" => {
                let now = kind.map_or_else(|| "not in the log".to_owned(), |k| format!("{k}"));
                advice.1.push(format!(
                    "CAL_MAG_COMP_TYP is {now}: set it to 2 (battery current) first, and {} to {:.3}, {:.3}, {:.3}",
                    names.current.join(", "),
                    new.current.x,
                    new.current.y,
                    new.current.z
                ));
            }
            other => advice
                .1
                .push(format!("{other}: no parameter corrects it; {}", finding.setting.effect.remedy())),
        }
    }
}

/// Three parameters of an effect of three values; `size`: T per unit of theirs. All of them where one is beyond chance: they are one vector, whose
/// best estimate is all that the flight says (of 4.8 mG/A in a firmware's simulation the one component beyond chance left 2.5).
fn propose(
    finding: &CompassFinding,
    on_board: &OnBoard,
    names: &[String; 3],
    values: &Vector3<f64>,
    (unit, size, source): (&'static str, f64, &'static str),
    advice: &mut Advice,
) {
    let is_beyond_chance = |k: usize| {
        let old = on_board.get(&names[k])?;
        Some((values[k] - old).abs() > SIGNIFICANT * finding.setting.sigmas[k] / size)
    };
    let any = (0..3).any(|k| is_beyond_chance(k) == Some(true));
    let values = names.iter().zip(values.iter().copied());
    let values = values.filter(|(name, _)| any || on_board.get(name).is_none());
    set(finding, on_board, values, (unit, source), advice);
}

/// Scale factors and what is beside the diagonal: all six, since they act together.
fn scales(
    finding: &CompassFinding,
    on_board: &OnBoard,
    names: &Names,
    scale: &Matrix3<f64>,
    source: &'static str,
    advice: &mut Advice,
) {
    if (0..3).any(|k| scale[(k, k)] < SCALE.0 || scale[(k, k)] > SCALE.1) {
        advice.1.push(format!("{}: beyond {} to {}", names.diagonal[0], SCALE.0, SCALE.1));
        return;
    }
    let values = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|at| scale[at]);
    let names = names.diagonal.iter().chain(&names.off_diagonal);
    set(finding, on_board, names.zip(values), ("", source), advice);
}

/// New values of parameters, to four decimals.
fn set<'a>(
    finding: &CompassFinding,
    on_board: &OnBoard,
    values: impl Iterator<Item = (&'a String, f64)>,
    (unit, source): (&'static str, &'static str),
    advice: &mut Advice,
) {
    for (name, value) in values {
        match on_board.get(name) {
            Some(on_board) => advice.0.push(SensorProposal {
                parameter: name.clone(),
                on_board,
                proposed: (value * 1e4).round() / 1e4,
                unit,
                effect: finding.setting.effect.name(),
                source,
            }),
            None => advice.1.push(format!("the log has no {name}")),
        }
    }
}

/// ArduPilot's `Rotation` and PX4's, which are the same up to 15: eighths of a turn, upright (0 to 7) and upside down (8 to 15).
fn rotation(number: f64) -> Option<Matrix3<f64>> {
    let k = Some(number).filter(|n| (0.0..16.0).contains(n) && n.fract() == 0.0)? as u8;
    let roll = if k >= 8 { std::f64::consts::PI } else { 0.0 };
    Some(Rotation3::from_euler_angles(roll, 0.0, f64::from(k % 8) * std::f64::consts::FRAC_PI_4).into_inner())
}

fn rotation_number(wanted: &Matrix3<f64>) -> Option<u8> {
    (0..16).find(|k| rotation(f64::from(*k)).is_some_and(|r| (r - wanted).norm() < 1e-6))
}

fn px4_rotation(place: usize, on_board: &OnBoard) -> Option<Matrix3<f64>> {
    match on_board.get(&format!("CAL_MAG{place}_ROT"))? {
        internal if internal < 0.0 => rotation(on_board.get("SENS_BOARD_ROT")?),
        external => rotation(external),
    }
}

/// The orientation after which the axes are the vehicle's; offsets and scales are those of the old axes and have to be calibrated anew.
fn orientation(compass: u8, turned: &Orientation, on_board: &OnBoard, advice: &mut Advice) {
    if !turned.is_known() {
        advice.1.push("this flight does not show which orientation is the right one: turn through all headings, with bank".to_owned());
        return;
    }
    if turned.is_reflection() {
        advice.1.push(
            "an axis is reversed: no orientation parameter undoes that; it is the driver's or the wiring's"
                .to_owned(),
        );
        return;
    }
    let (name, external, source) = match on_board.autopilot {
        Some(Autopilot::ArduPilot) => {
            let place = ardupilot_place(compass, on_board);
            let n = ardupilot_number(place);
            let external =
                if place == 0 { "COMPASS_EXTERNAL".to_owned() } else { format!("COMPASS_EXTERN{n}") };
            (format!("COMPASS_ORIENT{n}"), on_board.get(&external).is_none_or(|v| v != 0.0), ARDUPILOT_TURN)
        }
        Some(Autopilot::Px4) => {
            let Some(place) = px4_place(on_board, advice) else { return };
            let name = format!("CAL_MAG{place}_ROT");
            let external = on_board.get(&name).is_none_or(|v| v >= 0.0);
            (name, external, PX4_TURN)
        }
        None => {
            advice.1.push(NO_AUTOPILOT.to_owned());
            return;
        }
    };
    let old = on_board.get(&name);
    let new = old.and_then(rotation).and_then(|old| rotation_number(&(turned.undo() * old)));
    match (old, new) {
        _ if !external => advice.1.push(format!(
            "{name}: the compass is internal and turns with the board; check the board's orientation, or whether it is external"
        )),
        (Some(old), Some(new)) => {
            advice.0.push(SensorProposal {
                parameter: name,
                on_board: old,
                proposed: f64::from(new),
                unit: "",
                effect: "orientation",
                source,
            });
            advice.1.push("offsets and scales, which are of the old axes: calibrate the compass again after that".to_owned());
        }
        _ => advice.1.push(format!("{name}: not in the log, or not an orientation about the vertical axis")),
    }
}

/// `COMPASS_DEC`, rad, where ArduPilot does not take it from its own table and it is another one than the world's.
fn wrong_declination(on_board: &OnBoard, world: &WorldField) -> Option<f64> {
    let old = on_board.get("COMPASS_DEC").filter(|_| on_board.get("COMPASS_AUTODEC") == Some(0.0))?;
    let off = wrap_180(old.to_degrees() - world.declination_deg);
    (on_board.autopilot == Some(Autopilot::ArduPilot) && off.abs() > DECLINATION_DEG).then_some(old)
}

/// The same as a sentence: no compass is wrong, and every heading is.
pub(super) fn declination_off(on_board: &OnBoard, world: &WorldField) -> Option<String> {
    let degrees = wrong_declination(on_board, world)?.to_degrees();
    Some(format!(
        "COMPASS_DEC is {degrees:.1}° where the world model has {:.1}°: every heading that the autopilot takes from a compass is {:.0}° off.",
        world.declination_deg,
        wrap_180(degrees - world.declination_deg).abs()
    ))
}

fn declination(on_board: &OnBoard, world: &WorldField, advice: &mut Advice) {
    if let Some(old) = wrong_declination(on_board, world) {
        advice.0.push(SensorProposal {
            parameter: "COMPASS_DEC".to_owned(),
            on_board: old,
            proposed: (world.declination_deg.to_radians() * 1e4).round() / 1e4,
            unit: "rad",
            effect: "mag_declination",
            source: "AP_Compass/AP_Compass.cpp: var_info; applied in AP_AHRS/AP_AHRS_DCM.cpp and AP_NavEKF3 by get_declination",
        });
    }
}

/// `COMPASS_USE*` of compasses that are wrong and that nothing proposed corrects, where another one is in order.
pub(super) fn unused(compasses: &mut [CompassEntry], on_board: &OnBoard) {
    if on_board.autopilot != Some(Autopilot::ArduPilot) || compasses.iter().all(|c| c.status != Status::Ok) {
        return;
    }
    for entry in
        compasses.iter_mut().filter(|c| c.status == Status::Wrong && c.heading_rms_deg.after > UNUSABLE_DEG)
    {
        let n = ardupilot_number(ardupilot_place(entry.compass - 1, on_board));
        let name = format!("COMPASS_USE{n}");
        if let Some(old) = on_board.get(&name).filter(|v| *v != 0.0) {
            entry.proposals.push(SensorProposal {
                parameter: name,
                on_board: old,
                proposed: 0.0,
                unit: "",
                effect: "heading",
                source: "AP_Compass/AP_Compass.cpp: var_info; applied in use_for_yaw",
            });
        }
    }
}

/// What the samples hold already.
pub(super) fn corrected_on_board(on_board: &OnBoard) -> Option<String> {
    let set = |prefix: &str, inside: &[&str]| {
        let is = |name: &&String| name.starts_with(prefix) && inside.iter().any(|i| name.contains(i));
        on_board.parameters.iter().filter(|(name, v)| **v != 0.0 && is(name)).count()
    };
    let (prefix, names): (&str, &[&str]) = match on_board.autopilot? {
        Autopilot::ArduPilot => ("COMPASS_", &["OFS", "DIA", "ODI", "MOT", "ORIENT"]),
        Autopilot::Px4 => ("CAL_MAG", &["OFF", "SCALE", "ODIAG", "COMP", "ROT"]),
    };
    let count = set(prefix, names);
    (count > 0).then(|| {
        format!("The fields are as the autopilot corrected them: {count} parameters {prefix}* are set and taken along in the proposals.")
    })
}

#[cfg(test)]
mod tests;
