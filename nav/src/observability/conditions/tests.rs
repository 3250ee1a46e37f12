//! Flights and benches, simulated sample by sample.

use super::*;
use crate::math::{cos, exp, sin};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

/// 0.01 deg/s/√Hz.
const GYRO_NOISE: f64 = 1.745e-4;
const REST: [f64; 3] = [0.0, 0.0, -9.8];
/// 1-sigma of a coefficient of G before the flight: what a consumer data sheet allows.
const PRIOR_SIGMA: f64 = 360.0 * unit::DEG_PER_H_PER_G.si;

/// What the segments and the prior, but no turn and no fix, determine about any row of G: 1-sigma of its coefficients
/// of forward, right and down, rad/s per m/s². σ = N √((S + N²/σ₀² I)⁻¹)_kk; σ₀ where nothing has changed.
fn predicted_sigma(conditions: &PathConditions) -> [f64; 3] {
    let prior = Matrix3::from_diagonal_element((GYRO_NOISE / PRIOR_SIGMA).powi(2));
    let Some(inverse) = (conditions.gram() + prior).try_inverse() else { return [PRIOR_SIGMA; 3] };
    [0, 1, 2].map(|k| GYRO_NOISE * inverse[(k, k)].max(0.0).sqrt())
}

struct Vehicle {
    rng: Xoshiro256PlusPlus,
    rate_hz: f64,
    /// RMS of broadband vibration per axis, m/s².
    vibration: f64,
    /// Low-pass that the autopilot put on it, Hz; none when infinite.
    low_pass_hz: f64,
    shaken: Vector3<f64>,
    /// Bias that the filter has not found, and what it assumes of it, rad/s.
    leftover: f64,
    t_s: f64,
    conditions: PathConditions,
    /// When (a), (b), (c) were met, s.
    met_s: [Option<f64>; 3],
}

impl Vehicle {
    fn new(seed: u64, rate_hz: f64, vibration: f64) -> Self {
        Self {
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            rate_hz,
            vibration,
            low_pass_hz: f64::INFINITY,
            shaken: Vector3::zeros(),
            leftover: 0.0,
            t_s: 0.0,
            conditions: PathConditions::new(ConditionSettings::new(GYRO_NOISE)),
            met_s: [None; 3],
        }
    }

    fn noise(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let n: f64 = StandardNormal.sample(&mut self.rng);
            sigma * n
        })
    }

    /// Flies for some seconds; rate and force are functions of the time since the call.
    fn fly(&mut self, seconds: f64, rate: impl Fn(f64) -> [f64; 3], force: impl Fn(f64) -> [f64; 3]) {
        let dt_s = 1.0 / self.rate_hz;
        for k in 0..(seconds * self.rate_hz).round() as u32 {
            let t = f64::from(k) * dt_s;
            self.t_s += dt_s;
            let gyro = self.noise(GYRO_NOISE * self.rate_hz.sqrt()).add_scalar(self.leftover);
            // First order; the white input is scaled so that the output has the RMS asked for.
            let keep = exp(-std::f64::consts::TAU * self.low_pass_hz * dt_s);
            self.shaken = self.shaken * keep + self.noise(self.vibration * (1.0 - keep * keep).sqrt());
            let shaken = self.shaken;
            self.conditions.push(&SegmentSample {
                t_s: self.t_s,
                dt_s,
                rate: Vector3::from(rate(t)) + gyro,
                rate_sigma: self.leftover.abs() + 1e-5,
                force: Vector3::from(force(t)) + shaken,
            });
            let status = self.conditions.status();
            for (slot, met) in self.met_s.iter_mut().zip([status.a.met, status.b.met, status.c.met]) {
                if met && slot.is_none() {
                    *slot = Some(self.t_s);
                }
            }
        }
    }
}

fn still(_: f64) -> [f64; 3] {
    [0.0; 3]
}

#[test]
fn a_vibrating_bench_shows_nothing_for_ten_minutes() {
    for (seed, (rate_hz, leftover)) in
        [(50.0, 0.0), (50.0, 8e-3), (200.0, 0.0), (2.0, 0.0), (2.0, 1e-3), (10.0, 0.0)]
            .into_iter()
            .cycle()
            .take(60)
            .enumerate()
    {
        for vibration in [0.0, 0.05, 3.0] {
            let mut bench = Vehicle::new(seed as u64, rate_hz, vibration);
            bench.leftover = leftover;
            bench.fly(600.0, still, |_| REST);
            let conditions = &bench.conditions;
            assert_eq!(bench.met_s, [None; 3]);
            assert_eq!(conditions.gram(), Matrix3::zeros(), "{seed} {rate_hz} Hz {vibration} m/s²");
            assert_eq!(conditions.status().c.progress, 0.0);
            assert!(predicted_sigma(conditions).iter().all(|s| (s / PRIOR_SIGMA - 1.0).abs() < 1e-9));
        }
    }
}

