//! One MAVLink frame as it stood on the wire, and its meaning in the `ardupilotmega` dialect.
//!
//! A frame keeps its raw bytes, so that a recording holds exactly what arrived, whatever this program makes of it.

use bytes::Bytes;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::error::ParserError;
use mavlink::{MavHeader, MavlinkVersion, Message};

/// Start byte of MAVLink 1.
pub const MAGIC_V1: u8 = 0xFE;
/// Start byte of MAVLink 2.
pub const MAGIC_V2: u8 = 0xFD;
/// Longest frame: MAVLink 2 with 255 bytes of payload and a signature.
pub const MAX_FRAME_LEN: usize = 280;
/// The only incompatibility flag that exists: the frame carries a signature.
pub const FLAG_SIGNED: u8 = 0x01;
/// Length of a signature: link id, 6 bytes of time, 6 bytes of hash.
pub const SIGNATURE_LEN: usize = 13;

const HEADER_V1: usize = 6;
const HEADER_V2: usize = 10;

/// A whole frame with a valid checksum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    raw: Bytes,
    /// Protocol version.
    pub version: Version,
    /// Sender's system.
    pub system_id: u8,
    /// Sender's component.
    pub component_id: u8,
    /// Message id.
    pub message_id: u32,
    /// Sender's running number.
    pub sequence: u8,
}

/// Protocol version of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// MAVLink 1.
    V1,
    /// MAVLink 2.
    V2,
}

/// Who a frame of ours is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sender {
    /// System id: the vehicle's, for a companion.
    pub system_id: u8,
    /// Component id.
    pub component_id: u8,
}

/// What stands at a start byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scan {
    /// A frame of this length with a valid checksum.
    Valid(usize),
    /// A header with a message id that the dialect does not have; its checksum cannot be checked.
    Unknown(usize),
    /// A frame of this length whose checksum is wrong.
    BadChecksum(usize),
    /// Not enough bytes yet to decide.
    Incomplete,
    /// No start byte, or a header that no frame has.
    Nothing,
}

/// Why bytes are not a frame, or a frame not a message.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// The bytes are not exactly one valid frame.
    #[error("these {0} bytes are not one valid MAVLink frame")]
    NotAFrame(usize),
    /// The dialect's parser refused the payload.
    #[error("message {id} cannot be read: {reason}")]
    Payload {
        /// Message id.
        id: u32,
        /// What the parser said.
        reason: String,
    },
}

/// Looks at the bytes of a possible frame; `bytes[0]` is the candidate for the start byte.
pub fn scan(bytes: &[u8]) -> Scan {
    let Some(&magic) = bytes.first() else { return Scan::Incomplete };
    let (header, trailer, id) = match magic {
        MAGIC_V1 => {
            let Some(&id) = bytes.get(5) else { return Scan::Incomplete };
            (HEADER_V1, 2, u32::from(id))
        }
        MAGIC_V2 => {
            // An unknown incompatibility flag means a format no one here can read.
            match bytes.get(2) {
                Some(flags) if flags & !FLAG_SIGNED != 0 => return Scan::Nothing,
                _ => {}
            }
            let Some(&[flags, _, _, _, _, a, b, c]) = bytes.get(2..HEADER_V2) else {
                return Scan::Incomplete;
            };
            let signature = if flags & FLAG_SIGNED != 0 { SIGNATURE_LEN } else { 0 };
            (HEADER_V2, 2 + signature, u32::from_le_bytes([a, b, c, 0]))
        }
        _ => return Scan::Nothing,
    };
    let Some(&payload_len) = bytes.get(1) else { return Scan::Incomplete };
    let end = header + usize::from(payload_len);
    let len = end + trailer;
    let (Some(covered), Some(&[low, high]), true) =
        (bytes.get(1..end), bytes.get(end..end + 2), bytes.len() >= len)
    else {
        return Scan::Incomplete;
    };
    match extra_crc(id) {
        None => Scan::Unknown(len),
        Some(extra) if mavlink::calculate_crc(covered, extra) == u16::from_le_bytes([low, high]) => {
            Scan::Valid(len)
        }
        Some(_) => Scan::BadChecksum(len),
    }
}

