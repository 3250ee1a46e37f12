//! What a vehicle enforces of a geofence, by its parameters, which are never changed.

use super::{Against, Facts, Row, Verdict, valid};
use crate::mission_link::files::Contents;
use gaware_mission::fence::{LocalFence, LocalFrame};
use gaware_mission::item::{AltitudeReference, Autopilot, command};
use gaware_mission::params::{ParamName, Parameters};

/// Bits of ArduPilot's `FENCE_TYPE`: a ceiling, a circle around home, the uploaded areas.
const CEILING: u32 = 1;
const HOME_CIRCLE: u32 = 2;
const AREAS: u32 = 4;

/// The parameters that decide about a fence.
pub fn fence_parameters(autopilot: Autopilot) -> Vec<ParamName> {
    valid(match autopilot {
        Autopilot::ArduPilot => {
            &["FENCE_ENABLE", "FENCE_ACTION", "FENCE_TYPE", "FENCE_ALT_MAX", "FENCE_RADIUS"]
        }
        Autopilot::Px4 => &["GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"],
    })
}

/// What the vehicle does at the limits of an uploaded fence.
pub fn enforcement(autopilot: Autopilot, read: &Parameters) -> (Verdict, String) {
    match autopilot {
        Autopilot::ArduPilot => ardupilot(read),
        Autopilot::Px4 => px4(read),
    }
}

fn ardupilot(read: &Parameters) -> (Verdict, String) {
    let (Some(enable), Some(action)) = (read.get("FENCE_ENABLE"), read.get("FENCE_ACTION")) else {
        let text = "whether the vehicle enforces a fence is not known: it does not answer for FENCE_ENABLE and FENCE_ACTION";
        return (Verdict::Warn, text.to_owned());
    };
    if enable == 0.0 {
        return (Verdict::Warn, "FENCE_ENABLE is 0: the vehicle does NOT enforce the fence".to_owned());
    }
    if read.get("FENCE_TYPE").is_some_and(|t| t as u32 & AREAS == 0) {
        let text = "FENCE_TYPE leaves the uploaded areas out: the vehicle does NOT enforce them";
        return (Verdict::Warn, text.to_owned());
    }
    match action as i64 {
        0 => (Verdict::Warn, "FENCE_ACTION is 0: the vehicle only reports a breach of the fence".to_owned()),
        1 => (Verdict::Ok, "the vehicle enforces it: it returns at a breach (FENCE_ACTION 1)".to_owned()),
        n => (Verdict::Ok, format!("the vehicle enforces it (FENCE_ACTION {n})")),
    }
}

/// `GF_ACTION` (PX4, `geofence_params.c`).
fn px4(read: &Parameters) -> (Verdict, String) {
    let Some(action) = read.get("GF_ACTION") else {
        let text = "whether the vehicle enforces a fence is not known: it does not answer for GF_ACTION";
        return (Verdict::Warn, text.to_owned());
    };
    let words = match action as i64 {
        0 => return (Verdict::Warn, "GF_ACTION is 0: the vehicle does NOT enforce the fence".to_owned()),
        1 => {
            return (
                Verdict::Warn,
                "GF_ACTION is 1: the vehicle only warns of a breach of the fence".to_owned(),
            );
        }
        2 => "it holds its position",
        3 => "it returns",
        4 => "it terminates the flight",
        5 => "it lands",
        _ => "it acts",
    };
    (Verdict::Ok, format!("the vehicle enforces it: {words} at a breach (GF_ACTION {action})"))
}

pub(super) fn check(facts: &Facts, against: Against<'_>) -> Vec<Row> {
    let Some(plan) = against.plan else { return Vec::new() };
    let mut rows = Vec::new();
    if plan.fence.is_empty() {
        rows.push(Row::new("fence", Verdict::Ok, "the plan has no geofence"));
    } else {
        rows.extend(area(facts, plan));
        rows.extend(path(plan));
        let (verdict, text) = enforcement(facts.vehicle.autopilot, &facts.parameters);
        rows.push(Row::new("fence", verdict, format!("{}; {text}", plan.fence.describe())));
    }
    rows.extend(own_limits(facts, plan));
    rows
}

/// `MAV_CMD_NAV_LAST`: commands up to it are flown to, others only have a place (a region of interest, the begin of a landing).
const LAST_FLOWN: u16 = 95;
/// The way between two items is looked at in steps of so much, m.
const STEP_M: f64 = 5.0;

