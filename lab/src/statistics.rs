//! Small statistics shared by the studies.

/// Root mean square of each component.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rms3 {
    sum: [f64; 3],
    n: u64,
}

impl Rms3 {
    /// Adds one error.
    pub fn add(&mut self, error: [f64; 3]) {
        for (s, e) in self.sum.iter_mut().zip(error) {
            *s += e * e;
        }
        self.n += 1;
    }

    /// The result; zero when nothing was added.
    pub fn value(&self) -> [f64; 3] {
        self.sum.map(|s| if self.n == 0 { 0.0 } else { (s / self.n as f64).sqrt() })
    }

    /// How many were added.
    pub fn count(&self) -> u64 {
        self.n
    }
}

/// 95 % interval of a share (Wilson 1927); everything when nothing was counted.
pub fn wilson_95(hits: usize, of: usize) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let (z, n) = (1.959_964_f64, of as f64);
    let share = hits as f64 / n;
    let middle = share + z * z / (2.0 * n);
    let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    [middle - half, middle + half].map(|v| (v / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

/// Mean, median and largest of some values; NaN where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Median, the upper one of two.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

/// Of these values.
pub fn summary(values: impl Iterator<Item = f64>) -> Summary {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let at = |k: usize| sorted.get(k).copied().unwrap_or(f64::NAN);
    Summary { mean: sorted.iter().sum::<f64>() / n as f64, median: at(n / 2), max: at(n.wrapping_sub(1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_agrees_with_the_textbook() {
        // Agresti & Coull 1998: 0 of 10 gives (0, 0.278), 5 of 10 gives (0.237, 0.763).
        let [low, high] = wilson_95(0, 10);
        assert!(low < 1e-12 && (high - 0.278).abs() < 1e-3, "{low} {high}");
        let [low, high] = wilson_95(5, 10);
        assert!((low - 0.237).abs() < 1e-3 && (high - 0.763).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn a_summary_has_mean_median_and_largest() {
        let s = summary([4.0, 1.0, 10.0].into_iter());
        assert_eq!(s, Summary { mean: 5.0, median: 4.0, max: 10.0 });
        assert!(summary(std::iter::empty()).median.is_nan());
    }
}
