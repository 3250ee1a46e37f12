//! For services: one plain line every few seconds instead of a screen.

use super::Sources;
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
    let _ = write!(out, "; link {}", sinks.link.state.word());
    let _ = write!(out, "; imu {:.0} Hz; fixes {:.1} Hz", s.imu.rate_hz, s.gnss.rate_hz);
    if s.phase == Phase::Running {
        let states = &s.observability.states;
        let converged = states.iter().filter(|x| x.status == Status::Observable).count();
        let _ = write!(out, "; nis {}", brief(s.consistency.nis_mean_per_dof));
        let _ = write!(out, "; {converged} of {} parameters converged", states.len());
        if s.mission.flying {
            let _ = write!(out, "; autopilot flies item {}", s.mission.item);
        } else if s.guidance.done {
            out.push_str("; done: land");
        } else if !s.guidance.instruction.is_empty() {
            let _ = write!(out, "; fly: {} {:.0}%", s.guidance.instruction, s.guidance.progress * 100.0);
        }
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
