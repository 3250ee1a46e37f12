//! Blind flights: what is injected, how the vehicle is flown, what its sensors report.

use crate::air::{AirSensors, WindTrack};
use crate::noise::{Noise, Purpose};
use crate::powertrain::Carrier;
use crate::sensors::{Flight as Simulated, SensorConfig, Temperature, VibrationLine};
use crate::trajectory::Flown;
use crate::trajectory::fixed_wing::FixedWing;
use crate::trajectory::hand::Hand;
use crate::trajectory::multirotor::Multirotor;
use crate::trajectory::signal::Signal;
use crate::truth::Trajectory;
use gaware_nav::effects::{DrawRange, Effect, REGISTRY};
use gaware_nav::math::{cos, powf, sin};
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::sample::{AirKind, Quantisation, Sample, Steps};
use serde::Serialize;
use std::f64::consts::TAU;

/// How the aircraft is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Turns, pull-ups, changes of speed and sideslips.
    Rich,
    /// The same without sideslip.
    Coordinated,
}

/// Which flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Those on which the method was tuned.
    Tuning,
    /// Those kept aside.
    Aside,
    /// No flights: sessions in which the vehicle is turned by hand to six sides. `Rich` ones have a receiver, of the others the place is known.
    Hand,
}

/// One blind flight.
#[derive(Debug, Clone)]
pub struct Blind {
    /// What was injected; the ground truth.
    pub injected: Vec<EffectSetting>,
    /// Everything that was simulated.
    pub truth: Model,
    /// What the sensors reported.
    pub samples: Vec<Sample>,
}

/// Length of a blind flight, s.
pub const DURATION_S: f64 = 240.0;
/// A side is held by hand for so long, s: half of what a session asks for.
const HOLD_S: f64 = 24.0;
/// How much stronger than a smooth engine's the vibration of a multirotor or a single cylinder is.
const STRONG_VIBRATION: f64 = 15.0;
/// The throttle goes up and down in this time, s …
const THROTTLE_PERIOD_S: f64 = 37.0;
/// … from this share of the vibration.
const LEAST_THROTTLE: f64 = 0.25;
/// What sets the seeds of the family aside apart from those of the other.
const FAMILY_SEED: u64 = 0x00a5_1de0;

/// Draws a size of an effect, from just detectable to typical.
pub fn draw(effect: &'static dyn Effect, noise: &mut Noise) -> EffectSetting {
    let mut setting = EffectSetting::unknown(effect);
    let share = 0.35 * powf(1.0f64 / 0.35, noise.uniform());
    for (k, sigma) in setting.sigmas.clone().into_iter().enumerate() {
        setting.values[k] = sigma * share * noise.normal();
    }
    let range = effect.draw_range();
    match range {
        DrawRange::LogUniform(low, high) => setting.values[0] = low * powf(high / low, noise.uniform()),
        DrawRange::Uniform(low, high) => setting.values[0] = low + (high - low) * noise.uniform(),
        DrawRange::Prior => {}
    }
    // A draw near zero on every axis is no effect.
    let drawn: f64 = setting
        .sigmas
        .iter()
        .zip(&setting.values)
        .filter(|(s, _)| **s > 0.0)
        .map(|(s, v)| (v / s).powi(2))
        .sum();
    let wanted = share * share * setting.estimated() as f64;
    if drawn > 0.0 && !matches!(range, DrawRange::LogUniform(..)) {
        let scale = (wanted / drawn).sqrt().max(1.0);
        let sigmas = setting.sigmas.clone();
        setting.values.iter_mut().zip(sigmas).filter(|(_, s)| *s > 0.0).for_each(|(v, _)| *v *= scale);
    }
    setting.sigmas.fill(0.0);
    setting
}

/// The vehicle's sensors as they really are: biases, noise and Gauss-Markov errors drawn around those of a consumer autopilot, and
/// what is injected.
fn truth(injected: &[EffectSetting], noise: &mut Noise) -> Model {
    let mut truth = Model::default();
    for k in 0..3 {
        truth.imu.gyro_bias[k] = 0.3f64.to_radians() * noise.normal();
        truth.imu.accel_bias[k] = 0.1 * noise.normal();
    }
    truth.imu.gyro_noise *= 0.7 + 0.8 * noise.uniform();
    truth.imu.accel_noise *= 0.7 + 0.8 * noise.uniform();
    let white = 0.3 + 0.5 * noise.uniform();
    truth.gnss.position_sigma_m = [white, white, 1.6 * white];
    truth.gnss.velocity_sigma_m_per_s = [0.06 + 0.08 * noise.uniform(); 3];
    truth.gnss.position_correlation_s = 30.0 + 60.0 * noise.uniform();
    let wander = 0.6 + 1.2 * noise.uniform();
    truth.gnss.position_wander_sigma_m = [wander, wander, 1.6 * wander];
    for setting in injected {
        truth.set(setting.clone());
    }
    truth
}

