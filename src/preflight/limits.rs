//! The airframe file against the vehicle's own limits, and the plan against what PX4 requires of a mission.

use super::vehicle::distance_m;
use super::{Against, Facts, Row, Verdict};
use crate::mission_link::files::Contents;
use gaware_mission::airframe::{Airframe, Kind};
use gaware_mission::item::{Autopilot, command};
use gaware_mission::rules::{self, FirmwareRefusal};
use gaware_nav::math::atan2;

/// Parameters of ArduPilot, today's names and older ones.
pub(super) const ARDUPILOT: &[&str] = &[
    "SCHED_LOOP_RATE",
    "ROLL_LIMIT_DEG",
    "LIM_ROLL_CD",
    "AIRSPEED_MIN",
    "ARSPD_FBW_MIN",
    "AIRSPEED_MAX",
    "ARSPD_FBW_MAX",
    "AIRSPEED_CRUISE",
    "TRIM_ARSPD_CM",
    "WP_RADIUS",
    "ATC_ANGLE_MAX",
    "ANGLE_MAX",
    "ATC_SLEW_YAW",
    "WP_SPD",
    "WPNAV_SPEED",
];
/// Parameters of PX4.
pub(super) const PX4: &[&str] = &[
    "FW_R_LIM",
    "FW_AIRSPD_MIN",
    "FW_AIRSPD_TRIM",
    "FW_AIRSPD_MAX",
    "MPC_TILTMAX_AIR",
    "MPC_XY_VEL_MAX",
    "MPC_XY_CRUISE",
];
/// Parameters by which PX4 judges a mission.
pub(super) const PX4_MISSION: &[&str] = &["MIS_TKO_LAND_REQ", "FW_LND_ANG", "MIS_DIST_1WP"];

/// The steepest planned turn as a share of the airframe's bank, as the planner plans it.
const STEEPEST: f64 = 0.9;
/// Speeds that differ by less are alike, m/s.
const ALIKE_M_PER_S: f64 = 0.5;
/// A cruise speed may differ by this much before it is reported, m/s.
const CRUISE_M_PER_S: f64 = 2.0;
/// PX4 allows for rounding of the glide slope (FeasibilityChecker.cpp), deg.
const SLOPE_MARGIN_DEG: f64 = 0.1;

