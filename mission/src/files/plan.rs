//! QGroundControl's `.plan` files: JSON with mission, geofence and rally points (the "Plan File Format" of its developer
//! guide). Survey and corridor items carry the simple items they stand for and are expanded; others are refused.

use super::shortest;
use crate::airframe::Airframe;
use crate::fence::{Fence, FenceCircle, FencePolygon};
use crate::identity::Identity;
use crate::item::{Autopilot, Frame, Home, LatLon, Mission, MissionItem, command};
use serde::Deserialize;
use serde_json::{Value, json};

/// What a `.plan` file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanFile {
    /// Items and home.
    pub mission: Mission,
    /// Geofence.
    pub fence: Fence,
    /// Rally points: latitude, longitude (deg), altitude above home (m).
    pub rally_points: Vec<[f64; 3]>,
    /// Cruise speed of the plan, m/s.
    pub cruise_speed_m_per_s: f64,
    /// Hover speed of the plan, m/s.
    pub hover_speed_m_per_s: f64,
    /// `MAV_AUTOPILOT`: 3 ArduPilot, 12 PX4.
    pub firmware_type: u8,
    /// `MAV_TYPE`: 1 fixed wing, 2 quadrotor.
    pub vehicle_type: u8,
    /// Of a backup: the vehicle that it was read from.
    pub backup_of: Option<Identity>,
    /// The airframe that it was planned for, with its limits, where this program planned it.
    pub airframe: Option<Airframe>,
}

impl PlanFile {
    /// A plan for this autopilot and `MAV_TYPE`, speeds as QGroundControl's own defaults.
    pub fn new(mission: Mission, fence: Fence, autopilot: Autopilot, vehicle_type: u8) -> Self {
        Self {
            mission,
            fence,
            rally_points: Vec::new(),
            cruise_speed_m_per_s: 15.0,
            hover_speed_m_per_s: 5.0,
            firmware_type: match autopilot {
                Autopilot::ArduPilot => 3,
                Autopilot::Px4 => 12,
            },
            vehicle_type,
            backup_of: None,
            airframe: None,
        }
    }

    /// The autopilot that the plan was made for, where it names one of the two.
    pub fn autopilot(&self) -> Option<Autopilot> {
        match self.firmware_type {
            3 => Some(Autopilot::ArduPilot),
            12 => Some(Autopilot::Px4),
            _ => None,
        }
    }
}

/// Why a `.plan` file cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Not JSON, or a field of the wrong type.
    #[error("line {line}, column {column}: {message}")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser said.
        message: String,
    },
    /// A field of the wrong type in a document that is part of another file.
    #[error("{0}")]
    Field(String),
    /// JSON, but no plan.
    #[error("fileType is \"{0}\", a mission plan has \"Plan\"")]
    FileType(String),
    /// A later format.
    #[error("{what} has version {found}, this program reads version {known}; save it with QGroundControl 4")]
    Version {
        /// Part of the file.
        what: &'static str,
        /// As written.
        found: u32,
        /// What is read.
        known: u32,
    },
    /// An item that cannot be used.
    #[error("mission item {number}: {reason}")]
    Item {
        /// Item in the file, from 1.
        number: usize,
        /// Why.
        reason: String,
    },
    /// A position that is none.
    #[error("{what}: {reason}")]
    Place {
        /// Part of the file.
        what: String,
        /// Why.
        reason: &'static str,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct File {
    file_type: String,
    version: u32,
    mission: FileMission,
    #[serde(default)]
    geo_fence: FileFence,
    #[serde(default)]
    rally_points: FileRally,
    #[serde(default)]
    backup_of: Option<Value>,
    #[serde(default)]
    airframe: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct FileMission {
    version: u32,
    #[serde(default = "default_cruise")]
    cruise_speed: f64,
    #[serde(default = "default_hover")]
    hover_speed: f64,
    #[serde(default)]
    firmware_type: u8,
    #[serde(default)]
    vehicle_type: u8,
    #[serde(default)]
    planned_home_position: Option<[f64; 3]>,
    items: Vec<FileItem>,
}

fn default_cruise() -> f64 {
    15.0
}

fn default_hover() -> f64 {
    5.0
}

/// Simple and complex items in one: which fields must be there depends on `type`.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct FileItem {
    r#type: String,
    #[serde(default)]
    command: Option<u16>,
    #[serde(default)]
    frame: Option<u8>,
    #[serde(default)]
    auto_continue: Option<bool>,
    #[serde(default)]
    do_jump_id: Option<u32>,
    #[serde(default)]
    params: Vec<Option<f64>>,
    #[serde(default)]
    complex_item_type: Option<String>,
    #[serde(default, rename = "TransectStyleComplexItem")]
    transect: Option<Transect>,
}

