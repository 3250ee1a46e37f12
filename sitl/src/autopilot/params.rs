//! The parameters of the simulated autopilot and the parameter protocol, in both dialects: ArduPilot sends every value as a float, PX4 the bytes of
//! an integer (MAVLink "Parameter Protocol", "Parameter Encoding"). Neither answers for a parameter that it does not have.
//!
//! Settings as in the firmware: ArduPilot (`GCS_MAVLink/GCS_Param.cpp:263-322`, `AP_Param/AP_Param.cpp:2238`) ignores what is not finite,
//! rounds and limits integers to their type, and answers a read-only parameter with its old value; PX4
//! (`modules/mavlink/mavlink_parameters.cpp`) does not answer a setting of another type, and sends a hash as `_HASH_CHECK`.

use super::{Autopilot, Flavour};
use crate::scenario::Airframe;
use gaware_mission::params::{Encoding, ParamName, ParamType, ParamValue};
use mavlink::dialects::ardupilotmega::*;
use mavlink::types::CharArray;

/// A value of a type.
type Entry = (ParamName, ParamValue);

/// The table, sorted by name as autopilots sort theirs.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterTable {
    encoding: Encoding,
    entries: Vec<Entry>,
}

/// PX4's hash of all values.
const HASH: &str = "_HASH_CHECK";
/// What ArduPilot denies to set (`@READONLY` in its defaults).
const READ_ONLY: &[&str] = &["STAT_BOOTCNT"];