/// Where the mission leaves its own fence: at an item, or on the straight way to it.
fn path(plan: &Contents) -> Option<Row> {
    let items = plan.mission.items.iter().enumerate();
    let flown: Vec<_> = items
        .filter(|(_, item)| item.command <= LAST_FLOWN)
        .filter_map(|(k, item)| Some((k + 1, item.place()?)))
        .collect();
    let frame = LocalFrame::new(flown.first()?.1);
    let fence = LocalFence::new(&plan.fence, &frame);
    let mut before = None;
    for (number, place) in flown {
        let here = frame.to_local(place);
        let outside_m = -fence.clearance(here);
        if outside_m > 0.0 {
            let text =
                format!("item {number} lies {outside_m:.0} m outside of what the plan's own geofence allows");
            return Some(Row::new("fence", Verdict::Stop, text));
        }
        if let Some((from, there)) = before.replace((number, here)) {
            let steps = ((here - there).norm() / STEP_M).ceil().min(1e5) as u32;
            let leaves =
                |k: u32| fence.clearance(there + (here - there) * (f64::from(k) / f64::from(steps))) < 0.0;
            if (1..steps).any(leaves) {
                let text = format!(
                    "the way from item {from} to item {number} leaves what the plan's own geofence allows"
                );
                return Some(Row::new("fence", Verdict::Stop, text));
            }
        }
    }
    None
}

/// Whether the fence has an inside, and the vehicle is in it: an autopilot acts on a breach as soon as it is armed, or refuses to arm.
fn area(facts: &Facts, plan: &Contents) -> Option<Row> {
    if let Some(problem) = plan.fence.problem() {
        return Some(Row::new("fence", Verdict::Stop, problem));
    }
    let here = facts.position?;
    let frame = LocalFrame::new(here);
    let clearance_m = LocalFence::new(&plan.fence, &frame).clearance(frame.to_local(here));
    (clearance_m < 0.0).then(|| {
        let text =
            format!("the vehicle stands {:.0} m outside of what the plan's geofence allows", -clearance_m);
        Row::new("fence", Verdict::Stop, text)
    })
}

/// The vehicle's own ceiling and circle against what the plan needs.
fn own_limits(facts: &Facts, plan: &Contents) -> Vec<Row> {
    let read = &facts.parameters;
    let on = |bit: u32| {
        let enabled = read.get("FENCE_ENABLE").is_some_and(|v| v != 0.0);
        enabled && read.get("FENCE_TYPE").is_some_and(|t| t as u32 & bit != 0)
    };
    let (ceiling, circle) = match facts.vehicle.autopilot {
        Autopilot::ArduPilot => (
            on(CEILING).then(|| ("FENCE_ALT_MAX", read.get("FENCE_ALT_MAX"))),
            on(HOME_CIRCLE).then(|| ("FENCE_RADIUS", read.get("FENCE_RADIUS"))),
        ),
        // 0 is no limit.
        Autopilot::Px4 => (
            Some(("GF_MAX_VER_DIST", read.get("GF_MAX_VER_DIST").filter(|v| *v > 0.0))),
            Some(("GF_MAX_HOR_DIST", read.get("GF_MAX_HOR_DIST").filter(|v| *v > 0.0))),
        ),
    };
    let top = plan.mission.items.iter().filter(|i| {
        command::has_altitude(i.command) && i.frame.altitude_reference() == AltitudeReference::Home
    });
    let top_m = top.map(|i| f64::from(i.z)).fold(0.0, f64::max);
    let home = plan.mission.home.map(|h| h.place()).or(facts.position);
    let away_m = home.map_or(0.0, |home| {
        let frame = LocalFrame::new(home);
        let places = plan.mission.items.iter().filter_map(|i| i.place());
        places.map(|p| frame.to_local(p).norm()).fold(0.0, f64::max)
    });
    let broken = |limit: Option<(&str, Option<f64>)>, needed_m: f64, what: &str| match limit {
        Some((name, Some(limit_m))) if needed_m > limit_m => Some(Row::new(
            "fence",
            Verdict::Stop,
            format!(
                "{name} is {limit_m:.0} m and the plan goes {what} {needed_m:.0} m: it breaks the vehicle's own fence"
            ),
        )),
        _ => None,
    };
    broken(ceiling, top_m, "up to").into_iter().chain(broken(circle, away_m, "out to")).collect()
}
