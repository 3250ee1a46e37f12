//! What a log says of the vehicle that flew: autopilot, version, parameters. What it does not say stays unknown.

use crate::inputs::Input;
use crate::link::frame::Frame;
use crate::link::param_codec;
use crate::link::vehicle::Vehicle;
use crate::logs::{self, Item, LogError, LogNote, LogReader, Record, VehicleClass};
use crate::sensors::modes;
use gaware_mission::item::Autopilot;
use gaware_mission::params::file::ParamFile;
use gaware_mission::params::{Encoding, ParamMessage};
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::Sample;
use gaware_wire::heartbeat::Heartbeat;
use std::collections::{BTreeMap, BTreeSet};

const AUTOPILOT_VERSION: u32 = 148;

/// Why nothing is proposed where the log has no autopilot.
pub const NO_AUTOPILOT: &str = "the log does not say which autopilot flew: no parameter can be named";

/// A list with so many parameters lacks those alone that the vehicle does not have: complete lists of old and small firmware have 492 to 805
/// (recorded and public logs), partial ones a few.
const COMPLETE: usize = 400;

/// Which inertial unit samples are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SampledUnit {
    /// The one that the autopilot uses, whichever that is.
    #[default]
    Selected,
    /// By its place among those of the autopilot, from 0.
    Place(u8),
    /// By the id of its accelerometer.
    Device(u32),
    /// Several in turn.
    Several,
}

/// The vehicle's own word.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OnBoard {
    /// Whose parameters these are.
    pub autopilot: Option<Autopilot>,
    /// Major and minor version.
    pub version: Option<(u8, u8)>,
    /// Serial number of the board, where the log has one.
    pub board: Option<String>,
    /// System id, where the log has frames.
    pub system_id: Option<u8>,
    /// Whether wings carry it, where the log says so.
    pub fixed_wing: Option<bool>,
    /// What kind of vehicle it is, where the log says so.
    pub class: Option<VehicleClass>,
    /// Values by name.
    pub parameters: BTreeMap<String, f64>,
    /// Parameters whose value changed on the way: none counts.
    pub changed: BTreeSet<String>,
    /// Which inertial unit the samples are of.
    pub unit: SampledUnit,
    /// Whether the samples are those before the autopilot's low-pass (ArduPilot `AP_InertialSensor_Backend.cpp`: increments and raw samples are taken
    /// before it).
    pub unfiltered: bool,
    /// Whether values come from a file beside the log.
    pub from_file: bool,
    /// How many the vehicle says that it has, where it says so.
    pub announced: Option<usize>,
}

/// The name of an autopilot in documents.
pub fn key(autopilot: Autopilot) -> &'static str {
    match autopilot {
        Autopilot::ArduPilot => "ardupilot",
        Autopilot::Px4 => "px4",
    }
}

/// The serial number of `AUTOPILOT_VERSION`: `uid2` (18 bytes from 60), otherwise `uid` (8 bytes from 8); zeros are none.
fn board(payload: &[u8]) -> Option<String> {
    let hex = |from: usize, to: usize| {
        // Zeros at the end of a payload are not sent.
        let bytes = (from..to).map(|k| payload.get(k).copied().unwrap_or(0));
        let text: String = bytes.clone().map(|b| format!("{b:02x}")).collect();
        bytes.into_iter().any(|b| b != 0).then_some(text)
    };
    hex(60, 78).or_else(|| hex(8, 16))
}

impl OnBoard {
    /// Reads a log of any format for it. `vehicle`: the system id that is listened to (default: the first autopilot).
    ///
    /// # Errors
    /// A log that cannot be opened or read.
    pub fn read(log: impl Into<Input>, vehicle: Option<u8>) -> Result<Self, LogError> {
        let mut reader = logs::open(log)?;
        let mut found = Self::default();
        for record in reader.by_ref() {
            match record {
                Ok(record) => found.take(&record.item, vehicle),
                // What was read before a failing disk counts.
                Err(LogError::Read { .. }) => break,
                Err(error) => return Err(error),
            }
        }
        found.complete_from(reader.as_ref());
        Ok(found)
    }

