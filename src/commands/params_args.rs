//! The arguments of `gaware params`.

use super::mission_args::ConnectArgs;
use std::path::PathBuf;

/// Arguments of `gaware params`.
#[derive(Debug, Clone, clap::Args)]
pub struct ParamsArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: ParamsAction,
}

/// What can be done.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum ParamsAction {
    /// Show the parameters that correct what explain finds, with unit, range and the effect they correct.
    Show(ShowArgs),
    /// Read all parameters into a file.
    Backup(BackupArgs),
    /// Set what a file names: back up, set, read back, compare; restore on failure. Refused while armed; never reboots.
    Apply(ApplyArgs),
    /// Put a backup back, verified in the same way; without a file, take up a change that was interrupted and put the old values back.
    Restore(RestoreParamsArgs),
}

impl ParamsAction {
    /// The link.
    pub fn to(&self) -> &ConnectArgs {
        match self {
            Self::Show(args) => &args.to,
            Self::Backup(args) => &args.to,
            Self::Apply(args) => &args.to,
            Self::Restore(args) => &args.to,
        }
    }
}

/// Arguments of `show`.
#[derive(Debug, Clone, clap::Args)]
pub struct ShowArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Show every parameter of the vehicle.
    #[arg(long)]
    pub all: bool,
}

/// Arguments of `backup`.
#[derive(Debug, Clone, clap::Args)]
pub struct BackupArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// File to write, in the form of the autopilot's ground stations.
    pub file: PathBuf,
}

/// Arguments of `apply`.
#[derive(Debug, Clone, clap::Args)]
pub struct ApplyArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Parameter file: NAME,VALUE lines or QGroundControl's columns.
    pub file: PathBuf,
    /// Where to keep the old values (default: params-backup-TIME.param).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// Do not ask before the values are set: for scripts.
    #[arg(long)]
    pub yes: bool,
}

/// Arguments of `restore`.
#[derive(Debug, Clone, clap::Args)]
pub struct RestoreParamsArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Backup or journal of an interrupted change (default: the journal in this folder).
    pub file: Option<PathBuf>,
    /// Where to keep the values that are on board before they are replaced (default: params-backup-TIME.param).
    #[arg(long, value_name = "FILE")]
    pub backup: Option<PathBuf>,
    /// After an interrupted change: put the old values over values that are neither the old nor the new ones.
    #[arg(long)]
    pub force: bool,
}
