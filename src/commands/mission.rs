//! `gaware mission`: verified transfer of missions.

use super::demo::load_airframe;
pub use super::mission_args::{
    ClearArgs, ConnectArgs, DownloadArgs, LinkArgs, List, MissionAction, MissionArgs, RestoreArgs, UploadArgs,
};
use super::mission_result::{Action, MissionResult, OnVehicle};
use super::{CommandError, mission_restore, transfer};
use crate::figures::counted_were;
use crate::mission_link::delivery::{Delivered, DeliveryError, Order, deliver};
use crate::mission_link::files::{self, Contents, FileError};
use crate::mission_link::journal::{JournalError, Kind};
use crate::mission_link::restore::RestoreError;
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::uploader::phase_words;
use crate::mission_link::vehicle::identity_words;
use crate::mission_link::wire::{self, ListChange, News, Wire};
use gaware_mission::airframe::Airframe;
use gaware_mission::identity::{Identity, Sameness};
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::TransferError;
use gaware_mission::transfer::verified::{Options, Outcome};
use std::path::{Path, PathBuf};
use tokio_util::sync::CancellationToken;

/// Why a transfer was not done.
#[derive(Debug, thiserror::Error)]
pub enum MissionError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// No vehicle.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A download.
    #[error("the mission could not be read: {0}")]
    Download(#[from] TransferError),
    /// A list that not every vehicle has.
    #[error("the {kind} could not be read: {source}")]
    List {
        /// Which one.
        kind: MissionKind,
        /// Why.
        source: TransferError,
    },
    /// The pre-flight check, or an earlier transfer.
    #[error(transparent)]
    Delivery(#[from] DeliveryError),
    /// An airframe that there is not.
    #[error(transparent)]
    Airframe(Box<CommandError>),
    /// The second signal.
    #[error(
        "ended at once, as asked: what is on the vehicle is not known if an upload had begun; \"gaware mission restore\" takes it up from its journal"
    )]
    Abandoned,
    /// A mission without items would only delete the one on board.
    #[error("{0} holds no mission items; an upload would only delete the mission that is on the vehicle")]
    Empty(PathBuf),
    /// Which upload is to be taken up.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// `--new` without a journal.
    #[error(
        "--new is for the journal of an interrupted upload; {0} is a mission: use \"gaware mission upload\""
    )]
    NotAJournal(PathBuf),
    /// `--type` with a journal.
    #[error("{0} is the journal of an interrupted upload, which is restored as a whole: leave --type out")]
    JournalIsWhole(PathBuf),
    /// A backup of another vehicle.
    #[error("{0}")]
    OtherVehicle(String),
    /// An interrupted upload.
    #[error(transparent)]
    Restore(#[from] RestoreError),
    /// Anything but a verified upload.
    #[error("{0}")]
    NotVerified(Box<MissionResult>),
}

impl MissionError {
    /// Whether the arguments were at fault.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::File(FileError::Kind(_) | FileError::NotAPlan { .. })
                | Self::NotAJournal(_)
                | Self::JournalIsWhole(_)
                | Self::Journal(JournalError::Several { .. } | JournalError::OtherKind { .. })
        )
    }
}

/// Runs the transfer and says in a sentence, or in a document, how it ended. The document also reports transfers that did not bring what was
/// asked for; where there was no transfer there is none, as with the other commands.
///
/// # Errors
/// Anything but a verified transfer.
pub fn run(args: &MissionArgs) -> Result<(), CommandError> {
    let ended = transfer::run(|stop| async move { act(&args.action, &stop).await })?;
    let result = ended.unwrap_or(Err(MissionError::Abandoned));
    let json = match &args.action {
        MissionAction::Upload(args) => args.link.to.json,
        MissionAction::Download(args) => args.link.to.json,
        MissionAction::Restore(args) => args.to.json,
        MissionAction::Clear(args) => args.to.json,
    };
    transfer::show(result, json, |error| match error {
        MissionError::NotVerified(result) => Some(result.as_ref()),
        _ => None,
    })
}

async fn act(action: &MissionAction, stop: &CancellationToken) -> Result<MissionResult, MissionError> {
    match action {
        MissionAction::Upload(args) => {
            if files::read(&args.link.file)?.0.items.is_empty() {
                return Err(MissionError::Empty(args.link.file.clone()));
            }
            upload(args, stop, transfer::progress).await
        }
        MissionAction::Restore(args) => mission_restore::restore(args, stop, transfer::progress).await,
        MissionAction::Clear(args) => clear(args, stop, transfer::progress).await,
        MissionAction::Download(args) => download(args, stop).await,
    }
}

/// Uploads.
///
/// # Errors
/// As [`run`].
pub async fn upload(
    args: &UploadArgs,
    stop: &CancellationToken,
    say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    bring(Action::Upload, args, stop, say).await
}

