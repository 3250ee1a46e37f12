//! GNSS latency: a fix reports where the vehicle was some time before the fix's time stamp.

use super::{ActsOn, DrawRange, Effect, Excitation, FixInstant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// Time from validity to time stamp. Identifiable only relative to the delay of the inertial samples.
#[derive(Debug)]
pub struct GpsLatency;

impl Effect for GpsLatency {
    words! {
        name: "gps_latency",
        description: "GNSS fixes arrive late",
        cause: "the receiver computes and sends a solution some time after it measured, and the autopilot stamps it when it arrives",
        remedy: "set the autopilot's GNSS delay parameter (ArduPilot GPS1_DELAY_MS, PX4 SENS_GPS0_DELAY; before 4.6 and 1.18 GPS_DELAY_MS, EKF2_GPS_DELAY): the value to set counts from the autopilot's own time stamps and stands among its parameters",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        // Published flights: 50 to 300 ms.
        &[ParameterGroup { unit: unit::S, shape: Shape::Scalar, names: &["latency"], prior_sigma: 0.15 }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "gps_lever_arm",
            fly: &[Excitation::VaryingSpeed, Excitation::FigureEight],
            why: "a delay grows with the speed, an arm does not",
        }]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::LogUniform(0.04, 0.3)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn fix_delay_s(&self, p: &[f64], _elapsed_s: f64) -> f64 {
        p[0]
    }

    fn fix_jacobian(
        &self,
        _p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        position[0] = -x.v_n;
        velocity[0] = -x.smoothed_a_n;
    }

    fn values_to_try(&self) -> &'static [f64] {
        &[0.05, 0.1, 0.2]
    }

    fn delays_fixes(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::fix_instant;

    #[test]
    fn a_later_fix_lies_behind() {
        let x = fix_instant();
        let (mut dp, mut dv) = ([Vector3::zeros()], [Vector3::zeros()]);
        GpsLatency.fix_jacobian(&[0.1], &x, &mut dp, &mut dv);
        assert_eq!(GpsLatency.fix_delay_s(&[0.1], 60.0), 0.1);
        assert_eq!((dp[0], dv[0]), (-x.v_n, -x.smoothed_a_n));
    }
}
