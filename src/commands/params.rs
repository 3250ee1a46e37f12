//! `gaware params`: what the vehicle's parameters are to this program, and their verified change.

pub use super::params_args::{ApplyArgs, BackupArgs, ParamsAction, ParamsArgs, RestoreParamsArgs, ShowArgs};
use super::params_result::{Action, OnVehicle, ParamsResult, Shown};
use super::{CommandError, output, params_restore, transfer};
use crate::advice::table::{self, Mapping, Rule};
use crate::mission_link::facts;
use crate::mission_link::files::{self, FileError};
use crate::mission_link::param_journal::ParamJournal;
use crate::mission_link::param_transfer::{self, ParamEvent};
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::vehicle::Vehicle;
use crate::mission_link::wire::Wire;
use gaware_mission::item::Autopilot;
use gaware_mission::params::apply::{ApplyOutcome, ApplyPhase, Pair, Wanted};
use gaware_mission::params::file::{self, FileEntry, FileLine, ParamFile};
use gaware_mission::params::list::ListError;
use gaware_mission::params::{ParamName, ParamValue};
use std::path::{Path, PathBuf};
use tokio_util::sync::CancellationToken;

/// Why parameters were not read or changed.
#[derive(Debug, thiserror::Error)]
pub enum ParamsError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// No vehicle.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Reading all of them.
    #[error("the parameters could not be read: {0}")]
    List(#[from] ListError),
    /// An earlier change did not end.
    #[error(
        "an earlier change of parameters was interrupted, or is under way in another process; its journal is {0}. Run \"gaware params \
         restore --connect … {0}\" first, or remove that file if you know what is on the vehicle"
    )]
    Interrupted(String),
    /// There is nothing to take up.
    #[error("there is no journal of an interrupted change in {0}; name the backup that is to be put back")]
    NoJournal(PathBuf),
    /// Too many.
    #[error("several changes were interrupted here; name one of {0}")]
    Journals(String),
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
    /// The second signal.
    #[error(
        "ended at once, as asked: which values are on the vehicle is not known if a change had begun; \"gaware params restore\" takes it up \
         from its journal"
    )]
    Abandoned,
    /// Anything but a verified change.
    #[error("{0}")]
    NotVerified(Box<ParamsResult>),
}

impl ParamsError {
    /// Whether the arguments were at fault.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Journals(_))
    }
}

/// Runs the action and reports in a sentence, or in a document, how it ended.
///
/// # Errors
/// Anything but what was asked for.
pub fn run(args: &ParamsArgs) -> Result<(), CommandError> {
    let ended = transfer::run(|stop| async move { act(&args.action, &stop).await })?;
    let result = ended.unwrap_or(Err(ParamsError::Abandoned));
    let json = args.action.to().json;
    match &result {
        Ok(result) if json => output::json(result)?,
        Err(ParamsError::NotVerified(result)) if json => output::json(result.as_ref())?,
        Ok(result) => output::text(&format!("{result}\n"))?,
        Err(_) => {}
    }
    Ok(result.map(drop)?)
}

async fn act(action: &ParamsAction, stop: &CancellationToken) -> Result<ParamsResult, ParamsError> {
    match action {
        ParamsAction::Show(args) => show(args, stop).await,
        ParamsAction::Backup(args) => backup(args, stop, transfer::progress).await,
        ParamsAction::Apply(args) => apply(args, stop, transfer::progress).await,
        ParamsAction::Restore(args) => params_restore::restore(args, stop, transfer::progress).await,
    }
}

/// Shows the parameters that this program has a meaning for, or all.
///
/// # Errors
/// No vehicle, or no answer.
pub async fn show(args: &ShowArgs, stop: &CancellationToken) -> Result<ParamsResult, ParamsError> {
    let mut session = Session::open(&args.to.opening(), stop).await?;
    let autopilot = session.vehicle().autopilot;
    let read = if args.all {
        let all = param_transfer::list(&mut session, |_, _| ()).await;
        all.map(|all| all.map(|all| all.values.into_iter().collect::<Vec<_>>()))
    } else {
        let got = facts::read_parameters(&mut session, names(autopilot)).await;
        match got {
            Some(got) if got.is_silent() => Err(ListError::Silent),
            got => Ok(got.map(|got| got.values.into_iter().collect())),
        }
    };
    session.close().await;
    let values: Vec<(ParamName, ParamValue)> = read?.ok_or(SessionError::Cancelled)?;
    let shown: Vec<Shown> = values.iter().map(|(name, value)| Shown::new(*name, *value, autopilot)).collect();
    let mut text: String = shown.iter().map(|s| format!("{s}\n")).collect();
    text.push_str(&format!("{} parameters", shown.len()));
    let result = ParamsResult::new(Action::Show, true, OnVehicle::Unchanged, text);
    Ok(ParamsResult { parameters: Some(shown), ..result })
}