/// A parameter with its older names and what one unit of each is.
type Names = [(&'static str, f64)];

pub(super) fn check(facts: &Facts, against: Against<'_>) -> Vec<Row> {
    let mut rows = Vec::new();
    if facts.parameters.is_silent() {
        let text = "the vehicle answers for none of its parameters; its limits are not known";
        rows.push(Row::new("parameters", Verdict::Warn, text));
    }
    if let Some(airframe) = against.airframe {
        let compared = if airframe.is_fixed_wing() { wing(facts, airframe) } else { rotor(facts, airframe) };
        if compared.is_empty() && !facts.parameters.is_silent() {
            rows.push(Row::new("airframe", Verdict::Ok, allowed(airframe)));
        }
        rows.extend(compared);
    }
    if let Some(plan) = against.plan {
        rows.extend(check_mission(facts, plan));
    }
    rows
}

/// A limit says what the autopilot allows, not what the aircraft reaches: one with `FW_AIRSPD_MAX` 20 flew 14.6 m/s at full throttle.
fn allowed(airframe: &Airframe) -> String {
    let mut text = format!("the vehicle's limits allow what {} is said to do", airframe.name);
    if airframe.is_fixed_wing() && !airframe.is_fitted() {
        let planned = airframe.speed_max_m_per_s;
        text.push_str(&format!(
            "; whether it reaches speed_max_m_per_s {planned:.1} no parameter says: \"gaware airframe fit LOG\" measures it"
        ));
    }
    text
}

/// The first of these names that the vehicle has, and its value.
fn get(facts: &Facts, names: &Names) -> Option<(&'static str, f64)> {
    names.iter().find_map(|(name, unit)| Some((*name, facts.parameters.get(name)? * unit)))
}

fn row(verdict: Verdict, text: String) -> Row {
    Row::new("airframe", verdict, text)
}

/// A limit in deg that steep turns need.
fn bank(facts: &Facts, names: &Names, airframe: &Airframe) -> Option<Row> {
    let (name, limit) = get(facts, names)?;
    let wanted = airframe.bank_max_deg;
    let text = format!("{name} is {limit:.0}°, bank_max_deg of the airframe file {wanted:.0}°");
    if limit < STEEPEST * wanted {
        let planned = STEEPEST * wanted;
        return Some(row(
            Verdict::Stop,
            format!("{text}: planned turns of {planned:.0}° would be flown wider"),
        ));
    }
    (limit < wanted).then(|| row(Verdict::Warn, format!("{text}: no reserve is left in steep turns")))
}

fn wing(facts: &Facts, airframe: &Airframe) -> Vec<Row> {
    let (bank_names, min, max, cruise): (&Names, &Names, &Names, &Names) = match facts.vehicle.autopilot {
        Autopilot::ArduPilot => (
            &[("ROLL_LIMIT_DEG", 1.0), ("LIM_ROLL_CD", 0.01)],
            &[("AIRSPEED_MIN", 1.0), ("ARSPD_FBW_MIN", 1.0)],
            &[("AIRSPEED_MAX", 1.0), ("ARSPD_FBW_MAX", 1.0)],
            &[("AIRSPEED_CRUISE", 1.0), ("TRIM_ARSPD_CM", 0.01)],
        ),
        Autopilot::Px4 => (
            &[("FW_R_LIM", 1.0)],
            &[("FW_AIRSPD_MIN", 1.0)],
            &[("FW_AIRSPD_MAX", 1.0)],
            &[("FW_AIRSPD_TRIM", 1.0)],
        ),
    };
    // ArduPlane drops a change of speed outside its limits without a word (FIELD_NOTES, "Mission protocol").
    let ignored = "slower or faster legs of a plan would be flown at another speed";
    let slowest =
        get(facts, min).filter(|(_, v)| *v > airframe.speed_min_m_per_s + ALIKE_M_PER_S).map(|(n, v)| {
            let file = airframe.speed_min_m_per_s;
            row(
                Verdict::Stop,
                format!("{n} is {v:.1} m/s, speed_min_m_per_s of the airframe file {file:.1}: {ignored}"),
            )
        });
    let fastest =
        get(facts, max).filter(|(_, v)| *v < airframe.speed_max_m_per_s - ALIKE_M_PER_S).map(|(n, v)| {
            let file = airframe.speed_max_m_per_s;
            row(
                Verdict::Stop,
                format!("{n} is {v:.1} m/s, speed_max_m_per_s of the airframe file {file:.1}: {ignored}"),
            )
        });
    let usual = get(facts, cruise)
        .filter(|(_, v)| (v - airframe.speed_cruise_m_per_s).abs() > CRUISE_M_PER_S)
        .map(|(n, v)| {
            let file = airframe.speed_cruise_m_per_s;
            row(
                Verdict::Warn,
                format!("{n} is {v:.1} m/s, speed_cruise_m_per_s of the airframe file {file:.1}"),
            )
        });
    let widest = airframe.planned_radius_m(airframe.speed_cruise_m_per_s);
    let corners = get(facts, &[("WP_RADIUS", 1.0)]).filter(|(_, v)| *v > 2.0 * widest).map(|(n, v)| {
        row(
            Verdict::Warn,
            format!("{n} is {v:.0} m, more than two turn radii ({widest:.0} m each): legs end long before their waypoint"),
        )
    });
    bank(facts, bank_names, airframe)
        .into_iter()
        .chain(slowest)
        .chain(fastest)
        .chain(usual)
        .chain(corners)
        .collect()
}

fn rotor(facts: &Facts, airframe: &Airframe) -> Vec<Row> {
    let (tilt, speed): (&Names, &Names) = match facts.vehicle.autopilot {
        Autopilot::ArduPilot => {
            (&[("ATC_ANGLE_MAX", 1.0), ("ANGLE_MAX", 0.01)], &[("WP_SPD", 1.0), ("WPNAV_SPEED", 0.01)])
        }
        Autopilot::Px4 => (&[("MPC_TILTMAX_AIR", 1.0)], &[("MPC_XY_VEL_MAX", 1.0)]),
    };
    let fastest = get(facts, speed).filter(|(_, v)| *v < airframe.speed_cruise_m_per_s - ALIKE_M_PER_S).map(|(n, v)| {
        let file = airframe.speed_cruise_m_per_s;
        row(
            Verdict::Warn,
            format!("{n} is {v:.1} m/s, speed_cruise_m_per_s of the airframe file {file:.1}: the plan takes longer"),
        )
    });
    // Centidegrees per second; 0 is no limit.
    let yaw = get(facts, &[("ATC_SLEW_YAW", 0.01)])
        .filter(|(_, v)| *v > 0.0 && *v < airframe.yaw_rate_max_deg_per_s)
        .map(|(n, v)| {
            let file = airframe.yaw_rate_max_deg_per_s;
            row(
                Verdict::Warn,
                format!("{n} allows {v:.0} deg/s, yaw_rate_max_deg_per_s of the airframe file is {file:.0}"),
            )
        });
    bank(facts, tilt, airframe).into_iter().chain(fastest).chain(yaw).collect()
}

/// What the firmware refuses item by item ([`rules`]). A command that the table says is not supported is left to the vehicle to
/// refuse: firmware may be newer than the table.
fn check_items(facts: &Facts, plan: &Contents) -> Option<Row> {
    let kind = if facts.vehicle.is_fixed_wing()? { Kind::FixedWing } else { Kind::Multirotor };
    let verdict = match rules::check(&plan.mission, None, facts.vehicle.autopilot, kind) {
        Err(refusal @ (FirmwareRefusal::Parameter { .. } | FirmwareRefusal::Frame { .. })) => {
            (Verdict::Stop, refusal)
        }
        Err(refusal @ FirmwareRefusal::Command { .. }) => (Verdict::Warn, refusal),
        // Feasibility goes by the vehicle's own parameters, and whom the plan was made for is a check of its own.
        Err(FirmwareRefusal::Infeasible(_) | FirmwareRefusal::OtherAutopilot { .. }) | Ok(_) => return None,
    };
    Some(Row::new("mission", verdict.0, verdict.1.to_string()))
}

/// What the firmware refuses of a mission: items when they arrive, and on PX4 the whole in the background.
fn check_mission(facts: &Facts, plan: &Contents) -> Vec<Row> {
    let items = &plan.mission.items;
    let row = |verdict, text: String| Row::new("mission", verdict, text);
    let has = |number: u16| items.iter().any(|i| i.command == number);
    let (takes_off, lands) = (has(command::NAV_TAKEOFF), has(command::NAV_LAND));
    let mut rows: Vec<Row> = check_items(facts, plan).into_iter().collect();
    if let Some(wanted) = facts.parameters.get("MIS_TKO_LAND_REQ") {
        let missing = match wanted as i64 {
            1 => (!takes_off).then_some("a take-off"),
            2 => (!lands).then_some("a landing (plan with --land)"),
            3 if !takes_off && !lands => Some("a take-off and a landing"),
            3 if !takes_off => Some("a take-off"),
            3 if !lands => Some("a landing (plan with --land)"),
            4 if takes_off && !lands => Some("a landing, because it has a take-off (plan with --land)"),
            4 if lands && !takes_off => Some("a take-off, because it has a landing"),
            _ => None,
        };
        if let Some(missing) = missing {
            let text =
                format!("MIS_TKO_LAND_REQ is {wanted}: the vehicle rejects a mission without {missing}");
            rows.push(row(Verdict::Stop, text));
        }
    }
    if facts.vehicle.is_fixed_wing() == Some(true)
        && let Some(limit_deg) = facts.parameters.get("FW_LND_ANG")
        && let Some(slope_deg) = glide_slope_deg(plan)
        && slope_deg > limit_deg + SLOPE_MARGIN_DEG
    {
        let text = format!(
            "the landing has a glide slope of {slope_deg:.1}°, the vehicle rejects more than {limit_deg:.1}° (FW_LND_ANG)"
        );
        rows.push(row(Verdict::Stop, text));
    }
    if let (Some(limit_m), Some(vehicle), Some(first)) = (
        facts.parameters.get("MIS_DIST_1WP").filter(|v| *v > 0.0),
        facts.position,
        items.iter().find_map(|i| i.place()),
    ) {
        let metres = distance_m(vehicle, first);
        if metres > limit_m {
            let text = format!(
                "the first waypoint is {metres:.0} m away, the vehicle rejects more than {limit_m:.0} m (MIS_DIST_1WP)"
            );
            rows.push(row(Verdict::Stop, text));
        }
    }
    rows
}

/// From the waypoint before the landing to the landing.
fn glide_slope_deg(plan: &Contents) -> Option<f64> {
    let items = &plan.mission.items;
    let land = items.iter().position(|i| i.command == command::NAV_LAND)?;
    let (touch, before) = (items.get(land)?, items.get(land.checked_sub(1)?)?);
    if before.command != command::NAV_WAYPOINT {
        return None;
    }
    let metres = distance_m(before.place()?, touch.place()?);
    Some(atan2(f64::from(before.z - touch.z), metres).to_degrees())
}
