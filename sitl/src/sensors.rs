//! The sensors of a simulated vehicle: truth in, samples out, through the effects of a model.
//!
//! ω̃ = ω_ib + b_g + Σ effects + noise and f̃ likewise (the paper, eqs. (1) and (2)), then the rounding of the source.
//! Fixes report the vehicle some time before their stamp. The simulation is what the model says.

use crate::air::{AIR_SENSORS, AirSensors, Carried, WindTrack};
use crate::magnetometer::{COMPASSES, Magnetometers};
use crate::noise::{GaussMarkov, Noise, Purpose};
use crate::powertrain::{Carrier, Powertrain};
use crate::truth::{Trajectory, Truth};
use gaware_nav::earth::Geodetic;
use gaware_nav::effects::{
    Antenna, Conditions, FixInstant, Instant, Kernel, LateRate, Older, ReportedSample, Surroundings,
};
use gaware_nav::math::{cos, exp, hypot, sin};
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::operating::{Channel, LagBank, Operating, OperatingSample};
use gaware_nav::rotation::{euler_from_c_nb, wrap_pi};
use gaware_nav::sample::{
    AirSample, AttitudeHint, FieldSample, FixVelocity, GnssFix, ImuSample, ImuStream, Quantisation, Sample,
    SampleKind,
};
use nalgebra::Vector3;
use std::f64::consts::{SQRT_2, TAU};

mod drawn;
mod flight;

pub use drawn::draw_vehicle;
pub use flight::Flight;

/// One line of a vibration spectrum; sampling aliases it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VibrationLine {
    /// Hz.
    pub frequency_hz: f64,
    /// Specific force on each axis, RMS, m/s².
    pub accel_rms: [f64; 3],
    /// Angular rate about each axis, RMS, rad/s.
    pub gyro_rms: [f64; 3],
}

/// Temperature of the inertial unit: it warms up exponentially.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Temperature {
    /// At the start, °C.
    pub start_degc: f64,
    /// In the end, °C.
    pub end_degc: f64,
    /// Time constant, s.
    pub time_constant_s: f64,
}

impl Temperature {
    /// At a time, °C.
    pub fn at(&self, t_s: f64) -> f64 {
        self.end_degc + (self.start_degc - self.end_degc) * exp(-t_s / self.time_constant_s)
    }
}

/// Rates and habits of the sensors, apart from what the [`Model`] says.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorConfig {
    /// Inertial samples, Hz.
    pub imu_rate_hz: f64,
    /// Fixes, Hz; 0 = none.
    pub fix_rate_hz: f64,
    /// Time of the first fix, s.
    pub fix_phase_s: f64,
    /// Whether fixes carry vertical velocity.
    pub vertical_velocity: bool,
    /// Whether fixes carry their own 1-sigma figures (those of the model).
    pub report_sigmas: bool,
    /// Name of the source message.
    pub message: String,
    /// Rounding of the source.
    pub quantisation: Quantisation,
    /// The autopilot's own attitude, Hz; 0 = none.
    pub attitude_rate_hz: f64,
    /// 1-sigma of its slowly wandering error, rad.
    pub attitude_sigma_rad: [f64; 3],
    /// Vibration at full throttle.
    pub vibration: Vec<VibrationLine>,
    /// The throttle goes between this share and full …
    pub least_throttle: f64,
    /// … and back in this time, s; 0 = it stays full.
    pub throttle_period_s: f64,
    /// Stamps of inertial samples are late by up to this, s, evenly spread.
    pub time_jitter_s: f64,
    /// Temperature; `None` = the samples carry none and no effect sees any.
    pub temperature: Option<Temperature>,
    /// Times without fixes: from, to, s.
    pub outages: Vec<(f64, f64)>,
    /// Samples of each compass, Hz; 0 = none.
    pub field_rate_hz: f64,
    /// Samples of each barometer and of the airspeed, Hz; 0 = none.
    pub air_rate_hz: f64,
    /// Wind that carries the flight along.
    pub wind: WindTrack,
    /// What drives the vehicle; `None` = nothing is reported of it and no effect sees any.
    pub carrier: Option<Carrier>,
    /// Reports of throttle, battery and outputs, Hz; 0 = none.
    pub operating_rate_hz: f64,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            imu_rate_hz: 200.0,
            fix_rate_hz: 5.0,
            fix_phase_s: 0.0,
            vertical_velocity: false,
            report_sigmas: false,
            message: String::new(),
            quantisation: Quantisation::None,
            attitude_rate_hz: 0.0,
            attitude_sigma_rad: [0.01, 0.01, 0.03],
            vibration: Vec::new(),
            least_throttle: 1.0,
            throttle_period_s: 0.0,
            time_jitter_s: 0.0,
            temperature: None,
            outages: Vec::new(),
            field_rate_hz: 0.0,
            air_rate_hz: 0.0,
            wind: WindTrack::default(),
            carrier: None,
            operating_rate_hz: 0.0,
        }
    }
}

