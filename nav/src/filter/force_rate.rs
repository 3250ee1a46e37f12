//! How fast specific force and angular rate change, along a whole flight: known only afterwards, when the samples on both sides of
//! an instant are there. A receiver that rounds corners off needs it ([`GpsSmoothing`](crate::effects::GpsSmoothing)).

use crate::effects::{FixInstant, Older};
use crate::rotation::exp;
use crate::sample::{ImuSample, SampleKind};
use nalgebra::Vector3;

/// Means over so long before and after an instant are compared, s: two epochs of a receiver at 5 Hz, as its interpolation
/// compares them.
const SPAN_S: f64 = 0.1;

/// The angular rate itself is a mean over this time before and after an instant, s.
const RATE_SPAN_S: f64 = 0.02;

/// A change of velocity is put together of so many parts.
const PARTS: u32 = 4;

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

    /// The velocity `lag_s` before an instant, from the samples in between: their impulse, part by part in the axes of its middle.
    /// `told` and `force` are the specific force there as the sample has it and as it is.
    pub fn older(&self, lag_s: f64, x: &FixInstant, told: &Vector3<f64>, force: &Vector3<f64>) -> Older {
        if lag_s == 0.0 {
            return Older::default();
        }
        let step_s = lag_s / f64::from(PARTS);
        let part = |k: u32| {
            let (from, to) = (x.t_s - step_s * f64::from(k + 1), x.t_s - step_s * f64::from(k));
            let angle = self.up_to(&self.angles, x.t_s)? - self.up_to(&self.angles, 0.5 * (from + to))?;
            let impulse = self.up_to(&self.impulses, to)? - self.up_to(&self.impulses, from)?;
            Some(exp(&-angle) * (impulse + (force - told) * step_s))
        };
        let impulse: Option<Vector3<f64>> = (0..PARTS).map(part).sum();
        let rest = x.a_n - x.c_nb * force;
        impulse.map_or_else(Older::default, |i| Older { lag_s, change: -(x.c_nb * i + rest * lag_s) })
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

    /// A vehicle that rolls into a turn: the velocity of 0.18 s ago, against the path itself.
    #[test]
    fn the_velocity_of_a_while_ago_is_that_of_the_path() {
        let roll = |t: f64| 0.8 * (1.0 + (3.0 * t).sin());
        let velocity = |t: f64| Vector3::new(30.0 + 2.0 * t, 4.0 * (2.0 * t).sin(), -1.5 * (4.0 * t).cos());
        let acceleration = |t: f64| Vector3::new(2.0, 8.0 * (2.0 * t).cos(), 6.0 * (4.0 * t).sin());
        let gravity = Vector3::new(0.0, 0.0, 9.81);
        let c_nb = |t: f64| crate::rotation::c_nb_from_euler(roll(t), 0.0, 0.0);
        let force = |t: f64| c_nb(t).transpose() * (acceleration(t) - gravity);
        let (bias, lag_s) = (Vector3::new(0.3, -0.2, 0.4), 0.18);
        let samples: Vec<ImuSample> = (0..400)
            .map(|i| {
                let t_s = f64::from(i) * 0.005;
                let gyro = Vector3::new(2.4 * (3.0 * t_s).cos(), 0.0, 0.0);
                ImuSample { t_s, gyro, accel: force(t_s) + bias, temperature_degc: None }
            })
            .collect();
        let rates = ForceRates::new(&samples, SampleKind::Point);
        for t_s in [0.4, 0.9, 1.4] {
            let x = FixInstant {
                t_s,
                a_n: acceleration(t_s),
                c_nb: c_nb(t_s),
                ..crate::effects::testing::fix_instant()
            };
            let older = rates.older(lag_s, &x, &(force(t_s) + bias), &force(t_s));
            let exact = velocity(t_s - lag_s) - velocity(t_s);
            assert!((older.change - exact).norm() < 5e-3, "{t_s}: {} {exact}", older.change);
        }
    }
}
