//! The receiver's own smoothing: no effect that anybody looks for, but one that every receiver has.
//!
//! A receiver that filters its solutions, or interpolates between them, reports z(t − L) + κ z̈ of a motion z, whatever the
//! symmetric kernel is: L is its mean (the latency) and 2κ its variance. Between samples T apart a linear interpolation has κ up
//! to T²/8: at 5 Hz 5 mm per m/s², toward the centre of a turn, and a speed that falls short by centimetres per second there.
//! That imitates an antenna above the inertial unit. It is estimated beside the biases and never named.
//! The standard model has it among its tolerances, up to the interpolation of a receiver of 5 Hz.

use super::{Effect, FixEffect, FixInstant, ParameterGroup, Shape, Unit};
use nalgebra::Vector3;

/// Of a linear interpolation between samples 0.2 s apart.
const PRIOR_S2: f64 = 0.005;
const S2: Unit = Unit { symbol: "s²", suffix: "s2", si: 1.0 };

/// Half the variance of the receiver's kernel, s². It stands outside the registry: it is not tested.
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
        &[ParameterGroup { unit: S2, shape: Shape::Scalar, names: &["smoothing"], prior_sigma: PRIOR_S2 }]
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

    fn smoothing_s2(&self, p: &[f64]) -> f64 {
        p[0]
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        derivatives(x).map(|d| d * p[0])
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
            c_nb: c_nb_from_euler(0.0, 0.0, 0.0),
            rate_eb: Vector3::new(0.0, 0.0, rate),
            force_rate: Vector3::zeros(),
            antenna: Antenna::default(),
            older: Older::default(),
            elapsed_s: 0.0,
            conditions: crate::effects::Conditions::default(),
        };
        let [position, velocity] = GpsSmoothing.fix(&[t * t / 8.0], &x);
        let half = 0.5 * rate * t;
        assert!((position.y - r * (1.0 - half.cos())).abs() < 1e-4, "{position}");
        assert!((velocity.x + v * (1.0 - half.cos())).abs() < 1e-3, "{velocity}");
        assert!(velocity.y.abs() < 1e-12);
        crate::effects::testing::check_jacobians(&GpsSmoothing);
    }
}
