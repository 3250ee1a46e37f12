//! How a link is doing, for screens and results.

use super::address::Address;
use super::framer::FramerStats;
use serde::Serialize;

/// How a link is doing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LinkStatus {
    /// Where it leads.
    pub address: Address,
    /// Whether it is open.
    pub up: bool,
    /// Why it is not, in words; empty while it is.
    pub problem: String,
    /// Times it was opened.
    pub openings: u64,
    /// Bytes received.
    pub received_bytes: u64,
    /// Frames found in them.
    pub framer: FramerStats,
    /// Frames that it could not send: it was down, or the other side does not read.
    pub unsent: u64,
}
