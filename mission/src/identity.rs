//! Which vehicle: its hardware, not the system id that anyone may set.

use crate::item::Autopilot;
use crate::transfer::Address;
use serde::{Deserialize, Serialize};

/// Bytes of `uid2` of `AUTOPILOT_VERSION`.
const BYTES: usize = 18;
/// Where `uid2` and the older `uid` lie in the payload of `AUTOPILOT_VERSION`.
const UID2_AT: usize = 60;
const UID_AT: std::ops::Range<usize> = 8..16;

/// The hardware id of an autopilot: `uid2` of `AUTOPILOT_VERSION`, or `uid` where there is no other. Never all zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Uid([u8; BYTES]);

impl Uid {
    /// From the payload of `AUTOPILOT_VERSION`; zeros are none.
    pub fn from_version(payload: &[u8]) -> Option<Self> {
        // Zeros at the end of a payload are not sent.
        let at = |k: usize| payload.get(k).copied().unwrap_or(0);
        let mut short = [0; BYTES];
        short.iter_mut().zip(UID_AT).for_each(|(to, from)| *to = at(from));
        Self::known(std::array::from_fn(|k| at(UID2_AT + k))).or_else(|| Self::known(short))
    }

    /// From bytes; zeros are none.
    fn known(bytes: [u8; BYTES]) -> Option<Self> {
        bytes.iter().any(|b| *b != 0).then_some(Self(bytes))
    }
}

/// Hexadecimal, without the zeros at the end.
impl std::fmt::Display for Uid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let used = self.0.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
        self.0.iter().take(used).try_for_each(|b| write!(f, "{b:02x}"))
    }
}

impl From<Uid> for String {
    fn from(uid: Uid) -> Self {
        uid.to_string()
    }
}

impl TryFrom<String> for Uid {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl std::str::FromStr for Uid {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("\"{text}\" is no hardware id: 1 to {BYTES} bytes in hexadecimal, not all zero");
        let digits: Vec<u8> = text.chars().map_while(|c| Some(c.to_digit(16)? as u8)).collect();
        if digits.len() != text.chars().count() || !digits.len().is_multiple_of(2) || digits.len() > 2 * BYTES
        {
            return Err(wrong());
        }
        let mut bytes = [0; BYTES];
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = pair.iter().fold(0, |sum, digit| sum << 4 | digit);
        }
        Self::known(bytes).ok_or_else(wrong)
    }
}

/// Who a vehicle is: what is written to it, journalled and backed up belongs to this one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Hardware id; not known where the vehicle does not give one.
    #[serde(default)]
    pub uid: Option<Uid>,
    /// Its firmware.
    pub autopilot: Autopilot,
    /// `MAV_TYPE`; 0 is not known.
    pub mav_type: u8,
    /// System id.
    pub system_id: u8,
    /// Component id.
    pub component_id: u8,
    /// Its home or, where that is not known, where it was: latitude and longitude, deg.
    #[serde(default)]
    pub home: Option<[f64; 2]>,
}

/// What comparing two identities says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sameness {
    /// The same hardware.
    Same,
    /// Another one.
    Other,
    /// Nothing contradicts, but one of them has no hardware id.
    Unproven,
}

impl Identity {
    /// Where it is spoken to.
    pub fn address(&self) -> Address {
        Address { system: self.system_id, component: self.component_id }
    }

    /// Whether this is that vehicle.
    pub fn is(&self, other: &Self) -> Sameness {
        match (self.uid, other.uid) {
            (Some(a), Some(b)) if a == b => Sameness::Same,
            (Some(_), Some(_)) => Sameness::Other,
            _ => {
                let types = [self.mav_type, other.mav_type];
                let alike = types.contains(&0) || self.mav_type == other.mav_type;
                let same_id = (self.autopilot, self.system_id) == (other.autopilot, other.system_id);
                if alike && same_id { Sameness::Unproven } else { Sameness::Other }
            }
        }
    }
}

/// What carries a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// Wings alone.
    Wings,
    /// Wings, and rotors to take off and land.
    WingsAndRotors,
    /// Rotors.
    Rotors,
}

impl Carrier {
    /// By `MAV_TYPE` (MAVLink's `minimal.xml`); nothing for what does not fly or is carried otherwise.
    pub fn of(mav_type: u8) -> Option<Self> {
        match mav_type {
            1 => Some(Self::Wings),
            19..=25 => Some(Self::WingsAndRotors),
            // Quadrotor, coaxial, helicopter, hexarotor, octorotor, tricopter, dodecarotor, decarotor.
            2..=4 | 13..=15 | 29 | 35 => Some(Self::Rotors),
            _ => None,
        }
    }

    /// Whether wings alone carry it, or rotors alone.
    pub fn is_fixed_wing(self) -> Option<bool> {
        match self {
            Self::Wings => Some(true),
            Self::Rotors => Some(false),
            Self::WingsAndRotors => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vehicle(uid: Option<&str>, mav_type: u8) -> Identity {
        let uid = uid.map(|u| u.parse().expect("a hardware id"));
        let autopilot = Autopilot::ArduPilot;
        Identity { uid, autopilot, mav_type, system_id: 1, component_id: 1, home: None }
    }

    #[test]
    fn a_vehicle_is_its_hardware_not_its_system_id() {
        let a = vehicle(Some("0a1b"), 1);
        assert_eq!(a.is(&vehicle(Some("0a1b"), 1)), Sameness::Same);
        assert_eq!(a.is(&vehicle(Some("0a1c"), 1)), Sameness::Other);
        assert_eq!(a.is(&Identity { system_id: 7, mav_type: 2, ..a }), Sameness::Same, "ids can be set");
        assert_eq!(a.is(&vehicle(None, 1)), Sameness::Unproven);
        assert_eq!(a.is(&vehicle(None, 2)), Sameness::Other);
    }

    #[test]
    fn a_hardware_id_comes_from_uid2_or_uid_and_survives_a_file() {
        let mut payload = vec![0; 78];
        assert_eq!(Uid::from_version(&payload), None);
        payload[8..10].copy_from_slice(&[0x12, 0x34]);
        let short = Uid::from_version(&payload).expect("uid");
        assert_eq!(short.to_string(), "1234");
        assert_eq!(Uid::from_version(&payload[..10]), Some(short), "zeros at the end are not sent");
        payload[62] = 0xAB;
        let long = Uid::from_version(&payload).expect("uid2");
        assert_eq!(long.to_string(), "0000ab");
        assert_eq!(long.to_string().parse(), Ok(long));
        for wrong in ["", "0", "00", "xy", "é0", &"11".repeat(19)] {
            assert!(wrong.parse::<Uid>().is_err(), "{wrong}");
        }
    }
}
