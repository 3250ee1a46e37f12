//! Small books that the engine keeps: rates, elapsed time, warnings. All in the time of the samples.

use std::collections::VecDeque;

/// A rate is the mean over a window of this length, s.
const WINDOW_S: f64 = 2.0;
/// More warnings than this are not kept; the oldest goes first.
const MAX_WARNINGS: usize = 32;
/// Longer warnings are cut, bytes.
const MAX_WARNING_BYTES: usize = 400;

/// Events per second over the last seconds.
#[derive(Debug, Clone, Copy, Default)]
pub struct RateMeter {
    from_s: Option<f64>,
    count: u64,
    rate_hz: f64,
    settled: bool,
}

impl RateMeter {
    /// Takes the time of an event.
    pub fn push(&mut self, t_s: f64) {
        let from = *self.from_s.get_or_insert(t_s);
        let elapsed = t_s - from;
        if elapsed < 0.0 {
            *self = Self { rate_hz: self.rate_hz, settled: self.settled, ..Self::default() };
            self.from_s = Some(t_s);
            return;
        }
        if elapsed > 0.0 {
            self.count += 1;
        }
        if elapsed >= WINDOW_S || (!self.settled && elapsed > 0.0) {
            self.rate_hz = self.count as f64 / elapsed;
        }
        if elapsed >= WINDOW_S {
            (self.from_s, self.count, self.settled) = (Some(t_s), 0, true);
        }
    }

    /// The rate as it was when the last event came, Hz; zero when that is longer ago than two windows.
    pub fn at(&self, now_s: f64) -> f64 {
        match self.from_s {
            Some(from) if now_s - from <= 2.0 * WINDOW_S => self.rate_hz,
            _ => 0.0,
        }
    }
}

/// Time covered by samples, over restarts of the time base.
#[derive(Debug, Clone, Copy, Default)]
pub struct ElapsedTime {
    span: Option<(f64, f64)>,
    earlier_s: f64,
}

impl ElapsedTime {
    /// Takes the time of a sample.
    pub fn push(&mut self, t_s: f64) {
        let (first, last) = *self.span.get_or_insert((t_s, t_s));
        self.span = Some((first, last.max(t_s)));
    }

    /// The time base starts anew.
    pub fn restart(&mut self) {
        self.earlier_s = self.elapsed_s();
        self.span = None;
    }

    /// The newest time, s.
    pub fn now_s(&self) -> Option<f64> {
        self.span.map(|(_, last)| last)
    }

    /// Seconds covered in all.
    pub fn elapsed_s(&self) -> f64 {
        self.elapsed_at(self.now_s().unwrap_or(0.0))
    }

    /// Seconds covered when the time base shows this, s.
    pub fn elapsed_at(&self, t_s: f64) -> f64 {
        self.earlier_s + self.span.map_or(0.0, |(first, _)| t_s - first)
    }
}

/// What the user should know, each thing once, the newest last.
#[derive(Debug, Clone, Default)]
pub struct Warnings {
    list: VecDeque<String>,
}

impl Warnings {
    /// Adds one; one that is there already becomes the newest.
    pub fn push(&mut self, text: &str) {
        let mut end = text.len().min(MAX_WARNING_BYTES);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let Some(text) = text.get(..end).filter(|t| !t.is_empty()) else { return };
        self.list.retain(|w| w != text);
        if self.list.len() == MAX_WARNINGS {
            self.list.pop_front();
        }
        self.list.push_back(text.to_owned());
    }

    /// Takes one back.
    pub fn forget(&mut self, text: &str) {
        self.list.retain(|w| w != text);
    }

    /// All of them, newest last.
    pub fn to_vec(&self) -> Vec<String> {
        self.list.iter().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_settles_and_goes_when_events_stop() {
        let mut rate = RateMeter::default();
        for k in 0..1000 {
            rate.push(f64::from(k) * 0.005);
        }
        assert!((rate.at(5.0) - 200.0).abs() < 0.5, "{}", rate.at(5.0));
        assert_eq!(rate.at(12.0), 0.0);
    }

    #[test]
    fn a_reboot_does_not_lose_time() {
        let mut time = ElapsedTime::default();
        [100.0, 110.0].into_iter().for_each(|t| time.push(t));
        time.restart();
        [0.0, 5.0].into_iter().for_each(|t| time.push(t));
        assert_eq!((time.elapsed_s(), time.now_s()), (15.0, Some(5.0)));
    }

    #[test]
    fn time_goes_on_over_a_reboot() {
        let mut time = ElapsedTime::default();
        [100.0, 110.0].into_iter().for_each(|t| time.push(t));
        time.restart();
        assert_eq!(time.elapsed_at(3.0), 10.0);
        time.push(3.0);
        assert_eq!(time.elapsed_at(5.0), 12.0);
    }

    #[test]
    fn warnings_are_kept_once_and_not_without_end() {
        let mut warnings = Warnings::default();
        for k in 0..100 {
            warnings.push(&format!("warning {}", k % 50));
        }
        warnings.push("warning 30");
        let list = warnings.to_vec();
        assert_eq!(list.len(), MAX_WARNINGS);
        assert_eq!(list.last().map(String::as_str), Some("warning 30"));
        warnings.push(&"ü".repeat(1000));
        assert!(warnings.to_vec().last().is_some_and(|w| w.len() <= MAX_WARNING_BYTES));
    }
}
