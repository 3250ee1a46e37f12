//! The start: roll and pitch from gravity, heading from whoever knows it, and how far to trust each.

use crate::earth::STANDARD_GRAVITY;
use crate::filter::Initial;
use crate::math::atan2;
use crate::mechanization::NavState;
use crate::rotation::{c_nb_from_euler, euler_from_c_nb, exp};
use crate::rss;
use crate::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// Samples are averaged over so long, s.
pub const WINDOW_S: f64 = 2.0;
/// … and at least over so long before anything starts, s.
const ENOUGH_S: f64 = 1.0;
/// A hint older than this says nothing any more, s.
const HINT_AGE_S: f64 = 1.0;
/// A fix that is older than this, or newer, is none to start from, s.
const FIX_AGE_S: f64 = 1.5;
/// Trust in another filter's roll and pitch, rad.
const HINT_TILT_SIGMA: f64 = 0.05;
/// Trust in another filter's heading: a compass near motors and metal, rad.
const HINT_YAW_SIGMA: f64 = 0.14;
/// Trust in levelling while stationary: an accelerometer bias of 0.2 m/s² and vibration, rad.
const LEVEL_SIGMA: f64 = 0.035;
/// Trust in levelling while moving, rad.
const MOVING_LEVEL_SIGMA: f64 = 0.35;
/// Stationary: mean rate below this (a large gyro bias), rad/s …
const STATIONARY_RATE: f64 = 0.03;
/// … mean specific force this close to gravity, m/s² …
const STANDING_FORCE: f64 = 0.5;
/// … and ground speed below this, m/s.
const STANDING_SPEED: f64 = 0.7;

/// The last seconds of samples, and what else is known before the filter runs.
#[derive(Debug, Clone, Default)]
pub struct Gathering {
    samples: VecDeque<ImuSample>,
    hint: Option<AttitudeHint>,
}

/// How to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Position, velocity, attitude with sigmas.
    pub initial: Initial,
    /// Whether the heading is known; otherwise that of `initial` is arbitrary.
    pub heading_known: bool,
    /// Whether the vehicle stands, so that the mean rate is bias (and G f) alone.
    pub stationary: bool,
}

impl Gathering {
    /// Takes a sample.
    pub fn push_imu(&mut self, sample: ImuSample) {
        if !sample.is_usable() {
            return;
        }
        self.samples.push_back(sample);
        while self.samples.front().is_some_and(|s| s.t_s < sample.t_s - WINDOW_S) {
            self.samples.pop_front();
        }
    }

    /// Takes another filter's attitude.
    pub fn push_hint(&mut self, hint: AttitudeHint) {
        if hint.is_finite() {
            self.hint = Some(hint);
        }
    }

    /// Whether there are no samples yet.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The samples gathered, oldest first.
    pub fn samples(&self) -> impl Iterator<Item = &ImuSample> {
        self.samples.iter()
    }

    /// Mean rate and specific force over the window.
    pub fn mean(&self) -> Option<ImuSample> {
        let last = self.samples.back()?;
        let n = self.samples.len() as f64;
        let sum = |f: fn(&ImuSample) -> Vector3<f64>| self.samples.iter().map(f).sum::<Vector3<f64>>() / n;
        Some(ImuSample { gyro: sum(|s| s.gyro), accel: sum(|s| s.accel), ..*last })
    }

    /// Roll, pitch and yaw of a hint at the time of the newest sample: what the gyros showed since then on top.
    fn turned_since(&self, hint: &AttitudeHint) -> Vector3<f64> {
        let [roll, pitch, yaw] = hint.roll_pitch_yaw;
        let mut turned = UnitQuaternion::identity();
        let mut t_s = hint.t_s;
        for sample in self.samples.iter().filter(|s| s.t_s > hint.t_s) {
            turned *= exp(&(sample.gyro * (sample.t_s - t_s)));
            t_s = sample.t_s;
        }
        let c_nb = c_nb_from_euler(roll, pitch, yaw) * turned.to_rotation_matrix().into_inner();
        euler_from_c_nb(&c_nb)
    }

