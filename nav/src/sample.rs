//! What the filter eats: inertial samples, GNSS fixes, attitude hints, in SI units and one time base.
//!
//! The time base is the autopilot's boot time in seconds. Whoever makes these (live link, log reader, simulator) has
//! already dropped duplicates and foreign components; nothing here knows where a sample came from.

use crate::earth::{Geodetic, STANDARD_GRAVITY};
use crate::operating::OperatingSample;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// One inertial sample in body axes (forward, right, down).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImuSample {
    /// Time of validity, s: of the instant ([`SampleKind::Point`]) or of the end of the interval.
    pub t_s: f64,
    /// Angular rate ω_ib^b as measured, rad/s.
    pub gyro: Vector3<f64>,
    /// Specific force f^b as measured, m/s².
    pub accel: Vector3<f64>,
    /// Temperature of the inertial unit, °C, where the message carries it.
    pub temperature_degc: Option<f64>,
}

/// Beyond these no sensor on a vehicle reads: rate, rad/s, and specific force, m/s² (the paper flies 80 g).
const PLAUSIBLE_MOTION: (f64, f64) = (100.0, 2000.0);
/// Beyond these no fix is: height, m, and speed, m/s.
const PLAUSIBLE_FIX: (f64, f64) = (1e5, 1e4);

impl ImuSample {
    /// Whether rate and specific force are numbers.
    pub fn is_finite(&self) -> bool {
        self.gyro.iter().chain(self.accel.iter()).all(|v| v.is_finite())
    }

    /// Whether a sensor on a vehicle can have given these values at a time.
    pub fn is_plausible(&self) -> bool {
        let (rate, force) = PLAUSIBLE_MOTION;
        self.t_s.is_finite() && self.gyro.norm() < rate && self.accel.norm() < force
    }

    /// Whether it can be navigated with: plausible, and its temperature, where it has one, is a number.
    pub fn is_usable(&self) -> bool {
        self.is_plausible() && self.temperature_degc.is_none_or(f64::is_finite)
    }

    /// The sample of a source of this kind at a time between this one and the next.
    pub(crate) fn between(&self, next: &Self, kind: SampleKind, t_s: f64) -> Self {
        let (gyro, accel) = if kind == SampleKind::Point && next.t_s > self.t_s {
            let share = (t_s - self.t_s) / (next.t_s - self.t_s);
            (self.gyro.lerp(&next.gyro, share), self.accel.lerp(&next.accel, share))
        } else {
            (next.gyro, next.accel)
        };
        Self { t_s, gyro, accel, ..*next }
    }
}

/// How the values of a sample came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SampleKind {
    /// The value at one instant (all MAVLink sources).
    #[default]
    Point,
    /// The mean over the interval that ends at the time stamp (increments divided by their interval).
    IntervalMean,
}

/// How a source turns real values into integers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantisation {
    /// Floating-point values.
    #[default]
    None,
    /// To the nearest multiple of the step.
    Round(Steps),
    /// Toward zero, as a C cast does (`RAW_IMU`, `SCALED_IMU*` of ArduPilot and PX4).
    Truncate(Steps),
}

/// Steps of an integer source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Steps {
    /// rad/s per count.
    pub gyro: f64,
    /// m/s² per count.
    pub accel: f64,
}

impl Steps {
    /// `RAW_IMU` and `SCALED_IMU*`: 1 mrad/s and 1 mg.
    pub const RAW_IMU: Self = Self { gyro: 1e-3, accel: 1e-3 * STANDARD_GRAVITY };
}

/// What a stream of inertial samples is, reported once at its start and again when the source changes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ImuStream {
    /// Name of the source message, for example `RAW_IMU`; empty where there is none.
    pub message: String,
    /// Point samples or interval means.
    pub kind: SampleKind,
    /// Rounding of the source.
    pub quantisation: Quantisation,
}

/// What a fix says about velocity, in north-east-down axes, m/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FixVelocity {
    /// Nothing.
    None,
    /// North and east (`GPS_RAW_INT`: ground speed and course).
    Horizontal([f64; 2]),
    /// North, east and down.
    Full([f64; 3]),
}

impl FixVelocity {
    /// North, east and down, m/s; 0 where it says nothing.
    pub fn components(self) -> [f64; 3] {
        match self {
            Self::None => [0.0; 3],
            Self::Horizontal([n, e]) => [n, e, 0.0],
            Self::Full(v) => v,
        }
    }

    /// How many of these it says anything of.
    pub fn rows(self) -> usize {
        match self {
            Self::None => 0,
            Self::Horizontal(_) => 2,
            Self::Full(_) => 3,
        }
    }

    /// North and east, m/s, where it says anything.
    pub fn horizontal(self) -> Option<[f64; 2]> {
        let [n, e, _] = self.components();
        (self != Self::None).then_some([n, e])
    }
}