/// Brings a plan that is in a file, whatever that is called.
pub(super) async fn bring(
    action: Action,
    args: &UploadArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let contents = files::read_contents(&args.link.file)?;
    let backup = args.backup.clone().unwrap_or_else(|| transfer::default_backup("mission-backup", "plan"));
    let with_fence = !args.no_fence && !contents.fence.is_empty();
    files::check_holds(&backup, if with_fence { MissionKind::Fence } else { MissionKind::Mission })?;
    let airframe = args.airframe.as_deref().map(load_airframe).transpose();
    let airframe = airframe.map_err(|e| MissionError::Airframe(Box::new(e)))?;
    let mut session = Session::open(&args.link.to.opening(), stop).await?;
    let result = bring_over(&mut session, args, contents, airframe, backup.clone(), &mut say).await;
    session.close().await;
    let delivered = result?;
    let on_vehicle = OnVehicle::of(&delivered.outcome);
    let done = on_vehicle == OnVehicle::New && delivered.journal.is_none();
    let mut result = MissionResult::new(action, done, on_vehicle, delivered.text);
    result.items = match &delivered.outcome {
        Outcome::Verified { items } => Some(*items),
        Outcome::RestoredPrevious { .. } => delivered.kept,
        Outcome::Foreign { .. } | Outcome::Unknown { .. } => None,
    };
    result.backup = delivered.kept.map(|_| backup);
    result.fence = (!delivered.fence.is_empty()).then_some(delivered.fence);
    (result.warnings, result.overridden) = (delivered.checked.warnings, delivered.checked.overridden);
    result.journal = delivered.journal;
    result.settled()
}

async fn bring_over(
    session: &mut Session,
    args: &UploadArgs,
    contents: Contents,
    airframe: Option<Airframe>,
    backup: PathBuf,
    say: &mut impl FnMut(&str),
) -> Result<Delivered, MissionError> {
    let options = Options {
        even_while_flying: args.even_while_flying,
        planned_for: contents.planned_for,
        ..Options::default()
    };
    let order = Order {
        with_fence: !args.no_fence && !contents.fence.is_empty(),
        contents,
        options,
        patience_s: args.link.to.patience as f64,
        backup,
        airframe,
        others: Vec::new(),
        force: args.force,
    };
    Ok(deliver(session, &order, teller(say)).await?)
}

/// Puts one list of the vehicle in place of the one on board, which is kept in a file first.
pub(super) async fn bring_list(
    action: Action,
    (kind, new, backup_of): (MissionKind, Mission, Option<Identity>),
    args: &UploadArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let backup = args.backup.clone().unwrap_or_else(|| transfer::default_backup("mission-backup", "plan"));
    files::check_holds(&backup, kind)?;
    let mut session = Session::open(&args.link.to.opening(), stop).await?;
    let result = bring_list_over(&mut session, (kind, new, backup_of), args, &backup, &mut say).await;
    session.close().await;
    let (outcome, kept) = result?;
    let on_vehicle = OnVehicle::of(&outcome);
    let text = format!("{}; what was there before is in {}", outcome.about(kind), backup.display());
    let mut result = MissionResult::new(action, on_vehicle == OnVehicle::New, on_vehicle, text);
    result.items = match &outcome {
        Outcome::Verified { items } => Some(*items),
        Outcome::RestoredPrevious { .. } => Some(kept),
        Outcome::Foreign { .. } | Outcome::Unknown { .. } => None,
    };
    result.backup = Some(backup);
    result.settled()
}

async fn bring_list_over(
    session: &mut Session,
    (kind, new, backup_of): (MissionKind, Mission, Option<Identity>),
    args: &UploadArgs,
    backup: &Path,
    say: &mut impl FnMut(&str),
) -> Result<(Outcome, usize), MissionError> {
    let vehicle = session.identity();
    if let Some(meant) = backup_of.filter(|b| b.is(&vehicle) == Sameness::Other && !args.force) {
        return Err(MissionError::OtherVehicle(format!(
            "nothing was changed: {} is a backup of {}; connected is another vehicle, {}; --force restores it all the same",
            args.link.file.display(),
            identity_words(&meant),
            identity_words(&vehicle)
        )));
    }
    Kind::Mission.check(files::folder_of(backup), &vehicle)?;
    let previous = read_list(session, kind).await?;
    let kept = previous.items.len();
    let mut contents = Contents { backup_of: Some(vehicle), ..Contents::default() };
    let put = contents.put(kind, previous.clone());
    put.map_err(|source| FileError::List { path: backup.to_owned(), source })?;
    let text = files::text_of(backup, &contents, vehicle.autopilot, vehicle.mav_type)?;
    files::write_new(backup, &text)?;
    let options = Options { even_while_flying: args.even_while_flying, ..Options::default() };
    let change = ListChange { kind, new, previous };
    let outcome = wire::replace(session, change, options, args.link.to.patience as f64, teller(say)).await;
    Ok((outcome, kept))
}

