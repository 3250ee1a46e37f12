//! A parameter file on its way to a vehicle: checked against the vehicle, the old values kept on disk first, then the verified change.

use super::files::{self, FileError};
use super::journal::{Content, Journal, Kind};
use super::param_transfer;
use super::vehicle::Vehicle;
use super::wire::{News, Wire};
use crate::advice::table::{self, Mapping};
use gaware_mission::change::Phase;
use gaware_mission::identity::Identity;
use gaware_mission::item::Autopilot;
use gaware_mission::params::apply::{ApplyOutcome, Pair, Wanted};
use gaware_mission::params::file::{self, FileEntry, FileLine, ParamFile};
use gaware_mission::params::{ParamName, ParamType};
use std::path::{Path, PathBuf};

/// Why nothing was changed.
#[derive(Debug, thiserror::Error)]
pub enum ParamOrderError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file is not for this vehicle.
    #[error("nothing was changed: {path} is for {file}; this is {vehicle}", path = path.display())]
    OtherVehicle {
        /// The file.
        path: PathBuf,
        /// What it is for.
        file: String,
        /// What is there.
        vehicle: String,
    },
    /// A value outside its documented range.
    #[error("nothing was changed: {name} is to be {value}; its documented range is {low} to {high}")]
    Range {
        /// Parameter.
        name: ParamName,
        /// Value in the file.
        value: f64,
        /// Least.
        low: f64,
        /// Most.
        high: f64,
    },
}

/// A parameter file with the values that a vehicle is to get.
#[derive(Debug, Clone)]
pub struct ParamOrder {
    path: PathBuf,
    file: ParamFile,
}

