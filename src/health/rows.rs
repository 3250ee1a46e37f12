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
