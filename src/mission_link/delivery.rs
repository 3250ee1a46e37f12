//! A whole plan to a vehicle: the geofence first, since PX4 checks a mission against the fence it has, then the mission; each of them backed up,
//! read back and compared, and both put back when the mission does not get there. What is enforced of the fence is read and reported.

use super::facts;
use super::files::{self, Contents, FileError};
use super::journal::Journal;
use super::wire::{self, Change, CutOff, News, Wire};
use crate::preflight;
use gaware_mission::fence::Fence;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::TransferError;
use gaware_mission::transfer::verified::{Goal, Options, Outcome, Phase};
use std::path::PathBuf;

/// What is to be done.
#[derive(Debug, Clone)]
pub struct Order {
    /// The plan.
    pub contents: Contents,
    /// Whether its geofence goes along.
    pub with_fence: bool,
    /// How far to go.
    pub options: Options,
    /// How long to wait for a link that is lost, s.
    pub patience_s: f64,
    /// Where to keep what is on board before.
    pub backup: PathBuf,
}

/// How it ended.
#[derive(Debug)]
pub struct Delivered {
    /// The mission.
    pub outcome: Outcome,
    /// What is to be said of the geofence.
    pub fence: String,
    /// Items of the mission that was on board before, once it was kept.
    pub kept: Option<usize>,
    /// The journal, where it is not known what is on the vehicle.
    pub journal: Option<PathBuf>,
    /// All of it in a sentence.
    pub text: String,
}

/// What was read before anything is changed.
struct Before {
    mission: Mission,
    fence: Result<Fence, String>,
}

/// Brings the plan.
///
/// # Errors
/// Another transfer to this vehicle is under way or was interrupted.
pub async fn deliver(
    wire: &mut impl Wire,
    order: &Order,
    mut tell: impl FnMut(News),
) -> Result<Delivered, FileError> {
    let folder = files::folder_of(&order.backup);
    Journal::check(folder, &wire.vehicle())?;
    let before = match look(wire, order, &mut tell).await {
        Ok(before) => before,
        Err(why) => return Ok(untouched(why, None)),
    };
    let kept = Some(before.mission.items.len());
    let journal = match keep(wire, order, &before) {
        Ok(journal) => journal,
        Err(e) => return Ok(untouched(format!("the backup could not be kept: {e}"), None)),
    };
    let fences = journal.fences.clone();
    let (outcome, fence_known) = bring(wire, order, before.mission, fences.as_ref(), &mut tell).await;
    let fence = match &outcome {
        Outcome::Verified { .. } => say_fence(wire, order, before.fence.as_ref().ok()).await,
        _ => String::new(),
    };
    let mut text = outcome.to_string();
    if !fence.is_empty() {
        text.push_str(&format!("; {fence}"));
    }
    text.push_str(&format!("; the mission before is in {}", order.backup.display()));
    let known = fence_known && !matches!(outcome, Outcome::Unknown { .. });
    let left = (!known).then(|| journal.path.clone());
    text.push_str(&if known { journal.settle(&outcome) } else { journal.left_words() });
    Ok(Delivered { outcome, fence, kept, journal: left, text })
}

fn untouched(why: String, kept: Option<usize>) -> Delivered {
    let outcome = Outcome::RestoredPrevious { why };
    Delivered { text: outcome.to_string(), outcome, fence: String::new(), kept, journal: None }
}

/// Reads what is on board; says why nothing may be changed.
async fn look(wire: &mut impl Wire, order: &Order, tell: &mut impl FnMut(News)) -> Result<Before, String> {
    let flying = wire.vehicle().state.objection().filter(|_| !order.options.even_while_flying);
    if let Some(why) = flying {
        return Err(why.to_owned());
    }
    tell(News::Phase(Phase::BackingUp));
    let failed = |e: TransferError| match e {
        TransferError::Cancelled => "it was cancelled".to_owned(),
        e => format!("the mission on board could not be backed up first: {e}"),
    };
    let mission = wire::download(wire, MissionKind::Mission).await.map_err(failed)?;
    let fence = match wire::download(wire, MissionKind::Fence).await {
        Err(TransferError::Cancelled) => return Err("it was cancelled".to_owned()),
        Err(e) => Err(e.to_string()),
        Ok(list) => Fence::from_items(&list.items).map_err(|e| e.to_string()),
    };
    match &fence {
        Err(why) if order.with_fence => Err(format!(
            "its geofence cannot go along ({why}), and without it the vehicle would not keep to the area that was planned; \
             --no-fence uploads the mission alone"
        )),
        _ => Ok(Before { mission, fence }),
    }
}

