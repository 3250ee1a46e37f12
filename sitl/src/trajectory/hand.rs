//! A unit that people turn by hand on the ground: sides in some order, none exact, turns of a few seconds, hands that shake, and the mistakes
//! that people make. Between its turns it stands on a table, a box, or its nose against a wall.

use super::Profile;
use crate::truth::Motion;
use gaware_nav::earth::Geodetic;
use gaware_nav::math::{exp, sin, sin_cos};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Hands shake at this frequency, Hz, and by so much: an angle, rad (physiological tremor: 8 to 12 Hz; of arms that carry, slower).
const TREMOR: (f64, f64) = (3.7, 4e-3);

/// Foam gives way by so much, rad, with this time constant, s.
const SOFT: (f64, f64) = (6e-3, 4.0);
/// It does so about this axis of the unit.
const SINKS_ABOUT: Vector3<f64> = Vector3::new(0.64, -0.6, 0.48);

/// How somebody does it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    /// As read: sides up to 12° off, on a firm table.
    Careful,
    /// A side twice, one that is left too early, hands that shake, a break, a slow start.
    Mistaken,
    /// Sides some 20° off.
    Askew,
    /// On foam.
    Soft,
    /// Without the left side and the back.
    TwoMissing,
}

/// One thing that hands do, after the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Act {
    /// Leave it for so long, s.
    Rest(f64),
    /// Hold it in the air for so long, s: it shakes.
    Shake(f64),
    /// Leave it on something soft for so long, s: it sinks in.
    Sink(f64),
    /// Turn it about an axis of its own by an angle, rad, in so long, s; what is left over moves it by so far, m.
    Turn {
        /// About this axis.
        axis: [f64; 3],
        /// By this much, rad.
        angle: f64,
        /// In so long, s.
        for_s: f64,
    },
}

impl Act {
    fn duration_s(&self) -> f64 {
        match self {
            Self::Rest(s) | Self::Shake(s) | Self::Sink(s) | Self::Turn { for_s: s, .. } => *s,
        }
    }
}

/// What hands do, with the attitude at the begin of each act.
#[derive(Debug, Clone)]
pub struct Hand {
    acts: Vec<(f64, UnitQuaternion<f64>, Act)>,
    duration_s: f64,
    place: Geodetic,
}

/// The quintic 6u⁵ − 15u⁴ + 10u³ and its first two derivatives by time.
fn smooth(u: f64, for_s: f64) -> [f64; 3] {
    let u = u.clamp(0.0, 1.0);
    let v = 1.0 - u;
    [
        u * u * u * (10.0 + u * (6.0 * u - 15.0)),
        30.0 * u * u * v * v / for_s,
        60.0 * u * v * (v - u) / (for_s * for_s),
    ]
}

/// How far foam has given way after so long, rad, and how fast it does, rad/s; it begins smoothly.
fn sunk(since_s: f64) -> [f64; 2] {
    let (size, tau) = SOFT;
    let u = since_s / tau;
    [size * (1.0 - (1.0 + u) * exp(-u)), size * u * exp(-u) / tau]
}

