//! How fast specific force and angular rate change, along a whole flight: known only afterwards, when the samples on both sides of
//! an instant are there. A receiver that rounds corners off needs it ([`GpsSmoothing`](crate::effects::GpsSmoothing)).

use crate::sample::{ImuSample, SampleKind};
use nalgebra::Vector3;

/// Means over so long before and after an instant are compared, s: two epochs of a receiver at 5 Hz, as its interpolation
/// compares them.
const SPAN_S: f64 = 0.1;

/// The angular rate itself is a mean over this time before and after an instant, s.
const RATE_SPAN_S: f64 = 0.02;

/// Samples with the impulse of specific force, and the angle, up to each.
#[derive(Debug, Clone, Default)]
pub struct ForceRates {
    times_s: Vec<f64>,
    impulses: Vec<Vector3<f64>>,
    angles: Vec<Vector3<f64>>,
}

impl ForceRates {
    /// Of samples in order of time.
    pub fn new(samples: &[ImuSample], kind: SampleKind) -> Self {
        let (mut times_s, mut impulses, mut angles) = (Vec::new(), Vec::new(), Vec::new());
        let (mut last, mut sum, mut angle) = (None::<&ImuSample>, Vector3::zeros(), Vector3::zeros());
        for sample in samples {
            if let Some(before) = last {
                let start = if kind == SampleKind::Point { before } else { sample };
                let half = 0.5 * (sample.t_s - before.t_s);
                sum += (start.accel + sample.accel) * half;
                angle += (start.gyro + sample.gyro) * half;
            }
            times_s.push(sample.t_s);
            impulses.push(sum);
            angles.push(angle);
            last = Some(sample);
        }
        Self { times_s, impulses, angles }
    }

    fn up_to(&self, sums: &[Vector3<f64>], t_s: f64) -> Option<Vector3<f64>> {
        let next = self.times_s.partition_point(|t| *t < t_s);
        let before = next.checked_sub(1)?;
        let (t0, t1) = (*self.times_s.get(before)?, *self.times_s.get(next)?);
        let share = (t_s - t0) / (t1 - t0);
        Some(sums.get(before)?.lerp(sums.get(next)?, share))
    }

    /// Rate of change of the specific force in body axes, m/s³; zero where samples on one side are lacking.
    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        let [before, here, after] = [t_s - SPAN_S, t_s, t_s + SPAN_S].map(|t| self.up_to(&self.impulses, t));
        match (before, here, after) {
            (Some(a), Some(b), Some(c)) => (c - b * 2.0 + a) / (SPAN_S * SPAN_S),
            _ => Vector3::zeros(),
        }
    }

    /// First and second derivative of the angular rate, rad/s² and rad/s³; zero where samples on one side are lacking.
    pub fn of_rate_at(&self, t_s: f64) -> [Vector3<f64>; 2] {
        let rate = |t: f64| {
            let (a, b) =
                (self.up_to(&self.angles, t - RATE_SPAN_S)?, self.up_to(&self.angles, t + RATE_SPAN_S)?);
            Some((b - a) / (2.0 * RATE_SPAN_S))
        };
        match [t_s - SPAN_S, t_s, t_s + SPAN_S].map(rate) {
            [Some(a), Some(b), Some(c)] => [(c - a) / (2.0 * SPAN_S), (c - b * 2.0 + a) / (SPAN_S * SPAN_S)],
            _ => [Vector3::zeros(); 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_has_its_slope_and_the_ends_have_none() {
        let slope = Vector3::new(1.0, -3.0, 20.0);
        let samples: Vec<ImuSample> = (0..100)
            .map(|i| {
                let t_s = f64::from(i) * 0.02;
                ImuSample { t_s, gyro: Vector3::zeros(), accel: slope * t_s, temperature_degc: None }
            })
            .collect();
        let rates = ForceRates::new(&samples, SampleKind::Point);
        assert!((rates.at(1.003) - slope).norm() < 1e-9, "{}", rates.at(1.003));
        assert_eq!(rates.of_rate_at(1.003), [Vector3::zeros(); 2]);
        assert_eq!(rates.at(0.05), Vector3::zeros());
        assert_eq!(rates.at(3.0), Vector3::zeros());
        assert_eq!(ForceRates::default().at(0.0), Vector3::zeros());
    }
}
