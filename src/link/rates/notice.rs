//! Messages to the user about message rates.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A message to the user.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "rate_notice")]
pub enum RateNotice {
    /// The autopilot refused the rate that is wanted.
    Refused {
        /// Message id.
        message_id: u32,
        /// Rate wanted, Hz.
        rate_hz: u16,
        /// Rate it gives instead, Hz; nothing where it does not send the message at all.
        granted_hz: Option<u16>,
    },
    /// A message arrives more slowly than was agreed.
    Slow {
        /// Message id.
        message_id: u32,
        /// Agreed, Hz.
        rate_hz: u16,
        /// Measured, Hz.
        measured_hz: f64,
    },
    /// No command is answered; the old way of asking is tried.
    OldRequests,
}

impl fmt::Display for RateNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused { message_id, rate_hz, granted_hz: Some(granted) } => write!(
                f,
                "the autopilot gives message {message_id} at {granted} Hz only, {rate_hz} Hz are wanted (its main loop is too slow: SCHED_LOOP_RATE)"
            ),
            Self::Refused { message_id, rate_hz, granted_hz: None } => {
                write!(f, "the autopilot does not send message {message_id} ({rate_hz} Hz are wanted)")
            }
            Self::Slow { message_id, rate_hz, measured_hz } => write!(
                f,
                "message {message_id} arrives at {measured_hz:.1} Hz instead of {rate_hz} Hz; the link is too slow, the autopilot sends it no faster, or another station has changed the rate; asking again"
            ),
            Self::OldRequests => f.write_str(
                "the autopilot does not answer SET_MESSAGE_INTERVAL; asking by REQUEST_DATA_STREAM, which other stations may overwrite",
            ),
        }
    }
}
