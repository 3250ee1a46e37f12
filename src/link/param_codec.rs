//! Parameter messages as MAVLink payloads and back, by their published layout as in [`super::codec`].

use super::codec::Reader;
use crate::link::frame::Frame;
use gaware_mission::params::{ParamMessage, ParamName, ParamType};
use gaware_mission::transfer::Address;

const REQUEST_READ: u32 = 20;
const REQUEST_LIST: u32 = 21;
const VALUE: u32 = 22;
const SET: u32 = 23;
const ERROR: u32 = 345;
/// `MAV_PARAM_ERROR_DOES_NOT_EXIST`.
const DOES_NOT_EXIST: u8 = 1;
/// A request by name has this number.
const BY_NAME: i16 = -1;

/// What a vehicle says of a parameter in a frame: its value, or that there is none of that name.
pub fn decode(frame: &Frame) -> Option<ParamMessage> {
    let mut b = Reader::new(frame.payload());
    match frame.message_id {
        VALUE => {
            let (bits, count, index) = (b.u32(), b.u16(), b.u16());
            let name = ParamName::from_wire(std::array::from_fn(|_| b.u8()))?;
            Some(ParamMessage::Value { name, bits, kind: ParamType::from_number(b.u8()), count, index })
        }
        ERROR => {
            let _index_and_addressee = b.u32();
            let name = ParamName::from_wire(std::array::from_fn(|_| b.u8()))?;
            (b.u8() == DOES_NOT_EXIST).then_some(ParamMessage::Missing { name })
        }
        _ => None,
    }
}

/// Message id and payload of a message to the vehicle.
pub fn encode(to: Address, message: &ParamMessage) -> (u32, Vec<u8>) {
    let mut b = Vec::new();
    let address = [to.system, to.component];
    let id = match message {
        ParamMessage::RequestRead { name } => {
            b.extend(BY_NAME.to_le_bytes());
            b.extend(address);
            b.extend(name.to_wire());
            REQUEST_READ
        }
        ParamMessage::RequestIndex { index } => {
            // Numbers beyond what the field holds are none of any vehicle.
            b.extend(i16::try_from(*index).unwrap_or(i16::MAX).to_le_bytes());
            b.extend(address);
            b.extend([0; 16]);
            REQUEST_READ
        }
        ParamMessage::RequestList => {
            b.extend(address);
            REQUEST_LIST
        }
        ParamMessage::Set { name, bits, kind } => {
            b.extend(bits.to_le_bytes());
            b.extend(address);
            b.extend(name.to_wire());
            b.push(kind.number());
            SET
        }
        ParamMessage::Value { name, bits, kind, count, index } => {
            b.extend(bits.to_le_bytes());
            b.extend(count.to_le_bytes());
            b.extend(index.to_le_bytes());
            b.extend(name.to_wire());
            b.push(kind.map_or(0, ParamType::number));
            VALUE
        }
        ParamMessage::Missing { name } => {
            b.extend(BY_NAME.to_le_bytes());
            b.extend(address);
            b.extend(name.to_wire());
            b.push(DOES_NOT_EXIST);
            ERROR
        }
    };
    (id, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::{MavMessage, MavParamError};

    const VEHICLE: Address = Address { system: 1, component: 1 };

    fn framed(message: &ParamMessage) -> Frame {
        let (id, payload) = encode(VEHICLE, message);
        Frame::of_payload(Sender { system_id: 1, component_id: 191 }, 7, id, &payload).unwrap()
    }

    #[test]
    fn the_dialect_reads_what_is_written() {
        let name: ParamName = "FENCE_ENABLE".parse().unwrap();
        let MavMessage::PARAM_REQUEST_READ(m) = framed(&ParamMessage::RequestRead { name }).decode().unwrap()
        else {
            panic!("no request")
        };
        assert_eq!((m.param_index, m.target_system, m.target_component), (-1, 1, 1));
        assert_eq!(m.param_id.to_str().unwrap(), "FENCE_ENABLE");
        let set = ParamMessage::Set { name, bits: 2.5_f32.to_bits(), kind: ParamType::Real32 };
        let MavMessage::PARAM_SET(m) = framed(&set).decode().unwrap() else { panic!("no setting") };
        assert_eq!((m.param_value, m.param_type as u32), (2.5, 9));
        let value = ParamMessage::Value { name, bits: 7, kind: Some(ParamType::I32), count: 900, index: 12 };
        let MavMessage::PARAM_VALUE(m) = framed(&value).decode().unwrap() else { panic!("no value") };
        assert_eq!((m.param_value.to_bits(), m.param_count, m.param_index), (7, 900, 12));
        assert_eq!(decode(&framed(&value)), Some(value));
        let missing = ParamMessage::Missing { name };
        let MavMessage::PARAM_ERROR(m) = framed(&missing).decode().unwrap() else { panic!("no error") };
        assert_eq!((m.param_index, m.error), (-1, MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST));
        assert_eq!(m.param_id.to_str().unwrap(), "FENCE_ENABLE");
        assert_eq!(decode(&framed(&missing)), Some(missing));
    }
}
