//! A jump of the gyro biases: from some instant on they have another value, as after a shock or a change of supply.

use super::{ActsOn, DrawRange, Effect, Event, Instant, ParameterGroup, Shape, unit};
use nalgebra::Vector3;

/// When, and how much about each axis. The instant is searched for, the size is a state.
#[derive(Debug)]
pub struct GyroBiasStep;

/// 0.1 deg/s: a fifth of the prior of the bias itself, large against what the bias of a consumer gyro changes in a flight.
const PRIOR_SIGMA: f64 = 360.0 * unit::DEG_PER_H.si;

impl GyroBiasStep {
    fn on(p: &[f64], x: &Instant) -> bool {
        x.t_s >= p[0]
    }
}

impl Effect for GyroBiasStep {
    words! {
        name: "gyro_bias_step",
        description: "the gyro biases jump and stay at the new value",
        cause: "a shock, a change of supply or a reset of the sensor",
        remedy: "look at what happened at that instant; check mounting and supply of the unit",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[
            ParameterGroup {
                unit: unit::S,
                shape: Shape::Scalar,
                names: &["gyro_step_time"],
                prior_sigma: 0.0,
            },
            ParameterGroup {
                unit: unit::DEG_PER_H,
                shape: Shape::Vector,
                names: &["gyro_step_x", "gyro_step_y", "gyro_step_z"],
                prior_sigma: PRIOR_SIGMA,
            },
        ]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::Uniform(50.0, 190.0)
    }

    fn event(&self) -> Option<Event> {
        Some(Event::GyroBias)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Samples
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        if Self::on(p, x) { Vector3::new(p[1], p[2], p[3]) } else { Vector3::zeros() }
    }

    fn imu_jacobian(&self, p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        if Self::on(p, x) {
            for k in 0..3 {
                gyro[k + 1][k] = 1.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn jumps_once_and_stays() {
        let p = [100.0, 1e-3, -2e-3, 0.0];
        let at = |t_s: f64| GyroBiasStep.gyro(&p, &Instant { t_s, ..instant([0.1; 3], [0.0; 3]) });
        assert_eq!(at(99.9), Vector3::zeros());
        assert_eq!(at(100.0), Vector3::new(1e-3, -2e-3, 0.0));
        assert_eq!(at(900.0), at(100.0));
    }

    #[test]
    fn before_the_step_its_size_has_no_influence() {
        let mut gyro = [Vector3::zeros(); 4];
        let x = instant([0.1; 3], [0.0; 3]);
        GyroBiasStep.imu_jacobian(&[100.0, 1e-3, 0.0, 0.0], &x, &mut gyro, &mut [Vector3::zeros(); 4]);
        assert_eq!(gyro, [Vector3::zeros(); 4]);
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroBiasStep);
    }
}
