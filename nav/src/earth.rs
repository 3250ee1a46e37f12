//! The Earth: WGS84 ellipsoid, its rotation and its normal gravity, all in the ECEF frame.
//!
//! Gravity is the normal field with its zonal terms J2 and J4 plus the centrifugal acceleration, so no geodetic
//! conversion is needed inside the mechanisation. Nothing here knows of sensors or filters.

use crate::math::{atan2, sin, sin_cos};
use crate::rss;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Equatorial radius, m (WGS84, NIMA TR8350.2 table 3.1).
pub const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;
/// Flattening (WGS84, NIMA TR8350.2 table 3.1).
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared, 2f − f².
pub const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);
/// Rotation rate of the Earth, rad/s (WGS84).
pub const ROTATION_RATE: f64 = 7.292_115e-5;
/// Gravitational constant times mass of the Earth, m³/s² (WGS84).
pub const MU: f64 = 3.986_004_418e14;
/// Second zonal coefficient of the normal field (WGS84).
pub const J2: f64 = 1.082_629_821e-3;
/// Fourth zonal coefficient of the normal field (WGS84).
pub const J4: f64 = -2.370_911_2e-6;
/// Standard gravity, m/s²: the `g` of all units "per g" (ISO 80000-3).
pub const STANDARD_GRAVITY: f64 = 9.806_65;

/// Earth rotation vector ω_ie in ECEF, rad/s.
pub fn rotation_rate() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, ROTATION_RATE)
}

/// A geodetic position on WGS84; height above the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Latitude, rad, north positive.
    pub lat_rad: f64,
    /// Longitude, rad, east positive.
    pub lon_rad: f64,
    /// Height above the ellipsoid, m.
    pub height_m: f64,
}

impl Geodetic {
    /// From latitude and longitude in degrees and height above the ellipsoid in metres.
    pub fn from_degrees(lat_deg: f64, lon_deg: f64, height_m: f64) -> Self {
        Self { lat_rad: lat_deg.to_radians(), lon_rad: lon_deg.to_radians(), height_m }
    }

    /// The same point in ECEF, m (Groves 2013, eq. 2.112).
    pub fn to_ecef(self) -> Vector3<f64> {
        let (sin_lat, cos_lat) = sin_cos(self.lat_rad);
        let (sin_lon, cos_lon) = sin_cos(self.lon_rad);
        let n = EQUATORIAL_RADIUS_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        let p = (n + self.height_m) * cos_lat;
        Vector3::new(p * cos_lon, p * sin_lon, ((1.0 - ECCENTRICITY_SQUARED) * n + self.height_m) * sin_lat)
    }

    /// From an ECEF position, m.
    pub fn from_ecef(r_e: &Vector3<f64>) -> Self {
        let (sin_lat, cos_lat) = latitude(r_e);
        let w = (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        // Height without cancellation at the poles (Fukushima 1999, eq. 4).
        let height = rss(r_e.x, r_e.y) * cos_lat + r_e.z * sin_lat - EQUATORIAL_RADIUS_M * w;
        Self { lat_rad: atan2(sin_lat, cos_lat), lon_rad: atan2(r_e.y, r_e.x), height_m: height }
    }

    /// C_n^e: turns north-east-down vectors at this place into ECEF (Groves 2013, eq. 2.150 transposed).
    pub fn c_en(&self) -> Matrix3<f64> {
        ned_axes(sin_cos(self.lat_rad), sin_cos(self.lon_rad))
    }

    /// Meridian and transverse radii of curvature R_N, R_E, m (Groves 2013, eqs. 2.105 and 2.106).
    pub fn radii(&self) -> (f64, f64) {
        let w2 = 1.0 - ECCENTRICITY_SQUARED * sin(self.lat_rad).powi(2);
        let r_e = EQUATORIAL_RADIUS_M / w2.sqrt();
        (r_e * (1.0 - ECCENTRICITY_SQUARED) / w2, r_e)
    }
}

/// C_n^e at an ECEF position: that of its [`Geodetic`] without the angles in between.
pub fn c_en_at(r_e: &Vector3<f64>) -> Matrix3<f64> {
    let p = (r_e.x * r_e.x + r_e.y * r_e.y).sqrt();
    let lon = if p > 0.0 { (r_e.y / p, r_e.x / p) } else { (0.0, 1.0) };
    ned_axes(latitude(r_e), lon)
}

/// Sine and cosine of the geodetic latitude: Bowring's formula with refinements, below 1 nm up to 100 km height
/// (Bowring 1985, Survey Review 28), in sines and cosines alone.
fn latitude(r_e: &Vector3<f64>) -> (f64, f64) {
    let unit = |s: f64, c: f64| {
        let norm = (s * s + c * c).sqrt().max(f64::MIN_POSITIVE);
        (s / norm, c / norm)
    };
    let p = (r_e.x * r_e.x + r_e.y * r_e.y).sqrt();
    let b = EQUATORIAL_RADIUS_M * (1.0 - FLATTENING);
    let second_eccentricity_squared = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED);
    let (mut sin_beta, mut cos_beta) = unit(r_e.z * EQUATORIAL_RADIUS_M, p * b);
    for _ in 0..2 {
        let (sin_lat, cos_lat) = latitude_step(r_e.z, p, second_eccentricity_squared * b, sin_beta, cos_beta);
        (sin_beta, cos_beta) = unit((1.0 - FLATTENING) * sin_lat, cos_lat);
    }
    let (sin_lat, cos_lat) = latitude_step(r_e.z, p, second_eccentricity_squared * b, sin_beta, cos_beta);
    unit(sin_lat, cos_lat)
}

