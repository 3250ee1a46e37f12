//! Whose attitude fits the motion: the specific force turned by each attitude against the change of GNSS velocity.
//!
//! What the accelerometers measure, turned to north, east and down, is the acceleration of the vehicle less gravity (Groves 2013, section
//! 5.4.3), and the receiver's velocity is its integral whatever the wind. Every attitude of a log is judged by the same samples: this
//! estimate, the autopilot's, all lanes of its filters. Each gets its own constant accelerometer bias, so that it counts for none. A vehicle
//! that hovers and one that flies are judged alike.

mod yaw;

use crate::logs::TRUTH;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::rotation::c_nb_from_euler;
use gaware_nav::sample::FixVelocity;
use nalgebra::{Matrix3, Vector3};
use std::collections::{BTreeMap, VecDeque};
pub use yaw::Stretch;

/// Name of the attitude that flies.
pub const AUTOPILOT: &str = "autopilot";
/// Name of ours.
pub const OURS: &str = "this estimate";
/// Velocities are compared over about this time, s: rare attitudes and noise of the fixes count for less.
const SPAN_S: f64 = 1.0;
/// A longer interval had fixes or attitudes missing, s.
const LONGEST_S: f64 = 3.0;
/// Attitudes further apart are not integrated over, s: half a turn of a copter.
const SPACING_S: f64 = 0.35;
/// Fixes are no older than this, s.
const OLDEST_S: f64 = 2.0;
/// Intervals of this time count as one: what is common to neighbours is correlated, s.
const BLOCK_S: f64 = 5.0;
/// With fewer blocks nothing is decided …
const BLOCKS: usize = 8;
/// … nor where the mean is within so many of its standard errors (chance one in 400).
const SIGMAS: f64 = 3.0;
/// A misfit larger by less than this share is of no use to anybody: lanes that share their inertial unit differ by up to 3 %.
const WORTH: f64 = 1.05;
/// More attitudes are not judged.
const MOST_TRACKS: usize = 12;

/// Integrals since some time: of the turned force, m/s, and of the attitude, s.
#[derive(Debug, Clone, Copy, Default)]
struct Gain {
    force: Vector3<f64>,
    turn: Matrix3<f64>,
}

/// One interval between two fixes: its end, s, what GNSS says without gravity, m/s, and the integrals.
#[derive(Debug, Clone, Copy)]
struct Interval {
    t_s: f64,
    gained: Vector3<f64>,
    /// 0 where the vertical velocity is not measured.
    vertical: f64,
    gain: Gain,
}

/// Velocity of a fix; 0 where its vertical part is not measured.
#[derive(Debug, Clone, Copy)]
struct Velocity {
    t_s: f64,
    v: Vector3<f64>,
    vertical: f64,
}

/// One attitude under way.
#[derive(Debug, Clone, Default)]
struct Track {
    /// Sum and number of the specific forces since the last attitude.
    force: (Vector3<f64>, u32),
    last: Option<(f64, Matrix3<f64>)>,
    gains: VecDeque<(f64, Gain)>,
    waiting: VecDeque<Velocity>,
    start: Option<(Velocity, Gain)>,
    intervals: Vec<Interval>,
}

impl Track {
    fn push(&mut self, t_s: f64, c: Matrix3<f64>) {
        let (sum, count) = std::mem::take(&mut self.force);
        let Some((dt, before)) = self.last.replace((t_s, c)).map(|(t, before)| (t_s - t, before)) else {
            return;
        };
        if count == 0 || !(0.0..=SPACING_S).contains(&dt) {
            (self.start, self.gains) = (None, VecDeque::new());
            return;
        }
        // Between two attitudes a tenth of a second apart their mean is the middle one.
        let middle = 0.5 * (before + c);
        let mut gain = self.gains.back().map_or_else(Gain::default, |last| last.1);
        gain.force += middle * (sum / f64::from(count)) * dt;
        gain.turn += middle * dt;
        self.gains.push_back((t_s, gain));
        while self.gains.pop_front_if(|g| g.0 < t_s - OLDEST_S).is_some() {}
        while let Some(fix) = self.waiting.pop_front_if(|fix| fix.t_s <= t_s) {
            self.fix(fix);
        }
    }

