//! Barometers and airspeed sensors after a flight, and the wind that goes with the latter.
//!
//! Both are scalars along the settled trajectory ([`aids::series`](super::aids)). A barometer's height is that of the trajectory and an offset that
//! walks: the weather, and the GNSS height, which is no better known. An airspeed is the length of the velocity less the wind, whose north and east components walk;
//! a wing flies without much sideslip, which is a soft measurement of the wind across. Without turns wind and scale are the same; then the sigmas say so.

use super::aids::choose::{self, Chosen, Widths};
use super::aids::series::{self, Row, States};
use super::aids::{Finding, Settled, at_time};
use super::flight::Flight;
use crate::effects::{AIRSPEED, AirInstant, BAROMETER, Effect, SEA_LEVEL_DENSITY};
use crate::operating::{Channel, MOTORS};
use crate::sample::{AirKind, AirSample};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Samples this far from a fix are used for it: `SCALED_PRESSURE` comes at 2 Hz and more, s.
const NEAR_S: f64 = 0.6;
/// Fewer fixes with a sensor than this say nothing of it.
const ENOUGH: usize = 100;
/// Length of the blocks that are taken for independent of each other, s.
const BLOCK_S: f64 = 20.0;
/// Passes: wind multiplies the scale and the coefficients, and the noise is fitted.
const PASSES: usize = 5;
/// What is left of each effect of a sensor in order, 1-sigma, SI: 3 % of the dynamic pressure (.6 m at 20 m/s), 5 Pa of propeller wash (.4 m), .1 s, .05 m/°C,
/// 3 % (air 9 K from the standard's); 3 % of the airspeed, 3 Pa (.2 m/s at 15 m/s), .2 s.
const TOLERANCES: [&[f64]; 2] = [&[0.03, 5.0, 0.1, 0.05, 0.03], &[0.03, 3.0, 0.2]];
/// Least and largest white noise of heights, m, and airspeeds, m/s.
const NOISE: [(f64, f64); 2] = [(0.05, 3.0), (0.1, 3.0)];
/// Offset of a barometer at the start, m, and a component of the wind, m/s.
const START: [f64; 2] = [300.0, 8.0];
/// What a port's dynamic pressure knows of a wind that nothing measures, m/s.
const WIND_SIGMA: f64 = 5.0;
/// Sideslip of a wing, 1-sigma as a share of the airspeed, with the 25 fixes of 5 s in which it stays the same.
const SLIP: f64 = 0.05 * 5.0;
/// Its constant part: our own heading, and a fin that is not straight, rad.
const SLIP_CONSTANT: f64 = 0.05;
/// Below this airspeed nothing is said of the wind, m/s.
const FLIES: f64 = 5.0;
/// A temperature or a throttle that changes by less drives nothing: °C, share.
const DRIVES: [f64; 2] = [2.0, 0.1];

/// Wind over a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Wind {
    /// Mean velocity of the air, north and east, m/s.
    pub mean: [f64; 2],
    /// 1-sigma of the mean, with what the sensor's own errors leave open.
    pub sigma: [f64; 2],
    /// 1-sigma by which it changed.
    pub changed: f64,
}

/// One barometer or airspeed sensor.
#[derive(Debug, Clone)]
pub struct AirFound {
    /// What it is.
    pub kind: AirKind,
    /// Which, from 0.
    pub sensor: u8,
    /// Fixes at which it was compared.
    pub instants: usize,
    /// The largest error by the effects named, m or m/s, and the airspeed or ground speed at which it was, m/s.
    pub largest: (f64, f64),
    /// RMS of its residual less the offset's mean or the wind, as reported and corrected.
    pub residual: [f64; 2],
    /// White noise, and walk of offset or wind per √s.
    pub noise: [f64; 2],
    /// 1-sigma of an error at full speed that may have stayed unseen, m or m/s.
    pub known_to: f64,
    /// Effects that the flight shows.
    pub effects: Vec<Finding>,
    /// Effects that held-out data did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects that were tested and are not significant, with the evidence for each.
    pub not_found: Vec<(&'static str, f64)>,
    /// The wind, by an airspeed sensor.
    pub wind: Option<Wind>,
    /// Speed, and error as reported and as corrected, for a plot.
    pub points: Vec<[f64; 3]>,
}

/// A sensor at a fix.
#[derive(Debug, Clone, Copy)]
struct Instant {
    elapsed_s: f64,
    c_nb: Matrix3<f64>,
    v_n: Vector3<f64>,
    /// Height of the barometer, m, or airspeed.
    measured: f64,
    x: AirInstant,
}

/// Height of this pressure in the standard atmosphere, m (ISO 2533).
pub fn pressure_height_m(pressure_pa: f64) -> f64 {
    288.15 / 0.0065 * (1.0 - (pressure_pa / 101_325.0).powf(0.190_263))
}

/// Density of the standard atmosphere at this height, kg/m³.
pub fn density(height_m: f64) -> f64 {
    SEA_LEVEL_DENSITY * (1.0 - 0.0065 / 288.15 * height_m).max(0.3).powf(4.255_88)
}

/// A flight ready to judge what measures its air.
#[derive(Debug)]
pub struct Air<'a> {
    flight: &'a Flight,
    settled: &'a Settled,
    is_wing: bool,
}