/// One GNSS solution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GnssFix {
    /// Time stamp, s, on the time base of the inertial samples, before any latency is taken off.
    pub t_s: f64,
    /// Position of the antenna, height above the ellipsoid (or above sea level where nothing else is known:
    /// a constant offset does not matter to the filter).
    pub position: Geodetic,
    /// Velocity of the antenna.
    pub velocity: FixVelocity,
    /// The fix's own 1-sigma figures for north, east, down, m.
    pub position_sigma_m: Option<[f64; 3]>,
    /// The fix's own 1-sigma figures for velocity north, east, down, m/s.
    pub velocity_sigma_m_per_s: Option<[f64; 3]>,
    /// Dual-antenna heading of the vehicle and its sigma, rad.
    pub yaw_rad: Option<(f64, f64)>,
}

impl GnssFix {
    /// Whether a receiver on a vehicle can have given these values at a time.
    pub fn is_plausible(&self) -> bool {
        let (height, speed) = PLAUSIBLE_FIX;
        let velocity = self.velocity.components();
        let sigmas = self.position_sigma_m.iter().chain(&self.velocity_sigma_m_per_s).flatten();
        self.t_s.is_finite()
            && self.position.lat_rad.abs() <= std::f64::consts::FRAC_PI_2
            && self.position.lon_rad.abs() <= 2.0 * std::f64::consts::PI
            && self.position.height_m.abs() < height
            && velocity.iter().all(|v| v.abs() < speed)
            && sigmas.copied().all(|s| s.is_finite() && s >= 0.0)
            && self.yaw_rad.is_none_or(|(yaw, sigma)| yaw.is_finite() && sigma.is_finite())
    }
}

impl AttitudeHint {
    /// Whether all of it is finite.
    pub fn is_finite(&self) -> bool {
        self.t_s.is_finite() && self.roll_pitch_yaw.iter().all(|a| a.is_finite())
    }
}

/// Another filter's attitude: good for an initial value with an honest sigma and for comparison, never a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AttitudeHint {
    /// Time stamp, s.
    pub t_s: f64,
    /// Roll, pitch, yaw, rad.
    pub roll_pitch_yaw: [f64; 3],
}

/// One sample of a compass: the magnetic field in body axes, as the autopilot reports it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FieldSample {
    /// Time stamp, s.
    pub t_s: f64,
    /// Which compass of the vehicle, from 0.
    pub compass: u8,
    /// Field, T.
    pub field: Vector3<f64>,
}

/// The Earth's field is 22 to 67 µT; beyond ten times that nothing measures it any more, T. No field at all is a compass that is not there.
const PLAUSIBLE_FIELD_T: f64 = 7e-4;

impl FieldSample {
    /// Whether a compass on a vehicle can have given these values at a time.
    pub fn is_plausible(&self) -> bool {
        let size = self.field.norm();
        self.t_s.is_finite() && size > 0.0 && size < PLAUSIBLE_FIELD_T
    }
}

/// What a sample of the air is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AirKind {
    /// Static pressure, Pa, before any correction for the flow.
    Barometer,
    /// Equivalent airspeed (what a pitot tube shows), m/s.
    Airspeed,
}

/// One sample of a barometer or an airspeed sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AirSample {
    /// Time stamp, s.
    pub t_s: f64,
    /// Of what.
    pub kind: AirKind,
    /// Which of them, from 0.
    pub sensor: u8,
    /// Value in the unit of its kind.
    pub value: f64,
    /// Temperature of the sensor, °C, where it is known.
    pub temperature_degc: Option<f64>,
}

/// Pressure between 16 km and a mine, Pa, and airspeed, m/s.
const PLAUSIBLE_AIR: [(f64, f64); 2] = [(1e4, 1.2e5), (0.0, 400.0)];

impl AirSample {
    /// Whether a sensor on a vehicle can have given this value at a time.
    pub fn is_plausible(&self) -> bool {
        let (least, most) = PLAUSIBLE_AIR[self.kind as usize];
        self.t_s.is_finite() && (least..most).contains(&self.value)
    }
}

/// Why the time base or the vehicle started anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestartReason {
    /// The autopilot started anew: its boot time went back to the first minute.
    Reboot,
    /// The time base jumped forward beyond any plausible gap.
    ClockJump,
    /// The time base went back by seconds, and the autopilot did not start anew.
    ClockSetBack,
    /// Another source message took over.
    SourceChange,
    /// The sensor no longer measured.
    SensorFault,
}

/// One item on the straight line from a source to the engine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sample {
    /// What the following inertial samples are.
    Stream(ImuStream),
    /// An inertial sample.
    Imu(ImuSample),
    /// A GNSS fix.
    Fix(GnssFix),
    /// The autopilot's own attitude.
    Attitude(AttitudeHint),
    /// The magnetic field.
    Field(FieldSample),
    /// Pressure or speed of the air.
    Air(AirSample),
    /// A fresh start: state is kept for the constants of the vehicle, dropped for motion.
    Restart(RestartReason),
    /// The autopilot may have changed the calibration that its samples carry: their biases before and after are not the same.
    Recalibrated,
    /// Where the vehicle is as long as no fix says so: its home position, or what people say.
    Place(Geodetic),
    /// What the vehicle does beside moving.
    Operating(OperatingSample),
}