const ARDUPILOT: &[(&str, ParamType, f64)] = &[
    ("AHRS_ORIENTATION", ParamType::I8, 0.0),
    ("GPS1_DELAY_MS", ParamType::I16, 0.0),
    ("GPS1_POS_X", ParamType::Real32, 0.0),
    ("GPS1_POS_Y", ParamType::Real32, 0.0),
    ("GPS1_POS_Z", ParamType::Real32, 0.0),
    ("GPS2_TYPE", ParamType::I8, 0.0),
    ("INS_ACC2_ID", ParamType::I32, 0.0),
    ("INS_ACCEL_FILTER", ParamType::I16, 20.0),
    ("INS_ACCOFFS_X", ParamType::Real32, 0.0),
    ("INS_ACCOFFS_Y", ParamType::Real32, 0.0),
    ("INS_ACCOFFS_Z", ParamType::Real32, 0.0),
    ("INS_ACCSCAL_X", ParamType::Real32, 1.0),
    ("INS_ACCSCAL_Y", ParamType::Real32, 1.0),
    ("INS_ACCSCAL_Z", ParamType::Real32, 1.0),
    ("INS_ACC_ID", ParamType::I32, 2_753_028.0),
    ("INS_POS1_X", ParamType::Real32, 0.0),
    ("INS_POS1_Y", ParamType::Real32, 0.0),
    ("INS_POS1_Z", ParamType::Real32, 0.0),
    ("INS_TCAL1_ENABLE", ParamType::I8, 0.0),
    ("STAT_BOOTCNT", ParamType::I16, 7.0),
    ("FENCE_ACTION", ParamType::I8, 1.0),
    ("FENCE_ALT_MAX", ParamType::Real32, 100.0),
    ("FENCE_ENABLE", ParamType::I8, 0.0),
    ("FENCE_RADIUS", ParamType::Real32, 300.0),
    ("FENCE_TYPE", ParamType::I8, 7.0),
];
const PLANE: &[(&str, ParamType, f64)] = &[
    ("AIRSPEED_CRUISE", ParamType::Real32, 16.0),
    ("AIRSPEED_MAX", ParamType::I16, 25.0),
    ("AIRSPEED_MIN", ParamType::I16, 11.0),
    ("ROLL_LIMIT_DEG", ParamType::Real32, 55.0),
    ("WP_RADIUS", ParamType::I16, 60.0),
];
const COPTER: &[(&str, ParamType, f64)] = &[
    ("ANGLE_MAX", ParamType::I16, 4500.0),
    ("ATC_SLEW_YAW", ParamType::Real32, 6000.0),
    ("WPNAV_SPEED", ParamType::Real32, 1500.0),
];
const PX4: &[(&str, ParamType, f64)] = &[
    ("CAL_ACC0_ID", ParamType::I32, 1_310_988.0),
    ("CAL_ACC0_XOFF", ParamType::Real32, 0.0),
    ("CAL_ACC0_XSCALE", ParamType::Real32, 1.0),
    ("CAL_ACC0_YOFF", ParamType::Real32, 0.0),
    ("CAL_ACC0_YSCALE", ParamType::Real32, 1.0),
    ("CAL_ACC0_ZOFF", ParamType::Real32, 0.0),
    ("CAL_ACC0_ZSCALE", ParamType::Real32, 1.0),
    ("CAL_ACC1_ID", ParamType::I32, 1_310_996.0),
    ("EKF2_GPS_DELAY", ParamType::Real32, 110.0),
    ("EKF2_GPS_POS_X", ParamType::Real32, 0.0),
    ("EKF2_GPS_POS_Y", ParamType::Real32, 0.0),
    ("EKF2_GPS_POS_Z", ParamType::Real32, 0.0),
    ("EKF2_IMU_POS_X", ParamType::Real32, 0.0),
    ("EKF2_IMU_POS_Y", ParamType::Real32, 0.0),
    ("EKF2_IMU_POS_Z", ParamType::Real32, 0.0),
    ("SENS_BOARD_ROT", ParamType::I32, 0.0),
    // On by default; this autopilot commits nothing.
    ("SENS_IMU_AUTOCAL", ParamType::I32, 0.0),
    ("TC_A_ENABLE", ParamType::I32, 0.0),
    ("GF_ACTION", ParamType::I32, 2.0),
    ("GF_MAX_HOR_DIST", ParamType::Real32, 0.0),
    ("GF_MAX_VER_DIST", ParamType::Real32, 0.0),
    ("MIS_DIST_1WP", ParamType::Real32, 10_000.0),
];
const PX4_WING: &[(&str, ParamType, f64)] = &[
    ("FW_AIRSPD_MAX", ParamType::Real32, 36.0),
    ("FW_AIRSPD_MIN", ParamType::Real32, 17.0),
    ("FW_AIRSPD_TRIM", ParamType::Real32, 24.0),
    ("FW_LND_ANG", ParamType::Real32, 5.0),
    ("FW_R_LIM", ParamType::Real32, 50.0),
    ("MIS_TKO_LAND_REQ", ParamType::I32, 2.0),
];
const PX4_ROTOR: &[(&str, ParamType, f64)] = &[
    ("MIS_TKO_LAND_REQ", ParamType::I32, 0.0),
    ("MPC_TILTMAX_AIR", ParamType::Real32, 45.0),
    ("MPC_XY_CRUISE", ParamType::Real32, 10.0),
    ("MPC_XY_VEL_MAX", ParamType::Real32, 15.0),
];

impl ParameterTable {
    /// The usual parameters; `changes` replace values, or remove a parameter where they are no number.
    pub fn new(flavour: Flavour, airframe: Airframe, loop_rate_hz: f64, changes: &[(&str, f64)]) -> Self {
        let (encoding, parts) = match (flavour, airframe) {
            (Flavour::ArduPilot, Airframe::FixedWing) => (Encoding::ByValue, [ARDUPILOT, PLANE]),
            (Flavour::ArduPilot, Airframe::Multirotor) => (Encoding::ByValue, [ARDUPILOT, COPTER]),
            (Flavour::Px4, Airframe::FixedWing) => (Encoding::ByBytes, [PX4, PX4_WING]),
            (Flavour::Px4, Airframe::Multirotor) => (Encoding::ByBytes, [PX4, PX4_ROTOR]),
        };
        let rate = [("SCHED_LOOP_RATE", ParamType::I16, loop_rate_hz)];
        let rate = rate.iter().filter(|_| flavour == Flavour::ArduPilot);
        let all = parts.into_iter().flatten().chain(rate);
        let mut table = Self {
            encoding,
            entries: all
                .filter_map(|(name, kind, value)| {
                    Some((name.parse().ok()?, ParamValue { kind: *kind, value: *value }))
                })
                .collect(),
        };
        for (name, value) in changes {
            table.change(name, *value);
        }
        table.entries.sort_by_key(|(name, _)| *name);
        table
    }