    /// Takes what the format of a log says at its end.
    pub fn complete_from(&mut self, reader: &dyn LogReader) {
        self.is_log_of(reader.autopilot());
        self.is_of_kind(reader.vehicle_kind());
    }

    /// Takes the kind of vehicle that a log is of, where nothing said it before.
    pub fn is_of_kind(&mut self, kind: Option<VehicleKind>) {
        self.fixed_wing = self.fixed_wing.or(kind.map(|kind| kind == VehicleKind::FixedWing));
    }

    /// From records that are in memory.
    pub fn of_records(records: &[Record]) -> Self {
        let mut found = Self::default();
        records.iter().for_each(|record| found.take(&record.item, None));
        found
    }

    /// What the format of a log says of the autopilot, where no heartbeat has.
    pub fn is_log_of(&mut self, autopilot: Option<&str>) {
        self.autopilot = self.autopilot.or(match autopilot {
            Some("ardupilot") => Some(Autopilot::ArduPilot),
            Some("px4") => Some(Autopilot::Px4),
            _ => None,
        });
    }

    /// Takes an entry of a log. `vehicle`: as for [`Self::read`].
    pub fn take(&mut self, item: &Item, vehicle: Option<u8>) {
        match item {
            Item::Frame(frame) => self.frame(frame, vehicle),
            Item::Note(LogNote::Parameter { name, value }) => self.learn(name, *value),
            Item::Note(LogNote::Version(major, minor)) => self.version = Some((*major, *minor)),
            Item::Note(LogNote::Board(board)) => self.board = Some(board.clone()),
            Item::Note(LogNote::Vehicle(class)) => self.class = Some(*class),
            Item::Note(LogNote::Accelerometer(id)) => self.is_of(SampledUnit::Device(*id)),
            Item::Note(_) | Item::Measurement(_) => {}
        }
    }

    /// The unit that samples are of, by the messages that bring them: `SCALED_IMU` and `RAW_IMU` are of the first (ArduPilot
    /// `GCS_MAVLink/GCS_Common.cpp:2215`, PX4 `modules/mavlink/streams/SCALED_IMU.hpp`), `HIGHRES_IMU` of PX4 is of the one that it uses.
    pub fn samples_are(&mut self, samples: &[Sample]) {
        let px4 = self.autopilot == Some(Autopilot::Px4);
        for sample in samples {
            let Sample::Stream(stream) = sample else { continue };
            self.unfiltered |= stream.message.starts_with("IMT[") || stream.message.starts_with("ACC/GYR[");
            match stream.message.as_str() {
                "SCALED_IMU2" => self.is_of(SampledUnit::Place(1)),
                "SCALED_IMU3" => self.is_of(SampledUnit::Place(2)),
                "SCALED_IMU" | "RAW_IMU" | "IMU" => self.is_of(SampledUnit::Place(0)),
                "HIGHRES_IMU" if !px4 => self.is_of(SampledUnit::Place(0)),
                // Of a source with a number in its name: "IMU[1] (of 2 sources, …)"; PX4's units have other numbers in their parameters.
                other => {
                    match other.split_once('[').and_then(|(_, rest)| rest.split_once(']')?.0.parse().ok()) {
                        Some(unit) if !px4 => self.is_of(SampledUnit::Place(unit)),
                        Some(_) => self.unit = SampledUnit::Several,
                        None => {}
                    }
                }
            }
        }
    }

    fn is_of(&mut self, unit: SampledUnit) {
        self.unit = match self.unit {
            SampledUnit::Selected => unit,
            other if other == unit || unit == SampledUnit::Selected => other,
            _ => SampledUnit::Several,
        };
    }

