//! The truth: what an ideal sensor would read and where the vehicle really is, on WGS84 with a rotating Earth.
//!
//! Everything follows from place, velocity with its derivative, attitude and rate in north-east-down axes
//! (Groves 2013, sections 5.3 and 5.4, solved for the sensors). Gravity is Somigliana's formula with its height
//! expansion, on purpose not the zonal series of the mechanisation that is under test.

use gaware_nav::earth::{ECCENTRICITY_SQUARED, EQUATORIAL_RADIUS_M, FLATTENING, Geodetic, MU, ROTATION_RATE};
use gaware_nav::math::{cos, sin, tan};
use nalgebra::{Matrix3, Vector3};

/// The vehicle at one instant; all fields belong together exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Time, s.
    pub t_s: f64,
    /// Position of the inertial unit.
    pub place: Geodetic,
    /// Velocity relative to Earth, north-east-down, m/s.
    pub v_n: Vector3<f64>,
    /// C_b^n.
    pub c_nb: Matrix3<f64>,
    /// Angular rate ω_ib^b: what ideal gyros read, rad/s.
    pub rate_ib: Vector3<f64>,
    /// Specific force f^b: what ideal accelerometers read, m/s².
    pub force: Vector3<f64>,
    /// Time derivative of the components of `v_n`, m/s².
    pub a_n: Vector3<f64>,
    /// Rate relative to Earth ω_eb^b, rad/s.
    pub rate_eb: Vector3<f64>,
}

/// Motion in local axes, before the Earth has its say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Velocity relative to Earth, north-east-down, m/s.
    pub v_n: Vector3<f64>,
    /// Its time derivative by components, m/s².
    pub a_n: Vector3<f64>,
    /// C_b^n.
    pub c_nb: Matrix3<f64>,
    /// Rate of the body relative to the local axes ω_nb^b, rad/s.
    pub rate_nb: Vector3<f64>,
}

impl Truth {
    /// The truth that belongs to a motion at a place (Groves 2013, eqs. 5.39, 5.46 and 5.53).
    pub fn of(t_s: f64, place: Geodetic, motion: &Motion) -> Self {
        let c_bn = motion.c_nb.transpose();
        let earth = earth_rate_n(place.lat_rad);
        let transport = transport_rate_n(&place, &motion.v_n);
        let force_n = motion.a_n + (earth * 2.0 + transport).cross(&motion.v_n) - gravity_n(&place);
        let rate_eb = motion.rate_nb + c_bn * transport;
        Self {
            t_s,
            place,
            v_n: motion.v_n,
            c_nb: motion.c_nb,
            rate_ib: rate_eb + c_bn * earth,
            force: c_bn * force_n,
            a_n: motion.a_n,
            rate_eb,
        }
    }
}

/// A flight whose truth can be asked for.
pub trait Trajectory: Send + Sync {
    /// How long it lasts, s; infinite for a vehicle that flies on.
    fn duration_s(&self) -> f64;

    /// The truth at exactly this time, s. A flown (not analytic) trajectory goes only forward, but for at least the
    /// last second.
    fn truth_at(&mut self, t_s: f64) -> Truth;
}

impl<T: Trajectory + ?Sized> Trajectory for Box<T> {
    fn duration_s(&self) -> f64 {
        (**self).duration_s()
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        (**self).truth_at(t_s)
    }
}

/// Derivatives of latitude, longitude (rad/s) and height (m/s) (Groves 2013, eq. 2.111).
pub fn place_rate(place: &Geodetic, v_n: &Vector3<f64>) -> Vector3<f64> {
    let (r_n, r_e) = place.radii();
    Vector3::new(
        v_n.x / (r_n + place.height_m),
        v_n.y / ((r_e + place.height_m) * cos(place.lat_rad)),
        -v_n.z,
    )
}

/// Earth rotation ω_ie^n, rad/s (Groves 2013, eq. 2.123).
fn earth_rate_n(lat_rad: f64) -> Vector3<f64> {
    Vector3::new(cos(lat_rad), 0.0, -sin(lat_rad)) * ROTATION_RATE
}

