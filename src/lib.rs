//! `gaware`: a flight-test companion that estimates gyro g-sensitivity in flight.
//!
//! The library holds everything the binary does, so that tests and benches drive the same code.

// A closed pipe is no reason to panic: `commands::output` writes the results.
#![cfg_attr(not(test), deny(clippy::print_stdout))]

pub mod advice;
pub mod attitudes;
pub mod commands;
pub mod compare;
pub mod demo;
pub mod engine;
pub mod explain;
pub mod export;
pub mod figures;
pub mod fleet;
pub mod inputs;
pub mod link;
pub mod logs;
pub mod mission_link;
pub mod outputs;
pub mod parallel;
pub mod pipeline;
pub mod preflight;
pub mod report;
pub mod sensors;
pub mod sinks;
#[cfg(test)]
mod testing;
pub mod timeline;
pub mod unit;