#[test]
fn vibration_behind_the_autopilots_low_pass_shows_nothing() {
    for seed in 0..10 {
        let mut bench = Vehicle::new(seed, 200.0, 3.0);
        bench.low_pass_hz = 20.0;
        bench.fly(600.0, still, |_| REST);
        assert_eq!(bench.conditions.gram(), Matrix3::zeros(), "{seed}");
    }
}

#[test]
fn a_vibration_line_that_aliases_above_half_a_hertz_shows_nothing() {
    for line_hz in [0.6, 1.0, 1.7, 7.3] {
        let mut bench = Vehicle::new(1, 50.0, 0.1);
        bench.fly(600.0, still, |t| [0.0, 4.2 * sin(std::f64::consts::TAU * line_hz * t), -9.8]);
        assert_eq!(bench.conditions.gram(), Matrix3::zeros(), "{line_hz} Hz");
    }
}

#[test]
fn vibration_that_comes_and_goes_shows_nothing() {
    for seed in 0..10 {
        let mut bench = Vehicle::new(seed, 50.0, 0.0);
        for k in 0..20 {
            bench.vibration = [0.02, 3.0, 0.5, 5.0][k % 4];
            bench.fly(30.0, still, |_| REST);
        }
        assert_eq!(bench.conditions.gram(), Matrix3::zeros(), "{seed}");
    }
}

#[test]
fn a_straight_run_with_thrust_changes_shows_one_direction() {
    for seed in 0..10 {
        let mut plane = Vehicle::new(seed, 50.0, 0.3);
        for _ in 0..3 {
            plane.fly(40.0, still, |t| [1.0 + 4.0 * sin(0.5 * t), 0.0, -9.8]);
            plane.fly(4.0, |_| [0.0, 0.0, 0.4], |_| [0.0, 0.0, -9.8]);
        }
        let conditions = &plane.conditions;
        assert_eq!(plane.met_s, [None; 3]);
        let values = conditions.gram().symmetric_eigen().eigenvalues;
        let needed = ConditionSettings::new(GYRO_NOISE).needed();
        assert_eq!(values.iter().filter(|v| **v > 0.01 * needed).count(), 1, "{values}");
        let [forward, right, down] = predicted_sigma(conditions);
        assert!(
            forward < 40.0 * unit::DEG_PER_H_PER_G.si && right.min(down) > 300.0 * unit::DEG_PER_H_PER_G.si
        );
        let status = conditions.status();
        assert!(status.a.missing.contains("forward only"), "{}", status.a.missing);
        assert!(status.b.missing.ends_with(": right, down"), "{}", status.b.missing);
        assert!(status.c.missing.ends_with(": right, down"), "{}", status.c.missing);
        assert!((status.c.progress - 1.0 / 3.0).abs() < 0.01);
    }
}

#[test]
fn a_gentle_turn_shows_nothing() {
    for seed in 0..10 {
        let mut plane = Vehicle::new(seed, 50.0, 0.5);
        plane.fly(20.0, still, |_| REST);
        // 3 deg/s coordinated at 20 m/s: 6° of bank within 3 s.
        let (turn, bank) = (0.0524_f64, 0.1065_f64);
        let rolled = move |t: f64| bank * (t / 3.0).min(1.0);
        let rate = move |t: f64| {
            let phi = rolled(t);
            [if t < 3.0 { bank / 3.0 } else { 0.0 }, turn * sin(phi), turn * cos(phi)]
        };
        plane.fly(120.0, rate, move |t| [0.0, 0.0, -9.8 / cos(rolled(t))]);
        plane.fly(20.0, still, |_| REST);
        assert_eq!(plane.met_s, [None; 3]);
        assert_eq!(plane.conditions.gram(), Matrix3::zeros());
    }
}

