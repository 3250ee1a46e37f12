//! `gaware params restore`: puts a backup back, or takes up a change that was interrupted by the end of the program or of the link.

use super::params::{ParamsError, RestoreParamsArgs, bring, teller};
use super::params_args::ApplyArgs;
use super::params_result::{Action, OnVehicle, ParamsResult};
use super::transfer::{self, NoJournal};
use crate::figures::counted;
use crate::mission_link::param_delivery::ParamOrderError;
use crate::mission_link::param_journal::ParamJournal;
use crate::mission_link::param_transfer;
use crate::mission_link::session::{Opening, Session};
use crate::mission_link::wire::Wire;
use gaware_mission::params::apply::ApplyOutcome;
use std::path::{Path, PathBuf};
use tokio_util::sync::CancellationToken;

/// Restores.
///
/// # Errors
/// Anything but the wanted values, read back.
pub async fn restore(
    args: &RestoreParamsArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    let file = match &args.file {
        Some(file) => file.clone(),
        None => the_journal(Path::new("."))?,
    };
    if ParamJournal::is_named(&file) {
        return take_up(args, ParamJournal::read(&file)?, stop, &mut say).await;
    }
    let apply = ApplyArgs { to: args.to.clone(), file, backup: args.backup.clone() };
    bring(Action::Restore, &apply, stop, say).await
}

/// The only journal in a folder.
fn the_journal(folder: &Path) -> Result<PathBuf, ParamsError> {
    transfer::the_only(&ParamJournal::list(folder), folder).map_err(|why| match why {
        NoJournal::None(folder) => ParamsError::NoJournal(folder),
        NoJournal::Several(names) => ParamsError::Journals(names),
    })
}

async fn take_up(
    args: &RestoreParamsArgs,
    journal: ParamJournal,
    stop: &CancellationToken,
    say: &mut impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    let other = |vehicle: String| ParamOrderError::OtherVehicle {
        path: journal.path.clone(),
        file: format!("system {}, {}", journal.system_id, journal.autopilot),
        vehicle,
    };
    if let Some(id) = args.to.vehicle.filter(|id| *id != journal.system_id) {
        return Err(other(format!("system {id}")).into());
    }
    say(&format!(
        "a change of {} of system {} did not end",
        counted(journal.pairs.len(), "parameter"),
        journal.system_id
    ));
    let to = Opening { vehicle: Some(journal.system_id), ..args.to.opening() };
    let mut session = Session::open(&to, stop).await?;
    let vehicle = session.vehicle();
    if vehicle.autopilot != journal.autopilot {
        session.close().await;
        return Err(other(vehicle.to_string()).into());
    }
    let patience_s = args.to.patience as f64;
    let outcome = param_transfer::resume(&mut session, journal.pairs.clone(), patience_s, teller(say)).await;
    session.close().await;
    let on_vehicle = OnVehicle::of(&outcome);
    let (count, path) = (journal.pairs.len(), journal.path.clone());
    let rest = journal.settle(&outcome);
    let text = match &outcome {
        ApplyOutcome::Previous { .. } => {
            format!(
                "the old values of {} are on the vehicle, read back and compared{rest}",
                counted(count, "parameter")
            )
        }
        outcome => format!("{outcome}{rest}"),
    };
    let mut result = ParamsResult::new(Action::Restore, on_vehicle == OnVehicle::Previous, on_vehicle, text);
    result.count = Some(count);
    result.journal = (on_vehicle == OnVehicle::Mixed).then_some(path);
    if let ApplyOutcome::Mixed { values, .. } = &outcome {
        result.values = Some(values.iter().map(Into::into).collect());
    }
    result.settled()
}
