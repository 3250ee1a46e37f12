//! What every effect answers: what it is, in words and parameters, and what it does to inertial samples, fixes, the random walk of the biases and
//! raw samples. Everything but the former has a neutral default, so that a file of an effect holds only what it changes.

use super::{
    AirEffect, BiasWalk, DrawRange, Event, FieldEffect, FixInstant, Instant, Kernel, ParameterGroup,
    ReportedSample, Separation,
};
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};

/// What an effect acts on, beside other sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActsOn {
    /// Inertial samples.
    Samples,
    /// Fixes.
    Fixes,
    /// The process noise of the biases.
    Biases,
    /// Raw samples: a fault of a source, there or not.
    Source,
}

/// One way in which a real sensor differs from an ideal one: what it is, and what it does to what it acts on; nothing to the rest.
///
/// `p` holds its parameters in SI, in the order of its groups; its length is [`Effect::len`]. Jacobian slices come zeroed, one column per parameter.
pub trait Effect: Sync + std::fmt::Debug {
    /// The fixed name of the design's table.
    fn name(&self) -> &'static str;

    /// One line for people.
    fn description(&self) -> &'static str;

    /// What usually causes it.
    fn cause(&self) -> &'static str {
        "a driver, a message or a mounting that does not do what the autopilot assumes"
    }

    /// What to do about it.
    fn remedy(&self) -> &'static str {
        "correct the driver or the mounting; no filter can estimate it"
    }

    /// The parameters; empty for a discrete effect.
    fn groups(&self) -> &'static [ParameterGroup];

    /// Number of parameters.
    fn len(&self) -> usize {
        self.groups().iter().map(|g| g.shape.len()).sum()
    }

    /// Whether the effect is discrete: present or absent, without parameters.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// 1-sigma of what calibration leaves of it in a consumer unit, SI, for every parameter alike; `None` for what a sensor has or has
    /// not. The standard model estimates these.
    fn tolerance(&self) -> Option<f64> {
        None
    }

    /// Effects that it imitates, and what separates them. A pair stands in the file of one of them.
    fn separations(&self) -> &'static [Separation] {
        &[]
    }

    /// From where a study draws its first parameter.
    fn draw_range(&self) -> DrawRange {
        match *self.sizes_to_try() {
            [_, low, .., high] => DrawRange::LogUniform(low, high),
            _ => DrawRange::Prior,
        }
    }

    /// Whether it shows only where samples carry a temperature.
    fn needs_temperature(&self) -> bool {
        false
    }

    /// Another effect that no motion separates from it: it is looked for only where the model gives that one as known.
    fn needs_known(&self) -> Option<&'static str> {
        None
    }

    /// Logarithm of the odds against it before any flight, nats, beyond those against an effect of the catalogue.
    fn prior_cost(&self) -> f64 {
        0.0
    }

    /// Whether it shows only where the vehicle vibrates.
    fn needs_vibration(&self) -> bool {
        false
    }

    /// What jumps, if it is an event: an instant that is searched for, and a size.
    fn event(&self) -> Option<Event> {
        None
    }

    /// Whether it says that integer samples are truncated toward zero.
    fn truncates_samples(&self) -> bool {
        false
    }

    /// Whether it acts on this.
    fn acts_on(&self, _what: ActsOn) -> bool {
        false
    }

    /// Whether it is a fault of a source.
    fn is_source_mistake(&self) -> bool {
        self.acts_on(ActsOn::Source)
    }

    /// What it does to the field that a compass reports.
    fn on_field(&self) -> Option<&dyn FieldEffect> {
        None
    }

    /// What it does to a barometer or an airspeed sensor.
    fn on_air(&self) -> Option<&AirEffect> {
        None
    }

    /// What it adds to the true rate, rad/s.
    fn gyro(&self, _p: &[f64], _x: &Instant) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Whether what it adds to samples is linear in rate and specific force and depends on nothing else.
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

    /// Whether it depends on [`Conditions`](super::Conditions).
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

    /// ∂(position, velocity)/∂(body rotation ε) of what [`Self::fix`] adds, where C = Ĉ exp(ε).
    fn fix_by_attitude(&self, _p: &[f64], _x: &FixInstant) -> Option<[Matrix3<f64>; 2]> {
        None
    }

    /// Random walk that it adds to the biases.
    fn bias_walk(&self, _p: &[f64]) -> BiasWalk {
        BiasWalk::default()
    }

    /// Sizes worth trying, SI and ascending, where its only parameter is no state.
    fn sizes_to_try(&self) -> &'static [f64] {
        &[]
    }

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

/// A fault undone sample by sample.
pub(super) fn undo_one_by_one<E: Effect + ?Sized>(effect: &E, samples: &[ImuSample]) -> Vec<ImuSample> {
    let mut last = None;
    let mut undo = |sample: &ImuSample| {
        let undone = effect.undo_source_after(sample, last.as_ref());
        last = Some(*sample);
        undone
    };
    samples.iter().filter_map(&mut undo).collect()
}
