//! Which of two yaws fits the motion: the specific force turned by each against the change of GNSS velocity.
//!
//! What the accelerometers measure, levelled and turned to north and east, is the acceleration of the vehicle (Groves 2013, section
//! 5.4.3), and the receiver's velocity is its integral whatever the wind. Both yaws get the same level and the same samples, so that all
//! other errors (accelerometer bias, late fixes) are common; a vehicle that hovers and one that flies are judged alike.

use gaware_nav::rotation::c_nb_from_euler;
use gaware_nav::sample::FixVelocity;
use nalgebra::{Vector2, Vector3};
use std::collections::VecDeque;

/// Velocities are compared over at least this time, s: rare attitudes and noise of the fixes count for less.
const SPAN_S: f64 = 1.0;
/// A longer interval had fixes or attitudes missing, s.
const LONGEST_S: f64 = 3.0;
/// Attitudes further apart are not integrated over, s.
const SPACING_S: f64 = 0.5;
/// Fixes are no older than this, s.
const OLDEST_S: f64 = 2.0;
/// Intervals of this time count as one: what is common to neighbours is correlated, s.
const BLOCK_S: f64 = 10.0;
/// With fewer blocks nothing is decided …
const BLOCKS: usize = 8;
/// … nor where the mean is within so many of its standard errors (chance one in 400).
const SIGMAS: f64 = 3.0;

/// Whose yaw fits worse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Worse {
    /// The autopilot's.
    Autopilot,
    /// This estimate's.
    Ours,
}

/// Integral of the acceleration since some time, by the autopilot's yaw and by ours, m/s.
type Gains = [Vector2<f64>; 2];

/// The comparison under way.
#[derive(Debug, Clone, Default)]
pub struct Yaws {
    /// Sum and number of the specific forces since the last attitude.
    force: (Vector3<f64>, u32),
    attitude_s: Option<f64>,
    /// Time, velocity and gains at the fix that the interval began with.
    start: Option<(f64, Vector2<f64>, Gains)>,
    /// Gains at the last attitudes, oldest first.
    gains: VecDeque<(f64, Gains)>,
    /// Block, sum and number of its intervals: squared misfit of the autopilot's yaw less that of ours, m²/s².
    blocks: Vec<(i64, f64, u32)>,
}

impl Yaws {
    /// Takes an inertial sample, m/s².
    pub fn push_force(&mut self, force: &Vector3<f64>) {
        self.force.0 += force;
        self.force.1 += 1;
    }

    /// Takes both attitudes (roll, pitch, yaw, rad) at a time.
    pub fn push_attitudes(&mut self, t_s: f64, autopilot: [f64; 3], ours: [f64; 3]) {
        let (sum, count) = std::mem::take(&mut self.force);
        let Some(dt) = self.attitude_s.replace(t_s).map(|last| t_s - last) else { return };
        if count == 0 || !(0.0..=SPACING_S).contains(&dt) {
            (self.start, self.gains) = (None, VecDeque::new());
            return;
        }
        let middle = |k: usize| 0.5 * (autopilot[k] + ours[k]);
        let force = sum / f64::from(count);
        let mut gains = self.gains.back().map_or_else(Gains::default, |last| last.1);
        for (gained, yaw) in gains.iter_mut().zip([autopilot[2], ours[2]]) {
            *gained += (c_nb_from_euler(middle(0), middle(1), yaw) * force).xy() * dt;
        }
        self.gains.push_back((t_s, gains));
        while self.gains.pop_front_if(|g| g.0 < t_s - OLDEST_S).is_some() {}
    }

    /// The gains at a time, on the line between attitudes.
    fn gains_at(&self, t_s: f64) -> Option<Gains> {
        let after = self.gains.partition_point(|g| g.0 < t_s);
        let ((t1, a), (t2, b)) = (self.gains.get(after.checked_sub(1)?)?, self.gains.get(after)?);
        let share = (t_s - t1) / (t2 - t1);
        Some(std::array::from_fn(|k| a[k].lerp(&b[k], share)))
    }

