//! `gaware mission restore`: puts a backup back, or takes up an upload that was interrupted by the end of the program or of the link.

use super::mission::{LinkArgs, MissionError, RestoreArgs, UploadArgs, bring, bring_list, teller};
use super::mission_result::{Action, MissionResult, OnVehicle};
use super::transfer::{self, NoJournal};
use crate::figures::counted;
use crate::mission_link::files;
use crate::mission_link::journal::Journal;
use crate::mission_link::session::{Opening, Session};
use crate::mission_link::wire::{self, CutOff, Wire};
use gaware_mission::fence::Fence;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::OnBoard;
use gaware_mission::transfer::verified::{Goal, Options, Outcome};
use std::path::{Path, PathBuf};
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
    if let Some(list) = args.list {
        if Journal::is_named(&file) {
            return Err(MissionError::JournalIsWhole(file));
        }
        let kind = list.into();
        let new = files::read_contents(&file)?.list(kind);
        if new.items.is_empty() {
            return Err(MissionError::Empty(file));
        }
        return bring_list(Action::Restore, kind, new, &as_upload(args, file), stop, say).await;
    }
    if Journal::is_named(&file) {
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
    UploadArgs { link, backup: args.backup.clone(), no_fence: false, force, even_while_flying }
}

/// The only journal in a folder.
fn the_journal(folder: &Path) -> Result<PathBuf, MissionError> {
    transfer::the_only(&Journal::list(folder), folder).map_err(|why| match why {
        NoJournal::None(folder) => MissionError::NoJournal(folder),
        NoJournal::Several(names) => MissionError::Journals(names),
    })
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
    if let Some(id) = args.to.vehicle.filter(|id| *id != journal.system_id) {
        return Err(other(format!("system {id}")));
    }
    say(&begun(&journal));
    let to = Opening { vehicle: Some(journal.system_id), ..args.to.opening() };
    let mut session = Session::open(&to, stop).await?;
    let result = settle(args, &journal, &mut session, &other, say).await;
    session.close().await;
    let (outcome, was, fence_known) = result?;
    let (new, previous) = (journal.new.items.len(), journal.previous.items.len());
    let path = journal.path.clone();
    let rest = if fence_known { journal.settle(&outcome) } else { journal.left_words() };
    let on_vehicle = OnVehicle::of(&outcome);
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
        format!("on the vehicle was: {was}; now it is {now}, read back and compared{rest}")
    } else {
        format!("on the vehicle was: {was}. Now: {outcome}{rest}")
    };
    let journal = (on_vehicle == OnVehicle::Unknown || !fence_known).then_some(path);
    let result = MissionResult::new(Action::Restore, done, on_vehicle, text);
    MissionResult { items, was_on_vehicle: Some(was.to_string()), journal, ..result }.settled()
}

/// How it ended, what was on the vehicle before, and whether it is known which fence is there now.
async fn settle(
    args: &RestoreArgs,
    journal: &Journal,
    session: &mut Session,
    other: &impl Fn(String) -> MissionError,
    say: &mut impl FnMut(&str),
) -> Result<(Outcome, OnBoard, bool), MissionError> {
    let vehicle = session.vehicle();
    if vehicle.autopilot != journal.autopilot {
        return Err(other(format!("system {}, {:?}", vehicle.address.system, vehicle.autopilot)));
    }
    let refusal = vehicle.state.objection().filter(|_| !args.even_while_flying);
    if let Some(why) = refusal {
        return Err(MissionError::Flying(why.to_string()));
    }
    let got = wire::download(session, MissionKind::Mission).await?;
    let was = OnBoard::judge(vehicle.autopilot, &journal.new, &journal.previous, &got);
    say(&format!("on the vehicle now: {was}"));
    let goal = if args.new { Goal::New } else { Goal::Previous };
    let patience_s = args.to.patience as f64;
    // PX4 checks a mission against the fence it has: the fence comes first.
    let mut fence_known = true;
    if let Some((previous, new)) = &journal.fences {
        let list = |fence: &Fence| Mission { home: None, items: fence.items() };
        let cut_off = CutOff { kind: MissionKind::Fence, new: list(new), previous: list(previous), goal };
        let fence = wire::resume(session, cut_off, Options::default(), patience_s, teller(say)).await;
        fence_known = !matches!(fence, Outcome::Unknown { .. });
        say(&fence.about(MissionKind::Fence));
    }
    let cut_off = CutOff {
        kind: MissionKind::Mission,
        new: journal.new.clone(),
        previous: journal.previous.clone(),
        goal,
    };
    let outcome = wire::resume(session, cut_off, Options::default(), patience_s, teller(say)).await;
    Ok((outcome, was, fence_known))
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
        "an upload of {} over {} to system {} began{when} and did not end",
        counted(journal.new.items.len(), "item"),
        journal.previous.items.len(),
        journal.system_id
    )
}
