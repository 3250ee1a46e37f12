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
    pub fn between(start: &Motion, end: &Motion, kind: SampleKind, dt: f64) -> Self {
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

    #[test]
    fn coning_is_integrated_to_fourth_order() {
        // A body whose axis describes a cone: q(t) known in closed form, sampled at 100 Hz and at 200 Hz.
        let (a, w) = (0.05_f64, 20.0_f64);
        let rate = |t: f64| {
            // Body rate of q = Rz(wt) Rx(a) Rz(−wt).
            let (s, c) = (w * t).sin_cos();
            let k = w * a.sin();
            Vector3::new(-k * s, k * c, w * (a.cos() - 1.0))
        };
        let drift = |dt: f64| {
            let n = (10.0 / dt).round() as usize;
            let mut q = UnitQuaternion::identity();
            for i in 0..n {
                let (t0, t1) = (i as f64 * dt, (i + 1) as f64 * dt);
                let at = |t| Motion { rate: rate(t), force: Vector3::zeros() };
                q *= exp(&Increment::between(&at(t0), &at(t1), SampleKind::Point, dt).dtheta);
            }
            let attitude = |t: f64| {
                UnitQuaternion::from_scaled_axis(Vector3::z() * w * t)
                    * UnitQuaternion::from_scaled_axis(Vector3::x() * a)
                    * UnitQuaternion::from_scaled_axis(Vector3::z() * -w * t)
            };
            (attitude(0.0) * q).angle_to(&attitude(n as f64 * dt))
        };
        let (coarse, fine) = (drift(0.01), drift(0.005));
        assert!(fine < coarse / 3.5, "{coarse} {fine}");
        assert!(fine < 2e-3);
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