    /// Takes the velocity of a fix, with its time of validity.
    pub fn push_fix(&mut self, t_s: f64, velocity: &FixVelocity) {
        let velocity = match *velocity {
            FixVelocity::None => return,
            FixVelocity::Horizontal([n, e]) | FixVelocity::Full([n, e, _]) => Vector2::new(n, e),
        };
        let Some(gains) = self.gains_at(t_s) else {
            self.start = None;
            return;
        };
        let Some((start_s, before, from)) = self.start else {
            self.start = Some((t_s, velocity, gains));
            return;
        };
        let span_s = t_s - start_s;
        if (0.0..SPAN_S).contains(&span_s) {
            return;
        }
        if (SPAN_S..=LONGEST_S).contains(&span_s) {
            let misfit = |k: usize| (velocity - before - (gains[k] - from[k])).norm_squared();
            let (autopilot, ours) = (misfit(0), misfit(1));
            let block = (t_s / BLOCK_S).floor() as i64;
            match self.blocks.last_mut().filter(|b| b.0 == block) {
                Some((_, sum, count)) => (*sum, *count) = (*sum + autopilot - ours, *count + 1),
                None => self.blocks.push((block, autopilot - ours, 1)),
            }
        }
        self.start = Some((t_s, velocity, gains));
    }

    /// Forgets the interval under way: times begin anew.
    pub fn restart(&mut self) {
        *self = Self { blocks: std::mem::take(&mut self.blocks), ..Self::default() };
    }

    /// Whose yaw fits worse, where that is beyond chance.
    pub fn worse(&self) -> Option<Worse> {
        let n = self.blocks.len() as f64;
        if self.blocks.len() < BLOCKS {
            return None;
        }
        let means = || self.blocks.iter().map(|(_, sum, count)| sum / f64::from(*count));
        let mean = means().sum::<f64>() / n;
        let error = (means().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
        match mean {
            m if m > SIGMAS * error => Some(Worse::Autopilot),
            m if m < -SIGMAS * error => Some(Worse::Ours),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level vehicle that accelerates to and fro for three minutes, with these errors of the yaws, rad.
    fn flown(autopilot: f64, ours: f64, acceleration: f64) -> Option<Worse> {
        let (mut yaws, mut velocity, dt) = (Yaws::default(), Vector2::zeros(), 0.02);
        for k in 0..9000 {
            let t_s = f64::from(k) * dt;
            let yaw = 0.3 * (0.05 * t_s).sin();
            let ahead = acceleration * (0.8 * t_s).sin();
            velocity += Vector2::new(yaw.cos(), yaw.sin()) * (ahead * dt);
            // A biased accelerometer, and a receiver with noise in a wind that nobody measures.
            yaws.push_force(&Vector3::new(ahead + 0.15, 0.1, -9.8));
            if k % 5 == 4 {
                yaws.push_attitudes(t_s, [0.0, 0.0, yaw + autopilot], [0.0, 0.0, yaw + ours]);
            }
            if k % 10 == 9 {
                let noise = 0.05 * (f64::from(k) * 1.7).sin();
                yaws.push_fix(
                    t_s,
                    &FixVelocity::Horizontal([velocity.x + noise + 5.0, velocity.y - noise - 3.0]),
                );
            }
        }
        yaws.worse()
    }

    #[test]
    fn the_yaw_that_does_not_fit_the_acceleration_is_the_worse_one() {
        assert_eq!(flown(0.2, 0.0, 2.0), Some(Worse::Autopilot));
        assert_eq!(flown(0.01, -0.3, 2.0), Some(Worse::Ours));
    }

    #[test]
    fn nothing_is_decided_without_acceleration_or_between_equals() {
        assert_eq!(flown(0.5, 0.5, 2.0), None);
        assert_eq!(flown(0.02, 0.0, 0.0), None);
        assert_eq!(Yaws::default().worse(), None);
    }
}
