//! Delay between gyros and accelerometers: a sample's rate is older than its specific force.
//!
//! ω̃(t) = ω(t − L) = ω − L ω̇ + ½ L² ω̈. Low-passes of different corner (`INS_GYRO_FILTER`, `INS_ACCEL_FILTER`: 20 and 10 Hz differ by
//! 11 ms), and drivers that read one sensor a cycle before the other, have it. Where the samples are at hand the rate of a while ago
//! is that of the samples, and the series is one about it. Below zero the accelerometers are late; what both have in common
//! is part of [`GpsLatency`](super::GpsLatency).

use super::{ActsOn, DrawRange, Effect, Excitation, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// Time from the validity of the rate to that of the specific force.
#[derive(Debug)]
pub struct GyroAccelDelay;

impl Effect for GyroAccelDelay {
    words! {
        name: "gyro_accel_delay",
        description: "rate and specific force of a sample are not of the same time: above zero the rate is the older one",
        cause: "low-pass filters of different corner frequency, or a driver that reads one sensor before the other",
        remedy: "set the same low-pass for gyros and accelerometers (INS_GYRO_FILTER, INS_ACCEL_FILTER; IMU_GYRO_CUTOFF, IMU_ACCEL_CUTOFF)",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup { unit: unit::S, shape: Shape::Scalar, names: &["gyro_delay"], prior_sigma: 0.01 }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gyro_scale_factor",
                fly: &[Excitation::FigureEight],
                why: "a delay shows while the rate of turn changes, a scale factor in steady turns as well",
            },
            Separation {
                from: "gps_latency",
                fly: &[Excitation::FigureEight, Excitation::VaryingSpeed],
                why: "a delay of the gyros shows while rolling and pitching, one of the fixes with any acceleration",
            },
        ]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::LogUniform(0.004, 0.03)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Samples
    }

    fn rate_lag_s(&self, p: &[f64]) -> f64 {
        p[0]
    }

    fn needs_surroundings(&self) -> bool {
        true
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        let [first, second] = &x.around.rate_derivatives;
        let (known, beyond) = (x.around.late.lag_s, p[0] - x.around.late.lag_s);
        x.around.late.change + (second * known - first) * beyond + second * (0.5 * beyond * beyond)
    }

    fn imu_jacobian(&self, p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        let [first, second] = &x.around.rate_derivatives;
        gyro[0] = second * p[0] - first;
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::effects::testing::{check_jacobians, instant};
    use crate::effects::{LateRate, Surroundings};

    /// A swing, against the rate of a while ago itself: by the series alone, and about what the samples showed.
    #[test]
    fn a_swing_shows_the_rate_of_a_while_ago() {
        let rate = |t: f64| Vector3::new(1.2 * sin(2.0 * t), 0.3 * cos(3.0 * t), 0.1 * t);
        let first = |t: f64| Vector3::new(2.4 * cos(2.0 * t), -0.9 * sin(3.0 * t), 0.1);
        let second = |t: f64| Vector3::new(-4.8 * sin(2.0 * t), -2.7 * cos(3.0 * t), 0.0);
        for (t, late_s, lag_s) in [(0.4, 0.015, 0.0), (1.1, -0.02, 0.0), (0.9, 0.05, 0.04)] {
            let late = LateRate { lag_s, change: rate(t - lag_s) - rate(t) };
            let around = Surroundings { rate_derivatives: [first(t), second(t)], late, ..Default::default() };
            let x = Instant { around, ..instant(rate(t).into(), [0.0; 3]) };
            let exact = rate(t - late_s) - rate(t);
            let found = GyroAccelDelay.gyro(&[late_s], &x);
            assert!((found - exact).norm() < 2e-4, "{t} {late_s}: {found} {exact}");
        }
        check_jacobians(&GyroAccelDelay);
    }
}
