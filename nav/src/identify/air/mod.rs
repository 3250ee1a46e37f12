//! Barometers and airspeed sensors after a flight, and the wind that goes with the latter.
//!
//! Both are scalars along the settled trajectory ([`aids::series`](super::aids)). A barometer's height is that of the trajectory and an offset that
//! walks (the weather), with a bounded error of the trajectory's own height. An airspeed is the length of the velocity less the wind, whose north and east components
//! walk, with gusts along it; a wing flies without much sideslip, which is a soft measurement of the wind across. Without turns wind and scale are the same; then the
//! sigmas say so.

mod drag;
mod force;
mod sensor;
#[cfg(test)]
mod tests;

use super::aids::judged::{ENOUGH, Judged};
use super::aids::{Finding, Settled, at_time};
use super::flight::Flight;
use crate::effects::{AirInstant, SEA_LEVEL_DENSITY};
use crate::math::powf;
use crate::model::EffectSetting;
use crate::operating::{Channel, MOTORS};
use crate::sample::{AirKind, AirSample};
use nalgebra::{Rotation3, Vector2, Vector3};
pub(in crate::identify) use sensor::AirForeseen;
use sensor::AirSensor;

/// Samples this far from a fix are used for it: `SCALED_PRESSURE` comes at 2 Hz and more, s.
const NEAR_S: f64 = 0.6;
/// Below this speed nothing is said of the wind, m/s.
const FLIES: f64 = 5.0;
/// A wing that is slower over ground, and through the air than [`FLIES`], stands, m/s.
const STANDS: f64 = 1.0;
/// So far above and below where it stands the wind is another one than in flight (MIL-F-8785C, wind shear near the ground: 1.3 times as strong at 10 m as at 3 m), m. With
/// .5 to 20 m the scale of two flights was the same; with all that was measured until they stood it was not named on one of them.
const NEAR_GROUND_M: f64 = 10.0;

/// Wind over a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Wind {
    /// Mean velocity of the air, north and east, m/s.
    pub mean: [f64; 2],
    /// 1-sigma of the mean, with what the sensor's own errors leave open.
    pub sigma: [f64; 2],
    /// 1-sigma by which it changed.
    pub changed: f64,
    /// Gusts beside that: 1-sigma, m/s, and correlation time, s.
    pub gusts: (f64, f64),
    /// Time since the start, s, and the wind then, with the gust along the flow at an airspeed sensor, m/s.
    track: Vec<(f64, (Vector2<f64>, f64))>,
}

impl Wind {
    /// At a time since the start, s: that of the fix before.
    fn at(&self, elapsed_s: f64) -> (Vector2<f64>, f64) {
        let next = self.track.partition_point(|t| t.0 <= elapsed_s);
        self.track.get(next.saturating_sub(1)).map_or_else(|| (Vector2::from(self.mean), 0.0), |t| t.1)
    }
}

/// What was compared with the motion through the air.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AirQuantity {
    /// The height of a barometer.
    Height,
    /// An airspeed.
    Airspeed,
    /// The specific force of a multirotor along body x and y.
    Drag,
}

