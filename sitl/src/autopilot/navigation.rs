//! The navigation filter of the simulated autopilot: strapdown integration with constant-gain corrections by GNSS and compass, as a small
//! autopilot has (Mahony, Hamel, Pflimlin, IEEE Trans. Autom. Control 53 (2008) 1203-1218 for the attitude; Groves 2013, section 14.1 for
//! the coupling of tilt and velocity). It has nothing in common with the filter of this project but the sensors.
//!
//! It uses the parameters as the firmware does: a fix is compared with the state of `delay` ago, at the place of the antenna; samples come
//! calibrated. What it reports of itself are the test ratios of ArduPilot (`AP_NavEKF3/AP_NavEKF3_PosVelFusion.cpp`) or of PX4
//! (`EKF/ekf.h`, `updateAidSourceStatus`: low-passed with their sign, 0.5 s).

use super::params::ParameterTable;
use super::{Autopilot, Flavour};
use crate::truth::{Truth, gravity_n};
use gaware_nav::earth::Geodetic;
use gaware_nav::math::{atan2, cos, hypot};
use gaware_nav::rotation::wrap_pi;
use gaware_nav::sample::{FixVelocity, GnssFix, ImuSample};
use mavlink::dialects::ardupilotmega::*;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// The autopilot calibrates gyros and levels for so long after its start, s.
const ALIGN_S: f64 = 2.0;
/// Past states that are kept, s: more than the largest delay of either firmware.
const HISTORY_S: f64 = 0.5;
/// Gains of the corrections by position and velocity innovations, 1/s, 1/s and 1/s².
const POSITION_GAIN: f64 = 0.6;
const VELOCITY_GAIN: f64 = 0.6;
const POSITION_TO_VELOCITY: f64 = 0.03;
/// Tilt from velocity innovations, 1/s²: a quarter of the square of [`VELOCITY_GAIN`] damps critically.
const TILT_GAIN: f64 = 0.09;
/// Heading from the compass, 1/s.
const HEADING_GAIN: f64 = 0.05;
/// Gyro bias from corrections of the attitude, 1/s; vertical accelerometer bias from vertical velocity, 1/s².
const GYRO_BIAS_GAIN: f64 = 0.01;
const ACCEL_BIAS_GAIN: f64 = 0.01;
/// Assumed 1-sigma of innovations: velocity north, east, down, m/s; position, m; heading, rad. Gates as both firmwares set them, sigma.
const VELOCITY_SIGMA: [f64; 3] = [0.3, 0.3, 0.5];
const POSITION_SIGMA: [f64; 3] = [2.0, 2.0, 3.0];
const HEADING_SIGMA: f64 = 0.15;
const GATE: f64 = 5.0;
/// Time constant of PX4's low-pass of test ratios, s.
const RATIO_SMOOTHING_S: f64 = 0.5;
/// Delay that ArduPilot's driver assumes of its receiver where the parameter is 0, s (`AP_GPS/AP_GPS_UBLOX.cpp`, `get_lag`, M8 and later).
const DRIVER_DELAY_S: f64 = 0.12;

/// What the parameters say of the receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Receiver {
    /// Age of a fix when it arrives, s.
    delay_s: f64,
    /// The antenna from the inertial unit, body axes, m.
    lever_m: Vector3<f64>,
}

impl Receiver {
    /// As the parameters say; `delay_s` holds from boot to boot.
    pub(super) fn new(flavour: Flavour, table: &ParameterTable) -> Self {
        let three = |names: [&str; 3]| Vector3::from(names.map(|n| table.get(n).unwrap_or(0.0)));
        let (antenna, unit) = match flavour {
            Flavour::ArduPilot => {
                (["GPS1_POS_X", "GPS1_POS_Y", "GPS1_POS_Z"], ["INS_POS1_X", "INS_POS1_Y", "INS_POS1_Z"])
            }
            Flavour::Px4 => (
                ["EKF2_GPS_POS_X", "EKF2_GPS_POS_Y", "EKF2_GPS_POS_Z"],
                ["EKF2_IMU_POS_X", "EKF2_IMU_POS_Y", "EKF2_IMU_POS_Z"],
            ),
        };
        let delay_s = match flavour {
            Flavour::ArduPilot => {
                table.get("GPS1_DELAY_MS").filter(|ms| *ms > 0.0).map_or(DRIVER_DELAY_S, |ms| ms * 1e-3)
            }
            Flavour::Px4 => table.get("EKF2_GPS_DELAY").unwrap_or(0.0) * 1e-3,
        };
        Self { delay_s: delay_s.clamp(0.0, HISTORY_S), lever_m: three(antenna) - three(unit) }
    }

