//! Two attitudes of one vehicle laid over each other: an estimate and the truth, or an estimate and the autopilot's own.
//!
//! Their stamps never agree to the millisecond (an autopilot's sensor filter alone delays its samples by some 12 ms, 0.7 deg
//! at 60 deg/s), so one constant shift is searched for and told; what is left is the difference.

use gaware_nav::rotation::wrap_pi;

const SHIFT_STEP_S: f64 = 0.0005;
/// References further apart than this are not interpolated, s.
const MAX_SPACING_S: f64 = 0.15;

/// Roll, pitch, yaw, rad, at a time, s.
type Attitude = (f64, [f64; 3]);

/// An estimate and a reference over time.
#[derive(Debug, Clone, Default)]
pub struct Attitudes {
    estimate: Vec<Attitude>,
    reference: Vec<Attitude>,
    max_spacing_s: Option<f64>,
}

impl Attitudes {
    /// Interpolates references up to so many seconds apart.
    pub fn with_spacing(max_spacing_s: f64) -> Self {
        Self { max_spacing_s: Some(max_spacing_s), ..Self::default() }
    }

    /// Takes an estimate. Times must not go back; use [`Attitudes::clear`] when they do.
    pub fn push_estimate(&mut self, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        self.estimate.push((t_s, roll_pitch_yaw));
    }

    /// Takes a reference.
    pub fn push_reference(&mut self, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        self.reference.push((t_s, roll_pitch_yaw));
    }

    /// Time of the newest reference, s.
    pub fn newest_reference_s(&self) -> Option<f64> {
        self.reference.last().map(|(t, _)| *t)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.estimate.clear();
        self.reference.clear();
    }

    /// By how much the estimate lags behind the reference, s: the shift of at most `max_shift_s` that leaves the smallest
    /// differences. Nothing where the two never overlap.
    pub fn best_shift_s(&self, max_shift_s: f64) -> Option<f64> {
        let steps = (max_shift_s / SHIFT_STEP_S).round() as i32;
        (-steps..=steps)
            .map(|k| f64::from(k) * SHIFT_STEP_S)
            .filter_map(|shift| self.mean_squares(shift).map(|(_, ms)| (shift, ms.iter().sum::<f64>())))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(shift, _)| shift)
    }

    /// Number of differences and their mean squares in roll, pitch and yaw, rad².
    pub fn mean_squares(&self, shift_s: f64) -> Option<(usize, [f64; 3])> {
        let (mut n, mut sums) = (0_usize, [0.0; 3]);
        for (_, difference) in self.differences(shift_s) {
            n += 1;
            for (sum, d) in sums.iter_mut().zip(difference) {
                *sum += d * d;
            }
        }
        (n > 0).then(|| (n, sums.map(|s| s / n as f64)))
    }

    /// Estimate less reference, rad, with the estimate taken for that much older than its time says.
    pub fn differences(&self, shift_s: f64) -> impl Iterator<Item = Attitude> + '_ {
        let mut at = 0;
        let max_spacing_s = self.max_spacing_s.unwrap_or(MAX_SPACING_S);
        self.estimate.iter().filter_map(move |(t, estimate)| {
            let wanted = t - shift_s;
            while self.reference.get(at + 1).is_some_and(|(next, _)| *next < wanted) {
                at += 1;
            }
            let ((t0, a), (t1, b)) = (self.reference.get(at)?, self.reference.get(at + 1)?);
            let spacing = t1 - t0;
            if !(*t0..=*t1).contains(&wanted) || spacing <= 0.0 || spacing > max_spacing_s {
                return None;
            }
            let share = (wanted - t0) / spacing;
            let mut difference = [0.0; 3];
            for (((d, e), a), b) in difference.iter_mut().zip(estimate).zip(a).zip(b) {
                *d = wrap_pi(e - a - share * wrap_pi(b - a));
            }
            Some((*t, difference))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn differences_wrap_at_south_and_gaps_are_left_out() {
        let mut both = Attitudes::default();
        for k in 0..20 {
            let t = f64::from(k) * 0.1;
            // Turning through south; nothing was heard of the reference from 0.5 to 1.0 s.
            if !(6..10).contains(&k) {
                both.push_reference(t, [0.0, 0.0, wrap_pi(PI - 0.05 + 0.1 * t)]);
            }
            both.push_estimate(t, [0.01, 0.0, wrap_pi(PI - 0.05 + 0.1 * t + 0.02)]);
        }
        let all: Vec<_> = both.differences(0.0).collect();
        assert!((14..=17).contains(&all.len()), "{}", all.len());
        assert!(all.iter().all(|(_, d)| (d[0] - 0.01).abs() < 1e-9 && (d[2] - 0.02).abs() < 1e-9), "{all:?}");
    }
}
