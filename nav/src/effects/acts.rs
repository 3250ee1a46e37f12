//! What an effect may act on: inertial samples, fixes, the random walk of the biases, raw samples. One trait each, with neutral
//! defaults, so that a file of an effect holds only what it changes.

use super::{BiasWalk, FixInstant, Instant, Kernel, ReportedSample, undo_one_by_one};
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};

/// An effect on inertial samples.
///
/// `p` holds the effect's parameters in SI, in the order of its groups; its length is [`Effect::len`](super::Effect::len). Methods have a neutral
/// default. Jacobian slices come zeroed, one column per parameter.
pub trait ImuEffect {
    /// What it adds to the true rate, rad/s.
    fn gyro(&self, _p: &[f64], _x: &Instant) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Whether what it adds is linear in rate and specific force and depends on nothing else.
    fn is_linear(&self) -> bool {
        false
    }

    /// What it adds to the true specific force, m/s².
    fn accel(&self, _p: &[f64], _x: &Instant) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// ∂gyro/∂p and ∂accel/∂p.
    fn imu_jacobian(
        &self,
        _p: &[f64],
        _x: &Instant,
        _gyro: &mut [Vector3<f64>],
        _accel: &mut [Vector3<f64>],
    ) {
    }

    /// How much older than the specific force the reported rate is, s. [`Self::gyro`] holds what that changes.
    fn rate_lag_s(&self, _p: &[f64]) -> f64 {
        0.0
    }

    /// ∂accel/∂rate: how an error of rate becomes one of specific force.
    fn accel_by_rate(&self, _p: &[f64], _x: &Instant) -> Option<Matrix3<f64>> {
        None
    }

    /// Whether it depends on [`Instant::conditions`].
    fn needs_conditions(&self) -> bool {
        false
    }

    /// Whether it depends on [`Instant::around`].
    fn needs_surroundings(&self) -> bool {
        false
    }

    /// ∂gyro/∂force: how an error of specific force becomes one of rate.
    fn gyro_by_force(&self, _p: &[f64], _x: &Instant) -> Option<Matrix3<f64>> {
        None
    }
}

/// An effect on fixes; parameters as in [`ImuEffect`].
pub trait FixEffect {
    /// Whether it is a delay of whole fixes that stays the same.
    fn delays_fixes(&self) -> bool {
        false
    }

    /// How much older than its time stamp a fix is whose stamp is so long after the start of the estimation, s.
    fn fix_delay_s(&self, _p: &[f64], _elapsed_s: f64) -> f64 {
        0.0
    }

    /// Values of its one parameter about which a search linearises beside zero. A velocity of `L` ago is v − a L only while the acceleration
    /// lasts: in gusts it does not, and about zero a delay of 85 ms was worth 8 nats where it explained 11,172 (a plane of ArduPilot's own
    /// simulation in turbulence).
    fn values_to_try(&self) -> &'static [f64] {
        &[]
    }

    /// How much older than the position of a fix its velocity is, s. [`Self::fix`] holds what that changes.
    fn velocity_delay_s(&self, _p: &[f64]) -> f64 {
        0.0
    }

    /// The kernel that the receiver smooths with.
    fn kernel(&self, _p: &[f64]) -> Kernel {
        Kernel::default()
    }

    /// Whether it depends on the motion before and after the time of validity.
    fn needs_motion_around(&self) -> bool {
        false
    }

    /// Whether it depends on [`Conditions`](super::Conditions).
    fn needs_conditions(&self) -> bool {
        false
    }

    /// Position of the antenna relative to the inertial unit, m.
    fn arm(&self, _p: &[f64]) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// What it adds to position (m) and velocity (m/s) of a fix, north-east-down, beyond the delay.
    fn fix(&self, _p: &[f64], _x: &FixInstant) -> [Vector3<f64>; 2] {
        [Vector3::zeros(); 2]
    }

    /// ∂position/∂p and ∂velocity/∂p of a fix, delay included, at the time of validity.
    fn fix_jacobian(
        &self,
        _p: &[f64],
        _x: &FixInstant,
        _position: &mut [Vector3<f64>],
        _velocity: &mut [Vector3<f64>],
    ) {
    }

    /// ∂(position, velocity)/∂(body rotation ε) of what [`FixEffect::fix`] adds, where C = Ĉ exp(ε).
    fn fix_by_attitude(&self, _p: &[f64], _x: &FixInstant) -> Option<[Matrix3<f64>; 2]> {
        None
    }
}

/// An effect on the process noise of the biases.
pub trait WalkEffect {
    /// Random walk that it adds to the biases.
    fn bias_walk(&self, p: &[f64]) -> BiasWalk;

    /// Sizes worth trying, SI and ascending: its only parameter is no state.
    fn sizes_to_try(&self) -> &'static [f64];
}

/// An effect on raw samples: a fault of a source, there or not.
pub trait SourceEffect {
    /// What the source makes of a finished gyro (rad/s) and accelerometer (m/s²) sample.
    fn source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        [*gyro, *accel]
    }

    /// The finished sample behind what the source made of it.
    fn undo_source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        [*gyro, *accel]
    }

    /// The same for a fault that depends on what was reported before.
    fn source_after(&self, now: [Vector3<f64>; 2], _before: Option<&ReportedSample>) -> [Vector3<f64>; 2] {
        let [gyro, accel] = now;
        self.source(&gyro, &accel)
    }

    /// Whether whole numbers are no longer whole once it is undone: then rounding is undone after it and not before.
    fn changes_unit(&self) -> bool {
        false
    }

    /// A sample as it was finished, from it and the one reported before; `None` where nothing can be determined yet or nothing is new.
    fn undo_source_after(&self, now: &ImuSample, _last: Option<&ImuSample>) -> Option<ImuSample> {
        let [gyro, accel] = self.undo_source(&now.gyro, &now.accel);
        Some(ImuSample { gyro, accel, ..*now })
    }

    /// The finished samples behind a whole flight.
    fn undo_sequence(&self, samples: &[ImuSample]) -> Vec<ImuSample> {
        undo_one_by_one(self, samples)
    }

    /// Whether it shows from sample to sample, so that it can only be undone before samples are averaged.
    fn needs_neighbours(&self) -> bool {
        false
    }

    /// Logarithm of the odds for it that lie in the samples alone, whatever the vehicle did.
    fn reported_by(&self, _samples: &[ImuSample]) -> f64 {
        0.0
    }

    /// Whether these samples can have it at all.
    fn shows_in(&self, _samples: &[ImuSample]) -> bool {
        true
    }
}