impl ParamOrder {
    /// Reads a parameter file.
    ///
    /// # Errors
    /// The file cannot be read, names nothing, or has a value outside the documented range of its parameter.
    pub fn load(path: &Path) -> Result<Self, ParamOrderError> {
        let text =
            crate::inputs::text(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
        let wrong = |reason: String| FileError::Content { path: path.to_owned(), reason };
        let file = ParamFile::read(&text).map_err(|e| wrong(e.to_string()))?;
        check_ranges(&file)?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names and new values.
    pub fn entries(&self) -> &[FileEntry] {
        &self.file.entries
    }

    /// Where the values come from, as far as the file says so.
    pub fn origin(&self) -> &[String] {
        &self.file.origin
    }

    /// A file that says which vehicle it is for is for no other.
    ///
    /// # Errors
    /// It is for another one.
    pub fn check_vehicle(&self, vehicle: &Vehicle) -> Result<(), ParamOrderError> {
        let kind = |fixed: bool| if fixed { "a fixed wing" } else { "a multirotor" };
        let path = self.path.clone();
        if let Some(autopilot) = self.file.autopilot.filter(|a| *a != vehicle.autopilot) {
            let (file, vehicle) = (autopilot.to_string(), vehicle.autopilot.to_string());
            return Err(ParamOrderError::OtherVehicle { path, file, vehicle });
        }
        if let (Some(meant), Some(here)) = (self.file.uid, vehicle.uid)
            && meant != here
        {
            let (file, vehicle) = (format!("the vehicle with hardware id {meant}"), vehicle.to_string());
            return Err(ParamOrderError::OtherVehicle { path, file, vehicle });
        }
        match (self.file.fixed_wing, vehicle.is_fixed_wing()) {
            (Some(a), Some(b)) if a != b => {
                let (file, vehicle) = (kind(a).to_owned(), kind(b).to_owned());
                Err(ParamOrderError::OtherVehicle { path, file, vehicle })
            }
            _ => Ok(()),
        }
    }
}

/// How a change ended.
#[derive(Debug, Clone)]
pub struct ParamDelivered {
    /// What is on the vehicle.
    pub outcome: ApplyOutcome,
    /// Parameters whose value is another one than before.
    pub changed: usize,
    /// Whether the autopilot has to be rebooted for all of them to count.
    pub reboot_due: bool,
    /// Where the old values are, once anything could have been changed.
    pub backup: Option<PathBuf>,
    /// The journal from which `gaware params restore` goes on.
    pub journal: Option<PathBuf>,
    /// All of it in words.
    pub text: String,
}

/// Sets what the file names: backs up into `backup`, sets, reads back, compares; restores on failure.
///
/// # Errors
/// Nothing was changed: the file is for another vehicle, or an earlier change did not end.
pub async fn deliver(
    wire: &mut impl Wire,
    order: &ParamOrder,
    backup: PathBuf,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Result<ParamDelivered, ParamOrderError> {
    let vehicle = wire.vehicle();
    order.check_vehicle(&vehicle)?;
    files::refuse_existing(&backup)?;
    let folder = files::folder_of(&backup).to_owned();
    let who = wire.identity();
    Kind::Parameters.check(&folder, &who)?;
    let wanted =
        order.entries().iter().map(|e| Wanted { name: e.name, value: e.value, kind: e.kind }).collect();
    let mut journal = None;
    let keep = |pairs: &[Pair]| {
        let kept = || -> Result<Journal, FileError> {
            let entries = pairs.iter().map(|p| (p.name, p.kind, p.old));
            files::write_new(&backup, &text_of(&who, vehicle.is_fixed_wing(), entries))?;
            Journal::begin(&folder, who, Content::Parameters(pairs.to_vec()))
        };
        journal = Some(kept().map_err(|e| e.to_string())?);
        Ok(())
    };
    let outcome = param_transfer::apply(wire, wanted, patience_s, keep, tell).await;
    Ok(delivered(vehicle.autopilot, outcome, journal, backup))
}

fn delivered(
    autopilot: Autopilot,
    outcome: ApplyOutcome,
    journal: Option<Journal>,
    backup: PathBuf,
) -> ParamDelivered {
    let is_new = matches!(outcome, ApplyOutcome::Verified { .. });
    let is_mixed = matches!(outcome, ApplyOutcome::Mixed { .. });
    let pairs = match journal.as_ref().map(|j| &j.content) {
        Some(Content::Parameters(pairs)) => pairs.as_slice(),
        _ => &[],
    };
    let changed: Vec<Pair> = pairs.iter().filter(|p| p.old as f32 != p.new as f32).copied().collect();
    let needs_reboot = |p: &&Pair| mapping(p.name.as_str(), autopilot).is_some_and(|m| m.reboot);
    let reboot: Vec<String> = changed.iter().filter(needs_reboot).map(|p| p.name.to_string()).collect();
    let path = journal.as_ref().map(|j| j.path.clone());
    let kept = journal.is_some();
    let rest = journal.map_or_else(String::new, |j| j.settle(!is_mixed));
    let mut text = format!("{outcome}{rest}");
    if kept {
        let what = if is_new { "what was there before is in" } else { "the old values are in" };
        text.push_str(&format!("; {what} {}", backup.display()));
    }
    let reboot_due = is_new && !reboot.is_empty();
    if reboot_due {
        text.push_str(&format!(
            ". A reboot of the autopilot is due: {} counts only after it; this program does not reboot",
            reboot.join(", ")
        ));
    }
    ParamDelivered {
        outcome,
        changed: changed.len(),
        reboot_due,
        backup: kept.then_some(backup),
        journal: path.filter(|_| is_mixed),
        text,
    }
}

/// The mapping that sets a parameter.
pub fn mapping(name: &str, autopilot: Autopilot) -> Option<&'static Mapping> {
    table::rows().find(|m| m.autopilot == autopilot && m.parameters.contains(&name))
}

/// A parameter file of a vehicle.
pub fn text_of(
    vehicle: &Identity,
    fixed_wing: Option<bool>,
    entries: impl Iterator<Item = (ParamName, ParamType, f64)>,
) -> String {
    let head = file::backup_line(vehicle, fixed_wing);
    let entry = |(name, kind, value)| FileLine::Entry(FileEntry { name, value, kind: Some(kind) });
    let lines: Vec<FileLine> = std::iter::once(head).chain(entries.map(entry)).collect();
    file::write(vehicle.autopilot, vehicle.system_id, &lines)
}

/// What a change is doing, in words.
pub fn phase_words(phase: Phase) -> &'static str {
    match phase {
        Phase::BackingUp => "reading the values on board …",
        Phase::Sending => "setting …",
        Phase::ReadingBack => "reading back …",
        Phase::Restoring => "putting the old values back …",
        Phase::Finished => "finished",
    }
}

/// Documented ranges, as far as this program knows them.
fn check_ranges(file: &ParamFile) -> Result<(), ParamOrderError> {
    for entry in &file.entries {
        let known = table::rows().find(|m| m.parameters.contains(&entry.name.as_str()));
        if let Some((low, high)) = known.and_then(|m| m.range)
            && !(low..=high).contains(&entry.value)
        {
            return Err(ParamOrderError::Range { name: entry.name, value: entry.value, low, high });
        }
    }
    Ok(())
}
