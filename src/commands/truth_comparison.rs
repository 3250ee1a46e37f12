//! How far the estimated attitude is from the truth that a simulated autopilot sends along.
//!
//! The autopilot's sensor filter delays its samples by some 12 ms, so the estimate is of a slightly older attitude than
//! the truth beside it. One constant shift is searched for and told; what is left is the error.

use crate::sensors::truth::SimTruth;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Largest shift that is looked for, s.
const MAX_SHIFT_S: f64 = 0.02;
const SHIFT_STEP_S: f64 = 0.0005;
/// Truth further apart than this is not interpolated, s.
const MAX_SPACING_S: f64 = 0.15;

/// The result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TruthResult {
    /// Compared from this time after the first sample on, s.
    pub from_s: f64,
    /// Attitudes compared.
    pub samples: usize,
    /// By how much the estimate lags behind the truth, s.
    pub time_shift_s: f64,
    /// RMS error of roll, pitch, yaw after the shift, deg.
    pub attitude_rms_deg: [f64; 3],
    /// The same without the shift, deg.
    pub attitude_rms_unshifted_deg: [f64; 3],
}

/// Collects both.
#[derive(Debug, Clone)]
pub struct TruthComparison {
    from_s: f64,
    start_s: Option<f64>,
    truth: Vec<(f64, [f64; 3])>,
    estimate: Vec<(f64, [f64; 3])>,
}

impl TruthComparison {
    /// Compares from this many seconds after the start on.
    pub fn new(from_s: f64) -> Self {
        Self { from_s, start_s: None, truth: Vec::new(), estimate: Vec::new() }
    }

    /// Tells the time; the first one is the start.
    pub fn begin(&mut self, now_s: Option<f64>) {
        self.start_s = self.start_s.or(now_s);
    }

    /// Takes the truth and the estimate beside it.
    pub fn push(&mut self, truth: &SimTruth, estimate: Option<(f64, [f64; 3])>) {
        let from = self.start_s.map_or(f64::INFINITY, |s| s + self.from_s);
        // A reboot starts the truth anew; what is behind it cannot be interpolated with what was before.
        if self.truth.last().is_some_and(|(t, _)| truth.t_s < *t) {
            self.truth.clear();
            self.estimate.clear();
        }
        if truth.t_s >= from {
            self.truth.push((truth.t_s, truth.roll_pitch_yaw));
            self.estimate.extend(estimate.filter(|(t, _)| *t >= from));
        }
    }

    /// The result; nothing where there is no truth or no estimate.
    pub fn result(&self) -> Option<TruthResult> {
        let steps = (MAX_SHIFT_S / SHIFT_STEP_S).round() as i32;
        let best = (-steps..=steps)
            .map(|k| f64::from(k) * SHIFT_STEP_S)
            .filter_map(|shift| self.errors(shift).map(|(_, ms)| (shift, ms.iter().sum::<f64>())))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let (samples, mean_squares) = self.errors(best.0)?;
        let (_, unshifted) = self.errors(0.0)?;
        let degrees = |ms: [f64; 3]| ms.map(|v| v.sqrt().to_degrees());
        Some(TruthResult {
            from_s: self.from_s,
            samples,
            time_shift_s: best.0,
            attitude_rms_deg: degrees(mean_squares),
            attitude_rms_unshifted_deg: degrees(unshifted),
        })
    }

    /// Mean square errors, rad², with the estimate taken for that much older than its time says.
    fn errors(&self, shift_s: f64) -> Option<(usize, [f64; 3])> {
        let (mut n, mut sums, mut at) = (0_usize, [0.0; 3], 0);
        for (t, estimate) in &self.estimate {
            let wanted = t - shift_s;
            while self.truth.get(at + 1).is_some_and(|(next, _)| *next < wanted) {
                at += 1;
            }
            let (Some((t0, a)), Some((t1, b))) = (self.truth.get(at), self.truth.get(at + 1)) else {
                continue;
            };
            let spacing = t1 - t0;
            if !(*t0..=*t1).contains(&wanted) || spacing <= 0.0 || spacing > MAX_SPACING_S {
                continue;
            }
            let share = (wanted - t0) / spacing;
            n += 1;
            for (((sum, e), a), b) in sums.iter_mut().zip(estimate).zip(a).zip(b) {
                let truth = a + share * wrapped(b - a);
                *sum += wrapped(e - truth).powi(2);
            }
        }
        (n > 0).then(|| (n, sums.map(|s| s / n as f64)))
    }
}

/// Into −π to π.
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_lag_is_found_and_taken_out() {
        // Turning through north at a changing rate, estimated 12 ms late and 0.1 deg off in roll.
        let attitude = |t: f64| [0.3 * (2.0 * t).sin(), 0.1 * t.cos(), 3.0 + (0.5 * t).sin()];
        let mut comparison = TruthComparison::new(5.0);
        comparison.begin(Some(100.0));
        for k in 0..3000 {
            let t_s = 100.0 + f64::from(k) * 0.02;
            let roll_pitch_yaw = attitude(t_s).map(wrapped);
            let truth =
                SimTruth { t_s, roll_pitch_yaw, velocity_ned: [0.0; 3], lat_lon_deg: [0.0; 2], alt_m: 0.0 };
            let mut estimate = attitude(t_s - 0.012).map(wrapped);
            estimate[0] += 0.1_f64.to_radians();
            comparison.push(&truth, Some((t_s, estimate)));
        }
        let result = comparison.result().unwrap();
        assert!((result.time_shift_s - 0.012).abs() < 0.0006, "{result:?}");
        assert!((result.attitude_rms_deg[0] - 0.1).abs() < 0.01, "{result:?}");
        assert!(result.attitude_rms_deg[1] < 0.005 && result.attitude_rms_deg[2] < 0.01, "{result:?}");
        assert!(result.attitude_rms_unshifted_deg[2] > 0.1, "{result:?}");
        assert!((2700..2760).contains(&result.samples), "{result:?}");
    }

    #[test]
    fn without_truth_there_is_no_result() {
        assert_eq!(TruthComparison::new(0.0).result(), None);
    }
}
