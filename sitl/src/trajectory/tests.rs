//! Every flight is checked by navigating along it: its own sensors, integrated, must lead back to it.

use super::bench::Bench;
use super::fixed_wing::FixedWing;
use super::multirotor::Multirotor;
use super::paper::Paper;
use super::*;
use crate::truth::gravity_n;
use gaware_nav::earth::{ROTATION_RATE, STANDARD_GRAVITY, gravity, rotation_rate};
use gaware_nav::math::{cos, tan};
use gaware_nav::rotation::{euler_from_c_nb, exp, log};
use nalgebra::UnitQuaternion;

/// An inertial navigation in ECEF with a two-stage Magnus step for attitude and Runge-Kutta for the rest; shares no
/// code with the trajectories.
struct Strapdown {
    r: Vector3<f64>,
    v: Vector3<f64>,
    q: UnitQuaternion<f64>,
}

impl Strapdown {
    fn at(truth: &Truth) -> Self {
        let c_en = truth.place.c_en();
        let c = nalgebra::Rotation3::from_matrix_unchecked(c_en * truth.c_nb);
        Self { r: truth.place.to_ecef(), v: c_en * truth.v_n, q: UnitQuaternion::from_rotation_matrix(&c) }
    }

    fn step(&mut self, a: &Truth, m: &Truth, b: &Truth, dt: f64) {
        // Fourth-order Magnus expansion from Simpson's rule: ∫ω dt + ∫∫[ω, ω].
        let mean = (a.rate_ib + m.rate_ib * 4.0 + b.rate_ib) / 6.0;
        let coning = a.rate_ib.cross(&b.rate_ib) * (dt * dt / 12.0);
        let earth = |t: f64| exp(&(-rotation_rate() * t));
        let q0 = self.q;
        let q1 = earth(dt) * q0 * exp(&(mean * dt + coning));
        let half = (a.rate_ib * 5.0 + m.rate_ib * 8.0 - b.rate_ib) / 24.0;
        let qm = earth(0.5 * dt) * q0 * exp(&(half * dt));
        let acceleration = |q: &UnitQuaternion<f64>, f: &Vector3<f64>, r: &Vector3<f64>, v: &Vector3<f64>| {
            q * f + gravity(r) - rotation_rate().cross(v) * 2.0
        };
        let (r, v) = (self.r, self.v);
        let k1 = acceleration(&q0, &a.force, &r, &v);
        let k2 = acceleration(&qm, &m.force, &(r + v * (0.5 * dt)), &(v + k1 * (0.5 * dt)));
        let k3 =
            acceleration(&qm, &m.force, &(r + (v + k1 * (0.5 * dt)) * (0.5 * dt)), &(v + k2 * (0.5 * dt)));
        let k4 = acceleration(&q1, &b.force, &(r + (v + k2 * (0.5 * dt)) * dt), &(v + k3 * dt));
        self.r += v * dt + (k1 + k2 + k3) * (dt * dt / 6.0);
        self.v += (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0);
        self.q = q1;
    }
}

/// Largest position (m), velocity (m/s) and attitude (rad) differences at the end of the flight.
fn drift(mut flight: Flown, dt: f64) -> (f64, f64, f64) {
    let steps = (flight.duration_s() / dt).round() as usize;
    let mut last = flight.truth_at(0.0);
    let mut ins = Strapdown::at(&last);
    for k in 0..steps {
        let middle = flight.truth_at((k as f64 + 0.5) * dt);
        let next = flight.truth_at((k as f64 + 1.0) * dt);
        ins.step(&last, &middle, &next, dt);
        last = next;
    }
    let end = Strapdown::at(&last);
    ((ins.r - end.r).norm(), (ins.v - end.v).norm(), log(&(ins.q.inverse() * end.q)).norm())
}

/// Gravity differs by up to 1 µm/s² between the two formulas; over a flight of 300 s, a centimetre or so.
fn assert_comes_back(name: &str, flight: Flown) {
    let (position, velocity, attitude) = drift(flight, 2e-3);
    assert!(position < 0.1, "{name}: {position} m");
    assert!(velocity < 1e-3, "{name}: {velocity} m/s");
    assert!(attitude < 1e-8, "{name}: {attitude} rad");
}

#[test]
fn the_papers_flight_can_be_navigated() {
    assert_comes_back("paper", Flown::new(Paper::new()));
}

#[test]
fn fixed_wing_flights_can_be_navigated() {
    assert_comes_back("fixed wing", Flown::new(FixedWing::new(true)));
    assert_comes_back("gusts", Flown::new(FixedWing::new(false).with_gusts(30.0, 0.7, 0.3)));
}

