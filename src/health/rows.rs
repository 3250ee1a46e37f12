//! Values above a limit, in a row.

/// Values further apart than this are not a row, s.
const SPACING_S: f64 = 1.5;

/// A stretch in which every value is above a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// The first, s.
    pub(super) start: f64,
    /// The last, s.
    pub(super) end: f64,
    /// The largest value.
    pub(super) peak: f64,
}

impl Row {
    pub(super) fn length_s(&self) -> f64 {
        self.end - self.start
    }
}

/// The rows of values above a limit, with their times in order, s.
pub(super) fn rows(values: impl Iterator<Item = (f64, f64)>, limit: f64) -> Vec<Row> {
    let mut all: Vec<Row> = Vec::new();
    let mut open = false;
    for (t, value) in values {
        let above = value > limit;
        match all.last_mut().filter(|row| open && above && t - row.end < SPACING_S) {
            Some(row) => (row.end, row.peak) = (t, row.peak.max(value)),
            None if above => all.push(Row { start: t, end: t, peak: value }),
            None => {}
        }
        open = above;
    }
    all
}

/// The window of so many seconds in which values are above a limit for the longest, in sum: from the first of them on; what swings is above it again
/// and again. `None` where no two samples in a row are.
pub(super) fn fullest(
    values: impl Iterator<Item = (f64, f64)>,
    limit: f64,
    window_s: f64,
) -> Option<(Row, f64)> {
    let values: Vec<(f64, f64)> = values.collect();
    let spacing = |k: usize| {
        let before = k.checked_sub(1).and_then(|k| values.get(k)).map_or(f64::NEG_INFINITY, |v| v.0);
        let dt = values[k].0 - before;
        if dt < SPACING_S { dt } else { 0.0 }
    };
    let (mut first, mut whole_s) = (0, 0.0);
    let mut best: Option<(usize, usize, f64)> = None;
    for last in 0..values.len() {
        if values[last].1 <= limit {
            continue;
        }
        whole_s += spacing(last);
        while values[first].0 < values[last].0 - window_s {
            if values[first].1 > limit {
                whole_s -= spacing(first);
            }
            first += 1;
        }
        // The first of those that are alike but for rounding.
        if whole_s > best.map_or(0.0, |b| b.2) + 1e-9 {
            best = Some((first, last, whole_s));
        }
    }
    let (first, last, whole_s) = best?;
    let above = || values[first..=last].iter().filter(|v| v.1 > limit);
    let peak = above().map(|v| v.1).fold(limit, f64::max);
    Some((Row { start: above().next()?.0, end: values[last].0, peak }, whole_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_end_at_values_below_and_the_fullest_window_counts_them_again_and_again() {
        let swings = (0..100).map(|k| (0.1 * f64::from(k), if k % 4 < 2 && k > 50 { 3.0 } else { 0.0 }));
        let all = rows(swings.clone(), 1.0);
        assert!(all.len() > 5 && all.iter().all(|r| r.length_s() < 0.15), "{all:?}");
        let (row, whole_s) = fullest(swings.clone(), 1.0, 3.0).unwrap();
        assert!((5.1..6.0).contains(&row.start) && row.end - row.start <= 3.0 && row.peak == 3.0, "{row:?}");
        assert!((whole_s - 1.5).abs() < 0.2, "{whole_s}");
        assert_eq!(fullest(swings, 5.0, 3.0), None);
        // Samples that are far apart say nothing of the time between them.
        assert_eq!(fullest([(0.0, 2.0), (60.0, 2.0)].into_iter(), 1.0, 5.0), None);
    }
}