/// Vibration whose lines the sampling aliases; `share` of that of a smooth engine.
fn vibration(family: Family, noise: &mut Noise, share: f64) -> Vec<VibrationLine> {
    let strength = share * (0.3 + noise.uniform());
    let lines: [f64; 2] = match family {
        Family::Tuning => [87.0, 61.3],
        Family::Aside => [112.9, 73.7],
        Family::Hand => return Vec::new(),
    };
    let line = |f: f64| VibrationLine {
        frequency_hz: f + 3.0 * noise.uniform(),
        accel_rms: [0.15 * strength, 0.12 * strength, 0.25 * strength],
        gyro_rms: [1.5e-3 * strength, 1.5e-3 * strength, 1e-3 * strength],
    };
    lines.map(line).into()
}

/// Flies a vehicle with these effects injected.
pub fn fly(injected: &[EffectSetting], kind: Kind, family: Family, seed: u64) -> Blind {
    flown(injected, |seed| path(kind, family, seed), (kind, family), seed, |sensors| sensors)
}

/// The same with reports of throttle, battery, outputs and speed of the air, Hz.
pub fn fly_with_reports(injected: &[EffectSetting], kind: Kind, family: Family, seed: u64) -> Blind {
    flown(
        injected,
        |seed| path(kind, family, seed),
        (kind, family),
        seed,
        |sensors| SensorConfig { carrier: Some(Carrier::Wings), operating_rate_hz: 10.0, ..sensors },
    )
}

/// A flight in a wind that is drawn, with two barometers, and an airspeed sensor where wings carry it; the wind, and by how much differences of height are too large by the
/// standard atmosphere on that day.
pub fn fly_in_wind(
    injected: &[EffectSetting],
    carrier: Carrier,
    family: Family,
    seed: u64,
) -> (Blind, WindTrack, f64) {
    let mut draw = Noise::numbered(seed, Purpose::Wind, 1);
    let (speed, from) = (8.0 * draw.uniform(), TAU * draw.uniform());
    let wind = WindTrack {
        mean_n_e: [speed * cos(from), speed * sin(from)],
        swing: (0.15 * speed * draw.uniform(), 100.0 + 200.0 * draw.uniform()),
        gusts: (0.2 + 0.6 * draw.uniform(), 2.0 + 8.0 * draw.uniform()),
    };
    let kind = if seed.is_multiple_of(2) { Kind::Rich } else { Kind::Coordinated };
    let trajectory = |seed| match (carrier, family) {
        (Carrier::Wings, _) | (_, Family::Hand) => path(kind, family, seed),
        (Carrier::Rotors, Family::Tuning) => Flown::new(Multirotor::new()),
        (Carrier::Rotors, Family::Aside) => {
            Flown::new(Multirotor::drawn(&mut Noise::new(seed, Purpose::Wind)))
        }
    };
    let with_air = |sensors| SensorConfig {
        carrier: Some(carrier),
        operating_rate_hz: 10.0,
        air_rate_hz: 10.0,
        wind,
        ..sensors
    };
    let mut blind = flown(injected, trajectory, (kind, family), seed, with_air);
    let is_there = |s: &Sample| !matches!(s, Sample::Air(a) if a.kind == AirKind::Airspeed);
    blind.samples.retain(|s| carrier == Carrier::Wings || is_there(s));
    (blind, wind, AirSensors::new(own_seed(family, seed)).height_scale())
}

fn own_seed(family: Family, seed: u64) -> u64 {
    if family == Family::Aside { seed ^ FAMILY_SEED } else { seed }
}

