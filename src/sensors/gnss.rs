//! `GPS_RAW_INT` into a fix.
//!
//! The message has no vertical velocity, its `eph` and `epv` are dilutions and not metres, and zero means "unknown" in
//! every extension field. Its course is the direction of the velocity at any speed, until the receiver freezes it.

use gaware_nav::earth::Geodetic;
use gaware_nav::math::sin_cos;
use gaware_nav::sample::{FixVelocity, GnssFix};
use mavlink::dialects::ardupilotmega::GPS_RAW_INT_DATA;

/// From this speed on a course that is the same as before is that of a vehicle that goes straight, m/s.
const STRAIGHT_FROM_M_PER_S: f64 = 1.0;
/// Speed accuracy of a receiver that reports none, where its course is frozen, m/s.
const UNREPORTED_SPEED_SIGMA: f64 = 0.1;
/// Sigma of a dual-antenna heading whose message does not report it, rad.
const UNTOLD_YAW_SIGMA: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// A speed or course that was sent, in counts: both firmwares truncate it to whole cm/s and hundredths of a degree (AP_GPS.cpp, `send_mavlink_gps_raw`;
/// PX4's streams/GPS_RAW_INT.hpp), so that it was half a count more on average. Left out, 5 mm/s of 25 m/s make accelerometers that are right 300 ppm too
/// sensitive downward, and what a simulator's sphere is taken to stretch by 200 ppm wrong: five flights of ArduPilot's simulator had that scale factor
/// 400 to 630 ppm off, up to 4.1 sigma (2026-11-28).
fn untruncated(counts: u16) -> f64 {
    if counts == 0 { 0.0 } else { f64::from(counts) + 0.5 }
}

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

/// The course of a receiver, and whether it is frozen.
///
/// Speed and course are the velocity in other coordinates, with the same error in every direction at any speed. Only where the velocity
/// is too slow or too uncertain to have a direction, receivers keep the course of before (u-blox, MAX-M10S integration manual, "Freezing the
/// course over ground"; on a real flight of 2013 in 92 % of the fixes below 1 m/s). A course that is repeated to the hundredth of a degree
/// is no measurement.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Course {
    newest: Option<((u64, i32, i32), f64)>,
    frozen: bool,
}

impl Course {
    /// Velocity north and east by a speed, m/s, and a course, degrees. Where that has no known direction the velocity is zero with at
    /// least the sigma that comes with it. A fix that is sent again, with the same stamp and place, gives the same once more.
    pub fn velocity(&mut self, fix: (u64, i32, i32), speed: f64, course_deg: f64) -> ([f64; 2], Option<f64>) {
        if let Some((_, before)) = self.newest.filter(|(newest, _)| *newest != fix) {
            self.frozen = before == course_deg;
        }
        self.newest = Some((fix, course_deg));
        if self.frozen && speed < STRAIGHT_FROM_M_PER_S {
            return ([0.0; 2], Some(speed.max(UNREPORTED_SPEED_SIGMA)));
        }
        let (sin, cos) = sin_cos(course_deg.to_radians());
        ([speed * cos, speed * sin], None)
    }
}

/// What the fixes of one receiver have in common.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Receiver {
    height: HeightReference,
    course: Course,
}

/// Whether the message claims a three-dimensional solution at a place that exists.
pub fn has_fix(m: &GPS_RAW_INT_DATA) -> bool {
    m.fix_type as u8 >= 3
        && (m.lat, m.lon) != (0, 0)
        && m.lat.unsigned_abs() <= 900_000_000
        && m.lon.unsigned_abs() <= 1_800_000_000
}

impl Receiver {
    /// The fix of a message for which [`has_fix`] holds, stamped with a time on the base of the inertial samples.
    pub fn fix(&mut self, m: &GPS_RAW_INT_DATA, t_s: f64) -> GnssFix {
        let reported = |v: u32| (v != 0).then(|| f64::from(v) * 1e-3);
        let height_m = self.height.height_m(m);
        let position = Geodetic::from_degrees(f64::from(m.lat) * 1e-7, f64::from(m.lon) * 1e-7, height_m);
        let position_sigma_m = match (reported(m.h_acc), reported(m.v_acc)) {
            (Some(h), Some(v)) => Some([h, h, v]),
            // Vertical errors of receivers are about 1.5 times the horizontal ones.
            (Some(h), None) => Some([h, h, 1.5 * h]),
            _ => None,
        };
        let (velocity, velocity_sigma_m_per_s) = self.velocity(m, reported(m.vel_acc));
        GnssFix { t_s, position, velocity, position_sigma_m, velocity_sigma_m_per_s, yaw_rad: yaw(m) }
    }