    fn change(&mut self, name: &str, value: f64) {
        let Ok(name) = name.parse::<ParamName>() else { return };
        let known = self.entries.iter().position(|(n, _)| *n == name);
        match known {
            Some(index) if value.is_nan() => _ = self.entries.remove(index),
            Some(index) => self.entries[index].1.value = value,
            None if value.is_nan() => {}
            None => self.entries.push((name, ParamValue { kind: ParamType::Real32, value })),
        }
    }

    /// A value by name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.entries.iter().find(|(n, _)| n.as_str() == name).map(|(_, v)| v.value)
    }

    /// The answers to a message of the parameter protocol.
    pub fn handle(&mut self, message: &MavMessage) -> Vec<MavMessage> {
        match message {
            MavMessage::PARAM_REQUEST_LIST(_) => {
                let hash = (self.encoding == Encoding::ByBytes).then(|| self.hash_message());
                hash.into_iter().chain((0..self.entries.len()).map(|k| self.message(k))).collect()
            }
            MavMessage::PARAM_REQUEST_READ(m)
                if m.param_index < 0
                    && self.encoding == Encoding::ByBytes
                    && m.param_id.to_str() == Ok(HASH) =>
            {
                vec![self.hash_message()]
            }
            MavMessage::PARAM_REQUEST_READ(m) => {
                let index = match usize::try_from(m.param_index) {
                    Ok(index) => (index < self.entries.len()).then_some(index),
                    Err(_) => self.find(&m.param_id),
                };
                index.map(|k| self.message(k)).into_iter().collect()
            }
            MavMessage::PARAM_SET(m) => {
                let Some(index) = self.find(&m.param_id) else { return Vec::new() };
                match self.encoding {
                    Encoding::ByValue => self.set_as_ardupilot(index, m.param_value),
                    Encoding::ByBytes => self.set_as_px4(index, m),
                }
            }
            _ => Vec::new(),
        }
    }

    fn set_as_ardupilot(&mut self, index: usize, sent: f32) -> Vec<MavMessage> {
        if !sent.is_finite() {
            return Vec::new();
        }
        let (name, value) = &mut self.entries[index];
        if READ_ONLY.contains(&name.as_str()) {
            let text = format!("Param write denied ({name})");
            let severity = MavSeverity::MAV_SEVERITY_WARNING;
            let denied = STATUSTEXT_DATA { severity, text: text.as_str().into(), ..Default::default() };
            return vec![MavMessage::STATUSTEXT(denied), self.unnumbered(index)];
        }
        let v = f64::from(sent);
        value.value = match value.kind {
            ParamType::I8 => f64::from((v + 0.01_f64.copysign(v)) as i8),
            ParamType::I16 => f64::from((v + 0.01_f64.copysign(v)) as i16),
            ParamType::I32 => f64::from((v + 0.01_f64.copysign(v)) as i32),
            _ => v,
        };
        vec![self.unnumbered(index)]
    }

    fn set_as_px4(&mut self, index: usize, m: &PARAM_SET_DATA) -> Vec<MavMessage> {
        let value = &mut self.entries[index].1;
        if wire_type(value.kind) != m.param_type {
            return Vec::new();
        }
        *value = self.encoding.decode(m.param_value.to_bits(), value.kind);
        vec![self.message(index)]
    }

    /// The hash of names and values, as PX4 computes it (`lib/parameters/parameters.cpp:1309-1327`).
    fn hash_message(&self) -> MavMessage {
        let mut hash = 0_u32;
        for (name, value) in &self.entries {
            let bytes = self.encoding.encode(*value).to_le_bytes();
            hash = crc32_part(hash, name.as_str().as_bytes().iter().chain(&bytes));
        }
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: HASH.into(),
            param_value: f32::from_bits(hash),
            param_type: MavParamType::MAV_PARAM_TYPE_UINT32,
            param_count: self.entries.len() as u16,
            param_index: u16::MAX,
        })
    }

    /// A value as ArduPilot announces a change: without its number.
    fn unnumbered(&self, index: usize) -> MavMessage {
        match self.message(index) {
            MavMessage::PARAM_VALUE(m) => {
                MavMessage::PARAM_VALUE(PARAM_VALUE_DATA { param_index: u16::MAX, ..m })
            }
            other => other,
        }
    }

    fn find(&self, id: &CharArray<16>) -> Option<usize> {
        let text = id.to_str().ok()?;
        self.entries.iter().position(|(name, _)| name.as_str() == text)
    }

    fn message(&self, index: usize) -> MavMessage {
        let (name, value) = &self.entries[index];
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: name.as_str().into(),
            param_value: f32::from_bits(self.encoding.encode(*value)),
            param_type: wire_type(value.kind),
            param_count: self.entries.len() as u16,
            param_index: index as u16,
        })
    }
}