impl SensorConfig {
    /// Share of the vibration at full throttle.
    fn throttle(&self, t_s: f64) -> f64 {
        if self.throttle_period_s <= 0.0 {
            return 1.0;
        }
        let swing = 0.5 - 0.5 * cos(TAU * t_s / self.throttle_period_s);
        self.least_throttle + (1.0 - self.least_throttle) * swing
    }
}

/// Correlation time of the error of the autopilot's own attitude, s.
const ATTITUDE_CORRELATION_S: f64 = 30.0;

/// The sensors: what they read follows from the truth, the model, the seed, and the order of the calls.
#[derive(Debug, Clone)]
pub struct Sensors {
    model: Model,
    config: SensorConfig,
    quantisation: Quantisation,
    gyro_noise: Noise,
    accel_noise: Noise,
    walk_noise: Noise,
    position_noise: Noise,
    velocity_noise: Noise,
    jitter: Noise,
    wander: GaussMarkov,
    attitude: GaussMarkov,
    gyro_walk: Vector3<f64>,
    /// The last sample of each faulty source.
    told: Vec<Option<ReportedSample>>,
    accel_walk: Vector3<f64>,
    /// The last two true rates with their times, rad/s and s.
    rates: [Option<(f64, Vector3<f64>)>; 2],
    /// Phase per line and axis: three of force, three of rate.
    phases: Vec<[f64; 6]>,
    magnetometers: Magnetometers,
    air: AirSensors,
    powertrain: Option<Powertrain>,
    lags: LagBank,
    /// What the vehicle did beside moving at the last inertial sample, and the height of the first, m.
    conditions: Conditions,
    start_height_m: Option<f64>,
}

impl Sensors {
    /// New sensors of this seed.
    pub fn new(model: &Model, config: SensorConfig, seed: u64) -> Self {
        let stream = ImuStream { quantisation: config.quantisation, ..ImuStream::default() };
        let mut phase = Noise::new(seed, Purpose::Vibration);
        let phases =
            config.vibration.iter().map(|_| std::array::from_fn(|_| TAU * phase.uniform())).collect();
        let noise = |purpose| Noise::new(seed, purpose);
        Self {
            quantisation: model.quantisation_of(&stream),
            model: model.clone(),
            powertrain: config.carrier.map(|carrier| Powertrain::new(carrier, seed)),
            lags: LagBank::default(),
            conditions: Conditions::default(),
            start_height_m: None,
            config,
            gyro_noise: noise(Purpose::Gyro),
            accel_noise: noise(Purpose::Accel),
            walk_noise: noise(Purpose::BiasWalk),
            position_noise: noise(Purpose::Position),
            velocity_noise: noise(Purpose::Velocity),
            jitter: noise(Purpose::Jitter),
            wander: GaussMarkov::new(noise(Purpose::PositionWander)),
            attitude: GaussMarkov::new(noise(Purpose::Attitude)),
            gyro_walk: Vector3::zeros(),
            told: model.effects.iter().map(|_| None).collect(),
            accel_walk: Vector3::zeros(),
            rates: [None; 2],
            phases,
            magnetometers: Magnetometers::new(seed),
            air: AirSensors::new(seed),
        }
    }

    /// The same without the source's rounding, for whoever makes the messages.
    pub fn unrounded(model: &Model, config: SensorConfig, seed: u64) -> Self {
        Self { quantisation: Quantisation::None, ..Self::new(model, config, seed) }
    }

    /// Rates and habits.
    pub fn config(&self) -> &SensorConfig {
        &self.config
    }

    /// The model that is simulated.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// What the samples claim to be.
    pub fn stream(&self) -> ImuStream {
        ImuStream {
            message: self.config.message.clone(),
            kind: SampleKind::Point,
            quantisation: self.config.quantisation,
        }
    }

