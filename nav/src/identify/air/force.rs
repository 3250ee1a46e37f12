//! The specific force along a trajectory.

use super::super::flight::Flight;
use super::super::statistics::range;
use super::Settled;
use crate::sample::{ImuSample, SampleKind};
use nalgebra::Vector3;

/// The specific force is its mean over at most so long before and after a fix, s: shorter than a vehicle takes to tilt. The means of two fixes have no sample in common.
const ABOUT_S: f64 = 0.1;

/// Means of the specific force about each point of the trajectory, as the model reads the samples.
pub(super) fn forces(flight: &Flight, settled: &Settled) -> Vec<Option<Vector3<f64>>> {
    let (model, mut calibration) = (&settled.model, settled.reference.calibration.clone());
    let needs_conditions = model.effects.iter().any(|s| s.effect.needs_conditions());
    let (samples, knots) = (flight.samples_of(model), &settled.reference.knots);
    // A mean is one of the middle of its interval.
    let early_s = match flight.stream().kind {
        SampleKind::Point => 0.0,
        _ => 0.5 * range(samples.iter().map(|s| s.t_s)) / samples.len().max(2) as f64,
    };
    let mut force = |s: &ImuSample| {
        if needs_conditions {
            calibration.conditions = flight.conditions(s.t_s);
        }
        (s.t_s - early_s, calibration.motion(model, s).force)
    };
    let all: Vec<(f64, Vector3<f64>)> = samples.iter().map(&mut force).collect();
    let half_s = (0.5 * range(knots.iter().map(|k| k.t_s)) / knots.len().max(2) as f64).min(ABOUT_S);
    let about = |t_s: f64| {
        let from = all.partition_point(|f| f.0 < t_s - half_s);
        let own = &all[from..all.partition_point(|f| f.0 < t_s + half_s)];
        (!own.is_empty()).then(|| own.iter().map(|f| f.1).sum::<Vector3<f64>>() / own.len() as f64)
    };
    knots.iter().map(|k| about(k.t_s)).collect()
}
