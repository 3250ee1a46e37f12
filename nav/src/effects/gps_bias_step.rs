//! A jump of the fixes' position: from some instant on they lie beside the truth, as after a change of satellites,
//! of correction source or of the receiver's solution.

use super::{ActsOn, DrawRange, Effect, Event, FixInstant, ParameterGroup, Shape, unit};
use nalgebra::Vector3;

/// When, and how far north, east and down. The instant is searched for, the size is a state.
#[derive(Debug)]
pub struct GpsBiasStep;

impl GpsBiasStep {
    fn on(p: &[f64], x: &FixInstant) -> bool {
        x.t_s >= p[0]
    }
}

impl Effect for GpsBiasStep {
    words! {
        name: "gps_bias_step",
        description: "the GNSS position jumps and stays beside the truth",
        cause: "a change of satellites, of the correction source or of the receiver's solution",
        remedy: "look at the receiver's fix type and satellites at that instant; leave that part of the flight out",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[
            ParameterGroup {
                unit: unit::S,
                shape: Shape::Scalar,
                names: &["gps_step_time"],
                prior_sigma: 0.0,
            },
            // A single-frequency receiver that changes satellites jumps by a few metres.
            ParameterGroup {
                unit: unit::M,
                shape: Shape::Vector,
                names: &["gps_step_n", "gps_step_e", "gps_step_d"],
                prior_sigma: 5.0,
            },
        ]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::Uniform(50.0, 190.0)
    }

    fn event(&self) -> Option<Event> {
        Some(Event::FixPosition)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let size = if Self::on(p, x) { Vector3::new(p[1], p[2], p[3]) } else { Vector3::zeros() };
        [size, Vector3::zeros()]
    }

    fn fix_jacobian(
        &self,
        p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        _velocity: &mut [Vector3<f64>],
    ) {
        if Self::on(p, x) {
            for k in 0..3 {
                position[k + 1][k] = 1.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, fix_instant};

    #[test]
    fn jumps_once_and_stays() {
        let p = [100.0, 3.0, -2.0, 5.0];
        let at = |t_s: f64| GpsBiasStep.fix(&p, &FixInstant { t_s, ..fix_instant() });
        assert_eq!(at(99.9), [Vector3::zeros(); 2]);
        assert_eq!(at(100.0), [Vector3::new(3.0, -2.0, 5.0), Vector3::zeros()]);
        assert_eq!(at(900.0), at(100.0));
    }

    #[test]
    fn before_the_step_its_size_has_no_influence() {
        let mut dp = [Vector3::zeros(); 4];
        GpsBiasStep.fix_jacobian(
            &[100.0, 3.0, 0.0, 0.0],
            &fix_instant(),
            &mut dp,
            &mut [Vector3::zeros(); 4],
        );
        assert_eq!(dp, [Vector3::zeros(); 4]);
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GpsBiasStep);
    }
}
