//! What autopilots take: which mission items their firmware refuses, cuts or rewrites, known before the upload.
//!
//! One [table](table::ROWS) holds the rules of ArduPlane, ArduCopter and PX4 with their place in the firmware's source.
//! [`check`] judges a mission by it, [`stored_item`] says what the vehicle will read back. PX4 checks a mission a second time
//! after it has acknowledged it; [`feasibility`] holds those rules.

pub mod document;
pub mod feasibility;
mod rows;
pub mod table;

use crate::airframe::Kind;
use crate::item::{Autopilot, Mission, MissionItem, MissionKind, command};

/// The firmwares that the table distinguishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Firmware {
    /// ArduPilot for fixed wings.
    ArduPlane,
    /// ArduPilot for multirotors.
    ArduCopter,
    /// PX4, for both.
    Px4,
}

impl Firmware {
    /// All, in the table's order.
    pub const ALL: [Self; 3] = [Self::ArduPlane, Self::ArduCopter, Self::Px4];

    /// The firmware that flies this kind of airframe.
    pub fn of(autopilot: Autopilot, kind: Kind) -> Self {
        match (autopilot, kind) {
            (Autopilot::ArduPilot, Kind::FixedWing) => Self::ArduPlane,
            (Autopilot::ArduPilot, Kind::Multirotor) => Self::ArduCopter,
            (Autopilot::Px4, _) => Self::Px4,
        }
    }

    /// Whose firmware it is.
    pub fn autopilot(self) -> Autopilot {
        match self {
            Self::ArduPlane | Self::ArduCopter => Autopilot::ArduPilot,
            Self::Px4 => Autopilot::Px4,
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPlane => "ArduPlane",
            Self::ArduCopter => "ArduCopter",
            Self::Px4 => "PX4",
        }
    }
}

/// A value that the vehicle will hold differently from the one sent.
#[derive(Debug, Clone, PartialEq)]
pub struct Rewrite {
    /// Item, counted from 1 without home.
    pub item: usize,
    /// `MAV_CMD`.
    pub command: u16,
    /// Parameter, 1 to 4; 7 is the altitude.
    pub parameter: u8,
    /// As sent.
    pub sent: f32,
    /// As kept.
    pub kept: f32,
}

impl std::fmt::Display for Rewrite {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = command::describe(self.command);
        let Self { item, parameter, sent, kept, .. } = self;
        write!(f, "item {item} ({name}): parameter {parameter} is kept as {kept} instead of {sent}")
    }
}

/// Why a vehicle would not take a mission.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FirmwareRefusal {
    /// The plan names another autopilot.
    #[error(
        "this plan is for {}, the vehicle runs {}; make it again with an airframe file that has autopilot = \"{}\"",
        .made_for.name(), .vehicle.name(), .vehicle.key()
    )]
    OtherAutopilot {
        /// Whom the plan was made for.
        made_for: Autopilot,
        /// Who would have to fly it.
        vehicle: Autopilot,
    },
    /// A command that the firmware does not take in missions.
    #[error(
        "item {item} ({}, command {command}): {} does not take this command in missions{}",
        command::describe(*.command), .firmware.name(), other_autopilot(*.command, *.firmware)
    )]
    Command {
        /// Item, counted from 1 without home.
        item: usize,
        /// `MAV_CMD`.
        command: u16,
        /// Who refuses.
        firmware: Firmware,
    },
    /// A parameter with a value that the firmware does not take.
    #[error(
        "item {item} ({}, command {command}): {} refuses {value} in parameter {parameter}: {rule}",
        command::describe(*.command), .firmware.name()
    )]
    Parameter {
        /// Item, counted from 1 without home.
        item: usize,
        /// `MAV_CMD`.
        command: u16,
        /// Parameter, 1 to 7.
        parameter: u8,
        /// As the plan has it.
        value: f64,
        /// Who refuses.
        firmware: Firmware,
        /// What is taken, and what to do.
        rule: &'static str,
    },
    /// A frame that the firmware does not take for this command.
    #[error(
        "item {item} ({}, command {command}): {} refuses frame {frame}; write it in frame {wanted}",
        command::describe(*.command), .firmware.name()
    )]
    Frame {
        /// Item, counted from 1 without home.
        item: usize,
        /// `MAV_CMD`.
        command: u16,
        /// As the plan has it.
        frame: u8,
        /// The frame to use.
        wanted: u8,
        /// Who refuses.
        firmware: Firmware,
    },
    /// PX4 would take the mission, and reject it afterwards.
    #[error(transparent)]
    Infeasible(#[from] feasibility::Infeasible),
}