    /// The inertial sample at this truth; call it once per sample in order of time.
    pub fn imu(&mut self, truth: &Truth) -> ImuSample {
        self.imu_after(truth, 1.0 / self.config.imu_rate_hz)
    }

    /// The same when the last sample was taken `interval_s` before: noise and bias walk are those of that interval.
    pub fn imu_after(&mut self, truth: &Truth, interval_s: f64) -> ImuSample {
        let (vibration_force, vibration_rate) = self.vibration(truth.t_s);
        let temperature = self.config.temperature.map(|t| t.at(truth.t_s));
        let x = Instant {
            t_s: truth.t_s,
            rate: truth.rate_ib + vibration_rate,
            force: truth.force + vibration_force,
            temperature_above_25_degc: temperature.map_or(0.0, |t| t - 25.0),
            around: self.around(truth),
            conditions: self.conditions(truth, temperature),
        };
        let per_sample = 1.0 / interval_s.sqrt();
        let imu = &self.model.imu;
        let mut gyro = x.rate
            + Vector3::from(imu.gyro_bias)
            + self.gyro_walk
            + self.gyro_noise.normal3() * (imu.gyro_noise * per_sample);
        let mut accel = x.force
            + Vector3::from(imu.accel_bias)
            + self.accel_walk
            + self.accel_noise.normal3() * (imu.accel_noise * per_sample);
        let (mut gyro_walk, mut accel_walk) = (0.0f64, 0.0f64);
        for setting in &self.model.effects {
            gyro += setting.effect.gyro(&setting.values, &x);
            accel += setting.effect.accel(&setting.values, &x);
            let walk = setting.effect.bias_walk(&setting.values);
            gyro_walk = hypot(gyro_walk, walk.gyro);
            accel_walk = hypot(accel_walk, walk.accel);
        }
        self.gyro_walk += self.walk_noise.normal3() * (gyro_walk / per_sample);
        self.accel_walk += self.walk_noise.normal3() * (accel_walk / per_sample);
        let (mut gyro, mut accel) = self.quantisation.apply(&gyro, &accel);
        let mistakes = self.model.effects.iter().filter(|s| s.effect.is_source_mistake());
        for (setting, before) in mistakes.zip(&mut self.told) {
            let finished = [gyro, accel];
            let told = setting.effect.source_after(finished, before.as_ref());
            let count = before.map_or(0, |b| b.count) + 1;
            *before = Some(ReportedSample { raw: finished, reported: told, count });
            [gyro, accel] = told;
        }
        let late_s = self.config.time_jitter_s * self.jitter.uniform();
        ImuSample { t_s: truth.t_s + late_s, gyro, accel, temperature_degc: temperature }
    }

    /// The surroundings of this truth: derivatives by the last two before it, and the power of the vibration as it is.
    fn around(&mut self, truth: &Truth) -> Surroundings {
        let power = self.config.vibration.iter().fold(Vector3::zeros(), |sum: Vector3<f64>, line| {
            sum + Vector3::from(line.accel_rms.map(|rms| (rms * self.config.throttle(truth.t_s)).powi(2)))
        });
        let now = (truth.t_s, truth.rate_ib);
        let derivatives = match self.rates {
            [Some(old), Some(last)] if old.0 < last.0 && last.0 < now.0 => {
                // Newton's divided differences: the parabola through three points.
                let slope = |a: (f64, Vector3<f64>), b: (f64, Vector3<f64>)| (b.1 - a.1) / (b.0 - a.0);
                let (before, after) = (slope(old, last), slope(last, now));
                let bend = (after - before) / (now.0 - old.0);
                [after + bend * (now.0 - last.0), bend * 2.0]
            }
            _ => [Vector3::zeros(); 2],
        };
        self.rates = [self.rates[1], Some(now)];
        Surroundings { rate_derivatives: derivatives, late: LateRate::default(), vibration: power }
    }

    /// What the vehicle does beside moving.
    fn conditions(&mut self, truth: &Truth, temperature_degc: Option<f64>) -> Conditions {
        self.start_height_m.get_or_insert(truth.place.height_m);
        let beside = Conditions {
            operating: self.powertrain.as_mut().map(|p| p.at(truth)).unwrap_or_default(),
            elapsed_s: truth.t_s,
            lagged_degc: temperature_degc.map(|t| self.lags.push(truth.t_s, t - 25.0)).unwrap_or_default(),
            ..Conditions::default()
        };
        self.conditions = self.of_motion(truth, beside);
        self.conditions
    }