impl Hand {
    /// These acts, from level at a heading, rad.
    pub fn new(acts: impl IntoIterator<Item = Act>, heading: f64) -> Self {
        let mut at = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading)
            * UnitQuaternion::from_euler_angles(0.02, -0.03, 0.0);
        let mut list = Vec::new();
        let mut t_s = 0.0;
        for act in acts {
            list.push((t_s, at, act));
            t_s += act.duration_s();
            at *= match act {
                Act::Turn { axis, angle, .. } => UnitQuaternion::new(Vector3::from(axis).normalize() * angle),
                Act::Sink(s) => UnitQuaternion::new(SINKS_ABOUT * sunk(s)[0]),
                Act::Rest(_) | Act::Shake(_) => UnitQuaternion::identity(),
            };
        }
        Self { acts: list, duration_s: t_s, place: Geodetic::from_degrees(47.397_7, 8.545_6, 488.0) }
    }

    /// All six sides by quarter turns about each axis, each for so long, s, up to 12° off: as somebody does it who has read how.
    pub fn six_sides(hold_s: f64) -> Self {
        Self::in_manner(hold_s, Manner::Careful)
    }

    /// The same with mistakes: a side twice, a side that is left too early, hands that shake, a break, a slow start.
    pub fn with_mistakes(hold_s: f64) -> Self {
        Self::in_manner(hold_s, Manner::Mistaken)
    }

    /// Each side for so long, s, as somebody does it.
    pub fn in_manner(hold_s: f64, manner: Manner) -> Self {
        let mut acts = Self::turns(hold_s, manner);
        if manner == Manner::Soft {
            acts.iter_mut().for_each(|act| {
                if let Act::Rest(s) = act {
                    *act = Act::Sink(*s);
                }
            });
        }
        Self::new(acts, 1.1)
    }

    /// Quarter turns from level, each some degrees off: once around the pitch axis, once around the roll axis, and with the nose up once around the
    /// yaw axis; to and fro where sides are missing.
    fn plan(manner: Manner) -> Vec<([f64; 3], f64, f64)> {
        // How far off the sides of a circle are, rad, one after the other.
        let off: f64 = if manner == Manner::Askew { 0.32 } else { 0.12 };
        let circle = |[a, b, c]: [[f64; 3]; 3], sign: f64| {
            let by = [-off, off - 0.05, 0.02 - off, 0.0];
            let axes = [a, b, c, b];
            (0..4).map(move |k| {
                let before = if k > 0 { by[k - 1] } else { 0.0 };
                (axes[k], FRAC_PI_2 + sign * (by[k] - before), 2.5)
            })
        };
        let pitch = [[0.0, 1.0, 0.04], [0.03, 1.0, 0.0], [0.0, 1.0, -0.04]];
        let roll = [[1.0, 0.04, 0.0], [1.0, 0.0, 0.05], [1.0, -0.05, 0.0]];
        let yaw = [[0.04, 0.0, 1.0], [0.0, 0.03, 1.0], [0.0, -0.04, 1.0]];
        let up = ([0.0, 1.0, 0.02], FRAC_PI_2 - 0.06, 2.5);
        if manner == Manner::TwoMissing {
            // Neither on its left side nor on its back.
            let there = |axis: [f64; 3], off: f64| (axis, FRAC_PI_2 + off, 2.5);
            let back = |[x, y, z]: [f64; 3], off: f64| ([-x, -y, -z], FRAC_PI_2 + off, 2.5);
            return vec![
                there(pitch[0], -0.1),
                back(pitch[1], -0.1),
                back(pitch[0], -0.12),
                there(pitch[2], -0.12),
                there(roll[0], 0.1),
                back(roll[1], 0.1),
                up,
                there(yaw[0], 0.1),
                there(yaw[1], -0.1),
                back(yaw[2], -0.1),
                back(yaw[0], 0.1),
            ];
        }
        circle(pitch, 1.0).chain(circle(roll, -1.0)).chain([up]).chain(circle(yaw, -1.0)).collect()
    }

    fn turns(hold_s: f64, manner: Manner) -> Vec<Act> {
        let mistakes: &[usize] = if manner == Manner::Mistaken { &[1, 3, 4] } else { &[] };
        let mut acts = vec![Act::Rest(hold_s + 6.0)];
        for (k, (axis, angle, for_s)) in Self::plan(manner).into_iter().enumerate() {
            let wrong = mistakes.contains(&k);
            if wrong && k == 1 {
                // The side before is left at once and taken up again.
                let [x, y, z] = axis;
                acts.push(Act::Turn { axis, angle: 0.5, for_s: 1.5 });
                acts.push(Act::Shake(9.0));
                acts.push(Act::Turn { axis: [-x, -y, -z], angle: 0.5, for_s: 1.5 });
                acts.push(Act::Rest(hold_s));
            }
            acts.push(Act::Turn { axis, angle, for_s });
            acts.push(Act::Shake(if wrong { 14.0 } else { 1.5 }));
            if wrong && k == 3 {
                acts.push(Act::Rest(9.0));
                acts.push(Act::Turn { axis: [0.0, 1.0, 0.0], angle: 0.6, for_s: 1.5 });
                acts.push(Act::Turn { axis: [0.0, -1.0, 0.0], angle: 0.6, for_s: 1.5 });
            }
            acts.push(Act::Rest(hold_s + 6.0));
        }
        acts
    }

    fn act_at(&self, t_s: f64) -> Option<&(f64, UnitQuaternion<f64>, Act)> {
        let k = self.acts.partition_point(|(from_s, ..)| *from_s <= t_s);
        self.acts.get(k.saturating_sub(1))
    }
}

impl Profile for Hand {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn start(&self) -> Geodetic {
        self.place
    }

