//! How far the estimated attitude is from the truth that a simulated autopilot sends along, or has in its log.

use crate::attitudes::{Attitude, Attitudes, MAX_SPACING_S, difference};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

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
    /// Share of the errors of roll, pitch, yaw, as they are, within 2 of the estimate's sigmas.
    pub within_2_sigma: Option<[f64; 3]>,
}

/// An estimate beside the truth: its time, s, and roll, pitch, yaw with their sigmas, rad.
pub type Estimated = (f64, [f64; 3], Option<[f64; 3]>);

/// Collects both.
#[derive(Debug, Clone)]
pub struct TruthComparison {
    from_s: f64,
    start_s: Option<f64>,
    attitudes: Attitudes,
    /// The truth before.
    last: Option<Attitude>,
    /// Estimates with sigmas, and of these how many have roll, pitch, yaw within 2 of them.
    judged: (usize, [usize; 3]),
}

impl TruthComparison {
    /// Compares from this many seconds after the start on.
    pub fn new(from_s: f64) -> Self {
        Self { from_s, start_s: None, attitudes: Attitudes::default(), last: None, judged: (0, [0; 3]) }
    }

    /// Gives the time; the first one is the start.
    pub fn begin(&mut self, now_s: Option<f64>) {
        self.start_s = self.start_s.or(now_s);
    }

    /// Whether an estimate beside a truth of this time would be of use.
    pub fn wants(&self, t_s: f64) -> bool {
        self.start_s.is_some_and(|start| t_s >= start + self.from_s)
    }

    /// Takes the true roll, pitch, yaw, rad, and the estimate beside it.
    pub fn push(&mut self, t_s: f64, truth: [f64; 3], estimate: Option<Estimated>) {
        // A reboot starts the truth anew; what is behind it cannot be interpolated with what was before.
        if self.attitudes.newest_reference_s().is_some_and(|t| t_s < t) {
            self.attitudes.clear();
            self.last = None;
        }
        if !self.wants(t_s) {
            return;
        }
        self.attitudes.push_reference(t_s, truth);
        if let Some(estimate) = estimate.filter(|e| self.wants(e.0)) {
            self.attitudes.push_estimate(estimate.0, estimate.1);
            self.judge(t_s, truth, estimate);
        }
        self.last = Some((t_s, truth));
    }

    /// Counts an estimate between the truth before and this one.
    fn judge(&mut self, t_s: f64, truth: [f64; 3], (at_s, estimate, sigmas): Estimated) {
        let (Some(before), Some(sigmas)) = (self.last, sigmas) else { return };
        let neighbours = [&before, &(t_s, truth)];
        let Some(error) = difference(neighbours, (at_s, estimate), MAX_SPACING_S) else { return };
        self.judged.0 += 1;
        for ((within, error), sigma) in self.judged.1.iter_mut().zip(error).zip(sigmas) {
            *within += usize::from(error.abs() < 2.0 * sigma);
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
            within_2_sigma: (self.judged.0 > 0)
                .then(|| self.judged.1.map(|w| w as f64 / self.judged.0 as f64)),
        })
    }
}

/// Figures of roll, pitch and yaw of a result in a document.
pub fn figures(result: &Value, name: &str) -> Option<[f64; 3]> {
    let all: Vec<f64> = result.get(name)?.as_array()?.iter().filter_map(Value::as_f64).collect();
    all.try_into().ok()
}

/// The shares within 2 sigma of a result in a document, in words.
pub fn shares(result: &Value) -> Option<String> {
    let [roll, pitch, yaw] = figures(result, "within_2_sigma")?.map(|share| 100.0 * share);
    Some(format!("within 2 sigma of it roll {roll:.1} %, pitch {pitch:.1} %, yaw {yaw:.1} %"))
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
            let mut estimate = attitude(t_s - 0.012);
            estimate[0] += 0.1_f64.to_radians();
            // Of roll it says half of what it is off, of pitch enough, of yaw far too much.
            comparison.push(t_s, roll_pitch_yaw, Some((t_s, estimate, Some([1e-4, 1e-3, 1.0]))));
        }
        let result = comparison.result().unwrap();
        assert!((result.time_shift_s - 0.012).abs() < 0.0006, "{result:?}");
        assert!((result.attitude_rms_deg[0] - 0.1).abs() < 0.01, "{result:?}");
        assert!(result.attitude_rms_deg[1] < 0.005 && result.attitude_rms_deg[2] < 0.01, "{result:?}");
        assert!(result.attitude_rms_unshifted_deg[2] > 0.1, "{result:?}");
        assert!((2700..2760).contains(&result.samples), "{result:?}");
        let [roll, pitch, yaw] = result.within_2_sigma.unwrap();
        assert!(roll < 0.1 && pitch > 0.99 && yaw == 1.0, "{result:?}");
    }

    #[test]
    fn without_truth_there_is_no_result() {
        assert_eq!(TruthComparison::new(0.0).result(), None);
    }
}