    fn velocity(&mut self, m: &GPS_RAW_INT_DATA, reported: Option<f64>) -> (FixVelocity, Option<[f64; 3]>) {
        if m.vel == u16::MAX || m.cog == u16::MAX {
            return (FixVelocity::None, None);
        }
        let (speed, course_deg) = (untruncated(m.vel) * 1e-2, untruncated(m.cog) * 1e-2);
        let (velocity, at_least) = self.course.velocity((m.time_usec, m.lat, m.lon), speed, course_deg);
        let sigma = match (reported, at_least) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
        (FixVelocity::Horizontal(velocity), sigma.map(|s| [s; 3]))
    }
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
        Receiver::default().fix(m, 1.0)
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
        // Half a count more than was sent, of a cm/s and of a hundredth of a degree.
        assert!((e - 20.005).abs() < 1e-6 && (n + 20.005 * 0.005f64.to_radians()).abs() < 1e-6, "{n} {e}");
    }

    #[test]
    fn a_vehicle_at_rest_has_no_velocity() {
        let still = GPS_RAW_INT_DATA { vel: 0, cog: 0, ..message() };
        assert_eq!(one(&still).velocity, FixVelocity::Horizontal([0.0; 2]));
    }

    /// One fix of several, 140 ms after the one before.
    fn next(receiver: &mut Receiver, k: u64, vel: u16, cog: u16) -> GnssFix {
        let m = GPS_RAW_INT_DATA { time_usec: 140_000 * k, vel, cog, vel_acc: 400, ..message() };
        receiver.fix(&m, 0.14 * k as f64)
    }

    /// A rollout: the vehicle slows down along one line, and the receiver's noise is a tenth of what it reports.
    #[test]
    fn a_slow_vehicle_keeps_its_velocity() {
        let mut receiver = Receiver::default();
        for (k, (vel, cog)) in
            [(101, 35_952), (91, 158), (64, 35_200), (39, 1652), (8, 24_880)].into_iter().enumerate()
        {
            let fix = next(&mut receiver, k as u64, vel, cog);
            let FixVelocity::Horizontal([n, e]) = fix.velocity else { panic!("no velocity") };
            let (sin, cos) = sin_cos(((f64::from(cog) + 0.5) * 1e-2).to_radians());
            assert!((n - 0.01 * (f64::from(vel) + 0.5) * cos).abs() < 1e-9, "{k}: {n}");
            assert!((e - 0.01 * (f64::from(vel) + 0.5) * sin).abs() < 1e-9, "{k}: {e}");
            assert_eq!(fix.velocity_sigma_m_per_s, Some([0.4; 3]));
        }
    }

    #[test]
    fn a_frozen_course_is_no_direction() {
        let mut receiver = Receiver::default();
        let mut velocity = |k, vel, cog| {
            let fix = next(&mut receiver, k, vel, cog);
            (fix.velocity, fix.velocity_sigma_m_per_s.unwrap()[0])
        };
        let east = |v: FixVelocity| if let FixVelocity::Horizontal([_, e]) = v { e } else { f64::NAN };
        assert!((east(velocity(0, 120, 9000).0) - 1.205).abs() < 1e-6);
        assert!((east(velocity(1, 110, 9000).0) - 1.105).abs() < 1e-6, "a vehicle may go straight");
        let zero = FixVelocity::Horizontal([0.0; 2]);
        assert_eq!(velocity(2, 60, 9000), (zero, 0.605));
        assert_eq!(velocity(2, 60, 9000), (zero, 0.605), "the same message once more is the same fix");
        assert_eq!(velocity(3, 6, 9000), (zero, 0.4), "the sigma that is reported is the larger one");
        assert!((east(velocity(4, 60, 9000 + 117).0) - 0.605).abs() < 1e-3);
    }

    #[test]
    fn a_fix_that_is_sent_twice_is_no_frozen_course() {
        let mut receiver = Receiver::default();
        let first = next(&mut receiver, 1, 40, 9000);
        assert_eq!(next(&mut receiver, 1, 40, 9000), first);
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
        let mut receiver = Receiver::default();
        let with = GPS_RAW_INT_DATA { alt_ellipsoid: 535_000, ..message() };
        assert_eq!(receiver.fix(&with, 0.0).position.height_m, 535.0);
        assert_eq!(receiver.fix(&message(), 0.2).position.height_m, 535.0);
        let mut other = Receiver::default();
        assert_eq!(other.fix(&message(), 0.0).position.height_m, 488.0);
        assert_eq!(other.fix(&with, 0.2).position.height_m, 488.0);
    }

    #[test]
    fn two_dimensional_and_null_island_are_no_fix() {
        assert!(has_fix(&message()));
        assert!(!has_fix(&GPS_RAW_INT_DATA { fix_type: GpsFixType::GPS_FIX_TYPE_2D_FIX, ..message() }));
        assert!(!has_fix(&GPS_RAW_INT_DATA { lat: 0, lon: 0, ..message() }));
    }
}