#[test]
fn the_multirotor_flight_can_be_navigated() {
    assert_comes_back("multirotor", Flown::new(Multirotor::new()));
}

#[test]
fn the_bench_stands() {
    let mut bench = Flown::new(Bench::new(10.0));
    let (start, end) = (bench.truth_at(0.0), bench.truth_at(10.0));
    assert_eq!(start.place, end.place);
    assert!((start.force.norm() - gravity_n(&start.place).norm()).abs() < 1e-12);
    assert!((start.rate_ib.norm() - ROTATION_RATE).abs() < 1e-15);
}

#[test]
fn a_steady_turn_is_a_circle_of_the_right_size() {
    let (speed, bank) = (22.0, 45f64.to_radians());
    let mut turn = Flown::new(FixedWing::steady_turn(speed, bank, 30.0));
    let start = turn.truth_at(0.0);
    let circle_s = std::f64::consts::TAU * speed / (STANDARD_GRAVITY * tan(bank));
    let around = turn.truth_at(circle_s);
    let opposite = turn.truth_at(0.5 * circle_s);
    let distance = |t: &Truth| (t.place.to_ecef() - start.place.to_ecef()).norm();
    // The place does not close exactly: the axes turn with the meridian by some nanoradians.
    assert!(distance(&around) < 0.01, "{}", distance(&around));
    let diameter = 2.0 * speed * speed / (STANDARD_GRAVITY * tan(bank));
    assert!((distance(&opposite) - diameter).abs() < 0.01);
    // Load factor 1/cos φ, nothing to the side (Earth rotation and local gravity aside).
    assert!((start.force.norm() - STANDARD_GRAVITY / cos(bank)).abs() < 0.02, "{}", start.force);
    assert!(start.force.y.abs() < 0.02, "{}", start.force);
}

#[test]
fn the_papers_flight_has_the_papers_accelerations() {
    let mut flight = Flown::new(Paper::new());
    let mut peak_right_g = 0.0f64;
    for k in 0..700 {
        let truth = flight.truth_at(0.1 * k as f64);
        let g = truth.force / STANDARD_GRAVITY;
        if truth.t_s <= 10.0 {
            assert_eq!(truth.v_n, Vector3::zeros());
        } else if truth.t_s < 35.0 {
            assert!(g.y.abs() < 0.1 && truth.rate_eb.norm() < 1e-3);
        } else if truth.t_s < 45.0 {
            peak_right_g = peak_right_g.max(g.y);
            assert!(euler_from_c_nb(&truth.c_nb).x.abs() < 0.1);
        }
    }
    assert!((peak_right_g - 80.0).abs() < 3.0, "{peak_right_g}");
    // Three independent changes of specific force while the attitude stands still.
    let samples: Vec<Vector3<f64>> = (0..50).map(|k| flight.truth_at(45.5 + 0.1 * k as f64).force).collect();
    let mean = samples.iter().sum::<Vector3<f64>>() / 50.0;
    let gram: Matrix3<f64> =
        samples.iter().map(|f| (f - mean) * (f - mean).transpose()).sum::<Matrix3<f64>>() / 50.0;
    assert!(gram.symmetric_eigenvalues().min().sqrt() > STANDARD_GRAVITY, "{gram}");
    assert!((0..50).all(|k| flight.truth_at(45.5 + 0.1 * k as f64).rate_eb.norm() < 2e-3));
    assert!(flight.truth_at(70.0).place.height_m > flight.truth_at(55.0).place.height_m + 1000.0);
}

#[test]
fn coordinated_flight_keeps_the_ball_centred_and_slips_do_not() {
    let side = |sideslip| {
        let mut flight = Flown::new(FixedWing::new(sideslip));
        (0..3000).map(|k| flight.truth_at(0.1 * k as f64).force.y.abs()).fold(0.0, f64::max)
    };
    assert!(side(false) < 0.03, "{}", side(false));
    assert!(side(true) > 2.0, "{}", side(true));
}

#[test]
fn the_fixed_wing_stays_an_aircraft() {
    let mut flight = Flown::new(FixedWing::new(true));
    for k in 270..3000 {
        let truth = flight.truth_at(0.1 * k as f64);
        let speed = truth.v_n.norm();
        let load = truth.force.norm() / STANDARD_GRAVITY;
        assert!((14.0..31.0).contains(&speed), "{} s: {speed} m/s", truth.t_s);
        assert!((0.05..3.0).contains(&load), "{} s: {load} g", truth.t_s);
        assert!(truth.place.height_m > 489.0, "{} s: {} m", truth.t_s, truth.place.height_m);
    }
}
