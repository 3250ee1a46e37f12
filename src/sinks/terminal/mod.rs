//! The terminal screen and its headless alternative.
//!
//! [`draw::draw`] is pure: a view in, cells out. The loop around it has a thread of its own, because a slow serial
//! console blocks whoever writes to it; it redraws a few times a second at most, and only what has changed.

pub mod draw;
pub mod headless;
mod parts;

use super::events::{Event, EventDetector};
use super::log;
use super::status::{SinkStatus, StatusView};
use super::{Change, Request};
use crate::engine::snapshot::Snapshot;
use draw::{Over, View};
use ratatui::Terminal;
use ratatui::backend::Backend;
use ratatui::crossterm::event::{self, Event as Input, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot, watch};
use tokio_util::sync::CancellationToken;

/// Events kept for the list.
const EVENTS: usize = 50;

/// Messages scroll no further, lines.
const MOST_SCROLL: u16 = 400;

/// Between two frames.
const REDRAW: Duration = Duration::from_millis(250);
/// Between two frames on a serial console.
const SERIAL_REDRAW: Duration = Duration::from_secs(1);

/// Why there is no screen.
#[derive(Debug, thiserror::Error)]
pub enum TerminalError {
    /// The output is no terminal.
    #[error("standard output is not a terminal: use --headless")]
    NotATerminal,
    /// The terminal failed.
    #[error("the terminal failed: {0}; use --headless")]
    Io(#[from] io::Error),
}

/// How the screen looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Colours; without them bold and reverse carry what matters.
    pub color: bool,
    /// ASCII only, for consoles without UTF-8.
    pub ascii: bool,
    /// Between two redraws at least.
    pub redraw: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self { color: true, ascii: false, redraw: REDRAW }
    }
}

impl Options {
    /// From `NO_COLOR`, `TERM`, `LC_ALL`, `LC_CTYPE` and `LANG`, looked up by `get` (usually
    /// `|name| std::env::var(name).ok()`).
    pub fn from_env(get: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name| get(name).filter(|v| !v.is_empty());
        let term = set("TERM").unwrap_or_default();
        let dumb = term == "dumb";
        // What a getty on a serial port calls itself; at 9600 baud four frames a second would be too many.
        let serial = dumb || term.starts_with("vt");
        let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set).unwrap_or_default();
        let locale = locale.to_ascii_lowercase();
        Self {
            color: set("NO_COLOR").is_none() && !dumb,
            ascii: dumb || !(locale.contains("utf-8") || locale.contains("utf8")),
            redraw: if serial { SERIAL_REDRAW } else { REDRAW },
        }
    }
}

/// What the person at the keyboard wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// `q`, Ctrl-C.
    Quit,
    /// `?`, `h`: show or hide the help.
    Help,
    /// Escape, `n`: hide what lies over the screen; the answer no.
    Back,
    /// `u`: ask for the upload of the planned mission; `p`: for the parameters of the file.
    Ask(Change),
    /// `y`: the answer yes.
    Yes,
    /// Up, Down, and by pages: scroll the messages by so many lines.
    Scroll(i16),
    /// The window has another size.
    Resized,
}

/// Where keys come from.
pub trait Keys {
    /// The next key, or `None` when none came within `wait`.
    ///
    /// # Errors
    /// When the input failed; the screen then ends.
    fn next(&mut self, wait: Duration) -> io::Result<Option<Key>>;
}

/// Keys of the real terminal.
struct Keyboard;

impl Keys for Keyboard {
    fn next(&mut self, wait: Duration) -> io::Result<Option<Key>> {
        if !event::poll(wait)? {
            return Ok(None);
        }
        Ok(match event::read()? {
            Input::Key(key) if key.kind != KeyEventKind::Release => meaning(key),
            Input::Resize(..) => Some(Key::Resized),
            _ => None,
        })
    }
}

fn meaning(key: KeyEvent) -> Option<Key> {
    match key.code {
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::Quit),
        KeyCode::Char('q' | 'Q') => Some(Key::Quit),
        KeyCode::Char('?' | 'h') => Some(Key::Help),
        KeyCode::Esc | KeyCode::Char('n' | 'N') => Some(Key::Back),
        KeyCode::Char('u' | 'U') => Some(Key::Ask(Change::Mission)),
        KeyCode::Char('p' | 'P') => Some(Key::Ask(Change::Parameters)),
        KeyCode::Char('y' | 'Y') => Some(Key::Yes),
        KeyCode::Up => Some(Key::Scroll(-1)),
        KeyCode::Down => Some(Key::Scroll(1)),
        KeyCode::PageUp => Some(Key::Scroll(-5)),
        KeyCode::PageDown => Some(Key::Scroll(5)),
        _ => None,
    }
}

