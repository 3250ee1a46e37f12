//! `gaware mission`: verified transfer of missions.

use super::mission_result::{Action, MissionResult, OnVehicle};
use super::{CommandError, mission_restore, output, start};
use crate::link::address::Address;
use crate::mission_link::files::{self, FileError};
use crate::mission_link::journal::Journal;
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::uploader::phase_words;
use crate::mission_link::vehicle::Vehicle;
use crate::mission_link::wire::{News, Wire};
use gaware_mission::fence::Fence;
use gaware_mission::transfer::TransferError;
use gaware_mission::transfer::verified::{Options, Outcome};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};
use tokio_util::sync::CancellationToken;

/// Arguments of `gaware mission`.
#[derive(Debug, Clone, clap::Args)]
pub struct MissionArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: MissionAction,
}

/// The transfers.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum MissionAction {
    /// Back up, upload, read back, compare; restore on failure.
    Upload(UploadArgs),
    /// Read the mission on board into a file.
    Download(LinkArgs),
    /// Put a backup back, verified in the same way; without a file, take up an upload that was interrupted: say what is on the vehicle and put
    /// the previous mission back.
    Restore(RestoreArgs),
}

/// Link and file.
#[derive(Debug, Clone, clap::Args)]
pub struct LinkArgs {
    /// Link to the vehicle: serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT.
    #[arg(long, value_name = "ADDR", required = true)]
    pub connect: Vec<Address>,
    /// Mission file, .plan or .waypoints.
    pub file: PathBuf,
    /// Talk to this system id (default: the first autopilot).
    #[arg(long, value_name = "ID")]
    pub vehicle: Option<u8>,
    /// Wait so long for the vehicle, at the start and after a loss of the link.
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub patience: u64,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `upload`.
#[derive(Debug, Clone, clap::Args)]
pub struct UploadArgs {
    /// Link and file.
    #[command(flatten)]
    pub link: LinkArgs,
    /// Where to keep the mission that is on board before (default: mission-backup-TIME.plan).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// Replace the mission although it is being flown, or the vehicle is armed in its mission mode.
    #[arg(long)]
    pub even_while_flying: bool,
}

/// Arguments of `restore`.
#[derive(Debug, Clone, clap::Args)]
pub struct RestoreArgs {
    /// Link to the vehicle: serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT.
    #[arg(long, value_name = "ADDR", required = true)]
    pub connect: Vec<Address>,
    /// Backup (.plan or .waypoints) or journal of an interrupted upload (default: the journal in this folder).
    pub file: Option<PathBuf>,
    /// Talk to this system id (default: the one of the journal, or the first autopilot).
    #[arg(long, value_name = "ID")]
    pub vehicle: Option<u8>,
    /// Wait so long for the vehicle, at the start and after a loss of the link.
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub patience: u64,
    /// Where to keep the mission that is on board before a backup is put back (default: mission-backup-TIME.plan).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// After an interrupted upload: bring the new mission instead of the previous one.
    #[arg(long)]
    pub new: bool,
    /// Replace the mission although it is being flown, or the vehicle is armed in its mission mode.
    #[arg(long)]
    pub even_while_flying: bool,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
}

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
    /// A mission without items would only delete the one on board.
    #[error("{0} holds no mission items; an upload would only delete the mission that is on the vehicle")]
    Empty(PathBuf),
    /// There is nothing to take up.
    #[error("there is no journal of an interrupted upload in {0}; name the backup that is to be put back")]
    NoJournal(PathBuf),
    /// Too many.
    #[error("several uploads were interrupted here; name one of {0}")]
    Journals(String),
    /// `--new` without a journal.
    #[error(
        "--new is for the journal of an interrupted upload; {0} is a mission: use \"gaware mission upload\""
    )]
    NotAJournal(PathBuf),
    /// The journal is about something else.
    #[error("{path} is about {journal}; this is {vehicle}", path = path.display())]
    OtherVehicle {
        /// The journal.
        path: PathBuf,
        /// What it is about.
        journal: String,
        /// What is there.
        vehicle: String,
    },
    /// The vehicle is not to be changed now.
    #[error("nothing was changed: {0}; disarm or leave that mode, or give --even-while-flying")]
    Flying(String),
    /// Anything but a verified upload.
    #[error("{0}")]
    NotVerified(Box<MissionResult>),
}

impl MissionError {
    /// Whether the arguments were at fault.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::File(FileError::Kind(_)) | Self::NotAJournal(_) | Self::Journals(_))
    }
}