/// Parameters of an autopilot that a mapping sets or depends on.
fn names(autopilot: Autopilot) -> Vec<ParamName> {
    let mut names: Vec<&str> = Vec::new();
    for mapping in table::TABLE.iter().filter(|m| m.autopilot == autopilot) {
        names.extend(mapping.parameters);
        match mapping.rule {
            Rule::Antenna { unit } => names.extend(unit),
            Rule::Temperature { enabled, .. } => names.push(enabled),
            _ => {}
        }
    }
    names.extend(match autopilot {
        Autopilot::ArduPilot => ["AHRS_ORIENTATION", "INS_ACCEL_FILTER", "INS_ACC2_ID", "GPS2_TYPE"],
        Autopilot::Px4 => ["SENS_BOARD_ROT", "CAL_ACC0_ROT", "CAL_ACC0_ID", "CAL_ACC1_ID"],
    });
    names.sort_unstable();
    names.dedup();
    names.iter().filter_map(|n| n.parse().ok()).collect()
}

/// The mapping that sets a parameter.
pub(super) fn mapping(name: &str, autopilot: Autopilot) -> Option<&'static Mapping> {
    table::TABLE.iter().find(|m| m.autopilot == autopilot && m.parameters.contains(&name))
}

/// Reads all parameters into a file.
///
/// # Errors
/// No vehicle, parameters that do not arrive, or a file that exists.
pub async fn backup(
    args: &BackupArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    files::refuse_existing(&args.file)?;
    let mut session = Session::open(&args.to.opening(), stop).await?;
    let vehicle = session.vehicle();
    let mut tenths = None;
    let all = param_transfer::list(&mut session, |done, count| {
        let now = done * 10 / count.max(1);
        if count > 0 && tenths.replace(now) != Some(now) {
            say(&format!("{done} of {count} parameters"));
        }
    });
    let all = all.await;
    session.close().await;
    let all = all?.ok_or(SessionError::Cancelled)?;
    let entries = all.values.iter().map(|(name, v)| (*name, v.kind, v.value));
    files::write_new(&args.file, &text_of(&vehicle, entries))?;
    let text =
        format!("{} parameters were read from the vehicle into {}", all.values.len(), args.file.display());
    let result = ParamsResult::new(Action::Backup, true, OnVehicle::Unchanged, text);
    Ok(ParamsResult {
        count: Some(all.values.len()),
        file: Some(args.file.clone()),
        hash: all.hash,
        ..result
    })
}

/// A parameter file of a vehicle.
fn text_of(
    vehicle: &Vehicle,
    entries: impl Iterator<Item = (ParamName, gaware_mission::params::ParamType, f64)>,
) -> String {
    let head = file::vehicle_line(vehicle.autopilot, vehicle.is_fixed_wing());
    let entry = |(name, kind, value)| FileLine::Entry(FileEntry { name, value, kind: Some(kind) });
    let lines: Vec<FileLine> = std::iter::once(head).chain(entries.map(entry)).collect();
    file::write(vehicle.autopilot, vehicle.address.system, &lines)
}

/// Sets what a file names: backs up, sets, reads back, compares; restores on failure.
///
/// # Errors
/// Anything but every new value, read back.
pub async fn apply(
    args: &ApplyArgs,
    stop: &CancellationToken,
    say: impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    bring(Action::Apply, args, stop, say).await
}

