//! How a mission transfer ended, in words for people and as a document for machines.

use super::mission::MissionError;
use gaware_mission::transfer::verified::Outcome;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::PathBuf;

/// What was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// `gaware mission upload`.
    Upload,
    /// `gaware mission download`.
    Download,
    /// `gaware mission restore`.
    Restore,
    /// `gaware mission clear`.
    Clear,
}

/// What is on the vehicle now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnVehicle {
    /// What was read from it; nothing was changed.
    Unchanged,
    /// The mission that was sent, read back and compared.
    New,
    /// The mission before, read back and compared, or never touched.
    Previous,
    /// Another station's, which came meanwhile and was left alone.
    Other,
    /// No one knows for sure.
    Unknown,
}

impl OnVehicle {
    /// As an upload reports.
    pub fn of(outcome: &Outcome) -> Self {
        match outcome {
            Outcome::Verified { .. } => Self::New,
            Outcome::RestoredPrevious { .. } => Self::Previous,
            Outcome::Foreign { .. } => Self::Other,
            Outcome::Unknown { .. } => Self::Unknown,
        }
    }
}

/// The end of a transfer (`gaware.mission/1`).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct MissionResult {
    /// `gaware.mission/1`.
    pub schema: &'static str,
    /// What was asked for.
    pub action: Action,
    /// Whether that is what came of it; the exit status says the same.
    pub done: bool,
    /// What is on the vehicle now.
    pub on_vehicle: OnVehicle,
    /// Its items without home, where that is known.
    pub items: Option<usize>,
    /// What an interrupted upload had left on the vehicle, in words.
    pub was_on_vehicle: Option<String>,
    /// Where a mission that was read is now.
    pub file: Option<PathBuf>,
    /// Where the mission is that was on the vehicle before.
    pub backup: Option<PathBuf>,
    /// What became of the geofence, in words; nothing where there is nothing to say.
    pub fence: Option<String>,
    /// What the pre-flight check warned of.
    pub warnings: Vec<String>,
    /// What the pre-flight check would have stopped, had --force not been given.
    pub overridden: Vec<String>,
    /// Journal from which `gaware mission restore` goes on.
    pub journal: Option<PathBuf>,
    /// The same in a sentence.
    pub text: String,
}

impl MissionResult {
    /// A transfer with no more to report than this.
    pub fn new(action: Action, done: bool, on_vehicle: OnVehicle, text: String) -> Self {
        Self {
            schema: "gaware.mission/1",
            action,
            done,
            on_vehicle,
            items: None,
            was_on_vehicle: None,
            file: None,
            backup: None,
            fence: None,
            warnings: Vec::new(),
            overridden: Vec::new(),
            journal: None,
            text,
        }
    }

    /// An error where it is not what was asked for.
    ///
    /// # Errors
    /// Itself.
    pub fn settled(self) -> Result<Self, MissionError> {
        if self.done { Ok(self) } else { Err(MissionError::NotVerified(Box::new(self))) }
    }
}

impl std::fmt::Display for MissionResult {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}
