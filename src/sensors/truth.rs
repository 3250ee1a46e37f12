//! The truth that a simulated ArduPilot sends along (`SIM_STATE`), for comparison only: it never becomes a sample.

use super::Converter;
use crate::link::frame::Frame;
use mavlink::dialects::ardupilotmega::MavMessage;

/// Id of `SIM_STATE`.
const SIM_STATE: u32 = 108;

/// True motion at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimTruth {
    /// Time on the base of the samples, s: that of the inertial sample just before, as the message has none.
    pub t_s: f64,
    /// Roll, pitch, yaw, rad.
    pub roll_pitch_yaw: [f64; 3],
    /// Velocity north, east, down, m/s.
    pub velocity_ned: [f64; 3],
    /// Latitude, longitude, deg.
    pub lat_lon_deg: [f64; 2],
    /// Height above sea level, m.
    pub alt_m: f64,
}

impl SimTruth {
    /// Truth out of a frame of the converter's vehicle that `converter` has just been fed; nothing for any other
    /// message, and while no inertial sample has set the time.
    pub fn from_frame(frame: &Frame, converter: &Converter) -> Option<Self> {
        if frame.message_id != SIM_STATE || converter.vehicle() != Some(frame.system_id) {
            return None;
        }
        let t_s = converter.now_s()?;
        let MavMessage::SIM_STATE(m) = frame.decode().ok()? else { return None };
        // The integer fields are an extension of 2021; the f32 degrees before them resolve 1 m.
        let fine = (m.lat_int, m.lon_int) != (0, 0);
        let lat_lon_deg = if fine {
            [f64::from(m.lat_int) * 1e-7, f64::from(m.lon_int) * 1e-7]
        } else {
            [f64::from(m.lat), f64::from(m.lon)]
        };
        Some(Self {
            t_s,
            roll_pitch_yaw: [m.roll, m.pitch, m.yaw].map(f64::from),
            velocity_ned: [m.vn, m.ve, m.vd].map(f64::from),
            lat_lon_deg,
            alt_m: f64::from(m.alt),
        })
    }
}
