//! Which vehicle, of which kind, where, with which firmware, and what it sends.

use super::{Against, FIRST_ITEM, Facts, Row, STATE, Verdict};
use crate::mission_link::files::Contents;
use crate::mission_link::vehicle::{identity_words, type_words};
use gaware_mission::fence::LocalFrame;
use gaware_mission::identity::{Carrier, Sameness};
use gaware_mission::item::{Autopilot, LatLon};

/// A plan that begins farther away than this was made for another field, m.
const FIELD_M: f64 = 2000.0;
/// A home that is farther away than this is not where the vehicle stands, m.
const HOME_M: f64 = 200.0;
/// Below this rate a maneuver is not followed well, Hz, and below that not at all.
const GOOD_RATE_HZ: f64 = 50.0;
const LEAST_RATE_HZ: f64 = 20.0;
/// The first firmware with a geofence in the mission protocol: ArduPilot 4.0, PX4 1.9.
const FIRST_ARDUPILOT: [u8; 3] = [4, 0, 0];
const FIRST_PX4: [u8; 3] = [1, 9, 0];
/// Messages of which one is enough.
const INERTIAL: [&str; 3] = ["HIGHRES_IMU", "RAW_IMU", "SCALED_IMU"];

pub(super) fn check(facts: &Facts, against: Against<'_>) -> Vec<Row> {
    let mut rows = vec![choice(facts)];
    rows.extend(kind(facts, against));
    rows.extend(against.plan.and_then(|plan| backup(facts, plan)));
    if let Some(plan) = against.plan {
        rows.extend(places(facts, plan));
    }
    rows.push(state(facts));
    rows.push(firmware(facts));
    rows.extend(loop_rate(facts));
    rows.extend(streams(facts));
    rows
}

fn choice(facts: &Facts) -> Row {
    let me = facts.vehicle;
    let row = |verdict, text: String| Row::new("vehicle", verdict, text);
    if let Some(screen) = facts.on_screen.filter(|id| *id != me.address.system) {
        return row(
            Verdict::Stop,
            format!("{me} is not the vehicle on the screen, which is system {screen}"),
        );
    }
    if facts.others.is_empty() {
        return match me.uid {
            Some(_) => row(Verdict::Ok, me.to_string()),
            None => row(Verdict::Ok, format!("{me}; it gives no hardware id")),
        };
    }
    let all: Vec<String> = std::iter::once(&me).chain(&facts.others).map(ToString::to_string).collect();
    row(
        Verdict::Stop,
        format!(
            "there are {} vehicles on the link: {}; choose one with --vehicle",
            all.len(),
            all.join(" and ")
        ),
    )
}

/// A backup goes back into the vehicle that it was read from.
fn backup(facts: &Facts, plan: &Contents) -> Option<Row> {
    let (meant, here) = (plan.backup_of?, facts.vehicle.identity());
    let row = |verdict, text| Some(Row::new("backup", verdict, text));
    let (words, connected) = (identity_words(&meant), identity_words(&here));
    match meant.is(&here) {
        Sameness::Same => row(Verdict::Ok, format!("the file is a backup of this vehicle, {words}")),
        Sameness::Other => row(
            Verdict::Stop,
            format!("the file is a backup of {words}; connected is another vehicle, {connected}"),
        ),
        Sameness::Unproven => row(
            Verdict::Warn,
            format!(
                "the file is a backup of {words}; without a hardware id of both it is not certain that this is the same vehicle"
            ),
        ),
    }
}

fn kind(facts: &Facts, against: Against<'_>) -> Vec<Row> {
    let (vehicle, row) = (facts.vehicle, |verdict, text: String| Row::new("type", verdict, text));
    let mut rows = Vec::new();
    if let Some(plan) = against.plan {
        if let Some(other) = plan.planned_for.filter(|a| *a != vehicle.autopilot) {
            let text = format!("the plan was made for {other}, the vehicle runs {}", vehicle.autopilot);
            rows.push(row(Verdict::Stop, text));
        }
        let wings = |mav_type| Carrier::of(mav_type)?.is_fixed_wing();
        if let (Some(planned), Some(real)) = (plan.mav_type, vehicle.is_fixed_wing())
            && wings(planned).is_some_and(|p| p != real)
        {
            let planned = type_words(planned);
            let text =
                format!("the plan was made for a {planned}, the vehicle is a {}", vehicle.type_words());
            rows.push(row(Verdict::Stop, text));
        }
    }
    if let Some(airframe) = against.airframe {
        let described = if airframe.is_fixed_wing() { "fixed wing" } else { "multirotor" };
        if vehicle.is_fixed_wing().is_some_and(|wings| wings != airframe.is_fixed_wing()) {
            let text = format!(
                "the airframe {} is a {described}, the vehicle is a {}",
                airframe.name,
                vehicle.type_words()
            );
            rows.push(row(Verdict::Stop, text));
        }
        if airframe.autopilot != vehicle.autopilot {
            let text = format!(
                "the airframe {} is flown by {}, the vehicle runs {}",
                airframe.name, airframe.autopilot, vehicle.autopilot
            );
            rows.push(row(Verdict::Stop, text));
        }
    }
    if rows.is_empty() {
        rows.push(row(Verdict::Ok, format!("{}, {}", vehicle.type_words(), vehicle.autopilot)));
    }
    rows
}

/// Metres between two places; across the globe a lower bound that is far above any limit here.
pub(super) fn distance_m(a: LatLon, b: LatLon) -> f64 {
    LocalFrame::new(a).to_local(b).norm()
}

