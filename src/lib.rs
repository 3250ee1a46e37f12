//! `gaware`: a flight-test companion that estimates gyro g-sensitivity in flight.
//!
//! The library holds everything the binary does, so that tests and benches drive the same code. What needs no operating system (readers, time
//! line, engine, explain, reports) also builds for WebAssembly, for the page in the browser.

// A closed pipe is no reason to panic: `commands::output` writes the results.
#![cfg_attr(not(test), deny(clippy::print_stdout))]

pub mod advice;
pub mod aids;
pub mod air;
pub mod attitudes;
#[cfg(not(target_family = "wasm"))]
pub mod commands;
pub mod compare;
pub mod compass;
#[cfg(not(target_family = "wasm"))]
pub mod demo;
pub mod engine;
pub mod explain;
#[cfg(not(target_family = "wasm"))]
pub mod export;
pub mod figures;
pub mod fleet;
pub mod health;
pub mod inputs;
pub mod link;
pub mod logs;
#[cfg(not(target_family = "wasm"))]
pub mod mission_link;
pub mod outputs;
pub mod parallel;
pub mod pipeline;
#[cfg(not(target_family = "wasm"))]
pub mod preflight;
pub mod report;
pub mod sensors;
#[cfg(not(target_family = "wasm"))]
pub mod sinks;
#[cfg(test)]
mod testing;
pub mod timeline;
pub mod unit;
pub mod view;