    /// Takes a frame. `vehicle`: as for [`Self::read`].
    pub fn frame(&mut self, frame: &Frame, vehicle: Option<u8>) {
        let heartbeat = Heartbeat::of(frame);
        if let Some(heartbeat) = heartbeat
            && self.system_id.is_none()
            && let Some(seen) = Vehicle::from_heartbeat(frame)
            && vehicle.is_none_or(|id| id == seen.address.system)
        {
            self.system_id = Some(seen.address.system);
            self.autopilot = Some(seen.autopilot);
            self.fixed_wing = seen.is_fixed_wing();
            self.class = VehicleClass::of_mav_type(heartbeat.mav_type).or(self.class);
        }
        if self.system_id != Some(frame.system_id) {
            return;
        }
        if let Some(heartbeat) = heartbeat
            && self.class == Some(VehicleClass::FixedWing)
            && self.autopilot == Some(Autopilot::ArduPilot)
            && modes::is_of_rotors(heartbeat.custom_mode)
        {
            // A plane that rotors lift as well may call itself a plane in its heartbeats.
            self.class = Some(VehicleClass::Vtol);
        }
        if frame.message_id == AUTOPILOT_VERSION {
            // capabilities (8), uid (8), flight_sw_version: type, patch, minor, major.
            let at = |k: usize| frame.payload().get(k).copied().unwrap_or(0);
            self.version = Some((at(19), at(18))).filter(|v| *v != (0, 0)).or(self.version);
            self.board = board(frame.payload()).or(self.board.take());
        }
        if let (Some(ParamMessage::Value { name, bits, kind: Some(kind), count, .. }), Some(autopilot)) =
            (param_codec::decode(frame), self.autopilot)
        {
            self.announced = self.announced.max(Some(usize::from(count)));
            self.learn(name.as_str(), Encoding::of(autopilot).decode(bits, kind).value);
        }
    }

    /// A value of a parameter; two values of one are none.
    pub fn learn(&mut self, name: &str, value: f64) {
        if !value.is_finite() || self.changed.contains(name) {
            return;
        }
        match self.parameters.get(name) {
            Some(old) if *old as f32 != value as f32 => {
                self.parameters.remove(name);
                self.changed.insert(name.to_owned());
            }
            _ => _ = self.parameters.insert(name.to_owned(), value),
        }
    }

    /// Adds what another log of the same vehicle says.
    pub fn join(&mut self, other: &Self) {
        if self.autopilot.is_some() && other.autopilot.is_some() && self.autopilot != other.autopilot {
            // Logs of different autopilots are logs of different vehicles.
            *self = Self::default();
            return;
        }
        self.autopilot = self.autopilot.or(other.autopilot);
        self.version = self.version.or(other.version);
        self.board = self.board.take().or_else(|| other.board.clone());
        self.system_id = self.system_id.or(other.system_id);
        self.fixed_wing = self.fixed_wing.or(other.fixed_wing);
        self.class = self.class.or(other.class);
        self.is_of(other.unit);
        self.from_file |= other.from_file;
        self.announced = self.announced.max(other.announced);
        for name in &other.changed {
            self.parameters.remove(name);
            self.changed.insert(name.clone());
        }
        other.parameters.iter().for_each(|(name, value)| self.learn(name, *value));
    }

    /// Adds a parameter file of the vehicle; what the log says wins.
    pub fn add_file(&mut self, file: &ParamFile) {
        self.from_file = true;
        for entry in &file.entries {
            let name = entry.name.as_str();
            if !self.changed.contains(name) {
                self.parameters.entry(name.to_owned()).or_insert(entry.value);
            }
        }
    }

    /// The inertial unit: the board's serial number, otherwise the calibration of its accelerometers, which two units do not share. The ids of
    /// the sensors (`INS_ACC_ID`, `CAL_ACC0_ID`) are of bus and type: all boards of one make have the same. A simulation has none.
    pub fn unit(&self) -> Option<String> {
        if self.parameters.keys().any(|name| name.starts_with("SIM_")) {
            return None;
        }
        self.board.clone().or_else(|| {
            let own = |name: &&String| {
                let rest = name.strip_prefix("INS_").or_else(|| name.strip_prefix("CAL_"));
                rest.is_some_and(|rest| rest.starts_with("ACC") && !rest.contains("PRIO"))
            };
            let calibration: Vec<(&String, f64)> =
                self.parameters.keys().filter(own).filter_map(|name| Some((name, self.get(name)?))).collect();
            let calibrated = |(name, value): &(&String, f64)| name.contains("OFF") && *value != 0.0;
            if calibration.iter().filter(|row| calibrated(row)).count() < 3 {
                return None;
            }
            // FNV-1a: short, and the same on every machine.
            let bytes = calibration.iter().flat_map(|(name, value)| {
                name.bytes().chain((*value as f32).to_bits().to_le_bytes()).collect::<Vec<u8>>()
            });
            let hash = bytes
                .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
            Some(format!("calibration {hash:016x}"))
        })
    }

