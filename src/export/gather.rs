//! The tables of a flight, written down while it is replayed.

use super::rows::{Origin, STATES};
use super::table::Table;
use crate::engine::Engine;
use crate::engine::counters::ElapsedTime;
use crate::engine::events::{Event, EventDetector, Severity, Topic};
use crate::engine::snapshot::{ParameterEstimate, Snapshot, Summary};
use crate::pipeline::{Consumer, Estimator};
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample, Sample};
use nalgebra::Vector3;

/// Spacing of the rows of states, s: that of the live screens.
const STEP_S: f64 = 0.2;

/// The tables of one or more flights, in a fixed order.
#[derive(Debug, Clone)]
pub struct Gathered {
    states: Table,
    imu: Table,
    fixes: Table,
    attitude: Table,
    events: Table,
}

impl Default for Gathered {
    fn default() -> Self {
        Self {
            states: Table::new(
                STATES,
                "The estimate five times a second: motion, attitude, biases, G, innovations, with sigmas.",
            ),
            imu: Table::new("imu", "The inertial samples that the estimator was given, in body axes."),
            fixes: Table::new(
                "fixes",
                "The GNSS fixes that the estimator was given; `t_s` is the stamp of the message.",
            ),
            attitude: Table::new("autopilot_attitude", "The autopilot's own attitude."),
            events: Table::new("events", "What changed, in words: the events of the live screens."),
        }
    }
}

impl Gathered {
    /// All tables.
    pub fn into_tables(self) -> Vec<Table> {
        vec![self.states, self.imu, self.fixes, self.attitude, self.events]
    }
}

/// An engine whose flight is written down.
#[derive(Debug)]
pub struct Gather {
    engine: Engine,
    log: String,
    time: ElapsedTime,
    next_s: f64,
    detector: EventDetector,
    tables: Gathered,
}

impl Gather {
    /// Adds the flight of this log to the tables of earlier ones.
    pub fn new(engine: Engine, log: String, tables: Gathered) -> Self {
        Self {
            engine,
            log,
            time: ElapsedTime::default(),
            next_s: 0.0,
            detector: EventDetector::default(),
            tables,
        }
    }

    /// The tables.
    pub fn into_tables(self) -> Gathered {
        self.tables
    }

    fn note(&mut self, sample: &Sample) {
        let tables = &mut self.tables;
        let log = &self.log;
        let at = |time: &ElapsedTime, t_s: f64| Origin { log, elapsed_s: time.elapsed_at(t_s), t_s };
        match sample {
            Sample::Imu(imu) if imu.t_s.is_finite() => {
                self.time.push(imu.t_s);
                let origin = at(&self.time, imu.t_s);
                tables.imu.push(&[&origin, imu]);
                if origin.elapsed_s >= self.next_s {
                    // Not one row for each sample after a gap.
                    self.next_s = (self.next_s + STEP_S).max(origin.elapsed_s + 0.5 * STEP_S);
                    let snapshot = self.engine.snapshot();
                    for event in self.detector.feed(&snapshot) {
                        tables.events.push(&[&origin, &event]);
                    }
                    tables.states.push(&[&origin, &snapshot]);
                }
            }
            Sample::Fix(fix) => tables.fixes.push(&[&at(&self.time, fix.t_s), fix]),
            Sample::Attitude(hint) => tables.attitude.push(&[&at(&self.time, hint.t_s), hint]),
            Sample::Restart(_) => self.time.restart(),
            _ => {}
        }
    }
}

impl Consumer for Gather {
    fn feed(&mut self, sample: &Sample) {
        self.engine.feed(sample);
        self.note(sample);
    }

    fn engine(&mut self) -> Option<&mut Engine> {
        Some(&mut self.engine)
    }
}

impl Estimator for Gather {
    fn snapshot(&self) -> Snapshot {
        self.engine.snapshot()
    }

    fn summary(&self) -> Summary {
        self.engine.summary()
    }
}

/// One row of each table, for the list of columns.
pub fn example() -> Vec<Table> {
    let latency = ParameterEstimate {
        effect: "gps_latency".into(),
        name: "latency".into(),
        unit: "s".into(),
        ..Default::default()
    };
    let mut snapshot = Snapshot::default();
    snapshot.estimate.effects.push(latency);
    let fix = GnssFix {
        t_s: 0.0,
        position: Geodetic { lat_rad: 0.0, lon_rad: 0.0, height_m: 0.0 },
        velocity: FixVelocity::None,
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    };
    let imu = ImuSample { t_s: 0.0, gyro: Vector3::zeros(), accel: Vector3::zeros(), temperature_degc: None };
    let hint = AttitudeHint { t_s: 0.0, roll_pitch_yaw: [0.0; 3] };
    let event = Event { elapsed_s: 0.0, severity: Severity::Info, topic: Topic::Phase, text: String::new() };
    let origin = Origin { log: "", elapsed_s: 0.0, t_s: 0.0 };
    let mut tables = Gathered::default();
    tables.states.push(&[&origin, &snapshot]);
    tables.imu.push(&[&origin, &imu]);
    tables.fixes.push(&[&origin, &fix]);
    tables.attitude.push(&[&origin, &hint]);
    tables.events.push(&[&origin, &event]);
    tables.into_tables()
}