    /// The integrals at a time, on the line between attitudes.
    fn gain_at(&self, t_s: f64) -> Option<Gain> {
        let after = self.gains.partition_point(|g| g.0 < t_s);
        let ((t1, a), (t2, b)) = (self.gains.get(after.checked_sub(1)?)?, self.gains.get(after)?);
        let share = (t_s - t1) / (t2 - t1);
        Some(Gain { force: a.force.lerp(&b.force, share), turn: a.turn + (b.turn - a.turn) * share })
    }

    fn fix(&mut self, fix: Velocity) {
        let Some(gain) = self.gain_at(fix.t_s) else {
            self.start = None;
            return;
        };
        let Some((from, before)) = self.start else {
            self.start = Some((fix, gain));
            return;
        };
        let span_s = fix.t_s - from.t_s;
        // Intervals end at the same fixes for all attitudes, whenever each of them began: otherwise they could not be compared one by one.
        let cell = |t_s: f64| (t_s / SPAN_S).floor();
        if span_s >= 0.0 && cell(fix.t_s) == cell(from.t_s) {
            return;
        }
        if (0.5 * SPAN_S..=LONGEST_S).contains(&span_s) {
            self.intervals.push(Interval {
                t_s: fix.t_s,
                gained: fix.v - from.v - Vector3::z() * (STANDARD_GRAVITY * span_s),
                vertical: fix.vertical * from.vertical,
                gain: Gain { force: gain.force - before.force, turn: gain.turn - before.turn },
            });
        }
        self.start = Some((fix, gain));
    }

    fn restart(&mut self) {
        *self = Self { intervals: std::mem::take(&mut self.intervals), ..Self::default() };
    }
}

/// The comparison under way.
#[derive(Debug, Clone, Default)]
pub struct Motion(BTreeMap<String, Track>);

/// How one attitude fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Whose.
    pub name: String,
    /// RMS of what its turned force misses of the change of velocity, m/s over a second.
    pub misfit: f64,
    /// Constant error of its yaw, with sigma, deg; nothing where the flight does not show it.
    pub yaw_off_deg: Option<(f64, f64)>,
    /// Where its yaw is off for a while, and another one's is not.
    pub stretch: Option<Stretch>,
    /// Against the best one: difference of squared misfits over its standard error; 0 for the best.
    pub t: f64,
    /// Its misfit over that of the best one.
    pub ratio: f64,
    /// Time and squared misfit of every interval.
    squares: Vec<(f64, f64)>,
}

impl Fitted {
    /// Difference of the squared misfits from those of another one over its standard error.
    fn t_against(&self, other: &Self) -> f64 {
        difference(&self.squares, &other.squares)
    }

    /// Whether it is worse than the best one beyond chance, and by more than a hair.
    pub fn is_worse(&self) -> bool {
        self.t > SIGMAS && self.ratio > WORTH
    }

    /// Standard errors by which it is worse than another one, where that is beyond chance and more than a hair.
    pub fn worse_than(&self, other: &Self) -> Option<f64> {
        Some(self.t_against(other)).filter(|t| *t > SIGMAS && self.misfit > WORTH * other.misfit)
    }
}

impl Motion {
    /// Takes an inertial sample, m/s².
    pub fn push_force(&mut self, force: &Vector3<f64>) {
        for track in self.0.values_mut() {
            track.force = (track.force.0 + force, track.force.1 + 1);
        }
    }

