//! The air around a simulated vehicle and what measures it: wind that carries the flight along, pressure of a day that is warmer or colder than the
//! standard and whose weather changes, barometers and a pitot tube, with the effects of the model.
//!
//! On purpose another atmosphere than the estimator's: the pressure comes from the day's own temperature, and the density from both. A delayed sensor
//! shows what it measured a while ago, gusts included, and a pitot tube's offset adds to its pressure before the root is taken.

use crate::noise::{GaussMarkov, Noise, Purpose};
use crate::truth::{Motion, Trajectory, Truth, transport_rate_n};
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::effects::{AirDriver, AirInstant, SEA_LEVEL_DENSITY};
use gaware_nav::math::{cos, exp, powf, sin_cos};
use gaware_nav::model::Model;
use gaware_nav::sample::{AirKind, AirSample};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Gas constant of dry air, J/kg/K, and how fast the temperature falls with height, K/m.
const AIR: (f64, f64) = (287.053, 0.0065);
/// Noise of a barometer, Pa (an MS5611 over 20 ms), and of the airspeed, m/s.
const NOISE: [f64; 2] = [3.0, 0.3];
/// Weather: 1-sigma, Pa, and correlation time, s.
const WEATHER: (f64, f64) = (12.0, 900.0);
/// Barometers warm up by this much, K, in this time, s.
const WARMS: (f64, f64) = (15.0, 150.0);
/// What is measured in turn: two barometers and an airspeed sensor; the effects of the model are those of the first of each kind.
pub const AIR_SENSORS: [(AirKind, u8); 3] =
    [(AirKind::Barometer, 0), (AirKind::Barometer, 1), (AirKind::Airspeed, 0)];

/// Wind that carries the vehicle: its mean and a slow swing; and gusts that do not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindTrack {
    /// Mean velocity of the air, north and east, m/s.
    pub mean_n_e: [f64; 2],
    /// Amplitude of the swing, m/s, and its period, s.
    pub swing: (f64, f64),
    /// Gusts: 1-sigma, m/s, and correlation time, s.
    pub gusts: (f64, f64),
}

impl Default for WindTrack {
    fn default() -> Self {
        Self { mean_n_e: [0.0; 2], swing: (0.0, 0.0), gusts: (0.4, 5.0) }
    }
}

impl WindTrack {
    /// Way of the air, its velocity and acceleration, north, east, down.
    fn at(&self, t_s: f64) -> [Vector3<f64>; 3] {
        let [n, e] = self.mean_n_e;
        let (mean, (amplitude, period)) = (Vector3::new(n, e, 0.0), self.swing);
        if period <= 0.0 {
            return [mean * t_s, mean, Vector3::zeros()];
        }
        let (rate, along) = (TAU / period, Vector3::new(0.8, -0.6, 0.0) * amplitude);
        let (sin, cos) = sin_cos(rate * t_s);
        [mean * t_s + along * ((1.0 - cos) / rate), mean + along * sin, along * (cos * rate)]
    }

    /// Velocity of the air, north, east, down, m/s.
    pub fn velocity(&self, t_s: f64) -> Vector3<f64> {
        self.at(t_s)[1]
    }
}

/// A flight through air that moves.
pub struct Carried {
    /// The flight through the air.
    pub inner: Box<dyn Trajectory>,
    /// How the air moves.
    pub wind: WindTrack,
}

impl Trajectory for Carried {
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        let own = self.inner.truth_at(t_s);
        let [way, velocity, acceleration] = self.wind.at(t_s);
        let (r_n, r_e) = own.place.radii();
        let place = Geodetic {
            lat_rad: own.place.lat_rad + way.x / (r_n + own.place.height_m),
            lon_rad: own.place.lon_rad + way.y / ((r_e + own.place.height_m) * cos(own.place.lat_rad)),
            ..own.place
        };
        let rate_nb = own.rate_eb - own.c_nb.transpose() * transport_rate_n(&own.place, &own.v_n);
        let motion = Motion { v_n: own.v_n + velocity, a_n: own.a_n + acceleration, c_nb: own.c_nb, rate_nb };
        Truth::of(t_s, place, &motion)
    }
}

/// All of them.
#[derive(Debug, Clone)]
pub struct AirSensors {
    noise: Vec<Noise>,
    weather: GaussMarkov,
    gusts: GaussMarkov,
    /// Temperature of the day less the standard's, K.
    day: f64,
    /// What each would have shown without delay and noise, with the time.
    recent: [VecDeque<(f64, f64)>; AIR_SENSORS.len()],
}

impl AirSensors {
    /// Of this seed.
    pub fn new(seed: u64) -> Self {
        let numbered = |k: u32| Noise::numbered(seed, Purpose::Air, k);
        Self {
            noise: (0..3).map(numbered).collect(),
            weather: GaussMarkov::new(numbered(3)),
            gusts: GaussMarkov::new(numbered(4)),
            day: 6.0 * numbered(5).normal(),
            recent: Default::default(),
        }
    }

