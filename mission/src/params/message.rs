//! The messages of the parameter protocol, apart from any MAVLink library.

use super::{ParamName, ParamType};

/// A message of the parameter protocol; fields as in MAVLink.
#[derive(Debug, Clone, PartialEq)]
pub enum ParamMessage {
    /// `PARAM_REQUEST_READ` (20) by name.
    RequestRead {
        /// Parameter.
        name: ParamName,
    },
    /// `PARAM_REQUEST_READ` (20) by number.
    RequestIndex {
        /// Number in the vehicle's list.
        index: u16,
    },
    /// `PARAM_REQUEST_LIST` (21): all of them.
    RequestList,
    /// `PARAM_VALUE` (22).
    Value {
        /// Parameter.
        name: ParamName,
        /// The four bytes of the value, see [`super::Encoding`].
        bits: u32,
        /// Their type; unknown ones are `None`.
        kind: Option<ParamType>,
        /// Parameters in all.
        count: u16,
        /// Its number; 65535 where it has none.
        index: u16,
    },
    /// `PARAM_ERROR` (345) with `MAV_PARAM_ERROR_DOES_NOT_EXIST`, to anybody: what ArduPilot says from 4.7 on; before it is silent.
    Missing {
        /// The name that no parameter has.
        name: ParamName,
    },
    /// `PARAM_SET` (23).
    Set {
        /// Parameter.
        name: ParamName,
        /// The four bytes of the value.
        bits: u32,
        /// Their type.
        kind: ParamType,
    },
}