/// CRC-32 as NuttX's `crc32part`: reflected, from the value of the part before, without a final inversion.
fn crc32_part<'a>(crc: u32, bytes: impl Iterator<Item = &'a u8>) -> u32 {
    bytes.fold(crc, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
    })
}

fn wire_type(kind: ParamType) -> MavParamType {
    match kind {
        ParamType::U8 => MavParamType::MAV_PARAM_TYPE_UINT8,
        ParamType::I8 => MavParamType::MAV_PARAM_TYPE_INT8,
        ParamType::U16 => MavParamType::MAV_PARAM_TYPE_UINT16,
        ParamType::I16 => MavParamType::MAV_PARAM_TYPE_INT16,
        ParamType::U32 => MavParamType::MAV_PARAM_TYPE_UINT32,
        ParamType::I32 => MavParamType::MAV_PARAM_TYPE_INT32,
        ParamType::Real32 => MavParamType::MAV_PARAM_TYPE_REAL32,
    }
}

impl Autopilot {
    pub(super) fn handle_parameters(&mut self, message: &MavMessage) {
        let answers = self.parameters.handle(message);
        if !answers.is_empty() {
            self.use_parameters();
        }
        for answer in answers {
            self.send(&answer);
        }
    }

    /// What it keeps over a power cycle.
    pub fn parameters(&self) -> &ParameterTable {
        &self.parameters
    }

