//! The sinks: everything that shows, sends or keeps what the engine says.
//!
//! A sink reads snapshots from a `watch` channel and its own queue, never more. One that is slow loses its own
//! messages and counts them in [`status::SinkStatus`]; the engine never waits for it.

pub mod foxglove;
pub mod live;
pub mod log;
pub mod messages;
pub mod metrics;
pub mod recorder;
#[cfg(unix)]
pub mod supervisor;
pub mod telemetry;
pub mod terminal;
pub mod web;
pub mod words;

pub use crate::engine::events;
pub use crate::view::{link_meter, status};
use tokio::sync::oneshot;

/// What a person at a screen may want changed on the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Its mission becomes the planned one.
    Mission,
    /// Parameters get the values of a file.
    Parameters,
}

/// A change that is wanted; sent only after it was confirmed, and on the web page after the token was checked.
#[derive(Debug)]
pub struct Request {
    /// Which.
    pub change: Change,
    /// What came of it, in words for the pilot.
    pub reply: oneshot::Sender<Result<String, String>>,
}
