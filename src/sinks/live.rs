//! What a run is at one instant: the tasks beside the engine read it from a `watch` channel.

use super::recorder::RecorderStats;
use crate::engine::snapshot::Snapshot;
use crate::link::endpoint::LinkStatus;
use crate::sensors::Severity;
use serde::Serialize;

/// Everything a screen shows at one instant.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Live {
    /// The estimator.
    pub snapshot: Snapshot,
    /// System id of the vehicle that it listens to.
    pub vehicle: Option<u8>,
    /// The links.
    pub links: Vec<LinkStatus>,
    /// The recording.
    pub recorder: Option<RecorderStats>,
    /// The recording's file; empty where there is none.
    pub recording: String,
    /// Recent messages to the user, newest last.
    pub events: Vec<Event>,
    /// Round trip to the autopilot, ms.
    pub round_trip_ms: Option<f64>,
}

/// A message to the user.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// When, Unix µs.
    pub t_us: u64,
    /// How much it matters.
    pub severity: Severity,
    /// Text.
    pub text: String,
}
