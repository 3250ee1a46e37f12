//! For services: one plain line every few seconds instead of a screen.

use super::Sources;
use crate::engine::situation::{Control, SituationKind};
use crate::engine::snapshot::{Phase, Snapshot, Status};
use crate::sinks::events::phase_words;
use crate::sinks::log::plain;
use crate::sinks::status::{RecorderState, StatusView};
use crate::sinks::words::{brief, bytes, clock};
use std::fmt::Write;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncWrite, AsyncWriteExt};
use tokio_util::sync::CancellationToken;

/// Between two lines, by default.
pub const PERIOD: Duration = Duration::from_secs(5);

/// The line.
pub fn line(s: &Snapshot, sinks: &StatusView) -> String {
    let mut out = format!("{} {}", clock(s.elapsed_s), phase_words(s.phase).to_lowercase());
    // Writing to a String cannot fail.
    if s.phase != Phase::Running && !s.waiting_for.is_empty() {
        let _ = write!(out, " ({})", s.waiting_for);
    }
    if s.situation.kind != SituationKind::Starting {
        let _ = write!(out, "; {}", situation(s));
    }
    let _ = write!(out, "; link {}", sinks.link.state.word());
    let _ = write!(out, "; imu {:.0} Hz; fixes {:.1} Hz", s.imu.rate_hz, s.gnss.rate_hz);
    if s.phase == Phase::Running {
        let states = &s.observability.states;
        let converged = states.iter().filter(|x| x.status == Status::Observable).count();
        let _ = write!(out, "; nis {}", brief(s.consistency.nis_mean_per_dof));
        let _ = write!(out, "; {converged} of {} parameters converged", states.len());
    }
    match sinks.recorder.state {
        RecorderState::Off => {}
        RecorderState::Recording => {
            let _ = write!(out, "; rec {}", bytes(sinks.recorder.bytes));
        }
        RecorderState::Failed => {
            let _ = write!(out, "; RECORDER FAILED: {}", sinks.recorder.detail);
        }
    }
    if sinks.dropped() > 0 {
        let _ = write!(out, "; {} skipped", sinks.dropped());
    }
    if let Some(warning) = s.warnings.last() {
        let _ = write!(out, "; warning: {warning}");
    }
    out
}

/// What may be said now, and who flies.
fn situation(s: &Snapshot) -> String {
    let now = &s.situation;
    let mut out = format!("{}: {}", now.headline.to_lowercase(), now.text);
    if now.kind == SituationKind::Maneuver {
        let _ = write!(out, " {:.0}%", s.guidance.progress * 100.0);
    }
    let who = match now.control {
        Control::Unknown => return out,
        Control::Ground => "on the ground",
        Control::Pilot => "pilot flies",
        Control::Autopilot => "autopilot flies",
    };
    let said = now.headline.to_lowercase() == who;
    match (said, now.mode.as_str()) {
        (true, "") => {}
        (true, mode) => _ = write!(out, " ({mode})"),
        (false, "") => _ = write!(out, "; {who}"),
        (false, mode) => _ = write!(out, "; {who} ({mode})"),
    }
    out
}

/// Writes a line every `period` until `shutdown`.
///
/// # Errors
/// When the output fails, for example because its reader is gone.
pub async fn run(
    sources: Sources,
    period: Duration,
    mut out: impl AsyncWrite + Unpin,
    shutdown: CancellationToken,
) -> io::Result<()> {
    let mut ticks = tokio::time::interval(period);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            () = shutdown.cancelled() => return Ok(()),
            _ = ticks.tick() => {}
        }
        let snapshot = Arc::clone(&sources.snapshots.borrow());
        let text = plain(&line(&snapshot, &sources.status.view())).into_owned() + "\n";
        tokio::select! {
            () = shutdown.cancelled() => return Ok(()),
            written = async { out.write_all(text.as_bytes()).await?; out.flush().await } => written?,
        }
    }
}
