//! Clock drift: the clock that stamps fixes and the one that stamps inertial samples do not run alike.
//!
//! With a relative rate d a fix is d τ older than its stamp says, τ after the start: z(t − dτ) = z − dτ ż + ½ (dτ)² z̈. Recordings that put
//! the receiver's own time beside the autopilot's boot time have it, and so has a companion that stamps fixes itself.

use super::{DrawRange, Effect, Excitation, FixEffect, FixInstant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 200 ppm: quartz is within 50, ceramic resonators are within 5000.
const PRIOR_SIGMA: f64 = 200.0 * unit::PPM.si;

/// By how much fixes age, seconds per second.
#[derive(Debug)]
pub struct ClockDrift;

impl Effect for ClockDrift {
    fn name(&self) -> &'static str {
        "clock_drift"
    }

    fn description(&self) -> &'static str {
        "the clock of the GNSS stamps runs faster or slower than that of the inertial stamps"
    }

    fn cause(&self) -> &'static str {
        "fixes and inertial samples are stamped by different clocks that are not synchronised"
    }

    fn remedy(&self) -> &'static str {
        "stamp both on one clock, or synchronise them (TIMESYNC, PPS)"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::PPM,
            shape: Shape::Scalar,
            names: &["clock_drift"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gps_latency",
                fly: &[Excitation::VaryingSpeed, Excitation::FigureEight],
                why: "at the beginning and at the end of a long flight: a latency stays, a drift adds up",
            },
            Separation {
                from: "gps_velocity_latency",
                fly: &[Excitation::VaryingSpeed, Excitation::FigureEight],
                why: "at the beginning and at the end of a long flight: a latency stays, a drift adds up",
            },
        ]
    }

    fn draw_range(&self) -> DrawRange {
        DrawRange::LogUniform(100.0 * unit::PPM.si, 600.0 * unit::PPM.si)
    }

    fn on_fixes(&self) -> Option<&dyn FixEffect> {
        Some(self)
    }
}

impl FixEffect for ClockDrift {
    fn aging(&self, p: &[f64]) -> f64 {
        p[0]
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let late_s = p[0] * x.elapsed_s;
        let earlier =
            |first: Vector3<f64>, second: Vector3<f64>| second * (0.5 * late_s * late_s) - first * late_s;
        [earlier(x.v_n, x.a_n), earlier(x.a_n, x.jerk_n())]
    }

    fn fix_jacobian(
        &self,
        p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        let late_s = p[0] * x.elapsed_s;
        position[0] = (x.a_n * late_s - x.v_n) * x.elapsed_s;
        velocity[0] = (x.jerk_n() * late_s - x.a_n) * x.elapsed_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, fix_instant};

    /// 300 ppm after ten minutes are 0.18 s: on a level turn, against the circle itself.
    #[test]
    fn fixes_age_in_proportion_to_time() {
        let (v, rate, p) = (25.0, 0.3, [3e-4]);
        let x = FixInstant {
            v_n: Vector3::new(v, 0.0, 0.0),
            a_n: Vector3::new(0.0, v * rate, 0.0),
            c_nb: crate::rotation::c_nb_from_euler(0.0, 0.0, 0.0),
            rate_eb: Vector3::new(0.0, 0.0, rate),
            force_rate: Vector3::zeros(),
            elapsed_s: 600.0,
            ..fix_instant()
        };
        let turned = rate * 0.18;
        let exact = [
            Vector3::new(-turned.sin(), 1.0 - turned.cos(), 0.0) * (v / rate),
            Vector3::new(turned.cos() - 1.0, -turned.sin(), 0.0) * v,
        ];
        let found = ClockDrift.fix(&p, &x);
        for (found, exact) in found.iter().zip(&exact) {
            assert!((found - exact).norm() < 5e-3, "{found} {exact}");
        }
        assert_eq!(ClockDrift.fix(&p, &FixInstant { elapsed_s: 0.0, ..x }), [Vector3::zeros(); 2]);
        check_jacobians(&ClockDrift);
    }
}
