//! The receiver's own smoothing: no effect that anybody looks for, but one that every receiver has.
//!
//! A receiver that filters its solutions, or interpolates between them, reports z(t − L) + κ z̈ of a motion z, whatever the
//! symmetric kernel is: L is its mean (the latency) and 2κ its variance. One that interpolates between epochs 2h apart weighs one of them more unless the delay happens to
//! lead to their middle: it reports z(m) + κ z̈(m) + δ (z(m + h) − z(m − h)) / 2h, with the middle m = t − L − δ. With δ = 0 for a receiver that did not, a plane in gusts had
//! its fixes .0725 ± .008 s late instead of .034, an antenna .72 m ahead and gyros that feel 1710 ± 254 deg/h/g, none of them there (ArduPilot's simulator with `SIM_GPS1_LAG_MS` 60; at
//! 100, where δ is zero, all was right; 2026-11-27). Between samples T apart a linear interpolation has κ up
//! to T²/8: at 5 Hz 5 mm per m/s², toward the centre of a turn, and a speed that falls short by centimetres per second there.
//! That imitates an antenna above the inertial unit. It is estimated beside the biases and never named.
//! The standard model has it among its tolerances, up to the interpolation of a receiver of 5 Hz.

use super::{Effect, FixEffect, FixInstant, Kernel, ParameterGroup, Shape, Unit};
use nalgebra::Vector3;

/// Of a linear interpolation between samples 0.2 s apart.
const PRIOR_S2: f64 = 0.005;
/// A skew of so much would put the mean at the end of the span, s².
const SPAN_S2: f64 = Kernel::SPAN_S * Kernel::SPAN_S;
const S2: Unit = Unit { symbol: "s²", suffix: "s2", si: 1.0 };
const SKEW_S2: Unit = Unit { suffix: "skew_s2", ..S2 };

/// Half the variance of the receiver's kernel and its skew, s². It stands outside the registry: it is not tested.
#[derive(Debug)]
pub struct GpsSmoothing;

/// Acceleration and its rate of change. What an antenna away from the inertial unit adds, its arm takes care of.
fn derivatives(x: &FixInstant) -> [Vector3<f64>; 2] {
    [x.a_n, x.jerk_n()]
}

impl Effect for GpsSmoothing {
    fn name(&self) -> &'static str {
        "gps_smoothing"
    }

    fn description(&self) -> &'static str {
        "the receiver rounds corners off"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        const OWN: ParameterGroup =
            ParameterGroup { unit: S2, shape: Shape::Scalar, names: &["smoothing"], prior_sigma: PRIOR_S2 };
        &[OWN, ParameterGroup { unit: SKEW_S2, names: &["skew"], ..OWN }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_S2)
    }

    fn on_fixes(&self) -> Option<&dyn FixEffect> {
        Some(self)
    }
}

impl FixEffect for GpsSmoothing {
    fn needs_motion_around(&self) -> bool {
        true
    }

    fn fix_delay_s(&self, p: &[f64], _elapsed_s: f64) -> f64 {
        self.kernel(p).ahead_s
    }

    fn kernel(&self, p: &[f64]) -> Kernel {
        // No instant weighs less than nothing: beyond the span nothing is gained.
        Kernel { smoothing_s2: p[0], ahead_s: Kernel::SPAN_S * (p[1] / SPAN_S2).tanh() }
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let ahead_s = self.kernel(p).ahead_s;
        let [position, velocity] = derivatives(x).map(|d| d * p[0]);
        [position + x.v_n * ahead_s, velocity + x.spanned_a_n() * ahead_s]
    }

    fn fix_jacobian(
        &self,
        p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        let (own, arm) = (derivatives(x), x.derivatives_of(&x.antenna.arm));
        [position[0], velocity[0]] = [own[0] + arm[0], own[1] + arm[1]];
        // The middle is as much earlier as the mean is later.
        let by_skew = (1.0 - (p[1] / SPAN_S2).tanh().powi(2)) / Kernel::SPAN_S;
        velocity[1] = (x.spanned_a_n() - x.smoothed_a_n) * by_skew;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Antenna, Older};
    use crate::rotation::c_nb_from_euler;

    /// The middle of a chord of a level turn: nearer to the centre by v²/r T²/8, and slower in the same proportion.
    #[test]
    fn a_turn_is_cut_short() {
        let (v, r, t) = (25.0, 60.0, 0.2);
        let rate = v / r;
        let x = FixInstant {
            t_s: 0.0,
            v_n: Vector3::new(v, 0.0, 0.0),
            a_n: Vector3::new(0.0, v * rate, 0.0),
            smoothed_a_n: Vector3::new(0.0, v * rate, 0.0),
            uneven_n: Vector3::zeros(),
            c_nb: c_nb_from_euler(0.0, 0.0, 0.0),
            rate_eb: Vector3::new(0.0, 0.0, rate),
            force_rate: Vector3::zeros(),
            antenna: Antenna::default(),
            older: Older::default(),
            elapsed_s: 0.0,
            conditions: crate::effects::Conditions::default(),
        };
        let [position, velocity] = GpsSmoothing.fix(&[t * t / 8.0, 0.0], &x);
        let half = 0.5 * rate * t;
        assert!((position.y - r * (1.0 - half.cos())).abs() < 1e-4, "{position}");
        assert!((velocity.x + v * (1.0 - half.cos())).abs() < 1e-3, "{velocity}");
        assert!(velocity.y.abs() < 1e-12);
        crate::effects::testing::check_jacobians(&GpsSmoothing);
    }

    /// A receiver that weighs one epoch more reports it at the same mean delay: by its skew the velocity changes as finite differences say, the delay of the middle
    /// included.
    #[test]
    fn a_skew_moves_the_middle_and_leaves_the_mean() {
        let (w, h) = (11.0f64, Kernel::SPAN_S);
        let north = |v: f64| Vector3::new(v, 0.0, 0.0);
        let at = |t: f64, kernel: Kernel| {
            let (sin, cos) = (w * t).sin_cos();
            let mean = cos * (w * h).sin() / (w * h);
            let mean_rate = -w * sin * (w * h).sin() / (w * h);
            FixInstant {
                v_n: north(sin / w),
                a_n: north(cos),
                smoothed_a_n: north(cos - kernel.smoothing_s2 * w * w * cos + kernel.ahead_s * mean_rate),
                uneven_n: north((mean - cos) / h),
                rate_eb: Vector3::zeros(),
                c_nb: nalgebra::Matrix3::identity(),
                force_rate: north(-w * sin),
                ..crate::effects::testing::fix_instant()
            }
        };
        let told = |p: &[f64]| {
            let x = at(0.4 - GpsSmoothing.fix_delay_s(p, 0.0), GpsSmoothing.kernel(p));
            (x.v_n + GpsSmoothing.fix(p, &x)[1], x)
        };
        for p in [[0.0, 0.0], [0.004, 0.003], [0.005, -0.009]] {
            let step = 1e-6;
            let numeric = (told(&[p[0], p[1] + step]).0 - told(&[p[0], p[1] - step]).0) / (2.0 * step);
            let [mut position, mut velocity] = [[Vector3::zeros(); 2]; 2];
            GpsSmoothing.fix_jacobian(&p, &told(&p).1, &mut position, &mut velocity);
            assert!((numeric - velocity[1]).norm() < 1e-5 * velocity[1].norm(), "{numeric} {}", velocity[1]);
            assert_eq!(position[1], Vector3::zeros());
        }
    }
}