    /// The places of now with the delay of the last boot.
    #[must_use]
    pub(super) fn with_delay_of(self, booted: Self) -> Self {
        Self { delay_s: booted.delay_s, ..self }
    }
}

/// The calibration of the accelerometers: subtracted before the factor, as both firmwares do (`AP_InertialSensor_Backend.cpp:132-140`,
/// `lib/sensor_calibration/Accelerometer.hpp:84`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Calibration {
    offset: Vector3<f64>,
    factor: Vector3<f64>,
}

impl Calibration {
    pub(super) fn new(flavour: Flavour, table: &ParameterTable) -> Self {
        let (offset, factor) = match flavour {
            Flavour::ArduPilot => (
                ["INS_ACCOFFS_X", "INS_ACCOFFS_Y", "INS_ACCOFFS_Z"],
                ["INS_ACCSCAL_X", "INS_ACCSCAL_Y", "INS_ACCSCAL_Z"],
            ),
            Flavour::Px4 => (
                ["CAL_ACC0_XOFF", "CAL_ACC0_YOFF", "CAL_ACC0_ZOFF"],
                ["CAL_ACC0_XSCALE", "CAL_ACC0_YSCALE", "CAL_ACC0_ZSCALE"],
            ),
        };
        let three =
            |names: [&str; 3], usual: f64| Vector3::from(names.map(|n| table.get(n).unwrap_or(usual)));
        Self { offset: three(offset, 0.0), factor: three(factor, 1.0) }
    }

    pub(super) fn apply(&self, accel: &Vector3<f64>) -> Vector3<f64> {
        (accel - self.offset).component_mul(&self.factor)
    }
}

/// What the filter reports of itself: innovation over the largest accepted one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct TestRatios {
    velocity: f64,
    position: f64,
    height: f64,
    heading: f64,
}

/// Position (north, east, down from the first fix, m), velocity (m/s), body to local axes.
#[derive(Debug, Clone, Copy)]
struct State {
    t_s: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    /// Angular rate without its bias, rad/s.
    rate: Vector3<f64>,
}

/// The filter.
#[derive(Debug, Clone)]
pub(super) struct Navigation {
    flavour: Flavour,
    origin: Option<(Geodetic, Vector3<f64>)>,
    state: State,
    /// Sums of rate and force, and their number, while it aligns.
    aligning: Option<([Vector3<f64>; 2], u32)>,
    gyro_bias: Vector3<f64>,
    accel_bias_down: f64,
    last: Option<ImuSample>,
    history: VecDeque<State>,
    last_fix_s: Option<f64>,
    /// Signed and low-passed test ratios of PX4: three of velocity, three of position, heading.
    smoothed: [f64; 7],
    ratios: TestRatios,
}

impl Navigation {
    /// After a start.
    pub(super) fn new(flavour: Flavour) -> Self {
        let zero = Vector3::zeros();
        Self {
            flavour,
            origin: None,
            state: State {
                t_s: 0.0,
                position: zero,
                velocity: zero,
                attitude: UnitQuaternion::identity(),
                rate: zero,
            },
            aligning: Some(([zero; 2], 0)),
            gyro_bias: zero,
            accel_bias_down: 0.0,
            last: None,
            history: VecDeque::new(),
            last_fix_s: None,
            smoothed: [0.0; 7],
            ratios: TestRatios::default(),
        }
    }

    /// Takes a calibrated sample; `heading` is the compass's, rad, `started_s` when the autopilot was started.
    fn take_imu(&mut self, sample: &ImuSample, started_s: f64, heading: impl FnOnce() -> f64) {
        let Some(last) = self.last.replace(*sample) else { return };
        let dt = sample.t_s - last.t_s;
        if self.aligning.is_some() {
            self.align(sample, started_s, heading);
            return;
        }
        let Some((_, gravity)) = self.origin else {
            self.state.t_s = sample.t_s;
            return;
        };
        let rate = (last.gyro + sample.gyro) * 0.5 - self.gyro_bias;
        let half = UnitQuaternion::from_scaled_axis(rate * (0.5 * dt));
        let middle = self.state.attitude * half;
        let bias = Vector3::z() * self.accel_bias_down;
        let acceleration = middle * ((last.accel + sample.accel) * 0.5) - bias + gravity;
        let s = &mut self.state;
        s.position += s.velocity * dt + acceleration * (0.5 * dt * dt);
        s.velocity += acceleration * dt;
        s.attitude = middle * half;
        s.rate = sample.gyro - self.gyro_bias;
        s.t_s = sample.t_s;
        self.history.push_back(*s);
        while self.history.front().is_some_and(|old| old.t_s < sample.t_s - HISTORY_S) {
            self.history.pop_front();
        }
    }

