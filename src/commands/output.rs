//! The result of a command on stdout. A full disk is an error like any other there, and a reader who has seen enough
//! (`gaware replay … | head -1`) is none; `println!` would panic at both.

use super::CommandError;
use crate::sinks::log;
use serde::Serialize;
use std::io::{self, Write};

/// Writes a text to its end, without orders to the terminal that names of others may hold.
///
/// # Errors
/// What the system says.
pub fn text(text: &str) -> Result<(), CommandError> {
    write(|out| out.write_all(log::plain(text).as_bytes()))
}

/// Writes what this makes.
///
/// # Errors
/// What the system says.
pub fn words(make: impl FnOnce(&mut String) -> std::fmt::Result) -> Result<(), CommandError> {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = make(&mut out);
    text(&out)
}

/// Writes one document in one line.
///
/// # Errors
/// What the system says.
pub fn json(document: &impl Serialize) -> Result<(), CommandError> {
    write(|out| {
        serde_json::to_writer(&mut *out, document)?;
        writeln!(out)
    })
}

/// Writes one document for people and machines.
///
/// # Errors
/// What the system says.
pub fn json_pretty(document: &impl Serialize) -> Result<(), CommandError> {
    write(|out| {
        serde_json::to_writer_pretty(&mut *out, document)?;
        writeln!(out)
    })
}

fn write(
    job: impl FnOnce(&mut io::BufWriter<io::StdoutLock<'static>>) -> io::Result<()>,
) -> Result<(), CommandError> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    // At the end of the process no one would learn of what could not be flushed.
    job(&mut out).and_then(|()| out.flush()).map_err(CommandError::Output)
}
