//! What a report shows over time, written down while the flight is run through.

use crate::attitudes::Attitudes;
use crate::engine::Engine;
use crate::engine::snapshot::Snapshot;
use gaware_nav::sample::Sample;

/// Spacing of what is written down, s.
pub const PERIOD_S: f64 = 0.5;
/// The autopilot tells its attitude as rarely as this, s.
const HINT_SPACING_S: f64 = 0.35;

/// The flight in steps of half a second.
#[derive(Debug, Clone)]
pub struct FlightLog {
    /// Snapshots, oldest first.
    pub snapshots: Vec<Snapshot>,
    /// Our attitude beside the autopilot's, by seconds since the first sample.
    pub attitudes: Attitudes,
    clock: Clock,
}

/// Seconds since the first sample, over restarts of the autopilot's own clock.
#[derive(Debug, Clone, Copy, Default)]
struct Clock {
    earlier_s: f64,
    span: Option<(f64, f64)>,
}

impl Clock {
    /// Tells the time of a sample, s.
    fn push(&mut self, t_s: f64) {
        let (first, last) = *self.span.get_or_insert((t_s, t_s));
        self.span = Some((first, last.max(t_s)));
    }

    fn restart(&mut self) {
        self.earlier_s = self.at(self.span.map_or(0.0, |(_, last)| last));
        self.span = None;
    }

    fn at(&self, t_s: f64) -> f64 {
        self.earlier_s + self.span.map_or(0.0, |(first, _)| t_s - first)
    }
}

impl Default for FlightLog {
    fn default() -> Self {
        Self {
            snapshots: Vec::new(),
            attitudes: Attitudes::with_spacing(HINT_SPACING_S),
            clock: Clock::default(),
        }
    }
}

impl FlightLog {
    /// Takes a sample that the engine has just been fed with.
    pub fn push(&mut self, sample: &Sample, engine: &Engine) {
        match sample {
            Sample::Imu(imu) if imu.t_s.is_finite() => {
                self.clock.push(imu.t_s);
                let due = self.snapshots.last().map_or(f64::NEG_INFINITY, |s| s.elapsed_s + PERIOD_S);
                if self.clock.at(imu.t_s) >= due {
                    self.snapshots.push(engine.snapshot());
                }
            }
            Sample::Attitude(hint) if hint.t_s.is_finite() => {
                self.attitudes.push_reference(self.clock.at(hint.t_s), hint.roll_pitch_yaw);
                if let Some((t_s, attitude)) = engine.attitude() {
                    self.attitudes.push_estimate(self.clock.at(t_s), attitude);
                }
            }
            Sample::Restart(_) => self.clock.restart(),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_on_over_a_reboot() {
        let mut clock = Clock::default();
        [100.0, 110.0].into_iter().for_each(|t| clock.push(t));
        clock.restart();
        assert_eq!(clock.at(3.0), 10.0);
        clock.push(3.0);
        assert_eq!(clock.at(5.0), 12.0);
    }
}
