//! Starts the command that was asked for and turns its result into an exit status.

use clap::Parser;
use gaware::commands::cli::Cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    match Cli::try_parse() {
        Ok(cli) => gaware::commands::cli::execute(cli),
        Err(error) => gaware::commands::cli::refuse(error),
    }
}
