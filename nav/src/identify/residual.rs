//! Where simulation and measurement disagree: the sensors simulated along the smoothed trajectory against what they measured, by
//! channel, over time and over what the vehicle did.
//!
//! A squared normalised residual is 1 on average under a right model; what exceeds it is the model residual. Residuals of
//! neighbouring times are correlated (a fix speaks of all the accelerations before it), so sums of their squares scatter more than
//! independent ones would, by Σρ² over all lags (Bartlett 1946); that is measured on the flight itself.

use super::flight::Flight;
use super::judge::about;
use super::linear::Problem;
use super::linear::reference::{Knot, Reference};
use super::noise::Noise;
use super::select::{Selection, Settings};
use super::{Workers, map};
use crate::earth::STANDARD_GRAVITY;
use crate::model::Model;
use crate::sample::ImuSample;
use nalgebra::Vector3;

/// Before this the start is still felt, s.
const SETTLE_S: f64 = 20.0;
/// Places are searched in steps of this, s.
const WINDOW_S: f64 = 10.0;
/// Correlations are measured over this, points, and end where they fall below [`UNCORRELATED`].
const LAGS: usize = 400;
/// What chance leaves between independent residuals of a short flight.
const UNCORRELATED: f64 = 0.1;
/// A place stands out when its excess is this many sigmas.
const STANDS_OUT: f64 = 5.0;
/// At most so many places are reported.
const MOST: usize = 8;

/// Channels: sensor by sensor, x, y, z or north, east, down.
pub const CHANNELS: [&str; 12] = [
    "gyro_x",
    "gyro_y",
    "gyro_z",
    "accel_x",
    "accel_y",
    "accel_z",
    "position_north",
    "position_east",
    "position_down",
    "velocity_north",
    "velocity_east",
    "velocity_down",
];

/// A value with the variance that it has under the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Value.
    pub value: f64,
    /// Its variance if the model is right.
    pub variance: f64,
}

impl Residual {
    /// Over its sigma; `None` where the data say nothing.
    pub fn normalised(&self) -> Option<f64> {
        (self.variance > 0.0).then(|| self.value / self.variance.sqrt()).filter(|z| z.is_finite())
    }
}

/// What a whole flight says went wrong between one fix and the next, and at that one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// By channel; `None` where there is nothing to compare.
    pub residuals: [Option<Residual>; 12],
    /// What the biases of gyros, rad/s, and accelerometers, m/s², have walked.
    pub walked: [Vector3<f64>; 2],
}

/// What the vehicle did around one fix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Seconds since the start.
    pub elapsed_s: f64,
    /// Specific force, m/s².
    pub force: Vector3<f64>,
    /// Angular rate, rad/s.
    pub rate: Vector3<f64>,
    /// Over ground, m/s.
    pub speed: f64,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Above the start, m.
    pub height_m: f64,
    /// Of the inertial unit, °C.
    pub temperature_degc: Option<f64>,
    /// Root of the mean squared change of specific force from sample to sample, m/s².
    pub vibration: f64,
    /// What the biases of gyros, rad/s, and accelerometers, m/s², have walked since the start, where the model lets them and that was asked for.
    pub walked: [Vector3<f64>; 2],
}

/// Disagreement at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// What the vehicle did.
    pub motion: Motion,
    /// By channel; `None` where there is nothing to compare.
    pub residuals: [Option<Residual>; 12],
}

impl Point {
    /// Over its sigma.
    pub fn normalised(&self, channel: usize) -> Option<f64> {
        self.residuals[channel].and_then(|r| r.normalised())
    }
}

/// The disagreement along each of these flights, without what a selection adds to its model and with it; the noise is the same.
pub fn before_and_after(
    flights: &[&Flight],
    selection: &Selection,
    settings: &Settings,
    workers: &dyn Workers,
) -> Vec<[Vec<Point>; 2]> {
    let search = about(flights, selection, settings, workers);
    let [before, after] = [&[][..], &selection.added].map(|added| {
        let (model, references, problems) = search.at(&search.best(added, &selection.noise));
        let of = |k: usize| points(flights[k], &model, (&references[k], &problems[k]), &selection.noise);
        map(workers, flights.len(), of)
    });
    before.into_iter().zip(after).map(|(before, after)| [before, after]).collect()
}

/// The disagreement along a flight that was linearised about its trajectory under a model.
pub fn points(
    flight: &Flight,
    model: &Model,
    (reference, problem): (&Reference, &Problem),
    noise: &Noise,
) -> Vec<Point> {
    let both = motions(flight, model, reference).into_iter().zip(problem.disturbances(noise));
    let mut walked = [Vector3::zeros(); 2];
    let all = both.map(|(motion, found)| {
        walked.iter_mut().zip(found.walked).for_each(|(sum, step)| *sum += step);
        Point { motion: Motion { walked, ..motion }, residuals: found.residuals }
    });
    all.filter(|p| p.motion.elapsed_s > SETTLE_S).collect()
}

