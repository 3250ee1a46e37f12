//! The truth that a simulated autopilot sends along (ArduPilot's `SIM_STATE`, PX4's `HIL_STATE_QUATERNION`), for comparison
//! only: it never becomes a sample.

use super::Converter;
use crate::link::frame::Frame;
use crate::timeline::Stamp;
use mavlink::dialects::ardupilotmega::{HIL_STATE_QUATERNION_DATA, MavMessage, SIM_STATE_DATA};
use nalgebra::{Quaternion, UnitQuaternion};

/// A truth further away from the samples than this has a stamp out of place, s.
const NEAR_S: f64 = 10.0;
/// Ids of `SIM_STATE` and `HIL_STATE_QUATERNION`.
const TRUTH: [u32; 2] = [108, 115];

/// True motion at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimTruth {
    /// Time on the base of the samples, s; `SIM_STATE` has none and takes that of the inertial sample just before.
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
        if !TRUTH.contains(&frame.message_id) || converter.vehicle() != Some(frame.system_id) {
            return None;
        }
        let now_s = converter.time().now_s()?;
        match frame.decode().ok()? {
            MavMessage::SIM_STATE(m) => Some(Self::of_ardupilot(now_s, &m)),
            MavMessage::HIL_STATE_QUATERNION(m) => {
                let t_s = converter.time().place_s(Stamp::Usec(m.time_usec))?;
                Self::of_px4(t_s, &m).filter(|_| (t_s - now_s).abs() <= NEAR_S)
            }
            _ => None,
        }
    }

    fn of_ardupilot(t_s: f64, m: &SIM_STATE_DATA) -> Self {
        // The integer fields are an extension of 2021; the f32 degrees before them resolve 1 m.
        let fine = (m.lat_int, m.lon_int) != (0, 0);
        let lat_lon_deg = if fine {
            [f64::from(m.lat_int) * 1e-7, f64::from(m.lon_int) * 1e-7]
        } else {
            [f64::from(m.lat), f64::from(m.lon)]
        };
        Self {
            t_s,
            roll_pitch_yaw: [m.roll, m.pitch, m.yaw].map(f64::from),
            velocity_ned: [m.vn, m.ve, m.vd].map(f64::from),
            lat_lon_deg,
            alt_m: f64::from(m.alt),
        }
    }

    /// The quaternion turns body into north-east-down axes, scalar first (MAVLink `common.xml`).
    fn of_px4(t_s: f64, m: &HIL_STATE_QUATERNION_DATA) -> Option<Self> {
        let [w, x, y, z] = m.attitude_quaternion.map(f64::from);
        let (roll, pitch, yaw) = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)?.euler_angles();
        Some(Self {
            t_s,
            roll_pitch_yaw: [roll, pitch, yaw],
            velocity_ned: [m.vx, m.vy, m.vz].map(|v| f64::from(v) * 1e-2),
            lat_lon_deg: [f64::from(m.lat) * 1e-7, f64::from(m.lon) * 1e-7],
            alt_m: f64::from(m.alt) * 1e-3,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quaternion_of_px4_becomes_roll_pitch_yaw() {
        let (roll, pitch, yaw) = (0.3, -0.2, 2.5);
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let attitude_quaternion = [q.w, q.i, q.j, q.k].map(|v| v as f32);
        let m =
            HIL_STATE_QUATERNION_DATA { attitude_quaternion, vx: 1250, alt: 488_000, ..Default::default() };
        let truth = SimTruth::of_px4(3.0, &m).unwrap();
        for (got, wanted) in truth.roll_pitch_yaw.iter().zip([roll, pitch, yaw]) {
            assert!((got - wanted).abs() < 1e-6, "{truth:?}");
        }
        assert_eq!((truth.velocity_ned[0], truth.alt_m), (12.5, 488.0));
        let none = HIL_STATE_QUATERNION_DATA::default();
        assert_eq!(
            SimTruth::of_px4(3.0, &HIL_STATE_QUATERNION_DATA { attitude_quaternion: [0.0; 4], ..none }),
            None
        );
    }
}
