//! A whole plan to a vehicle, checked against it: the geofence first, since PX4 checks a mission against the fence it has, then the mission; each of them backed up,
//! read back and compared, and both put back when the mission does not get there. What is enforced of the fence is read and reported.

use super::facts::{self, Wish};
use super::files::{self, Contents, FileError};
use super::journal::{Content, Journal, Kind, list};
use super::param_transfer;
use super::vehicle::Vehicle;
use super::wire::{self, Checked, ListChange, News, Wire};
use crate::preflight::{self, Against, Facts, Verdict};
use gaware_mission::airframe::Airframe;
use gaware_mission::change::Phase;
use gaware_mission::compare::differences;
use gaware_mission::fence::Fence;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::TransferError;
use gaware_mission::transfer::verified::{Goal, Options, Outcome};
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
    /// The airframe that the plan is for, where the plan does not name one.
    pub airframe: Option<Airframe>,
    /// Other vehicles on the link, where none was chosen.
    pub others: Vec<Vehicle>,
    /// Upload although the check says stop.
    pub force: bool,
}

/// Why nothing was begun.
#[derive(Debug, thiserror::Error)]
pub enum DeliveryError {
    /// Another transfer to this vehicle is under way or was interrupted.
    #[error(transparent)]
    File(#[from] FileError),
    /// The pre-flight check, or a contradiction about who the vehicle is.
    #[error("nothing was changed: {0}")]
    Refused(String),
    /// The pre-flight check; it can be overridden.
    #[error("nothing was changed: {0}; --force uploads all the same")]
    Preflight(String),
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
    /// What the pre-flight check had to say.
    pub checked: Checked,
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

/// The pre-flight check of an upload, the same as `gaware preflight` but for the messages that an estimate needs. Whether the vehicle may be
/// changed at all in its state is the transfer's own matter, as is where the mission begins.
async fn check(wire: &mut impl Wire, order: &Order) -> Result<Checked, DeliveryError> {
    let parameters = preflight::parameters(wire.vehicle().autopilot);
    let wish = Wish { parameters, ..Wish::default() };
    let facts = facts::gather(wire, wish).await.map_err(DeliveryError::Refused)?;
    let facts = Facts { others: order.others.clone(), ..facts };
    let against = Against { plan: Some(&order.contents), airframe: order.airframe.as_ref() };
    let rows = preflight::check(&facts, against);
    let of = |verdict| -> Vec<String> {
        let left_out = [preflight::STATE, preflight::FIRST_ITEM];
        let rows = rows.iter().filter(|r| r.verdict == verdict && !left_out.contains(&r.check));
        rows.map(|r| r.text.clone()).collect()
    };
    let (warnings, overridden) = (of(Verdict::Warn), of(Verdict::Stop));
    if !overridden.is_empty() && !order.force {
        return Err(DeliveryError::Preflight(overridden.join("; ")));
    }
    Ok(Checked { warnings, overridden })
}

/// Checks and brings the plan.
///
/// # Errors
/// Another transfer to this vehicle is under way or was interrupted; or the check says stop, and that was not overridden.
pub async fn deliver(
    wire: &mut impl Wire,
    order: &Order,
    mut tell: impl FnMut(News),
) -> Result<Delivered, DeliveryError> {
    Kind::Mission.check(files::folder_of(&order.backup), &wire.identity())?;
    let checked = check(wire, order).await?;
    tell(News::Checked(checked.clone()));
    let before = match look(wire, order, &mut tell).await {
        Ok(before) => before,
        Err(why) => return Ok(untouched(why, checked)),
    };
    let kept = Some(before.mission.items.len());
    let journal = match keep(wire, order, &before) {
        Ok(journal) => journal,
        Err(e) => return Ok(untouched(format!("the backup could not be kept: {e}"), checked)),
    };
    let fences = order.with_fence.then(|| fences_of(order, &before));
    let (mut outcome, fence_known) = bring(wire, order, before.mission, fences.as_ref(), &mut tell).await;
    if let (Outcome::Verified { .. }, Some((_, after))) = (&outcome, &fences)
        && let Some(foreign) = other_fence(wire, after).await
    {
        outcome = foreign;
    }
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
    text.push_str(&journal.settle(known));
    Ok(Delivered { outcome, fence, kept, checked, journal: left, text })
}

fn untouched(why: String, checked: Checked) -> Delivered {
    let outcome = Outcome::RestoredPrevious { why };
    Delivered { text: outcome.to_string(), outcome, fence: String::new(), kept: None, checked, journal: None }
}

/// The fence before, and the one of the plan.
fn fences_of(order: &Order, before: &Before) -> (Fence, Fence) {
    (before.fence.clone().unwrap_or_default(), order.contents.fence.clone())
}

/// Another station's fence in place of the one that was verified before the mission; a fence that cannot be read now is still that one.
async fn other_fence(wire: &mut impl Wire, sent: &Fence) -> Option<Outcome> {
    let got = wire::download(wire, MissionKind::Fence).await.ok()?;
    if differences(wire.vehicle().autopilot, &list(sent), &got).is_empty() {
        return None;
    }
    let on_vehicle = format!(
        "the mission that was sent is on the vehicle, its geofence is NOT: {} items of another one were read back",
        got.items.len()
    );
    let what_to_do = "Find out who else uploads, then upload again and read both back".to_owned();
    Some(Outcome::Foreign { on_vehicle, what_to_do })
}

/// Reads what is on board; says why nothing may be changed.
async fn look(wire: &mut impl Wire, order: &Order, tell: &mut impl FnMut(News)) -> Result<Before, String> {
    let flying = wire.vehicle().state.objection().filter(|_| !order.options.even_while_flying);
    if let Some(why) = flying {
        return Err(why.to_owned());
    }
    tell(News::Phase(Phase::BackingUp));
    let failed = |e: TransferError| match e {
        TransferError::Stopped(why) => why,
        e => format!("the mission on board could not be backed up first: {e}"),
    };
    let mission = wire::download(wire, MissionKind::Mission).await.map_err(failed)?;
    let fence = match wire::download(wire, MissionKind::Fence).await {
        Err(TransferError::Stopped(why)) => return Err(why),
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
    let vehicle = wire.identity();
    let (fence, mission) = (before.fence.clone().unwrap_or_default(), before.mission.clone());
    let contents = Contents { mission, fence, backup_of: Some(vehicle), ..Contents::default() };
    let text = files::text_of(&order.backup, &contents, vehicle.autopilot, vehicle.mav_type)?;
    files::write_new(&order.backup, &text)?;
    let fences = order.with_fence.then(|| fences_of(order, before));
    let (previous, new) = (contents.mission, order.contents.mission.clone());
    Journal::begin(files::folder_of(&order.backup), vehicle, Content::Mission { previous, new, fences })
}

/// Fence and mission; whether it is known which fence is on the vehicle.
async fn bring(
    wire: &mut impl Wire,
    order: &Order,
    previous: Mission,
    fences: Option<&(Fence, Fence)>,
    tell: &mut impl FnMut(News),
) -> (Outcome, bool) {
    if let Some((before, after)) = fences {
        let change = ListChange { kind: MissionKind::Fence, new: list(after), previous: list(before) };
        // It is read once more at the end of all.
        let options = Options { confirm: false, ..order.options };
        let fence = wire::replace(wire, change, options, order.patience_s, &mut *tell).await;
        match &fence {
            Outcome::Verified { .. } => {}
            Outcome::RestoredPrevious { why } => {
                let why = format!("its geofence did not get onto the vehicle: {why}");
                return (Outcome::RestoredPrevious { why }, true);
            }
            Outcome::Foreign { .. } => return (fence, true),
            Outcome::Unknown { .. } => return (fence, false),
        }
    }
    let new = order.contents.mission.clone();
    let change = ListChange { kind: MissionKind::Mission, new, previous };
    let outcome = wire::replace(wire, change, order.options, order.patience_s, &mut *tell).await;
    let (Outcome::RestoredPrevious { why }, Some((before, after))) = (&outcome, fences) else {
        return (outcome, true);
    };
    // The fence belongs to the mission that did not get there.
    let change = ListChange { kind: MissionKind::Fence, new: list(after), previous: list(before) };
    match wire::resume(wire, change, Goal::Previous, order.options, order.patience_s, tell).await {
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
    match param_transfer::read(wire, names).await {
        Ok(read) => format!("{planned}; {}", preflight::enforcement(autopilot, &read).1),
        Err(_) => planned,
    }
}