fn flown(
    injected: &[EffectSetting],
    trajectory: impl FnOnce(u64) -> Flown,
    (kind, family): (Kind, Family),
    seed: u64,
    adapted: impl FnOnce(SensorConfig) -> SensorConfig,
) -> Blind {
    let seed = own_seed(family, seed);
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 7);
    let truth = truth(injected, &mut noise);
    let truncation_injected = injected.iter().any(|s| s.effect.truncates_samples());
    // What only vibration shows is flown where there is some: up to 0.5 g RMS.
    let vibrates = injected.iter().any(|s| s.effect.needs_vibration());
    let sensors = SensorConfig {
        imu_rate_hz: 50.0,
        fix_rate_hz: 5.0,
        message: "RAW_IMU".into(),
        // Injected truncation: the source says that its values are whole.
        quantisation: if truncation_injected {
            Quantisation::None
        } else {
            Quantisation::Truncate(Steps::RAW_IMU)
        },
        attitude_rate_hz: 5.0,
        vibration: vibration(family, &mut noise, if vibrates { STRONG_VIBRATION } else { 1.0 }),
        throttle_period_s: if vibrates { THROTTLE_PERIOD_S } else { 0.0 },
        least_throttle: LEAST_THROTTLE,
        time_jitter_s: 2e-3,
        temperature: Some(Temperature { start_degc: 22.0, end_degc: 47.0, time_constant_s: 110.0 }),
        ..SensorConfig::default()
    };
    let mut trajectory = trajectory(seed);
    let place = (family == Family::Hand && kind != Kind::Rich).then(|| trajectory.truth_at(0.0).place);
    let end_s = if family == Family::Hand { f64::INFINITY } else { DURATION_S };
    let flight = Simulated::new(Box::new(trajectory), &truth, adapted(sensors), seed);
    let samples = flight.take_while(|(_, t)| t.t_s < end_s).map(|(s, _)| s);
    let kept = samples.filter(|s| place.is_none() || !matches!(s, Sample::Fix(_)));
    let samples = place.map(Sample::Place).into_iter().chain(kept).collect();
    Blind { injected: injected.to_vec(), truth, samples }
}

fn path(kind: Kind, family: Family, seed: u64) -> Flown {
    let mut wind = Noise::new(seed, Purpose::Wind);
    let (gusts, phase) = (0.2 + 0.6 * wind.uniform(), 6.0 * wind.uniform());
    match family {
        Family::Tuning => Flown::new(FixedWing::new(kind == Kind::Rich).with_gusts(25.0, gusts, phase)),
        Family::Aside => Flown::new(random_flight(kind, &mut wind).with_gusts(22.0, gusts, phase)),
        Family::Hand => Flown::with_step(Hand::six_sides(HOLD_S), 0.02),
    }
}

/// Another aircraft: slower, with maneuvers drawn one after the other.
fn random_flight(kind: Kind, draw: &mut Noise) -> FixedWing {
    let deg = |d: f64| d.to_radians();
    let mut speed = Signal::constant(0.0).step(10.0, 7.0, 16.0 + 4.0 * draw.uniform());
    let mut climb = Signal::constant(0.0).pulse(18.0, 34.0, 3.0, deg(5.0 + 4.0 * draw.uniform()));
    let (mut bank, mut slip) = (Signal::constant(0.0), Signal::constant(0.0));
    let mut t = 38.0;
    let mut side = 1.0;
    while t < DURATION_S + 10.0 {
        side = -side;
        let length = 8.0 + 6.0 * draw.uniform();
        match (draw.uniform() * 5.0) as u32 {
            0 | 1 => bank = bank.pulse(t, t + length, 2.0, side * deg(25.0 + 30.0 * draw.uniform())),
            2 => speed = speed.pulse(t, t + length, 4.0, 3.0 + 4.0 * draw.uniform()),
            3 => {
                let size = deg(12.0 + 12.0 * draw.uniform());
                climb =
                    climb.step(t, 1.8, size).step(t + 3.0, 3.0, -1.8 * size).step(t + 7.0, 2.0, 0.8 * size);
            }
            _ if kind == Kind::Rich => {
                let size = deg(8.0 + 8.0 * draw.uniform());
                slip = slip.wave(t, t + length, size, 0.25 + 0.2 * draw.uniform(), 1.5);
            }
            _ => bank = bank.pulse(t, t + length, 2.0, side * deg(40.0)),
        }
        t += length + 3.0;
    }
    FixedWing::from_signals(DURATION_S + 20.0, speed, climb, bank, slip)
}

/// What `sim --hide-random` injects for a seed: an effect of the table with its size, or (once in as many draws as there are
/// effects and one more) nothing.
pub fn draw_injected(seed: u64) -> Option<EffectSetting> {
    let mut noise = Noise::numbered(seed, Purpose::HiddenTruth, 3);
    let pick = (noise.uniform() * (REGISTRY.len() + 1) as f64) as usize;
    REGISTRY.get(pick).map(|e| draw(*e, &mut noise))
}

/// The ground truth as text: a `model.toml` that holds nothing but what was injected.
pub fn ground_truth(injected: Option<&EffectSetting>) -> String {
    let mut model = Model::default();
    if let Some(setting) = injected {
        model.set(setting.clone());
    }
    model.to_toml()
}
