//! Predicted and reached sigmas over time, laid over each other maneuver by maneuver.

use super::Prepared;
use gaware_mission::planner::SigmasAt;
use serde::Serialize;

/// Spacing of the reached sigmas, s.
pub const PERIOD_S: f64 = 2.0;

/// One maneuver, planned and flown, s since the begin of the plan and since take-off.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Span {
    /// In a few words.
    pub words: String,
    /// Planned begin.
    pub planned_start_s: f64,
    /// Planned end.
    pub planned_end_s: f64,
    /// When the item before its first one was reached.
    pub flown_start_s: f64,
    /// When its last item was reached.
    pub flown_end_s: f64,
}

/// Sigmas of all constant states at one time, in the units of screens.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// Since take-off, s.
    pub t_s: f64,
    /// In the order of the names.
    pub sigmas: Vec<f64>,
}

/// Both, over the time of the flight.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Series {
    /// States.
    pub names: Vec<String>,
    /// Their units.
    pub units: Vec<String>,
    /// Their targets.
    pub targets: Vec<f64>,
    /// As predicted, at the time when the same was flown.
    pub predicted: Vec<Point>,
    /// As reached.
    pub reached: Vec<Point>,
    /// Maneuvers that were flown.
    pub maneuvers: Vec<Span>,
}

/// What is written down in flight.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// When which item was reached, counted from 1 without home.
    pub items: Vec<(usize, f64)>,
    /// Time since take-off, and sigma by name.
    pub sigmas: Vec<(f64, Vec<(String, f64)>)>,
    /// Sigma by name where the plan ends; what is flown after that was not promised.
    pub at_end: Vec<(String, f64)>,
}

impl Series {
    /// From the plan and what was written down.
    pub fn of(prepared: &Prepared, log: &Log) -> Self {
        let plan = &prepared.plan;
        let first = plan.sigmas.first().map_or(&[][..], |s| &s.sigmas[..]);
        let maneuvers: Vec<Span> = plan
            .maneuvers
            .iter()
            .filter(|m| log.items.iter().any(|(i, _)| i >= m.items.end()))
            .filter_map(|m| {
                Some(Span {
                    words: m.maneuver.words(&prepared.settings.airframe).short.to_owned(),
                    planned_start_s: m.start_s,
                    planned_end_s: m.end_s,
                    flown_start_s: log.reached(m.items.start().checked_sub(1)?)?,
                    flown_end_s: log.reached(*m.items.end())?,
                })
            })
            .collect();
        let names: Vec<String> = first.iter().map(|s| s.name.to_string()).collect();
        let of_log = |(t_s, sigmas): &(f64, Vec<(String, f64)>)| {
            let sigma = |name: &String| sigmas.iter().find(|(n, _)| n == name).map(|(_, s)| *s);
            Some(Point { t_s: *t_s, sigmas: names.iter().map(sigma).collect::<Option<_>>()? })
        };
        let of_plan = |at: &SigmasAt| Point {
            t_s: when_flown(&maneuvers, at.t_s),
            sigmas: at.sigmas.iter().map(|s| s.sigma).collect(),
        };
        Self {
            units: first.iter().map(|s| s.unit.to_string()).collect(),
            targets: first.iter().map(|s| s.target).collect(),
            predicted: plan.sigmas.iter().map(of_plan).collect(),
            reached: log.sigmas.iter().filter_map(of_log).collect(),
            names,
            maneuvers,
        }
    }

    /// The largest sigma of these states over time; none where the model has none of them.
    pub fn worst(&self, names: &[&str], reached: bool) -> Option<Vec<(f64, f64)>> {
        let at: Vec<usize> = (0..self.names.len())
            .filter(|k| self.names.get(*k).is_some_and(|n| names.contains(&n.as_str())))
            .collect();
        let points = if reached { &self.reached } else { &self.predicted };
        let worst = |p: &Point| at.iter().filter_map(|k| p.sigmas.get(*k)).copied().fold(0.0, f64::max);
        (!at.is_empty() && !points.is_empty()).then(|| points.iter().map(|p| (p.t_s, worst(p))).collect())
    }

    /// Unit and target of the first of these states.
    pub fn unit_and_target(&self, names: &[&str]) -> (String, f64) {
        let found = self.names.iter().position(|n| names.contains(&n.as_str()));
        let unit = found.and_then(|k| self.units.get(k)).cloned().unwrap_or_default();
        (unit, found.and_then(|k| self.targets.get(k)).copied().unwrap_or(0.0))
    }
}

impl Log {
    /// When this item, or the last one before it that can be reached, was.
    fn reached(&self, item: usize) -> Option<f64> {
        self.items.iter().filter(|(i, _)| *i <= item).map(|(_, t)| *t).next_back()
    }
}

/// The time of the flight at which it was where the plan was at this time: linear between the ends of maneuvers.
fn when_flown(maneuvers: &[Span], planned_s: f64) -> f64 {
    let knots = maneuvers
        .iter()
        .flat_map(|m| [(m.planned_start_s, m.flown_start_s), (m.planned_end_s, m.flown_end_s)]);
    let mut before: Option<(f64, f64)> = None;
    for (planned, flown) in knots {
        if planned_s <= planned {
            return match before {
                Some((p, f)) if planned > p => f + (planned_s - p) * (flown - f) / (planned - p),
                _ => flown - (planned - planned_s),
            };
        }
        before = Some((planned, flown));
    }
    before.map_or(planned_s, |(p, f)| f + planned_s - p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plan_and_flight_are_laid_over_each_other_at_the_ends_of_maneuvers() {
        let span = |planned_start_s, planned_end_s, flown_start_s, flown_end_s| Span {
            words: String::new(),
            planned_start_s,
            planned_end_s,
            flown_start_s,
            flown_end_s,
        };
        let spans = [span(5.0, 15.0, 30.0, 50.0), span(15.0, 25.0, 50.0, 58.0)];
        for (planned, flown) in
            [(5.0, 30.0), (0.0, 25.0), (10.0, 40.0), (15.0, 50.0), (20.0, 54.0), (30.0, 63.0)]
        {
            assert!((when_flown(&spans, planned) - flown).abs() < 1e-9, "{planned}");
        }
        assert_eq!(when_flown(&[], 7.0), 7.0);
    }
}