/// What the vehicle did at each fix of a flight.
pub(super) fn motions(flight: &Flight, model: &Model, reference: &Reference) -> Vec<Motion> {
    let samples = flight.samples_of(model);
    let mut samples = samples.iter().peekable();
    let (start_s, start) = (flight.initial().t_s, flight.initial().nav);
    let start_height_m = start.geodetic().height_m;
    let mut last: Option<ImuSample> = None;
    let mut motion = Motion::default();
    let at = |knot: &Knot| {
        let mut seen = Seen::default();
        while let Some(sample) = samples.next_if(|x| x.t_s <= knot.t_s) {
            seen.take(sample, last.as_ref());
            last = Some(*sample);
        }
        seen.into(&mut motion);
        motion.elapsed_s = knot.t_s - start_s;
        motion.speed = knot.nav.v_e.norm();
        motion.heading_rad = knot.nav.euler().z;
        motion.height_m = knot.nav.geodetic().height_m - start_height_m;
        motion
    };
    reference.knots.iter().map(at).collect()
}

/// Samples of one interval.
#[derive(Default)]
struct Seen {
    n: f64,
    force: Vector3<f64>,
    rate: Vector3<f64>,
    change: f64,
    temperature_degc: Option<f64>,
}

impl Seen {
    fn take(&mut self, sample: &ImuSample, last: Option<&ImuSample>) {
        self.n += 1.0;
        self.force += sample.accel;
        self.rate += sample.gyro;
        self.change += last.map_or(0.0, |l| (sample.accel - l.accel).norm_squared());
        self.temperature_degc = sample.temperature_degc;
    }

    fn into(self, motion: &mut Motion) {
        if self.n > 0.0 {
            motion.force = self.force / self.n;
            motion.rate = self.rate / self.n;
            motion.vibration = (self.change / self.n).sqrt();
            motion.temperature_degc = self.temperature_degc;
        }
    }
}

/// What a regime is a range of.
struct Quantity {
    name: &'static str,
    unit: &'static str,
    of: fn(&Motion) -> Option<f64>,
    /// Limits between ranges; none: thirds of the flight.
    limits: &'static [f64],
    digits: usize,
}

const QUANTITIES: [Quantity; 8] = [
    Quantity {
        name: "specific force z",
        unit: "g",
        of: |m| Some(-m.force.z / STANDARD_GRAVITY),
        limits: &[0.8, 1.2, 1.5],
        digits: 1,
    },
    Quantity {
        name: "specific force y",
        unit: "g",
        of: |m| Some(m.force.y.abs() / STANDARD_GRAVITY),
        limits: &[0.1, 0.25],
        digits: 2,
    },
    Quantity {
        name: "specific force x",
        unit: "g",
        of: |m| Some(m.force.x.abs() / STANDARD_GRAVITY),
        limits: &[0.15, 0.35],
        digits: 2,
    },
    Quantity {
        name: "rate",
        unit: "deg/s",
        of: |m| Some(m.rate.norm().to_degrees()),
        limits: &[5.0, 20.0],
        digits: 0,
    },
    Quantity { name: "speed", unit: "m/s", of: |m| Some(m.speed), limits: &[], digits: 0 },
    Quantity { name: "temperature", unit: "°C", of: |m| m.temperature_degc, limits: &[], digits: 0 },
    Quantity { name: "vibration", unit: "m/s²", of: |m| Some(m.vibration), limits: &[], digits: 2 },
    Quantity { name: "time since start", unit: "s", of: |m| Some(m.elapsed_s), limits: &[], digits: 0 },
];

impl Quantity {
    /// Limits for these points; `None` where the quantity is unknown or does not vary.
    fn limits(&self, points: &[Point]) -> Option<Vec<f64>> {
        if !self.limits.is_empty() {
            return Some(self.limits.to_vec());
        }
        let mut all: Vec<f64> = points.iter().filter_map(|p| (self.of)(&p.motion)).collect();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all.get((share * all.len() as f64) as usize).copied();
        let (low, high) = (at(1.0 / 3.0)?, at(2.0 / 3.0)?);
        let least = 0.5 * 10f64.powi(-(self.digits as i32));
        // Of a vehicle that stands for a third of the time nothing is below its speed.
        let above = *all.first()? + least;
        (high - low > 2.0 * least).then(|| [low, high].into_iter().filter(|l| *l > above).collect())
    }

    fn range(&self, limits: &[f64], motion: &Motion) -> Option<usize> {
        let value = (self.of)(motion)?;
        Some(limits.iter().take_while(|l| value >= **l).count())
    }