    /// A value by name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.parameters.get(name).copied()
    }

    /// Whether the vehicle has it, with whatever value.
    pub fn has(&self, name: &str) -> bool {
        self.parameters.contains_key(name) || self.changed.contains(name)
    }

    /// How many parameters the log holds, where that is all of them. A flight that begins while they are read leaves a part: 722 of 1348 of
    /// ArduCopter 4.7.
    pub fn complete(&self) -> Option<usize> {
        let held = self.parameters.len();
        Some(held).filter(|n| *n >= COMPLETE && n + self.changed.len() >= self.announced.unwrap_or(0))
    }

    fn on(&self, names: &[&str]) -> Option<String> {
        names.iter().find(|n| self.get(n).is_some_and(|v| v != 0.0)).map(|n| (*n).to_owned())
    }

    /// Why a correction in sensor axes of this unit cannot be derived from one in body axes, by what the log has.
    pub fn rotation(&self, unit: u8, small_deg: f64) -> Option<String> {
        let turned =
            |name: &str, least: f64| self.get(name).filter(|v| v.abs() > least).map(|v| (name.to_owned(), v));
        let found = match self.autopilot? {
            Autopilot::ArduPilot => turned("AHRS_ORIENTATION", 0.0),
            Autopilot::Px4 => turned("SENS_BOARD_ROT", 0.0)
                .or_else(|| {
                    let name = format!("CAL_ACC{unit}_ROT");
                    self.get(&name).filter(|v| *v > 0.0).map(|v| (name, v))
                })
                .or_else(|| {
                    ["X", "Y", "Z"].iter().find_map(|a| turned(&format!("SENS_BOARD_{a}_OFF"), small_deg))
                }),
        };
        found.map(|(name, value)| {
            format!("{name} is {value}: the parameter acts in the sensor's axes, and the effect was found in the body's")
        })
    }

    /// The parameter of the board's rotation, where the log lacks it.
    pub fn unknown_rotation(&self) -> Option<&'static str> {
        let name = match self.autopilot? {
            Autopilot::ArduPilot => "AHRS_ORIENTATION",
            Autopilot::Px4 => "SENS_BOARD_ROT",
        };
        self.get(name).is_none().then_some(name)
    }

    /// The id of the accelerometer whose calibration PX4 keeps in this place; 0 is none.
    fn accelerometer(&self, place: u8) -> Option<u32> {
        // An id has 32 bits, its parameter a sign.
        self.get(&format!("CAL_ACC{place}_ID")).map(|id| id as i64 as u32)
    }

    /// In which place the autopilot keeps the calibration of the unit that the samples are of, from 0.
    ///
    /// # Errors
    /// Why that is not known.
    pub fn place(&self) -> Result<u8, String> {
        let px4 = self.autopilot == Some(Autopilot::Px4);
        match self.unit {
            SampledUnit::Several => Err("the samples are of several inertial units in turn".to_owned()),
            SampledUnit::Place(place) if px4 && self.accelerometer(place) == Some(0) => Err(format!(
                "CAL_ACC{place}_ID is 0: the unit that the samples are of has no calibration on the vehicle"
            )),
            SampledUnit::Place(place) => Ok(place),
            SampledUnit::Device(id) => {
                (0..4).find(|place| self.accelerometer(*place) == Some(id)).ok_or_else(|| {
                    format!(
                        "the samples are of accelerometer {id}, and no CAL_ACC*_ID in the log has this id"
                    )
                })
            }
            SampledUnit::Selected if px4 => match self.on(&["CAL_ACC1_ID", "CAL_ACC2_ID", "CAL_ACC3_ID"]) {
                Some(name) => Err(format!(
                    "{name} says that there are several inertial units, and the log does not say of which one its samples are"
                )),
                None => Ok(0),
            },
            SampledUnit::Selected => Ok(0),
        }
    }

    /// What PX4 has done by itself to an accelerometer's offset when it was disarmed: from 0.05 m/s² on it adds what its filter has learnt
    /// (`modules/sensors/vehicle_imu/VehicleIMU.cpp`, `SENS_IMU_AUTOCAL`, on by default), at 1 g the share of a scale factor too.
    pub fn commits_offsets(&self) -> bool {
        self.autopilot == Some(Autopilot::Px4) && self.get("SENS_IMU_AUTOCAL") != Some(0.0)
    }

    /// What else there is on the vehicle that the samples say nothing of.
    pub fn other_units(&self) -> Option<String> {
        let place = self.place().ok()?;
        let (px4, names): (bool, [&str; 4]) = match self.autopilot? {
            Autopilot::ArduPilot => (false, ["INS_ACC_ID", "INS_ACC2_ID", "INS_ACC3_ID", "INS4_ACC_ID"]),
            Autopilot::Px4 => (true, ["CAL_ACC0_ID", "CAL_ACC1_ID", "CAL_ACC2_ID", "CAL_ACC3_ID"]),
        };
        let own = *names.get(usize::from(place))?;
        let others: Vec<&str> = names.into_iter().filter(|name| *name != own).collect();
        let ordinal =
            ["first", "second", "third", "fourth"].get(usize::from(place)).copied().unwrap_or("last");
        match (self.get(own), self.on(&others)) {
            (Some(id), Some(name)) if px4 => Some(format!(
                "{name}: there are further inertial units with parameters of their own; these are of the {ordinal} one ({own} {id}), which the \
                 filter that flies need not use"
            )),
            (_, Some(name)) => Some(format!(
                "{name}: there are further inertial units with parameters of their own; the samples are of the {ordinal} one, and the lane that \
                 flew may use another"
            )),
            (Some(_), None) => None,
            (None, None) if px4 => None,
            (None, None) => Some(
                "the log does not say how many inertial units there are; the samples are of the first one"
                    .to_owned(),
            ),
        }
    }

    /// Whether there is a second receiver.
    pub fn second_receiver(&self) -> Option<String> {
        let name = self.on(&["GPS2_TYPE", "GPS_TYPE2", "SENS_GPS1_ID"])?;
        Some(format!("{name}: there is a second GNSS receiver; the fixes are of the first one"))
    }

    /// What the log itself leaves open.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.changed.is_empty() {
            let names: Vec<&str> = self.changed.iter().map(String::as_str).collect();
            notes.push(format!("changed on the way or between logs, so not counted: {}", names.join(", ")));
        }
        if self.parameters.is_empty() {
            notes.push(
                "the log holds no parameters of the vehicle; give them with --parameters FILE (from \"gaware params backup\")".to_owned(),
            );
        }
        if self.from_file && self.commits_offsets() {
            notes.push(
                "parameters come from a file: where it was read after the flight, its CAL_ACC*_OFF are not those that flew (SENS_IMU_AUTOCAL: \
                 PX4 changes them when it is disarmed)"
                    .to_owned(),
            );
        }
        if self.version.is_none() && self.autopilot.is_some() {
            notes.push(match self.autopilot {
                Some(Autopilot::ArduPilot) => {
                    "the log does not say which version flew: before 4.6 GPS1_DELAY_MS is GPS_DELAY_MS, GPS1_POS_X is GPS_POS1_X".to_owned()
                }
                _ => "the log does not say which version flew: since 2026 EKF2_GPS_DELAY is SENS_GPS0_DELAY, EKF2_GPS_POS_X is \
                      SENS_GPS0_OFFX"
                    .to_owned(),
            });
        }
        notes
    }
}
