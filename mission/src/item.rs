//! Missions as autopilots understand them: commands, frames and items with MAVLink's numbers, home apart.
//!
//! An item holds the fields of `MISSION_ITEM_INT` and nothing of its sequence number: where home stands and how items are
//! counted differs between autopilots and files, see [`Mission::wire_items`].

use crate::rules::surviving_altitude;
use serde::{Deserialize, Serialize};

pub mod command;

/// A `MAV_FRAME`, kept as its number so that nothing a file holds is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Frame(pub u8);

/// What an altitude is counted from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AltitudeReference {
    /// Mean sea level.
    MeanSeaLevel,
    /// Home.
    Home,
    /// The ground below.
    Terrain,
    /// The frame has none, or one that this program does not use.
    None,
}

impl Frame {
    /// Latitude and longitude, altitude above mean sea level.
    pub const GLOBAL: Self = Self(0);
    /// Not a position: the frame of `DO_` commands.
    pub const MISSION: Self = Self(2);
    /// Altitude above home.
    pub const GLOBAL_RELATIVE_ALT: Self = Self(3);
    /// As [`Self::GLOBAL`], integers.
    pub const GLOBAL_INT: Self = Self(5);
    /// As [`Self::GLOBAL_RELATIVE_ALT`], integers: what this program writes for positions.
    pub const GLOBAL_RELATIVE_ALT_INT: Self = Self(6);
    /// Altitude above terrain.
    pub const GLOBAL_TERRAIN_ALT: Self = Self(10);
    /// As [`Self::GLOBAL_TERRAIN_ALT`], integers.
    pub const GLOBAL_TERRAIN_ALT_INT: Self = Self(11);

    /// What altitudes in this frame are counted from.
    pub fn altitude_reference(self) -> AltitudeReference {
        match self.0 {
            0 | 5 => AltitudeReference::MeanSeaLevel,
            3 | 6 => AltitudeReference::Home,
            10 | 11 => AltitudeReference::Terrain,
            _ => AltitudeReference::None,
        }
    }

    /// The frame as files hold it: with float positions; the `_INT` ones are a matter of the wire.
    #[must_use]
    pub fn in_files(self) -> Self {
        match self {
            Self::GLOBAL_INT => Self::GLOBAL,
            Self::GLOBAL_RELATIVE_ALT_INT => Self::GLOBAL_RELATIVE_ALT,
            Self::GLOBAL_TERRAIN_ALT_INT => Self::GLOBAL_TERRAIN_ALT,
            frame => frame,
        }
    }

    /// The frame as the wire wants it: the `_INT` ones for positions.
    #[must_use]
    pub fn on_wire(self) -> Self {
        match self {
            Self::GLOBAL => Self::GLOBAL_INT,
            Self::GLOBAL_RELATIVE_ALT => Self::GLOBAL_RELATIVE_ALT_INT,
            Self::GLOBAL_TERRAIN_ALT => Self::GLOBAL_TERRAIN_ALT_INT,
            frame => frame,
        }
    }

    /// Whether x and y are latitude and longitude.
    pub fn is_global(self) -> bool {
        self.altitude_reference() != AltitudeReference::None
    }
}

/// A place on the map, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LatLon {
    /// Latitude, deg.
    pub lat_deg: f64,
    /// Longitude, deg.
    pub lon_deg: f64,
}

impl LatLon {
    /// From integers of 1e-7 deg.
    pub fn from_e7(lat_e7: i32, lon_e7: i32) -> Self {
        Self { lat_deg: f64::from(lat_e7) * 1e-7, lon_deg: f64::from(lon_e7) * 1e-7 }
    }

    /// To integers of 1e-7 deg, rounded.
    pub fn to_e7(self) -> (i32, i32) {
        // A cast of a float saturates; latitudes and longitudes stay far from the ends.
        ((self.lat_deg * 1e7).round() as i32, (self.lon_deg * 1e7).round() as i32)
    }

    /// Whether it lies on the Earth.
    pub fn is_valid(self) -> bool {
        self.lat_deg.abs() <= 90.0 && self.lon_deg.abs() <= 180.0
    }
}

/// Home: where relative altitudes start and the vehicle returns to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Home {
    /// Latitude, 1e-7 deg.
    pub lat_e7: i32,
    /// Longitude, 1e-7 deg.
    pub lon_e7: i32,
    /// Altitude above mean sea level, m.
    pub alt_m: f32,
}

impl Home {
    /// The place without its altitude.
    pub fn place(self) -> LatLon {
        LatLon::from_e7(self.lat_e7, self.lon_e7)
    }
}

/// One mission item; the fields of `MISSION_ITEM_INT`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MissionItem {
    /// `MAV_CMD`, see [`command`].
    pub command: u16,
    /// Frame of x, y and z.
    pub frame: Frame,
    /// Whether the mission goes on by itself after this item.
    pub autocontinue: bool,
    /// Parameters 1 to 4; NaN is "the vehicle's default".
    pub params: [f32; 4],
    /// Latitude in 1e-7 deg in global frames, parameter 5 as an integer otherwise; `i32::MAX` is "here" or unset.
    pub x: i32,
    /// Longitude in 1e-7 deg in global frames, parameter 6 as an integer otherwise; `i32::MAX` is "here" or unset.
    pub y: i32,
    /// Altitude in m, or parameter 7.
    pub z: f32,
}

