//! The Earth of a simulator: many fly over a sphere that does not turn, with the same gravity everywhere. What that puts into a recording is taken out, so that
//! no effect is named for it.
//!
//! Positions of the receiver, read as those of the ellipsoid, stretch against their own velocities.
//! ArduPilot's has a sphere of 6 378 100 m (`AP_Common/Location.h`, `LOCATION_SCALING_FACTOR`), others 6 353 000 to 6 371 000 m: by up to 0.67 % north, by
//! up to 0.34 % east. Left in, that is 0.07 m/s at 20 m/s, which effects of the catalogue imitate where nothing else is that large. What the
//! positions stretch by is a regression of the way between fixes on the integral of their velocities: on two flights of ArduPilot's simulator −1350 ± 62 and
//! 1921 ± 81, −1232 ± 21 and 1881 ± 22 ppm (its sphere: −1330 and 1801), on public logs of vehicles ± 4500 ppm and more (2026-11-26).
//!
//! Where the positions show a sphere, gyros did not see the Earth turn (15 deg/h), accelerometers no Coriolis force (0.3 mg at 20 m/s), and gravity was 9.80665 m/s² (0.9 mg
//! off at 35° south; `SIM_Aircraft.cpp`, `update_dynamics`, of ArduPilot): what a unit on the Earth would have measured is added to the samples.

use super::linear::reference::Reference;
use crate::earth::{Geodetic, ROTATION_RATE, STANDARD_GRAVITY, c_en_at, gravity};
use crate::math::cos;
use crate::mechanization::NavState;
use crate::sample::{GnssFix, ImuSample};
use nalgebra::{Matrix2, Vector2, Vector3};

/// No Earth stretches by more: radii of curvature of the ellipsoid lie between 6335 and 6400 km.
const MOST: f64 = 6.7e-3;
/// No sphere stretches both directions by less at any latitude.
const LEAST: f64 = 1e-3;
/// It must be this many sigmas …
const SIGMAS: f64 = 5.0;
/// … over at least so many ways …
const WAYS: usize = 6;
/// … of this length, s, …
const WAY_S: f64 = 10.0;
/// … without a pause of this, s; one that a pause ends counts from this length on, s.
const PAUSE_S: f64 = 1.5;
const SHORT_S: f64 = 4.0;

/// One way: displacement, integral of the velocity, change of the velocity (what differs in age); north and east.
type Way = [Vector2<f64>; 3];

/// One that goes on: where it began, its trapezoids so far, and the slopes at both of its ends.
type Begun<'a> = (&'a GnssFix, Vector2<f64>, Option<[Vector2<f64>; 2]>);

/// Ways of a flight between its fixes: the trapezoids of their velocities, less what these leave out in turns, by the slopes at both ends (Euler and Maclaurin;
/// Abramowitz & Stegun 1964, 25.4.7). Circles of 15 s with five fixes a second would seem 600 ppm too small.
fn ways(fixes: &[GnssFix]) -> Vec<Way> {
    let Some(origin) = fixes.first().map(|f| f.position) else { return Vec::new() };
    let mut out = Vec::new();
    let mut begun: Option<Begun<'_>> = None;
    for pair in fixes.windows(2) {
        let [before, now] = pair else { continue };
        let (Some(v_before), Some(v)) = (horizontal(before), horizontal(now)) else { return Vec::new() };
        let dt = now.t_s - before.t_s;
        let (first, mut way, mut slopes) = begun.take().unwrap_or((before, Vector2::zeros(), None));
        let (last, v_last) = if dt > PAUSE_S { (before, v_before) } else { (now, v) };
        if dt <= PAUSE_S {
            way += (v_before + v) * (0.5 * dt);
            let slope = (v - v_before) * (dt / 12.0);
            slopes = Some([slopes.map_or(slope, |s| s[0]), slope]);
        }
        let long_s = last.t_s - first.t_s;
        if dt <= PAUSE_S && long_s < WAY_S {
            begun = Some((first, way, slopes));
        } else if let Some(v_first) = horizontal(first).filter(|_| long_s >= SHORT_S) {
            way += slopes.map_or_else(Vector2::zeros, |[begin, end]| begin - end);
            out.push([away(&origin, &last.position) - away(&origin, &first.position), way, v_last - v_first]);
        }
    }
    out
}

fn horizontal(fix: &GnssFix) -> Option<Vector2<f64>> {
    fix.velocity.horizontal().map(Vector2::from)
}