    fn label(&self, limits: &[f64], range: usize) -> String {
        let (name, unit, d) = (self.name, self.unit, self.digits);
        match (range.checked_sub(1).and_then(|k| limits.get(k)), limits.get(range)) {
            (None, Some(high)) => format!("{name} below {high:.d$} {unit}"),
            (Some(low), None) => format!("{name} above {low:.d$} {unit}"),
            (Some(low), Some(high)) => format!("{name} {low:.d$} to {high:.d$} {unit}"),
            (None, None) => name.to_owned(),
        }
    }
}

/// The disagreement of one channel in one regime.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Channel.
    pub channel: usize,
    /// `specific force z above 1.5 g`.
    pub regime: String,
    /// What the regime is a range of.
    pub quantity: &'static str,
    /// Share of the flight, by points.
    pub share: f64,
    /// Mean squared normalised residual.
    pub mean_square: f64,
    /// RMS of the residual, unit of the channel.
    pub rms: f64,
}

/// Sums over the points of a channel.
#[derive(Default, Clone, Copy)]
struct Sum {
    n: f64,
    square: f64,
    size: f64,
}

impl Sum {
    fn take(&mut self, residual: &Residual) {
        if let Some(z) = residual.normalised() {
            self.n += 1.0;
            self.square += z * z;
            self.size += residual.value * residual.value;
        }
    }

    fn excess(&self) -> f64 {
        self.square - self.n
    }

    fn stands_out(&self, correlated: f64) -> bool {
        self.n > 0.0 && self.excess() > STANDS_OUT * (2.0 * correlated * self.n).sqrt()
    }
}

/// By how much correlation raises the variance of a sum of squares of this channel.
fn correlated(points: &[Point], channel: usize) -> f64 {
    let z: Vec<f64> = points.iter().filter_map(|p| p.normalised(channel)).collect();
    let square: f64 = z.iter().map(|v| v * v).sum();
    if square <= 0.0 {
        return 1.0;
    }
    let rho = |lag: usize| z.iter().zip(&z[lag..]).map(|(a, b)| a * b).sum::<f64>() / square;
    let lags = (1..LAGS.min(z.len())).map(rho).take_while(|r| *r > UNCORRELATED);
    1.0 + 2.0 * lags.map(|r| r * r).sum::<f64>()
}

/// Every channel in every regime.
pub fn cells(points: &[Point]) -> Vec<Cell> {
    let mut out = Vec::new();
    for quantity in &QUANTITIES {
        let Some(limits) = quantity.limits(points) else { continue };
        let mut sums = vec![[Sum::default(); 12]; limits.len() + 1];
        for point in points {
            let Some(range) = quantity.range(&limits, &point.motion) else { continue };
            for (c, residual) in point.residuals.iter().enumerate() {
                residual.iter().for_each(|r| sums[range][c].take(r));
            }
        }
        for c in 0..12 {
            let all: f64 = sums.iter().map(|s| s[c].n).sum();
            for (range, sum) in sums.iter().map(|s| s[c]).enumerate().filter(|(_, s)| s.n > 0.0) {
                out.push(Cell {
                    channel: c,
                    regime: quantity.label(&limits, range),
                    quantity: quantity.name,
                    share: sum.n / all,
                    mean_square: sum.square / sum.n,
                    rms: (sum.size / sum.n).sqrt(),
                });
            }
        }
    }
    out
}

/// A stretch of the flight in which a channel disagrees.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Channel.
    pub channel: usize,
    /// From, seconds since the start.
    pub start_s: f64,
    /// To, seconds since the start.
    pub end_s: f64,
    /// The regime that goes with it.
    pub regime: String,
    /// Share of the flight's excess over the expected residuals.
    pub share: f64,
}