/// One barometer or airspeed sensor, or the drag of a multirotor.
#[derive(Debug, Clone)]
pub struct AirFound {
    /// What it is.
    pub kind: AirQuantity,
    /// Which, from 0.
    pub sensor: u8,
    /// Fixes at which it was compared.
    pub instants: usize,
    /// The largest error, m or m/s, by the effects named and by what the tolerances of the others leave, or the largest drag, m/s², and the airspeed or ground speed at which it was,
    /// m/s.
    pub largest: (f64, f64),
    /// 1-sigma of that error.
    pub largest_sigma: f64,
    /// RMS of its residual as reported and corrected: of a height less its mean over two minutes, of an airspeed in the wind that goes with what was found.
    pub residual: [f64; 2],
    /// The same on held-out blocks, corrected by values of the others.
    pub held_out: [f64; 2],
    /// What is left on held-out blocks that no effect explains, also within its tolerance.
    pub unexplained: f64,
    /// White noise, and walk of offset or wind per √s.
    pub noise: [f64; 2],
    /// 1-sigma of an error at full speed that may have stayed unseen, m or m/s.
    pub known_to: f64,
    /// Effects that the flight shows.
    pub effects: Vec<Finding>,
    /// Effects that are not named, of which each adds a share of that error that is worth a word.
    pub shared: Vec<EffectSetting>,
    /// Effects that held-out data did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects that were tested and are not significant, with the evidence for each.
    pub not_found: Vec<(&'static str, f64)>,
    /// The wind, by an airspeed sensor or by drag.
    pub wind: Option<Wind>,
    /// Speed, and residual as reported and as corrected, for a plot.
    pub points: Vec<[f64; 3]>,
    /// Mean density of the air relative to sea level: of drag.
    pub density: f64,
}

/// The vehicle at a time of a flight.
#[derive(Debug, Clone, Copy)]
pub struct Carriage {
    /// Since the start, s.
    pub elapsed_s: f64,
    /// Attitude.
    pub c_nb: Rotation3<f64>,
    /// Velocity over ground, north, east, down, m/s.
    pub v_n: Vector3<f64>,
    /// Height above the ellipsoid or the sea, m.
    pub height_m: f64,
    /// Share of full throttle.
    pub throttle: f64,
    /// Specific force in body axes, m/s², where it is known.
    pub force: Option<Vector3<f64>>,
}

/// A sensor at a fix.
#[derive(Debug, Clone, Copy)]
struct Instant {
    elapsed_s: f64,
    /// Height of the barometer, m, or airspeed.
    measured: f64,
    /// Density of the air, kg/m³.
    density: f64,
    /// Temperature of the sensor less its mean, K.
    temperature: f64,
}

/// Height of this pressure in the standard atmosphere, m (ISO 2533).
pub fn pressure_height_m(pressure_pa: f64) -> f64 {
    288.15 / 0.0065 * (1.0 - powf(pressure_pa / 101_325.0, 0.190_263))
}

/// Density of the standard atmosphere at this height, kg/m³.
pub fn density(height_m: f64) -> f64 {
    SEA_LEVEL_DENSITY * powf((1.0 - 0.0065 / 288.15 * height_m).max(0.3), 4.255_88)
}

/// A flight ready to judge what measures its air.
#[derive(Debug)]
pub struct Air<'a> {
    samples: &'a [AirSample],
    start_s: f64,
    is_wing: bool,
    /// The vehicle at each fix.
    carriage: Vec<Carriage>,
}

impl<'a> Air<'a> {
    /// `is_wing`: whether wings carry the vehicle, so that it flies without much sideslip.
    pub fn new(flight: &'a Flight, settled: &Settled, is_wing: bool) -> Self {
        let start_s = flight.initial().t_s;
        let at = |(k, force): (&super::linear::reference::Knot, _)| Carriage {
            elapsed_s: k.t_s - start_s,
            c_nb: Rotation3::from_matrix_unchecked(k.nav.c_nb()),
            v_n: k.nav.v_n(),
            height_m: k.nav.geodetic().height_m,
            throttle: throttle(flight, is_wing, k.t_s),
            force,
        };
        let carriage = settled.reference.knots.iter().zip(force::forces(flight, settled)).map(at).collect();
        Self { samples: flight.air(), start_s, is_wing, carriage }
    }

    /// Every sensor that measured during the flight: airspeed first, since its wind is the barometers' too.
    pub fn all(&self) -> Vec<AirFound> {
        let mut sensors: Vec<(AirKind, u8)> = self.samples.iter().map(|a| (a.kind, a.sensor)).collect();
        sensors.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        sensors.dedup();
        let mut out: Vec<AirFound> = Vec::new();
        for (kind, sensor) in sensors {
            let wind = out.iter().find_map(|f| f.wind.clone());
            out.extend(self.one(kind, sensor, wind.as_ref()));
        }
        out
    }

    /// The drag of a multirotor.
    pub fn drag(&self) -> Option<AirFound> {
        drag::Drag::new(self).judged()
    }

    fn one(&self, kind: AirKind, number: u8, wind: Option<&Wind>) -> Option<AirFound> {
        let instants = self.instants(kind, number);
        if instants.len() < ENOUGH {
            return None;
        }
        let mut sensor = AirSensor::new(self, kind, instants, wind);
        let (values, noise, blocks) = sensor.fitted()?;
        let chosen = sensor.chosen(&values, &noise, &blocks);
        Some(sensor.found(number, &chosen, noise))
    }