/// One list of the vehicle, or why it cannot be had.
async fn read_list(session: &mut Session, kind: MissionKind) -> Result<Mission, MissionError> {
    wire::download(session, kind).await.map_err(|source| match kind {
        MissionKind::Mission => MissionError::Download(source),
        _ => MissionError::List { kind, source },
    })
}

/// Removes one list from the vehicle, kept in a file first and read back afterwards.
///
/// # Errors
/// As [`run`].
pub async fn clear(
    args: &ClearArgs,
    stop: &CancellationToken,
    say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let link = LinkArgs { to: args.to.clone(), file: PathBuf::new() };
    let upload = UploadArgs {
        link,
        backup: args.backup.clone(),
        no_fence: true,
        airframe: None,
        force: false,
        even_while_flying: args.even_while_flying,
    };
    bring_list(Action::Clear, (args.list.into(), Mission::default(), None), &upload, stop, say).await
}

/// Says in words what an upload reports; of its items every tenth part.
pub(super) fn teller(say: &mut impl FnMut(&str)) -> impl FnMut(News) {
    let mut percent = None;
    move |news| match news {
        News::Phase(phase) => say(phase_words(phase)),
        News::Said(text) => say(&text),
        News::Checked(checked) => {
            checked.warnings.iter().for_each(|text| say(&format!("warning: {text}")));
            checked.overridden.iter().for_each(|text| say(&format!("--force overrides: {text}")));
        }
        News::Progress(done, total) => {
            let now = done * 10 / total.max(1);
            if percent.replace(now) != Some(now) {
                say(&format!("{done} of {total} items"));
            }
        }
        News::Stranded(text) => say(&format!("{text}\nwaiting for the link …")),
    }
}

/// Downloads.
///
/// # Errors
/// As [`run`].
pub async fn download(args: &DownloadArgs, stop: &CancellationToken) -> Result<MissionResult, MissionError> {
    let file = &args.link.file;
    files::check_holds(file, args.list.map_or(MissionKind::Mission, MissionKind::from))?;
    files::refuse_existing(file)?;
    let mut session = Session::open(&args.link.to.opening(), stop).await?;
    let vehicle = session.identity();
    let read = read_contents(&mut session, args).await;
    session.close().await;
    let (contents, notes) = read?;
    let contents = Contents { backup_of: Some(vehicle), ..contents };
    let text = files::text_of(file, &contents, vehicle.autopilot, vehicle.mav_type)?;
    files::write_new(file, &text)?;
    let items = contents.mission.items.len();
    let what = match args.list.map(MissionKind::from) {
        None | Some(MissionKind::Mission) => counted_were(items, "item"),
        Some(MissionKind::Fence) => format!("a geofence ({}) was", contents.fence.describe()),
        Some(MissionKind::Rally) => counted_were(contents.rally_points.len(), "rally point"),
    };
    let text = format!("{what} read from the vehicle into {}{notes}", file.display());
    let result = MissionResult::new(Action::Download, true, OnVehicle::Unchanged, text);
    let fence = (!contents.fence.is_empty()).then(|| contents.fence.describe());
    Ok(MissionResult { items: Some(items), file: Some(file.clone()), fence, ..result })
}

/// What the file is to hold, and what else there is to say.
async fn read_contents(
    session: &mut Session,
    args: &DownloadArgs,
) -> Result<(Contents, String), MissionError> {
    let path = &args.link.file;
    let mut contents = Contents::default();
    let fails = |source| FileError::List { path: path.clone(), source };
    if let Some(kind) = args.list.map(MissionKind::from) {
        let list = read_list(session, kind).await?;
        contents.put(kind, list).map_err(fails)?;
        return Ok((contents, String::new()));
    }
    contents.mission = read_list(session, MissionKind::Mission).await?;
    let mut notes = String::new();
    if path.extension().is_some_and(|e| e == "plan") {
        for kind in [MissionKind::Fence, MissionKind::Rally] {
            // Not every vehicle has these lists; the mission is worth having without them.
            let put = match wire::download(session, kind).await {
                Err(error @ TransferError::Stopped(_)) => return Err(error.into()),
                Err(e) => Err(e.to_string()),
                Ok(list) => contents.put(kind, list).map_err(|e| e.to_string()),
            };
            if let Err(why) = put {
                notes.push_str(&format!("; its {kind} is not in it: {why}"));
            }
        }
        if !contents.fence.is_empty() {
            notes.insert_str(0, &format!(", with its geofence ({})", contents.fence.describe()));
        }
    }
    Ok((contents, notes))
}
