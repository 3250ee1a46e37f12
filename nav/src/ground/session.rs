//! The ground session: which side next, for how long, and what each side has brought.
//!
//! A static multi-position test (IEEE 1293, section 12.3.1; Titterton & Weston 2004, section 8.3) done by hand: six sides in any order, each held
//! still until its mean rate is known, and turns between them for scale factors and axes. A pure state machine: looks at the motion in,
//! instructions out.

use crate::earth::STANDARD_GRAVITY;
use nalgebra::Vector3;

/// A side is recognised within this angle, rad.
const NEAR: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Wanted of the mean rate of a side, rad/s: two sides with it give an element of G to 6 deg/h/g; with the noise of the standard model that is
/// half a minute. Six sides of 45 s gave 5 to 15 deg/h/g on recordings (`tests/ground`).
const RATE_SIGMA: f64 = 8.0 / 3600.0 * std::f64::consts::PI / 180.0;
/// A side is held for at least and at most so long, s: shorter means see nothing of rounding that dithers, longer ones a warming sensor.
const HOLD_S: (f64, f64) = (12.0, 45.0);
/// Hands that do not come to rest on a side within this time are told so, s.
const IMPATIENT_S: f64 = 8.0;
/// A turn counts beyond this rate, rad/s.
const TURNING: f64 = 0.15;
/// Beyond this rate, rad/s, nobody is trying to hold it still.
const HOLDING: f64 = 0.5;
/// Each axis is turned by so much in all, rad: half a turn shows 0.3 % of scale as half a degree, which gravity measures to a tenth.
const TURN: f64 = std::f64::consts::PI;
/// Looks further apart than this are an interruption, s.
const GAP_S: f64 = 2.0;

/// A side of the vehicle that points down, or how it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// As it flies.
    Level,
    /// Nose to the sky.
    NoseUp,
    /// Nose to the ground.
    NoseDown,
    /// On its right side.
    RightSide,
    /// On its left side.
    LeftSide,
    /// On its back.
    UpsideDown,
}

impl Side {
    /// All six, in the order in which they are asked for.
    pub const ALL: [Self; 6] =
        [Self::Level, Self::NoseUp, Self::NoseDown, Self::RightSide, Self::LeftSide, Self::UpsideDown];

    /// The specific force of a unit at rest on this side, in gravities.
    pub fn force(self) -> Vector3<f64> {
        match self {
            Self::Level => -Vector3::z(),
            Self::NoseUp => Vector3::x(),
            Self::NoseDown => -Vector3::x(),
            Self::RightSide => -Vector3::y(),
            Self::LeftSide => Vector3::y(),
            Self::UpsideDown => Vector3::z(),
        }
    }

    /// The side on which a specific force stands, m/s²; none in between.
    pub fn of_force(force: &Vector3<f64>) -> Option<Self> {
        let along = |s: &Self| s.force().dot(force) / force.norm().max(1e-9);
        let near = |s: &Self| along(s) > NEAR.cos() && (force.norm() - STANDARD_GRAVITY).abs() < 1.0;
        Self::ALL.into_iter().find(near)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::NoseUp => "nose up",
            Self::NoseDown => "nose down",
            Self::RightSide => "on its right side",
            Self::LeftSide => "on its left side",
            Self::UpsideDown => "upside down",
        }
    }
}

/// One look at the vehicle.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// When, s.
    pub t_s: f64,
    /// Specific force without its noise, m/s².
    pub force: Vector3<f64>,
    /// Rate without its noise, rad/s.
    pub rate: Vector3<f64>,
    /// Whether it is held as stationary.
    pub stationary: bool,
    /// White noise of the gyros, (rad/s)²/Hz.
    pub noise: f64,
    /// The largest sigma of an element of G, deg/h/g.
    pub g_sigma_deg_per_h_per_g: f64,
}

/// What one side has brought so far.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SideState {
    /// Which.
    pub side: Side,
    /// For how long it was held, s.
    pub held_s: f64,
    /// Whether that is enough.
    pub done: bool,
    /// Whether the vehicle cannot stand so.
    pub skipped: bool,
    /// The largest sigma of an element of G before and after, deg/h/g.
    pub g_sigma_deg_per_h_per_g: Option<[f64; 2]>,
}

