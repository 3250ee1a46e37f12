//! Names, types and values of parameters.

use serde::{Deserialize, Serialize};

/// The name of a parameter: 1 to 16 ASCII characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ParamName([u8; 16]);

/// Not a name of a parameter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no name of a parameter: it has 1 to 16 letters, digits and underscores")]
pub struct NameError(String);

impl ParamName {
    /// From its 16 bytes on the wire, filled with zeros; `None` where they are no name.
    pub fn from_wire(bytes: [u8; 16]) -> Option<Self> {
        let length = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        let (name, rest) = bytes.split_at(length);
        let valid = !name.is_empty() && name.iter().all(|b| b.is_ascii_graphic());
        // What follows the end may be anything.
        let mut clean = bytes;
        clean.iter_mut().skip(length).for_each(|b| *b = 0);
        (valid && rest.len() + length == 16).then_some(Self(clean))
    }

    /// Its 16 bytes on the wire.
    pub fn to_wire(self) -> [u8; 16] {
        self.0
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|b| *b == 0).unwrap_or(self.0.len());
        self.0.get(..length).and_then(|b| std::str::from_utf8(b).ok()).unwrap_or_default()
    }
}

impl std::str::FromStr for ParamName {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        let valid = text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        let mut bytes = [0; 16];
        match bytes.get_mut(..text.len()) {
            Some(place) if valid && !text.is_empty() => place.copy_from_slice(text.as_bytes()),
            _ => return Err(NameError(text.to_owned())),
        }
        Ok(Self(bytes))
    }
}

impl TryFrom<String> for ParamName {
    type Error = NameError;

    fn try_from(text: String) -> Result<Self, NameError> {
        text.parse()
    }
}

impl From<ParamName> for String {
    fn from(name: ParamName) -> Self {
        name.to_string()
    }
}

impl std::fmt::Display for ParamName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// `MAV_PARAM_TYPE`, as far as it fits into four bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum ParamType {
    /// 1.
    U8,
    /// 2.
    I8,
    /// 3.
    U16,
    /// 4.
    I16,
    /// 5.
    U32,
    /// 6.
    I32,
    /// 9.
    Real32,
}

impl ParamType {
    /// From its number.
    pub fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            1 => Self::U8,
            2 => Self::I8,
            3 => Self::U16,
            4 => Self::I16,
            5 => Self::U32,
            6 => Self::I32,
            9 => Self::Real32,
            _ => return None,
        })
    }

    /// Its number.
    pub fn number(self) -> u8 {
        match self {
            Self::U8 => 1,
            Self::I8 => 2,
            Self::U16 => 3,
            Self::I16 => 4,
            Self::U32 => 5,
            Self::I32 => 6,
            Self::Real32 => 9,
        }
    }
}

impl TryFrom<u8> for ParamType {
    type Error = String;

    fn try_from(number: u8) -> Result<Self, String> {
        Self::from_number(number).ok_or_else(|| format!("{number} is no type of a parameter"))
    }
}

impl From<ParamType> for u8 {
    fn from(kind: ParamType) -> Self {
        kind.number()
    }
}

impl ParamType {
    /// Whether a value of this type can be exactly this, up to single precision.
    pub fn holds(self, value: f64) -> bool {
        let within = |low: f64, high: f64| value.fract() == 0.0 && (low..=high).contains(&value);
        match self {
            Self::U8 => within(0.0, f64::from(u8::MAX)),
            Self::I8 => within(f64::from(i8::MIN), f64::from(i8::MAX)),
            Self::U16 => within(0.0, f64::from(u16::MAX)),
            Self::I16 => within(f64::from(i16::MIN), f64::from(i16::MAX)),
            Self::U32 => within(0.0, f64::from(u32::MAX)),
            Self::I32 => within(f64::from(i32::MIN), f64::from(i32::MAX)),
            Self::Real32 => value.is_finite() && (value as f32).is_finite(),
        }
    }
}

impl std::fmt::Display for ParamType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::Real32 => "float",
        })
    }
}

/// How an integer lies in the four bytes of a value (MAVLink "Parameter Protocol", "Parameter Encoding").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// ArduPilot: the bytes are a float that has the value of the integer (C cast).
    ByValue,
    /// PX4: the bytes are those of the integer.
    ByBytes,
}

impl Encoding {
    /// The habit of this autopilot.
    pub fn of(autopilot: crate::item::Autopilot) -> Self {
        match autopilot {
            crate::item::Autopilot::ArduPilot => Self::ByValue,
            crate::item::Autopilot::Px4 => Self::ByBytes,
        }
    }