/// Transport rate ω_en^n, rad/s (Groves 2013, eq. 5.44).
pub fn transport_rate_n(place: &Geodetic, v_n: &Vector3<f64>) -> Vector3<f64> {
    let (r_n, r_e) = place.radii();
    let east = v_n.y / (r_e + place.height_m);
    Vector3::new(east, -v_n.x / (r_n + place.height_m), -east * tan(place.lat_rad))
}

/// Normal gravity, north-east-down, m/s²: Somigliana on the ellipsoid, second-order height expansion and the curvature of
/// the plumb line (NIMA TR8350.2, eqs. 4-1 and 4-3; Groves 2013, eq. 2.140).
pub fn gravity_n(place: &Geodetic) -> Vector3<f64> {
    const SEMI_MINOR_M: f64 = EQUATORIAL_RADIUS_M * (1.0 - FLATTENING);
    const M: f64 =
        ROTATION_RATE * ROTATION_RATE * EQUATORIAL_RADIUS_M * EQUATORIAL_RADIUS_M * SEMI_MINOR_M / MU;
    /// North component per height, 1/s².
    const PLUMB_LINE: f64 = 8.08e-9;
    let s2 = sin(place.lat_rad).powi(2);
    let h = place.height_m / EQUATORIAL_RADIUS_M;
    let on_ellipsoid =
        9.780_325_335_9 * (1.0 + 0.001_931_852_652_41 * s2) / (1.0 - ECCENTRICITY_SQUARED * s2).sqrt();
    let down = on_ellipsoid * (1.0 - 2.0 * (1.0 + FLATTENING + M - 2.0 * FLATTENING * s2) * h + 3.0 * h * h);
    Vector3::new(-PLUMB_LINE * place.height_m * sin(2.0 * place.lat_rad), 0.0, down)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::earth;

    #[test]
    fn gravity_agrees_with_the_zonal_series_up_to_ten_kilometres() {
        for lat_deg in [-80.0, -28.0, 0.0, 28.0, 47.0, 89.0] {
            for height_m in [0.0, 500.0, 5e3, 1e4] {
                let place = Geodetic::from_degrees(lat_deg, 8.0, height_m);
                let series = place.c_en().transpose() * earth::gravity(&place.to_ecef());
                let difference = (series - gravity_n(&place)).norm();
                assert!(difference < 5e-6, "{lat_deg}° {height_m} m: {difference:e}");
            }
        }
    }

    #[test]
    fn standing_vehicle_feels_gravity_and_earth_rate_only() {
        let place = Geodetic::from_degrees(47.0, 8.0, 400.0);
        let still = Motion {
            v_n: Vector3::zeros(),
            a_n: Vector3::zeros(),
            c_nb: Matrix3::identity(),
            rate_nb: Vector3::zeros(),
        };
        let truth = Truth::of(0.0, place, &still);
        assert!((truth.force + gravity_n(&place)).norm() < 1e-15);
        assert!((truth.rate_ib.norm() - ROTATION_RATE).abs() < 1e-18);
        assert_eq!(truth.rate_eb, Vector3::zeros());
    }

    /// At the equator an eastbound vehicle feels the Eötvös effect 2 Ω v + v²/R less.
    #[test]
    fn eastbound_flight_is_lighter() {
        let place = Geodetic::from_degrees(0.0, 8.0, 0.0);
        let v = 300.0;
        let motion = Motion {
            v_n: Vector3::new(0.0, v, 0.0),
            a_n: Vector3::zeros(),
            c_nb: Matrix3::identity(),
            rate_nb: Vector3::zeros(),
        };
        let truth = Truth::of(0.0, place, &motion);
        let expected = -gravity_n(&place).z + 2.0 * ROTATION_RATE * v + v * v / EQUATORIAL_RADIUS_M;
        assert!((truth.force.z - expected).abs() < 1e-12, "{} {expected}", truth.force.z);
    }
}
