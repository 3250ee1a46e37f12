//! The noise that makes linearised flights most likely: a quasi-Newton search on the logarithms of its figures, within limits.

use super::super::linear::Problem;
use super::super::pass::Options;
use super::super::{Workers, map};
use super::{FIGURES, Limits, Noise};
use crate::math::{exp, ln};

/// At most so many slopes are asked for in one fit.
const MOST_SLOPES: usize = 40;
/// No figure changes by more than this factor in one step (as a logarithm).
const LONGEST_STEP: f64 = 0.7;
/// A search that expects to gain less than this is over, nats.
const WORTH: f64 = 0.02;
/// A step that led downhill is tried again at this share of its length …
const SHORTER: f64 = 0.4;
/// … as long as more than this is left of it.
const LEAST_SHARE: f64 = 0.05;

/// The inverse curvature that a fit has learnt; the next one starts from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Metric([[f64; FIGURES]; FIGURES]);

impl Metric {
    /// Of so many fixes: white noise of the fixes is known to a few per cent, the rest to some tenths.
    pub fn new(fixes: usize) -> Self {
        let n = fixes.max(10) as f64;
        let curvature = [n / 10.0, n / 10.0, 2.0 * n, n, 2.0 * n, n / 20.0, n / 50.0, n / 20.0];
        Self(std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 / curvature[i] } else { 0.0 })))
    }

    /// Learns from a step and the change of the slope over it (Broyden, Fletcher, Goldfarb & Shanno; Nocedal & Wright
    /// 2006, eq. 6.17).
    fn learn(&mut self, step: &[f64; FIGURES], change: &[f64; FIGURES]) {
        let along: f64 = step.iter().zip(change).map(|(s, y)| s * y).sum();
        let size: f64 = step.iter().map(|s| s * s).sum::<f64>() * change.iter().map(|y| y * y).sum::<f64>();
        if along <= 1e-8 * size.sqrt() {
            return;
        }
        let hy = self.times(change);
        let yhy: f64 = change.iter().zip(&hy).map(|(y, h)| y * h).sum();
        for i in 0..FIGURES {
            for j in 0..FIGURES {
                self.0[i][j] += (1.0 + yhy / along) * step[i] * step[j] / along
                    - (hy[i] * step[j] + step[i] * hy[j]) / along;
            }
        }
    }

    fn times(&self, v: &[f64; FIGURES]) -> [f64; FIGURES] {
        std::array::from_fn(|i| self.0[i].iter().zip(v).map(|(h, v)| h * v).sum())
    }

    /// The step uphill that leaves out figures which stand at a limit and would go beyond it.
    fn step(&self, slope: &[f64; FIGURES], free: &[bool; FIGURES]) -> [f64; FIGURES] {
        let masked: [f64; FIGURES] = std::array::from_fn(|i| if free[i] { slope[i] } else { 0.0 });
        let mut step = self.times(&masked);
        (0..FIGURES).for_each(|i| step[i] = if free[i] { step[i] } else { 0.0 });
        if step.iter().zip(&masked).map(|(s, g)| s * g).sum::<f64>() <= 0.0 {
            step = std::array::from_fn(|i| self.0[i][i].max(1e-6) * masked[i]);
        }
        let longest = step.iter().fold(0.0f64, |m, s| m.max(s.abs()));
        let scale = (LONGEST_STEP / longest.max(1e-12)).min(1.0);
        step.map(|s| s * scale)
    }
}

/// A fitted noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// The noise.
    pub noise: Noise,
    /// Logarithm of the likelihood of the fit part.
    pub log_likelihood: f64,
    /// What the fit has learnt of the curvature.
    pub metric: Metric,
}

/// Likelihood and slopes by the logarithms of the figures, all flights together.
pub(super) fn slope(
    problems: &[Problem],
    noise: &Noise,
    options: &Options,
    workers: &dyn Workers,
) -> (f64, [f64; FIGURES]) {
    let each = map(workers, problems.len(), |k| problems[k].slope(noise, options));
    each.iter().fold((0.0, [0.0; FIGURES]), |(sum, by), s| {
        (sum + s.log_likelihood, std::array::from_fn(|i| by[i] + s.by_figure[i]))
    })
}

/// Fits the noise to linearised flights: a quasi-Newton search on logarithms within limits.
pub fn fit(
    problems: &[Problem],
    start: Noise,
    limits: &Limits,
    metric: &Metric,
    options: &Options,
    workers: &dyn Workers,
) -> Fitted {
    let mut search = Climb::new(problems, start, limits, metric);
    let (mut value, mut by) = slope(problems, &search.noise(), options, workers);
    for _ in 1..MOST_SLOPES {
        let Some(next) = search.next(&by) else { break };
        let (next_value, next_by) = slope(problems, &figures(&next), options, workers);
        if search.take(next, &by, &next_by, next_value > value) {
            (value, by) = (next_value, next_by);
        }
    }
    // What was learnt serves the next fit, also where it could see nothing more to gain here.
    let metric = search.given_up.unwrap_or(search.metric);
    Fitted { noise: search.noise(), log_likelihood: value, metric }
}