/// What is asked for now.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Instruction {
    /// Nothing has come yet.
    #[default]
    Wait,
    /// Put it on this side.
    Turn {
        /// Which.
        side: Side,
    },
    /// Hold it as it is.
    Hold {
        /// Which.
        side: Side,
        /// For so long, s.
        seconds_left: f64,
    },
    /// It stands on a side, but hands shake.
    TooMuchMotion {
        /// Which.
        side: Side,
    },
    /// This side is done; another is wanted.
    AlreadyDone {
        /// Which.
        side: Side,
        /// Which next.
        next: Side,
    },
    /// Turn it about an axis: 0 roll, 1 pitch, 2 yaw.
    TurnAbout {
        /// Which axis.
        axis: usize,
    },
    /// Everything is done.
    Done,
}

impl Instruction {
    /// The kind alone: seconds that pass make no other instruction.
    pub fn same_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Hold { side: a, .. }, Self::Hold { side: b, .. }) => a == b,
            _ => self == other,
        }
    }

    /// In words; one sentence.
    pub fn words(&self) -> String {
        match self {
            Self::Wait => "Waiting for inertial samples".to_owned(),
            Self::Turn { side } => format!("Turn the vehicle {}", side.words()),
            Self::Hold { side, seconds_left } => {
                format!("Hold still {}: {seconds_left:.0} s", side.words())
            }
            Self::TooMuchMotion { side } => {
                format!("Too much motion {}: support the vehicle", side.words())
            }
            Self::AlreadyDone { side, next } => {
                format!("Already done {}: turn it {}", side.words(), next.words())
            }
            Self::TurnAbout { axis } => {
                let axis = ["roll", "pitch", "yaw"].get(*axis).copied().unwrap_or("yaw");
                format!("Turn the vehicle once around its {axis} axis, then hold it still")
            }
            Self::Done => "Ground session done".to_owned(),
        }
    }
}

/// The session.
#[derive(Debug, Clone)]
pub struct Session {
    sides: [SideState; 6],
    turned: [f64; 3],
    last_s: Option<f64>,
    /// The side under way, since when hands try, and the sigma of G before it.
    under_way: Option<(Side, f64, f64)>,
    interruptions: u32,
    instruction: Instruction,
    began_s: Option<f64>,
    done_s: Option<f64>,
}

impl Default for Session {
    fn default() -> Self {
        let fresh = |side| SideState {
            side,
            held_s: 0.0,
            done: false,
            skipped: false,
            g_sigma_deg_per_h_per_g: None,
        };
        Self {
            sides: Side::ALL.map(fresh),
            turned: [0.0; 3],
            last_s: None,
            under_way: None,
            interruptions: 0,
            instruction: Instruction::default(),
            began_s: None,
            done_s: None,
        }
    }
}

impl Session {
    /// Leaves a side out that this vehicle cannot stand on.
    pub fn skip(&mut self, side: Side) {
        self.sides.iter_mut().filter(|s| s.side == side).for_each(|s| s.skipped = true);
    }

    /// What each side has brought.
    pub fn sides(&self) -> &[SideState; 6] {
        &self.sides
    }

    /// How far it was turned about its axes in all, rad.
    pub fn turned(&self) -> [f64; 3] {
        self.turned
    }

    /// What is asked for.
    pub fn instruction(&self) -> Instruction {
        self.instruction
    }