#[derive(Deserialize)]
struct Transect {
    #[serde(default, rename = "Items")]
    items: Vec<FileItem>,
}

#[derive(Deserialize, Default)]
struct FileFence {
    #[serde(default)]
    circles: Vec<FileCircle>,
    #[serde(default)]
    polygons: Vec<FilePolygon>,
}

#[derive(Deserialize)]
struct FileCircle {
    circle: CircleShape,
    inclusion: bool,
}

#[derive(Deserialize)]
struct CircleShape {
    center: [f64; 2],
    radius: f64,
}

#[derive(Deserialize)]
struct FilePolygon {
    inclusion: bool,
    polygon: Vec<[f64; 2]>,
}

#[derive(Deserialize, Default)]
struct FileRally {
    #[serde(default)]
    points: Vec<[f64; 3]>,
}

/// Largest altitude, radius or speed of a file that is meant, m or m/s.
const LARGEST: f64 = 1e6;

/// Reads a `.plan` file.
///
/// # Errors
/// Not JSON, another kind or version of file, complex items without their simple ones, places off the Earth.
pub fn read(text: &str) -> Result<PlanFile, PlanError> {
    let file: File = serde_json::from_str(text.trim_start_matches('\u{feff}')).map_err(|e| {
        PlanError::Syntax { line: e.line(), column: e.column(), message: without_position(&e) }
    })?;
    contents(file)
}

/// Reads a plan that is part of another document.
///
/// # Errors
/// As [`read`].
pub fn from_document(document: Value) -> Result<PlanFile, PlanError> {
    contents(serde_json::from_value(document).map_err(|e| PlanError::Field(e.to_string()))?)
}

fn contents(file: File) -> Result<PlanFile, PlanError> {
    if file.file_type != "Plan" {
        return Err(PlanError::FileType(file.file_type));
    }
    for (what, found, known) in [("the file", file.version, 1), ("the mission", file.mission.version, 2)] {
        if found != known {
            return Err(PlanError::Version { what, found, known });
        }
    }
    for (what, value) in
        [("cruiseSpeed", file.mission.cruise_speed), ("hoverSpeed", file.mission.hover_speed)]
    {
        bounded(|| what.to_owned(), value)?;
    }
    for (k, [lat, lon, alt]) in file.rally_points.points.iter().enumerate() {
        let what = || format!("rally point {}", k + 1);
        place(what, [*lat, *lon])?;
        bounded(what, *alt)?;
    }
    let home = file.mission.planned_home_position.map(read_home).transpose()?;
    let items = read_items(&file.mission.items)?;
    Ok(PlanFile {
        mission: Mission { home, items },
        fence: read_fence(&file.geo_fence)?,
        rally_points: file.rally_points.points,
        cruise_speed_m_per_s: file.mission.cruise_speed,
        hover_speed_m_per_s: file.mission.hover_speed,
        firmware_type: file.mission.firmware_type,
        vehicle_type: file.mission.vehicle_type,
        // What another program writes under these names is none of ours.
        airframe: file.airframe.and_then(|v| serde_json::from_value(v).ok()),
        backup_of: file.backup_of.and_then(|v| serde_json::from_value(v).ok()),
    })
}

/// The parser's words without its own " at line 3 column 7".
fn without_position(e: &serde_json::Error) -> String {
    let text = e.to_string();
    text.rsplit_once(" at line ").map_or(text.clone(), |(message, _)| message.to_owned())
}