impl MissionItem {
    /// An item at a place, altitude above home in m.
    pub fn at(command: u16, params: [f32; 4], place: LatLon, alt_m: f32) -> Self {
        let (x, y) = place.to_e7();
        Self { command, frame: Frame::GLOBAL_RELATIVE_ALT_INT, autocontinue: true, params, x, y, z: alt_m }
    }

    /// A command without a place.
    pub fn action(command: u16, params: [f32; 4]) -> Self {
        Self { command, frame: Frame::MISSION, autocontinue: true, params, x: 0, y: 0, z: 0.0 }
    }

    /// The place of an item that has one.
    pub fn place(&self) -> Option<LatLon> {
        let meant = command::has_position(self.command)
            && self.frame.is_global()
            && self.x != i32::MAX
            && self.y != i32::MAX
            // Zero and zero means "where the vehicle is" to autopilots.
            && (self.x, self.y) != (0, 0);
        meant.then(|| LatLon::from_e7(self.x, self.y))
    }
}

/// The two families of autopilots and their habits with missions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Autopilot {
    /// Home at sequence 0, stored in place, fields rounded.
    ArduPilot,
    /// First item at sequence 0, replaced as a whole.
    Px4,
}

impl Autopilot {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot => "ArduPilot",
            Self::Px4 => "PX4",
        }
    }

    /// Its name in files.
    pub fn key(self) -> &'static str {
        match self {
            Self::ArduPilot => "ardupilot",
            Self::Px4 => "px4",
        }
    }

    /// The heading of an item that leaves the nose where it is: NaN on PX4, where 0 is north; ArduPilot does not use it and refuses NaN
    /// in most commands.
    pub fn free_heading(self) -> f32 {
        match self {
            Self::ArduPilot => 0.0,
            Self::Px4 => f32::NAN,
        }
    }
}

impl std::fmt::Display for Autopilot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// The three lists of items that a vehicle keeps (`MAV_MISSION_TYPE`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MissionKind {
    /// What is flown.
    #[default]
    Mission,
    /// The geofence.
    Fence,
    /// Rally points.
    Rally,
}

impl MissionKind {
    /// `MAV_MISSION_TYPE`.
    pub fn number(self) -> u8 {
        match self {
            Self::Mission => 0,
            Self::Fence => 1,
            Self::Rally => 2,
        }
    }
}

impl std::fmt::Display for MissionKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Mission => "mission",
            Self::Fence => "geofence",
            Self::Rally => "list of rally points",
        })
    }
}

/// A mission: items in the order they are flown, home apart.
///
/// `DO_JUMP` counts items from 1, as `.plan` files, `.waypoints` files and ArduPilot do.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Mission {
    /// Home, where it is known.
    pub home: Option<Home>,
    /// What is flown.
    pub items: Vec<MissionItem>,
}

impl Mission {
    /// The items by sequence number as this autopilot wants them on the wire.
    pub fn wire_items(&self, autopilot: Autopilot) -> Vec<MissionItem> {
        match autopilot {
            Autopilot::ArduPilot => self.home_first().into_iter().map(for_ardupilot).collect(),
            Autopilot::Px4 => self.items.iter().map(|i| shift_jump(*i, -1.0)).collect(),
        }
    }

    /// The index by which this autopilot reports that the mission begins with its first item: 0 on PX4; on ArduPilot anything up to the first
    /// command that is flown, since the others before it are done on the way.
    pub fn first_index(&self, autopilot: Autopilot) -> u16 {
        match autopilot {
            Autopilot::Px4 => 0,
            Autopilot::ArduPilot => {
                let flown = self.items.iter().position(|i| i.command <= command::NAV_LAST);
                u16::try_from(flown.unwrap_or(0) + 1).unwrap_or(u16::MAX)
            }
        }
    }

    /// Home as a waypoint, then the items: the order of ArduPilot and of `.waypoints` files.
    pub(crate) fn home_first(&self) -> Vec<MissionItem> {
        let home = self.home.unwrap_or(Home { lat_e7: 0, lon_e7: 0, alt_m: 0.0 });
        let home = MissionItem {
            command: command::NAV_WAYPOINT,
            frame: Frame::GLOBAL,
            autocontinue: true,
            params: [0.0; 4],
            x: home.lat_e7,
            y: home.lon_e7,
            z: home.alt_m,
        };
        std::iter::once(home).chain(self.items.iter().map(|i| here_as_zero(*i))).collect()
    }