    /// The value that these bytes stand for.
    pub fn decode(self, bits: u32, kind: ParamType) -> ParamValue {
        let float = f64::from(f32::from_bits(bits));
        let [a, b, ..] = bits.to_le_bytes();
        let value = match (self, kind) {
            (Self::ByValue, _) | (Self::ByBytes, ParamType::Real32) => float,
            (Self::ByBytes, ParamType::U8) => f64::from(a),
            (Self::ByBytes, ParamType::I8) => f64::from(a.cast_signed()),
            (Self::ByBytes, ParamType::U16) => f64::from(u16::from_le_bytes([a, b])),
            (Self::ByBytes, ParamType::I16) => f64::from(i16::from_le_bytes([a, b])),
            (Self::ByBytes, ParamType::U32) => f64::from(bits),
            (Self::ByBytes, ParamType::I32) => f64::from(bits.cast_signed()),
        };
        ParamValue { kind, value }
    }

    /// Whether two values of a type are one on the wire.
    pub fn same(self, kind: ParamType, a: f64, b: f64) -> bool {
        let bits = |value| self.encode(ParamValue { kind, value });
        let zero = |v: f64| v as f32 == 0.0;
        bits(a) == bits(b) || (zero(a) && zero(b) && (kind == ParamType::Real32 || self == Self::ByValue))
    }

    /// The bytes of a value; one beyond the range of its type becomes the nearest one.
    pub fn encode(self, value: ParamValue) -> u32 {
        let v = value.value;
        match (self, value.kind) {
            (Self::ByValue, _) | (Self::ByBytes, ParamType::Real32) => (v as f32).to_bits(),
            (Self::ByBytes, ParamType::U8) => u32::from(v as u8),
            (Self::ByBytes, ParamType::I8) => u32::from((v as i8).cast_unsigned()),
            (Self::ByBytes, ParamType::U16) => u32::from(v as u16),
            (Self::ByBytes, ParamType::I16) => u32::from((v as i16).cast_unsigned()),
            (Self::ByBytes, ParamType::U32) => v as u32,
            (Self::ByBytes, ParamType::I32) => (v as i32).cast_unsigned(),
        }
    }
}

/// A value with its type. An `f64` holds every value of these types.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamValue {
    /// Type.
    pub kind: ParamType,
    /// Value.
    pub value: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn integers_lie_differently_in_the_bytes_of_the_two_autopilots() {
        let two = ParamValue { kind: ParamType::I32, value: 2.0 };
        assert_eq!((Encoding::ByValue.encode(two), Encoding::ByBytes.encode(two)), (2.0_f32.to_bits(), 2));
        // The wrong one of the two reads nonsense.
        assert_eq!(Encoding::ByValue.decode(2, ParamType::I32).value, f64::from(f32::from_bits(2)));
    }

    #[test]
    fn names_end_with_a_zero_or_with_the_sixteenth_character() {
        let name: ParamName = "MIS_TKO_LAND_REQ".parse().expect("sixteen");
        assert_eq!((name.as_str(), ParamName::from_wire(name.to_wire())), ("MIS_TKO_LAND_REQ", Some(name)));
        let mut noisy = *b"GF_ACTION\0trash!";
        assert_eq!(ParamName::from_wire(noisy), "GF_ACTION".parse().ok());
        noisy[0] = 0;
        assert_eq!(ParamName::from_wire(noisy), None);
        assert!("".parse::<ParamName>().is_err() && "SEVENTEEN_LETTERS".parse::<ParamName>().is_err());
    }

    proptest! {
        #[test]
        fn every_value_survives_both_encodings(number in 1u8..10, raw: i16) {
            let Some(kind) = ParamType::from_number(number) else { return Ok(()) };
            let value = match kind {
                ParamType::U8 => f64::from(raw as u8),
                ParamType::I8 => f64::from(raw as i8),
                ParamType::U16 | ParamType::U32 => f64::from(raw as u16),
                ParamType::I16 | ParamType::I32 => f64::from(raw),
                ParamType::Real32 => f64::from(raw) * 0.5,
            };
            let value = ParamValue { kind, value };
            for encoding in [Encoding::ByValue, Encoding::ByBytes] {
                prop_assert_eq!(encoding.decode(encoding.encode(value), kind), value);
            }
            prop_assert_eq!(kind.number(), number);
        }
    }
}
