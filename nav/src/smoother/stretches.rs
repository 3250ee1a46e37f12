//! A whole flight smoothed: its recording stretch by stretch, so that hours take no more memory than minutes.
//!
//! What goes back over a recording needs it from the end. The filter runs through the flight once and leaves a copy of itself at the
//! beginning of every stretch; each stretch is then recorded again from there (checkpoints, Griewank & Walther 2000, "Algorithm
//! 799: revolve").

use super::{Back, Smoothed};
use crate::filter::Fusion;
use crate::identify::flight::Flight;
use crate::identify::noise::Noise;
use crate::identify::pass::{at_start, scaled};
use crate::identify::rounding::Rounding;
use crate::model::Model;
use crate::sample::{GnssFix, ImuSample, SampleKind};

/// A node this long after the last one where fixes are rarer, s.
const SPACING_S: f64 = 0.2;
/// So many nodes are recorded at a time: fifteen minutes of fixes at 5 Hz. A shorter flight is gone through once.
const STRETCH: usize = 4500;

/// A filter on its way through a flight.
#[derive(Clone)]
struct Way<'a> {
    fusion: Fusion,
    /// What comes next.
    samples: &'a [ImuSample],
    fixes: &'a [GnssFix],
}

impl<'a> Way<'a> {
    fn new(flight: &'a Flight, model: &Model, noise: &Noise, samples: &'a [ImuSample]) -> Self {
        let mut filter = at_start(flight, model, noise);
        filter.record(SPACING_S);
        Self { fusion: Fusion::without_window(filter), samples, fixes: flight.fixes() }
    }

    /// On until so many nodes are recorded; `false` where the flight ends before.
    fn go(&mut self, kind: SampleKind, rounding: &Rounding, noise: &Noise, nodes: usize) -> bool {
        while self.fusion.filter().recorded() < nodes {
            let Some((sample, rest)) = self.samples.split_first() else { return false };
            self.samples = rest;
            self.fusion.filter_mut().set_stream(kind, rounding.at(sample.t_s));
            let due = self.fixes.iter().take_while(|f| f.t_s <= sample.t_s).count();
            let (now, later) = self.fixes.split_at(due);
            self.fixes = later;
            now.iter().for_each(|fix| self.fusion.push_fix(scaled(fix, noise)));
            self.fusion.push_imu(*sample);
            while self.fusion.poll().is_some() {}
        }
        true
    }
}

/// What is wanted of every node of the best trajectory of a flight under a model with its noise, in order of time.
pub(super) fn smoothed<T>(
    flight: &Flight,
    model: &Model,
    noise: &Noise,
    of: impl Fn(Smoothed) -> T,
) -> Vec<T> {
    in_stretches(flight, model, noise, STRETCH, of)
}

/// The same with so many nodes recorded at a time. The recording of a filter takes kilobytes a fix: of a long flight
/// only one stretch is there at a time, and the stretches before the last are recorded once more from where each began.
fn in_stretches<T>(
    flight: &Flight,
    model: &Model,
    noise: &Noise,
    stretch: usize,
    of: impl Fn(Smoothed) -> T,
) -> Vec<T> {
    let samples = flight.samples_of(model);
    let (kind, rounding) = (flight.stream().kind, flight.rounding(model));
    let mut way = Way::new(flight, model, noise, &samples);
    let layout = way.fusion.filter().layout().clone();
    let mut starts = Vec::new();
    let mut start = way.clone();
    while way.go(kind, &rounding, noise, stretch) {
        drop(way.fusion.filter_mut().take_nodes());
        starts.push(std::mem::replace(&mut start, way.clone()));
    }
    let mut back = Back::new(model, &layout);
    let mut out = Vec::new();
    loop {
        let nodes = way.fusion.filter_mut().take_nodes();
        out.extend(nodes.into_iter().rev().map(|node| of(back.over(node))));
        let Some(before) = starts.pop() else { break };
        way = before;
        way.go(kind, &rounding, noise, stretch);
    }
    out.reverse();
    out
}

/// The best trajectory of a flight under a model with its noise.
pub fn trajectory(flight: &Flight, model: &Model, noise: &Noise) -> Vec<Smoothed> {
    smoothed(flight, model, noise, |s| s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::tests::fly;

    #[test]
    fn stretches_make_no_difference() {
        let model = Model::default();
        let flight = Flight::prepare(&fly(&model, 3), &model).unwrap();
        let noise = Noise::measured(&model, &[&flight]);
        let all = |stretch| in_stretches(&flight, &model, &noise, stretch, |s| s);
        let (whole, cut) = (all(usize::MAX), all(100));
        assert!(whole.len() > 500 && whole.len() == cut.len(), "{} {}", whole.len(), cut.len());
        for (a, b) in whole.iter().zip(&cut) {
            assert_eq!(
                (a.t_s, a.nav, &a.sigma, a.gyro, &a.position),
                (b.t_s, b.nav, &b.sigma, b.gyro, &b.position)
            );
        }
    }
}