    /// The sensor at every fix of the linearised flight.
    fn instants(&self, kind: AirKind, sensor: u8) -> Vec<Instant> {
        let is_own = |a: &&AirSample| a.kind == kind && a.sensor == sensor;
        let own: Vec<(f64, AirSample)> = self.samples.iter().filter(is_own).map(|a| (a.t_s, *a)).collect();
        let between = |a: &AirSample, b: &AirSample, s: f64| {
            let mix = |a: f64, b: f64| a + (b - a) * s;
            let temperature_degc = a.temperature_degc.zip(b.temperature_degc).map(|(a, b)| mix(a, b));
            AirSample { value: mix(a.value, b.value), temperature_degc, ..*a }
        };
        let is_height = kind == AirKind::Barometer;
        let at = |c: &Carriage| {
            let sample = at_time(&own, self.start_s + c.elapsed_s, NEAR_S, between)?;
            let measured = if is_height { pressure_height_m(sample.value) } else { sample.value };
            let stands = c.v_n.norm() < STANDS && measured < FLIES;
            let instant = Instant {
                elapsed_s: c.elapsed_s,
                measured,
                density: density(if is_height { measured } else { c.height_m }),
                temperature: sample.temperature_degc.unwrap_or(0.0),
            };
            Some((instant, (c.height_m, stands)))
        };
        let (mut all, places): (Vec<Instant>, Vec<_>) = self.carriage.iter().filter_map(at).unzip();
        if self.is_wing && !is_height {
            let mut near = near_ground(&places).into_iter();
            all.retain(|_| near.next() == Some(false));
        }
        let mean = all.iter().map(|i| i.temperature).sum::<f64>() / all.len().max(1) as f64;
        all.iter_mut().for_each(|i| i.temperature -= mean);
        all
    }
}

/// Of heights, m, with whether the vehicle stands there: which are near the ground where it stood before or stands after, without having been away from it between.
fn near_ground(all: &[(f64, bool)]) -> Vec<bool> {
    let mut near = vec![false; all.len()];
    let mut go = |order: &mut dyn Iterator<Item = usize>| {
        let mut ground = None;
        for k in order {
            let (height_m, stands) = all[k];
            let is_near = |ground: &f64| (height_m - ground).abs() < NEAR_GROUND_M;
            ground = if stands { Some(height_m) } else { ground.filter(is_near) };
            near[k] |= ground.is_some();
        }
    };
    go(&mut (0..all.len()));
    go(&mut (0..all.len()).rev());
    near
}

/// By how much that changes which depends on the air with a wind that is stronger by one m/s to the north and to the east.
fn by_wind(c_nb: &Rotation3<f64>, x: &AirInstant, of: impl Fn(&AirInstant) -> f64) -> Vector2<f64> {
    const BY: f64 = 1e-3;
    let in_wind = |w| AirInstant { velocity: x.velocity - c_nb.inverse() * (BY * w), ..*x };
    Vector2::new(of(&in_wind(Vector3::x())), of(&in_wind(Vector3::y()))).map(|there| (there - of(x)) / BY)
}

/// The throttle, or the mean of a multirotor's motors.
fn throttle(flight: &Flight, is_wing: bool, t_s: f64) -> f64 {
    let now = flight.operating().at(t_s);
    let motors: Vec<f64> = (0..MOTORS as u8).filter_map(|k| now.get(Channel::Motor(k))).collect();
    let mean = || (!is_wing && !motors.is_empty()).then(|| motors.iter().sum::<f64>() / motors.len() as f64);
    now.get(Channel::Throttle).or_else(mean).unwrap_or(0.0)
}

/// The vehicle at another time, on the straight line between its neighbours; at the ends as it is there.
fn carriage_at(all: &[Carriage], elapsed_s: f64) -> Option<Carriage> {
    let next = all.partition_point(|c| c.elapsed_s <= elapsed_s);
    let before = all.get(next.saturating_sub(1))?;
    let Some(after) = all.get(next).filter(|_| next > 0) else { return Some(*before) };
    let share = (elapsed_s - before.elapsed_s) / (after.elapsed_s - before.elapsed_s);
    let mix = |a: f64, b: f64| a + (b - a) * share;
    Some(Carriage {
        elapsed_s,
        c_nb: before.c_nb.try_slerp(&after.c_nb, share, 1e-9).unwrap_or(before.c_nb),
        v_n: before.v_n.lerp(&after.v_n, share),
        height_m: mix(before.height_m, after.height_m),
        throttle: mix(before.throttle, after.throttle),
        force: before.force.zip(after.force).map(|(before, after)| before.lerp(&after, share)),
    })
}
