//! The way between a vehicle and the program: framing, endpoints, and the small protocols that keep a link useful.
//!
//! Everything that decides anything is a state machine without sockets or clocks; the tasks around them only move
//! bytes.

pub mod address;
pub mod codec;
#[cfg(not(target_family = "wasm"))]
pub mod endpoint;
pub mod guard;
pub mod heartbeat;
pub mod param_codec;
pub mod rates;
pub mod signing;
pub mod status;
pub mod systems;
pub mod timesync;
pub mod vehicle;

pub use gaware_wire::{frame, framer};
