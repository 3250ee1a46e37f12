//! Two attitudes of one vehicle laid over each other: an estimate and the truth, or an estimate and the autopilot's own.
//!
//! Their stamps never agree to the millisecond (an autopilot's sensor filter alone delays its samples by some 12 ms, 0.7 deg
//! at 60 deg/s), so one constant shift is searched for and reported; what is left is the difference.

use gaware_nav::rotation::wrap_pi;

const SHIFT_STEP_S: f64 = 0.0005;
/// The shift is searched for with so many estimates at most.
const FOR_SHIFT: usize = 2000;
/// Of a long flight every second, fourth, … piece of this length is kept, s, …
const PIECE_S: f64 = 2.0;
/// … so that there are no more attitudes of either kind than this (2 MB).
const MOST: usize = 1 << 16;
/// References further apart than this are not interpolated, s.
pub const MAX_SPACING_S: f64 = 0.15;

/// Roll, pitch, yaw, rad, at a time, s.
pub type Attitude = (f64, [f64; 3]);

/// An estimate and a reference over time.
#[derive(Debug, Clone, Default)]
pub struct Attitudes {
    estimate: Vec<Attitude>,
    reference: Vec<Attitude>,
    max_spacing_s: Option<f64>,
    newest_reference_s: Option<f64>,
    /// One of 2^thinned pieces is kept.
    thinned: u32,
}

impl Attitudes {
    /// Interpolates references up to so many seconds apart.
    pub fn with_spacing(max_spacing_s: f64) -> Self {
        Self { max_spacing_s: Some(max_spacing_s), ..Self::default() }
    }

    /// Takes an estimate. Times must not go back; use [`Attitudes::clear`] when they do.
    pub fn push_estimate(&mut self, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        if self.keeps(t_s) {
            self.estimate.push((t_s, roll_pitch_yaw));
            self.thin_out();
        }
    }

    /// Takes a reference.
    pub fn push_reference(&mut self, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        self.newest_reference_s = Some(t_s);
        if self.keeps(t_s) {
            self.reference.push((t_s, roll_pitch_yaw));
            self.thin_out();
        }
    }

    fn keeps(&self, t_s: f64) -> bool {
        ((t_s / PIECE_S).floor() as i64).rem_euclid(1 << self.thinned) == 0
    }

    /// Keeps the memory bounded; whole pieces go, so that neighbours stay neighbours in what is left.
    fn thin_out(&mut self) {
        if self.estimate.len().max(self.reference.len()) <= MOST {
            return;
        }
        self.thinned = (self.thinned + 1).min(32);
        let (mut estimate, mut reference) =
            (std::mem::take(&mut self.estimate), std::mem::take(&mut self.reference));
        estimate.retain(|(t, _)| self.keeps(*t));
        reference.retain(|(t, _)| self.keeps(*t));
        (self.estimate, self.reference) = (estimate, reference);
    }

    /// Time of the newest reference, s.
    pub fn newest_reference_s(&self) -> Option<f64> {
        self.newest_reference_s
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.estimate.clear();
        self.reference.clear();
        self.newest_reference_s = None;
        self.thinned = 0;
    }

    /// By how much the estimate lags behind the reference, s: the shift of at most `max_shift_s` that leaves the smallest
    /// differences. Nothing where the two never overlap.
    pub fn best_shift_s(&self, max_shift_s: f64) -> Option<f64> {
        let steps = (max_shift_s / SHIFT_STEP_S).round() as i32;
        let every = self.estimate.len().div_ceil(FOR_SHIFT).max(1);
        (-steps..=steps)
            .map(|k| f64::from(k) * SHIFT_STEP_S)
            .filter_map(|shift| {
                self.mean_squares_of(shift, every).map(|(_, ms)| (shift, ms.iter().sum::<f64>()))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(shift, _)| shift)
    }

    /// Number of differences and their mean squares in roll, pitch and yaw, rad².
    pub fn mean_squares(&self, shift_s: f64) -> Option<(usize, [f64; 3])> {
        self.mean_squares_of(shift_s, 1)
    }

    fn mean_squares_of(&self, shift_s: f64, every: usize) -> Option<(usize, [f64; 3])> {
        let (mut n, mut sums) = (0_usize, [0.0; 3]);
        for (_, difference) in self.differences_of(shift_s, every) {
            n += 1;
            for (sum, d) in sums.iter_mut().zip(difference) {
                *sum += d * d;
            }
        }
        (n > 0).then(|| (n, sums.map(|s| s / n as f64)))
    }

    /// Estimate less reference, rad, with the estimate taken for that much older than its time says.
    pub fn differences(&self, shift_s: f64) -> impl Iterator<Item = Attitude> + '_ {
        self.differences_of(shift_s, 1)
    }

    /// The same of one in so many estimates.
    fn differences_of(&self, shift_s: f64, every: usize) -> impl Iterator<Item = Attitude> + '_ {
        let mut at = 0;
        let max_spacing_s = self.max_spacing_s.unwrap_or(MAX_SPACING_S);
        self.estimate.iter().step_by(every).filter_map(move |(t, estimate)| {
            let wanted = t - shift_s;
            while self.reference.get(at + 1).is_some_and(|(next, _)| *next < wanted) {
                at += 1;
            }
            let neighbours = [self.reference.get(at)?, self.reference.get(at + 1)?];
            let difference = difference(neighbours, (wanted, *estimate), max_spacing_s)?;
            Some((*t, difference))
        })
    }
}

/// An estimate less what lies between two references, rad; nothing outside them, or where they are further apart than this, s.
pub fn difference(
    [(t0, a), (t1, b)]: [&Attitude; 2],
    (t_s, estimate): Attitude,
    max_spacing_s: f64,
) -> Option<[f64; 3]> {
    let spacing = t1 - t0;
    if !(*t0..=*t1).contains(&t_s) || spacing <= 0.0 || spacing > max_spacing_s {
        return None;
    }
    let share = (t_s - t0) / spacing;
    let mut difference = [0.0; 3];
    for (((d, e), a), b) in difference.iter_mut().zip(estimate).zip(a).zip(b) {
        *d = wrap_pi(e - a - share * wrap_pi(b - a));
    }
    Some(difference)
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::{cos, sin};

    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn ten_hours_take_no_more_memory_than_one_and_the_shift_is_still_found() {
        let attitude = |t: f64| [0.3 * sin(2.0 * t), 0.1 * cos(t), wrap_pi(0.5 * t)];
        let mut both = Attitudes::default();
        for k in 0..36_000 * 20 {
            let t = f64::from(k) * 0.05;
            both.push_reference(t, attitude(t));
            both.push_estimate(t, attitude(t - 0.01));
        }
        assert!(both.estimate.len() <= MOST && both.reference.len() <= MOST);
        assert!((both.best_shift_s(0.02).unwrap() - 0.01).abs() < 1e-9);
        let (n, ms) = both.mean_squares(0.01).unwrap();
        assert!(n > MOST / 4 && ms.iter().all(|v| v.sqrt() < 1e-3), "{n} {ms:?}");
        let last = both.differences(0.01).last().unwrap().0;
        assert!(last > 35_000.0, "{last}");
    }

    #[test]
    fn differences_wrap_at_south_and_gaps_are_left_out() {
        let mut both = Attitudes::default();
        for k in 0..20 {
            let t = f64::from(k) * 0.1;
            // Turning through south; nothing was received of the reference from 0.5 to 1.0 s.
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
