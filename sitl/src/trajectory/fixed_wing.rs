//! A small fixed-wing aircraft, 15 to 30 m/s: take-off, coordinated turns to both sides, speed changes, pull-ups, and
//! (unless it is flown strictly coordinated) sideslips.
//!
//! Bank, climb angle, speed and sideslip are prescribed; course and lift follow from the balance of forces in wind
//! axes (Stevens, Lewis & Johnson 2016, section 2.5, without wind), angle of attack from the lift.

use super::Scripted;
use super::signal::{Jet, Signal};
use super::{Chain, Profile};
use crate::truth::Motion;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::math::{cos, sin};
use nalgebra::Vector3;
use std::ops::{Add, Div, Mul, Neg};

/// Side acceleration per sideslip and speed squared, 1/m: 15° at 22 m/s give 2.4 m/s².
pub(crate) const SIDE_FORCE_PER_M: f64 = 0.019;
/// Angle of attack per lift over (V² + V₀²), m²/s² per m/s²: 3° in level flight at 20 m/s, 8° at rest.
const ATTACK: f64 = 3.3;
/// V₀², (m/s)².
const ATTACK_SPEED_SQUARED: f64 = 225.0;

/// The profile.
#[derive(Debug, Clone)]
pub struct FixedWing {
    duration_s: f64,
    speed: Signal,
    climb: Signal,
    bank: Signal,
    slip: Signal,
}

impl FixedWing {
    /// The flight of 300 s, with or without deliberate sideslip.
    pub fn new(sideslip: bool) -> Self {
        Self {
            duration_s: 300.0,
            speed: speed_signal(),
            climb: climb_signal(),
            bank: bank_signal(sideslip),
            slip: if sideslip { slip_signal() } else { Signal::constant(0.0) },
        }
    }

    /// Any flight: speed (m/s), climb angle, bank and sideslip (rad) over time. It must start at speed zero or level.
    pub fn from_signals(duration_s: f64, speed: Signal, climb: Signal, bank: Signal, slip: Signal) -> Self {
        Self { duration_s, speed, climb, bank, slip }
    }

    /// A steady coordinated turn from the first second, for `duration_s`.
    pub fn steady_turn(speed_m_per_s: f64, bank_rad: f64, duration_s: f64) -> Self {
        Self {
            duration_s,
            speed: Signal::constant(speed_m_per_s),
            climb: Signal::constant(0.0),
            bank: Signal::constant(bank_rad),
            slip: Signal::constant(0.0),
        }
    }

    /// Straight and level at one speed.
    pub fn straight(speed_m_per_s: f64, duration_s: f64) -> Self {
        Self::steady_turn(speed_m_per_s, 0.0, duration_s)
    }

    /// The same flight with a landing after it, 40 s to a standstill: it ends at rest.
    #[must_use]
    pub fn landed(mut self) -> Self {
        let end_s = self.duration_s;
        self.speed = self.speed.clone().step(end_s, 20.0, -self.speed.at(end_s).x);
        self.duration_s += 40.0;
        self
    }

    /// Stirs the air from `from_s` on: quick sideslip, climb and speed changes of about this velocity RMS, and the bank
    /// they cause. `phase` picks one of many airs.
    #[must_use]
    pub fn with_gusts(mut self, from_s: f64, rms_m_per_s: f64, phase: f64) -> Self {
        const CRUISE_M_PER_S: f64 = 22.0;
        // Three incommensurate lines per axis, each of equal power.
        let line = rms_m_per_s * (2.0f64 / 3.0).sqrt();
        let stir = |mut signal: Signal, scale: f64, frequencies: [f64; 3], k: f64| {
            for (i, f) in frequencies.into_iter().enumerate() {
                let p = phase * (1.0 + k) + i as f64 * 2.1 + k;
                signal = signal.wave_with_phase(from_s, self.duration_s, line * scale, f, 2.0, p);
            }
            signal
        };
        self.slip = stir(self.slip.clone(), 1.0 / CRUISE_M_PER_S, [0.31, 0.73, 1.37], 0.0);
        self.climb = stir(self.climb.clone(), 0.3 / CRUISE_M_PER_S, [0.27, 0.61, 1.13], 1.0);
        self.speed = stir(self.speed.clone(), 0.3, [0.23, 0.53, 0.97], 2.0);
        self.bank = stir(self.bank.clone(), 1.0 / CRUISE_M_PER_S, [0.29, 0.67, 1.21], 3.0);
        self
    }
}

fn speed_signal() -> Signal {
    Signal::constant(0.0)
        .step(15.0, 8.0, 18.0)
        .step(52.0, 5.0, 4.0)
        .step(100.0, 4.0, 8.0)
        .step(107.0, 6.0, -13.0)
        .step(116.0, 4.0, 7.0)
        .step(236.0, 5.0, -6.0)
        .step(252.0, 5.0, 10.0)
        .step(282.0, 3.0, -8.0)
        .step(287.0, 3.0, 8.0)
        .step(292.0, 4.0, -8.0)
}

