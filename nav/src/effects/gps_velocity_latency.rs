//! GNSS velocity latency: the velocity of a fix is older than its position. Receivers that filter velocity, or take it from the
//! epoch before, and autopilots that join two messages of different epochs have it.
//!
//! v(t − L) = v(t) − a L + ½ ȧ L² to second order. Where an aircraft rolls quickly the rest is centimetres per second at 0.2 s; there
//! the samples give the velocity of a while ago, and the series is one about it.

use super::{ActsOn, DrawRange, Effect, Excitation, FixInstant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// Time from the validity of the velocity to that of the position.
#[derive(Debug)]
pub struct GpsVelocityLatency;

impl Effect for GpsVelocityLatency {
    words! {
        name: "gps_velocity_latency",
        description: "the velocity of GNSS fixes is older than their position",
        cause: "the receiver filters its velocity or takes it from an earlier epoch, or a driver joins messages of two epochs",
        remedy: "choose a dynamic model without velocity smoothing in the receiver, or log velocity with its own time of validity",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::S,
            shape: Shape::Scalar,
            names: &["velocity_latency"],
            prior_sigma: 0.1,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gps_latency",
                fly: &[Excitation::VaryingSpeed, Excitation::FigureEight],
                why: "positions show a delay in proportion to speed, velocities in proportion to acceleration",
            },
            Separation {
                from: "gps_lever_arm",
                fly: &[Excitation::VaryingSpeed, Excitation::FigureEight],
                why: "a delay shows with any acceleration, an arm with the rate of turn alone",
            },
        ]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::LogUniform(0.04, 0.2)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn needs_motion_around(&self) -> bool {
        true
    }

    fn values_to_try(&self) -> &'static [f64] {
        &[0.05, 0.1, 0.2]
    }

    fn velocity_delay_s(&self, p: &[f64]) -> f64 {
        p[0]
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let beyond = p[0] - x.older.lag_s;
        let change = x.jerk_n() * (0.5 * beyond) - x.older.acceleration;
        [Vector3::zeros(), x.older.change + change * beyond]
    }

    fn fix_jacobian(
        &self,
        p: &[f64],
        x: &FixInstant,
        _position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        velocity[0] = x.jerk_n() * (p[0] - x.older.lag_s) - x.older.acceleration;
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::effects::testing::check_jacobians;
    use crate::effects::{Antenna, Older};
    use crate::rotation::c_nb_from_euler;

    /// Velocity of a level turn a while ago, against the circle itself.
    #[test]
    fn a_turn_shows_the_velocity_of_a_while_ago() {
        let (v, rate, latency) = (60.0, 0.25, 0.12);
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
            older: Older { acceleration: Vector3::new(0.0, v * rate, 0.0), ..Older::default() },
            elapsed_s: 0.0,
            conditions: crate::effects::Conditions::default(),
        };
        let [position, velocity] = GpsVelocityLatency.fix(&[latency], &x);
        let turned = rate * latency;
        let exact = Vector3::new(v * cos(turned) - v, -v * sin(turned), 0.0);
        assert!((velocity - exact).norm() < 1e-3, "{velocity} {exact}");
        assert_eq!(position, Vector3::zeros());
        check_jacobians(&GpsVelocityLatency);
    }
}
