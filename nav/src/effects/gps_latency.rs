//! GNSS latency: a fix tells where the vehicle was some time before the fix's time stamp.

use super::{Effect, FixInstant, ParameterGroup, Shape, unit};
use nalgebra::Vector3;

/// Time from validity to time stamp. Identifiable only relative to the delay of the inertial samples.
#[derive(Debug)]
pub struct GpsLatency;

impl Effect for GpsLatency {
    fn name(&self) -> &'static str {
        "gps_latency"
    }

    fn description(&self) -> &'static str {
        "GNSS fixes arrive late"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        // Published flights: 50 to 300 ms.
        &[ParameterGroup { unit: unit::S, shape: Shape::Scalar, names: &["latency"], prior_sigma: 0.15 }]
    }

    fn fix_delay_s(&self, p: &[f64]) -> f64 {
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
        velocity[0] = -x.a_n;
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
        assert_eq!(GpsLatency.fix_delay_s(&[0.1]), 0.1);
        assert_eq!((dp[0], dv[0]), (-x.v_n, -x.a_n));
    }
}
