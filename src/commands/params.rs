//! `gaware params`: what the vehicle's parameters are to this program, and their verified change.

pub use super::params_args::{ApplyArgs, BackupArgs, ParamsAction, ParamsArgs, RestoreParamsArgs, ShowArgs};
use super::params_result::{Action, OnVehicle, ParamsResult, Shown};
use super::{CommandError, params_restore, transfer};
use crate::advice::rule_free;
use crate::advice::table::{self, Rule};
use crate::figures::{counted, counted_were};
use crate::mission_link::files::{self, FileError};
use crate::mission_link::journal::JournalError;
use crate::mission_link::param_delivery::{self, ParamOrder, ParamOrderError};
use crate::mission_link::param_transfer;
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::wire::{News, Wire};
use gaware_mission::item::Autopilot;
use gaware_mission::params::apply::ApplyOutcome;
use gaware_mission::params::list::ListError;
use gaware_mission::params::{ParamName, ParamValue};
use std::path::PathBuf;
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
    /// Nothing was changed.
    #[error(transparent)]
    Order(#[from] ParamOrderError),
    /// Which change is to be taken up.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// A journal of another vehicle.
    #[error("{0}")]
    OtherVehicle(String),
    /// What is on the vehicle is of neither set.
    #[error(
        "nothing was changed: on the vehicle are values that are not known to be the old or the new ones: {values}. --force puts the old values of \
         {path} over them and keeps them in a file; or remove that journal if what is there is wanted", path = path.display()
    )]
    Neither {
        /// The journal.
        path: PathBuf,
        /// Which they are.
        values: String,
    },
    /// Nobody who could confirm.
    #[error(
        "nothing was changed: there is no terminal on which the change could be confirmed; --yes sets the values without a question"
    )]
    NobodyToAsk,
    /// Not confirmed.
    #[error("nothing was changed: the change was not confirmed")]
    NotConfirmed,
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
        use JournalError::{OtherKind, Several};
        matches!(self, Self::Journal(Several { .. } | OtherKind { .. }) | Self::NobodyToAsk)
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
    transfer::show(result, json, |error| match error {
        ParamsError::NotVerified(result) => Some(result.as_ref()),
        _ => None,
    })
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
        all.map(|all| all.values.into_iter().collect::<Vec<_>>())
    } else {
        let got = param_transfer::read(&mut session, names(autopilot)).await;
        match got {
            Ok(got) if got.is_silent() => Err(ListError::Silent),
            Ok(got) => Ok(got.values.into_iter().collect()),
            Err(why) => Err(ListError::Stopped(why)),
        }
    };
    session.close().await;
    let values: Vec<(ParamName, ParamValue)> = read?;
    let shown: Vec<Shown> = values.iter().map(|(name, value)| Shown::new(*name, *value, autopilot)).collect();
    let mut text: String = shown.iter().map(|s| format!("{s}\n")).collect();
    text.push_str(&counted(shown.len(), "parameter"));
    let result = ParamsResult::new(Action::Show, true, OnVehicle::Unchanged, text);
    Ok(ParamsResult { parameters: Some(shown), ..result })
}

