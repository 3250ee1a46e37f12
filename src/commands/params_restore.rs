//! `gaware params restore`: puts a backup back, or takes up a change that was interrupted by the end of the program or of the link.

use super::params::{ParamsError, RestoreParamsArgs, bring, teller};
use super::params_args::ApplyArgs;
use super::params_result::{Action, OnVehicle, ParamsResult};
use super::transfer;
use crate::figures::counted;
use crate::mission_link::files;
use crate::mission_link::journal::{Content, Journal, Kind};
use crate::mission_link::session::{Opening, Session};
use crate::mission_link::vehicle::identity_words;
use crate::mission_link::wire::Wire;
use crate::mission_link::{param_delivery, param_transfer};
use gaware_mission::params::apply::{ApplyOutcome, Pair};
use gaware_mission::params::list::ListError;
use gaware_mission::params::{Encoding, ParamName};
use std::path::PathBuf;
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
    let file = transfer::to_restore(Kind::Parameters, args.file.as_ref())?;
    if Kind::Parameters.names(&file) {
        return take_up(args, Journal::read(&file)?, stop, &mut say).await;
    }
    let apply = ApplyArgs { to: args.to.clone(), file, backup: args.backup.clone(), yes: true };
    bring(Action::Restore, &apply, stop, say).await
}

async fn take_up(
    args: &RestoreParamsArgs,
    journal: Journal,
    stop: &CancellationToken,
    say: &mut impl FnMut(&str),
) -> Result<ParamsResult, ParamsError> {
    let Content::Parameters(pairs) = journal.content.clone() else {
        return Err(journal.is_of_other_kind().into());
    };
    say(&format!(
        "a change of {} of {} began{} and did not end",
        counted(pairs.len(), "parameter"),
        identity_words(&journal.vehicle),
        journal.begun_words()
    ));
    let to = Opening { vehicle: args.to.vehicle.or(Some(journal.vehicle.system_id)), ..args.to.opening() };
    let mut session = Session::open(&to, stop).await?;
    let result = settle(args, &journal, &pairs, &mut session, say).await;
    session.close().await;
    let (outcome, backup) = result?;
    let on_vehicle = OnVehicle::of(&outcome);
    let (count, path) = (pairs.len(), journal.path.clone());
    let kept = format!("; what was on it is in {}", backup.display());
    let rest = journal.settle(on_vehicle != OnVehicle::Mixed);
    let text = match &outcome {
        ApplyOutcome::Previous { .. } => {
            format!(
                "the old values of {} are on the vehicle, read back and compared{kept}{rest}",
                counted(count, "parameter")
            )
        }
        outcome => format!("{outcome}{kept}{rest}"),
    };
    let mut result = ParamsResult::new(Action::Restore, on_vehicle == OnVehicle::Previous, on_vehicle, text);
    result.count = Some(count);
    result.backup = Some(backup);
    result.journal = (on_vehicle == OnVehicle::Mixed).then_some(path);
    if let ApplyOutcome::Mixed { values, .. } = &outcome {
        result.values = Some(values.clone());
    }
    result.settled()
}

/// Checks that this is the vehicle, and that what is on it came from this change; keeps it in a file, and puts the old values back.
async fn settle(
    args: &RestoreParamsArgs,
    journal: &Journal,
    pairs: &[Pair],
    session: &mut Session,
    say: &mut impl FnMut(&str),
) -> Result<(ApplyOutcome, PathBuf), ParamsError> {
    let (vehicle, here) = (session.vehicle(), session.identity());
    let doubt = journal.check_vehicle(&here).map_err(ParamsError::OtherVehicle)?;
    doubt.iter().for_each(|text| say(&format!("warning: {text}")));
    let names: Vec<ParamName> = pairs.iter().map(|p| p.name).collect();
    let got = param_transfer::read(session, names).await.map_err(ListError::Stopped)?;
    if got.is_silent() {
        return Err(ListError::Silent.into());
    }
    let encoding = Encoding::of(vehicle.autopilot);
    let on_board = |p: &Pair| got.values.get(&p.name).map(|v| v.value);
    let is = |p: &Pair, value: f64| on_board(p).is_some_and(|v| encoding.same(p.kind, v, value));
    let neither = pairs.iter().filter(|p| !is(p, p.old) && !is(p, p.new)).map(|p| {
        let there = on_board(p).map_or_else(|| "without an answer".to_owned(), |v| (v as f32).to_string());
        format!("{} {there} (old {}, new {})", p.name, p.old as f32, p.new as f32)
    });
    let neither: Vec<String> = neither.collect();
    if !neither.is_empty() && !args.force {
        return Err(ParamsError::Neither { path: journal.path.clone(), values: neither.join(", ") });
    }
    let backup = transfer::beside(&journal.path, args.backup.as_ref(), ("params-backup", "param"));
    let values = got.values.iter().map(|(name, v)| (*name, v.kind, v.value));
    files::write_new(&backup, &param_delivery::text_of(&here, vehicle.is_fixed_wing(), values))?;
    let patience_s = args.to.patience as f64;
    let outcome = param_transfer::resume(session, pairs.to_vec(), patience_s, teller(say)).await;
    Ok((outcome, backup))
}
