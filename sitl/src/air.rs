//! The air around a simulated vehicle and what measures it: wind that carries the flight along, pressure of a day that is warmer or colder than the
//! standard and whose weather changes, barometers and a pitot tube, through the effects of the model.
//!
//! On purpose another atmosphere than the estimator's: the pressure comes from the day's own temperature, and the density from both.

use crate::noise::{GaussMarkov, Noise, Purpose};
use crate::truth::{Motion, Trajectory, Truth, transport_rate_n};
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::effects::{AirInstant, SEA_LEVEL_DENSITY};
use gaware_nav::model::Model;
use gaware_nav::sample::{AirKind, AirSample};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Gas constant of dry air, J/kg/K, and how fast the temperature falls with height, K/m.
const AIR: (f64, f64) = (287.053, 0.0065);
/// Noise of a barometer, Pa (an MS5611 over 20 ms), and of the airspeed, m/s.
const NOISE: [f64; 2] = [3.0, 0.3];
/// Weather: 1-sigma, Pa, and correlation time, s.
const WEATHER: (f64, f64) = (12.0, 900.0);
/// Gusts that do not carry the vehicle along: 1-sigma, m/s, and correlation time, s.
const GUSTS: (f64, f64) = (0.4, 5.0);
/// Barometers warm up by this much, K, in this time, s.
const WARMS: (f64, f64) = (15.0, 150.0);
/// What is measured in turn: two barometers and an airspeed sensor; the effects of the model are those of the first of each kind.
pub const AIR_SENSORS: [(AirKind, u8); 3] =
    [(AirKind::Barometer, 0), (AirKind::Barometer, 1), (AirKind::Airspeed, 0)];

/// Wind that carries the vehicle: its mean and a slow swing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WindTrack {
    /// Mean velocity of the air, north and east, m/s.
    pub mean_n_e: [f64; 2],
    /// Amplitude of the swing, m/s, and its period, s.
    pub swing: (f64, f64),
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
        let (sin, cos) = (rate * t_s).sin_cos();
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
            lon_rad: own.place.lon_rad + way.y / ((r_e + own.place.height_m) * own.place.lat_rad.cos()),
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
        }
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
        let still = (101_325.0 + weather) * (temperature / sea).powf(STANDARD_GRAVITY / (AIR.0 * AIR.1));
        let density = still / (AIR.0 * temperature);
        let gusts = self.gusts.at(truth.t_s, GUSTS.1) * GUSTS.0;
        let velocity = truth.c_nb.transpose() * (truth.v_n - wind.velocity(truth.t_s)) + gusts;
        let to_equivalent = (density / SEA_LEVEL_DENSITY).sqrt();
        let along = velocity.dot(&(truth.c_nb.transpose() * truth.a_n)) / velocity.norm().max(1.0);
        let warm = WARMS.0 * (1.0 - (-truth.t_s / WARMS.1).exp());
        let x = AirInstant {
            velocity,
            density,
            height_m: truth.place.height_m,
            climb: -truth.v_n.z,
            throttle,
            temperature: warm,
            airspeed: [velocity.norm() * to_equivalent, along * to_equivalent],
        };
        let effects = model.effects.iter().filter(|_| sensor == 0);
        let own =
            |name: &str| name.starts_with(if kind == AirKind::Barometer { "baro_" } else { "airspeed_" });
        let added: f64 = effects
            .filter(|s| own(s.effect.name()))
            .filter_map(|s| Some(s.effect.on_air()?.added(&s.values, &x)))
            .sum();
        let noise = self.noise[which].normal() * NOISE[kind as usize];
        let value = match kind {
            // So much height is so much pressure less.
            AirKind::Barometer => still - density * STANDARD_GRAVITY * added + noise,
            AirKind::Airspeed => (x.airspeed[0] + added + noise).max(0.0),
        };
        let temperature_degc = (kind == AirKind::Barometer).then_some(25.0 + warm);
        AirSample { t_s: truth.t_s, kind, sensor, value, temperature_degc }
    }
}
