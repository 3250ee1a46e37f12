//! The journal of a mission transfer: what was on the vehicle before and what was to replace it, on disk before the first item goes out.
//!
//! It is removed when one of the two missions has been read back whole. If the program dies in between, or the link never comes back,
//! `gaware mission restore` finds it and knows what to put back.

use super::files::{self, FileError};
use super::journal_file::{self, JournalFiles};
use super::vehicle::Vehicle;
use gaware_mission::compare::differences;
use gaware_mission::fence::Fence;
use gaware_mission::files::plan::{self, PlanFile};
use gaware_mission::item::{Autopilot, Mission};
use gaware_mission::transfer::verified::Outcome;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Schema of the file.
const SCHEMA: &str = "gaware.transfer/1";
/// Its file.
const FILES: JournalFiles = JournalFiles("mission-transfer-system");

/// A transfer that has begun.
#[derive(Debug, Clone, PartialEq)]
pub struct Journal {
    /// The file.
    pub path: PathBuf,
    /// System id of the vehicle.
    pub system_id: u8,
    /// Its habits.
    pub autopilot: Autopilot,
    /// When it began, s since 1970; 0 where the clock was not set.
    pub begun_unix_s: u64,
    /// On the vehicle before.
    pub previous: Mission,
    /// To be on it afterwards.
    pub new: Mission,
    /// The geofence before and the one that goes along with the new mission, where one does.
    pub fences: Option<(Fence, Fence)>,
}

/// As written. The missions are whole `.plan` documents, so that a ground station can open them in need.
#[derive(Debug, Serialize, Deserialize)]
struct Document {
    schema: String,
    system_id: u8,
    autopilot: Autopilot,
    begun_unix_s: u64,
    /// Whether the geofences in the two documents count.
    #[serde(default)]
    with_fence: bool,
    previous: Value,
    new: Value,
}

impl Journal {
    /// Writes the journal of a transfer that is about to begin, down to the disk.
    ///
    /// # Errors
    /// There is one already: another transfer to this vehicle is under way or was interrupted. Or the disk refuses.
    pub fn begin(
        folder: &Path,
        vehicle: &Vehicle,
        previous: &Mission,
        new: &Mission,
        fences: Option<(Fence, Fence)>,
    ) -> Result<Self, FileError> {
        Self::check(folder, vehicle)?;
        let system_id = vehicle.address.system;
        let path = Self::path(folder, system_id);
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let journal = Self {
            path,
            system_id,
            autopilot: vehicle.autopilot,
            begun_unix_s: since.as_secs(),
            previous: previous.clone(),
            new: new.clone(),
            fences,
        };
        journal.write(vehicle.mav_type)?;
        // What cannot be read again could not be put back.
        let read = Self::read(&journal.path);
        let same = |a: &Mission, b: &Mission| differences(vehicle.autopilot, a, b).is_empty();
        match read {
            Ok(read)
                if same(&read.previous, previous)
                    && same(&read.new, new)
                    && journal.same_fences(&read, vehicle.autopilot) =>
            {
                Ok(journal)
            }
            other => {
                let reason = other.err().map_or_else(
                    || "a mission changes when it is written to a file and read again".to_owned(),
                    |e| e.to_string(),
                );
                let path = journal.path.clone();
                journal.end()?;
                Err(FileError::Content { path, reason })
            }
        }
    }

    /// Whether the fences are stored alike by a vehicle.
    fn same_fences(&self, other: &Self, autopilot: Autopilot) -> bool {
        let list = |fence: &Fence| Mission { home: None, items: fence.items() };
        let same = |a: &Fence, b: &Fence| differences(autopilot, &list(a), &list(b)).is_empty();
        match (&self.fences, &other.fences) {
            (None, None) => true,
            (Some((a, b)), Some((c, d))) => same(a, c) && same(b, d),
            _ => false,
        }
    }

    /// Whether a transfer to this vehicle may begin.
    ///
    /// # Errors
    /// Another one is under way or was interrupted.
    pub fn check(folder: &Path, vehicle: &Vehicle) -> Result<(), FileError> {
        let path = Self::path(folder, vehicle.address.system);
        if path.exists() { Err(FileError::Interrupted { path }) } else { Ok(()) }
    }

    fn path(folder: &Path, system_id: u8) -> PathBuf {
        FILES.path(folder, system_id)
    }

    fn write(&self, mav_type: u8) -> Result<(), FileError> {
        let wrong = |reason: String| FileError::Content { path: self.path.clone(), reason };
        let (before, after) = self.fences.clone().unwrap_or_default();
        let document = |mission: &Mission, fence: Fence| {
            plan::document(&PlanFile::new(mission.clone(), fence, self.autopilot, mav_type))
        };
        let document = Document {
            schema: SCHEMA.to_owned(),
            system_id: self.system_id,
            autopilot: self.autopilot,
            begun_unix_s: self.begun_unix_s,
            with_fence: self.fences.is_some(),
            previous: document(&self.previous, before),
            new: document(&self.new, after),
        };
        let text = serde_json::to_string_pretty(&document).map_err(|e| wrong(e.to_string()))?;
        files::write_new(&self.path, &text)
    }

    /// Reads a journal.
    ///
    /// # Errors
    /// The file cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| FileError::Read { path: path.to_owned(), source })?;
        let wrong = |reason: String| FileError::Content { path: path.to_owned(), reason };
        let found: Document = serde_json::from_str(&text)
            .map_err(|e| wrong(format!("no journal of a mission transfer: {e}")))?;
        if found.schema != SCHEMA {
            return Err(wrong(format!("schema is \"{}\", this program reads \"{SCHEMA}\"", found.schema)));
        }
        let plan = |v: Value| plan::from_document(v).map_err(|e| wrong(e.to_string()));
        let (previous, new) = (plan(found.previous)?, plan(found.new)?);
        Ok(Self {
            path: path.to_owned(),
            system_id: found.system_id,
            autopilot: found.autopilot,
            begun_unix_s: found.begun_unix_s,
            fences: found.with_fence.then_some((previous.fence, new.fence)),
            previous: previous.mission,
            new: new.mission,
        })
    }

    /// The journals in a folder.
    pub fn list(folder: &Path) -> Vec<PathBuf> {
        FILES.list(folder)
    }

    /// Whether a file has the name of a journal.
    pub fn is_named(path: &Path) -> bool {
        FILES.is_named(path)
    }

    /// The rest of a sentence about a vehicle of which no one knows what is on it.
    pub fn left_words(&self) -> String {
        format!(
            ". Both missions are in {}: \"gaware mission restore\" puts the previous one back when the link is there again",
            self.path.display()
        )
    }

    /// Ends the journal where it is known what is on the vehicle; the rest of the sentence about the outcome where it is not.
    pub fn settle(self, outcome: &Outcome) -> String {
        if matches!(outcome, Outcome::Unknown { .. }) {
            return self.left_words();
        }
        self.end().err().map(|e| format!("; {e}: remove it by hand")).unwrap_or_default()
    }

    /// The transfer came to a good end.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn end(self) -> Result<(), FileError> {
        journal_file::end(&self.path)
    }
}