    /// Takes an attitude (roll, pitch, yaw, rad) at a time.
    pub fn push_attitude(&mut self, name: &str, t_s: f64, [roll, pitch, yaw]: [f64; 3]) {
        if !self.0.contains_key(name) && self.0.len() >= MOST_TRACKS {
            return;
        }
        self.0.entry(name.to_owned()).or_default().push(t_s, c_nb_from_euler(roll, pitch, yaw));
    }

    /// Takes the velocity of a fix, with its time of validity.
    pub fn push_fix(&mut self, t_s: f64, velocity: &FixVelocity) {
        if *velocity == FixVelocity::None {
            return;
        }
        let (v, vertical) = (velocity.components().into(), f64::from(u8::from(velocity.rows() == 3)));
        for track in self.0.values_mut() {
            track.waiting.push_back(Velocity { t_s, v, vertical });
            if track.waiting.len() > 64 {
                track.waiting.pop_front();
            }
        }
    }

    /// Forgets the intervals under way: times begin anew.
    pub fn restart(&mut self) {
        self.0.values_mut().for_each(Track::restart);
    }

    /// All attitudes, the best first; empty where there are too few intervals.
    pub fn fitted(&self) -> Vec<Fitted> {
        let judged: Vec<_> = self
            .0
            .iter()
            .filter(|(_, track)| blocks(&track.intervals) >= BLOCKS)
            .map(|(name, track)| {
                let bias = yaw::bias(&track.intervals);
                let square = |i: &Interval| (i.t_s, residual(i, &bias, 0.0).norm_squared());
                let squares: Vec<(f64, f64)> = track.intervals.iter().map(square).collect();
                let mean = squares.iter().map(|s| s.1).sum::<f64>() / squares.len() as f64;
                let windows = yaw::windows(&track.intervals, &bias);
                (name, squares, mean.sqrt(), yaw::off(&track.intervals), windows)
            })
            .collect();
        let candidates = judged.iter().filter(|j| j.0 != TRUTH);
        let Some(best) = candidates.min_by(|a, b| a.2.total_cmp(&b.2)) else { return Vec::new() };
        let mut all: Vec<Fitted> = judged
            .iter()
            .map(|(name, squares, misfit, yaw_off_deg, windows)| {
                let others = judged.iter().filter(|j| j.0 != *name && j.0 != TRUTH);
                let others = others.map(|j| (j.0.as_str(), j.4.as_slice()));
                let t = if *name == best.0 { 0.0 } else { difference(squares, &best.1) };
                Fitted {
                    name: (*name).clone(),
                    misfit: *misfit,
                    yaw_off_deg: *yaw_off_deg,
                    stretch: yaw::stretch(windows, others),
                    t,
                    ratio: misfit / best.2.max(1e-9),
                    squares: squares.clone(),
                }
            })
            .collect();
        all.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        all
    }
}

fn blocks(intervals: &[Interval]) -> usize {
    let mut all: Vec<i64> = intervals.iter().map(|i| (i.t_s / BLOCK_S).floor() as i64).collect();
    all.dedup();
    all.len()
}

/// What an interval leaves, with this accelerometer bias and the attitude turned by this yaw.
fn residual(i: &Interval, bias: &Vector3<f64>, yaw: f64) -> Vector3<f64> {
    let r = i.gained - c_nb_from_euler(0.0, 0.0, yaw) * (i.gain.force - i.gain.turn * bias);
    Vector3::new(r.x, r.y, r.z * i.vertical)
}

