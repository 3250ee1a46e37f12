//! A flight that is written down as a formula, for the examples: eights with changing speed and height, and ideal sensors.

#![allow(dead_code, reason = "each example uses a part of it")]

use gaware_nav::earth::{self, Geodetic};
use gaware_nav::math::{cos, sin};
use gaware_nav::mechanization::{Motion, NavState};
use gaware_nav::rotation::{log, skew};
use gaware_nav::sample::{FixVelocity, GnssFix, ImuSample, ImuStream, Sample};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// 100 samples and 5 fixes a second.
pub const DT_S: f64 = 0.01;
pub const FIX_EVERY: u32 = 20;
const H_S: f64 = 1e-3;

/// Where it is, m, in axes of the starting point.
fn place(t: f64) -> Vector3<f64> {
    // At first it stands; then it speeds up.
    let s = 0.5 * (t - 5.0).clamp(0.0, 20.0).powi(2) / 20.0 + (t - 25.0).max(0.0);
    let turn = 0.11 * s + 0.6 * sin(0.07 * s);
    Vector3::new(180.0 * sin(turn), 120.0 * sin(2.0 * turn), -60.0 * (1.0 - cos(0.09 * s)))
}

fn derivative(of: impl Fn(f64) -> Vector3<f64>, t: f64) -> Vector3<f64> {
    (of(t + H_S) - of(t - H_S)) / (2.0 * H_S)
}

/// Position, velocity, attitude; a wing that banks so that the force stands on it.
pub fn truth(t: f64) -> NavState {
    let start = Geodetic::from_degrees(47.0, 8.0, 500.0);
    let c_en = start.c_en();
    let v = derivative(place, t);
    let a = (place(t + 0.05) - 2.0 * place(t) + place(t - 0.05)) / 0.0025;
    let nose = (v + Vector3::new(1.0, 0.7, 0.0)).normalize();
    let down = (Vector3::z() * 9.8 - a).normalize();
    let right = down.cross(&nose).normalize();
    let c_nb = Matrix3::from_columns(&[nose, right, nose.cross(&right)]);
    NavState {
        r_e: start.to_ecef() + c_en * place(t),
        v_e: c_en * v,
        q_eb: UnitQuaternion::from_matrix(&(c_en * c_nb)),
    }
}

/// Angular rate and specific force there.
pub fn motion(t: f64) -> Motion {
    let now = truth(t);
    let turned = log(&(truth(t - H_S).q_eb.inverse() * truth(t + H_S).q_eb)) / (2.0 * H_S);
    let a_e = derivative(|t| truth(t).v_e, t);
    let gravity = earth::gravity(&now.r_e) - skew(&earth::rotation_rate()) * now.v_e * 2.0;
    let to_body = now.q_eb.inverse();
    Motion { rate: turned + to_body * earth::rotation_rate(), force: to_body * (a_e - gravity) }
}

/// A fix with errors of centimetres.
pub fn fix(t: f64) -> GnssFix {
    let now = truth(t);
    let error = |k: f64| 0.02 * sin(17.0 * t + k);
    GnssFix {
        t_s: t,
        position: now.geodetic(),
        velocity: FixVelocity::Full((now.v_n() + Vector3::new(error(0.0), error(2.0), error(4.0))).into()),
        position_sigma_m: Some([0.5; 3]),
        velocity_sigma_m_per_s: Some([0.05; 3]),
        yaw_rad: None,
    }
}

/// The whole flight as an autopilot would send it, with gyros that also respond to specific force by G.
pub fn samples(g: &Matrix3<f64>, seconds: u32) -> Vec<Sample> {
    let mut out = vec![Sample::Stream(ImuStream::default())];
    for k in 1..seconds * 100 {
        let t_s = f64::from(k) * DT_S;
        let Motion { rate, force } = motion(t_s);
        out.push(Sample::Imu(ImuSample {
            t_s,
            gyro: rate + g * force,
            accel: force,
            temperature_degc: None,
        }));
        if k % FIX_EVERY == 0 {
            out.push(Sample::Fix(fix(t_s)));
        }
    }
    out
}