/// "340 m", "820 km".
fn far(metres: f64) -> String {
    if metres < 10_000.0 { format!("{metres:.0} m") } else { format!("{:.0} km", metres / 1000.0) }
}

fn places(facts: &Facts, plan: &Contents) -> Vec<Row> {
    let row = |verdict, text: String| Row::new("place", verdict, text);
    let first = plan.mission.items.iter().enumerate().find_map(|(k, i)| Some((k + 1, i.place()?)));
    let home = plan.mission.home.map(|h| h.place());
    let Some(vehicle) = facts.position else {
        let text = "the vehicle reports no position; whether the plan belongs to this place is not known";
        return vec![row(Verdict::Warn, text.to_owned())];
    };
    let mut rows = Vec::new();
    if let Some((number, place)) = first {
        let metres = distance_m(vehicle, place);
        let text = format!("item {number}, the first with a place, is {} from the vehicle", far(metres));
        if metres > FIELD_M {
            rows.push(row(
                Verdict::Stop,
                format!("{text}; a plan for this field begins within {}", far(FIELD_M)),
            ));
        } else {
            rows.push(row(Verdict::Ok, text));
        }
    }
    if let Some(home) = home {
        let metres = distance_m(vehicle, home);
        let text = format!("the plan's home is {} from the vehicle", far(metres));
        if metres > FIELD_M {
            rows.push(row(Verdict::Stop, text));
        } else if metres > HOME_M {
            let why = "altitudes and the way home count from where the vehicle is armed, not from there";
            rows.push(row(Verdict::Warn, format!("{text}; {why}")));
        } else {
            rows.push(row(Verdict::Ok, text));
        }
    }
    rows
}

fn state(facts: &Facts) -> Row {
    let state = facts.vehicle.state;
    match state.objection() {
        Some(why) => Row::new(STATE, Verdict::Stop, why),
        None if state.armed => Row::new(STATE, Verdict::Warn, "the vehicle is armed"),
        None => Row::new(STATE, Verdict::Ok, "disarmed"),
    }
}

/// Where the mission would begin: the index of an earlier flight survives everything but an order.
pub(super) fn current_item(facts: &Facts, plan: &Contents) -> Option<Row> {
    let row = |verdict, text: String| Some(Row::new(FIRST_ITEM, verdict, text));
    let first = plan.mission.first_index(facts.vehicle.autopilot);
    match facts.current_item {
        None => row(
            Verdict::Warn,
            "where the mission would begin is not known: the vehicle sends no MISSION_CURRENT".to_owned(),
        ),
        Some(seq) if seq > first => row(
            Verdict::Stop,
            format!(
                "the current item is {seq}: the vehicle would skip those before it, the take-off among them; \
                 \"gaware mission upload\" begins with the first"
            ),
        ),
        Some(_) => row(Verdict::Ok, "begins with its first item".to_owned()),
    }
}

fn firmware(facts: &Facts) -> Row {
    let autopilot = facts.vehicle.autopilot;
    let Some([major, minor, patch]) = facts.firmware else {
        let text =
            format!("{autopilot} of unknown version: it does not answer the request for AUTOPILOT_VERSION");
        return Row::new("firmware", Verdict::Warn, text);
    };
    let text = format!("{autopilot} {major}.{minor}.{patch}");
    let first = match autopilot {
        Autopilot::ArduPilot => FIRST_ARDUPILOT,
        Autopilot::Px4 => FIRST_PX4,
    };
    if [major, minor, patch] < first {
        let [a, b, _] = first;
        return Row::new("firmware", Verdict::Warn, format!("{text} is older than {a}.{b}: not tested"));
    }
    Row::new("firmware", Verdict::Ok, text)
}

/// ArduPilot reports its loop rate by a parameter; PX4's inertial messages do not depend on one.
fn loop_rate(facts: &Facts) -> Option<Row> {
    let loop_hz = facts.parameters.get("SCHED_LOOP_RATE")?;
    // 1.25 loops, cut to whole milliseconds: `GCS_MAVLINK::cap_message_interval`.
    let imu_hz = 1e3 / (1250.0 / loop_hz.max(1.0)).floor().max(1.0);
    let text = format!("SCHED_LOOP_RATE is {loop_hz:.0}: inertial messages at {imu_hz:.0} Hz at most");
    Some(if imu_hz < LEAST_RATE_HZ {
        Row::new("rate", Verdict::Stop, format!("{text}, too slow for any maneuver ({LEAST_RATE_HZ:.0} Hz)"))
    } else if imu_hz < GOOD_RATE_HZ {
        Row::new("rate", Verdict::Warn, format!("{text}; {GOOD_RATE_HZ:.0} Hz or more are better"))
    } else {
        Row::new("rate", Verdict::Ok, text)
    })
}

fn streams(facts: &Facts) -> Option<Row> {
    if facts.streams.is_empty() {
        return None;
    }
    let names = |works: bool| -> Vec<&str> {
        facts.streams.iter().filter(|s| s.works == works).map(|s| s.name).collect()
    };
    let (come, missing) = (names(true), names(false));
    let row = |verdict, text: String| Some(Row::new("messages", verdict, text));
    if !come.iter().any(|n| INERTIAL.contains(n)) {
        return row(Verdict::Stop, format!("the vehicle sends none of {} on request", INERTIAL.join(", ")));
    }
    let needed: Vec<&str> = missing.into_iter().filter(|n| !INERTIAL.contains(n)).collect();
    if !needed.is_empty() {
        return row(Verdict::Stop, format!("the vehicle does not send {} on request", needed.join(", ")));
    }
    row(Verdict::Ok, format!("{} come on request", come.join(", ")))
}