/// A sensor with what its passes need.
struct Series {
    kind: AirKind,
    catalogue: &'static [&'static dyn Effect],
    widths: Widths,
    instants: Vec<Instant>,
    is_wing: bool,
    /// The wind at each instant about which it is linearised.
    wind: Vec<States>,
}

impl<'a> Air<'a> {
    /// `is_wing`: whether wings carry the vehicle, so that it flies without much sideslip.
    pub fn new(flight: &'a Flight, settled: &'a Settled, is_wing: bool) -> Self {
        Self { flight, settled, is_wing }
    }

    /// Every sensor that measured during the flight: airspeed first, since its wind is the barometers' too.
    pub fn all(&self) -> Vec<AirFound> {
        let mut sensors: Vec<(AirKind, u8)> = self.flight.air().iter().map(|a| (a.kind, a.sensor)).collect();
        sensors.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        sensors.dedup();
        let mut out: Vec<AirFound> = Vec::new();
        for (kind, sensor) in sensors {
            let wind = out.iter().find_map(|f| f.wind.clone());
            out.extend(self.one(kind, sensor, wind.as_ref()));
        }
        out
    }

    fn one(&self, kind: AirKind, sensor: u8, wind: Option<&Wind>) -> Option<AirFound> {
        let instants = self.instants(kind, sensor);
        if instants.len() < ENOUGH {
            return None;
        }
        let mut series = Series::new(self, kind, instants, wind);
        let (values, noise, blocks) = series.fitted()?;
        // A height that is farther off with the corrections than without them names nothing, however well they fit beside a walk: the
        // barometers of ArduPilot's simulation warm up as they climb, and 14 of 20 in order had been given a temperature's error.
        let shown = |v: &[f64]| match kind {
            AirKind::Barometer => rms(&series.residuals(v)),
            AirKind::Airspeed => 0.0,
        };
        let reported = shown(&vec![0.0; series.widths.len()]);
        let error = |v: &[f64]| match shown(v) {
            worse if worse > reported => f64::INFINITY,
            _ => -series::pass(&series.rows(v, false), &noise, BLOCK_S).held_out,
        };
        let chosen = choose::choose(&blocks, &[], &series.widths, &values, &error);
        Some(series.found(sensor, &chosen, noise))
    }

    /// The sensor at every fix of the linearised flight.
    fn instants(&self, kind: AirKind, sensor: u8) -> Vec<Instant> {
        let is_own = |a: &&AirSample| a.kind == kind && a.sensor == sensor;
        let own: Vec<(f64, AirSample)> =
            self.flight.air().iter().filter(is_own).map(|a| (a.t_s, *a)).collect();
        let between = |a: &AirSample, b: &AirSample, s: f64| {
            let mix = |a: f64, b: f64| a + (b - a) * s;
            let temperature_degc = a.temperature_degc.zip(b.temperature_degc).map(|(a, b)| mix(a, b));
            AirSample { value: mix(a.value, b.value), temperature_degc, ..*a }
        };
        let start_s = self.flight.initial().t_s;
        let at = |knot: &super::linear::reference::Knot| {
            let sample = at_time(&own, knot.t_s, NEAR_S, between)?;
            let (v_n, height_m) = (knot.nav.v_n(), knot.nav.geodetic().height_m);
            let is_height = kind == AirKind::Barometer;
            let x = AirInstant {
                density: density(if is_height { pressure_height_m(sample.value) } else { height_m }),
                height_m,
                climb: -v_n.z,
                throttle: self.throttle(knot.t_s),
                temperature: sample.temperature_degc.unwrap_or(0.0),
                ..AirInstant::default()
            };
            let measured = if is_height { pressure_height_m(sample.value) } else { sample.value };
            Some(Instant { elapsed_s: knot.t_s - start_s, c_nb: knot.nav.c_nb(), v_n, measured, x })
        };
        let mut all: Vec<Instant> = self.settled.reference.knots.iter().filter_map(at).collect();
        let mean = |of: &dyn Fn(&Instant) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
        let (height_m, temperature) = (mean(&|i| i.x.height_m), mean(&|i| i.x.temperature));
        for i in &mut all {
            i.measured -= if kind == AirKind::Barometer { i.x.height_m } else { 0.0 };
            i.x.height_m -= height_m;
            i.x.temperature -= temperature;
        }
        all
    }

