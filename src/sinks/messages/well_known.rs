//! Those of Foxglove's well-known schemas that make its map, 3-D and log panels work without set-up.
//!
//! The field names are theirs (<https://docs.foxglove.dev/docs/visualization/message-schemas/introduction>).

use crate::engine::snapshot::Snapshot;
use crate::sensors::Severity;
use schemars::JsonSchema;
use serde::Serialize;

/// The frame of the vehicle.
const VEHICLE: &str = "vehicle";

/// Time as Foxglove's JSON messages have it.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Time {
    /// Seconds.
    pub sec: u64,
    /// Nanoseconds.
    pub nsec: u32,
}

impl Time {
    fn from_us(t_us: u64) -> Self {
        Self { sec: t_us / 1_000_000, nsec: (t_us % 1_000_000) as u32 * 1000 }
    }
}

/// `foxglove.LocationFix`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct LocationFix {
    /// Time of reception.
    pub timestamp: Time,
    /// Frame of the antenna.
    pub frame_id: String,
    /// Latitude, deg.
    pub latitude: f64,
    /// Longitude, deg.
    pub longitude: f64,
    /// Height, m.
    pub altitude: f64,
    /// East, north, up, m².
    pub position_covariance: [f64; 9],
    /// 2: the diagonal is known.
    pub position_covariance_type: u8,
}

impl LocationFix {
    /// Where the vehicle is by this snapshot.
    pub fn new(t_us: u64, s: &Snapshot) -> Self {
        let [n, e, d] = s.motion.position_sigma_m.map(|v| v * v);
        Self {
            timestamp: Time::from_us(t_us),
            frame_id: VEHICLE.to_owned(),
            latitude: s.motion.lat_deg,
            longitude: s.motion.lon_deg,
            altitude: s.motion.height_m,
            position_covariance: [e, 0.0, 0.0, 0.0, n, 0.0, 0.0, 0.0, d],
            position_covariance_type: 2,
        }
    }
}

/// A vector.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Vector3 {
    /// x.
    pub x: f64,
    /// y.
    pub y: f64,
    /// z.
    pub z: f64,
}

/// A rotation.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Quaternion {
    /// x.
    pub x: f64,
    /// y.
    pub y: f64,
    /// z.
    pub z: f64,
    /// Real part.
    pub w: f64,
}

/// Position and orientation.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Pose {
    /// m.
    pub position: Vector3,
    /// Body into frame.
    pub orientation: Quaternion,
}

/// `foxglove.PoseInFrame`: attitude in a local frame with x east, y north, z up and the body's x forward, y left, z up,
/// as its 3-D panel draws.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PoseInFrame {
    /// Time of reception.
    pub timestamp: Time,
    /// Frame.
    pub frame_id: String,
    /// Pose.
    pub pose: Pose,
}

impl PoseInFrame {
    /// The attitude of this snapshot at the origin of the local frame.
    pub fn new(t_us: u64, s: &Snapshot) -> Self {
        let [roll, pitch, yaw] = s.estimate.attitude_deg.value.map(f64::to_radians);
        // From east-north-up the heading counts the other way round and from another axis, pitch changes its sign.
        let q = nalgebra::UnitQuaternion::from_euler_angles(roll, -pitch, std::f64::consts::FRAC_PI_2 - yaw);
        Self {
            timestamp: Time::from_us(t_us),
            frame_id: "local".to_owned(),
            pose: Pose {
                position: Vector3 { x: 0.0, y: 0.0, z: 0.0 },
                orientation: Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
            },
        }
    }
}

/// `foxglove.FrameTransform`: the vehicle in the local frame of [`PoseInFrame`], at its origin.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FrameTransform {
    /// Time of reception.
    pub timestamp: Time,
    /// The local frame.
    pub parent_frame_id: String,
    /// The vehicle.
    pub child_frame_id: String,
    /// m.
    pub translation: Vector3,
    /// Body into frame.
    pub rotation: Quaternion,
}

impl FrameTransform {
    /// The attitude of this snapshot.
    pub fn new(t_us: u64, s: &Snapshot) -> Self {
        let PoseInFrame { timestamp, frame_id, pose } = PoseInFrame::new(t_us, s);
        Self {
            timestamp,
            parent_frame_id: frame_id,
            child_frame_id: VEHICLE.to_owned(),
            translation: pose.position,
            rotation: pose.orientation,
        }
    }
}

/// `foxglove.Log`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Log {
    /// Time of reception.
    pub timestamp: Time,
    /// 2 = information, 3 = warning.
    pub level: u8,
    /// Text.
    pub message: String,
    /// Who says it.
    pub name: String,
    /// Not used.
    pub file: String,
    /// Not used.
    pub line: u32,
}

impl Log {
    /// A line of the log.
    pub fn new(t_us: u64, severity: Severity, text: &str) -> Self {
        Self {
            timestamp: Time::from_us(t_us),
            level: match severity {
                Severity::Info => 2,
                Severity::Warning => 3,
            },
            message: text.to_owned(),
            name: "gaware".to_owned(),
            file: String::new(),
            line: 0,
        }
    }
}
