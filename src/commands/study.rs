//! `gaware study`: starts the laboratory, a program of its own beside this one.
//!
//! The studies drive this program's library, so they cannot be in it; and no aircraft needs them.

use super::CommandError;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// Arguments of `study`: those of the laboratory.
#[derive(Debug, Clone, clap::Args)]
#[command(disable_help_flag = true)]
pub struct StudyArgs {
    /// Which study, with its options; `gaware study --help` lists them.
    #[arg(value_name = "STUDY", trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<OsString>,
}

/// Where the laboratory stands: beside this program.
fn laboratory() -> Result<PathBuf, CommandError> {
    let own = std::env::current_exe()?;
    Ok(own.with_file_name(format!("gaware-lab{}", std::env::consts::EXE_SUFFIX)))
}

/// Runs a study to its end; its exit status is ours.
///
/// # Errors
/// The laboratory is not there or does not start.
pub fn run(args: &StudyArgs) -> Result<ExitCode, CommandError> {
    let path = laboratory()?;
    let status = Command::new(&path).args(&args.arguments).status().map_err(|e| CommandError::Lab {
        reason: match e.kind() {
            std::io::ErrorKind::NotFound => "does not stand there".to_owned(),
            _ => format!("does not start ({e})"),
        },
        path,
    })?;
    Ok(ExitCode::from(status.code().and_then(|c| u8::try_from(c).ok()).unwrap_or(1)))
}
