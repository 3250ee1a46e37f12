//! The sinks: everything that shows, sends or keeps what the engine says.
//!
//! A sink reads snapshots from a `watch` channel and its own queue, never more. One that is slow loses its own
//! messages and counts them in [`status::SinkStatus`]; the engine never waits for it.

pub mod events;
pub mod metrics;
pub mod recorder;
pub mod status;
pub mod telemetry;
pub mod terminal;
pub mod web;
pub mod words;