/// Parameters of an autopilot that a mapping sets or depends on.
fn names(autopilot: Autopilot) -> Vec<ParamName> {
    let mut names: Vec<&str> = Vec::new();
    for mapping in
        table::rows().filter(|m| m.autopilot == autopilot && m.of_unit.is_none_or(|unit| unit == 0))
    {
        names.extend(mapping.parameters);
        match mapping.rule {
            Rule::Antenna { unit } => names.extend(unit),
            Rule::Temperature { enabled, .. } => names.push(enabled),
            _ => {}
        }
    }
    names.extend(match autopilot {
        Autopilot::ArduPilot => &["AHRS_ORIENTATION", "INS_ACCEL_FILTER", "INS_ACC2_ID", "GPS2_TYPE"][..],
        Autopilot::Px4 => &[
            "SENS_BOARD_ROT",
            "CAL_ACC0_ROT",
            "CAL_ACC0_ID",
            "CAL_ACC1_ID",
            "CAL_ACC2_ID",
            "SENS_IMU_AUTOCAL",
        ],
    });
    names.sort_unstable();
    names.dedup();
    names.iter().filter_map(|n| n.parse().ok()).collect()
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
    let (vehicle, fixed_wing) = (session.identity(), session.vehicle().is_fixed_wing());
    let mut tenths = None;
    let all = param_transfer::list(&mut session, |done, count| {
        let now = done * 10 / count.max(1);
        if count > 0 && tenths.replace(now) != Some(now) {
            say(&format!("{done} of {count} parameters"));
        }
    });
    let all = all.await;
    session.close().await;
    let all = all?;
    let entries = all.values.iter().map(|(name, v)| (*name, v.kind, v.value));
    files::write_new(&args.file, &param_delivery::text_of(&vehicle, fixed_wing, entries))?;
    let text = format!(
        "{} read from the vehicle into {}",
        counted_were(all.values.len(), "parameter"),
        args.file.display()
    );
    let result = ParamsResult::new(Action::Backup, true, OnVehicle::Unchanged, text);
    Ok(ParamsResult {
        count: Some(all.values.len()),
        file: Some(args.file.clone()),
        hash: all.hash,
        ..result
    })
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

/// Brings a file, whatever that is called.
pub(super) async fn bring(
    action: Action,
    args: &ApplyArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    let order = ParamOrder::load(&args.file)?;
    let backup = args.backup.clone().unwrap_or_else(|| transfer::default_backup("params-backup", "param"));
    files::refuse_existing(&backup)?;
    let mut session = Session::open(&args.to.opening(), stop).await?;
    let mut agreed = show_change(&mut session, &order, &mut say).await;
    if agreed.is_ok() && !args.yes {
        agreed = confirm(&session, &order, stop).await;
    }
    if let Err(why) = agreed {
        session.close().await;
        return Err(why);
    }
    let patience_s = args.to.patience as f64;
    let delivered = param_delivery::deliver(&mut session, &order, backup, patience_s, teller(&mut say)).await;
    session.close().await;
    let delivered = delivered?;
    let on_vehicle = OnVehicle::of(&delivered.outcome);
    let done = on_vehicle == OnVehicle::New;
    let mut result = ParamsResult::new(action, done, on_vehicle, delivered.text);
    result.changed = done.then_some(delivered.changed);
    result.reboot_due = delivered.reboot_due;
    result.backup = delivered.backup;
    result.journal = delivered.journal;
    result.values = match &delivered.outcome {
        ApplyOutcome::Mixed { values, .. } => Some(values.clone()),
        _ => None,
    };
    result.settled()
}

/// Shows where the values come from and what they replace.
async fn show_change(
    wire: &mut impl Wire,
    order: &ParamOrder,
    say: &mut impl FnMut(&str),
) -> Result<(), ParamsError> {
    let vehicle = wire.vehicle();
    order.check_vehicle(&vehicle)?;
    let names = order.entries().iter().map(|e| e.name).collect();
    let old =
        param_transfer::read(wire, names).await.map_err(|why| ParamsError::List(ListError::Stopped(why)))?;
    order.origin().iter().for_each(|line| say(line));
    for entry in order.entries() {
        let unit = param_delivery::mapping(entry.name.as_str(), vehicle.autopilot).map_or("", |m| m.unit);
        let before = old.values.get(&entry.name).map_or_else(|| "?".to_owned(), |v| rule_free(v.value));
        say(format!("{}: {before} → {} {unit}", entry.name, rule_free(entry.value)).trim_end());
    }
    Ok(())
}

async fn confirm(wire: &impl Wire, order: &ParamOrder, stop: &CancellationToken) -> Result<(), ParamsError> {
    let (count, vehicle) = (counted(order.entries().len(), "value"), wire.vehicle());
    match transfer::confirmed(&format!("set {count} on {vehicle}? [y/N]"), stop).await {
        Some(true) => Ok(()),
        Some(false) => Err(ParamsError::NotConfirmed),
        None => Err(ParamsError::NobodyToAsk),
    }
}

/// Says in words what a change reports.
pub(super) fn teller(say: &mut impl FnMut(&str)) -> impl FnMut(News) {
    move |event| match event {
        News::Phase(phase) => say(param_delivery::phase_words(phase)),
        News::Stranded(text) => say(&format!("{text}\nwaiting for the vehicle …")),
        News::Said(text) => say(&text),
        News::Checked(_) | News::Progress(..) => {}
    }
}
