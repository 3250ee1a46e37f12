//! The second view: how much each state's sigma has shrunk, against its start and against a target.
//!
//! A ratio alone is no proof: a state whose sigma shrank to a tenth may still be too uncertain to use, and one that
//! was known well before the flight meets a target without having been observed. So both count.

use crate::effects::{Unit, unit};
use crate::filter::layout::StateName;

/// Sigma above this share of the start: the flight gave next to no information.
const UNLEARNED: f64 = 0.9;
/// Sigma above this share: it gives some information.
const WEAK: f64 = 0.5;
/// Target of a state without one of its own, and ceiling of every target, as a share of the start.
const SHARE_OF_START: f64 = 0.5;

/// Sigmas below which states count as observable, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Targets {
    /// Element of G, rad/s per m/s².
    pub g: f64,
    /// Gyro bias, rad/s.
    pub gyro_bias: f64,
    /// Accelerometer bias, m/s².
    pub accel_bias: f64,
}

impl Default for Targets {
    /// 40 deg/h/g, 100 deg/h, 5 mg: a bias that moves by tens of deg/h from one start to the next need not be known better, and
    /// a plan that wants it has no time left for G.
    fn default() -> Self {
        Self {
            g: 40.0 * unit::DEG_PER_H_PER_G.si,
            gyro_bias: 100.0 * unit::DEG_PER_H.si,
            accel_bias: 5.0 * unit::MG.si,
        }
    }
}

impl Targets {
    /// The target of a state that started with `start`, SI: never more than half of that, so that a state which was
    /// known beforehand is not called observed.
    pub fn of(&self, state: &StateName, start: f64) -> f64 {
        let wanted = match state.effect {
            "gyro_g_sensitivity" => self.g,
            "gyro_bias" => self.gyro_bias,
            "accel_bias" => self.accel_bias,
            _ => f64::INFINITY,
        };
        wanted.min(SHARE_OF_START * start)
    }
}

/// How well a state is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Knowledge {
    /// Sigma as at the start.
    Unobservable,
    /// Sigma has begun to shrink.
    Weak,
    /// Sigma is less than half of the start.
    Converging,
    /// Sigma has reached the target.
    Observable,
}

/// One state in this view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateKnowledge {
    /// Name.
    pub name: &'static str,
    /// Unit of screens.
    pub unit: Unit,
    /// Verdict.
    pub knowledge: Knowledge,
    /// Sigma now over sigma at the start.
    pub ratio: f64,
    /// Sigma now, SI.
    pub sigma: f64,
    /// Target, SI.
    pub target: f64,
}

/// Judges a state by its sigma now and at the start, SI.
pub fn judge(state: &StateName, sigma: f64, start: f64, targets: &Targets) -> StateKnowledge {
    let target = targets.of(state, start);
    let ratio = if start > 0.0 { sigma / start } else { 1.0 };
    let knowledge = if sigma <= target {
        Knowledge::Observable
    } else if ratio > UNLEARNED {
        Knowledge::Unobservable
    } else if ratio > WEAK {
        Knowledge::Weak
    } else {
        Knowledge::Converging
    };
    StateKnowledge { name: state.name, unit: state.unit, knowledge, ratio, sigma, target }
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: StateName = StateName {
        effect: "gyro_g_sensitivity",
        name: "g11",
        unit: unit::DEG_PER_H_PER_G,
        is_tolerance: false,
    };

    fn verdict(sigma: f64, start: f64) -> Knowledge {
        judge(&G, sigma * G.unit.si, start * G.unit.si, &Targets::default()).knowledge
    }

    #[test]
    fn a_state_climbs_from_unobservable_to_observable() {
        let seen = [360.0, 300.0, 100.0, 39.0].map(|s| verdict(s, 360.0));
        assert_eq!(
            seen,
            [Knowledge::Unobservable, Knowledge::Weak, Knowledge::Converging, Knowledge::Observable]
        );
    }

    #[test]
    fn what_was_known_beforehand_is_not_called_observed() {
        assert_eq!(verdict(30.0, 30.0), Knowledge::Unobservable);
        assert_eq!(verdict(16.0, 30.0), Knowledge::Weak);
        assert_eq!(verdict(14.0, 30.0), Knowledge::Observable);
    }
}