    /// The mission from items by sequence number as this autopilot sends them.
    pub fn from_wire_items(autopilot: Autopilot, items: &[MissionItem]) -> Self {
        match (autopilot, items) {
            (Autopilot::ArduPilot, [home, rest @ ..]) => {
                let known = (home.x, home.y) != (0, 0);
                let home = known.then_some(Home { lat_e7: home.x, lon_e7: home.y, alt_m: home.z });
                Self { home, items: rest.to_vec() }
            }
            (Autopilot::ArduPilot, []) => Self::default(),
            (Autopilot::Px4, items) => {
                Self { home: None, items: items.iter().map(|i| shift_jump(*i, 1.0)).collect() }
            }
        }
    }
}

impl Mission {
    /// The items of one of the three lists by sequence number, as they are sent. Only the mission has a home and jumps.
    pub fn wire_list(&self, kind: MissionKind, autopilot: Autopilot) -> Vec<MissionItem> {
        match kind {
            MissionKind::Mission => self.wire_items(autopilot),
            MissionKind::Fence | MissionKind::Rally => self.items.clone(),
        }
    }

    /// One of the three lists from items by sequence number.
    pub fn from_wire_list(kind: MissionKind, autopilot: Autopilot, items: &[MissionItem]) -> Self {
        match kind {
            MissionKind::Mission => Self::from_wire_items(autopilot, items),
            MissionKind::Fence | MissionKind::Rally => Self { home: None, items: items.to_vec() },
        }
    }
}

impl MissionItem {
    /// The item as it goes to this autopilot, but for the targets of jumps.
    pub(crate) fn sent_to(&self, autopilot: Autopilot) -> Self {
        match autopilot {
            Autopilot::ArduPilot => for_ardupilot(here_as_zero(*self)),
            Autopilot::Px4 => *self,
        }
    }
}

/// ArduPilot cuts altitudes to centimetres: they are sent such that a mission read back and sent again stays the same.
fn for_ardupilot(mut item: MissionItem) -> MissionItem {
    if command::has_altitude(item.command) {
        item.z = surviving_altitude(item.z);
    }
    item
}

/// ArduPilot takes zero for "here" and refuses a position off the Earth.
fn here_as_zero(mut item: MissionItem) -> MissionItem {
    for v in [&mut item.x, &mut item.y] {
        if *v == i32::MAX {
            *v = 0;
        }
    }
    item
}

/// PX4 counts the targets of jumps from 0.
fn shift_jump(mut item: MissionItem, by: f32) -> MissionItem {
    if item.command == command::DO_JUMP {
        item.params[0] += by;
    }
    item
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mission() -> Mission {
        Mission {
            home: Some(Home { lat_e7: 473_977_418, lon_e7: 85_455_938, alt_m: 488.0 }),
            items: vec![
                MissionItem::at(
                    command::NAV_WAYPOINT,
                    [0.0; 4],
                    LatLon { lat_deg: 47.4, lon_deg: 8.55 },
                    100.0,
                ),
                MissionItem::action(command::DO_JUMP, [1.0, 2.0, 0.0, 0.0]),
            ],
        }
    }

    #[test]
    fn ardupilot_has_home_at_zero() {
        let wire = mission().wire_items(Autopilot::ArduPilot);
        assert_eq!((wire.len(), wire[0].x, wire[0].frame), (3, 473_977_418, Frame::GLOBAL));
        assert_eq!(Mission::from_wire_items(Autopilot::ArduPilot, &wire), mission());
    }

    #[test]
    fn px4_starts_with_the_first_item_and_counts_jumps_from_zero() {
        let wire = mission().wire_items(Autopilot::Px4);
        assert_eq!((wire.len(), wire[1].params[0]), (2, 0.0));
        assert_eq!(Mission::from_wire_items(Autopilot::Px4, &wire).items, mission().items);
    }

    #[test]
    fn an_unset_position_is_zero_for_ardupilot() {
        let here = MissionItem { x: i32::MAX, y: i32::MAX, ..mission().items[0] };
        let wire = Mission { home: None, items: vec![here] }.wire_items(Autopilot::ArduPilot);
        assert_eq!((wire[1].x, wire[1].y), (0, 0));
    }

    #[test]
    fn no_altitude_is_lowered_when_ardupilot_cuts_it_to_centimetres() {
        for centimetres in (-20_000..50_000).chain((50_000..900_000).step_by(97)) {
            let stored = centimetres as f32 * 0.01;
            let mut item = mission().items[0];
            for _ in 0..3 {
                // Backed up and restored, again and again.
                item.z = stored;
                let one = Mission { home: None, items: vec![item] };
                let wire = one.wire_list(MissionKind::Mission, Autopilot::ArduPilot);
                assert_eq!((wire[1].z * 100.0) as i32, centimetres, "{stored}");
            }
        }
    }

    #[test]
    fn an_empty_vehicle_is_an_empty_mission() {
        assert_eq!(Mission::from_wire_items(Autopilot::ArduPilot, &[]), Mission::default());
        let only_home = Mission::default().wire_items(Autopilot::ArduPilot);
        assert!(Mission::from_wire_items(Autopilot::ArduPilot, &only_home).items.is_empty());
    }
}