    /// Stationary after the start: gyro bias and level from means.
    fn align(&mut self, sample: &ImuSample, started_s: f64, heading: impl FnOnce() -> f64) {
        let Some(([rate, force], count)) = &mut self.aligning else { return };
        *rate += sample.gyro;
        *force += sample.accel;
        *count += 1;
        if sample.t_s - started_s < ALIGN_S {
            return;
        }
        let n = f64::from(*count);
        self.gyro_bias = *rate / n;
        let f = *force / n;
        let roll = atan2(-f.y, -f.z);
        let pitch = atan2(f.x, hypot(f.y, f.z));
        self.state.attitude = UnitQuaternion::from_euler_angles(roll, pitch, heading());
        self.state.t_s = sample.t_s;
        self.aligning = None;
    }

    /// Takes a fix that arrives now.
    fn take_fix(&mut self, fix: &GnssFix, receiver: &Receiver, heading: f64) {
        if self.aligning.is_some() {
            return;
        }
        let Some((origin, _)) = self.origin else {
            self.origin = Some((fix.position, gravity_n(&fix.position)));
            return;
        };
        let Some(past) = self.past(fix.t_s - receiver.delay_s) else { return };
        let dt = self.last_fix_s.map_or(0.0, |t| fix.t_s - t);
        self.last_fix_s = Some(fix.t_s);
        let lever = past.attitude * receiver.lever_m;
        let swing = past.attitude * past.rate.cross(&receiver.lever_m);
        let position = local(&origin, &fix.position) - past.position - lever;
        let velocity = match fix.velocity {
            FixVelocity::Full(v) => Vector3::from(v) - past.velocity - swing,
            FixVelocity::Horizontal([n, e]) => {
                Vector3::new(n - past.velocity.x - swing.x, e - past.velocity.y - swing.y, 0.0)
            }
            FixVelocity::None => Vector3::zeros(),
        };
        // The compass is read now, the fix is older.
        let yaw = wrap_pi(heading - self.state.attitude.euler_angles().2);
        self.judge(&velocity, &position, yaw, dt);
        self.correct(&velocity, &position, yaw, dt);
    }

    /// The state at a past time, between two that are kept.
    fn past(&self, t_s: f64) -> Option<State> {
        let next = self.history.partition_point(|s| s.t_s < t_s);
        let (a, b) = (self.history.get(next.checked_sub(1)?)?, self.history.get(next)?);
        let share = (t_s - a.t_s) / (b.t_s - a.t_s);
        Some(State {
            t_s,
            position: a.position.lerp(&b.position, share),
            velocity: a.velocity.lerp(&b.velocity, share),
            attitude: a.attitude.nlerp(&b.attitude, share),
            rate: a.rate.lerp(&b.rate, share),
        })
    }

    fn correct(&mut self, velocity: &Vector3<f64>, position: &Vector3<f64>, yaw: f64, dt: f64) {
        let Some(last) = &self.last else { return };
        let force = self.state.attitude * last.accel;
        let tilt = force.cross(velocity) * (TILT_GAIN * dt / force.norm_squared().max(1.0));
        let turn = Vector3::new(tilt.x, tilt.y, tilt.z + HEADING_GAIN * dt * yaw);
        let turned = UnitQuaternion::from_scaled_axis(turn);
        let by = [
            position * (POSITION_GAIN * dt),
            velocity * (VELOCITY_GAIN * dt) + position * (POSITION_TO_VELOCITY * dt),
        ];
        self.gyro_bias -= self.state.attitude.inverse() * turn * GYRO_BIAS_GAIN;
        self.accel_bias_down -= velocity.z * (ACCEL_BIAS_GAIN * dt);
        // What is kept must not show the same error again.
        for state in self.history.iter_mut().chain(std::iter::once(&mut self.state)) {
            state.position += by[0];
            state.velocity += by[1];
            state.attitude = turned * state.attitude;
        }
    }

