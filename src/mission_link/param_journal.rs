//! The journal of a change of parameters: old and new values, on disk before the first one is set.
//!
//! It is removed when one of the two sets has been read back whole. If the program dies in between, or the link never comes back,
//! `gaware params restore` finds it and puts the old values back.

use super::files::{self, FileError};
use super::journal_file::{self, JournalFiles};
use super::vehicle::Vehicle;
use gaware_mission::item::Autopilot;
use gaware_mission::params::ParamType;
use gaware_mission::params::apply::{ApplyOutcome, Pair};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Schema of the file.
const SCHEMA: &str = "gaware.parameter-change/1";
/// Its file.
const FILES: JournalFiles = JournalFiles("parameter-change-system");

/// A change that has begun.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamJournal {
    /// The file.
    pub path: PathBuf,
    /// System id of the vehicle.
    pub system_id: u8,
    /// Its dialect.
    pub autopilot: Autopilot,
    /// Old and new values.
    pub pairs: Vec<Pair>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Document {
    schema: String,
    system_id: u8,
    autopilot: Autopilot,
    parameters: Vec<Entry>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Entry {
    name: String,
    /// `MAV_PARAM_TYPE`.
    kind: u8,
    old: f64,
    new: f64,
}

impl ParamJournal {
    /// Where the journal of a change of this vehicle lies.
    pub fn path(folder: &Path, system_id: u8) -> PathBuf {
        FILES.path(folder, system_id)
    }

    /// Writes the journal of a change that is about to begin, down to the disk.
    ///
    /// # Errors
    /// There is one already, or the disk refuses.
    pub fn begin(folder: &Path, vehicle: &Vehicle, pairs: &[Pair]) -> Result<Self, FileError> {
        let (system_id, autopilot) = (vehicle.address.system, vehicle.autopilot);
        let journal =
            Self { path: Self::path(folder, system_id), system_id, autopilot, pairs: pairs.to_vec() };
        let entry =
            |p: &Pair| Entry { name: p.name.to_string(), kind: p.kind.number(), old: p.old, new: p.new };
        let parameters = pairs.iter().map(entry).collect();
        let document = Document { schema: SCHEMA.to_owned(), system_id, autopilot, parameters };
        let wrong = |reason: String| FileError::Content { path: journal.path.clone(), reason };
        let text = serde_json::to_string_pretty(&document).map_err(|e| wrong(e.to_string()))?;
        files::write_new(&journal.path, &text)?;
        // What cannot be read again could not be put back.
        match Self::read(&journal.path) {
            Ok(read) if read == journal => Ok(journal),
            other => {
                let reason = other
                    .err()
                    .map_or_else(|| "it reads otherwise than written".to_owned(), |e| e.to_string());
                let path = journal.path.clone();
                journal.end()?;
                Err(FileError::Content { path, reason })
            }
        }
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
            .map_err(|e| wrong(format!("no journal of a change of parameters: {e}")))?;
        if found.schema != SCHEMA {
            return Err(wrong(format!("schema is \"{}\", this program reads \"{SCHEMA}\"", found.schema)));
        }
        let pair = |e: &Entry| {
            let name = e.name.parse().map_err(|e: gaware_mission::params::NameError| wrong(e.to_string()))?;
            let kind =
                ParamType::from_number(e.kind).ok_or_else(|| wrong(format!("{} is no type", e.kind)))?;
            let finite = e.old.is_finite() && e.new.is_finite();
            finite
                .then_some(Pair { name, kind, old: e.old, new: e.new })
                .ok_or_else(|| wrong(format!("{name} has no value")))
        };
        let pairs = found.parameters.iter().map(pair).collect::<Result<_, _>>()?;
        Ok(Self { path: path.to_owned(), system_id: found.system_id, autopilot: found.autopilot, pairs })
    }

    /// The journals in a folder.
    pub fn list(folder: &Path) -> Vec<PathBuf> {
        FILES.list(folder)
    }

    /// Whether a file has the name of a journal.
    pub fn is_named(path: &Path) -> bool {
        FILES.is_named(path)
    }

    /// Ends the journal where one of the two sets is on board; the rest of the sentence about the outcome.
    pub fn settle(self, outcome: &ApplyOutcome) -> String {
        if matches!(outcome, ApplyOutcome::Mixed { .. }) {
            return format!(
                ". Both sets are in {}: \"gaware params restore\" puts the old one back when the link is there again",
                self.path.display()
            );
        }
        self.end().err().map(|e| format!("; {e}: remove it by hand")).unwrap_or_default()
    }

    /// The change came to a good end.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn end(self) -> Result<(), FileError> {
        journal_file::end(&self.path)
    }
}