/// From the origin, north and east, m.
fn away(origin: &Geodetic, place: &Geodetic) -> Vector2<f64> {
    let (north, east) = place.radii();
    Vector2::new(
        (place.lat_rad - origin.lat_rad) * (north + origin.height_m),
        (place.lon_rad - origin.lon_rad) * (east + origin.height_m) * cos(place.lat_rad),
    )
}

/// By how much the positions stretch along one axis, and the 1-sigma; `None` where the ways say nothing.
fn along(ways: &[Way], axis: usize) -> Option<(f64, f64)> {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for [moved, way, change] in ways {
        let x = Vector2::new(way[axis], change[axis]);
        normal += x * x.transpose();
        right += x * (moved[axis] - way[axis]);
    }
    let covariance = normal.try_inverse()?;
    let fit = covariance * right;
    let left =
        |[moved, way, change]: &Way| moved[axis] - way[axis] - fit.x * way[axis] - fit.y * change[axis];
    let square: f64 = ways.iter().map(|w| left(w).powi(2)).sum();
    Some((fit.x, (square / (ways.len() as f64 - 2.0) * covariance[(0, 0)]).sqrt()))
}

/// By how much the positions of a simulator's fixes stretch north and east against their velocities; `None` for those of a receiver.
pub(super) fn stretch(fixes: &[GnssFix]) -> Option<[f64; 2]> {
    let ways = ways(fixes);
    if ways.len() < WAYS {
        return None;
    }
    let both = [along(&ways, 0)?, along(&ways, 1)?];
    let is_known = both.iter().all(|(k, sigma)| k.abs() < MOST && SIGMAS * sigma < MOST);
    let is_there = both.iter().any(|(k, sigma)| k.abs() > LEAST.max(SIGMAS * sigma));
    (is_known && is_there).then(|| both.map(|b| b.0))
}

/// The position on the ellipsoid as far from the origin as the simulator had it.
pub(super) fn undone(origin: &Geodetic, place: Geodetic, [north, east]: [f64; 2]) -> Geodetic {
    Geodetic {
        lat_rad: origin.lat_rad + (place.lat_rad - origin.lat_rad) / (1.0 + north),
        lon_rad: origin.lon_rad + (place.lon_rad - origin.lon_rad) / (1.0 + east),
        ..place
    }
}

/// A flight over an Earth that does not turn: time and trajectory at its fixes.
#[derive(Debug, Clone)]
pub(super) struct Still(Vec<(f64, NavState)>);

impl Still {
    /// By a first trajectory.
    pub(super) fn of(reference: &Reference) -> Self {
        Self(reference.knots.iter().map(|k| (k.t_s, k.nav)).collect())
    }

    /// The same at another time.
    pub(super) fn move_by(&mut self, by_s: f64) {
        self.0.iter_mut().for_each(|(t_s, _)| *t_s += by_s);
    }