/// Noise from the logarithms of its figures.
fn figures(at: &[f64; FIGURES]) -> Noise {
    Noise::from_figures(&at.map(exp))
}

/// A search uphill.
struct Climb<'a> {
    limits: &'a Limits,
    /// The metric that nothing has been learnt for.
    plain: Metric,
    metric: Metric,
    /// The metric that was learnt, where the plain one has taken its place and has not yet gained anything.
    given_up: Option<Metric>,
    at: [f64; FIGURES],
    free: [bool; FIGURES],
    /// Share of the next step that is taken.
    share: f64,
}

impl<'a> Climb<'a> {
    fn new(problems: &[Problem], start: Noise, limits: &'a Limits, metric: &Metric) -> Self {
        Self {
            limits,
            plain: Metric::new(problems.iter().map(|p| p.times().count()).sum()),
            metric: *metric,
            given_up: None,
            at: limits.within(&start).get().map(ln),
            free: [true; FIGURES],
            share: 1.0,
        }
    }

    fn noise(&self) -> Noise {
        figures(&self.at)
    }

    /// Where to look next; `None` where nothing is to be gained any more. A metric that was learnt elsewhere may see nothing to gain, or point
    /// downhill: before the search ends, it is given up for the plain one.
    fn next(&mut self, by: &[f64; FIGURES]) -> Option<[f64; FIGURES]> {
        self.free = self.limits.free(&self.at, by);
        loop {
            let step = self.metric.step(by, &self.free);
            let expected: f64 = step.iter().zip(by).map(|(s, g)| 0.5 * s * g).sum();
            if expected >= WORTH && self.share >= LEAST_SHARE {
                return Some(self.limits.clamp(&std::array::from_fn(|i| self.at[i] + self.share * step[i])));
            }
            if self.given_up.is_some() {
                return None;
            }
            self.given_up = Some(std::mem::replace(&mut self.metric, self.plain));
            self.share = 1.0;
        }
    }

    /// Learns from the slopes at both ends of a step, and goes there where that is `better`.
    fn take(
        &mut self,
        next: [f64; FIGURES],
        by: &[f64; FIGURES],
        next_by: &[f64; FIGURES],
        better: bool,
    ) -> bool {
        let moved: [f64; FIGURES] = std::array::from_fn(|i| next[i] - self.at[i]);
        // A figure that stands still at a limit says nothing of the curvature along those that move.
        let change = std::array::from_fn(|i| if self.free[i] { by[i] - next_by[i] } else { 0.0 });
        self.metric.learn(&moved, &change);
        if better {
            (self.at, self.share, self.given_up) = (next, 1.0, None);
        } else {
            self.share *= SHORTER;
        }
        better
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::linear::reference::Reference;
    use super::super::super::{Serial, flight::Flight, tests::fly};
    use super::super::figure;
    use super::*;
    use crate::identify::watched::Watched;
    use crate::model::Model;

    /// Figures that stand at a limit pull hard; those that are free must still find their best.
    #[test]
    fn the_best_is_found_from_anywhere_beside_figures_at_their_limits() {
        let model = Model::default();
        let flight = Flight::prepare(&fly(&model, 1), &model).unwrap();
        let measured = Noise::measured(&model, &[&flight]);
        let mut limits = Limits::new(&model, &[&flight]);
        for k in [figure::POSITION, figure::HEIGHT, figure::VELOCITY] {
            limits.0[k] = (0.2, 0.25);
        }
        limits.0[figure::CORRELATION] = (20.0, 30.0);
        let reference = Reference::find(&flight, &model, &measured, &Serial);
        let problems = [Problem::new(&flight, &model, &reference, &Watched::default(), &Serial)];
        let options = Options::default();
        let from = |inertial: f64, gauss_markov_m: f64, metric: &Metric| {
            let (gyro, accel) = (measured.gyro * inertial, measured.accel * inertial);
            let start = Noise { gyro, accel, gauss_markov_m, correlation_s: 250.0, ..measured };
            fit(&problems, start, &limits, metric, &options, &Serial)
        };
        // What one fit has learnt serves the next.
        let first = from(2.5, 3.0, &Metric::new(flight.fixes().len()));
        let second = from(0.15, 0.03, &first.metric);
        let third = from(1.0, 0.7, &second.metric);
        assert!(first.noise.velocity_scale > 0.25 - 1e-9, "{first:?}");
        for other in [second, third] {
            assert!((other.log_likelihood - first.log_likelihood).abs() < 0.1, "{first:?} {other:?}");
        }
    }
}
