//! Takes up an upload of which only a journal is left: into the vehicle that it is about, over what came from that upload, and never without
//! a copy of what is on board.

use super::files::{self, Contents, FileError};
use super::journal::{Journal, list};
use super::wire::{self, ListChange, News, Wire};
use gaware_mission::fence::Fence;
use gaware_mission::identity::{Identity, Sameness};
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::verified::{Goal, Options, Outcome};
use gaware_mission::transfer::{OnBoard, TransferError};
use std::path::PathBuf;

/// Why nothing was changed.
#[derive(Debug, thiserror::Error)]
pub enum RestoreError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// What is on board cannot be read.
    #[error("nothing was changed: the {kind} on board could not be read: {source}")]
    List {
        /// Which list.
        kind: MissionKind,
        /// Why.
        source: TransferError,
    },
    /// The journal is of another vehicle.
    #[error("{0}")]
    OtherVehicle(String),
    /// What is on the vehicle is of neither mission.
    #[error(
        "nothing was changed: on the vehicle is neither the previous mission nor the new one, but {what}. --force puts the mission of {path} \
         over it and keeps it in a file; or remove that journal if what is there is wanted", path = path.display()
    )]
    Neither {
        /// The journal.
        path: PathBuf,
        /// What was read.
        what: String,
    },
    /// The vehicle is not to be changed now.
    #[error("nothing was changed: {0}; disarm or leave that mode, or give --even-while-flying")]
    Flying(String),
}

/// An upload that was interrupted, and what is wanted of it.
#[derive(Debug)]
pub struct Restoration<'a> {
    /// Its journal.
    pub journal: &'a Journal,
    /// The mission before.
    pub previous: &'a Mission,
    /// The one that was to be there.
    pub new: &'a Mission,
    /// The fence before, and the new one.
    pub fences: Option<&'a (Fence, Fence)>,
    /// Which of them.
    pub goal: Goal,
    /// Also over what is of neither.
    pub force: bool,
    /// Also into a vehicle that flies a mission.
    pub even_while_flying: bool,
    /// How long to wait for a link that is lost, s.
    pub patience_s: f64,
    /// Where to keep what is on board.
    pub backup: PathBuf,
}

/// How it ended.
#[derive(Debug)]
pub struct Settled {
    /// What is on the vehicle.
    pub outcome: Outcome,
    /// What was on it before.
    pub was: OnBoard,
    /// Whether it is known which fence is there now.
    pub fence_known: bool,
}

/// Checks that this is the vehicle and that what is on it came from this upload, keeps it in a file, and brings what is wanted.
///
/// # Errors
/// Nothing was changed.
pub async fn settle(
    wire: &mut impl Wire,
    wanted: &Restoration<'_>,
    mut tell: impl FnMut(News),
) -> Result<Settled, RestoreError> {
    let (vehicle, here) = (wire.vehicle(), wire.identity());
    let doubt = wanted.journal.check_vehicle(&here).map_err(RestoreError::OtherVehicle)?;
    doubt.into_iter().for_each(|text| tell(News::Said(format!("warning: {text}"))));
    if let Some(why) = vehicle.state.objection().filter(|_| !wanted.even_while_flying) {
        return Err(RestoreError::Flying(why.to_owned()));
    }
    let got = read(wire, MissionKind::Mission).await?;
    let was = OnBoard::judge(vehicle.autopilot, wanted.new, wanted.previous, &got);
    tell(News::Said(format!("on the vehicle now: {was}")));
    let fence = match wanted.fences {
        Some(_) => read(wire, MissionKind::Fence).await?,
        None => Mission::default(),
    };
    if !wanted.force {
        wanted.check_on_board(&here, &was, &fence)?;
    }
    wanted.keep(here, got, fence)?;
    let Restoration { goal, patience_s, .. } = *wanted;
    let (over_others, even_while_flying) = (wanted.force, wanted.even_while_flying);
    let options = Options { even_while_flying, over_others, ..Options::default() };
    // PX4 checks a mission against the fence it has: the fence comes first.
    let mut fence_known = true;
    if let Some((previous, new)) = wanted.fences {
        let change = ListChange { kind: MissionKind::Fence, new: list(new), previous: list(previous) };
        let fence = wire::resume(wire, change, goal, options, patience_s, &mut tell).await;
        fence_known = !matches!(fence, Outcome::Unknown { .. });
        tell(News::Said(fence.about(MissionKind::Fence)));
    }
    let (new, previous) = (wanted.new.clone(), wanted.previous.clone());
    let change = ListChange { kind: MissionKind::Mission, new, previous };
    let outcome = wire::resume(wire, change, goal, options, patience_s, tell).await;
    Ok(Settled { outcome, was, fence_known })
}

async fn read(wire: &mut impl Wire, kind: MissionKind) -> Result<Mission, RestoreError> {
    wire::download(wire, kind).await.map_err(|source| RestoreError::List { kind, source })
}

impl Restoration<'_> {
    /// What is on board must come from the upload: anything else is somebody's who does not expect that it is replaced.
    fn check_on_board(&self, here: &Identity, was: &OnBoard, fence: &Mission) -> Result<(), RestoreError> {
        let proven = self.journal.vehicle.is(here) == Sameness::Same;
        let neither = |found: &OnBoard| match found {
            OnBoard::Other { .. } => true,
            OnBoard::Nothing => !proven,
            _ => false,
        };
        let of_fence = |(previous, new): &(Fence, Fence)| {
            OnBoard::judge(here.autopilot, &list(new), &list(previous), fence)
        };
        let what = match self.fences.map(of_fence) {
            _ if neither(was) => was.to_string(),
            Some(found) if neither(&found) => {
                format!("{was}, with a geofence of {} items of neither", fence.items.len())
            }
            _ => return Ok(()),
        };
        Err(RestoreError::Neither { path: self.journal.path.clone(), what })
    }

    /// Keeps what is on board.
    fn keep(&self, vehicle: Identity, mission: Mission, fence: Mission) -> Result<(), FileError> {
        let mut contents = Contents { mission, backup_of: Some(vehicle), ..Contents::default() };
        let put = contents.put(MissionKind::Fence, fence);
        put.map_err(|source| FileError::List { path: self.backup.clone(), source })?;
        let text = files::text_of(&self.backup, &contents, vehicle.autopilot, vehicle.mav_type)?;
        files::write_new(&self.backup, &text)
    }
}
