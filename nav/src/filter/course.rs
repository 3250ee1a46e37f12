//! Whether a vehicle goes straight: then its axes stay, whatever estimates and noise make of the rate.
//!
//! What the filter knows of tilt and accelerometer biases together it knows in body axes that do not turn. Turned with every new estimate
//! of the gyro biases, or recentred with every correction, a thousand fixes would separate the two, and the heading
//! (first-estimates Jacobians, Huang, Mourikis & Roumeliotis 2010). A second in which one sample of noise passes for a turn is enough
//! for that in hours of smooth flight, so the rate is judged by its mean over as long as it is known to be steady, and a
//! straight course lasts through a noisy second.

use super::regressor::Regressor;
use super::unseen::GAP_S;
use nalgebra::Vector3;

/// A turn lasts about so long, s.
const LASTING_S: f64 = 1.0;
/// A course that was straight stays so for this long while noise masks whether it is, s.
const HIDDEN_S: f64 = 3.0;

/// The rate over the last seconds, by two readings: with the present estimates, and with those of the last real motion. A new estimate
/// makes no turn of a straight course, nor does an old one that was wrong.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    /// Rates below these are within their errors, rad/s.
    pub(super) no_turn_below: Vector3<f64>,
    slow: [Vector3<f64>; 2],
    /// When it was last seen to be straight, s.
    straight_s: Option<f64>,
    is_straight: bool,
}

impl Course {
    /// Whether it is straight.
    pub(super) fn is_straight(&self) -> bool {
        self.is_straight
    }

    /// The rate of the next sample at `t_s`, `dt` after the last one, rad/s. Noise reaches to `band` in one sample and less in a mean.
    pub(super) fn take(
        &mut self,
        (t_s, dt): (f64, f64),
        rate: &Vector3<f64>,
        regressor: &Regressor,
        band: f64,
    ) {
        let held = regressor.held_rate();
        for (slow, rate) in self.slow.iter_mut().zip([*rate, rate - held]) {
            *slow += (rate - *slow) * (dt / LASTING_S).min(1.0);
        }
        let turns = |means: &[Vector3<f64>; 2], over_s: &Vector3<f64>| {
            let limit = |k: usize| self.no_turn_below[k] + band * (dt / over_s[k]).min(1.0).sqrt();
            means.iter().all(|mean| (0..3).any(|k| mean[k].abs() >= limit(k)))
        };
        if dt > GAP_S || turns(&self.slow, &Vector3::from_element(2.0 * LASTING_S)) {
            self.straight_s = None;
        } else if regressor.is_quiet() {
            let steady = regressor.motion().rate;
            self.straight_s = (!turns(&[steady + held, steady], &regressor.rate_steady_s())).then_some(t_s);
        }
        self.is_straight = self.straight_s.is_some_and(|since| t_s - since < HIDDEN_S);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanization::Motion;

    const DT: f64 = 0.02;
    const BAND: f64 = 0.006;

    /// A minute of noise about a rate with one sample far off every eight seconds; whether the course is straight, sample by sample.
    fn minute(rate: f64, bursts: f64) -> Vec<bool> {
        let mut course = Course { no_turn_below: Vector3::from_element(2e-4), ..Course::default() };
        let mut regressor = Regressor::default();
        let motion = |z: f64| Motion { rate: Vector3::new(0.0, 0.0, z), force: Vector3::zeros() };
        regressor.start(&motion(rate));
        (0..3000)
            .map(|k| {
                let noise = if k % 400 == 399 { bursts } else { [0.001, -0.001, 0.0005, -0.0005][k % 4] };
                let motion = motion(rate + noise);
                regressor.take(&motion, (BAND, 1.0), DT);
                course.take((k as f64 * DT, DT), &motion.rate, &regressor, BAND);
                course.is_straight()
            })
            .collect()
    }

    #[test]
    fn a_sample_of_noise_is_no_turn() {
        assert!(minute(0.0, 1.2 * BAND).iter().skip(100).all(|s| *s));
    }

    #[test]
    fn an_estimate_of_the_bias_that_goes_wrong_is_no_turn() {
        let (mut course, mut regressor) = (Course::default(), Regressor::default());
        course.no_turn_below = Vector3::from_element(2e-4);
        let motion = |z: f64| Motion { rate: Vector3::new(0.0, 0.0, z), force: Vector3::zeros() };
        regressor.start(&motion(0.0));
        let mut shown = 0.0;
        for k in 0..6000 {
            if k % 10 == 0 && shown < 5e-3 {
                regressor.estimate_changed(&motion(shown), &motion(shown + 1e-5));
                shown += 1e-5;
            }
            regressor.take(&motion(shown), (BAND, 1.0), DT);
            course.take((f64::from(k) * DT, DT), &motion(shown).rate, &regressor, BAND);
            assert!(course.is_straight() || k < 100, "{k}");
        }
        assert!(shown >= 5e-3);
    }

    #[test]
    fn a_turn_that_is_slow_is_one_when_it_lasts() {
        // Two degrees in a minute.
        let slow = minute(6e-4, 0.0);
        assert!(slow.iter().skip(2500).all(|s| !*s));
        let turn = minute(0.02, 0.0);
        assert!(turn.iter().skip(100).all(|s| !*s));
    }
}
