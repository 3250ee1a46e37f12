//! From the fields of a topic to measurements.

use super::{Basic, Subscription};
use crate::logs::VehicleClass;
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{FixVelocity, GnssFix};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// A fix, or nothing where the receiver has none.
pub(super) fn fix(fields: &Fields) -> Option<GnssFix> {
    let position = fields.position().filter(|_| fields.number("fix_type").is_some_and(|t| t >= 3.0))?;
    let given = |name| fields.number(name).filter(|v| *v > 0.0);
    let velocity = match ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s"].map(|n| fields.number(n)) {
        [Some(n), Some(e), Some(d)] => FixVelocity::Full([n, e, d]),
        _ => FixVelocity::None,
    };
    Some(GnssFix {
        t_s: 0.0,
        position,
        velocity,
        // In this format eph and epv are metres.
        position_sigma_m: given("eph").zip(given("epv")).map(|(h, v)| [h, h, v]),
        velocity_sigma_m_per_s: given("s_variance_m_s").map(|s| [s; 3]),
        yaw_rad: None,
    })
}

/// Roll, pitch, yaw, rad.
pub(super) fn attitude(fields: &Fields) -> Option<[f64; 3]> {
    rotation(fields, "q")
}

/// Roll, pitch, yaw of a quaternion, rad.
pub(super) fn rotation(fields: &Fields, name: &str) -> Option<[f64; 3]> {
    let [w, x, y, z] = [0, 1, 2, 3].map(|k| fields.element(name, k));
    let (roll, pitch, yaw) = UnitQuaternion::try_new(Quaternion::new(w?, x?, y?, z?), 0.5)?.euler_angles();
    Some([roll, pitch, yaw])
}

/// `vehicle_type` of `vehicle_status`: 1 rotary wing, 2 fixed wing; a VTOL has wings to fly turns with. Logs before 1.9 have
/// `is_rotary_wing`.
pub(super) fn vehicle_class(fields: &Fields) -> Option<VehicleClass> {
    if fields.number("is_vtol") == Some(1.0) {
        return Some(VehicleClass::Vtol);
    }
    match (fields.number("vehicle_type"), fields.number("is_rotary_wing")) {
        (Some(1.0), _) | (None, Some(1.0)) => Some(VehicleClass::Multirotor),
        (Some(2.0), _) | (None, Some(0.0)) => Some(VehicleClass::FixedWing),
        (Some(3.0), _) => Some(VehicleClass::Rover),
        _ => None,
    }
}

/// Fields of a message by name, whatever their type.
pub(super) struct Fields<'a> {
    pub(super) topic: &'a Subscription,
    pub(super) data: &'a [u8],
}

impl Fields<'_> {
    pub(super) fn stamp(&self) -> Option<u64> {
        self.stamp_of("timestamp")
    }

    /// The time at which it was measured, otherwise published, µs.
    pub(super) fn sampled(&self) -> Option<u64> {
        self.stamp_of("timestamp_sample").filter(|t| *t > 0).or_else(|| self.stamp())
    }

    fn stamp_of(&self, name: &str) -> Option<u64> {
        let (offset, _, _) = *self.topic.fields.get(name).filter(|f| f.1 == Basic::U64)?;
        Some(u64::from_le_bytes(*self.data.get(offset..)?.first_chunk()?))
    }

    /// Whether a flag is there and set.
    pub(super) fn flag(&self, name: &str) -> bool {
        self.number(name).is_some_and(|v| v != 0.0)
    }

    /// A finite number.
    pub(super) fn number(&self, name: &str) -> Option<f64> {
        self.element(name, 0)
    }

    pub(super) fn element(&self, name: &str, k: usize) -> Option<f64> {
        let (offset, basic, _) = *self.topic.fields.get(name).filter(|f| k < f.2)?;
        basic.read(self.data.get(offset + k * basic.size()..)?).filter(|v| v.is_finite())
    }

    pub(super) fn vector(&self, name: &str) -> Option<Vector3<f64>> {
        let [x, y, z] = [0, 1, 2].map(|k| self.element(name, k));
        Some(Vector3::new(x?, y?, z?))
    }

    /// Degrees and metres since 1.14, 1e-7 degrees and millimetres before.
    pub(super) fn position(&self) -> Option<Geodetic> {
        let fine = ["latitude_deg", "longitude_deg", "altitude_msl_m"].map(|n| self.number(n));
        let coarse = ["lat", "lon", "alt"].map(|n| self.number(n));
        match (fine, coarse) {
            ([Some(lat), Some(lon), Some(alt)], _) => Some((lat, lon, alt)),
            (_, [Some(lat), Some(lon), Some(alt)]) => Some((lat * 1e-7, lon * 1e-7, alt * 1e-3)),
            _ => None,
        }
        .filter(|(lat, lon, _)| lat.abs() <= 90.0 && lon.abs() <= 180.0 && (*lat, *lon) != (0.0, 0.0))
        .map(|(lat, lon, alt)| Geodetic::from_degrees(lat, lon, alt))
    }
}
