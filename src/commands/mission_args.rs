//! The arguments of `gaware mission`.

use crate::link::address::Address;
use crate::mission_link::session::Opening;
use gaware_mission::item::MissionKind;
use std::path::PathBuf;
use std::time::Duration;

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
    /// Back up, upload with the geofence of the plan, read back, compare; restore on failure.
    Upload(UploadArgs),
    /// Read what is on board into a file: mission, geofence and rally points, or one of them.
    Download(DownloadArgs),
    /// Put a backup back, verified in the same way; without a file, take up an upload that was interrupted: say what is on the vehicle and put
    /// the previous mission back.
    Restore(RestoreArgs),
    /// Remove the mission, the geofence or the rally points, kept in a file first.
    Clear(ClearArgs),
}

/// The lists that a vehicle keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum List {
    /// What is flown.
    Mission,
    /// The geofence.
    Fence,
    /// Rally points.
    Rally,
}

impl From<List> for MissionKind {
    fn from(list: List) -> Self {
        match list {
            List::Mission => Self::Mission,
            List::Fence => Self::Fence,
            List::Rally => Self::Rally,
        }
    }
}

/// How to reach a vehicle.
#[derive(Debug, Clone, clap::Args)]
pub struct ConnectArgs {
    /// Link to the vehicle: serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT.
    #[arg(long, value_name = "ADDR", required = true)]
    pub connect: Vec<Address>,
    /// Talk to this system id (needed where there are several vehicles; after an interrupted upload its own is known).
    #[arg(long, value_name = "ID")]
    pub vehicle: Option<u8>,
    /// Wait so long for the vehicle, at the start and after a loss of the link.
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub patience: u64,
    /// Sign with this key (32 bytes or 64 hexadecimal digits) and accept only frames signed with it.
    #[arg(long, value_name = "FILE")]
    pub signing_key: Option<PathBuf>,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
}

impl ConnectArgs {
    /// Where a session finds the vehicle.
    pub(super) fn opening(&self) -> Opening<'_> {
        Opening {
            addresses: &self.connect,
            vehicle: self.vehicle,
            patience: Duration::from_secs(self.patience),
            signing_key: self.signing_key.as_deref(),
        }
    }
}

/// Link and file.
#[derive(Debug, Clone, clap::Args)]
pub struct LinkArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Mission file, .plan or .waypoints.
    pub file: PathBuf,
}

/// Arguments of `download`.
#[derive(Debug, Clone, clap::Args)]
pub struct DownloadArgs {
    /// Link and file.
    #[command(flatten)]
    pub link: LinkArgs,
    /// Read only this (default: all of them into a .plan, the mission into a .waypoints).
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    pub list: Option<List>,
}

/// Arguments of `clear`.
#[derive(Debug, Clone, clap::Args)]
pub struct ClearArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// What to remove.
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    pub list: List,
    /// Where to keep what is on board before (default: mission-backup-TIME.plan).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// Remove it although a mission is being flown, or the vehicle is armed in its mission mode.
    #[arg(long)]
    pub even_while_flying: bool,
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
    /// What flies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it (default: the airframe that the plan was made for).
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Leave the vehicle's geofence as it is.
    #[arg(long)]
    pub no_fence: bool,
    /// Upload although the pre-flight check says stop; what that overrides is reported.
    #[arg(long)]
    pub force: bool,
    /// Replace the mission although it is being flown, or the vehicle is armed in its mission mode.
    #[arg(long)]
    pub even_while_flying: bool,
}

/// Arguments of `restore`.
#[derive(Debug, Clone, clap::Args)]
pub struct RestoreArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Backup (.plan or .waypoints) or journal of an interrupted upload (default: the journal in this folder).
    pub file: Option<PathBuf>,
    /// Where to keep what is on board before it is replaced (default: mission-backup-TIME.plan).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// Restore only this from a backup (default: the mission, and the geofence that is with it).
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    pub list: Option<List>,
    /// After an interrupted upload: bring the new mission instead of the previous one.
    #[arg(long)]
    pub new: bool,
    /// Upload although the pre-flight check says stop; what that overrides is reported. After an interrupted
    /// upload: put the mission over one that is neither the previous nor the new one.
    #[arg(long)]
    pub force: bool,
    /// Replace the mission although it is being flown, or the vehicle is armed in its mission mode.
    #[arg(long)]
    pub even_while_flying: bool,
}
