//! Strapdown mechanisation in ECEF (the paper, eqs. (6) to (9)) from point samples at their true spacing or from
//! interval means. It knows nothing of errors, filters or sensors: rates and specific forces come in compensated.

use crate::earth::{self, Geodetic};
use crate::rotation::{exp, skew};
use crate::sample::SampleKind;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Position, velocity and attitude of the inertial unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavState {
    /// Position in ECEF, m.
    pub r_e: Vector3<f64>,
    /// Velocity relative to Earth, ECEF axes, m/s.
    pub v_e: Vector3<f64>,
    /// Attitude: turns body vectors into ECEF ones.
    pub q_eb: UnitQuaternion<f64>,
}

impl NavState {
    /// From a geodetic place, a north-east-down velocity (m/s) and C_b^n.
    pub fn from_ned(place: Geodetic, v_n: &Vector3<f64>, c_nb: &Matrix3<f64>) -> Self {
        let c_en = place.c_en();
        let c_eb = nalgebra::Rotation3::from_matrix_unchecked(c_en * c_nb);
        Self { r_e: place.to_ecef(), v_e: c_en * v_n, q_eb: UnitQuaternion::from_rotation_matrix(&c_eb) }
    }

    /// C_b^e.
    pub fn c_eb(&self) -> Matrix3<f64> {
        self.q_eb.to_rotation_matrix().into_inner()
    }

    /// The place on the ellipsoid.
    pub fn geodetic(&self) -> Geodetic {
        Geodetic::from_ecef(&self.r_e)
    }

    /// Velocity in north-east-down axes, m/s.
    pub fn v_n(&self) -> Vector3<f64> {
        earth::c_en_at(&self.r_e).transpose() * self.v_e
    }

    /// C_b^n.
    pub fn c_nb(&self) -> Matrix3<f64> {
        earth::c_en_at(&self.r_e).transpose() * self.c_eb()
    }

    /// Roll, pitch, yaw, rad.
    pub fn euler(&self) -> Vector3<f64> {
        crate::rotation::euler_from_c_nb(&self.c_nb())
    }
}

/// Compensated rate and specific force at one instant (or their mean over the interval that ends there).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// ω_ib^b, rad/s.
    pub rate: Vector3<f64>,
    /// f^b, m/s².
    pub force: Vector3<f64>,
}

/// The largest angle that one evaluation of the series covers, rad: its next terms are below 1e-3 of it.
const LONGEST_ARC: f64 = 0.5;
/// More pieces than this are not worth it: such a motion was not measured but made up.
const MOST_ARCS: f64 = 64.0;

/// What the body did in one interval, before Earth comes into it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Increment {
    /// Length of the interval, s.
    pub dt: f64,
    /// Rotation vector from the start attitude to the end attitude, start axes, rad.
    pub dtheta: Vector3<f64>,
    /// ∫ C f dt in the axes of the start attitude, m/s.
    pub dv: Vector3<f64>,
    /// ∬ C f dt² in the axes of the start attitude, m.
    pub dp: Vector3<f64>,
}

impl Increment {
    /// From the motion at both ends of an interval of `dt` seconds.
    ///
    /// Point samples are taken as varying linearly in between: coning by ω₀×ω₁/12 (Savage 1998, part 1, eq. 44, for
    /// linear rate), sculling and rotation by the exact integrals of the linear model to second order in angle.
    /// Interval means are taken as constant.
    ///
    /// The series are good to a fraction of a radian; a longer interval is made of shorter ones.
    pub fn between(start: &Motion, end: &Motion, kind: SampleKind, dt: f64) -> Self {
        let angle = start.rate.norm().max(end.rate.norm()) * dt;
        if angle <= LONGEST_ARC || !angle.is_finite() {
            return Self::arc(start, end, kind, dt);
        }
        let pieces = (angle / LONGEST_ARC).ceil().min(MOST_ARCS);
        let start = if kind == SampleKind::Point { start } else { end };
        let at = |k: f64| Motion {
            rate: start.rate.lerp(&end.rate, k / pieces),
            force: start.force.lerp(&end.force, k / pieces),
        };
        let piece_s = dt / pieces;
        let mut whole = Self { dt, dtheta: Vector3::zeros(), dv: Vector3::zeros(), dp: Vector3::zeros() };
        let mut turned = UnitQuaternion::identity();
        for k in 0..pieces as u32 {
            let k = f64::from(k);
            let piece = Self::arc(&at(k), &at(k + 1.0), SampleKind::Point, piece_s);
            whole.dp += whole.dv * piece_s + turned * piece.dp;
            whole.dv += turned * piece.dv;
            turned *= exp(&piece.dtheta);
        }
        whole.dtheta = crate::rotation::log(&turned);
        whole
    }