/// Where the other family knows a command, a plan is likely made for it.
fn other_autopilot(number: u16, firmware: Firmware) -> String {
    let other = Firmware::ALL
        .into_iter()
        .filter(|f| f.autopilot() != firmware.autopilot())
        .find(|f| table::row(number, *f).is_some_and(|r| r.taken));
    other.map_or_else(String::new, |f| {
        let name = f.autopilot().name();
        format!("; the plan seems to be for {name}: make it again for {}", firmware.autopilot().name())
    })
}

/// Judges a mission before its upload: what the vehicle would refuse is an error, what it would keep differently is returned.
///
/// `made_for` is the autopilot that a plan names ([`crate::files::plan::PlanFile::autopilot`]), `None` where the file has none. Items are
/// as the plan has them, home apart; commands without a row in the table are judged by the rules for all commands alone.
///
/// # Errors
/// The first rule that the mission breaks, with item, command, parameter and value.
///
/// # Examples
/// ```
/// use gaware_mission::{airframe::Kind, item::{Autopilot, LatLon, Mission, MissionItem, command}, rules};
/// let place = LatLon { lat_deg: 47.4, lon_deg: 8.55 };
/// let circle = MissionItem::at(command::NAV_LOITER_TURNS, [2.0, 0.0, 60.0, f32::NAN], place, 100.0);
/// let mission = Mission { home: None, items: vec![circle] };
/// let refused = rules::check(&mission, None, Autopilot::ArduPilot, Kind::FixedWing);
/// assert!(refused.is_err_and(|e| e.to_string().starts_with("item 1 (loiter turns, command 18): ArduPlane refuses NaN in parameter 4")));
/// ```
pub fn check(
    mission: &Mission,
    made_for: Option<Autopilot>,
    autopilot: Autopilot,
    kind: Kind,
) -> Result<Vec<Rewrite>, FirmwareRefusal> {
    if let Some(made_for) = made_for.filter(|m| *m != autopilot) {
        return Err(FirmwareRefusal::OtherAutopilot { made_for, vehicle: autopilot });
    }
    let firmware = Firmware::of(autopilot, kind);
    let mut rewrites = Vec::new();
    for (k, item) in mission.items.iter().enumerate() {
        check_item(item, k + 1, firmware)?;
        if item.command == command::DO_JUMP && autopilot == Autopilot::ArduPilot {
            check_jump(item, k + 1, mission.items.len(), firmware)?;
        }
        rewrites.extend(differences(item, k + 1, firmware));
    }
    if autopilot == Autopilot::Px4 {
        feasibility::check(mission, kind, &feasibility::Limits::default())?;
    }
    Ok(rewrites)
}

/// `MissionItemProtocol_Waypoints::append_item`: a jump has a target inside the mission.
fn check_jump(
    item: &MissionItem,
    number: usize,
    items: usize,
    firmware: Firmware,
) -> Result<(), FirmwareRefusal> {
    let target = item.params[0];
    if target >= 1.0 && target <= items as f32 {
        return Ok(());
    }
    Err(FirmwareRefusal::Parameter {
        item: number,
        command: item.command,
        parameter: 1,
        value: f64::from(target),
        firmware,
        rule: "a jump goes to an item of this mission; correct its target",
    })
}

fn check_item(item: &MissionItem, number: usize, firmware: Firmware) -> Result<(), FirmwareRefusal> {
    let row = table::row(item.command, firmware);
    if row.is_some_and(|r| !r.taken || r.list != MissionKind::Mission) {
        return Err(FirmwareRefusal::Command { item: number, command: item.command, firmware });
    }
    let refused = |parameter: u8, value: f64, rule: &'static str| {
        Err(FirmwareRefusal::Parameter {
            item: number,
            command: item.command,
            parameter,
            value,
            firmware,
            rule,
        })
    };
    for (k, value) in item.params.into_iter().enumerate() {
        let parameter = k as u8 + 1;
        let nan = row.map_or(firmware == Firmware::Px4, |r| r.nan[k]);
        if value.is_nan() && !nan {
            return refused(parameter, f64::from(value), "write a number; 0 is the vehicle's default");
        }
        if value.is_infinite() {
            return refused(parameter, f64::from(value), "write a finite number");
        }
    }
    if row.map_or(command::has_position(item.command), |r| r.frames.has_place()) {
        check_place(item, &refused)?;
    }
    if let Some(row) = row
        && !row.frames.take(item.frame)
    {
        let (frame, wanted) = (item.frame.0, row.frames.usual().0);
        return Err(FirmwareRefusal::Frame { item: number, command: item.command, frame, wanted, firmware });
    }
    Ok(())
}

