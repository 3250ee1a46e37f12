//! How a program is asked to end: Ctrl-C, a service manager, a terminal or window that goes away.

use tokio_util::sync::CancellationToken;

/// Cancels when the program is asked to end.
pub fn cancel_on_signal(stop: &CancellationToken) {
    let stop = stop.clone();
    tokio::spawn(async move {
        any_signal().await;
        stop.cancel();
    });
}

/// Ctrl-C, or what else this system asks with.
pub(super) async fn any_signal() {
    tokio::select! {
        _ = tokio::signal::ctrl_c() => {}
        () = system::asked() => {}
    }
}

/// Ends the process with a sentence when it is asked to end: for long work that writes nothing before its end.
pub(super) fn end_when_asked(left: &'static str) {
    /// Status of a program that a signal ended, as shells report SIGINT.
    const INTERRUPTED: i32 = 130;
    let wait = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        runtime.block_on(any_signal());
        crate::sinks::log::line(&format!("interrupted: {left}"));
        std::process::exit(INTERRUPTED);
    };
    // Without the thread a signal ends the process as well, without the sentence.
    let _ = std::thread::Builder::new().name("signals".into()).spawn(wait);
}

/// SIGTERM of a service manager, and SIGHUP, which a terminal or ssh session that goes away sends.
#[cfg(unix)]
mod system {
    use tokio::signal::unix::{Signal, SignalKind, signal};

    pub(super) async fn asked() {
        let terminate = signal(SignalKind::terminate()).ok();
        // The handler goes in once; after that the system says that the signal is caught.
        static IGNORED: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
        // Never where the process was started to outlive its terminal (`nohup`).
        let ignored = *IGNORED.get_or_init(hangup_is_ignored);
        let hangup = if ignored { None } else { signal(SignalKind::hangup()).ok() };
        tokio::select! {
            () = comes(terminate) => {}
            () = comes(hangup) => {}
        }
    }

    async fn comes(signal: Option<Signal>) {
        match signal {
            Some(mut signal) => _ = signal.recv().await,
            None => std::future::pending().await,
        }
    }

    /// Whether SIGHUP was ignored when the process started, as Linux reports it; elsewhere it is taken to be not.
    fn hangup_is_ignored() -> bool {
        /// Signal 1 is the lowest bit.
        const HANGUP: u64 = 1;
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok()).is_some_and(|m| m & HANGUP != 0)
    }
}

/// Ctrl-Break, a window that is closed (Windows then leaves five seconds), the end of the session.
#[cfg(windows)]
mod system {
    use tokio::signal::windows::{ctrl_break, ctrl_close, ctrl_shutdown};

    pub(super) async fn asked() {
        let (Ok(mut pause), Ok(mut close), Ok(mut shutdown)) = (ctrl_break(), ctrl_close(), ctrl_shutdown())
        else {
            return std::future::pending().await;
        };
        tokio::select! {
            _ = pause.recv() => {}
            _ = close.recv() => {}
            _ = shutdown.recv() => {}
        }
    }
}
