//! Inertial navigation, sensor effects, filter, observability and identification of `gaware`.
//!
//! This crate is arithmetic only: it does no I/O, reads no clock, draws no random numbers of its own and knows
//! nothing of MAVLink. Time is always a parameter. It cannot navigate without GNSS for longer than its sensors allow,
//! and it treats the vehicle as a rigid body whose inertial unit does not move.

pub mod alignment;
mod averaging;
pub mod bound;
pub mod consistency;
pub mod displacement;
pub mod drift;
pub mod earth;
pub mod effects;
pub mod estimator;
pub mod filter;
pub mod ground;
pub mod heading;
pub mod identify;
mod linear;
pub mod math;
pub mod mechanization;
pub mod model;
pub mod noise_meter;
pub mod observability;
pub mod operating;
pub mod quantisation;
pub mod receiver;
pub mod rotation;
pub mod sample;
#[cfg(test)]
mod testing;
mod vibration;

/// Root of a sum of squares that are far from the limits of numbers.
pub(crate) fn rss(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}
