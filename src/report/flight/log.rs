//! What a report shows over time, written down while the flight is run through.

use crate::attitudes::Attitudes;
use crate::engine::Engine;
use crate::engine::counters::ElapsedTime;
use crate::engine::snapshot::Snapshot;
use gaware_nav::sample::Sample;

/// Spacing of what is written down, s.
pub const PERIOD_S: f64 = 0.5;
/// The autopilot reports its attitude as rarely as this, s.
const HINT_SPACING_S: f64 = 0.35;

/// The flight in steps of half a second.
#[derive(Debug, Clone)]
pub struct FlightLog {
    /// Snapshots, oldest first.
    pub snapshots: Vec<Snapshot>,
    /// Our attitude beside the autopilot's, by seconds since the first sample.
    pub attitudes: Attitudes,
    time: ElapsedTime,
    /// Time of the newest inertial sample, s since the first one.
    newest_s: f64,
}

impl Default for FlightLog {
    fn default() -> Self {
        Self {
            snapshots: Vec::new(),
            attitudes: Attitudes::with_spacing(HINT_SPACING_S),
            time: ElapsedTime::default(),
            newest_s: 0.0,
        }
    }
}

impl FlightLog {
    /// Time of the newest inertial sample, s since the first one.
    pub fn newest_s(&self) -> f64 {
        self.newest_s
    }

    /// Takes a sample that the engine has just been fed with.
    pub fn push(&mut self, sample: &Sample, engine: &mut Engine) {
        match sample {
            Sample::Imu(imu) if imu.t_s.is_finite() => {
                self.time.push(imu.t_s);
                self.newest_s = self.time.elapsed_at(imu.t_s);
                let due = self.snapshots.last().map_or(f64::NEG_INFINITY, |s| s.elapsed_s + PERIOD_S);
                if self.newest_s >= due {
                    self.snapshots.push(engine.snapshot());
                }
            }
            Sample::Attitude(hint) if hint.t_s.is_finite() => {
                self.attitudes.push_reference(self.time.elapsed_at(hint.t_s), hint.roll_pitch_yaw);
                if let Some((t_s, attitude)) = engine.attitude() {
                    self.attitudes.push_estimate(self.time.elapsed_at(t_s), attitude);
                }
            }
            Sample::Restart(_) => self.time.restart(),
            _ => {}
        }
    }
}