#[test]
fn the_papers_flight_meets_a_then_b_then_c() {
    for seed in 0..10 {
        let mut plane = Vehicle::new(seed, 100.0, 0.3);
        plane.fly(10.0, still, |_| REST);
        assert_eq!(plane.conditions.status().c.progress, 0.0);
        plane.fly(25.0, still, |t| [5.0 + 5.0 * sin(0.4 * t), 0.0, -9.8]);
        assert_eq!(plane.met_s, [None; 3]);
        plane.fly(10.0, |_| [0.0, 0.0, 0.157], |_| [0.0, 12.0, -9.8]);
        // Forward in its own time, right and down together; then down alone.
        plane.fly(10.0, still, |t| {
            let together = 5.0 * sin(1.1 * t);
            [8.0 * cos(1.3 * t), together, -9.8 + together]
        });
        plane.fly(15.0, still, |t| [0.0, 0.0, -9.8 + 6.0 * sin(0.9 * t)]);
        let [Some(a), Some(b), Some(c)] = plane.met_s else { panic!("{seed}: {:?}", plane.met_s) };
        assert!(45.0 < a && a < b && b < c, "{seed}: {a} {b} {c}");
        let status = plane.conditions.status();
        assert!(status.c.missing.is_empty() && status.c.progress == 1.0, "{status:?}");
        assert!(plane.conditions.excited_segments() >= 2);
        assert!(predicted_sigma(&plane.conditions).iter().all(|s| *s <= 40.0 * unit::DEG_PER_H_PER_G.si));
    }
}

#[test]
fn the_force_at_the_beginning_of_a_turn_counts() {
    let mut plane = Vehicle::new(3, 100.0, 0.1);
    plane.fly(25.0, still, |t| [5.0 + 5.0 * sin(0.4 * t), 0.0, -9.8]);
    assert_eq!(plane.met_s[0], None);
    // The paper's turn: 80 g to the right from one moment to the next, 9 deg/s.
    plane.fly(10.0, |_| [0.0, 0.0, 0.157], |_| [0.0, 780.0, -9.8]);
    assert!(plane.met_s[0].is_some_and(|t| t < 25.6), "{:?}", plane.met_s);
    assert_eq!(plane.met_s[2], None);
}

#[test]
fn one_segment_is_not_enough_for_b_and_c() {
    let excite = |t: f64| [5.0 * cos(0.7 * t), 5.0 * sin(1.1 * t), -9.8 + 5.0 * sin(0.9 * t)];
    let mut plane = Vehicle::new(1, 50.0, 0.3);
    plane.fly(40.0, still, excite);
    let status = plane.conditions.status();
    assert!(status.a.met && !status.b.met && !status.c.met);
    assert!(status.c.missing.contains("second segment"), "{}", status.c.missing);
    plane.fly(2.0, |_| [0.0, 0.0, 0.4], |_| REST);
    plane.fly(10.0, still, excite);
    assert!(plane.conditions.status().b.met && plane.conditions.status().c.met);
}

#[test]
fn equal_samples_give_equal_results() {
    let run = || {
        let mut plane = Vehicle::new(9, 50.0, 1.0);
        plane.fly(30.0, still, |t| [5.0 * sin(t), 0.0, -9.8]);
        (plane.conditions.gram(), plane.conditions.status().clone())
    };
    assert_eq!(run(), run());
}

/// Fits a row of G to simulated rates on one segment; its scatter over many runs is what was predicted.
#[test]
fn predicted_sigma_is_the_scatter_of_a_fit() {
    let (dt, n, runs) = (0.02, 2000_u32, 300);
    let force = |t: f64| Vector3::new(3.0 * cos(0.7 * t), 2.0 * sin(1.1 * t), -9.8 + sin(0.3 * t));
    let mut conditions = PathConditions::new(ConditionSettings::new(GYRO_NOISE));
    let mut scatter = crate::observability::segments::Scatter::default();
    for k in 0..n {
        let t_s = f64::from(k) * dt;
        scatter.add(&force(t_s), dt);
        conditions.push(&SegmentSample {
            t_s,
            dt_s: dt,
            rate: Vector3::zeros(),
            rate_sigma: 1e-5,
            force: force(t_s),
        });
    }
    let Some(inverse) = scatter.gram.try_inverse() else { panic!("three directions were flown") };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut squares = Vector3::zeros();
    for _ in 0..runs {
        let mut right = Vector3::zeros();
        for k in 0..n {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let rate = 1e-3 + GYRO_NOISE / f64::sqrt(dt) * noise;
            right += (force(f64::from(k) * dt) - scatter.mean) * (rate * dt);
        }
        let fitted: Vector3<f64> = inverse * right;
        squares += fitted.component_mul(&fitted);
    }
    for (axis, predicted) in predicted_sigma(&conditions).into_iter().enumerate() {
        let measured = (squares[axis] / f64::from(runs)).sqrt();
        assert!((measured / predicted - 1.0).abs() < 0.15, "{axis}: {measured:e} {predicted:e}");
    }
}
