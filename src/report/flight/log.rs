//! What a report shows over time, written down while the flight is run through.

use super::attitude::SETTLED_DEG;
use super::motion::{AUTOPILOT, Motion, OURS};
use crate::attitudes::Attitudes;
use crate::engine::Engine;
use crate::engine::counters::ElapsedTime;
use crate::engine::snapshot::{Snapshot, Summary};
use crate::logs::filter::{Channel, Origin};
use crate::pipeline::{Consumer, Estimator};
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
    /// Every attitude of the log against the motion.
    pub(super) motion: Motion,
    /// What the autopilot's own filter reports: s since the first sample, channel, value.
    pub filter_reports: Vec<(f64, Channel, f64)>,
    /// Where these come from; `None` where there are none.
    pub filter_origin: Option<Origin>,
    time: ElapsedTime,
    /// Time of the newest inertial sample, s since the first one.
    newest_s: f64,
}

impl Default for FlightLog {
    fn default() -> Self {
        Self {
            snapshots: Vec::new(),
            attitudes: Attitudes::with_spacing(HINT_SPACING_S),
            motion: Motion::default(),
            filter_reports: Vec::new(),
            filter_origin: None,
            time: ElapsedTime::default(),
            newest_s: 0.0,
        }
    }
}

impl FlightLog {
    /// Takes what the autopilot's filter reports. Its own log has more than its messages; where both are in one file, the log counts.
    fn filter_report(&mut self, origin: Origin, values: &[(Channel, f64)]) {
        match (self.filter_origin, origin) {
            (Some(Origin::Log), Origin::Link) => return,
            (Some(Origin::Link), Origin::Log) => self.filter_reports.clear(),
            _ => {}
        }
        self.filter_origin = Some(origin);
        let t_s = self.newest_s;
        self.filter_reports.extend(values.iter().map(|(channel, value)| (t_s, *channel, *value)));
    }

    /// Takes an attitude that stands beside the one that flies.
    fn attitude_report(&mut self, name: &str, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        self.motion.push_attitude(name, self.time.elapsed_at(t_s), roll_pitch_yaw);
    }

    /// Takes a sample that the engine has just been fed with.
    pub fn push(&mut self, sample: &Sample, engine: &mut Engine) {
        match sample {
            Sample::Imu(imu) if imu.t_s.is_finite() => {
                self.time.push(imu.t_s);
                self.newest_s = self.time.elapsed_at(imu.t_s);
                self.motion.push_force(&imu.accel);
                let due = self.snapshots.last().map_or(f64::NEG_INFINITY, |s| s.elapsed_s + PERIOD_S);
                if self.newest_s >= due {
                    self.snapshots.push(engine.snapshot());
                }
            }
            Sample::Attitude(hint) if hint.t_s.is_finite() => {
                let hint_s = self.time.elapsed_at(hint.t_s);
                self.attitudes.push_reference(hint_s, hint.roll_pitch_yaw);
                self.motion.push_attitude(AUTOPILOT, hint_s, hint.roll_pitch_yaw);
                if let Some((t_s, attitude)) = engine.attitude() {
                    self.attitudes.push_estimate(self.time.elapsed_at(t_s), attitude);
                    if settled(engine) {
                        self.motion.push_attitude(OURS, self.time.elapsed_at(t_s), attitude);
                    }
                }
            }
            Sample::Fix(fix) if fix.t_s.is_finite() => {
                let delay_s = engine.filter().map_or(0.0, |f| f.fix_delay_s(fix.t_s));
                self.motion.push_fix(self.time.elapsed_at(fix.t_s) - delay_s, &fix.velocity);
            }
            Sample::Restart(_) => {
                self.time.restart();
                self.motion.restart();
            }
            _ => {}
        }
    }
}

/// Whether the yaw of the estimate is known well enough to be compared.
fn settled(engine: &Engine) -> bool {
    engine.filter().is_some_and(|f| f.heading_sigma().to_degrees() < SETTLED_DEG)
}

/// An engine whose flight is written down.
#[derive(Debug, Clone)]
pub struct Logged {
    engine: Engine,
    log: FlightLog,
}

impl Logged {
    /// Around an engine that has seen nothing.
    pub fn new(engine: Engine) -> Self {
        Self { engine, log: FlightLog::default() }
    }

    /// The flight so far.
    pub fn log(&self) -> &FlightLog {
        &self.log
    }
}

impl Consumer for Logged {
    fn feed(&mut self, sample: &Sample) {
        self.engine.feed(sample);
        self.log.push(sample, &mut self.engine);
    }

    fn engine(&mut self) -> Option<&mut Engine> {
        Some(&mut self.engine)
    }

    fn filter_report(&mut self, origin: Origin, values: &[(Channel, f64)]) {
        self.log.filter_report(origin, values);
    }

    fn attitude_report(&mut self, name: &str, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        self.log.attitude_report(name, t_s, roll_pitch_yaw);
    }
}

impl Estimator for Logged {
    fn snapshot(&self) -> Snapshot {
        self.engine.snapshot()
    }

    fn summary(&self) -> Summary {
        self.engine.summary()
    }
}
