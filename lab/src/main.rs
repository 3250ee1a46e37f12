//! `gaware-lab`: the studies; `gaware study` starts it.

use clap::Parser;
use gaware_lab::commands::{StudyArgs, execute};
use std::process::ExitCode;

/// Claims about accuracy that anybody can repeat.
#[derive(Parser)]
#[command(name = "gaware-lab", bin_name = "gaware study", version, max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    study: StudyArgs,
}

fn main() -> ExitCode {
    match Cli::try_parse() {
        Ok(cli) => execute(&cli.study),
        Err(error) => gaware::commands::cli::refuse(error),
    }
}
