//! An effect asked for what it does, whatever it acts on: simulator, filter and `explain` need not know which traits it has.

use super::{
    BiasWalk, Effect, FixEffect, FixInstant, ImuEffect, Instant, Kernel, ReportedSample, SourceEffect,
    WalkEffect,
};
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};

/// What an effect does to whatever it may act on; nothing to the rest.
impl<'a> dyn Effect + 'a {
    /// As [`ImuEffect::gyro`].
    pub fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.on_samples().map_or_else(Vector3::zeros, |e| e.gyro(p, x))
    }

    /// As [`ImuEffect::accel`].
    pub fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.on_samples().map_or_else(Vector3::zeros, |e| e.accel(p, x))
    }

    /// As [`ImuEffect::imu_jacobian`].
    pub fn imu_jacobian(
        &self,
        p: &[f64],
        x: &Instant,
        gyro: &mut [Vector3<f64>],
        accel: &mut [Vector3<f64>],
    ) {
        if let Some(e) = self.on_samples() {
            e.imu_jacobian(p, x, gyro, accel);
        }
    }

    /// As [`ImuEffect::gyro_by_force`].
    pub fn gyro_by_force(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        self.on_samples().and_then(|e| e.gyro_by_force(p, x))
    }

    /// As [`FixEffect::delays_fixes`].
    pub fn delays_fixes(&self) -> bool {
        self.on_fixes().is_some_and(FixEffect::delays_fixes)
    }

    /// As [`FixEffect::fix_delay_s`].
    pub fn fix_delay_s(&self, p: &[f64], elapsed_s: f64) -> f64 {
        self.on_fixes().map_or(0.0, |e| e.fix_delay_s(p, elapsed_s))
    }

    /// As [`FixEffect::velocity_delay_s`].
    pub fn velocity_delay_s(&self, p: &[f64]) -> f64 {
        self.on_fixes().map_or(0.0, |e| e.velocity_delay_s(p))
    }

    /// As [`FixEffect::kernel`].
    pub fn kernel(&self, p: &[f64]) -> Kernel {
        self.on_fixes().map_or_else(Kernel::default, |e| e.kernel(p))
    }

    /// As [`FixEffect::needs_motion_around`].
    pub fn needs_motion_around(&self) -> bool {
        self.on_fixes().is_some_and(FixEffect::needs_motion_around)
    }

    /// As [`ImuEffect::rate_lag_s`].
    pub fn rate_lag_s(&self, p: &[f64]) -> f64 {
        self.on_samples().map_or(0.0, |e| e.rate_lag_s(p))
    }

    /// As [`ImuEffect::accel_by_rate`].
    pub fn accel_by_rate(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        self.on_samples().and_then(|e| e.accel_by_rate(p, x))
    }

    /// As [`ImuEffect::needs_conditions`] and [`FixEffect::needs_conditions`].
    pub fn needs_conditions(&self) -> bool {
        self.on_samples().is_some_and(ImuEffect::needs_conditions)
            || self.on_fixes().is_some_and(FixEffect::needs_conditions)
    }

    /// As [`ImuEffect::needs_surroundings`].
    pub fn needs_surroundings(&self) -> bool {
        self.on_samples().is_some_and(ImuEffect::needs_surroundings)
    }

    /// As [`FixEffect::fix`].
    pub fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        self.on_fixes().map_or([Vector3::zeros(); 2], |e| e.fix(p, x))
    }

    /// As [`FixEffect::fix_jacobian`].
    pub fn fix_jacobian(
        &self,
        p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        if let Some(e) = self.on_fixes() {
            e.fix_jacobian(p, x, position, velocity);
        }
    }

    /// As [`FixEffect::fix_by_attitude`].
    pub fn fix_by_attitude(&self, p: &[f64], x: &FixInstant) -> Option<[Matrix3<f64>; 2]> {
        self.on_fixes().and_then(|e| e.fix_by_attitude(p, x))
    }

    /// As [`FixEffect::values_to_try`].
    pub fn values_to_try(&self) -> &'static [f64] {
        self.on_fixes().map_or(&[], FixEffect::values_to_try)
    }

    /// As [`WalkEffect::bias_walk`].
    pub fn bias_walk(&self, p: &[f64]) -> BiasWalk {
        self.on_biases().map_or_else(BiasWalk::default, |e| e.bias_walk(p))
    }

    /// As [`WalkEffect::sizes_to_try`]; empty for all others.
    pub fn sizes_to_try(&self) -> &'static [f64] {
        self.on_biases().map_or(&[], WalkEffect::sizes_to_try)
    }

    /// Whether it changes finished samples.
    pub fn is_source_mistake(&self) -> bool {
        self.on_source().is_some()
    }

    /// As [`SourceEffect::source`].
    pub fn source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        self.on_source().map_or([*gyro, *accel], |e| e.source(gyro, accel))
    }

    /// As [`SourceEffect::undo_source`].
    pub fn undo_source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        self.on_source().map_or([*gyro, *accel], |e| e.undo_source(gyro, accel))
    }

    /// As [`SourceEffect::source_after`].
    pub fn source_after(&self, now: [Vector3<f64>; 2], before: Option<&ReportedSample>) -> [Vector3<f64>; 2] {
        self.on_source().map_or(now, |e| e.source_after(now, before))
    }

    /// As [`SourceEffect::undo_source_after`].
    pub fn undo_source_after(&self, now: &ImuSample, last: Option<&ImuSample>) -> Option<ImuSample> {
        self.on_source().map_or(Some(*now), |e| e.undo_source_after(now, last))
    }

    /// As [`SourceEffect::undo_sequence`].
    pub fn undo_sequence(&self, samples: &[ImuSample]) -> Vec<ImuSample> {
        self.on_source().map_or_else(|| samples.to_vec(), |e| e.undo_sequence(samples))
    }

    /// As [`SourceEffect::needs_neighbours`].
    pub fn needs_neighbours(&self) -> bool {
        self.on_source().is_some_and(SourceEffect::needs_neighbours)
    }

    /// As [`SourceEffect::changes_unit`].
    pub fn changes_unit(&self) -> bool {
        self.on_source().is_some_and(SourceEffect::changes_unit)
    }

    /// As [`SourceEffect::reported_by`].
    pub fn reported_by(&self, samples: &[ImuSample]) -> f64 {
        self.on_source().map_or(0.0, |e| e.reported_by(samples))
    }

    /// As [`SourceEffect::shows_in`].
    pub fn shows_in(&self, samples: &[ImuSample]) -> bool {
        self.on_source().is_none_or(|e| e.shows_in(samples))
    }
}
