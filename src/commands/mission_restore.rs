//! `gaware mission restore`: puts a backup back, or takes up an upload that was cut off by the end of the program or of the link.

use super::mission::{LinkArgs, MissionError, RestoreArgs, UploadArgs, bring, teller};
use super::mission_result::{Action, MissionResult, OnVehicle};
use crate::mission_link::journal::Journal;
use crate::mission_link::session::Session;
use crate::mission_link::wire::{CutOff, Wire};
use gaware_mission::transfer::OnBoard;
use gaware_mission::transfer::verified::{Goal, Options, Outcome};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Restores.
///
/// # Errors
/// Anything but the wanted mission, read back whole.
pub async fn restore(
    args: &RestoreArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let file = match &args.file {
        Some(file) => file.clone(),
        None => the_journal(Path::new("."))?,
    };
    if Journal::is_named(&file) {
        let journal = Journal::read(&file)?;
        return take_up(args, journal, stop, &mut say).await;
    }
    if args.new {
        return Err(MissionError::NotAJournal(file));
    }
    let RestoreArgs { vehicle, patience, json, even_while_flying, .. } = *args;
    let link = LinkArgs { connect: args.connect.clone(), file, vehicle, patience, json };
    let upload = UploadArgs { link, backup: args.backup.clone(), even_while_flying };
    bring(Action::Restore, &upload, stop, say).await
}

/// The only journal in a folder.
fn the_journal(folder: &Path) -> Result<PathBuf, MissionError> {
    let found = Journal::list(folder);
    match found.as_slice() {
        [one] => Ok(one.clone()),
        [] => Err(MissionError::NoJournal(std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()))),
        many => {
            let names: Vec<String> = many.iter().map(|p| p.display().to_string()).collect();
            Err(MissionError::Journals(names.join(", ")))
        }
    }
}

async fn take_up(
    args: &RestoreArgs,
    journal: Journal,
    stop: &CancellationToken,
    say: &mut impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let other = |vehicle: String| MissionError::OtherVehicle {
        path: journal.path.clone(),
        journal: format!("system {}, {:?}", journal.system_id, journal.autopilot),
        vehicle,
    };
    if let Some(id) = args.vehicle.filter(|id| *id != journal.system_id) {
        return Err(other(format!("system {id}")));
    }
    say(&begun(&journal));
    let patience = Duration::from_secs(args.patience);
    let mut session = Session::open(&args.connect, Some(journal.system_id), patience, stop).await?;
    let result = settle(args, &journal, &mut session, &other, say).await;
    session.close().await;
    let (outcome, was) = result?;
    let (new, previous) = (journal.new.items.len(), journal.previous.items.len());
    let (path, rest) = (journal.path.clone(), journal.settle(&outcome));
    let on_vehicle = OnVehicle::of(&outcome);
    let (items, done, now) = match on_vehicle {
        OnVehicle::New => (Some(new), true, format!("the new mission of {new} items")),
        OnVehicle::Previous => {
            (Some(previous), !args.new, format!("the previous mission of {previous} items"))
        }
        _ => (None, false, String::new()),
    };
    let text = if done {
        format!("on the vehicle was: {was}; now it is {now}, read back and compared{rest}")
    } else {
        format!("on the vehicle was: {was}. Now: {outcome}{rest}")
    };
    let journal = (on_vehicle == OnVehicle::Unknown).then_some(path);
    let result = MissionResult::new(Action::Restore, done, on_vehicle, text);
    MissionResult { items, was_on_vehicle: Some(was.to_string()), journal, ..result }.settled()
}

/// How it ended, and what was on the vehicle before.
async fn settle(
    args: &RestoreArgs,
    journal: &Journal,
    session: &mut Session,
    other: &impl Fn(String) -> MissionError,
    say: &mut impl FnMut(&str),
) -> Result<(Outcome, OnBoard), MissionError> {
    let vehicle = session.vehicle();
    if vehicle.autopilot != journal.autopilot {
        return Err(other(format!("system {}, {:?}", vehicle.address.system, vehicle.autopilot)));
    }
    let refusal = vehicle.state.objection().filter(|_| !args.even_while_flying);
    if let Some(why) = refusal {
        return Err(MissionError::Flying(why.to_string()));
    }
    let got = session.download().await?;
    let was = OnBoard::judge(vehicle.autopilot, &journal.new, &journal.previous, &got);
    say(&format!("on the vehicle now: {was}"));
    let cut_off = CutOff {
        new: journal.new.clone(),
        previous: journal.previous.clone(),
        goal: if args.new { Goal::New } else { Goal::Previous },
    };
    let patience = Duration::from_secs(args.patience);
    let outcome = session.resume(cut_off, Options::default(), patience, teller(say)).await;
    Ok((outcome, was))
}

fn begun(journal: &Journal) -> String {
    let since = std::time::SystemTime::now()
        .duration_since(std::time::SystemTime::UNIX_EPOCH)
        .map_or(0, |now| now.as_secs().saturating_sub(journal.begun_unix_s));
    let when = match since / 60 {
        _ if journal.begun_unix_s == 0 => String::new(),
        0..=1 => " just now".to_owned(),
        minutes @ 2..=120 => format!(" {minutes} minutes ago"),
        minutes => format!(" {} hours ago", minutes / 60),
    };
    format!(
        "an upload of {} items over {} to system {} began{when} and did not end",
        journal.new.items.len(),
        journal.previous.items.len(),
        journal.system_id
    )
}