/// Reads a parameter file.
pub(super) fn read(path: &Path) -> Result<ParamFile, FileError> {
    let text =
        std::fs::read_to_string(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
    let wrong = |e: file::ParamFileError| FileError::Content { path: path.to_owned(), reason: e.to_string() };
    ParamFile::read(&text).map_err(wrong)
}

/// Brings a file, whatever that is called.
pub(super) async fn bring(
    action: Action,
    args: &ApplyArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    let file = read(&args.file)?;
    check_ranges(&file)?;
    let backup = args.backup.clone().unwrap_or_else(|| transfer::default_backup("params-backup", "param"));
    files::refuse_existing(&backup)?;
    let folder = files::folder_of(&backup).to_owned();
    let mut session = Session::open(&args.to.opening(), stop).await?;
    let vehicle = session.vehicle();
    let ready = check_vehicle(&args.file, &file, &vehicle).and_then(|()| {
        let journal = ParamJournal::path(&folder, vehicle.address.system);
        if journal.exists() { Err(ParamsError::Interrupted(journal.display().to_string())) } else { Ok(()) }
    });
    if let Err(error) = ready {
        session.close().await;
        return Err(error);
    }
    let wanted = file.entries.iter().map(|e| Wanted { name: e.name, value: e.value, kind: e.kind }).collect();
    let mut journal = None;
    let keep = |pairs: &[Pair]| {
        let kept = || -> Result<ParamJournal, FileError> {
            let entries = pairs.iter().map(|p| (p.name, p.kind, p.old));
            files::write_new(&backup, &text_of(&vehicle, entries))?;
            ParamJournal::begin(&folder, &vehicle, pairs)
        };
        journal = Some(kept().map_err(|e| e.to_string())?);
        Ok(())
    };
    let outcome =
        param_transfer::apply(&mut session, wanted, args.to.patience as f64, keep, teller(&mut say)).await;
    session.close().await;
    report(action, &outcome, journal, backup)
}

fn report(
    action: Action,
    outcome: &ApplyOutcome,
    journal: Option<ParamJournal>,
    backup: PathBuf,
) -> Result<ParamsResult, ParamsError> {
    let on_vehicle = OnVehicle::of(outcome);
    let changed: Vec<Pair> =
        journal.iter().flat_map(|j| &j.pairs).filter(|p| p.old as f32 != p.new as f32).copied().collect();
    let autopilot = journal.as_ref().map(|j| j.autopilot);
    let reboot: Vec<String> = changed
        .iter()
        .filter(|p| autopilot.and_then(|a| mapping(p.name.as_str(), a)).is_some_and(|m| m.reboot))
        .map(|p| p.name.to_string())
        .collect();
    let kept = journal.is_some();
    let path = journal.as_ref().map(|j| j.path.clone());
    let rest = journal.map_or_else(String::new, |j| j.settle(outcome));
    let mut text = format!("{outcome}{rest}");
    if kept && on_vehicle != OnVehicle::New {
        text.push_str(&format!("; the old values are in {}", backup.display()));
    } else if kept {
        text.push_str(&format!("; what was there before is in {}", backup.display()));
    }
    let due = on_vehicle == OnVehicle::New && !reboot.is_empty();
    if due {
        text.push_str(&format!(
            ". A reboot of the autopilot is due: {} counts only after it; this program does not reboot",
            reboot.join(", ")
        ));
    }
    let mut result = ParamsResult::new(action, on_vehicle == OnVehicle::New, on_vehicle, text);
    result.changed = (on_vehicle == OnVehicle::New).then_some(changed.len());
    result.reboot_due = due;
    result.backup = kept.then_some(backup);
    result.journal = path.filter(|_| on_vehicle == OnVehicle::Mixed);
    result.values = match outcome {
        ApplyOutcome::Mixed { values, .. } => Some(values.iter().map(Into::into).collect()),
        _ => None,
    };
    result.settled()
}

/// Documented ranges, as far as this program knows them.
fn check_ranges(file: &ParamFile) -> Result<(), ParamsError> {
    for entry in &file.entries {
        let known = table::TABLE.iter().find(|m| m.parameters.contains(&entry.name.as_str()));
        if let Some((low, high)) = known.and_then(|m| m.range)
            && !(low..=high).contains(&entry.value)
        {
            return Err(ParamsError::Range { name: entry.name, value: entry.value, low, high });
        }
    }
    Ok(())
}

/// A file that says which vehicle it is for is for no other.
fn check_vehicle(path: &Path, file: &ParamFile, vehicle: &Vehicle) -> Result<(), ParamsError> {
    let kind = |fixed: bool| if fixed { "a fixed wing" } else { "a multirotor" };
    let other =
        |file: String, vehicle: String| ParamsError::OtherVehicle { path: path.to_owned(), file, vehicle };
    if let Some(autopilot) = file.autopilot.filter(|a| *a != vehicle.autopilot) {
        return Err(other(autopilot.to_string(), vehicle.autopilot.to_string()));
    }
    match (file.fixed_wing, vehicle.is_fixed_wing()) {
        (Some(a), Some(b)) if a != b => Err(other(kind(a).to_owned(), kind(b).to_owned())),
        _ => Ok(()),
    }
}

/// Says in words what a change reports.
pub(super) fn teller(say: &mut impl FnMut(&str)) -> impl FnMut(ParamEvent) {
    move |event| match event {
        ParamEvent::Phase(phase) => say(match phase {
            ApplyPhase::BackingUp => "reading the values on board …",
            ApplyPhase::Setting => "setting …",
            ApplyPhase::ReadingBack => "reading back …",
            ApplyPhase::Restoring => "putting the old values back …",
            ApplyPhase::Finished => "finished",
        }),
        ParamEvent::Waiting(text) => say(&format!("{text}\nwaiting for the vehicle …")),
    }
}
