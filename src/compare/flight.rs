//! One flight for the comparison: what the autopilot's filter reports over time, what the vehicle did meanwhile, and its attitude less ours.

use super::{AttitudeAngle, Quantity};
use crate::engine::Engine;
use crate::engine::snapshot::{Phase, Snapshot};
use crate::inputs::Input;
use crate::logs::LogError;
use crate::logs::filter::Origin;
use crate::pipeline::{Pipeline, Recorded};
use crate::report::flight::{FlightLog, Logged, attitude_differences};
use crate::sensors::ConverterOptions;
use gaware_nav::math::hypot;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;

/// A vehicle flies that is faster than this over the ground, m/s, or higher than this above its start, m.
const FLYING_M_PER_S: f64 = 3.0;
const FLYING_M: f64 = 3.0;
/// A turn has at least this bank, level flight less than the second one, deg.
const TURN_DEG: f64 = 20.0;
const LEVEL_DEG: f64 = 8.0;
/// Load beside 1 g that is a pull-up or a push-over, with the wings level, g.
const PULL_G: f64 = 0.25;
/// Change of speed over the ground that is a speed change, m/s².
const SPEED_CHANGE_M_PER_S2: f64 = 0.7;
/// Differences of attitude closer together than this are not kept: they are correlated over seconds, s.
const ATTITUDE_PERIOD_S: f64 = 0.2;

/// What the vehicle does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Regime {
    /// All regimes that both flights have, each with the same weight in both.
    All,
    /// Wings level (bank below 8°), steady.
    Level,
    /// Bank beyond 20°.
    Turns,
    /// Pull-ups and push-overs with the wings level: load more than 0.25 g beside 1 g.
    PullUps,
    /// Wings level, change of speed beyond 0.7 m/s².
    SpeedChanges,
    /// In flight, none of these.
    Other,
}

impl Regime {
    /// All but the sum.
    pub const EACH: [Self; 5] = [Self::Level, Self::Turns, Self::PullUps, Self::SpeedChanges, Self::Other];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::All => "all, same mix",
            Self::Level => "level",
            Self::Turns => "turns",
            Self::PullUps => "pull-ups",
            Self::SpeedChanges => "speed changes",
            Self::Other => "other",
        }
    }

    /// From bank (deg), load (g) and change of speed (m/s²).
    fn of(bank_deg: f64, load_g: f64, speed_change_m_per_s2: f64) -> Self {
        if bank_deg > TURN_DEG {
            Self::Turns
        } else if (load_g - 1.0).abs() > PULL_G {
            Self::PullUps
        } else if speed_change_m_per_s2.abs() > SPEED_CHANGE_M_PER_S2 {
            Self::SpeedChanges
        } else if bank_deg < LEVEL_DEG {
            Self::Level
        } else {
            Self::Other
        }
    }
}

/// A value with what the vehicle did at that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Since the first sample, s.
    pub t_s: f64,
    /// Value, in the unit of its quantity.
    pub value: f64,
    /// What the vehicle did; `None` where it did not fly.
    pub regime: Option<Regime>,
}

/// What the comparison uses of a flight.
#[derive(Debug, Clone, Default)]
pub struct FilterFlight {
    /// Autopilot, as the log names it.
    pub autopilot: &'static str,
    /// Where the values come from; `None` where there are none.
    pub origin: Option<Origin>,
    /// Values over time.
    pub series: BTreeMap<Quantity, Vec<Point>>,
}

impl FilterFlight {
    /// From a flight that was written down.
    pub fn of(log: &FlightLog, autopilot: &'static str) -> Self {
        let regimes = Regimes::new(&log.snapshots);
        let mut series: BTreeMap<Quantity, Vec<Point>> = BTreeMap::new();
        let mut push = |quantity: Quantity, t_s: f64, value: f64| {
            series.entry(quantity).or_default().push(Point { t_s, value, regime: regimes.at(t_s) });
        };
        for (t_s, channel, value) in &log.filter_reports {
            push(Quantity::Channel(*channel), *t_s, *value);
        }
        let mut kept_s = f64::NEG_INFINITY;
        for (t_s, [roll, pitch, yaw]) in attitude_differences(log) {
            if t_s - kept_s < ATTITUDE_PERIOD_S {
                continue;
            }
            kept_s = t_s;
            push(Quantity::Attitude(AttitudeAngle::AttitudeRoll), t_s, roll);
            push(Quantity::Attitude(AttitudeAngle::AttitudePitch), t_s, pitch);
            push(Quantity::Attitude(AttitudeAngle::AttitudeYaw), t_s, yaw);
        }
        Self { autopilot, origin: log.filter_origin, series }
    }

    /// Reads a log of any format through the engine.
    ///
    /// # Errors
    /// A log that cannot be opened or read.
    pub fn read(
        log: impl Into<Input>,
        options: ConverterOptions,
        engine: Engine,
        progress: &dyn Fn(u64, u64),
    ) -> Result<Self, LogError> {
        let recorded = Recorded::open(log, options)?;
        let total = recorded.total_bytes();
        let (pipeline, _): (Pipeline<Logged>, _) =
            recorded.run(Logged::new(engine), f64::INFINITY, &|done| progress(done, total))?;
        Ok(Self::of(pipeline.engine().log(), pipeline.autopilot()))
    }
}

/// What the vehicle did, in steps of the snapshots; `None`: it did not fly.
struct Regimes(Vec<(f64, Option<Regime>)>);

impl Regimes {
    fn new(snapshots: &[Snapshot]) -> Self {
        let running: Vec<&Snapshot> = snapshots.iter().filter(|s| s.phase == Phase::Running).collect();
        let ground_m = running.first().map_or(0.0, |s| s.motion.height_m);
        let speed = |s: &Snapshot| {
            let [n, e, _] = s.motion.velocity_ned_m_per_s;
            hypot(n, e)
        };
        let at = |(k, s): (usize, &&Snapshot)| {
            let before = k.checked_sub(1).and_then(|k| running.get(k)).unwrap_or(s);
            let after = running.get(k + 1).unwrap_or(s);
            let dt_s = (after.elapsed_s - before.elapsed_s).max(1e-3);
            let flying = speed(s) > FLYING_M_PER_S || s.motion.height_m - ground_m > FLYING_M;
            let regime = Regime::of(
                s.estimate.attitude_deg.value[0].abs(),
                -s.motion.specific_force_g[2],
                (speed(after) - speed(before)) / dt_s,
            );
            (s.elapsed_s, flying.then_some(regime))
        };
        Self(running.iter().enumerate().map(at).collect())
    }

    fn at(&self, t_s: f64) -> Option<Regime> {
        let next = self.0.partition_point(|(t, _)| *t <= t_s);
        next.checked_sub(1).and_then(|k| self.0.get(k)).and_then(|(_, regime)| *regime)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_regime_is_what_dominates() {
        assert_eq!(Regime::of(45.0, 1.41, 0.0), Regime::Turns);
        assert_eq!(Regime::of(3.0, 1.8, 1.0), Regime::PullUps);
        assert_eq!(Regime::of(3.0, 1.0, -1.5), Regime::SpeedChanges);
        assert_eq!(Regime::of(3.0, 1.05, 0.1), Regime::Level);
        assert_eq!(Regime::of(12.0, 1.02, 0.1), Regime::Other);
    }
}