    /// Holds that ended before they were enough.
    pub fn interruptions(&self) -> u32 {
        self.interruptions
    }

    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        self.done_s.is_some()
    }

    /// From the first look to the end, or until now, s.
    pub fn duration_s(&self) -> f64 {
        let end = self.done_s.or(self.last_s);
        self.began_s.zip(end).map_or(0.0, |(from, to)| to - from)
    }

    /// Seconds that a side must be held for with this noise, (rad/s)²/Hz: by what its mean rate is then known to.
    pub fn wanted_s(noise: f64) -> f64 {
        (noise / (RATE_SIGMA * RATE_SIGMA)).clamp(HOLD_S.0, HOLD_S.1)
    }

    /// Takes a look at the vehicle.
    pub fn look(&mut self, look: &Look) {
        self.began_s.get_or_insert(look.t_s);
        let dt = self.last_s.replace(look.t_s).map_or(0.0, |last| look.t_s - last);
        if !(0.0..GAP_S).contains(&dt) {
            self.interrupt();
            return;
        }
        let side = Side::of_force(&look.force).filter(|_| look.rate.norm() < HOLDING);
        if let Some((held, ..)) = self.under_way
            && side != Some(held)
        {
            self.interrupt();
        }
        if !look.stationary {
            for (turned, rate) in self.turned.iter_mut().zip(look.rate.iter()) {
                *turned += if rate.abs() > TURNING { rate.abs() * dt } else { 0.0 };
            }
        }
        self.instruction = match side {
            Some(side) => self.on_side(side, look, dt),
            None => self.next(None),
        };
        if self.instruction == Instruction::Done {
            self.done_s.get_or_insert(look.t_s);
        }
    }

    /// A hold that ends too early keeps what it has.
    fn interrupt(&mut self) {
        if let Some((side, ..)) = self.under_way.take()
            && self.sides.iter().any(|s| s.side == side && !s.done && s.held_s > 0.0)
        {
            self.interruptions += 1;
        }
    }

    fn on_side(&mut self, side: Side, look: &Look, dt: f64) -> Instruction {
        let (_, since_s, before) =
            *self.under_way.get_or_insert((side, look.t_s, look.g_sigma_deg_per_h_per_g));
        let Some(state) = self.sides.iter_mut().find(|s| s.side == side) else { return Instruction::Wait };
        if look.stationary {
            state.held_s += dt;
        }
        if state.held_s > 0.0 {
            let first = state.g_sigma_deg_per_h_per_g.map_or(before, |[first, _]| first);
            state.g_sigma_deg_per_h_per_g = Some([first, look.g_sigma_deg_per_h_per_g]);
        }
        let seconds_left = Self::wanted_s(look.noise) - state.held_s;
        if state.done || seconds_left <= 0.0 {
            state.done = true;
            return self.next(Some(side));
        }
        if !look.stationary && look.t_s - since_s > IMPATIENT_S {
            return Instruction::TooMuchMotion { side };
        }
        Instruction::Hold { side, seconds_left }
    }

    /// What comes next for a vehicle that stands on a side that is done, or between sides.
    fn next(&self, on: Option<Side>) -> Instruction {
        let next = self.sides.iter().find(|s| !s.done && !s.skipped).map(|s| s.side);
        let axis = (0..3).find(|k| self.turned.get(*k).is_some_and(|t| *t < TURN));
        match (next, on, axis) {
            (Some(next), Some(side), _) => Instruction::AlreadyDone { side, next },
            (Some(side), None, _) => Instruction::Turn { side },
            (None, _, Some(axis)) => Instruction::TurnAbout { axis },
            // The turn that is last is measured by the rest after it.
            (None, None, None) => self.instruction,
            (None, Some(_), None) => Instruction::Done,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: f64 = 2e-8;

    /// Stands on a side for so long, or turns toward it at this rate, rad/s.
    fn play(session: &mut Session, t_s: &mut f64, side: Side, for_s: f64, rate: Vector3<f64>) {
        let end = *t_s + for_s;
        let began = *t_s;
        while *t_s < end {
            let turning = rate.norm() > 0.0;
            let force = if turning { Vector3::new(5.0, 5.0, -5.0) } else { side.force() * STANDARD_GRAVITY };
            let stationary = !turning && *t_s - began > 5.0;
            session.look(&Look {
                t_s: *t_s,
                force,
                rate,
                stationary,
                noise: NOISE,
                g_sigma_deg_per_h_per_g: 10.0,
            });
            *t_s += 0.1;
        }
    }

    fn turn(session: &mut Session, t_s: &mut f64, axis: usize) {
        play(session, t_s, Side::Level, 3.0, Vector3::ith(axis, 0.8));
    }

    #[test]
    fn sides_are_recognised_within_twenty_degrees_and_not_beyond() {
        for side in Side::ALL {
            for (degrees, wanted) in [(0.0, true), (18.0, true), (24.0, false)] {
                let f64_degrees: f64 = degrees;
                let across = if side.force().x.abs() > 0.5 { Vector3::y() } else { Vector3::x() };
                let (sin, cos) = f64_degrees.to_radians().sin_cos();
                let force = (side.force() * cos + across * sin) * STANDARD_GRAVITY;
                assert_eq!(Side::of_force(&force) == Some(side), wanted, "{side:?} {degrees}");
            }
        }
        assert_eq!(Side::of_force(&Vector3::new(0.0, 0.0, -14.0)), None);
    }

    #[test]
    fn six_sides_in_any_order_and_a_turn_about_each_axis_end_it() {
        let (mut session, mut t_s) = (Session::default(), 0.0);
        let order = [3, 0, 5, 1, 4, 2];
        for (n, k) in order.into_iter().enumerate() {
            play(&mut session, &mut t_s, Side::ALL[k], 60.0, Vector3::zeros());
            assert!(session.sides()[k].done, "{k}");
            // Roll and pitch are turned on the way from side to side.
            turn(&mut session, &mut t_s, n % 2);
        }
        assert_eq!(session.instruction(), Instruction::TurnAbout { axis: 2 });
        turn(&mut session, &mut t_s, 2);
        turn(&mut session, &mut t_s, 2);
        assert!(!session.is_done(), "the turn is measured by the rest after it");
        play(&mut session, &mut t_s, Side::Level, 6.0, Vector3::zeros());
        assert!(session.is_done());
    }

    #[test]
    fn a_side_that_is_done_is_not_asked_for_again() {
        let (mut session, mut t_s) = (Session::default(), 0.0);
        play(&mut session, &mut t_s, Side::Level, 60.0, Vector3::zeros());
        let Instruction::AlreadyDone { side, next } = session.instruction() else {
            panic!("{:?}", session.instruction())
        };
        assert_eq!((side, next), (Side::Level, Side::NoseUp));
    }

    #[test]
    fn seconds_left_follow_the_noise_and_not_the_clock() {
        let (quiet, loud) = (Session::wanted_s(2.5e-9), Session::wanted_s(2e-8));
        assert!(quiet < loud && quiet >= HOLD_S.0 && loud <= HOLD_S.1, "{quiet} {loud}");
        let (mut session, mut t_s) = (Session::default(), 0.0);
        play(&mut session, &mut t_s, Side::NoseUp, 10.0, Vector3::zeros());
        let Instruction::Hold { side, seconds_left } = session.instruction() else {
            panic!("{:?}", session.instruction())
        };
        assert_eq!(side, Side::NoseUp);
        assert!((seconds_left - (Session::wanted_s(NOISE) - 5.0)).abs() < 0.3, "{seconds_left}");
    }

    #[test]
    fn hands_that_shake_are_told_and_an_interruption_keeps_what_there_is() {
        let (mut session, mut t_s) = (Session::default(), 0.0);
        let shaky = |session: &mut Session, t_s: &mut f64| {
            for _ in 0..120 {
                let force = Side::NoseDown.force() * STANDARD_GRAVITY;
                let rate = Vector3::new(0.05, 0.0, 0.0);
                let look = Look {
                    t_s: *t_s,
                    force,
                    rate,
                    stationary: false,
                    noise: NOISE,
                    g_sigma_deg_per_h_per_g: 10.0,
                };
                session.look(&look);
                *t_s += 0.1;
            }
        };
        shaky(&mut session, &mut t_s);
        assert_eq!(session.instruction(), Instruction::TooMuchMotion { side: Side::NoseDown });
        play(&mut session, &mut t_s, Side::NoseDown, 10.0, Vector3::zeros());
        turn(&mut session, &mut t_s, 1);
        let held_s = session.sides()[2].held_s;
        assert!(held_s > 4.0 && !session.sides()[2].done && session.interruptions() == 1);
        t_s += 30.0;
        play(&mut session, &mut t_s, Side::NoseDown, 60.0, Vector3::zeros());
        assert!(session.sides()[2].done);
    }

    #[test]
    fn a_vehicle_that_cannot_lie_on_its_back_is_done_without() {
        let (mut session, mut t_s) = (Session::default(), 0.0);
        session.skip(Side::UpsideDown);
        for side in &Side::ALL[..5] {
            play(&mut session, &mut t_s, *side, 60.0, Vector3::zeros());
            (0..3).for_each(|k| turn(&mut session, &mut t_s, k));
        }
        play(&mut session, &mut t_s, Side::Level, 8.0, Vector3::zeros());
        assert!(session.is_done(), "{:?}", session.instruction());
    }
}
