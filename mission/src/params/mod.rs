//! The parameter protocol: messages and times in, messages out; no sockets, no clock (MAVLink "Parameter Protocol").
//!
//! [`ParamRead`] reads parameters by name, several at a time, with retries; [`list::ParamList`] reads all of them; [`apply::ParamApply`] changes
//! some, verified. A parameter travels as four bytes with a type; how an integer lies in
//! them differs between autopilots, see [`Encoding`].

pub mod apply;
pub mod file;
pub mod list;
mod message;
mod read;
mod value;

pub use message::ParamMessage;
pub use read::{ParamRead, ParamTiming, Parameters};
pub use value::{Encoding, NameError, ParamName, ParamType, ParamValue};
