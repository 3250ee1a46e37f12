//! The sinks: everything that shows, sends or keeps what the engine says.
//!
//! A sink reads snapshots from a `watch` channel and its own queue, never more. One that is slow loses its own
//! messages and counts them in [`status::SinkStatus`]; the engine never waits for it.

pub mod events;
pub mod link_meter;
pub mod log;
pub mod metrics;
pub mod recorder;
pub mod status;
#[cfg(unix)]
pub mod supervisor;
pub mod telemetry;
pub mod terminal;
pub mod web;
pub mod words;

use tokio::sync::oneshot;

/// Something that a person at a screen wants changed on the vehicle; sent only after it was confirmed, and on the web page
/// after the token was checked.
#[derive(Debug)]
pub enum Request {
    /// Upload the planned excitation mission to the vehicle.
    UploadMission {
        /// What came of it, in words for the pilot.
        reply: oneshot::Sender<Result<String, String>>,
    },
}