    /// The start that this fix makes possible, valid at the newest sample; `None` until enough is gathered.
    pub fn start(
        &self,
        fix: &GnssFix,
        position_sigma_m: [f64; 3],
        velocity_sigma: [f64; 3],
    ) -> Option<Start> {
        let (first, last) = (self.samples.front()?, self.samples.back()?);
        let age_s = last.t_s - fix.t_s;
        if last.t_s - first.t_s < ENOUGH_S || age_s.is_nan() || age_s.abs() > FIX_AGE_S {
            return None;
        }
        let mean = self.mean()?;
        let v_n = Vector3::from(fix.velocity.components());
        let stationary = mean.gyro.norm() < STATIONARY_RATE
            && (mean.accel.norm() - STANDARD_GRAVITY).abs() < STANDING_FORCE
            && fix.velocity != FixVelocity::None
            && v_n.norm() < STANDING_SPEED;
        let hint = self.hint.filter(|h| (last.t_s - h.t_s).abs() < HINT_AGE_S);
        let level =
            [atan2(-mean.accel.y, -mean.accel.z), atan2(mean.accel.x, rss(mean.accel.y, mean.accel.z))];
        let mut hinted_yaw = None;
        let (roll, pitch, tilt_sigma) = match hint {
            Some(h) => {
                let now = self.turned_since(&h);
                hinted_yaw = Some((now.z, HINT_YAW_SIGMA));
                (now.x, now.y, HINT_TILT_SIGMA)
            }
            None if stationary => (level[0], level[1], LEVEL_SIGMA),
            None => (level[0], level[1], MOVING_LEVEL_SIGMA),
        };
        let heading = fix.yaw_rad.or(hinted_yaw);
        let (yaw, yaw_sigma) = heading.unwrap_or((0.0, crate::heading::MEMBER_SIGMA_RAD));
        let moved = if stationary { 0.5 } else { 3.0 };
        let initial = Initial {
            t_s: last.t_s,
            nav: NavState::from_ned(fix.position, &v_n, &c_nb_from_euler(roll, pitch, yaw)),
            // The fix is older than the sample by an unknown latency.
            position_sigma_m: position_sigma_m.map(|s| s + (0.3 + age_s.abs()) * v_n.norm() + 1.0),
            velocity_sigma_m_per_s: velocity_sigma.map(|s| s + moved),
            attitude_sigma_rad: [tilt_sigma, tilt_sigma, yaw_sigma],
        };
        Some(Start { initial, heading_known: heading.is_some(), stationary })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;

    fn gathered(roll: f64, pitch: f64) -> Gathering {
        let c = c_nb_from_euler(roll, pitch, 1.0);
        let accel = c.transpose() * Vector3::new(0.0, 0.0, -STANDARD_GRAVITY);
        let mut g = Gathering::default();
        for i in 0..150 {
            g.push_imu(ImuSample {
                t_s: f64::from(i) * 0.01,
                gyro: Vector3::zeros(),
                accel,
                temperature_degc: None,
            });
        }
        g
    }

    fn fix() -> GnssFix {
        GnssFix {
            t_s: 1.49,
            position: Geodetic::from_degrees(47.0, 8.0, 400.0),
            velocity: FixVelocity::Horizontal([0.1, 0.0]),
            position_sigma_m: None,
            velocity_sigma_m_per_s: None,
            yaw_rad: None,
        }
    }

    #[test]
    fn levels_from_gravity() {
        let start = gathered(0.2, -0.1).start(&fix(), [1.0; 3], [0.1; 3]).expect("enough samples");
        let euler = start.initial.nav.euler();
        assert!((euler.x - 0.2).abs() < 1e-9 && (euler.y + 0.1).abs() < 1e-9, "{euler}");
        assert!(start.stationary && !start.heading_known);
    }

    #[test]
    fn a_fix_from_another_time_starts_nothing() {
        for t_s in [-3.0, 5.0, f64::NAN] {
            assert!(gathered(0.0, 0.0).start(&GnssFix { t_s, ..fix() }, [1.0; 3], [0.1; 3]).is_none());
        }
    }

    #[test]
    fn a_hint_is_turned_by_what_the_gyros_showed_since() {
        let mut g = Gathering::default();
        for i in 0..150 {
            g.push_imu(ImuSample {
                t_s: f64::from(i) * 0.01,
                gyro: Vector3::new(0.0, 0.0, 0.5),
                accel: Vector3::new(0.0, 0.0, -STANDARD_GRAVITY),
                temperature_degc: None,
            });
        }
        g.push_hint(AttitudeHint { t_s: 0.69, roll_pitch_yaw: [0.0, 0.0, 1.0] });
        let yaw = g.start(&fix(), [1.0; 3], [0.1; 3]).unwrap().initial.nav.euler().z;
        assert!((yaw - 1.4).abs() < 1e-6, "{yaw}");
    }

    #[test]
    fn takes_heading_from_the_fix_before_the_hint() {
        let mut g = gathered(0.0, 0.0);
        g.push_hint(AttitudeHint { t_s: 1.4, roll_pitch_yaw: [0.0, 0.0, 2.0] });
        let with_yaw = GnssFix { yaw_rad: Some((1.0, 0.02)), ..fix() };
        let yaw = |f: &GnssFix| g.start(f, [1.0; 3], [0.1; 3]).map(|s| s.initial.nav.euler().z);
        assert!(yaw(&with_yaw).is_some_and(|y| (y - 1.0).abs() < 1e-9));
        assert!(yaw(&fix()).is_some_and(|y| (y - 2.0).abs() < 1e-9));
    }

    #[test]
    fn waits_for_a_second_of_samples() {
        assert_eq!(Gathering::default().start(&fix(), [1.0; 3], [0.1; 3]), None);
    }
}