    /// The same with the motion of this truth.
    fn of_motion(&self, truth: &Truth, beside: Conditions) -> Conditions {
        Conditions {
            speed: truth.v_n.norm(),
            height_m: truth.place.height_m - self.start_height_m.unwrap_or(truth.place.height_m),
            heading_rad: euler_from_c_nb(&truth.c_nb).z,
            ..beside
        }
    }

    /// What the autopilot reports of throttle, battery and outputs at the last inertial sample.
    pub fn operating(&mut self) -> Operating {
        self.powertrain.as_mut().map(Powertrain::reported).unwrap_or_default()
    }

    fn vibration(&self, t_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (mut force, mut rate) = (Vector3::zeros(), Vector3::zeros());
        let throttle = self.config.throttle(t_s);
        for (line, phase) in self.config.vibration.iter().zip(&self.phases) {
            let angle = TAU * line.frequency_hz * t_s;
            for axis in 0..3 {
                force[axis] += throttle * SQRT_2 * line.accel_rms[axis] * sin(angle + phase[axis]);
                rate[axis] += throttle * SQRT_2 * line.gyro_rms[axis] * sin(angle + phase[axis + 3]);
            }
        }
        (force, rate)
    }

    /// How much older than its stamp the fix with this stamp is, s.
    pub fn fix_delay_s(&self, stamp_s: f64) -> f64 {
        self.model.effects.iter().map(|s| s.effect.fix_delay_s(&s.values, stamp_s)).sum()
    }

    /// The fix with this stamp, from the truth around its time of validity, and that time, s. A receiver that smooths reports the mean
    /// of two instants, by the distance and the weights that its kernel says.
    pub fn fix(&mut self, stamp_s: f64, mut truth_at: impl FnMut(f64) -> Truth) -> (GnssFix, f64) {
        let effects = || self.model.effects.iter();
        let valid_s = stamp_s - self.fix_delay_s(stamp_s);
        let older_s = valid_s - effects().map(|s| s.effect.velocity_delay_s(&s.values)).sum::<f64>();
        let kernels = effects().map(|s| s.effect.kernel(&s.values));
        let (instants, newer) = two_instants(kernels.fold(Kernel::default(), Kernel::and));
        let mut around = |t_s: f64| instants.map(|by| truth_at((t_s + by).max(0.0)));
        let (truths, older) = (around(valid_s), around(older_s));
        let antenna = |truths: &[Truth; 2]| truths.each_ref().map(|t| self.antenna(stamp_s, t));
        let ([[p1, _], [p2, _]], [[_, v1], [_, v2]]) = (antenna(&truths), antenna(&older));
        let [here, there] = &truths;
        let place = between(&here.place, &there.place, newer);
        let gnss = &self.model.gnss;
        let white = self.position_noise.normal3().component_mul(&Vector3::from(gnss.position_sigma_m));
        let correlated = self.wander.at(stamp_s, gnss.position_correlation_s);
        let mut offset = white;
        if gnss.position_correlation_s > 0.0 {
            offset += correlated.component_mul(&Vector3::from(gnss.position_wander_sigma_m));
        }
        offset += p1.lerp(&p2, newer);
        let mut velocity = older[0].v_n.lerp(&older[1].v_n, newer)
            + self.velocity_noise.normal3().component_mul(&Vector3::from(gnss.velocity_sigma_m_per_s));
        velocity += v1.lerp(&v2, newer);
        (self.reported(stamp_s, &displaced(&place, &offset), &velocity), valid_s)
    }

    /// What the effects add to position and velocity of a fix at an instant, north, east, down. The truth of another time is exact, and
    /// stands in for what an effect says of an older velocity and of smoothing.
    fn antenna(&self, stamp_s: f64, truth: &Truth) -> [Vector3<f64>; 2] {
        let x = FixInstant {
            t_s: truth.t_s,
            v_n: truth.v_n,
            a_n: truth.a_n,
            smoothed_a_n: truth.a_n,
            skewed_n: Vector3::zeros(),
            c_nb: truth.c_nb,
            rate_eb: truth.rate_eb,
            force_rate: Vector3::zeros(),
            antenna: Antenna::default(),
            older: Older::default(),
            elapsed_s: stamp_s,
            conditions: Conditions { elapsed_s: stamp_s, ..self.of_motion(truth, self.conditions) },
        };
        let by_time = |s: &EffectSetting| {
            let (e, p) = (s.effect, &s.values);
            e.velocity_delay_s(p) != 0.0 || !e.kernel(p).is_none()
        };
        let mut sum = [Vector3::zeros(); 2];
        for setting in self.model.effects.iter().filter(|s| !by_time(s)) {
            let added = setting.effect.fix(&setting.values, &x);
            sum.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        }
        sum
    }