    /// What a unit on the Earth would have measured where the simulated one measured these: the rate of the Earth, the Coriolis acceleration and gravity
    /// as in the navigation equations in ECEF axes (Groves 2013, eqs. 5.18 to 5.36).
    pub(super) fn on_earth(&self, samples: &mut [ImuSample]) {
        let rate = Vector3::new(0.0, 0.0, ROTATION_RATE);
        let mut at = 0;
        for sample in samples {
            while self.0.get(at + 1).is_some_and(|(t_s, _)| *t_s <= sample.t_s) {
                at += 1;
            }
            let Some((t_s, nav)) = self.0.get(at) else { return };
            let q_eb = self.0.get(at + 1).map_or(nav.q_eb, |(next_s, next)| {
                let share = ((sample.t_s - t_s) / (next_s - t_s).max(1e-6)).clamp(0.0, 1.0);
                nav.q_eb.nlerp(&next.q_eb, share)
            });
            let constant = c_en_at(&nav.r_e) * Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
            let force = constant - gravity(&nav.r_e) + 2.0 * rate.cross(&nav.v_e);
            sample.gyro += q_eb.inverse_transform_vector(&rate);
            sample.accel += q_eb.inverse_transform_vector(&force);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{sin, sin_cos};
    use crate::sample::FixVelocity;

    /// Circles at so many rad/s that drift away at 47° north, with fixes five times a second on a sphere of this radius; `None`: on the ellipsoid.
    fn circled(turn: f64, radius_m: Option<f64>, error_m: f64) -> Vec<GnssFix> {
        let home = Geodetic::from_degrees(47.0, 8.0, 500.0);
        let (north, east) = home.radii();
        let [north, east] = radius_m.map_or([north + 500.0, east + 500.0], |r| [r, r]);
        // Uniform with this RMS.
        let error = |k: f64| ((sin(12.9898 * k) * 43_758.545_3).rem_euclid(1.0) - 0.5) * 12f64.sqrt();
        let fix = |k: i32| {
            let t_s = 0.2 * f64::from(k);
            let (s, c) = sin_cos(turn * t_s);
            let v = Vector2::new(20.0 * c + 3.0, 20.0 * s - 2.0);
            let at = Vector2::new(20.0 / turn * s + 3.0 * t_s, 20.0 / turn * (1.0 - c) - 2.0 * t_s);
            let error = [2 * k, 2 * k + 1].map(|k| error_m * error(f64::from(k)));
            let position = Geodetic {
                lat_rad: home.lat_rad + (at.x + error[0]) / north,
                lon_rad: home.lon_rad + (at.y + error[1]) / (east * cos(home.lat_rad + at.x / north)),
                height_m: 500.0,
            };
            GnssFix {
                t_s,
                position,
                velocity: FixVelocity::Horizontal([v.x, v.y]),
                position_sigma_m: None,
                velocity_sigma_m_per_s: None,
                yaw_rad: None,
            }
        };
        (0..3000).map(fix).collect()
    }

    fn flown(radius_m: Option<f64>, error_m: f64) -> Vec<GnssFix> {
        circled(0.05, radius_m, error_m)
    }

    /// In circles of 14 s and more: what trapezoids leave out is none of the sphere's.
    #[test]
    fn circles_do_not_stretch_it() {
        for turn in [0.05, 0.25, 0.45] {
            let [north, east] = stretch(&circled(turn, Some(6_378_100.0), 0.0)).unwrap();
            assert!(
                (north + 1.248e-3).abs() < 5e-5 && (east - 1.876e-3).abs() < 5e-5,
                "{turn}: {north} {east}"
            );
        }
    }

    #[test]
    fn the_sphere_of_a_simulator_is_seen_and_taken_out() {
        let fixes = flown(Some(6_378_100.0), 0.02);
        let [north, east] = stretch(&fixes).unwrap();
        assert!((north + 1.25e-3).abs() < 2e-4 && (east - 1.88e-3).abs() < 2e-4, "{north} {east}");
        let origin = fixes[0].position;
        let straight: Vec<GnssFix> = fixes
            .into_iter()
            .map(|f| GnssFix { position: undone(&origin, f.position, [north, east]), ..f })
            .collect();
        assert!(stretch(&straight).is_none());
    }

    /// At rest, nose to the east: a simulated unit shows no rate and standard gravity, one on the Earth its rotation and the gravity of the place.
    #[test]
    fn samples_are_those_of_a_unit_on_the_earth() {
        let place = Geodetic::from_degrees(-35.0, 149.0, 600.0);
        let c_nb = crate::rotation::c_nb_from_euler(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let nav = NavState::from_ned(place, &Vector3::zeros(), &c_nb);
        let still = Still(vec![(0.0, nav), (10.0, nav)]);
        let simulated = ImuSample {
            t_s: 4.0,
            gyro: Vector3::zeros(),
            accel: Vector3::new(0.0, 0.0, -STANDARD_GRAVITY),
            temperature_degc: None,
        };
        let mut samples = [simulated];
        still.on_earth(&mut samples);
        let [sample] = samples;
        // The Earth turns about north and, south of the equator, about down: y of this body is south.
        let (north, down) = (cos(35f64.to_radians()), sin(35f64.to_radians()));
        let rate = ROTATION_RATE * Vector3::new(0.0, -north, down);
        assert!((sample.gyro - rate).amax() < 1e-9, "{}", sample.gyro);
        assert!((sample.accel.norm() - gravity(&nav.r_e).norm()).abs() < 1e-6, "{}", sample.accel);
    }

    /// Where a pause ends a way, the next one begins after it.
    #[test]
    fn pauses_do_not_hide_it() {
        let mut fixes = flown(Some(6_378_100.0), 0.02);
        fixes.retain(|f| f.t_s % 7.0 < 5.0);
        let [north, east] = stretch(&fixes).unwrap();
        assert!((north + 1.25e-3).abs() < 3e-4 && (east - 1.88e-3).abs() < 3e-4, "{north} {east}");
    }

    #[test]
    fn fixes_of_a_receiver_are_left_alone() {
        assert!(stretch(&flown(None, 0.01)).is_none());
        assert!(stretch(&flown(Some(6_378_100.0), 5.0)).is_none());
        assert!(stretch(&flown(Some(6_378_100.0), 0.02)[..250]).is_none());
        assert!(stretch(&[]).is_none());
    }
}