fn place(what: impl FnOnce() -> String, [lat_deg, lon_deg]: [f64; 2]) -> Result<LatLon, PlanError> {
    let place = LatLon { lat_deg, lon_deg };
    if place.is_valid() {
        return Ok(place);
    }
    Err(PlanError::Place { what: what(), reason: "latitude and longitude must be degrees on the Earth" })
}

/// A number that can be meant: what is larger does not survive the single precision of an item.
fn bounded(what: impl FnOnce() -> String, value: f64) -> Result<(), PlanError> {
    if value.abs() <= LARGEST {
        return Ok(());
    }
    Err(PlanError::Place { what: what(), reason: "altitudes, radii and speeds must be within 1000000" })
}

fn read_home([lat, lon, alt]: [f64; 3]) -> Result<Home, PlanError> {
    bounded(|| "plannedHomePosition".to_owned(), alt)?;
    let (lat_e7, lon_e7) = place(|| "plannedHomePosition".to_owned(), [lat, lon])?.to_e7();
    Ok(Home { lat_e7, lon_e7, alt_m: alt as f32 })
}

fn read_items(items: &[FileItem]) -> Result<Vec<MissionItem>, PlanError> {
    let mut flat: Vec<(usize, &FileItem)> = Vec::new();
    for (k, item) in items.iter().enumerate() {
        match (item.r#type.as_str(), &item.transect) {
            ("SimpleItem", _) => flat.push((k + 1, item)),
            ("ComplexItem", Some(t)) if !t.items.is_empty() => {
                flat.extend(t.items.iter().map(|i| (k + 1, i)))
            }
            ("ComplexItem", _) => {
                let kind = item.complex_item_type.as_deref().unwrap_or("of unknown type");
                let reason = format!(
                    "the complex item \"{kind}\" holds no simple items; replace it by waypoints in QGroundControl"
                );
                return Err(PlanError::Item { number: k + 1, reason });
            }
            (other, _) => {
                let reason = format!("type is \"{other}\", known are SimpleItem and ComplexItem");
                return Err(PlanError::Item { number: k + 1, reason });
            }
        }
    }
    let mut found = Vec::new();
    for (number, item) in &flat {
        let bad = |reason: String| PlanError::Item { number: *number, reason };
        let mut read = read_item(item).map_err(bad)?;
        if read.command == command::DO_JUMP {
            // A jump names the doJumpId of its target; a mission counts items from 1.
            let id = read.params[0];
            let target = flat.iter().position(|(_, i)| i.do_jump_id.is_some_and(|j| j as f32 == id));
            // QGroundControl numbers in order; a file without ids is taken to do so too.
            let ids = flat.iter().any(|(_, i)| i.do_jump_id.is_some());
            match target {
                Some(index) => read.params[0] = (index + 1) as f32,
                None if ids => return Err(bad(format!("it jumps to item {id}, which does not exist"))),
                None => {}
            }
        }
        found.push(read);
    }
    Ok(found)
}

fn read_item(item: &FileItem) -> Result<MissionItem, String> {
    let (Some(number), Some(frame)) = (item.command, item.frame) else {
        return Err("command or frame is missing".to_owned());
    };
    let Ok(p) = <[Option<f64>; 7]>::try_from(item.params.clone()) else {
        return Err(format!("7 params expected, found {}", item.params.len()));
    };
    let frame = Frame(frame);
    let coordinate = |v: Option<f64>, limit: f64| match v {
        None => Ok(i32::MAX),
        Some(v) if !frame.is_global() && v.abs() < f64::from(i32::MAX) => Ok(v.round() as i32),
        Some(v) if v.abs() <= limit => Ok((v * 1e7).round() as i32),
        Some(v) => Err(format!("{v} is no latitude or longitude in degrees")),
    };
    if let Some(k) = p.iter().position(|v| v.is_some_and(|v| v.abs() > f64::from(f32::MAX))) {
        let value = p[k].unwrap_or_default();
        return Err(format!("parameter {} is {value:e}, more than an item can hold", k + 1));
    }
    if let Some(z) = p[6].filter(|z| z.abs() > LARGEST) {
        return Err(format!("an altitude of {z:e} m is none"));
    }
    let float = |v: Option<f64>| v.map_or(f32::NAN, |v| v as f32);
    Ok(MissionItem {
        command: number,
        frame,
        autocontinue: item.auto_continue.unwrap_or(true),
        params: [float(p[0]), float(p[1]), float(p[2]), float(p[3])],
        x: coordinate(p[4], 90.0)?,
        y: coordinate(p[5], 180.0)?,
        z: float(p[6]),
    })
}