fn climb_signal() -> Signal {
    let deg = |d: f64| d.to_radians();
    Signal::constant(0.0)
        .pulse(24.0, 50.0, 3.0, deg(8.0))
        // Pull-ups and push-overs: up to 2.5 g and down to 0.2 g.
        .step(154.0, 2.0, deg(22.0))
        .step(157.0, 3.0, deg(-40.0))
        .step(161.0, 2.0, deg(18.0))
        .step(168.0, 1.6, deg(25.0))
        .step(170.5, 3.0, deg(-50.0))
        .step(174.5, 2.0, deg(25.0))
        .pulse(236.0, 247.0, 3.0, deg(9.0))
        .pulse(252.0, 262.0, 3.0, deg(-9.0))
}

fn bank_signal(sideslip: bool) -> Signal {
    let deg = |d: f64| d.to_radians();
    let bank = Signal::constant(0.0)
        .pulse(60.0, 75.0, 2.0, deg(30.0))
        .pulse(80.0, 95.0, 2.0, deg(-40.0))
        .pulse(122.0, 134.0, 2.0, deg(55.0))
        .pulse(138.0, 150.0, 2.0, deg(-55.0))
        .pulse(208.0, 218.0, 2.0, deg(45.0))
        .pulse(220.0, 230.0, 2.0, deg(-45.0))
        .pulse(268.0, 278.0, 2.0, deg(50.0));
    // The bank against a steady sideslip that keeps the course.
    if sideslip { bank.pulse(193.5, 198.5, 1.5, deg(12.0)) } else { bank }
}

fn slip_signal() -> Signal {
    let deg = |d: f64| d.to_radians();
    Signal::constant(0.0)
        .step(180.0, 1.5, deg(15.0))
        .step(186.0, 2.0, deg(-30.0))
        .step(192.0, 1.5, deg(15.0))
        .pulse(193.5, 198.5, 1.5, deg(14.0))
        .wave(200.0, 207.0, deg(12.0), 0.4, 1.0)
        .pulse(211.0, 215.0, 1.0, deg(10.0))
        .pulse(223.0, 227.0, 1.0, deg(-10.0))
        .wave(240.0, 249.0, deg(9.0), 0.3, 1.0)
        .wave(268.0, 280.0, deg(8.0), 0.35, 1.0)
}

/// A value with its time derivative.
#[derive(Clone, Copy)]
struct Dual {
    x: f64,
    d: f64,
}

impl Dual {
    fn cos(self) -> Self {
        Self { x: cos(self.x), d: -sin(self.x) * self.d }
    }
    fn sin(self) -> Self {
        Self { x: sin(self.x), d: cos(self.x) * self.d }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { x: self.x + o.x, d: self.d + o.d }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { x: -self.x, d: -self.d }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self { x: self.x * o.x, d: self.d * o.x + self.x * o.d }
    }
}

impl Mul<f64> for Dual {
    type Output = Self;
    fn mul(self, o: f64) -> Self {
        Self { x: self.x * o, d: self.d * o }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        Self { x: self.x / o.x, d: (self.d - self.x / o.x * o.d) / o.x }
    }
}

impl Scripted for FixedWing {
    fn parts(&mut self) -> ([&mut Signal; 4], &mut f64) {
        ([&mut self.speed, &mut self.climb, &mut self.bank, &mut self.slip], &mut self.duration_s)
    }
}

impl Profile for FixedWing {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(47.397_7, 8.545_6, 488.0)
    }

    fn start_course_rad(&self) -> f64 {
        60f64.to_radians()
    }

    fn motion_at(&self, t_s: f64, course_rad: f64) -> (Motion, f64) {
        let [speed, climb, bank, slip] =
            [&self.speed, &self.climb, &self.bank, &self.slip].map(|s| s.at(t_s));
        wing_motion(course_rad, &speed, &climb, &bank, &slip)
    }
}

/// Motion of an aircraft relative to the air, and its rate of course, from course, speed, climb, bank and sideslip.
pub(crate) fn wing_motion(course_rad: f64, v: &Jet, gamma: &Jet, mu: &Jet, beta: &Jet) -> (Motion, f64) {
    let first = |j: &Jet| Dual { x: j.x, d: j.d1 };
    let (speed, climb, bank, slip) = (first(v), first(gamma), first(mu), first(beta));
    let climb_rate = Dual { x: gamma.d1, d: gamma.d2 };
    // V γ̇ = L cos μ − Y sin μ − g cos γ and V cos γ χ̇ = L sin μ + Y cos μ.
    let side = -(speed * speed * slip) * SIDE_FORCE_PER_M;
    let lift = (speed * climb_rate + climb.cos() * STANDARD_GRAVITY + side * bank.sin()) / bank.cos();
    let turning = lift.x * sin(bank.x) + side.x * cos(bank.x);
    // On the ground nothing turns: bank and slip are zero there.
    let course_rate = turning / (speed.x.max(1.0) * cos(climb.x));
    let attack = lift * ATTACK / (speed * speed + Dual { x: ATTACK_SPEED_SQUARED, d: 0.0 });

    let path = Chain::new().about(2, course_rad, course_rate).about(1, climb.x, climb.d);
    let body = path.about(0, bank.x, bank.d).about(2, -slip.x, -slip.d).about(1, attack.x, attack.d);
    let velocity = Vector3::new(speed.x, 0.0, 0.0);
    let acceleration = Vector3::new(speed.d, 0.0, 0.0) + path.rate().cross(&velocity);
    let motion = Motion {
        v_n: path.matrix() * velocity,
        a_n: path.matrix() * acceleration,
        c_nb: body.matrix(),
        rate_nb: body.rate(),
    };
    (motion, course_rate)
}