    /// By how much differences of height are too large by the standard atmosphere on this day, as a share.
    pub fn height_scale(&self) -> f64 {
        -self.day / (288.15 + self.day)
    }

    /// What one of [`AIR_SENSORS`] measures at this truth, with this throttle, in this wind; call it in order of time.
    pub fn at(
        &mut self,
        which: usize,
        truth: &Truth,
        model: &Model,
        wind: &WindTrack,
        throttle: f64,
    ) -> AirSample {
        let (kind, sensor) = AIR_SENSORS[which];
        let sea = 288.15 + self.day;
        let temperature = sea - AIR.1 * truth.place.height_m;
        let weather = WEATHER.0 * self.weather.at(truth.t_s, WEATHER.1).x;
        let still = (101_325.0 + weather) * powf(temperature / sea, STANDARD_GRAVITY / (AIR.0 * AIR.1));
        let density = still / (AIR.0 * temperature);
        let gusts = self.gusts.at(truth.t_s, wind.gusts.1) * wind.gusts.0;
        let velocity = truth.c_nb.transpose() * (truth.v_n - wind.velocity(truth.t_s)) + gusts;
        let warm = WARMS.0 * (1.0 - exp(-truth.t_s / WARMS.1));
        let x = AirInstant {
            velocity,
            density,
            height_m: truth.place.height_m,
            throttle,
            temperature: warm,
            airspeed: [velocity.norm() * (density / SEA_LEVEL_DENSITY).sqrt(), 0.0],
            ..AirInstant::default()
        };
        let errors = Errors::of(model, kind, sensor, &x);
        let now = match kind {
            // So much height is so much pressure less.
            AirKind::Barometer => still - density * STANDARD_GRAVITY * errors.added,
            AirKind::Airspeed => {
                let pressure = 0.5 * SEA_LEVEL_DENSITY * x.airspeed[0].powi(2) + errors.pressure_pa;
                errors.added + (2.0 * pressure.max(0.0) / SEA_LEVEL_DENSITY).sqrt()
            }
        };
        let noise = self.noise[which].normal() * NOISE[kind as usize];
        let shown = self.late(which, truth.t_s, now, errors.delay_s) + noise;
        let value = if kind == AirKind::Airspeed { shown.max(0.0) } else { shown };
        let temperature_degc = (kind == AirKind::Barometer).then_some(25.0 + warm);
        AirSample { t_s: truth.t_s, kind, sensor, value, temperature_degc }
    }

    /// The value of a while ago; the first one before there was any.
    fn late(&mut self, which: usize, t_s: f64, now: f64, delay_s: f64) -> f64 {
        let recent = &mut self.recent[which];
        recent.push_back((t_s, now));
        while recent.get(1).is_some_and(|next| next.0 <= t_s - delay_s) {
            recent.pop_front();
        }
        let Some((from, a)) = recent.front().copied() else { return now };
        let (to, b) = recent.get(1).copied().unwrap_or((t_s, now));
        let share = if to > from { ((t_s - delay_s - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        a + (b - a) * share
    }
}

/// What is wrong with a sensor at an instant.
#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    /// m or m/s.
    added: f64,
    /// Of a pitot tube, Pa.
    pressure_pa: f64,
    delay_s: f64,
}

impl Errors {
    fn of(model: &Model, kind: AirKind, sensor: u8, x: &AirInstant) -> Self {
        let mut out = Self::default();
        let family = if kind == AirKind::Barometer { "baro_" } else { "airspeed_" };
        let own = |name: &str| sensor == 0 && name.starts_with(family);
        for setting in model.effects.iter().filter(|s| own(s.effect.name())) {
            let Some(effect) = setting.effect.on_air() else { continue };
            match effect.drivers {
                [AirDriver::SpeedByPressure] => out.pressure_pa += setting.values[0],
                [driver] if driver.is_delay() => out.delay_s += setting.values[0],
                _ => out.added += effect.added(&setting.values, x),
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A delay is that of a real sensor: what was there a while ago, not a derivative.
    #[test]
    fn a_late_sensor_shows_what_was_there_before() {
        let mut sensors = AirSensors::new(1);
        let shown: Vec<f64> =
            (0..40).map(|k| f64::from(k) * 0.1).map(|t| sensors.late(0, t, t * t, 1.25)).collect();
        assert!(shown[..13].iter().all(|v| *v == 0.0), "{shown:?}");
        assert!((shown[30] - 1.75f64.powi(2)).abs() < 0.003, "{}", shown[30]);
        assert_eq!(sensors.late(0, 4.0, 16.0, 0.0), 16.0);
    }
}
