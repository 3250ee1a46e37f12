//! The receiver's own smoothing: no effect that anybody looks for, but one that every receiver has.
//!
//! A receiver that filters its solutions, or interpolates between them, reports z + κ z̈ + σ z⃛ of a motion z at t − L: L is the mean of its kernel (the latency), 2κ its variance
//! and 6σ its third moment about the mean. One that interpolates between epochs 2h apart weighs one of them more unless the delay happens to lead to their middle. With the mean δ later than that,
//! 2κ = h² − δ² and 6σ = −4κδ. In gusts the series ends too early: [`Kernel::instants`] has two instants of these moments. The parameters are the moments all the same: they enter
//! linearly, and an uneven kernel is found from none (with δ for a parameter there were two maxima, and a negative κ beside the opposite δ was a third; 2026-11-28). With σ = 0 for a
//! receiver that had one, a plane in gusts had its fixes .0725 ± .008 s late instead of .034, an antenna .72 m ahead and gyros that feel 1710 ± 254 deg/h/g, none of them there
//! (ArduPilot's simulator with `SIM_GPS1_LAG_MS` 60; at 100, where δ is zero, all was right). Between samples T apart a linear interpolation has κ up
//! to T²/8: at 5 Hz 5 mm per m/s², toward the centre of a turn, and a speed that falls short by centimetres per second there.
//! That imitates an antenna above the inertial unit. It is estimated beside the biases and never named.
//! The standard model has it among its tolerances, up to the interpolation of a receiver of 5 Hz.

use super::{ActsOn, Effect, FixInstant, Kernel, ParameterGroup, Shape, Unit};
use nalgebra::Vector3;

/// Of a linear interpolation between samples 0.2 s apart.
const PRIOR_S2: f64 = 0.005;
/// The most that an interpolation between samples 0.2 s apart can have: 2 h³ / 9√3.
const PRIOR_S3: f64 = 1.3e-4;
const S2: Unit = Unit { symbol: "s²", suffix: "s2", si: 1.0 };
const S3: Unit = Unit { symbol: "s³", suffix: "skew_s3", si: 1.0 };

/// Half the variance of the receiver's kernel, s², and a sixth of its third moment, s³. It stands outside the registry: it is not tested.
#[derive(Debug)]
pub struct GpsSmoothing;

/// Acceleration and its rate of change. What an antenna away from the inertial unit adds, its arm takes care of.
fn derivatives(x: &FixInstant) -> [Vector3<f64>; 2] {
    [x.a_n, x.jerk_n()]
}

/// Third derivatives of position and velocity.
fn thirds(x: &FixInstant) -> [Vector3<f64>; 2] {
    [x.jerk_n(), x.skewed_n]
}

impl Effect for GpsSmoothing {
    words! {
        name: "gps_smoothing",
        description: "the receiver rounds corners off",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        const OWN: ParameterGroup =
            ParameterGroup { unit: S2, shape: Shape::Scalar, names: &["smoothing"], prior_sigma: PRIOR_S2 };
        &[OWN, ParameterGroup { unit: S3, names: &["skew"], prior_sigma: PRIOR_S3, ..OWN }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_S2)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn needs_motion_around(&self) -> bool {
        true
    }

    fn kernel(&self, p: &[f64]) -> Kernel {
        Kernel { smoothing_s2: p[0], skew_s3: p[1] }
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let [even, uneven] = [derivatives(x), thirds(x)];
        [0, 1].map(|k| even[k] * p[0] + uneven[k] * p[1])
    }

    fn fix_jacobian(
        &self,
        _p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        let (own, arm) = (derivatives(x), x.derivatives_of(&x.antenna.arm));
        [position[0], velocity[0]] = [own[0] + arm[0], own[1] + arm[1]];
        [position[1], velocity[1]] = thirds(x);
    }
}

#[cfg(test)]
mod tests {
    use crate::math::cos;

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
            skewed_n: Vector3::zeros(),
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
        assert!((position.y - r * (1.0 - cos(half))).abs() < 1e-4, "{position}");
        assert!((velocity.x + v * (1.0 - cos(half))).abs() < 1e-3, "{velocity}");
        assert!(velocity.y.abs() < 1e-12);
        crate::effects::testing::check_jacobians(&GpsSmoothing);
    }

    /// Nine tenths of one epoch and one of the next, of a path whose third derivatives stay: at its mean what the moments say, exactly.
    #[test]
    fn a_receiver_that_weighs_one_epoch_more_reports_its_moments() {
        let (newer, h) = (0.1, 0.1);
        let middle_s = h * (1.0 - 2.0 * newer);
        let smoothing_s2 = 0.5 * (h * h - middle_s * middle_s);
        let p = [smoothing_s2, smoothing_s2 * middle_s / 1.5];
        let place = |t: f64| 3.0 * t + 2.0 * t * t - 7.0 * t.powi(3);
        let speed = |t: f64| 3.0 + 4.0 * t - 21.0 * t * t + 5.0 * t.powi(3);
        let north = |x: f64| Vector3::new(x, 0.0, 0.0);
        let both =
            |of: &dyn Fn(f64) -> f64| newer * of(middle_s + h) + (1.0 - newer) * of(middle_s - h) - of(0.0);
        let x = |a: f64, jerk: f64, snap: f64| FixInstant {
            a_n: north(a),
            force_rate: north(jerk),
            skewed_n: north(snap),
            rate_eb: Vector3::zeros(),
            c_nb: nalgebra::Matrix3::identity(),
            ..crate::effects::testing::fix_instant()
        };
        let [position, _] = GpsSmoothing.fix(&p, &x(4.0, -42.0, 0.0));
        assert!((position - north(both(&place))).norm() < 1e-12, "{position}");
        let [_, velocity] = GpsSmoothing.fix(&p, &x(0.0, -42.0, 30.0));
        assert!((velocity - north(both(&speed))).norm() < 1e-12, "{velocity}");
    }
}
