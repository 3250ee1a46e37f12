//! The way between a vehicle and the program: framing, endpoints, and the small protocols that keep a link useful.
//!
//! Everything that decides anything is a state machine without sockets or clocks; the tasks around them only move
//! bytes.

pub mod address;
pub mod endpoint;
pub mod guard;
pub mod heartbeat;
pub mod rates;
pub mod signing;
pub mod systems;
pub mod timesync;

pub use gaware_wire::{frame, framer};