/// A message as the bytes of a MAVLink 2 frame.
pub fn encode(header: MavHeader, message: &MavMessage) -> Vec<u8> {
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    raw.raw_bytes().to_vec()
}

/// CRC_EXTRA of a message of the dialect.
fn extra_crc(id: u32) -> Option<u8> {
    match MavMessage::extra_crc(id) {
        // The lookup says 0 for what it does not know, and a known message may well have 0.
        0 => MavMessage::default_message_from_id(id).map(|_| 0),
        crc => Some(crc),
    }
}

impl Frame {
    /// Takes exactly one frame.
    ///
    /// # Errors
    /// When the bytes are not one whole frame with a valid checksum.
    pub fn parse(raw: Bytes) -> Result<Self, FrameError> {
        if scan(&raw) != Scan::Valid(raw.len()) {
            return Err(FrameError::NotAFrame(raw.len()));
        }
        Self::from_valid(raw).ok_or(FrameError::NotAFrame(0))
    }

    /// From bytes that [`scan`] has called valid.
    pub fn from_valid(raw: Bytes) -> Option<Self> {
        let (version, header) = match *raw.first()? {
            MAGIC_V1 => {
                let &[sequence, system, component, id] = raw.get(2..HEADER_V1)?.first_chunk()?;
                (Version::V1, (sequence, system, component, u32::from(id)))
            }
            _ => {
                let &[sequence, system, component, a, b, c] = raw.get(4..HEADER_V2)?.first_chunk()?;
                (Version::V2, (sequence, system, component, u32::from_le_bytes([a, b, c, 0])))
            }
        };
        let (sequence, system_id, component_id, message_id) = header;
        Some(Self { raw, version, system_id, component_id, message_id, sequence })
    }

    /// Makes a MAVLink 2 frame of a message.
    pub fn encode(from: Sender, sequence: u8, message: &MavMessage) -> Self {
        let header =
            MavHeader { system_id: u32::from(from.system_id), component_id: from.component_id, sequence };
        Self {
            raw: encode(header, message).into(),
            version: Version::V2,
            system_id: from.system_id,
            component_id: from.component_id,
            message_id: message.message_id(),
            sequence,
        }
    }

    /// Makes a MAVLink 2 frame of a payload, for messages with values that the dialect's types do not hold. Zeros at the
    /// end may be given or left out.
    ///
    /// # Errors
    /// When the payload is too long, or the dialect does not know the message, so that its checksum cannot be made.
    pub fn of_payload(
        from: Sender,
        sequence: u8,
        message_id: u32,
        payload: &[u8],
    ) -> Result<Self, FrameError> {
        let used = payload.iter().rposition(|b| *b != 0).map_or(1, |last| last + 1);
        let payload = payload.get(..used).unwrap_or(&[0]);
        let unfit = || FrameError::NotAFrame(payload.len());
        let len = u8::try_from(payload.len()).map_err(|_| unfit())?;
        let extra = extra_crc(message_id).ok_or_else(unfit)?;
        let [a, b, c, _] = message_id.to_le_bytes();
        let mut raw = vec![MAGIC_V2, len, 0, 0, sequence, from.system_id, from.component_id, a, b, c];
        raw.extend(payload);
        let crc = mavlink::calculate_crc(raw.get(1..).unwrap_or_default(), extra);
        raw.extend(crc.to_le_bytes());
        Self::parse(raw.into())
    }

    /// Who sent it, and its number.
    pub fn header(&self) -> MavHeader {
        let Self { system_id, component_id, sequence, .. } = *self;
        MavHeader { system_id: u32::from(system_id), component_id, sequence }
    }

    /// The bytes as they stood on the wire.
    pub fn raw(&self) -> &Bytes {
        &self.raw
    }

    /// The payload; MAVLink 2 leaves zeros at its end out.
    pub fn payload(&self) -> &[u8] {
        let header = match self.version {
            Version::V1 => HEADER_V1,
            Version::V2 => HEADER_V2,
        };
        let len = self.raw.get(1).map_or(0, |n| usize::from(*n));
        self.raw.get(header..header + len).unwrap_or_default()
    }