/// The places that stand out, largest share first; none where simulation and measurement agree.
pub fn places(points: &[Point]) -> Vec<Place> {
    let mut whole = 0.0;
    let mut found: Vec<Place> = Vec::new();
    for c in 0..12 {
        let mut windows: std::collections::BTreeMap<i64, Sum> = std::collections::BTreeMap::new();
        for p in points {
            if let Some(r) = &p.residuals[c] {
                windows.entry((p.motion.elapsed_s / WINDOW_S) as i64).or_default().take(r);
            }
        }
        let correlated = correlated(points, c);
        let mut last: Option<(i64, Place)> = None;
        for (w, sum) in windows {
            whole += sum.excess().max(0.0);
            if !sum.stands_out(correlated) {
                continue;
            }
            let (start_s, end_s) = (w as f64 * WINDOW_S, (w + 1) as f64 * WINDOW_S);
            match &mut last {
                Some((before, place)) if *before + 1 == w => {
                    (*before, place.end_s) = (w, end_s);
                    place.share += sum.excess();
                }
                _ => {
                    let place =
                        Place { channel: c, start_s, end_s, regime: String::new(), share: sum.excess() };
                    found.extend(last.replace((w, place)).map(|(_, p)| p));
                }
            }
        }
        found.extend(last.map(|(_, p)| p));
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found.truncate(MOST);
    for place in &mut found {
        place.share /= whole;
        place.regime = regime(points, place);
    }
    found
}

/// The regime that the worst of a place lies in: the range with the highest mean square of those that the excess of the place falls
/// into for the most part.
fn regime(points: &[Point], place: &Place) -> String {
    let inside = |p: &&Point| (place.start_s..place.end_s).contains(&p.motion.elapsed_s);
    let mut best: Option<(f64, String)> = None;
    for quantity in QUANTITIES.iter().filter(|q| q.name != "time since start") {
        let Some(limits) = quantity.limits(points) else { continue };
        let mut sums = vec![Sum::default(); limits.len() + 1];
        let mut rest = vec![0.0; limits.len() + 1];
        for p in points {
            let Some(range) = quantity.range(&limits, &p.motion) else { continue };
            rest[range] += 1.0;
            if let Some(r) = p.residuals[place.channel].as_ref().filter(|_| inside(&p)) {
                sums[range].take(r);
            }
        }
        let excess: f64 = sums.iter().map(|s| s.excess().max(0.0)).sum();
        for (range, sum) in sums.iter().enumerate().filter(|(_, s)| s.excess() > 0.5 * excess) {
            // A range that the vehicle is in nearly all the time separates nothing.
            let usual = rest[range] / points.len().max(1) as f64;
            let score = sum.square / sum.n.max(1.0) * (1.0 - usual);
            if usual < 0.7 && best.as_ref().is_none_or(|b| score > b.0) {
                best = Some((score, quantity.label(&limits, range)));
            }
        }
    }
    best.map_or_else(|| "steady flight".to_owned(), |b| b.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(elapsed_s: f64, load: f64, z: f64) -> Point {
        let mut residuals = [None; 12];
        let sign = if (elapsed_s * 5.0).round() as i64 % 2 == 0 { 1.0 } else { -1.0 };
        residuals[1] = Some(Residual { value: 0.01 * z * sign, variance: 1e-4 });
        residuals[9] =
            Some(Residual { value: if (elapsed_s as i64) % 2 == 0 { 0.1 } else { -0.1 }, variance: 0.01 });
        let force = Vector3::new(0.0, 0.0, -load * STANDARD_GRAVITY);
        Point { motion: Motion { elapsed_s, force, speed: 20.0, ..Motion::default() }, residuals }
    }

    #[test]
    fn a_gyro_that_errs_under_load_is_found_there() {
        let points: Vec<Point> = (0..1200)
            .map(|k| {
                let t = f64::from(k) * 0.2;
                let turning = (100.0..120.0).contains(&t);
                point(t, if turning { 2.0 } else { 1.0 }, if turning { 4.0 } else { 1.0 })
            })
            .collect();
        let places = places(&points);
        assert_eq!(places.len(), 1, "{places:?}");
        assert_eq!(CHANNELS[places[0].channel], "gyro_y");
        assert_eq!((places[0].start_s, places[0].end_s), (100.0, 120.0));
        assert_eq!(places[0].regime, "specific force z above 1.5 g");
        assert!(places[0].share > 0.99);
        let cells = cells(&points);
        let heavy = cells.iter().find(|c| c.channel == 1 && c.regime.ends_with("above 1.5 g")).unwrap();
        assert!((heavy.mean_square - 16.0).abs() < 1e-9 && (heavy.rms - 0.04).abs() < 1e-9);
        assert!((heavy.share - 100.0 / 1200.0).abs() < 1e-9);
        // The speed never changes: no regime.
        assert!(cells.iter().all(|c| c.quantity != "speed"));
    }

    #[test]
    fn no_range_is_below_the_speed_of_a_vehicle_that_stands() {
        let standing = |k: i32| if k < 600 { 0.0 } else { 0.02 * f64::from(k) };
        let of = |k: i32| {
            let p = point(f64::from(k) * 0.2, 1.0, 1.0);
            Point { motion: Motion { speed: standing(k), ..p.motion }, ..p }
        };
        let cells = cells(&(0..1200).map(of).collect::<Vec<_>>());
        let mut ranges: Vec<&str> =
            cells.iter().filter(|c| c.quantity == "speed").map(|c| c.regime.as_str()).collect();
        ranges.sort_unstable();
        ranges.dedup();
        assert_eq!(ranges, ["speed above 16 m/s", "speed below 16 m/s"]);
    }

    #[test]
    fn where_all_is_as_it_should_be_no_place_stands_out() {
        let points: Vec<Point> = (0..1200).map(|k| point(f64::from(k) * 0.2, 1.0, 1.0)).collect();
        assert!(places(&points).is_empty());
    }
}
