//! `GPS_RAW_INT` into a fix.
//!
//! The message has no vertical velocity, its `eph` and `epv` are dilutions and not metres, and zero means "unknown" in
//! every extension field.

use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{FixVelocity, GnssFix};
use mavlink::dialects::ardupilotmega::GPS_RAW_INT_DATA;

/// Below this speed the course is noise, m/s.
const COURSE_FROM_M_PER_S: f64 = 1.0;
/// Speed accuracy of a receiver that does not report it, for the slow case only, m/s.
const UNTOLD_SPEED_SIGMA: f64 = 0.1;
/// Sigma of a dual-antenna heading whose message does not report it, rad.
const UNTOLD_YAW_SIGMA: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// Heights of one flight must share a reference: what the first fix had decides.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum HeightReference {
    /// No fix yet.
    #[default]
    Undecided,
    /// `alt` (sea level), because the first fix had no ellipsoidal height.
    SeaLevel,
    /// Ellipsoid; the last separation of the two, m, bridges messages without it.
    Ellipsoid {
        /// Ellipsoidal height minus height above sea level.
        separation_m: f64,
    },
}

impl HeightReference {
    fn height_m(&mut self, m: &GPS_RAW_INT_DATA) -> f64 {
        let sea_level = f64::from(m.alt) * 1e-3;
        let ellipsoid = (m.alt_ellipsoid != 0).then(|| f64::from(m.alt_ellipsoid) * 1e-3);
        *self = match (*self, ellipsoid) {
            (Self::Undecided, None) => Self::SeaLevel,
            (Self::Undecided | Self::Ellipsoid { .. }, Some(h)) => {
                Self::Ellipsoid { separation_m: h - sea_level }
            }
            (kept, _) => kept,
        };
        match *self {
            Self::Ellipsoid { separation_m } => sea_level + separation_m,
            Self::SeaLevel | Self::Undecided => sea_level,
        }
    }
}

/// Whether the message claims a three-dimensional solution at a place that exists.
pub fn has_fix(m: &GPS_RAW_INT_DATA) -> bool {
    m.fix_type as u8 >= 3
        && (m.lat, m.lon) != (0, 0)
        && m.lat.unsigned_abs() <= 900_000_000
        && m.lon.unsigned_abs() <= 1_800_000_000
}

/// The fix of a message for which [`has_fix`] holds, stamped with a time on the base of the inertial samples.
pub fn fix(m: &GPS_RAW_INT_DATA, t_s: f64, reference: &mut HeightReference) -> GnssFix {
    let told = |v: u32| (v != 0).then(|| f64::from(v) * 1e-3);
    let position =
        Geodetic::from_degrees(f64::from(m.lat) * 1e-7, f64::from(m.lon) * 1e-7, reference.height_m(m));
    let position_sigma_m = match (told(m.h_acc), told(m.v_acc)) {
        (Some(h), Some(v)) => Some([h, h, v]),
        // Vertical errors of receivers are about 1.5 times the horizontal ones.
        (Some(h), None) => Some([h, h, 1.5 * h]),
        _ => None,
    };
    let (velocity, velocity_sigma_m_per_s) = velocity(m, told(m.vel_acc));
    GnssFix { t_s, position, velocity, position_sigma_m, velocity_sigma_m_per_s, yaw_rad: yaw(m) }
}

fn velocity(m: &GPS_RAW_INT_DATA, sigma: Option<f64>) -> (FixVelocity, Option<[f64; 3]>) {
    let all = |s: f64| [s; 3];
    if m.vel == u16::MAX {
        return (FixVelocity::None, None);
    }
    let speed = f64::from(m.vel) * 1e-2;
    if speed < COURSE_FROM_M_PER_S {
        // Nothing but "slow" is known, in any direction.
        let sigma = sigma.unwrap_or(UNTOLD_SPEED_SIGMA).max(speed);
        return (FixVelocity::Horizontal([0.0, 0.0]), Some(all(sigma)));
    }
    if m.cog == u16::MAX {
        return (FixVelocity::None, None);
    }
    let (sin, cos) = (f64::from(m.cog) * 1e-2).to_radians().sin_cos();
    (FixVelocity::Horizontal([speed * cos, speed * sin]), sigma.map(all))
}

