//! Samples as flat records with units in the names, for people who open a recording in another program.

use gaware_nav::sample::{AttitudeHint, GnssFix, ImuSample};
use schemars::JsonSchema;
use serde::Serialize;

/// An inertial sample.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ImuRecord {
    /// Boot time, s.
    pub t_s: f64,
    /// Forward, right, down.
    pub gyro_rad_per_s: [f64; 3],
    /// Forward, right, down.
    pub accel_m_per_s2: [f64; 3],
    /// Temperature of the unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_degc: Option<f64>,
}

impl From<&ImuSample> for ImuRecord {
    fn from(s: &ImuSample) -> Self {
        Self {
            t_s: s.t_s,
            gyro_rad_per_s: s.gyro.into(),
            accel_m_per_s2: s.accel.into(),
            temperature_degc: s.temperature_degc,
        }
    }
}

/// A fix.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FixRecord {
    /// Boot time, s, before latency.
    pub t_s: f64,
    /// Latitude.
    pub lat_deg: f64,
    /// Longitude.
    pub lon_deg: f64,
    /// Height as the receiver counts it.
    pub height_m: f64,
    /// North, east, and down where the message has it.
    pub velocity_m_per_s: Vec<f64>,
    /// North, east, down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_sigma_m: Option<[f64; 3]>,
    /// North, east, down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_sigma_m_per_s: Option<[f64; 3]>,
}

impl From<&GnssFix> for FixRecord {
    fn from(s: &GnssFix) -> Self {
        Self {
            t_s: s.t_s,
            lat_deg: s.position.lat_rad.to_degrees(),
            lon_deg: s.position.lon_rad.to_degrees(),
            height_m: s.position.height_m,
            velocity_m_per_s: s.velocity.components()[..s.velocity.rows()].to_vec(),
            position_sigma_m: s.position_sigma_m,
            velocity_sigma_m_per_s: s.velocity_sigma_m_per_s,
        }
    }
}

/// The autopilot's own attitude.
#[derive(Debug, Serialize, JsonSchema)]
pub struct AttitudeRecord {
    /// Boot time, s.
    pub t_s: f64,
    /// Roll, pitch, yaw.
    pub attitude_deg: [f64; 3],
}

impl From<&AttitudeHint> for AttitudeRecord {
    fn from(s: &AttitudeHint) -> Self {
        Self { t_s: s.t_s, attitude_deg: s.roll_pitch_yaw.map(f64::to_degrees) }
    }
}