fn read_fence(file: &FileFence) -> Result<Fence, PlanError> {
    let mut fence = Fence::default();
    for (k, c) in file.circles.iter().enumerate() {
        let what = || format!("geofence circle {}", k + 1);
        if c.circle.radius.is_nan() || c.circle.radius <= 0.0 {
            return Err(PlanError::Place { what: what(), reason: "the radius must be positive" });
        }
        bounded(what, c.circle.radius)?;
        let center = place(what, c.circle.center)?;
        fence.circles.push(FenceCircle { inclusion: c.inclusion, center, radius_m: c.circle.radius });
    }
    for (k, p) in file.polygons.iter().enumerate() {
        let what = || format!("geofence polygon {}", k + 1);
        if p.polygon.len() < 3 {
            return Err(PlanError::Place { what: what(), reason: "a polygon has at least three corners" });
        }
        let corners = p.polygon.iter().map(|c| place(what, *c)).collect::<Result<_, _>>()?;
        fence.polygons.push(FencePolygon { inclusion: p.inclusion, corners });
    }
    Ok(fence)
}

/// Writes a `.plan` file, indented as QGroundControl does.
pub fn write(plan: &PlanFile) -> String {
    format!("{:#}\n", document(plan))
}

/// The plan as part of another document.
pub fn document(plan: &PlanFile) -> Value {
    let items: Vec<Value> =
        plan.mission.items.iter().enumerate().map(|(k, i)| write_item(k + 1, i)).collect();
    let home = plan.mission.home.map(|h| {
        let p = h.place();
        json!([degrees(p.lat_deg), degrees(p.lon_deg), shortest(h.alt_m)])
    });
    let circles: Vec<Value> = plan
        .fence
        .circles
        .iter()
        .map(|c| {
            json!({"circle": {"center": [c.center.lat_deg, c.center.lon_deg], "radius": c.radius_m},
               "inclusion": c.inclusion, "version": 1})
        })
        .collect();
    let polygons: Vec<Value> = plan
        .fence
        .polygons
        .iter()
        .map(|p| {
            let corners: Vec<[f64; 2]> = p.corners.iter().map(|c| [c.lat_deg, c.lon_deg]).collect();
            json!({"inclusion": p.inclusion, "polygon": corners, "version": 1})
        })
        .collect();
    let mut document = json!({
        "fileType": "Plan",
        "geoFence": {"circles": circles, "polygons": polygons, "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": plan.cruise_speed_m_per_s,
            "firmwareType": plan.firmware_type,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": plan.hover_speed_m_per_s,
            "items": items,
            "plannedHomePosition": home,
            "vehicleType": plan.vehicle_type,
            "version": 2
        },
        "rallyPoints": {"points": plan.rally_points, "version": 2},
        "version": 1
    });
    if let Some(fields) = document.as_object_mut() {
        fields.extend(plan.backup_of.map(|v| ("backupOf".to_owned(), json!(v))));
        fields.extend(plan.airframe.as_ref().map(|a| ("airframe".to_owned(), json!(a))));
    }
    document
}

/// Seven decimals: what an integer of 1e-7 deg means.
fn degrees(value: f64) -> f64 {
    (value * 1e7).round() / 1e7
}

fn write_item(number: usize, item: &MissionItem) -> Value {
    let float = |v: f32| if v.is_nan() { Value::Null } else { json!(shortest(v)) };
    let coordinate = |v: i32| match v {
        i32::MAX => Value::Null,
        v if item.frame.is_global() => json!(degrees(f64::from(v) * 1e-7)),
        v => json!(v),
    };
    let [p1, p2, p3, p4] = item.params.map(float);
    json!({
        "autoContinue": item.autocontinue,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame.in_files().0,
        "params": [p1, p2, p3, p4, coordinate(item.x), coordinate(item.y), float(item.z)],
        "type": "SimpleItem"
    })
}

#[cfg(test)]
mod tests;
