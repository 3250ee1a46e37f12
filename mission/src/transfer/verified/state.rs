//! How far an upload may go.

use crate::item::Autopilot;

/// How far to go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Upload although a mission is being flown or the vehicle is armed in its mission mode.
    pub even_while_flying: bool,
    /// Put the backup over what is of neither mission, too.
    pub over_others: bool,
    /// Read what was verified once more after a short quiet.
    pub confirm: bool,
    /// Whom the plan was made for, where that is known; named when the vehicle refuses it.
    pub planned_for: Option<Autopilot>,
    /// Attempts to upload the new mission.
    pub upload_attempts: u32,
    /// Attempts to put the backup back before calling for help.
    pub restore_attempts: u32,
    /// Attempts of each download.
    pub download_attempts: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            even_while_flying: false,
            over_others: false,
            confirm: true,
            planned_for: None,
            upload_attempts: 2,
            restore_attempts: 4,
            download_attempts: 6,
        }
    }
}

/// What an interrupted upload is to end with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Goal {
    /// The mission that was on the vehicle before.
    Previous,
    /// The new one; the previous one if that fails.
    New,
    /// Whichever is there whole; otherwise the previous one.
    Whole,
}