/// Latitude from the parametric latitude, as a direction of any length (Bowring 1985).
fn latitude_step(z: f64, p: f64, polar: f64, sin_beta: f64, cos_beta: f64) -> (f64, f64) {
    let cube = |x: f64| x * x * x;
    (z + polar * cube(sin_beta), p - ECCENTRICITY_SQUARED * EQUATORIAL_RADIUS_M * cube(cos_beta))
}

/// North, east and down in ECEF axes as columns, from sine and cosine of latitude and longitude.
fn ned_axes((sin_lat, cos_lat): (f64, f64), (sin_lon, cos_lon): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(
        -sin_lat * cos_lon,
        -sin_lon,
        -cos_lat * cos_lon,
        -sin_lat * sin_lon,
        cos_lon,
        -cos_lat * sin_lon,
        cos_lat,
        0.0,
        -sin_lat,
    )
}

/// Gravity (gravitation plus centrifugal acceleration) in ECEF, m/s², at an ECEF position.
///
/// Zonal expansion of the normal field to J4 (Vallado 2013, eqs. 8-31 and 8-33) and ω²·[x, y, 0] (Groves 2013,
/// eq. 2.132); agrees with Somigliana's formula to 1 µm/s² on the ellipsoid.
pub fn gravity(r_e: &Vector3<f64>) -> Vector3<f64> {
    let r2 = r_e.norm_squared();
    let r = r2.sqrt();
    let u2 = r_e.z * r_e.z / r2;
    let q = EQUATORIAL_RADIUS_M * EQUATORIAL_RADIUS_M / r2;
    let j2 = 1.5 * J2 * q;
    let j4 = 15.0 / 8.0 * J4 * q * q;
    let xy = 1.0 + j2 * (1.0 - 5.0 * u2) - j4 * (1.0 - 14.0 * u2 + 21.0 * u2 * u2);
    let z = 1.0 + j2 * (3.0 - 5.0 * u2) - j4 * (5.0 - 70.0 / 3.0 * u2 + 21.0 * u2 * u2);
    let k = -MU / (r2 * r);
    let w2 = ROTATION_RATE * ROTATION_RATE;
    Vector3::new((k * xy + w2) * r_e.x, (k * xy + w2) * r_e.y, k * z * r_e.z)
}

/// ∂g/∂r in ECEF, 1/s²: point mass and centrifugal parts, enough for error propagation.
pub fn gravity_gradient(r_e: &Vector3<f64>) -> Matrix3<f64> {
    let r2 = r_e.norm_squared();
    let k = MU / (r2 * r2.sqrt());
    let w2 = ROTATION_RATE * ROTATION_RATE;
    (r_e * r_e.transpose() * (3.0 / r2) - Matrix3::identity()) * k
        + Matrix3::from_diagonal(&Vector3::new(w2, w2, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Somigliana's closed formula on the ellipsoid (NIMA TR8350.2, eq. 4-1).
    fn somigliana(lat: f64) -> f64 {
        let s2 = sin(lat).powi(2);
        9.780_325_335_9 * (1.0 + 0.001_931_852_652_41 * s2) / (1.0 - ECCENTRICITY_SQUARED * s2).sqrt()
    }

    #[test]
    fn gravity_agrees_with_somigliana_and_points_down() {
        for lat_deg in [-90.0, -60.0, -45.0, 0.0, 30.0, 47.0, 80.0, 90.0] {
            let place = Geodetic::from_degrees(lat_deg, 13.0, 0.0);
            let g_n = place.c_en().transpose() * gravity(&place.to_ecef());
            assert!((g_n.z - somigliana(place.lat_rad)).abs() < 1e-6, "{lat_deg}: {g_n}");
            assert!(g_n.xy().norm() < 2e-6, "{lat_deg}: {g_n}");
        }
    }

    #[test]
    fn gravity_gradient_matches_finite_differences() {
        /// The gradient of the J2 term, which `gravity_gradient` leaves out: 12 J2 μ/r³.
        const J2_PART: f64 = 12.0 * J2 * 1.54e-6;
        let r = Geodetic::from_degrees(47.0, 8.0, 500.0).to_ecef();
        for i in 0..3 {
            let mut step = Vector3::zeros();
            step[i] = 100.0;
            let numeric = (gravity(&(r + step)) - gravity(&(r - step))) / 200.0;
            assert!((numeric - gravity_gradient(&r).column(i)).norm() < J2_PART);
        }
    }

    proptest! {
        #[test]
        fn geodetic_round_trip(lat in -89.999..89.999f64, lon in -180.0..180.0f64, h in -5e3..1e5f64) {
            let place = Geodetic::from_degrees(lat, lon, h);
            let back = Geodetic::from_ecef(&place.to_ecef());
            prop_assert!((back.to_ecef() - place.to_ecef()).norm() < 1e-7);
            prop_assert!((back.lat_rad - place.lat_rad).abs() < 1e-14);
        }

        #[test]
        fn axes_at_a_position_are_those_of_its_latitude_and_longitude(
            lat in -90.0..90.0f64, lon in -180.0..180.0f64, h in -5e3..1e5f64,
        ) {
            let place = Geodetic::from_degrees(lat, lon, h);
            prop_assert!((c_en_at(&place.to_ecef()) - place.c_en()).norm() < 1e-13);
        }

        #[test]
        fn c_en_is_a_rotation(lat in -90.0..90.0f64, lon in -180.0..180.0f64) {
            let c = Geodetic::from_degrees(lat, lon, 0.0).c_en();
            prop_assert!((c * c.transpose() - Matrix3::identity()).norm() < 1e-14);
            prop_assert!((c.determinant() - 1.0).abs() < 1e-14);
        }
    }
}
