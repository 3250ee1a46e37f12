//! Clock drift: the clock that stamps fixes and the one that stamps inertial samples do not run alike.
//!
//! With a relative rate d a fix is d τ older than its stamp says, τ after the start, and is compared with the motion of that time. A
//! series about the stamp would not do: the acceleration of one instant is mostly vibration. Recordings that put the receiver's own time
//! beside the autopilot's boot time have it, and so has a companion that stamps fixes itself.

use super::{ActsOn, DrawRange, Effect, Excitation, FixInstant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 200 ppm: quartz is within 50, ceramic resonators are within 5000.
const PRIOR_SIGMA: f64 = 200.0 * unit::PPM.si;

/// By how much fixes age, seconds per second.
#[derive(Debug)]
pub struct ClockDrift;

impl Effect for ClockDrift {
    words! {
        name: "clock_drift",
        description: "the clock of the GNSS stamps runs faster or slower than that of the inertial stamps",
        cause: "fixes and inertial samples are stamped by different clocks that are not synchronised, or the delay of the fixes has changed on the way",
        remedy: "stamp both on one clock, or synchronise them (TIMESYNC, PPS)",
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

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn fix_delay_s(&self, p: &[f64], elapsed_s: f64) -> f64 {
        p[0] * elapsed_s
    }

    fn fix_jacobian(
        &self,
        _p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        position[0] = -x.v_n * x.elapsed_s;
        velocity[0] = -x.smoothed_a_n * x.elapsed_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::fix_instant;

    /// 300 ppm after ten minutes are 0.18 s.
    #[test]
    fn fixes_age_in_proportion_to_time() {
        let x = FixInstant { elapsed_s: 600.0, ..fix_instant() };
        let (mut dp, mut dv) = ([Vector3::zeros()], [Vector3::zeros()]);
        ClockDrift.fix_jacobian(&[3e-4], &x, &mut dp, &mut dv);
        assert!((ClockDrift.fix_delay_s(&[3e-4], 600.0) - 0.18).abs() < 1e-12);
        assert_eq!(ClockDrift.fix_delay_s(&[3e-4], 0.0), 0.0);
        assert_eq!((dp[0], dv[0]), (x.v_n * -600.0, x.smoothed_a_n * -600.0));
        assert_eq!(ClockDrift.fix(&[3e-4], &x), [Vector3::zeros(); 2]);
    }
}