    /// The throttle, or the mean of a multirotor's motors.
    fn throttle(&self, t_s: f64) -> f64 {
        let now = self.flight.operating().at(t_s);
        let motors: Vec<f64> = (0..MOTORS as u8).filter_map(|k| now.get(Channel::Motor(k))).collect();
        let mean = || {
            (!self.is_wing && !motors.is_empty()).then(|| motors.iter().sum::<f64>() / motors.len() as f64)
        };
        now.get(Channel::Throttle).or_else(mean).unwrap_or(0.0)
    }
}

fn range(of: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

fn rms(residuals: &[f64]) -> f64 {
    (residuals.iter().map(|v| v * v).sum::<f64>() / residuals.len().max(1) as f64).sqrt()
}

impl Series {
    fn new(air: &Air<'_>, kind: AirKind, instants: Vec<Instant>, wind: Option<&Wind>) -> Self {
        let catalogue = [BAROMETER, AIRSPEED][kind as usize];
        let changes =
            [range(instants.iter().map(|i| i.x.temperature)), range(instants.iter().map(|i| i.x.throttle))];
        let is_there = |effect: &str| match effect {
            "baro_temperature" => changes[0] > DRIVES[0],
            "baro_thrust" => changes[1] > DRIVES[1],
            _ => true,
        };
        let widths = Widths::new(catalogue, TOLERANCES[kind as usize], is_there);
        let widths = match kind {
            AirKind::Barometer => (0..2).fold(widths, |w, k| {
                w.along("baro_dynamic_pressure", wind.map_or(WIND_SIGMA, |w| w.sigma[k].hypot(w.changed)))
            }),
            AirKind::Airspeed => widths.always(SLIP_CONSTANT),
        };
        let mean = wind.map_or_else(States::zeros, |w| Vector2::from(w.mean));
        let wind = vec![mean; instants.len()];
        Self { kind, catalogue, widths, instants, is_wing: air.is_wing, wind }
    }

    /// Parameters of effects, before those that go with them.
    fn effects(&self) -> usize {
        self.catalogue.iter().map(|e| e.len()).sum()
    }

    /// By how much the wind differs that a port's dynamic pressure shows.
    fn shift(&self, values: &[f64]) -> States {
        match self.kind {
            AirKind::Barometer => Vector2::new(values[self.effects()], values[self.effects() + 1]),
            AirKind::Airspeed => States::zeros(),
        }
    }

    /// The instants with what depends on the wind, and on `shift` of it.
    fn seen(&self, shift: &States) -> Vec<AirInstant> {
        let one = |(i, wind): (&Instant, &States)| {
            let w = wind + shift;
            let velocity = i.c_nb.transpose() * (i.v_n - Vector3::new(w.x, w.y, 0.0));
            let airspeed = velocity.norm() * (i.x.density / SEA_LEVEL_DENSITY).sqrt();
            AirInstant { velocity, airspeed: [airspeed, 0.0], ..i.x }
        };
        let mut all: Vec<AirInstant> = self.instants.iter().zip(&self.wind).map(one).collect();
        let speeds: Vec<(f64, f64)> =
            self.instants.iter().zip(&all).map(|(i, x)| (i.elapsed_s, x.airspeed[0])).collect();
        for (x, w) in all.iter_mut().skip(1).zip(speeds.windows(3)) {
            x.airspeed[1] = (w[2].1 - w[0].1) / (w[2].0 - w[0].0).max(1e-3);
        }
        all
    }

    /// What the effects add at an instant with these values.
    fn added(&self, values: &[f64], x: &AirInstant) -> f64 {
        let mut at = 0;
        let one = |e: &&dyn Effect| {
            let p = &values[at..at + e.len()];
            at += e.len();
            e.on_air().map_or(0.0, |a| a.added(p, x))
        };
        self.catalogue.iter().map(one).sum()
    }

    fn rows(&self, values: &[f64], with_columns: bool) -> Vec<Row> {
        let shift = self.shift(values);
        let seen = self.seen(&shift);
        let own = |x: &AirInstant| -> Vec<f64> {
            let effects = self.catalogue.iter().filter_map(|e| e.on_air());
            let columns = effects.flat_map(|a| a.drivers.iter().map(|d| d.value(x)));
            if with_columns { columns.collect() } else { Vec::new() }
        };
        let rows =
            self.instants.iter().zip(&seen).zip(&self.wind).flat_map(|((i, x), wind)| match self.kind {
                AirKind::Barometer => vec![self.height(values, i, x, own(x))],
                AirKind::Airspeed => self.speed((i, x, wind), values, own(x)),
            });
        rows.collect()
    }

    fn height(&self, values: &[f64], i: &Instant, x: &AirInstant, mut columns: Vec<f64>) -> Row {
        if !columns.is_empty() {
            // A wind that is stronger by one m/s to the north or east.
            for axis in 0..2 {
                let mut w = Vector3::zeros();
                w[axis] = 1e-3;
                let there = AirInstant { velocity: x.velocity - i.c_nb.transpose() * w, ..*x };
                columns.push((self.added(values, &there) - self.added(values, x)) / 1e-3);
            }
        }
        Row {
            elapsed_s: i.elapsed_s,
            residual: i.measured - self.added(values, x),
            noise: 1.0,
            least: 0.0,
            by_state: Vector2::x(),
            columns,
        }
    }

    /// The airspeed, and for a wing that it does not slip; nothing on the ground.
    fn speed(
        &self,
        (i, x, wind): (&Instant, &AirInstant, &States),
        values: &[f64],
        mut columns: Vec<f64>,
    ) -> Vec<Row> {
        let against = x.velocity.norm();
        if against < FLIES || i.v_n.norm() < FLIES && i.measured < FLIES {
            return Vec::new();
        }
        let (scale, slip) = (values[0], values[self.effects()]);
        let to_equivalent = (x.density / SEA_LEVEL_DENSITY).sqrt();
        let unit = i.c_nb * x.velocity / against;
        let by_state = -unit.xy() * ((1.0 + scale) * to_equivalent);
        let with_columns = !columns.is_empty();
        let none = if with_columns { vec![0.0; self.effects()] } else { Vec::new() };
        columns.extend(with_columns.then_some(0.0));
        let speed = Row {
            elapsed_s: i.elapsed_s,
            residual: i.measured - x.airspeed[0] - self.added(values, x) + by_state.dot(wind),
            noise: 1.0,
            least: 0.0,
            by_state,
            columns,
        };
        if !self.is_wing {
            return vec![speed];
        }
        let across = i.c_nb.column(1);
        let by_state = Vector2::new(-across[0], -across[1]);
        let slipping = Row {
            residual: slip * against - x.velocity.y + by_state.dot(wind),
            noise: 0.0,
            least: SLIP * against,
            by_state,
            columns: none.into_iter().chain(with_columns.then_some(-against)).collect(),
            ..speed.clone()
        };
        vec![speed, slipping]
    }

    /// Values of all effects together within their widest priors, the noise, and the information about them there.
    fn fitted(&mut self) -> Option<(Vec<f64>, series::Noise, Vec<super::pass::Information>)> {
        let mut values = vec![0.0; self.widths.len()];
        let (limits, start) = (NOISE[self.kind as usize], START[self.kind as usize]);
        for pass in 0..PASSES {
            let noise = series::noise_of(&self.rows(&values, false), limits, start);
            let rows = self.rows(&values, true);
            if rows.len() < ENOUGH {
                return None;
            }
            let run = series::pass(&rows, &noise, BLOCK_S);
            if pass + 1 == PASSES {
                return Some((values, noise, run.blocks));
            }
            let step = choose::step(&run.blocks, &[], &self.widths, &values)?;
            values.iter_mut().zip(&step).for_each(|(v, s)| *v += s);
            self.follow(&values, &noise);
        }
        None
    }

    /// Linearises an airspeed about the wind that it shows with these values.
    fn follow(&mut self, values: &[f64], noise: &series::Noise) {
        if self.kind == AirKind::Airspeed {
            self.wind = self.winds(values, noise).0;
        }
    }

    /// The wind at every instant, and 1-sigma of its mean along each axis.
    fn winds(&self, values: &[f64], noise: &series::Noise) -> (Vec<States>, States) {
        let rows = self.rows(values, false);
        let smoothed = series::pass(&rows, noise, BLOCK_S).smoothed();
        let mut next = 0;
        let at = |i: &Instant| {
            while rows.get(next + 1).is_some_and(|r| r.elapsed_s <= i.elapsed_s) {
                next += 1;
            }
            smoothed.get(next).map_or_else(States::zeros, |s| s.0)
        };
        let winds = self.instants.iter().map(at).collect();
        let count = smoothed.len().max(1) as f64;
        let variance = smoothed.iter().map(|s| s.1.diagonal()).sum::<States>() / count;
        (winds, variance.map(|v| v.max(0.0).sqrt()))
    }

    fn found(&mut self, sensor: u8, chosen: &Chosen, noise: series::Noise) -> AirFound {
        let named = &chosen.named;
        let reported = vec![0.0; self.widths.len()];
        let linearised = self.wind.clone();
        self.follow(&reported, &noise);
        let before = self.residuals(&reported);
        self.wind = linearised;
        self.follow(named, &noise);
        let after = self.residuals(named);
        let seen = self.seen(&self.shift(named));
        let errors: Vec<(f64, f64)> =
            seen.iter().map(|x| (self.added(named, x), x.velocity.norm())).collect();
        let largest = errors.iter().copied().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        let every = self.instants.len().div_ceil(600).max(1);
        let points = errors.iter().zip(before.iter().zip(&after)).step_by(every);
        AirFound {
            kind: self.kind,
            sensor,
            instants: self.instants.len(),
            largest: largest.unwrap_or_default(),
            residual: [rms(&before), rms(&after)],
            noise: [noise.sigma, noise.walk],
            known_to: self.known_to(chosen, &seen),
            effects: chosen.findings.clone(),
            removed: chosen.removed.clone(),
            not_found: chosen.not_found.clone(),
            wind: (self.kind == AirKind::Airspeed).then(|| self.wind(named, &noise, chosen)),
            points: points.map(|((_, speed), (b, a))| [*speed, *b, *a]).collect(),
        }
    }

    /// What is left of the measurement at every instant, about its mean for a height.
    fn residuals(&self, values: &[f64]) -> Vec<f64> {
        let shift = self.shift(values);
        let is_height = self.kind == AirKind::Barometer;
        let expected = |x: &AirInstant| self.added(values, x) + if is_height { 0.0 } else { x.airspeed[0] };
        let mut all: Vec<f64> =
            self.instants.iter().zip(self.seen(&shift)).map(|(i, x)| i.measured - expected(&x)).collect();
        if is_height {
            let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
            all.iter_mut().for_each(|v| *v -= mean);
        }
        all
    }

    /// 1-sigma of what may have stayed unseen of the first effect (port or scale) at the 90th percentile of the speed.
    fn known_to(&self, chosen: &Chosen, seen: &[AirInstant]) -> f64 {
        let mut by: Vec<f64> =
            seen.iter().filter_map(|x| Some(self.catalogue[0].on_air()?.drivers[0].value(x).abs())).collect();
        by.sort_by(f64::total_cmp);
        chosen.first_sigma * by.get(by.len() * 9 / 10).copied().unwrap_or(0.0)
    }

    fn wind(&self, named: &[f64], noise: &series::Noise, chosen: &Chosen) -> Wind {
        let (winds, own) = self.winds(named, noise);
        let mean_of = |w: &[States]| w.iter().sum::<States>() / w.len().max(1) as f64;
        let mean = mean_of(&winds);
        // What the sensor's own error leaves open.
        let mut shifted = named.to_vec();
        shifted[0] += chosen.first_sigma;
        let by_scale = mean_of(&self.winds(&shifted, noise).0) - mean;
        let changed =
            winds.iter().map(|w| (w - mean).norm_squared()).sum::<f64>() / winds.len().max(1) as f64;
        Wind {
            mean: mean.into(),
            sigma: [0, 1].map(|k| own[k].hypot(by_scale[k])),
            changed: (0.5 * changed).sqrt(),
        }
    }
}