    /// An interval in which the body turns by little.
    fn arc(start: &Motion, end: &Motion, kind: SampleKind, dt: f64) -> Self {
        let (w0, f0) = match kind {
            SampleKind::Point => (start.rate, start.force),
            SampleKind::IntervalMean => (end.rate, end.force),
        };
        let (w1, f1) = (end.rate, end.force);
        let (w_mean, f_mean) = ((w0 + w1) * 0.5, (f0 + f1) * 0.5);
        let (dw, df) = (w1 - w0, f1 - f0);
        let dt2 = dt * dt;
        let dtheta = w_mean * dt + w0.cross(&w1) * (dt2 / 12.0);
        // ∫ α×f with α = ω₀τ + ½ω̇τ², f = f₀ + ḟτ, and ½∫ α×(α×f) with the means.
        let turn = w0.cross(&f0) / 2.0 + w0.cross(&df) / 3.0 + dw.cross(&f0) / 6.0 + dw.cross(&df) / 8.0;
        let dv = f_mean * dt + turn * dt2 + w_mean.cross(&w_mean.cross(&f_mean)) * (dt2 * dt / 6.0);
        let dp = (f0 / 3.0 + f1 / 6.0) * dt2 + w_mean.cross(&f_mean) * (dt2 * dt / 6.0);
        Self { dt, dtheta, dv, dp }
    }
}

/// One step of the mechanisation (Groves 2013, section 5.3, with trapezoidal position and mid-interval gravity).
pub fn step(state: &NavState, inc: &Increment) -> NavState {
    let dt = inc.dt;
    let omega = earth::rotation_rate();
    let c0 = state.c_eb();
    // The ECEF axes turn by ω_ie·dt below the inertially fixed start attitude: half of it on average for dv.
    let turned = |v: Vector3<f64>, share: f64| v - omega.cross(&v) * (share * dt);
    let dv_f = turned(c0 * inc.dv, 0.5);
    let dp_f = turned(c0 * inc.dp, 1.0 / 3.0);
    let g0 = earth::gravity(&state.r_e);
    let coriolis = |v: &Vector3<f64>| omega.cross(v) * -2.0;
    let a0 = g0 + coriolis(&state.v_e);
    let r_mid = state.r_e + state.v_e * (0.5 * dt);
    let v_mid = state.v_e + (dv_f + a0 * dt) * 0.5;
    let a_mid = earth::gravity(&r_mid) + coriolis(&v_mid);
    let v_e = state.v_e + dv_f + a_mid * dt;
    let r_e = state.r_e + state.v_e * dt + dp_f + a0 * (0.5 * dt * dt);
    let mut q_eb = exp(&(-omega * dt)) * state.q_eb * exp(&inc.dtheta);
    q_eb.renormalize_fast();
    NavState { r_e, v_e, q_eb }
}

