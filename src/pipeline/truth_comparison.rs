//! How far the estimated attitude is from the truth that a simulated autopilot sends along.

use crate::attitudes::Attitudes;
use crate::sensors::truth::SimTruth;
use schemars::JsonSchema;
use serde::Serialize;

/// Largest shift that is searched, s.
const MAX_SHIFT_S: f64 = 0.02;

/// The result.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
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
    attitudes: Attitudes,
}

impl TruthComparison {
    /// Compares from this many seconds after the start on.
    pub fn new(from_s: f64) -> Self {
        Self { from_s, start_s: None, attitudes: Attitudes::default() }
    }

    /// Gives the time; the first one is the start.
    pub fn begin(&mut self, now_s: Option<f64>) {
        self.start_s = self.start_s.or(now_s);
    }

    /// Whether an estimate beside this truth would be of use.
    pub fn wants(&self, truth: &SimTruth) -> bool {
        self.start_s.is_some_and(|start| truth.t_s >= start + self.from_s)
    }

    /// Takes the truth and the estimate beside it.
    pub fn push(&mut self, truth: &SimTruth, estimate: Option<(f64, [f64; 3])>) {
        let from = self.start_s.map_or(f64::INFINITY, |s| s + self.from_s);
        // A reboot starts the truth anew; what is behind it cannot be interpolated with what was before.
        if self.attitudes.newest_reference_s().is_some_and(|t| truth.t_s < t) {
            self.attitudes.clear();
        }
        if truth.t_s >= from {
            self.attitudes.push_reference(truth.t_s, truth.roll_pitch_yaw);
            if let Some((t, estimate)) = estimate.filter(|(t, _)| *t >= from) {
                self.attitudes.push_estimate(t, estimate);
            }
        }
    }

    /// The result; nothing where there is no truth or no estimate.
    pub fn result(&self) -> Option<TruthResult> {
        let time_shift_s = self.attitudes.best_shift_s(MAX_SHIFT_S)?;
        let (samples, mean_squares) = self.attitudes.mean_squares(time_shift_s)?;
        let (_, unshifted) = self.attitudes.mean_squares(0.0)?;
        let degrees = |ms: [f64; 3]| ms.map(|v| v.sqrt().to_degrees());
        Some(TruthResult {
            from_s: self.from_s,
            samples,
            time_shift_s,
            attitude_rms_deg: degrees(mean_squares),
            attitude_rms_unshifted_deg: degrees(unshifted),
        })
    }
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::{cos, sin};

    use super::*;

    #[test]
    fn a_constant_lag_is_found_and_taken_out() {
        // Turning through north at a changing rate, estimated 12 ms late and 0.1 deg off in roll.
        let attitude = |t: f64| [0.3 * sin(2.0 * t), 0.1 * cos(t), 3.0 + sin(0.5 * t)];
        let mut comparison = TruthComparison::new(5.0);
        comparison.begin(Some(100.0));
        for k in 0..3000 {
            let t_s = 100.0 + f64::from(k) * 0.02;
            let roll_pitch_yaw = attitude(t_s);
            let truth =
                SimTruth { t_s, roll_pitch_yaw, velocity_ned: [0.0; 3], lat_lon_deg: [0.0; 2], alt_m: 0.0 };
            let mut estimate = attitude(t_s - 0.012);
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
