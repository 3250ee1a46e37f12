//! Lines for stderr that hold no one up.
//!
//! A thread of its own writes them. Where no one reads (a full pipe, Ctrl-S, a stalled ssh) lines are lost, and their number is
//! reported as soon as someone reads again. A closed stderr ends nothing: what is meant for it is dropped.

use std::borrow::Cow;
use std::io::{self, Write};
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::AsyncWrite;

/// Lines that may wait for a reader.
const LINES_AHEAD: usize = 512;
/// Bytes that are kept while a screen has the terminal.
const HELD_BYTES: usize = 64 * 1024;
/// How long the end of the program waits for what was written last.
const FLUSH_PATIENCE: Duration = Duration::from_millis(500);

static STDERR: OnceLock<Lines> = OnceLock::new();

enum Job {
    Text(Vec<u8>),
    /// Keep lines back until the release.
    Hold,
    Release,
    Flush(SyncSender<()>),
}

/// A queue of lines and the thread that writes them.
#[derive(Debug)]
struct Lines {
    queue: SyncSender<Job>,
    lost: Arc<AtomicU64>,
}

impl Lines {
    fn start(out: impl Write + Send + 'static) -> io::Result<Self> {
        let (queue, jobs) = sync_channel(LINES_AHEAD);
        let lost = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&lost);
        std::thread::Builder::new().name("log".to_owned()).spawn(move || write_all(&jobs, &counted, out))?;
        Ok(Self { queue, lost })
    }

    fn text(&self, bytes: &[u8]) {
        if self.queue.try_send(Job::Text(bytes.to_vec())).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits until everything is written, but not for ever.
    fn flush(&self, patience: Duration) {
        let (done, wait) = sync_channel(1);
        if self.queue.try_send(Job::Flush(done)).is_ok() {
            // No one reads: the lines are lost.
            let _ = wait.recv_timeout(patience);
        }
    }
}

fn write_all(jobs: &Receiver<Job>, lost: &AtomicU64, mut out: impl Write) {
    let mut reported = 0;
    let mut held: Option<Vec<u8>> = None;
    for job in jobs {
        match job {
            Job::Hold => held = Some(Vec::new()),
            Job::Release => _ = out.write_all(&held.take().unwrap_or_default()),
            Job::Text(bytes) => {
                if let Some(held) = &mut held {
                    if held.len() + bytes.len() <= HELD_BYTES {
                        held.extend(bytes);
                    } else {
                        lost.fetch_add(1, Ordering::Relaxed);
                    }
                    continue;
                }
                // A reader that is gone for good is no failure of the program.
                let _ = out.write_all(&bytes);
                let now = lost.load(Ordering::Relaxed);
                if now > reported {
                    let _ =
                        writeln!(out, "gaware: {} log lines were lost: stderr was not read", now - reported);
                    reported = now;
                }
            }
            Job::Flush(done) => {
                let _ = out.flush();
                let _ = done.try_send(());
            }
        }
    }
}

/// From now on lines for stderr are written by a thread of their own.
///
/// # Errors
/// When the system gives no thread.
pub fn start() -> io::Result<()> {
    if STDERR.get().is_none() {
        let lines = Lines::start(io::stderr())?;
        // Someone else may have been faster.
        let _ = STDERR.set(lines);
    }
    Ok(())
}

/// Writes one line to stderr.
pub fn line(text: &str) {
    let _ = writeln!(Stderr, "{}", plain(text));
}

/// The text without orders to the terminal: names of files, models and airframes, and texts of vehicles come from others. Control
/// characters other than the end of a line and the tabulator are written as escapes (`\u{1b}`).
pub fn plain(text: &str) -> Cow<'_, str> {
    let order = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(order) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if order(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    Cow::Owned(out)
}

/// While this lives, lines for a stderr that is a terminal are kept back: a screen is drawn there, and shows the events itself.
#[derive(Debug)]
pub struct Hold(());

impl Hold {
    /// Keeps lines back from now on; nothing where stderr is no terminal.
    pub fn of_terminal() -> Option<Self> {
        let lines = STDERR.get().filter(|_| io::IsTerminal::is_terminal(&io::stderr()))?;
        lines.queue.send(Job::Hold).ok().map(|()| Self(()))
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        // Without a thread there is nothing to release.
        let _ = STDERR.get().map(|lines| lines.queue.send(Job::Release));
    }
}

/// Waits for the lines that are under way, at most half a second.
pub fn flush() {
    if let Some(lines) = STDERR.get() {
        lines.flush(FLUSH_PATIENCE);
    }
}

/// Stderr for writers of whole lines; never fails and, once [`start`] was called, never waits.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match STDERR.get() {
            Some(lines) => lines.text(bytes),
            // No one there to read it.
            None => _ = io::stderr().write_all(bytes),
        }
        Ok(())
    }

    fn write_fmt(&mut self, text: std::fmt::Arguments<'_>) -> io::Result<()> {
        self.write_all(text.to_string().as_bytes())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl AsyncWrite for Stderr {
    fn poll_write(self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Poll::Ready(self.get_mut().write(bytes))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::channel;

    /// A reader that reads only when it is let.
    struct Stalled(Receiver<()>, Arc<Mutex<Vec<u8>>>);

    impl Write for Stalled {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            // Once the sender is gone everything is read.
            let _ = self.0.recv();
            self.1.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn lines_are_kept_back_while_a_screen_is_shown_and_written_afterwards() {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let lines = Lines::start(Stalled(channel().1, Arc::clone(&seen))).unwrap();
        let text = || String::from_utf8(seen.lock().unwrap().clone()).unwrap();
        lines.text(b"before\n");
        lines.queue.send(Job::Hold).unwrap();
        lines.text(b"meanwhile\n");
        lines.flush(FLUSH_PATIENCE);
        assert_eq!(text(), "before\n");
        lines.queue.send(Job::Release).unwrap();
        lines.text(b"after\n");
        lines.flush(FLUSH_PATIENCE);
        assert_eq!(text(), "before\nmeanwhile\nafter\n");
    }

    #[test]
    fn a_reader_that_stalls_costs_lines_and_nobody_waits() {
        let (go_on, wait) = channel();
        let seen = Arc::new(Mutex::new(Vec::new()));
        let lines = Lines::start(Stalled(wait, Arc::clone(&seen))).unwrap();
        for k in 0..LINES_AHEAD + 100 {
            lines.text(format!("line {k}\n").as_bytes());
        }
        let lost = lines.lost.load(Ordering::Relaxed);
        assert!((99..=100).contains(&lost), "{lost}");
        drop(go_on);
        while !String::from_utf8(seen.lock().unwrap().clone()).unwrap().contains("log lines were lost") {
            std::thread::yield_now();
            lines.text(b"again\n");
        }
        let text = String::from_utf8(seen.lock().unwrap().clone()).unwrap();
        assert!(text.starts_with("line 0\n"));
    }
}