/// What the screen shows.
#[derive(Debug, Clone)]
pub struct Sources {
    /// The engine's snapshots.
    pub snapshots: watch::Receiver<Arc<Snapshot>>,
    /// What the tasks around it say.
    pub status: Arc<SinkStatus>,
    /// The task that carries out what is asked for and confirmed, where there is one.
    pub requests: Option<mpsc::Sender<Request>>,
}

/// Opens the screen on a thread of its own. The receiver yields how it ended; a quit cancels `shutdown`.
///
/// # Errors
/// [`TerminalError::NotATerminal`] where standard output is none, [`TerminalError::Io`] where it cannot be set up.
pub fn spawn(
    sources: Sources,
    options: Options,
    shutdown: CancellationToken,
) -> Result<oneshot::Receiver<Result<(), TerminalError>>, TerminalError> {
    if !io::stdout().is_terminal() {
        return Err(TerminalError::NotATerminal);
    }
    let mut terminal = ratatui::try_init()?;
    let hold = log::Hold::of_terminal();
    let (done, ended) = oneshot::channel();
    std::thread::Builder::new().name("terminal".into()).spawn(move || {
        let result = run(&mut terminal, &mut Keyboard, sources, options, &shutdown);
        ratatui::restore();
        drop(hold);
        // No one may be waiting any more, then no one wants to know.
        let _ = done.send(result);
    })?;
    Ok(ended)
}

/// The loop: draws until a quit (which cancels `shutdown`) or until `shutdown`.
///
/// # Errors
/// When drawing or the input fails.
pub fn run<B: Backend>(
    terminal: &mut Terminal<B>,
    keys: &mut impl Keys,
    mut sources: Sources,
    options: Options,
    shutdown: &CancellationToken,
) -> Result<(), TerminalError>
where
    B::Error: Send + Sync + 'static,
{
    let mut detector = EventDetector::default();
    let mut events: Vec<Event> = Vec::new();
    let mut over = Over::Nothing;
    let mut scroll = 0_u16;
    let counters = sources.status.sink("terminal");
    sources.snapshots.mark_changed();
    let mut last_sequence = None;
    while !shutdown.is_cancelled() {
        let started = Instant::now();
        let snapshot = Arc::clone(&sources.snapshots.borrow_and_update());
        if last_sequence != Some(snapshot.sequence) {
            counters.delivered(1);
            last_sequence = Some(snapshot.sequence);
        }
        events.extend(detector.feed(&snapshot));
        events.drain(..events.len().saturating_sub(EVENTS));
        let sinks = sources.status.view();
        let view = View { snapshot: &snapshot, sinks: &sinks, events: &events, options, over, scroll };
        terminal
            .draw(|frame| draw::draw(frame, &view))
            .map_err(|e| TerminalError::Io(io::Error::other(e)))?;
        // Keys are answered at once; snapshots wait for the next turn.
        loop {
            let left = options.redraw.saturating_sub(started.elapsed());
            match keys.next(left)? {
                Some(Key::Quit) => {
                    shutdown.cancel();
                    return Ok(());
                }
                Some(Key::Help) => over = if over == Over::Help { Over::Nothing } else { Over::Help },
                Some(Key::Back) => over = Over::Nothing,
                Some(Key::Ask(change)) if sources.requests.is_some() && can_be_asked(&sinks, change) => {
                    over = Over::Question(change);
                }
                Some(Key::Yes) => {
                    if let Over::Question(change) = over {
                        over = Over::Nothing;
                        ask_for(change, &sources);
                    }
                }
                // No flight has so many messages: the screen itself stops at the last.
                Some(Key::Scroll(by)) => scroll = scroll.saturating_add_signed(by).min(MOST_SCROLL),
                Some(Key::Ask(_) | Key::Resized) => {}
                None if started.elapsed() < options.redraw && !shutdown.is_cancelled() => continue,
                None => {}
            }
            break;
        }
    }
    Ok(())
}

fn can_be_asked(sinks: &StatusView, change: Change) -> bool {
    match change {
        Change::Mission => sinks.mission.state.can_be_asked_for(),
        Change::Parameters => sinks.parameters.state.can_be_asked_for(),
    }
}

/// Asks for the change; how it goes is in the status.
fn ask_for(change: Change, sources: &Sources) {
    let (reply, _) = oneshot::channel();
    // A queue that is full holds the same wish already.
    let _ = sources.requests.as_ref().map(|r| r.try_send(Request { change, reply }));
}

#[cfg(test)]
mod tests;
