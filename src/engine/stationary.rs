//! Whether the vehicle moves at all, judged on smoothed samples, so that a shaking engine does not mask it.

use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::exp;
use gaware_nav::sample::ImuSample;
use nalgebra::Vector3;

/// Time constant of the smoothing, s.
const SMOOTHING_S: f64 = 1.0;
/// Mean rate of a stationary vehicle, a large gyro bias included, rad/s …
const RATE: f64 = 0.03;
/// … mean specific force this close to gravity, m/s² …
const FORCE: f64 = 0.5;
/// … and speed, m/s.
const SPEED: f64 = 1.0;
/// It must look like standstill for so long, s.
const PATIENCE_S: f64 = 3.0;

/// Smoothed samples.
#[derive(Debug, Clone, Copy, Default)]
pub struct StationaryTest {
    last_s: Option<f64>,
    rate: Vector3<f64>,
    force: Vector3<f64>,
    still_s: f64,
}

impl StationaryTest {
    /// Takes a sample.
    pub fn push(&mut self, sample: &ImuSample) {
        let Some(last) = self.last_s.replace(sample.t_s) else {
            (self.rate, self.force) = (sample.gyro, sample.accel);
            return;
        };
        let dt = (sample.t_s - last).clamp(0.0, SMOOTHING_S);
        let share = 1.0 - exp(-dt / SMOOTHING_S);
        self.rate += (sample.gyro - self.rate) * share;
        self.force += (sample.accel - self.force) * share;
        let still = self.rate.norm() < RATE && (self.force.norm() - STANDARD_GRAVITY).abs() < FORCE;
        self.still_s = if still { self.still_s + dt } else { 0.0 };
    }

    /// Rate, rad/s, and specific force, m/s², without what shakes.
    pub fn smoothed(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.rate, self.force)
    }

    /// Whether it stands (or hovers) at this speed, m/s.
    pub fn stands(&self, speed: f64) -> bool {
        self.still_s >= PATIENCE_S && speed < SPEED
    }
}