/// Runs the transfer and says in a sentence, or in a document, how it ended. The document also tells of transfers that did not bring what was
/// asked for; where there was no transfer there is none, as with the other commands.
///
/// # Errors
/// Anything but a verified transfer.
pub fn run(args: &MissionArgs) -> Result<(), CommandError> {
    let runtime = start::runtime()?;
    let result: Result<MissionResult, MissionError> = runtime.block_on(async {
        let stop = CancellationToken::new();
        start::cancel_on_signal(&stop);
        match &args.action {
            MissionAction::Upload(args) => {
                if files::read(&args.link.file)?.0.items.is_empty() {
                    return Err(MissionError::Empty(args.link.file.clone()));
                }
                upload(args, &stop, |text| eprintln!("{text}")).await
            }
            MissionAction::Restore(args) => {
                mission_restore::restore(args, &stop, |text| eprintln!("{text}")).await
            }
            MissionAction::Download(link) => download(link, &stop).await,
        }
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    let json = match &args.action {
        MissionAction::Upload(args) => args.link.json,
        MissionAction::Download(link) => link.json,
        MissionAction::Restore(args) => args.json,
    };
    match &result {
        Ok(result) if json => output::json(result)?,
        Err(MissionError::NotVerified(result)) if json => output::json(result.as_ref())?,
        Ok(result) => output::text(&format!("{result}\n"))?,
        Err(_) => {}
    }
    Ok(result.map(drop)?)
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

/// Brings a mission that is in a file, whatever that is called.
pub(super) async fn bring(
    action: Action,
    args: &UploadArgs,
    stop: &CancellationToken,
    mut say: impl FnMut(&str),
) -> Result<MissionResult, MissionError> {
    let (mission, _) = files::read(&args.link.file)?;
    let backup_path = args.backup.clone().unwrap_or_else(default_backup);
    let folder = Journal::folder_of(&backup_path);
    let mut session = open(&args.link, stop).await?;
    let vehicle = session.vehicle();
    if let Err(e) = Journal::check(folder, &vehicle) {
        session.close().await;
        return Err(e.into());
    }
    let options = Options { even_while_flying: args.even_while_flying, ..Options::default() };
    let (mut kept, mut journal) = (None, None);
    let new = mission.clone();
    let keep = |backup: &gaware_mission::item::Mission| {
        let text =
            files::text_of(&backup_path, backup, &Fence::default(), vehicle.autopilot, vehicle.mav_type);
        text.and_then(|text| files::write_new(&backup_path, &text)).map_err(|e| e.to_string())?;
        journal = Some(Journal::begin(folder, &vehicle, backup, &new).map_err(|e| e.to_string())?);
        kept = Some(backup.items.len());
        Ok(())
    };
    let patience = Duration::from_secs(args.link.patience);
    let outcome = session.upload(mission, options, patience, keep, teller(&mut say)).await;
    session.close().await;
    let mut text = outcome.to_string();
    if kept.is_some() {
        text.push_str(&format!("; the mission before is in {}", backup_path.display()));
    }
    let on_vehicle = OnVehicle::of(&outcome);
    let left = journal.as_ref().filter(|_| on_vehicle == OnVehicle::Unknown).map(|j| j.path.clone());
    text.push_str(&journal.map(|j| j.settle(&outcome)).unwrap_or_default());
    let done = on_vehicle == OnVehicle::New;
    let mut result = MissionResult::new(action, done, on_vehicle, text);
    result.items = match &outcome {
        Outcome::Verified { items } => Some(*items),
        Outcome::RestoredPrevious { .. } => kept,
        Outcome::Unknown { .. } => None,
    };
    result.backup = kept.map(|_| backup_path.clone());
    result.journal = left;
    result.settled()
}

/// Says in words what an upload tells; of its items every tenth part.
pub(super) fn teller(say: &mut impl FnMut(&str)) -> impl FnMut(News) {
    let mut percent = None;
    move |news| match news {
        News::Phase(phase) => say(phase_words(phase)),
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
pub async fn download(args: &LinkArgs, stop: &CancellationToken) -> Result<MissionResult, MissionError> {
    files::check_kind(&args.file)?;
    if args.file.exists() {
        let source = std::io::Error::from(std::io::ErrorKind::AlreadyExists);
        return Err(FileError::Write { path: args.file.clone(), source }.into());
    }
    let mut session = open(args, stop).await?;
    let Vehicle { autopilot, mav_type, .. } = session.vehicle();
    let mission = session.download().await;
    session.close().await;
    let mission = mission?;
    let text = files::text_of(&args.file, &mission, &Fence::default(), autopilot, mav_type)?;
    files::write_new(&args.file, &text)?;
    let items = mission.items.len();
    let text = format!("{items} items were read from the vehicle into {}", args.file.display());
    let result = MissionResult::new(Action::Download, true, OnVehicle::Unchanged, text);
    Ok(MissionResult { items: Some(items), file: Some(args.file.clone()), ..result })
}

async fn open(args: &LinkArgs, stop: &CancellationToken) -> Result<Session, SessionError> {
    Session::open(&args.connect, args.vehicle, Duration::from_secs(args.patience), stop).await
}

fn default_backup() -> PathBuf {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    PathBuf::from(format!("mission-backup-{}.plan", since.as_millis()))
}