/// Writes backup and journal, down to the disk.
fn keep(wire: &impl Wire, order: &Order, before: &Before) -> Result<Journal, FileError> {
    let vehicle = wire.vehicle();
    let fence = before.fence.clone().unwrap_or_default();
    let contents = Contents { mission: before.mission.clone(), fence, ..Contents::default() };
    let text = files::text_of_contents(&order.backup, &contents, vehicle.autopilot, vehicle.mav_type)?;
    files::write_new(&order.backup, &text)?;
    let fences = order.with_fence.then(|| (contents.fence, order.contents.fence.clone()));
    let folder = files::folder_of(&order.backup);
    Journal::begin(folder, &vehicle, &before.mission, &order.contents.mission, fences)
}

/// Fence and mission; whether it is known which fence is on the vehicle.
async fn bring(
    wire: &mut impl Wire,
    order: &Order,
    previous: Mission,
    fences: Option<&(Fence, Fence)>,
    tell: &mut impl FnMut(News),
) -> (Outcome, bool) {
    let list = |fence: &Fence| Mission { home: None, items: fence.items() };
    if let Some((before, after)) = fences {
        let change = Change { kind: MissionKind::Fence, new: list(after), previous: list(before) };
        let fence = wire::replace(wire, change, order.options, order.patience_s, &mut *tell).await;
        match &fence {
            Outcome::Verified { .. } => {}
            Outcome::RestoredPrevious { why } => {
                let why = format!("its geofence did not get onto the vehicle: {why}");
                return (Outcome::RestoredPrevious { why }, true);
            }
            Outcome::Unknown { .. } => return (fence, false),
        }
    }
    let new = order.contents.mission.clone();
    let change = Change { kind: MissionKind::Mission, new, previous };
    let outcome = wire::replace(wire, change, order.options, order.patience_s, &mut *tell).await;
    let (Outcome::RestoredPrevious { why }, Some((before, after))) = (&outcome, fences) else {
        return (outcome, true);
    };
    // The fence belongs to the mission that did not get there.
    let cut_off =
        CutOff { kind: MissionKind::Fence, new: list(after), previous: list(before), goal: Goal::Previous };
    match wire::resume(wire, cut_off, order.options, order.patience_s, tell).await {
        Outcome::Unknown { on_vehicle, what_to_do } => {
            let on_vehicle = format!("{on_vehicle}; the previous mission is there, because {why}");
            (Outcome::Unknown { on_vehicle, what_to_do }, false)
        }
        _ => (outcome, true),
    }
}

/// What is on the vehicle of a fence, and what it does at it.
async fn say_fence(wire: &mut impl Wire, order: &Order, before: Option<&Fence>) -> String {
    let on_board = if order.with_fence { Some(&order.contents.fence) } else { before };
    let planned = match (order.with_fence, order.contents.fence.is_empty()) {
        (true, _) => format!("its geofence ({}) too", order.contents.fence.describe()),
        (false, true) => match before {
            Some(fence) if !fence.is_empty() => format!(
                "the plan has no geofence; the vehicle keeps its own ({}), which \"gaware mission clear --type fence\" removes",
                fence.describe()
            ),
            _ => return String::new(),
        },
        (false, false) => match before {
            Some(fence) if !fence.is_empty() => {
                format!(
                    "THE PLAN'S GEOFENCE IS NOT ON THE VEHICLE, which keeps its own ({})",
                    fence.describe()
                )
            }
            _ => "THE PLAN'S GEOFENCE IS NOT ON THE VEHICLE".to_owned(),
        },
    };
    if on_board.is_none_or(Fence::is_empty) {
        return planned;
    }
    let autopilot = wire.vehicle().autopilot;
    let names = preflight::fence_parameters(autopilot);
    match facts::read_parameters(wire, names).await {
        Some(read) => format!("{planned}; {}", preflight::enforcement(autopilot, &read).1),
        None => planned,
    }
}
