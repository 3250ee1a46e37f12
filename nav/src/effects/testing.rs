//! What the tests of all effects share.

use super::{Antenna, Effect, FixInstant, Instant, LateRate, MAX_PARAMETERS, Older, Surroundings};
use crate::rotation::c_nb_from_euler;
use nalgebra::Vector3;

pub fn instant(rate: [f64; 3], force: [f64; 3]) -> Instant {
    let rate = Vector3::from(rate);
    let around = Surroundings {
        rate_derivatives: [Vector3::new(0.5, -0.3, 0.8) + rate * 2.0, Vector3::new(-3.0, 1.0, 2.0)],
        late: LateRate::default(),
        vibration: Vector3::new(2.0, 9.0, 30.0),
    };
    Instant {
        t_s: 12.0,
        rate,
        force: force.into(),
        temperature_above_25_degc: 7.0,
        around,
        ..Instant::default()
    }
}

pub fn fix_instant() -> FixInstant {
    FixInstant {
        t_s: 12.0,
        v_n: Vector3::new(20.0, -5.0, 1.0),
        a_n: Vector3::new(1.0, 3.0, -0.5),
        smoothed_a_n: Vector3::new(0.8, 2.5, -0.4),
        skewed_n: Vector3::new(-40.0, 90.0, 300.0),
        c_nb: c_nb_from_euler(0.4, -0.2, 1.0),
        rate_eb: Vector3::new(0.1, 0.2, -0.4),
        force_rate: Vector3::new(2.0, -1.0, 5.0),
        antenna: Antenna::default(),
        older: Older { acceleration: Vector3::new(0.8, 2.5, -0.4), ..Older::default() },
        elapsed_s: 100.0,
        conditions: crate::effects::Conditions::default(),
    }
}

/// Every Jacobian of an effect against central differences, at three instants and parameters of prior size.
///
/// A parameter that is no linear state stands at 5 of its units (an instant before those tested) and its columns
/// must stay zero.
pub fn check_jacobians(effect: &dyn Effect) {
    let n = effect.len();
    let priors: Vec<f64> =
        effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.prior_sigma, g.shape.len())).collect();
    let units = effect.groups().iter().flat_map(|g| std::iter::repeat_n(g.unit.si, g.shape.len()));
    let value = |i: usize, s: f64, unit: f64| if s > 0.0 { s * (0.7 - 0.3 * i as f64) } else { 5.0 * unit };
    let p: Vec<f64> = priors.iter().zip(units).enumerate().map(|(i, (s, u))| value(i, *s, u)).collect();
    let shifted = |k: usize, by: f64| -> Vec<f64> {
        let mut q = p.clone();
        q[k] += by;
        q
    };
    let close = |numeric: Vector3<f64>, exact: &Vector3<f64>| {
        assert!(
            (numeric - exact).norm() <= 1e-6 * (1.0 + exact.norm()),
            "{}: {numeric} {exact}",
            effect.name()
        );
    };
    for x in [
        instant([0.3, -0.2, 0.5], [1.0, 2.0, -15.0]),
        instant([0.0, 0.1, 0.0], [0.2, -0.4, -9.8]),
        instant([-2.0, 1.0, 0.7], [-20.0, 5.0, 3.0]),
    ] {
        if effect.is_linear() {
            let bare = Instant { rate: x.rate, force: x.force, ..Instant::default() };
            let half = Instant { rate: 0.5 * x.rate, force: 0.5 * x.force, ..x };
            let (rate, force) =
                (Instant { force: Vector3::zeros(), ..bare }, Instant { rate: Vector3::zeros(), ..bare });
            for of in [<dyn Effect>::gyro, <dyn Effect>::accel] {
                close(2.0 * of(effect, &p, &half), &of(effect, &p, &x));
                close(of(effect, &p, &rate) + of(effect, &p, &force), &of(effect, &p, &x));
            }
        }
        let mut gyro = [Vector3::zeros(); MAX_PARAMETERS];
        let mut accel = [Vector3::zeros(); MAX_PARAMETERS];
        effect.imu_jacobian(&p, &x, &mut gyro[..n], &mut accel[..n]);
        for k in 0..n {
            if priors[k] == 0.0 {
                assert_eq!((gyro[k], accel[k]), (Vector3::zeros(), Vector3::zeros()), "{}", effect.name());
                continue;
            }
            let h = priors[k] * 1e-2;
            let (plus, minus) = (shifted(k, h), shifted(k, -h));
            close((effect.gyro(&plus, &x) - effect.gyro(&minus, &x)) / (2.0 * h), &gyro[k]);
            close((effect.accel(&plus, &x) - effect.accel(&minus, &x)) / (2.0 * h), &accel[k]);
        }
        if let Some(by_rate) = effect.accel_by_rate(&p, &x) {
            for k in 0..3 {
                let mut step = Vector3::zeros();
                step[k] = 1e-3;
                let (plus, minus) =
                    (Instant { rate: x.rate + step, ..x }, Instant { rate: x.rate - step, ..x });
                let numeric = (effect.accel(&p, &plus) - effect.accel(&p, &minus)) / 2e-3;
                close(numeric, &by_rate.column(k).into());
            }
        }
        if let Some(by_force) = effect.gyro_by_force(&p, &x) {
            for k in 0..3 {
                let mut step = Vector3::zeros();
                step[k] = 1e-3;
                let (plus, minus) =
                    (Instant { force: x.force + step, ..x }, Instant { force: x.force - step, ..x });
                let numeric = (effect.gyro(&p, &plus) - effect.gyro(&p, &minus)) / 2e-3;
                close(numeric, &by_force.column(k).into());
            }
        }
    }
    if effect.fix_delay_s(&p, 100.0) == 0.0 {
        let x = fix_instant();
        let (mut dp, mut dv) = ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
        effect.fix_jacobian(&p, &x, &mut dp[..n], &mut dv[..n]);
        for k in 0..n {
            if priors[k] == 0.0 {
                assert_eq!((dp[k], dv[k]), (Vector3::zeros(), Vector3::zeros()), "{}", effect.name());
                continue;
            }
            let h = priors[k] * 1e-2;
            let ([p1, v1], [p0, v0]) = (effect.fix(&shifted(k, h), &x), effect.fix(&shifted(k, -h), &x));
            close((p1 - p0) / (2.0 * h), &dp[k]);
            close((v1 - v0) / (2.0 * h), &dv[k]);
        }
    }
}
