//! `gaware mission restore`: puts a backup back, or takes up an upload that was interrupted by the end of the program or of the link.

use super::mission::{LinkArgs, MissionError, RestoreArgs, UploadArgs, bring, bring_list, teller};
use super::mission_result::{Action, MissionResult, OnVehicle};
use super::transfer;
use crate::figures::counted;
use crate::mission_link::files;
use crate::mission_link::journal::{Content, Journal, Kind};
use crate::mission_link::restore::{self, Restoration, Settled};
use crate::mission_link::session::{Opening, Session};
use crate::mission_link::vehicle::identity_words;
use gaware_mission::transfer::verified::Goal;
use std::path::PathBuf;
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
    let file = transfer::to_restore(Kind::Mission, args.file.as_ref())?;
    if let Some(list) = args.list {
        if Kind::Mission.names(&file) {
            return Err(MissionError::JournalIsWhole(file));
        }
        let kind = list.into();
        let contents = files::read_contents(&file)?;
        let new = contents.list(kind);
        if new.items.is_empty() {
            return Err(MissionError::Empty(file));
        }
        let what = (kind, new, contents.backup_of);
        return bring_list(Action::Restore, what, &as_upload(args, file), stop, say).await;
    }
    if Kind::Mission.names(&file) {
        let journal = Journal::read(&file)?;
        return take_up(args, journal, stop, &mut say).await;
    }
    if args.new {
        return Err(MissionError::NotAJournal(file));
    }
    if files::read(&file)?.0.items.is_empty() {
        return Err(MissionError::Empty(file));
    }
    bring(Action::Restore, &as_upload(args, file), stop, say).await
}

fn as_upload(args: &RestoreArgs, file: PathBuf) -> UploadArgs {
    let RestoreArgs { even_while_flying, force, .. } = *args;
    let link = LinkArgs { to: args.to.clone(), file };
    UploadArgs {
        link,
        backup: args.backup.clone(),
        airframe: None,
        no_fence: false,
        force,
        even_while_flying,
    }
}

async fn take_up(
    args: &RestoreArgs,
    journal: Journal,
    stop: &CancellationToken,
    say: &mut impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let Content::Mission { previous, new, fences } = &journal.content else {
        return Err(journal.is_of_other_kind().into());
    };
    let system_id = journal.vehicle.system_id;
    say(&format!(
        "an upload of {} over {} to {} began{} and did not end",
        counted(new.items.len(), "item"),
        previous.items.len(),
        identity_words(&journal.vehicle),
        journal.begun_words()
    ));
    let to = Opening { vehicle: args.to.vehicle.or(Some(system_id)), ..args.to.opening() };
    let request = Restoration {
        journal: &journal,
        previous,
        new,
        fences: fences.as_ref(),
        goal: if args.new { Goal::New } else { Goal::Previous },
        force: args.force,
        even_while_flying: args.even_while_flying,
        patience_s: args.to.patience as f64,
        backup: transfer::beside(&journal.path, args.backup.as_ref(), ("mission-backup", "plan")),
    };
    let mut session = Session::open(&to, stop).await?;
    let result = restore::settle(&mut session, &request, teller(say)).await;
    session.close().await;
    let Settled { outcome, was, fence_known } = result?;
    let backup = request.backup.clone();
    let (new, previous) = (new.items.len(), previous.items.len());
    let path = journal.path.clone();
    let on_vehicle = OnVehicle::of(&outcome);
    let rest = journal.settle(fence_known && on_vehicle != OnVehicle::Unknown);
    let kept = format!("; what was on it is in {}", backup.display());
    let (items, done, now) = match on_vehicle {
        OnVehicle::New => (Some(new), fence_known, format!("the new mission of {}", counted(new, "item"))),
        OnVehicle::Previous => (
            Some(previous),
            !args.new && fence_known,
            format!("the previous mission of {}", counted(previous, "item")),
        ),
        _ => (None, false, String::new()),
    };
    let text = if done {
        format!("on the vehicle was: {was}; now it is {now}, read back and compared{kept}{rest}")
    } else {
        format!("on the vehicle was: {was}. Now: {outcome}{kept}{rest}")
    };
    let journal = (on_vehicle == OnVehicle::Unknown || !fence_known).then_some(path);
    let result = MissionResult::new(Action::Restore, done, on_vehicle, text);
    let was_on_vehicle = Some(was.to_string());
    MissionResult { items, was_on_vehicle, journal, backup: Some(backup), ..result }.settled()
}
