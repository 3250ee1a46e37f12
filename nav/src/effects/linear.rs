//! Effects that are linear in their parameters, as data: each parameter multiplies one driver and adds to one axis of one sensor.

use super::{ActsOn, Effect, Instant, ParameterGroup, Separation};
use nalgebra::{Matrix3, Vector3};

/// The three axes of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// rad/s.
    Gyro,
    /// m/s².
    Accel,
}

/// What a parameter multiplies; the number is the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driver {
    /// Specific force, m/s².
    Force(usize),
    /// Its square, m²/s⁴.
    ForceSquared(usize),
    /// Angular rate, rad/s.
    Rate(usize),
    /// Temperature above 25 °C.
    Temperature,
    /// Power of the vibration, m²/s⁴.
    Vibration(usize),
}

impl Driver {
    /// Its value.
    pub fn value(self, x: &Instant) -> f64 {
        match self {
            Self::Force(k) => x.force[k],
            Self::ForceSquared(k) => x.force[k] * x.force[k],
            Self::Rate(k) => x.rate[k],
            Self::Temperature => x.temperature_above_25_degc,
            Self::Vibration(k) => x.around.vibration[k],
        }
    }

    /// Its derivative by specific force and by rate: axis and value.
    fn by_motion(self, x: &Instant) -> [Option<(usize, f64)>; 2] {
        match self {
            Self::Force(k) => [Some((k, 1.0)), None],
            Self::ForceSquared(k) => [Some((k, 2.0 * x.force[k])), None],
            Self::Rate(k) => [None, Some((k, 1.0))],
            Self::Temperature | Self::Vibration(_) => [None, None],
        }
    }
}

/// One row of the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct LinearEffect {
    /// The fixed name of the design's table.
    pub name: &'static str,
    /// One line for people.
    pub description: &'static str,
    /// What usually causes it.
    pub cause: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
    /// What it adds to.
    pub acts_on: Sensor,
    /// Units, names, layout and prior of the parameters.
    pub parameters: &'static [ParameterGroup],
    /// Axis of the sensor and driver of each parameter.
    pub cells: &'static [(usize, Driver)],
    /// See [`Effect::tolerance`].
    pub tolerance: Option<f64>,
    /// See [`Effect::separations`].
    pub separations: &'static [Separation],
}

impl LinearEffect {
    fn added(&self, to: Sensor, p: &[f64], x: &Instant) -> Vector3<f64> {
        let mut out = Vector3::zeros();
        if to == self.acts_on {
            self.cells.iter().zip(p).for_each(|((axis, driver), p)| out[*axis] += p * driver.value(x));
        }
        out
    }

    /// Derivative of what is added by specific force (0) or rate (1).
    fn by_motion(&self, of: usize, p: &[f64], x: &Instant) -> Matrix3<f64> {
        let mut out = Matrix3::zeros();
        for ((axis, driver), p) in self.cells.iter().zip(p) {
            if let Some((k, by)) = driver.by_motion(x)[of] {
                out[(*axis, k)] += p * by;
            }
        }
        out
    }

    fn any(&self, of: fn(&Driver) -> bool) -> bool {
        self.cells.iter().any(|(_, driver)| of(driver))
    }
}

impl Effect for LinearEffect {
    of_row!();

    fn tolerance(&self) -> Option<f64> {
        self.tolerance
    }

    fn separations(&self) -> &'static [Separation] {
        self.separations
    }

    fn needs_temperature(&self) -> bool {
        self.any(|d| *d == Driver::Temperature)
    }

    fn needs_vibration(&self) -> bool {
        self.any(|d| matches!(d, Driver::Vibration(_)))
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Samples
    }

    fn is_linear(&self) -> bool {
        !self.any(|d| !matches!(d, Driver::Force(_) | Driver::Rate(_)))
    }

    fn needs_surroundings(&self) -> bool {
        self.needs_vibration()
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.added(Sensor::Gyro, p, x)
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        self.added(Sensor::Accel, p, x)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        let columns = if self.acts_on == Sensor::Gyro { gyro } else { accel };
        columns
            .iter_mut()
            .zip(self.cells)
            .for_each(|(column, (axis, driver))| column[*axis] = driver.value(x));
    }

    fn gyro_by_force(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        let drives =
            self.acts_on == Sensor::Gyro && self.cells.iter().any(|(_, d)| d.by_motion(x)[0].is_some());
        drives.then(|| self.by_motion(0, p, x))
    }

    fn accel_by_rate(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        let drives =
            self.acts_on == Sensor::Accel && self.cells.iter().any(|(_, d)| d.by_motion(x)[1].is_some());
        drives.then(|| self.by_motion(1, p, x))
    }
}