/// Acceleration relative to Earth in ECEF axes, m/s² (the paper, eq. (7)).
pub fn acceleration(state: &NavState, force: &Vector3<f64>) -> Vector3<f64> {
    state.c_eb() * force - skew(&earth::rotation_rate()) * state.v_e * 2.0 + earth::gravity(&state.r_e)
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin, sin_cos};

    use super::*;
    use crate::rotation::c_nb_from_euler;

    /// Motion of a vehicle that stands on the rotating Earth.
    fn standing(state: &NavState) -> Motion {
        let to_body = state.q_eb.inverse();
        Motion { rate: to_body * earth::rotation_rate(), force: to_body * -earth::gravity(&state.r_e) }
    }

    #[test]
    fn a_standing_vehicle_stays() {
        let start = NavState::from_ned(
            Geodetic::from_degrees(48.0, 11.0, 500.0),
            &Vector3::zeros(),
            &c_nb_from_euler(0.1, -0.2, 2.0),
        );
        let m = standing(&start);
        let mut state = start;
        for _ in 0..60_000 {
            state = step(&state, &Increment::between(&m, &m, SampleKind::Point, 0.01));
        }
        assert!((state.r_e - start.r_e).norm() < 1e-3, "{}", (state.r_e - start.r_e).norm());
        assert!((state.v_e - start.v_e).norm() < 1e-5);
        assert!(state.q_eb.angle_to(&start.q_eb) < 1e-9);
    }

    /// Rate and specific force of a body whose axis describes a cone while it is shaken in phase with that: coning turns it and
    /// sculling moves it, though neither rate nor force has a mean there.
    fn coning_and_sculling(t: f64) -> Motion {
        let (s, c) = sin_cos(CONE.1 * t);
        let k = CONE.1 * sin(CONE.0);
        // Body rate of q = Rz(wt) Rx(a) Rz(−wt).
        let rate = Vector3::new(-k * s, k * c, CONE.1 * (cos(CONE.0) - 1.0));
        Motion { rate, force: Vector3::new(0.0, 0.0, SHAKEN * c) }
    }

    /// Half angle, rad, and rate, rad/s.
    const CONE: (f64, f64) = (0.05, 20.0);
    /// Amplitude of the specific force along the cone's axis, m/s².
    const SHAKEN: f64 = 10.0;

    fn on_the_cone(t: f64) -> UnitQuaternion<f64> {
        let about = |v: Vector3<f64>| UnitQuaternion::from_scaled_axis(v);
        about(Vector3::z() * CONE.1 * t) * about(Vector3::x() * CONE.0) * about(Vector3::z() * -CONE.1 * t)
    }

    /// Attitude error, rad, and velocity error, m/s, after 10 s at 100 Hz when each increment is changed by `change`.
    fn drift(change: impl Fn(&Motion, &Motion, &mut Increment)) -> (f64, f64) {
        const DT: f64 = 0.01;
        let mut q = on_the_cone(0.0);
        let (mut v, mut exact) = (Vector3::zeros(), Vector3::zeros());
        for i in 0..1000 {
            let t = f64::from(i) * DT;
            let (start, end) = (coning_and_sculling(t), coning_and_sculling(t + DT));
            let mut inc = Increment::between(&start, &end, SampleKind::Point, DT);
            change(&start, &end, &mut inc);
            v += on_the_cone(t) * inc.dv;
            q *= exp(&inc.dtheta);
            // Simpson's rule over hundredths of the step is exact to 1e-12 here.
            for k in 0..100 {
                let at = |share: f64| {
                    let time = t + DT * (f64::from(k) + share) / 100.0;
                    on_the_cone(time) * coning_and_sculling(time).force
                };
                exact += (at(0.0) + at(0.5) * 4.0 + at(1.0)) * (DT / 600.0);
            }
        }
        (q.angle_to(&on_the_cone(10.0)), (v - exact).norm())
    }

    #[test]
    fn coning_and_sculling_are_integrated_and_neither_term_may_be_missing_or_reversed() {
        let coning = |a: &Motion, b: &Motion| a.rate.cross(&b.rate) * (1e-4 / 12.0);
        let sculling = |a: &Motion, b: &Motion| {
            let (dw, df) = (b.rate - a.rate, b.force - a.force);
            (a.rate.cross(&df) - dw.cross(&a.force)) * (1e-4 / 12.0)
        };
        // Linear interpolation of a sine of 20 rad/s at 100 Hz leaves this much.
        let (attitude, velocity) = drift(|_, _, _| {});
        assert!(attitude < 1.7e-3 && velocity < 8.6e-3, "{attitude} {velocity}");
        for (share, least) in [(1.0, (3.3e-3, 24e-3)), (2.0, (4.9e-3, 41e-3))] {
            let (without, _) = drift(|a, b, inc| inc.dtheta -= coning(a, b) * share);
            assert!(without > least.0, "{share}: {without}");
            let (_, without) = drift(|a, b, inc| inc.dv -= sculling(a, b) * share);
            assert!(without > least.1, "{share}: {without}");
        }
    }

    #[test]
    fn a_long_interval_is_made_of_short_ones() {
        let start = Motion { rate: Vector3::new(0.4, -1.0, 2.0), force: Vector3::new(1.0, 2.0, -9.0) };
        let end = Motion { rate: Vector3::new(-0.3, 1.5, 1.0), force: Vector3::new(-2.0, 0.5, -12.0) };
        const LENGTH_S: f64 = 5.0;
        let long = Increment::between(&start, &end, SampleKind::Point, LENGTH_S);
        let at = |share: f64| Motion {
            rate: start.rate.lerp(&end.rate, share),
            force: start.force.lerp(&end.force, share),
        };
        let (mut q, mut v, mut p) = (UnitQuaternion::identity(), Vector3::zeros(), Vector3::zeros());
        for i in 0..5000 {
            let share = |k: i32| f64::from(k) / 5000.0;
            let dt = LENGTH_S / 5000.0;
            let step = Increment::between(&at(share(i)), &at(share(i + 1)), SampleKind::Point, dt);
            p += v * dt + q * step.dp;
            v += q * step.dv;
            q *= exp(&step.dtheta);
        }
        assert!(exp(&long.dtheta).angle_to(&q) < 0.01, "{}", exp(&long.dtheta).angle_to(&q));
        assert!((long.dv - v).norm() < 0.01 * v.norm() && (long.dp - p).norm() < 0.01 * p.norm());
    }

    #[test]
    fn free_fall_with_rotation_follows_gravity() {
        // No specific force: whatever the body turns, the path is ballistic.
        let start = NavState::from_ned(
            Geodetic::from_degrees(10.0, 20.0, 10_000.0),
            &Vector3::new(100.0, 50.0, -20.0),
            &Matrix3::identity(),
        );
        let m = Motion { rate: Vector3::new(1.0, -2.0, 0.5), force: Vector3::zeros() };
        let run = |dt: f64| {
            (0..(5.0 / dt) as usize)
                .fold(start, |s, _| step(&s, &Increment::between(&m, &m, SampleKind::Point, dt)))
        };
        assert!((run(0.02).r_e - run(0.001).r_e).norm() < 1e-3);
    }
}
