//! Integer samples: what rounding and truncation do to a value, and the best guess of the value behind a count.
//!
//! Rounding acts like white noise of 1/√12 step once the sensor noise exceeds half a step (Widrow & Kollár 2008,
//! ch. 4). Truncation toward zero does not: away from zero it shifts every value by half a step toward zero, and
//! around zero it has a dead zone two steps wide.

use crate::sample::{ImuSample, Quantisation, Steps};
use nalgebra::Vector3;

impl Quantisation {
    /// What the source makes of a real sample.
    pub fn apply(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let with = |steps: &Steps, f: fn(f64) -> f64| {
            (gyro.map(|v| f(v / steps.gyro) * steps.gyro), accel.map(|v| f(v / steps.accel) * steps.accel))
        };
        match self {
            Self::None => (*gyro, *accel),
            Self::Round(steps) => with(steps, f64::round),
            Self::Truncate(steps) => with(steps, f64::trunc),
        }
    }

    /// The sample with each count replaced by the centre of the values that lead to it.
    pub fn undo(&self, sample: &ImuSample) -> ImuSample {
        match self {
            Self::None | Self::Round(_) => *sample,
            Self::Truncate(steps) => ImuSample {
                gyro: sample.gyro.map(|v| centre(v, steps.gyro)),
                accel: sample.accel.map(|v| centre(v, steps.accel)),
                ..*sample
            },
        }
    }

    /// Variances that the rounding adds to each gyro and accelerometer value, (rad/s)² and (m/s²)².
    pub fn variance(&self) -> (f64, f64) {
        match self {
            Self::None => (0.0, 0.0),
            Self::Round(s) | Self::Truncate(s) => (s.gyro * s.gyro / 12.0, s.accel * s.accel / 12.0),
        }
    }
}

/// Centre of the values that truncation maps to the count nearest to `value`.
fn centre(value: f64, step: f64) -> f64 {
    let count = (value / step).round();
    if count == 0.0 { 0.0 } else { value + 0.5 * step * count.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn undoing_truncation_leaves_at_most_half_a_step_outside_the_dead_zone(v in -1.0..1.0f64) {
            let q = Quantisation::Truncate(Steps::RAW_IMU);
            let (gyro, accel) = q.apply(&Vector3::repeat(v), &Vector3::repeat(v));
            let back = q.undo(&ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None });
            let limit = if v.abs() < Steps::RAW_IMU.gyro { Steps::RAW_IMU.gyro } else { 0.5 * Steps::RAW_IMU.gyro };
            prop_assert!((back.gyro.x - v).abs() <= limit * 1.000_001);
        }
    }

    #[test]
    fn truncation_goes_toward_zero() {
        let q = Quantisation::Truncate(Steps { gyro: 1.0, accel: 1.0 });
        let (g, _) = q.apply(&Vector3::new(1.9, -1.9, 0.9), &Vector3::zeros());
        assert_eq!(g, Vector3::new(1.0, -1.0, 0.0));
    }
}
