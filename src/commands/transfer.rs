//! What `gaware mission` and `gaware params` share: a transfer that signals end in order, its lines on stderr, and its files.

use super::{CommandError, output, signals, start};
use crate::mission_link::files;
use crate::mission_link::journal::{JournalError, Kind};
use serde::Serialize;
use std::fmt::Display;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tokio_util::sync::CancellationToken;

/// Runs a transfer. The first signal asks it for an orderly end, which puts back what was there before; the second ends at once, and
/// then there is no result.
///
/// # Errors
/// When the system gives no threads.
pub(super) fn run<F: Future>(
    work: impl FnOnce(CancellationToken) -> F,
) -> Result<Option<F::Output>, CommandError> {
    let runtime = start::runtime()?;
    let result = runtime.block_on(async {
        let (stop, now) = (CancellationToken::new(), CancellationToken::new());
        watch_signals(&stop, &now);
        tokio::select! {
            result = work(stop) => Some(result),
            () = now.cancelled() => None,
        }
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    Ok(result)
}

/// Prints how it ended: the sentence, or the document, also where `not_verified` finds it in the error.
pub(super) fn show<R: Serialize + Display, E>(
    result: Result<R, E>,
    json: bool,
    not_verified: impl Fn(&E) -> Option<&R>,
) -> Result<(), CommandError>
where
    CommandError: From<E>,
{
    match &result {
        Ok(result) if json => output::json(result)?,
        Ok(result) => output::text(&format!("{result}\n"))?,
        Err(error) => match not_verified(error) {
            Some(result) if json => output::json(result)?,
            _ => {}
        },
    }
    Ok(result.map(drop)?)
}

fn watch_signals(stop: &CancellationToken, now: &CancellationToken) {
    let (stop, now) = (stop.clone(), now.clone());
    tokio::spawn(async move {
        signals::any_signal().await;
        progress("stopping: what was begun is put back first; the same signal again ends at once");
        stop.cancel();
        signals::any_signal().await;
        now.cancel();
    });
}

/// Asks for a yes on the terminal; `None` where there is none to ask on.
pub(super) async fn confirmed(question: &str, stop: &CancellationToken) -> Option<bool> {
    if !std::io::stdin().is_terminal() {
        return None;
    }
    progress(question);
    let (answer, answered) = tokio::sync::oneshot::channel();
    // A thread of its own: nothing waits for it where a signal comes instead of an answer.
    std::thread::spawn(move || {
        let mut line = String::new();
        let read = std::io::stdin().read_line(&mut line).is_ok();
        let yes = matches!(line.trim().to_ascii_lowercase().as_str(), "y" | "yes");
        let _ = answer.send(read && yes);
    });
    tokio::select! {
        answer = answered => Some(answer.unwrap_or(false)),
        () = stop.cancelled() => Some(false),
    }
}

/// A line on stderr. Where the terminal has gone away there is no one to read it, and the transfer goes on.
pub(super) fn progress(text: &str) {
    crate::sinks::log::line(text);
}

/// Name of a new backup: `prefix`, the time, `extension`.
pub(super) fn default_backup(prefix: &str, extension: &str) -> PathBuf {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    PathBuf::from(format!("{prefix}-{}.{extension}", since.as_millis()))
}

/// The file that is to be restored: the one that the user names, or the only journal in this folder.
pub(super) fn to_restore(kind: Kind, named: Option<&PathBuf>) -> Result<PathBuf, JournalError> {
    match named {
        Some(file) if kind.other().names(file) => {
            Err(JournalError::OtherKind { path: file.clone(), kind: kind.other() })
        }
        Some(file) => Ok(file.clone()),
        None => kind.the_only(Path::new(".")),
    }
}

/// Where what is on board is kept while a journal is taken up: beside it, where the user names nothing else.
pub(super) fn beside(journal: &Path, named: Option<&PathBuf>, (prefix, extension): (&str, &str)) -> PathBuf {
    named.cloned().unwrap_or_else(|| files::folder_of(journal).join(default_backup(prefix, extension)))
}