/// 0: none, 65535: the receiver cannot, 36000: north.
fn yaw(m: &GPS_RAW_INT_DATA) -> Option<(f64, f64)> {
    if !(1..=36_000).contains(&m.yaw) {
        return None;
    }
    let sigma = if m.hdg_acc == 0 { UNTOLD_YAW_SIGMA } else { (f64::from(m.hdg_acc) * 1e-5).to_radians() };
    Some(((f64::from(m.yaw % 36_000) * 1e-2).to_radians(), sigma))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::GpsFixType;

    fn message() -> GPS_RAW_INT_DATA {
        GPS_RAW_INT_DATA {
            lat: 473_977_420,
            lon: 85_455_940,
            alt: 488_000,
            vel: 2000,
            cog: 9000,
            fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            ..Default::default()
        }
    }

    fn one(m: &GPS_RAW_INT_DATA) -> GnssFix {
        fix(m, 1.0, &mut HeightReference::default())
    }

    #[test]
    fn dilution_is_never_taken_for_metres() {
        let m = GPS_RAW_INT_DATA { eph: 121, epv: 200, ..message() };
        assert_eq!(one(&m).position_sigma_m, None);
        let m = GPS_RAW_INT_DATA { h_acc: 800, v_acc: 1200, vel_acc: 150, ..message() };
        assert_eq!(one(&m).position_sigma_m, Some([0.8, 0.8, 1.2]));
        assert_eq!(one(&m).velocity_sigma_m_per_s, Some([0.15; 3]));
    }

    #[test]
    fn course_east_is_velocity_east() {
        let FixVelocity::Horizontal([n, e]) = one(&message()).velocity else { panic!("no velocity") };
        assert!(n.abs() < 1e-9 && (e - 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_slow_course_is_not_believed() {
        let m = GPS_RAW_INT_DATA { vel: 60, cog: 12_345, vel_acc: 200, ..message() };
        let fix = one(&m);
        assert_eq!(fix.velocity, FixVelocity::Horizontal([0.0, 0.0]));
        assert_eq!(fix.velocity_sigma_m_per_s, Some([0.6; 3]));
    }

    #[test]
    fn unknown_velocity_is_none() {
        assert_eq!(one(&GPS_RAW_INT_DATA { vel: u16::MAX, ..message() }).velocity, FixVelocity::None);
        assert_eq!(one(&GPS_RAW_INT_DATA { cog: u16::MAX, ..message() }).velocity, FixVelocity::None);
    }

    #[test]
    fn yaw_has_three_special_values() {
        for (raw, wanted) in [(0, None), (65_535, None), (36_000, Some(0.0)), (9000, Some(90.0_f64))] {
            let yaw = one(&GPS_RAW_INT_DATA { yaw: raw, ..message() }).yaw_rad.map(|(y, _)| y.to_degrees());
            assert_eq!(yaw.map(f64::round), wanted);
        }
    }

    #[test]
    fn height_keeps_its_reference_when_the_ellipsoid_goes_missing() {
        let mut reference = HeightReference::default();
        let with = GPS_RAW_INT_DATA { alt_ellipsoid: 535_000, ..message() };
        assert_eq!(fix(&with, 0.0, &mut reference).position.height_m, 535.0);
        assert_eq!(fix(&message(), 0.2, &mut reference).position.height_m, 535.0);
        let mut other = HeightReference::default();
        assert_eq!(fix(&message(), 0.0, &mut other).position.height_m, 488.0);
        assert_eq!(fix(&with, 0.2, &mut other).position.height_m, 488.0);
    }

    #[test]
    fn two_dimensional_and_null_island_are_no_fix() {
        assert!(has_fix(&message()));
        assert!(!has_fix(&GPS_RAW_INT_DATA { fix_type: GpsFixType::GPS_FIX_TYPE_2D_FIX, ..message() }));
        assert!(!has_fix(&GPS_RAW_INT_DATA { lat: 0, lon: 0, ..message() }));
    }
}
