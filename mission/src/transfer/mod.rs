//! The mission transfer: messages and times in, messages out; no sockets, no clock (MAVLink "Mission Protocol").
//!
//! [`Upload`], [`Download`] and [`Clear`] are single transfers; [`verified::VerifiedUpload`] is the one that vehicles
//! deserve: back up, upload, read back, restore on failure. Times are seconds on any monotonic base.

mod clear;
mod download;
pub mod events;
mod message;
mod on_board;
mod upload;
pub mod verified;

pub use clear::Clear;
pub use download::{Download, Downloaded};
pub use message::{Address, Envelope, MissionMessage, MissionResult};
pub use on_board::OnBoard;
pub use upload::Upload;

use crate::item::MissionKind;

/// Waiting times and patience (FIELD_NOTES, "Mission protocol").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Wait for the first reply, s.
    pub first_reply_s: f64,
    /// Wait for each item of a download, s; stretched to twice the measured round trip on slower links.
    pub item_s: f64,
    /// Repetitions of a message that got no reply.
    pub retries: u32,
    /// Silence after which an upload is over, s: ArduPilot gives up after 8 s, PX4 after 5 s.
    pub silence_s: f64,
    /// Longest time without a new item being asked for, s, however often the vehicle asks for old ones.
    pub progress_s: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self { first_reply_s: 1.5, item_s: 0.25, retries: 5, silence_s: 9.0, progress_s: 30.0 }
    }
}

/// Who talks with whom about which kind of mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peers {
    /// This program.
    pub me: Address,
    /// The autopilot.
    pub vehicle: Address,
    /// Which of the vehicle's lists.
    pub kind: MissionKind,
    /// Waiting times.
    pub timing: Timing,
}

impl Peers {
    /// The mission itself, with the usual waiting times.
    pub fn new(me: Address, vehicle: Address) -> Self {
        Self { me, vehicle, kind: MissionKind::Mission, timing: Timing::default() }
    }

    /// The same about another list of the vehicle.
    #[must_use]
    pub fn about(self, kind: MissionKind) -> Self {
        Self { kind, ..self }
    }

    /// `MAV_MISSION_TYPE`.
    pub(crate) fn mission_type(&self) -> u8 {
        self.kind.number()
    }

    /// Whether a message is from the vehicle, for us (or for all), about this kind of mission.
    pub(crate) fn concerns(&self, envelope: &Envelope) -> bool {
        envelope.from == self.vehicle
            && (envelope.to.system == 0 || envelope.to.system == self.me.system)
            && (envelope.to.component == 0 || envelope.to.component == self.me.component)
            && envelope.message.mission_type().is_none_or(|t| t == self.mission_type())
    }
}

/// What a transfer asks its caller to do.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Send this to the vehicle.
    Send(MissionMessage),
    /// Report to the user.
    Progress {
        /// Items done.
        done: usize,
        /// Items in all.
        total: usize,
    },
}

/// Why a transfer failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// No reply to the opening message.
    #[error("the vehicle does not answer; check the link and the system id")]
    NoReply,
    /// The vehicle fell silent in between.
    #[error("the vehicle fell silent after {done} of {total} items")]
    Silent {
        /// Items done.
        done: usize,
        /// Items in all.
        total: usize,
    },
    /// The vehicle asks for the same items for ever.
    #[error("the vehicle asked for the same items again and again, {done} of {total} in all")]
    NoProgress {
        /// Items done.
        done: usize,
        /// Items in all.
        total: usize,
    },
    /// The vehicle said no.
    #[error("the vehicle refused: {}", .result.describe())]
    Refused {
        /// What it said.
        result: MissionResult,
        /// The item it asked for last, as the vehicle counts.
        seq: Option<u16>,
    },
    /// The user.
    #[error("cancelled")]
    Cancelled,
    /// It was not to go on.
    #[error("{0}")]
    Stopped(String),
    /// More items than a sequence number can count.
    #[error("a mission of {0} items cannot be transferred")]
    TooLong(usize),
}

impl TransferError {
    /// Whether trying again with the same mission may work.
    pub fn is_transient(&self) -> bool {
        match self {
            Self::NoReply | Self::Silent { .. } | Self::NoProgress { .. } => true,
            Self::Refused { result, .. } => !result.is_final(),
            Self::Cancelled | Self::Stopped(_) | Self::TooLong(_) => false,
        }
    }
}

/// The opening message of a transfer and its repetitions.
#[derive(Debug, Clone)]
pub(crate) struct Opening {
    pub deadline: f64,
    retries_left: u32,
    period: f64,
}

impl Opening {
    pub fn new(now: f64, timing: &Timing) -> Self {
        Self {
            deadline: now + timing.first_reply_s,
            retries_left: timing.retries,
            period: timing.first_reply_s,
        }
    }

    /// At its deadline: true to send again, false when patience is over.
    pub fn again(&mut self, now: f64) -> bool {
        if self.retries_left == 0 {
            return false;
        }
        self.retries_left -= 1;
        self.deadline = now + self.period;
        true
    }
}

#[cfg(test)]
mod tests;