    fn judge(&mut self, velocity: &Vector3<f64>, position: &Vector3<f64>, yaw: f64, dt: f64) {
        let of = |v: f64, sigma: f64| (v / (GATE * sigma)).powi(2);
        let joint = |v: &[f64], sigmas: &[f64]| {
            let squares = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
            (squares(v) / (GATE * GATE * squares(sigmas))).sqrt()
        };
        if self.flavour == Flavour::ArduPilot {
            self.ratios = TestRatios {
                velocity: joint(velocity.as_slice(), &VELOCITY_SIGMA),
                position: joint(&position.as_slice()[..2], &POSITION_SIGMA[..2]),
                height: of(position.z, POSITION_SIGMA[2]).sqrt(),
                heading: of(yaw, HEADING_SIGMA).sqrt(),
            };
            return;
        }
        let sigmas = VELOCITY_SIGMA.iter().chain(&POSITION_SIGMA).chain(std::iter::once(&HEADING_SIGMA));
        let values = velocity.iter().chain(position.iter()).chain(std::iter::once(&yaw));
        let share = dt / (dt + RATIO_SMOOTHING_S);
        for ((smoothed, v), sigma) in self.smoothed.iter_mut().zip(values).zip(sigmas) {
            *smoothed += share * (of(*v, *sigma).copysign(*v) - *smoothed);
        }
        let largest = |part: &[f64]| part.iter().fold(0.0_f64, |most, v| most.max(v.abs())).sqrt();
        self.ratios = TestRatios {
            velocity: largest(&self.smoothed[..3]),
            position: largest(&self.smoothed[3..5]),
            height: largest(&self.smoothed[5..6]),
            heading: largest(&self.smoothed[6..]),
        };
    }
}

impl Autopilot {
    /// The parameters that hold at once.
    pub(super) fn use_parameters(&mut self) {
        let flavour = self.config.flavour;
        self.calibration = Calibration::new(flavour, &self.parameters);
        self.receiver = Receiver::new(flavour, &self.parameters).with_delay_of(self.receiver);
    }

    /// The filter after a start, which is when the delay is read.
    pub(super) fn start_navigation(&mut self) {
        let flavour = self.config.flavour;
        self.receiver = Receiver::new(flavour, &self.parameters);
        self.navigation = self.config.navigates.then(|| Navigation::new(flavour));
    }

    pub(super) fn navigate(&mut self, sample: &ImuSample, truth: &Truth) {
        if let Some(navigation) = &mut self.navigation {
            let sensors = &mut self.sensors;
            let started_s = self.booted_s;
            navigation.take_imu(sample, started_s, || sensors.attitude(truth).roll_pitch_yaw[2]);
        }
    }

    /// The fix that has just arrived.
    pub(super) fn navigate_by_fix(&mut self) {
        if self.navigation.is_none() {
            return;
        }
        let truth = self.truth();
        let heading = self.sensors.attitude(&truth).roll_pitch_yaw[2];
        if let (Some(navigation), Some(fix)) = (&mut self.navigation, &self.fix) {
            navigation.take_fix(fix, &self.receiver, heading);
        }
    }

    /// `ATTITUDE` by its own filter, where it has one.
    pub(super) fn own_attitude(&self, time_boot_ms: u32) -> Option<MavMessage> {
        let navigation = self.navigation.as_ref()?;
        let [roll, pitch, yaw] = navigation.state.attitude.euler_angles().into();
        let rate = navigation.state.rate;
        Some(MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms,
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed: rate.x as f32,
            pitchspeed: rate.y as f32,
            yawspeed: rate.z as f32,
        }))
    }

    /// `EKF_STATUS_REPORT` or `ESTIMATOR_STATUS`; nothing before the first fix.
    pub(super) fn filter_status(&self) -> Option<MavMessage> {
        let navigation = self.navigation.as_ref()?;
        navigation.last_fix_s?;
        let TestRatios { velocity, position, height, heading } = navigation.ratios;
        Some(match self.config.flavour {
            Flavour::ArduPilot => MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
                velocity_variance: velocity as f32,
                pos_horiz_variance: position as f32,
                pos_vert_variance: height as f32,
                compass_variance: heading as f32,
                ..Default::default()
            }),
            Flavour::Px4 => MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
                time_usec: (self.boot_s() * 1e6) as u64,
                vel_ratio: velocity as f32,
                pos_horiz_ratio: position as f32,
                pos_vert_ratio: height as f32,
                mag_ratio: heading as f32,
                ..Default::default()
            }),
        })
    }
}

/// North, east, down from the origin, m; over the few kilometres of a flight the Earth is flat enough for a filter of this accuracy.
fn local(origin: &Geodetic, place: &Geodetic) -> Vector3<f64> {
    let (r_n, r_e) = origin.radii();
    Vector3::new(
        (place.lat_rad - origin.lat_rad) * (r_n + origin.height_m),
        wrap_pi(place.lon_rad - origin.lon_rad) * (r_e + origin.height_m) * cos(origin.lat_rad),
        origin.height_m - place.height_m,
    )
}

#[cfg(test)]
mod tests;