/// Difference of the squared misfits of two attitudes over its standard error; 0 where they share too little time.
fn difference(own: &[(f64, f64)], best: &[(f64, f64)]) -> f64 {
    let mut other = best.iter().peekable();
    let mut blocks: Vec<(i64, f64, u32)> = Vec::new();
    for (t_s, square) in own {
        // Both begin and end with the same fixes unless one of them had a gap.
        while other.next_if(|o| o.0 < t_s - 0.05).is_some() {}
        let Some(same) = other.next_if(|o| (o.0 - t_s).abs() <= 0.05) else { continue };
        let block = (t_s / BLOCK_S).floor() as i64;
        match blocks.last_mut().filter(|b| b.0 == block) {
            Some((_, sum, count)) => (*sum, *count) = (*sum + square - same.1, *count + 1),
            None => blocks.push((block, square - same.1, 1)),
        }
    }
    let n = blocks.len() as f64;
    if blocks.len() < BLOCKS {
        return 0.0;
    }
    let means = || blocks.iter().map(|(_, sum, count)| sum / f64::from(*count));
    let mean = means().sum::<f64>() / n;
    let error = (means().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    if error > 0.0 { mean / error } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::{cos, sin};

    use super::*;

    /// A vehicle that accelerates to and fro for three minutes, with these errors of pitch and yaw of the autopilot and of the yaw of ours, rad.
    fn flown(errors: [f64; 3], acceleration: f64) -> Vec<Fitted> {
        flown_with(&|_| errors, acceleration, 0.0)
    }

    /// The same where ours begins so much later, s.
    fn flown_from(later_s: f64, errors: [f64; 3], acceleration: f64) -> Vec<Fitted> {
        flown_with(&|_| errors, acceleration, later_s)
    }

    /// The same with errors that come and go.
    fn flown_with(errors: &dyn Fn(f64) -> [f64; 3], acceleration: f64, later_s: f64) -> Vec<Fitted> {
        let (mut motion, mut velocity, dt) = (Motion::default(), Vector3::zeros(), 0.02);
        for k in 0..9000 {
            let t_s = f64::from(k) * dt;
            let [pitch, autopilot, ours] = errors(t_s);
            let yaw = 3.0 * sin(0.05 * t_s);
            let ahead = acceleration * sin(0.8 * t_s);
            velocity += Vector3::new(cos(yaw), sin(yaw), 0.0) * (ahead * dt);
            // A biased accelerometer, and a receiver with noise in a wind that nobody measures.
            motion.push_force(&Vector3::new(ahead + 0.15, 0.1, -STANDARD_GRAVITY));
            if k % 5 == 4 {
                motion.push_attitude(AUTOPILOT, t_s, [0.0, pitch, yaw + autopilot]);
                if t_s > later_s {
                    motion.push_attitude(OURS, t_s, [0.0, 0.0, yaw + ours]);
                }
            }
            if k % 10 == 9 {
                let noise = 0.05 * sin(f64::from(k) * 1.7);
                motion.push_fix(
                    t_s,
                    &FixVelocity::Full([velocity.x + noise + 5.0, velocity.y - noise - 3.0, 0.0]),
                );
            }
        }
        motion.fitted()
    }

    fn worse(all: &[Fitted]) -> Option<&str> {
        all.iter().find(|f| f.is_worse()).map(|f| f.name.as_str())
    }

    #[test]
    fn the_yaw_that_does_not_fit_the_acceleration_is_the_worse_one_and_its_error_is_found() {
        let all = flown([0.0, 0.2, 0.0], 2.0);
        assert_eq!(worse(&all), Some(AUTOPILOT), "{all:?}");
        let (off, sigma) = all.iter().find(|f| f.name == AUTOPILOT).unwrap().yaw_off_deg.unwrap();
        assert!((off - 11.46).abs() < 3.0 * sigma.max(0.3) && sigma < 2.0, "{off} {sigma}");
        let all = flown([0.0, 0.01, -1.5], 2.0);
        assert_eq!(worse(&all), Some(OURS), "{all:?}");
        let (off, sigma) = all.iter().find(|f| f.name == OURS).unwrap().yaw_off_deg.unwrap();
        assert!((off + 85.9).abs() < 3.0 * sigma.max(0.5), "{off} {sigma}");
    }

    /// On a recorded flight the two were out of step, and nothing of them was compared.
    #[test]
    fn an_attitude_that_begins_between_two_fixes_is_compared_all_the_same() {
        for later_s in [1.3, 1.5, 1.7, 1.9, 2.1] {
            assert_eq!(worse(&flown_from(later_s, [0.0, 0.2, 0.0], 2.0)), Some(AUTOPILOT), "{later_s}");
        }
    }

    #[test]
    fn a_tilt_that_turns_with_the_vehicle_is_a_bias_and_one_that_comes_and_goes_is_an_error() {
        // 1.7° of pitch are a force that a bias of 30 mg may have; strong acceleration would tell them apart.
        assert_eq!(worse(&flown([0.03, 0.0, 0.0], 0.3)), None);
        assert_eq!(worse(&flown([0.03, 0.0, 0.0], 2.0)), Some(AUTOPILOT));
        let mut motion = Motion::default();
        for k in 0..9000 {
            let t_s = f64::from(k) * 0.02;
            motion.push_force(&Vector3::new(0.0, 0.0, -STANDARD_GRAVITY));
            if k % 5 == 4 {
                motion.push_attitude(AUTOPILOT, t_s, [0.1 * sin(0.3 * t_s), 0.0, 0.0]);
                motion.push_attitude(OURS, t_s, [0.0; 3]);
            }
            if k % 10 == 9 {
                motion.push_fix(t_s, &FixVelocity::Full([0.02 * sin(f64::from(k) * 1.7), 0.0, 0.0]));
            }
        }
        assert_eq!(worse(&motion.fitted()), Some(AUTOPILOT), "hovering is enough");
    }

    /// Ten seconds of three minutes change the mean by little, and the yaw was wrong all the same.
    #[test]
    fn a_yaw_that_is_wrong_for_a_while_is_found_with_its_time() {
        let of = |all: &[Fitted], name: &str| all.iter().find(|f| f.name == name).unwrap().stretch.clone();
        let wrong = |t: f64| if (60.0..75.0).contains(&t) { 1.5 } else { 0.0 };
        let all = flown_with(&|t| [0.0, wrong(t), 0.0], 2.0, 0.0);
        let found = of(&all, AUTOPILOT).unwrap();
        assert!((found.off_deg - 86.0).abs() < 10.0 && found.against == OURS, "{found:?}");
        assert!((found.from_s - 60.0).abs() <= 6.0 && (found.to_s - 75.0).abs() <= 6.0, "{found:?}");
        assert_eq!(of(&all, OURS), None);
        // Both alike are wrong by the fixes, and 8° are not worth a word.
        let all = flown_with(&|t| [0.0, wrong(t), wrong(t)], 2.0, 0.0);
        assert_eq!((of(&all, AUTOPILOT), of(&all, OURS)), (None, None));
        assert_eq!(of(&flown_with(&|t| [0.0, 0.1 * wrong(t), 0.0], 2.0, 0.0), AUTOPILOT), None);
        assert_eq!(of(&flown_with(&|t| [0.0, wrong(t), 0.0], 0.01, 0.0), AUTOPILOT), None, "no acceleration");
    }

    #[test]
    fn nothing_is_decided_without_acceleration_or_between_equals() {
        assert_eq!(worse(&flown([0.0, 0.5, 0.5], 2.0)), None);
        let all = flown([0.0, 0.02, 0.0], 0.0);
        assert_eq!(worse(&all), None);
        // At rest a simulated receiver has no noise, and any yaw fits.
        let mut motion = Motion::default();
        for k in 0..9000 {
            let t_s = f64::from(k) * 0.02;
            motion.push_force(&Vector3::new(0.0, 0.0, -STANDARD_GRAVITY));
            if k % 5 == 4 {
                motion.push_attitude(AUTOPILOT, t_s, [0.0, 0.0, 1.4]);
            }
            if k % 10 == 9 {
                motion.push_fix(t_s, &FixVelocity::Full([1e-9 * sin(f64::from(k)), 0.0, 0.0]));
            }
        }
        assert_eq!(motion.fitted()[0].yaw_off_deg, None);
        assert!(Motion::default().fitted().is_empty());
    }
}