    /// Starts with the parameters of an earlier power cycle.
    #[must_use]
    pub fn with_parameters(mut self, table: ParameterTable) -> Self {
        self.parameters = table;
        self.use_parameters();
        self.start_navigation();
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(table: &mut ParameterTable, name: &str) -> Option<PARAM_VALUE_DATA> {
        let request =
            PARAM_REQUEST_READ_DATA { param_index: -1, param_id: name.into(), ..Default::default() };
        match table.handle(&MavMessage::PARAM_REQUEST_READ(request)).as_slice() {
            [MavMessage::PARAM_VALUE(value)] => Some(value.clone()),
            [] => None,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn ardupilot_casts_integers_and_px4_sends_their_bytes() {
        let mut plane = ParameterTable::new(Flavour::ArduPilot, Airframe::FixedWing, 400.0, &[]);
        let value = read(&mut plane, "SCHED_LOOP_RATE").unwrap();
        assert_eq!((value.param_value, value.param_type as u32), (400.0, 4));
        let mut px4 = ParameterTable::new(Flavour::Px4, Airframe::FixedWing, 400.0, &[]);
        let value = read(&mut px4, "MIS_TKO_LAND_REQ").unwrap();
        assert_eq!((value.param_value.to_bits(), value.param_type as u32), (2, 6));
        assert_eq!(read(&mut px4, "SCHED_LOOP_RATE"), None);
    }

    fn set(table: &mut ParameterTable, name: &str, value: f32, param_type: MavParamType) -> Vec<MavMessage> {
        let set =
            PARAM_SET_DATA { param_value: value, param_id: name.into(), param_type, ..Default::default() };
        table.handle(&MavMessage::PARAM_SET(set))
    }

    #[test]
    fn settings_are_limited_and_denied_as_the_firmware_does() {
        let mut plane = ParameterTable::new(Flavour::ArduPilot, Airframe::FixedWing, 400.0, &[]);
        let i8 = MavParamType::MAV_PARAM_TYPE_INT8;
        assert_eq!(set(&mut plane, "AHRS_ORIENTATION", 1000.0, i8).len(), 1);
        assert_eq!(plane.get("AHRS_ORIENTATION"), Some(127.0));
        assert!(set(&mut plane, "GPS1_POS_X", f32::NAN, i8).is_empty());
        let denied = set(&mut plane, "STAT_BOOTCNT", 1.0, i8);
        assert!(
            matches!(denied.as_slice(), [MavMessage::STATUSTEXT(_), MavMessage::PARAM_VALUE(v)] if v.param_value == 7.0)
        );
        let mut px4 = ParameterTable::new(Flavour::Px4, Airframe::FixedWing, 400.0, &[]);
        assert!(set(&mut px4, "EKF2_GPS_DELAY", 90.0, MavParamType::MAV_PARAM_TYPE_INT32).is_empty());
        assert_eq!(set(&mut px4, "EKF2_GPS_DELAY", 90.0, MavParamType::MAV_PARAM_TYPE_REAL32).len(), 1);
        assert_eq!(px4.get("EKF2_GPS_DELAY"), Some(90.0));
    }

    #[test]
    fn the_hash_of_px4_follows_every_value() {
        let mut px4 = ParameterTable::new(Flavour::Px4, Airframe::FixedWing, 400.0, &[]);
        let hash = |table: &mut ParameterTable| read(table, HASH).expect("a hash").param_value.to_bits();
        let before = hash(&mut px4);
        set(&mut px4, "EKF2_GPS_POS_X", 0.5, MavParamType::MAV_PARAM_TYPE_REAL32);
        assert_ne!(hash(&mut px4), before);
        set(&mut px4, "EKF2_GPS_POS_X", 0.0, MavParamType::MAV_PARAM_TYPE_REAL32);
        assert_eq!(hash(&mut px4), before);
        // The check value of the algorithm, without its inversions: 0 stays 0.
        assert_eq!(crc32_part(u32::MAX, b"123456789".iter()) ^ u32::MAX, 0xCBF4_3926);
    }

    #[test]
    fn a_setting_is_answered_with_the_new_value_and_the_list_holds_all() {
        let changes = [("FENCE_ENABLE", 1.0), ("ROLL_LIMIT_DEG", f64::NAN), ("LIM_ROLL_CD", 4500.0)];
        let mut plane = ParameterTable::new(Flavour::ArduPilot, Airframe::FixedWing, 50.0, &changes);
        assert_eq!((plane.get("FENCE_ENABLE"), plane.get("ROLL_LIMIT_DEG")), (Some(1.0), None));
        let set = PARAM_SET_DATA {
            param_value: 0.0,
            param_id: "FENCE_ENABLE".into(),
            param_type: MavParamType::MAV_PARAM_TYPE_INT8,
            ..Default::default()
        };
        assert_eq!(plane.handle(&MavMessage::PARAM_SET(set)).len(), 1);
        assert_eq!(plane.get("FENCE_ENABLE"), Some(0.0));
        let all = plane.handle(&MavMessage::PARAM_REQUEST_LIST(Default::default()));
        let MavMessage::PARAM_VALUE(last) = all.last().unwrap() else { panic!("no value") };
        assert_eq!(usize::from(last.param_count), all.len());
        assert_eq!(usize::from(last.param_index), all.len() - 1);
    }
}
