//! What `gaware mission` and `gaware params` share: a transfer that signals end in order, its lines on stderr, and its files.

use super::{CommandError, start};
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

fn watch_signals(stop: &CancellationToken, now: &CancellationToken) {
    let (stop, now) = (stop.clone(), now.clone());
    tokio::spawn(async move {
        start::any_signal().await;
        progress("stopping: what was begun is put back first; the same signal again ends at once");
        stop.cancel();
        start::any_signal().await;
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

/// Why no journal of an interrupted transfer can be taken up.
pub(super) enum NoJournal {
    /// There is none in this folder.
    None(PathBuf),
    /// There are these.
    Several(String),
}

/// The only one of the journals found in a folder.
pub(super) fn the_only(found: &[PathBuf], folder: &Path) -> Result<PathBuf, NoJournal> {
    match found {
        [one] => Ok(one.clone()),
        [] => Err(NoJournal::None(std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()))),
        many => {
            let names: Vec<String> = many.iter().map(|p| p.display().to_string()).collect();
            Err(NoJournal::Several(names.join(", ")))
        }
    }
}
