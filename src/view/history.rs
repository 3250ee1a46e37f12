//! The last minutes, so that a page opened or loaded again in flight has its charts, track and events at once.

use crate::engine::events::{Event, EventDetector};
use crate::engine::snapshot::Snapshot;
use serde::Serialize;
use std::collections::VecDeque;

/// Seconds between two points.
const STEP_S: f64 = 1.0;
/// Points kept: fifteen minutes.
const POINTS: usize = 900;
/// Events kept.
const EVENTS: usize = 60;

/// Names of the columns of a point.
const COLUMNS: [&str; 5] =
    ["elapsed_s", "specific_force_g", "normalised_innovation", "g_sigma_deg_per_h_per_g", "lat_lon_deg"];

/// One point of the charts: time, specific force, innovations, sigmas of G by rows, latitude and longitude.
type Point = (f64, [f64; 3], [f64; 6], [[f64; 3]; 3], [f64; 2]);

/// What `GET /api/v1/history` returns.
#[derive(Debug, Clone, Serialize)]
pub struct History {
    columns: [&'static str; 5],
    points: VecDeque<Point>,
    events: VecDeque<Event>,
    #[serde(skip)]
    detector: EventDetector,
}

impl Default for History {
    fn default() -> Self {
        Self {
            columns: COLUMNS,
            points: VecDeque::new(),
            events: VecDeque::new(),
            detector: EventDetector::default(),
        }
    }
}

impl History {
    /// A copy with at most that many of the newest points, to be sent without holding the lock.
    pub fn newest(&self, points: Option<usize>) -> Self {
        let skip = points.map_or(0, |n| self.points.len().saturating_sub(n));
        Self {
            columns: COLUMNS,
            points: self.points.iter().skip(skip).copied().collect(),
            events: self.events.clone(),
            detector: EventDetector::default(),
        }
    }

    /// Takes the newest snapshot.
    pub fn feed(&mut self, s: &Snapshot) {
        let last_s = self.points.back().map_or(f64::NEG_INFINITY, |p| p.0);
        if s.elapsed_s < last_s {
            // The engine started again: the past belongs to another flight.
            *self = Self::default();
        }
        self.events.extend(self.detector.feed(s));
        while self.events.len() > EVENTS {
            self.events.pop_front();
        }
        if s.elapsed_s < last_s || s.elapsed_s >= last_s + STEP_S {
            self.points.push_back(point(s));
        }
        while self.points.len() > POINTS {
            self.points.pop_front();
        }
    }
}

fn point(s: &Snapshot) -> Point {
    // Fewer digits make the answer a third as long; none of them would show.
    let short = |x: f64| (x * 1e4).round() / 1e4;
    let place = |x: f64| (x * 1e7).round() / 1e7;
    (
        short(s.elapsed_s),
        s.motion.specific_force_g.map(short),
        s.consistency.last_normalised_innovation.map(short),
        s.estimate.g_sensitivity_deg_per_h_per_g.sigma.map(|row| row.map(short)),
        [place(s.motion.lat_deg), place(s.motion.lon_deg)],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elapsed_s: f64) -> Snapshot {
        Snapshot { elapsed_s, ..Snapshot::default() }
    }

    #[test]
    fn keeps_one_point_a_second_and_no_more_than_it_may() {
        let mut h = History::default();
        for step in 0..20_000 {
            h.feed(&at(f64::from(step) * 0.1));
        }
        assert_eq!(h.points.len(), POINTS);
        assert!(h.points.back().unwrap().0 > 1998.0);
    }

    #[test]
    fn a_new_start_forgets_the_flight_before() {
        let mut h = History::default();
        for step in 0..100 {
            h.feed(&at(f64::from(step)));
        }
        h.feed(&at(0.0));
        assert_eq!(h.points.len(), 1);
        assert_eq!(h.events.len(), 1);
    }
}