/// `check_lat`, `check_lng` and `LOCATION_ALT_MAX_M` of ArduPilot; PX4 takes any place and cannot fly to one off the Earth.
fn check_place(
    item: &MissionItem,
    refused: &dyn Fn(u8, f64, &'static str) -> Result<(), FirmwareRefusal>,
) -> Result<(), FirmwareRefusal> {
    const ALTITUDE_MAX_M: f32 = 83_000.0;
    // Unset is sent as zero, and zero with zero is where the vehicle is; one of them alone would be a place at the equator or in Greenwich.
    for (parameter, own, other, what) in [
        (5, item.x, item.y, "write a latitude, or no longitude either"),
        (6, item.y, item.x, "write a longitude, or no latitude either"),
    ] {
        if own == i32::MAX && other != i32::MAX && other != 0 {
            return refused(parameter, f64::NAN, what);
        }
    }
    let degrees = |v: i32| if v == i32::MAX { 0.0 } else { f64::from(v) * 1e-7 };
    if degrees(item.x).abs() > 90.0 {
        return refused(5, degrees(item.x), "a latitude lies within 90 degrees");
    }
    if degrees(item.y).abs() > 180.0 {
        return refused(6, degrees(item.y), "a longitude lies within 180 degrees");
    }
    if item.z.is_nan() || item.z.abs() >= ALTITUDE_MAX_M {
        return refused(7, f64::from(item.z), "write the altitude in metres, below 83000");
    }
    Ok(())
}

fn differences(item: &MissionItem, number: usize, firmware: Firmware) -> Vec<Rewrite> {
    let kept = stored_item(item, firmware);
    let altitude = (7, item.z, kept.z);
    let params = (1u8..).zip(item.params).zip(kept.params).map(|((n, sent), kept)| (n, sent, kept));
    params
        .chain([altitude])
        // What means nothing to the command may get lost; so may a NaN that is only the default.
        .filter(|(n, sent, kept)| {
            sent != kept && !sent.is_nan() && (*n != 7 || command::has_altitude(item.command))
        })
        .map(|(parameter, sent, kept)| Rewrite { item: number, command: item.command, parameter, sent, kept })
        .collect()
}

/// The item as this firmware keeps and reads it back; an item that it refuses comes back unchanged.
pub fn stored_item(item: &MissionItem, firmware: Firmware) -> MissionItem {
    table::row(item.command, firmware).filter(|r| r.taken).map_or(*item, |row| row.keep(item))
}

/// ArduPilot's altitudes: `int32_t alt = z * 100.0f`, read back as `alt * 0.01f` (`AP_Mission::mavlink_int_to_mission_cmd`,
/// `mission_cmd_to_mavlink_int`).
fn centimetres(z_m: f32) -> f32 {
    // A cast of a float cuts toward zero.
    (z_m * 100.0) as i32 as f32 * 0.01
}

/// The altitude that ArduPilot keeps as the centimetre nearest to this one, however often it is read back and sent again: cutting
/// `50.12_f32 * 100` gives 5011.
pub fn surviving_altitude(z_m: f32) -> f32 {
    let wanted = (f64::from(z_m) * 100.0).round();
    if !wanted.is_finite() || wanted.abs() >= f64::from(1 << 23) {
        return z_m;
    }
    let mut sent = (wanted / 100.0) as f32;
    for _ in 0..4 {
        if f64::from((sent * 100.0) as i32) == wanted {
            return sent;
        }
        // Cut toward zero: a little further away from it.
        sent = if wanted < 0.0 { sent.next_down() } else { sent.next_up() };
    }
    z_m
}

#[cfg(test)]
mod tests;