    /// The signature, where there is one.
    pub fn signature(&self) -> Option<&[u8; SIGNATURE_LEN]> {
        let signed = self.version == Version::V2 && self.raw.get(2).is_some_and(|f| f & FLAG_SIGNED != 0);
        if signed { self.raw.last_chunk() } else { None }
    }

    /// The message. Enumerated fields that the dialect does not know are replaced by a neutral value in the messages
    /// that estimation needs, because a new kind of fix or vehicle must not cost the measurement.
    ///
    /// # Errors
    /// When the payload cannot be read even so.
    pub fn decode(&self) -> Result<MavMessage, FrameError> {
        let version = match self.version {
            Version::V1 => MavlinkVersion::V1,
            Version::V2 => MavlinkVersion::V2,
        };
        let payload = self.payload();
        MavMessage::parse(version, self.message_id, payload)
            .or_else(|e| match neutralised(self.message_id, payload, &e) {
                Some(patched) => MavMessage::parse(version, self.message_id, &patched),
                None => Err(e),
            })
            .map_err(|e| FrameError::Payload { id: self.message_id, reason: e.to_string() })
    }
}

/// The payload with its unknown enumeration values replaced.
fn neutralised(id: u32, payload: &[u8], error: &ParserError) -> Option<Vec<u8>> {
    let mut bytes = payload.to_vec();
    match (id, error) {
        (0, _) => {
            // HEARTBEAT: type, autopilot, base_mode, system_status.
            let [kind, autopilot, _, status] = bytes.get_mut(4..8)?.first_chunk_mut::<4>()?;
            if matches!(error, ParserError::InvalidEnum { enum_type, .. } if *enum_type == "MavType") {
                *kind = 0;
            }
            if *autopilot > 20 {
                *autopilot = 0;
            }
            if *status > 8 {
                *status = 0;
            }
        }
        (24, _) => {
            // GPS_RAW_INT.fix_type: kinds beyond PPP are still three-dimensional.
            *bytes.get_mut(28)? = 3;
        }
        (105, _) => {
            // HIGHRES_IMU.fields_updated: 13 bits are defined.
            *bytes.get_mut(61)? &= 0x1F;
        }
        _ => return None,
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA, RAW_IMU_DATA};

    const VEHICLE: Sender = Sender { system_id: 1, component_id: 1 };

    /// Replaces one payload byte and mends the checksum.
    fn with_byte(frame: &Frame, at: usize, value: u8, extra: u8) -> Frame {
        let mut raw = frame.raw().to_vec();
        raw[HEADER_V2 + at] = value;
        let end = raw.len() - 2;
        let crc = mavlink::calculate_crc(&raw[1..end], extra);
        raw[end..].copy_from_slice(&crc.to_le_bytes());
        Frame::parse(raw.into()).unwrap()
    }

    #[test]
    fn a_message_survives_encoding() {
        let message = MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec: 7, zacc: -1000, ..Default::default() });
        let frame = Frame::encode(VEHICLE, 9, &message);
        assert_eq!(frame.decode().unwrap(), message);
        assert_eq!(Frame::parse(frame.raw().clone()).unwrap(), frame);
    }

    #[test]
    fn an_unknown_kind_of_fix_keeps_its_position() {
        let fix = GPS_RAW_INT_DATA {
            lat: 473_977_420,
            fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            yaw: 9,
            ..Default::default()
        };
        let frame = Frame::encode(VEHICLE, 0, &MavMessage::GPS_RAW_INT(fix));
        let odd = with_byte(&frame, 28, 99, 24);
        match odd.decode().unwrap() {
            MavMessage::GPS_RAW_INT(m) => assert_eq!(m.lat, 473_977_420),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_unknown_vehicle_type_keeps_its_heartbeat() {
        let frame = Frame::encode(
            VEHICLE,
            0,
            &MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavlink_version: 3, ..Default::default() }),
        );
        let odd = with_byte(&frame, 4, 250, 50);
        assert!(matches!(odd.decode().unwrap(), MavMessage::HEARTBEAT(_)));
    }
}
