//! Sensors beside the inertial unit after a flight, in what all of them have in common: the trajectory that they are judged by, a scalar
//! measurement along it with errors that walk, and which effects of a sensor the flight shows.
//!
//! Nothing here changes the trajectory. A sensor is a catalogue of effects, the columns of their parameters at each fix, and tolerances that
//! are never named.

pub(super) mod choose;
pub mod foreseen;
pub(super) mod judged;
pub(super) mod series;
pub(super) mod settled;

use crate::model::EffectSetting;
pub use settled::Settled;

/// An effect of a sensor that the flight shows.
#[derive(Debug, Clone)]
pub struct Finding {
    /// With its values and their 1-sigma.
    pub setting: EffectSetting,
    /// Logarithm of the odds that it is there.
    pub evidence: f64,
    /// By how much it makes the held-out blocks more likely, nats.
    pub held_out_gain: f64,
    /// Others that would do as well: the flight does not separate them.
    pub others: Vec<&'static str>,
}

/// The value at a time, on the straight line between its neighbours where both are within `near_s`. A mean over more of them would be shorter
/// in a turn.
pub(super) fn at_time<V: Copy>(
    samples: &[(f64, V)],
    t_s: f64,
    near_s: f64,
    between: impl Fn(&V, &V, f64) -> V,
) -> Option<V> {
    let next = samples.partition_point(|s| s.0 < t_s);
    let (before, after) = (samples.get(next.checked_sub(1)?)?, samples.get(next)?);
    if t_s - before.0 > near_s || after.0 - t_s > near_s {
        return None;
    }
    Some(between(&before.1, &after.1, (t_s - before.0) / (after.0 - before.0)))
}
