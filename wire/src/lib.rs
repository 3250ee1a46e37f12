//! The MAVLink codec: frames found in any stream of bytes, their meaning in the `ardupilotmega` dialect, and frames of ours.
//!
//! The program and its simulated autopilot share it. No sockets, no clock.

pub mod frame;
pub mod framer;
pub mod heartbeat;