    fn reported(&self, stamp_s: f64, position: &Geodetic, velocity: &Vector3<f64>) -> GnssFix {
        let gnss = &self.model.gnss;
        GnssFix {
            t_s: stamp_s,
            position: *position,
            velocity: if self.config.vertical_velocity {
                FixVelocity::Full((*velocity).into())
            } else {
                FixVelocity::Horizontal([velocity.x, velocity.y])
            },
            position_sigma_m: self.config.report_sigmas.then_some(gnss.position_sigma_m),
            velocity_sigma_m_per_s: self.config.report_sigmas.then_some(gnss.velocity_sigma_m_per_s),
            yaw_rad: None,
        }
    }

    /// The autopilot's own attitude.
    pub fn attitude(&mut self, truth: &Truth) -> AttitudeHint {
        let error = self
            .attitude
            .at(truth.t_s, ATTITUDE_CORRELATION_S)
            .component_mul(&Vector3::from(self.config.attitude_sigma_rad));
        let angles = euler_from_c_nb(&truth.c_nb) + error;
        AttitudeHint { t_s: truth.t_s, roll_pitch_yaw: [angles.x, angles.y, wrap_pi(angles.z)] }
    }

    /// What a compass measures at this truth, T; nothing where it has no field.
    pub fn field(&mut self, compass: u8, truth: &Truth) -> Option<Vector3<f64>> {
        let current = self.powertrain.as_ref().and_then(|p| p.now().get(Channel::Current));
        self.magnetometers.at(compass, truth, &self.model, current.unwrap_or(0.0))
    }

    /// What one of [`AIR_SENSORS`] measures at this truth; where the air moves otherwise than the flight's own wind, in that wind.
    pub fn air(&mut self, which: usize, truth: &Truth, wind: Option<WindTrack>) -> AirSample {
        let throttle = self.powertrain.as_ref().and_then(|p| p.now().get(Channel::Throttle));
        let wind = wind.unwrap_or(self.config.wind);
        self.air.at(which, truth, &self.model, &wind, throttle.unwrap_or(0.0))
    }

    /// Whether there is no fix at this time.
    pub fn in_outage(&self, t_s: f64) -> bool {
        self.config.outages.iter().any(|(from, to)| (*from..*to).contains(&t_s))
    }
}

/// How long before and after the mean of its kernel a receiver measures, s, and the weight of the later of both instants.
fn two_instants(kernel: Kernel) -> ([f64; 2], f64) {
    let smoothing_s2 = kernel.smoothing_s2.max(0.0);
    // With weights (1 ± δ/h)/2 of instants ± h about the middle the mean is δ later, half the variance (h² − δ²)/2, and the third moment −2δ times the variance.
    let ahead_s = if smoothing_s2 > 0.0 { -1.5 * kernel.skew_s3 / smoothing_s2 } else { 0.0 };
    let half_s = hypot((2.0 * smoothing_s2).sqrt(), ahead_s);
    let newer = if half_s > 0.0 { 0.5 + 0.5 * ahead_s / half_s } else { 0.5 };
    ([-half_s - ahead_s, half_s - ahead_s], newer)
}

/// A place so far on the way from one to another.
fn between(a: &Geodetic, b: &Geodetic, share: f64) -> Geodetic {
    Geodetic {
        lat_rad: a.lat_rad + share * (b.lat_rad - a.lat_rad),
        lon_rad: a.lon_rad + share * wrap_pi(b.lon_rad - a.lon_rad),
        height_m: a.height_m + share * (b.height_m - a.height_m),
    }
}

/// A place moved by north, east, down, m.
fn displaced(place: &Geodetic, by: &Vector3<f64>) -> Geodetic {
    let (r_n, r_e) = place.radii();
    Geodetic {
        lat_rad: place.lat_rad + by.x / (r_n + place.height_m),
        lon_rad: place.lon_rad + by.y / ((r_e + place.height_m) * cos(place.lat_rad)),
        height_m: place.height_m - by.z,
    }
}

#[cfg(test)]
mod tests;