    fn motion_at(&self, t_s: f64, _course_rad: f64) -> (Motion, f64) {
        let mut motion = Motion {
            v_n: Vector3::zeros(),
            a_n: Vector3::zeros(),
            c_nb: nalgebra::Matrix3::identity(),
            rate_nb: Vector3::zeros(),
        };
        let Some((from_s, at, act)) = self.act_at(t_s) else { return (motion, 0.0) };
        let (since_s, for_s) = (t_s - from_s, act.duration_s());
        let turn = |axis: Vector3<f64>, angle: f64| at * UnitQuaternion::new(axis * angle);
        let (attitude, rate) = match act {
            Act::Rest(_) => (*at, Vector3::zeros()),
            Act::Sink(_) => {
                let [angle, rate] = sunk(since_s);
                (turn(SINKS_ABOUT, angle), SINKS_ABOUT * rate)
            }
            Act::Turn { axis, angle, .. } => {
                let axis = Vector3::from(*axis).normalize();
                let [share, rate, _] = smooth(since_s / for_s, for_s);
                // Hands lift it and put it down again: up and down by some 0.2 m.
                let lift = |u: f64| smooth(u, 0.5 * for_s);
                let half = 2.0 * since_s / for_s;
                let (sign, [_, v, a]) = if half < 1.0 { (-1.0, lift(half)) } else { (1.0, lift(half - 1.0)) };
                motion.v_n.z = 0.2 * sign * v;
                motion.a_n.z = 0.2 * sign * a;
                (turn(axis, angle * share), axis * (angle * rate))
            }
            Act::Shake(_) => {
                let omega = TAU * TREMOR.0;
                // It fades in and out, so that rates do not jump.
                let fade = sin(PI * since_s / for_s).powi(2);
                let fade_rate = PI / for_s * sin(TAU * since_s / for_s);
                let (sin, cos) = sin_cos(omega * since_s);
                let axis = Vector3::new(0.6, 0.7, 0.39).normalize();
                let angle = TREMOR.1 * fade * sin;
                (turn(axis, angle), axis * (TREMOR.1 * (fade_rate * sin + fade * omega * cos)))
            }
        };
        motion.c_nb = attitude.to_rotation_matrix().into_inner();
        motion.rate_nb = rate;
        (motion, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::math::cos;

    #[test]
    fn rate_is_the_derivative_of_the_attitude_and_velocity_the_integral_of_acceleration() {
        use Manner::{Askew, Careful, Mistaken, Soft, TwoMissing};
        for manner in [Careful, Mistaken, Askew, Soft, TwoMissing] {
            let hand = Hand::in_manner(20.0, manner);
            let mut t = 0.0;
            let h = 1e-4;
            while t < hand.duration_s() - 1.0 {
                let [a, b, c] = [t - h, t, t + h].map(|t| hand.motion_at(t.max(0.0), 0.0).0);
                t += 0.0937;
                let s = b.c_nb.transpose() * (c.c_nb - a.c_nb) / (2.0 * h);
                let rate = Vector3::new(s[(2, 1)], s[(0, 2)], s[(1, 0)]);
                assert!(t < 0.2 || (rate - b.rate_nb).norm() < 2e-3, "{t}: {rate} {}", b.rate_nb);
                let by = (c.v_n - a.v_n) / (2.0 * h);
                assert!(t < 0.2 || (by - b.a_n).norm() < 2e-2, "{t}: {by} {}", b.a_n);
            }
            assert!(hand.motion_at(hand.duration_s(), 0.0).0.v_n.norm() < 1e-9);
        }
    }

    #[test]
    fn every_side_comes_down_within_twenty_degrees() {
        let hand = Hand::six_sides(20.0);
        let askew = Hand::in_manner(20.0, Manner::Askew);
        let level = |h: &Hand, t_s: f64| h.motion_at(t_s, 0.0).0.c_nb.row(2).transpose().amax();
        let rests = askew.acts.iter().filter(|(.., act)| matches!(act, Act::Rest(_)));
        let worst = rests.map(|(from_s, ..)| level(&askew, from_s + 1.0)).fold(1.0, f64::min);
        assert!(worst < cos(17f64.to_radians()), "{worst}");
        let mut seen = [false; 6];
        for (from_s, ..) in hand.acts.iter().filter(|(.., act)| matches!(act, Act::Rest(_))) {
            let up = -hand.motion_at(from_s + 1.0, 0.0).0.c_nb.row(2).transpose();
            let k = up.iamax();
            assert!(up[k].abs() > cos(20f64.to_radians()), "{up}");
            seen[2 * k + usize::from(up[k] > 0.0)] = true;
        }
        assert_eq!(seen, [true; 6]);
    }
}
