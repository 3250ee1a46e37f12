//! The ground session: which side next, for how long, and what each side has brought.
//!
//! A static multi-position test (IEEE 1293, section 12.3.1; Titterton & Weston 2004, section 8.3) done by hand: six sides, each held still until its
//! mean rate is known, and quarter turns between them, whose angles gravity measures, for scale factors and axes of the gyros (Tedaldi, Pretto &
//! Menegatti 2014). As long as those are wide the sides are asked for in the order of such turns: once around the pitch axis, once around the roll axis, and
//! on its side once around the yaw axis. Any other order counts as well. A pure state machine: looks at the motion in, instructions out.

mod turns;

use crate::earth::STANDARD_GRAVITY;
use crate::math::cos;
use nalgebra::Vector3;
use turns::Turns;

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
/// Where turns are wanted each side comes again, and is held for this share of its time at once …
const VISIT: f64 = 0.5;
/// … and where it needs no more time, so long, s, for gravity to measure the turn before and the one after.
const BETWEEN_TURNS_S: f64 = 8.0;
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
        let near = |s: &Self| along(s) > cos(NEAR) && (force.norm() - STANDARD_GRAVITY).abs() < 1.0;
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
    /// What turns about each axis show of the gyros: its sigma as a share of the one wanted. Beyond one, turns are asked for.
    pub turn_sigma: [f64; 3],
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
    /// Turn it about an axis by a quarter: 0 roll, 1 pitch, 2 yaw.
    TurnAbout {
        /// Which axis.
        axis: usize,
        /// To this side.
        side: Side,
    },
    /// Everything is done.
    Done,
}

impl Instruction {
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
            Self::TurnAbout { axis, side } => {
                let axis = ["roll", "pitch", "yaw"].get(*axis).copied().unwrap_or("yaw");
                format!("Turn the vehicle around its {axis} axis: {}", side.words())
            }
            Self::Done => "Ground session done".to_owned(),
        }
    }
}

/// A side under way.
#[derive(Debug, Clone, Copy)]
struct Visit {
    side: Side,
    /// Since when hands try, s.
    since_s: f64,
    /// For how long it has been still, s.
    held_s: f64,
    /// The sigma of G before it.
    before: f64,
}

/// The session.
#[derive(Debug, Clone)]
pub struct Session {
    sides: [SideState; 6],
    turns: Turns,
    turn_sigma: [f64; 3],
    last_s: Option<f64>,
    under_way: Option<Visit>,
    /// Where the vehicle should go.
    aim: Option<Instruction>,
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
            turns: Turns::default(),
            turn_sigma: [0.0; 3],
            last_s: None,
            under_way: None,
            aim: None,
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
        self.turns.turned()
    }

    /// What turns about each axis show: its sigma as a share of the one wanted.
    pub fn turn_sigma(&self) -> [f64; 3] {
        self.turn_sigma
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
        if let Some(visit) = self.under_way
            && side != Some(visit.side)
        {
            self.interrupt();
        }
        self.turn_sigma = look.turn_sigma;
        if !look.stationary {
            self.turns.turn(&look.rate.map(|rate| if rate.abs() > TURNING { rate * dt } else { 0.0 }));
        }
        self.instruction = match side {
            Some(side) => self.on_side(side, look, dt),
            None => self.between(),
        };
        if self.instruction == Instruction::Done {
            self.done_s.get_or_insert(look.t_s);
        }
    }

    /// A hold that ends too early keeps what it has.
    fn interrupt(&mut self) {
        if let Some(visit) = self.under_way.take()
            && self.aim.is_none()
            && visit.held_s > 0.0
        {
            self.interruptions += 1;
        }
    }

    /// Whether the vehicle can stand on a side.
    fn can(&self, side: Side) -> bool {
        self.sides.iter().any(|s| s.side == side && !s.skipped)
    }

    /// About which axes turns are wanted.
    fn wanted(&self) -> [bool; 3] {
        std::array::from_fn(|k| self.turn_sigma[k] > 1.0 && self.turns.asks(k, &|side| self.can(side)))
    }

    fn on_side(&mut self, side: Side, look: &Look, dt: f64) -> Instruction {
        let turns = self.wanted().contains(&true);
        let before = look.g_sigma_deg_per_h_per_g;
        let visit = self.under_way.get_or_insert(Visit { side, since_s: look.t_s, held_s: 0.0, before });
        let Some(state) = self.sides.iter_mut().find(|s| s.side == side) else { return Instruction::Wait };
        if look.stationary {
            state.held_s += dt;
            visit.held_s += dt;
            self.turns.arrive(side);
            self.aim = None;
        } else if let Some(aim) = self.aim.filter(|_| visit.held_s > 0.0) {
            // It does what it was asked for: the turn is no motion of this side.
            return aim;
        }
        if state.held_s > 0.0 {
            let first = state.g_sigma_deg_per_h_per_g.map_or(visit.before, |[first, _]| first);
            state.g_sigma_deg_per_h_per_g = Some([first, look.g_sigma_deg_per_h_per_g]);
        }
        let wanted_s = Self::wanted_s(look.noise);
        let mut seconds_left = wanted_s - state.held_s;
        state.done |= seconds_left <= 0.0;
        if turns {
            let whole_s = (VISIT * wanted_s).max(HOLD_S.0);
            seconds_left = (seconds_left + visit.held_s).clamp(BETWEEN_TURNS_S, whole_s) - visit.held_s;
        }
        if seconds_left <= 0.0 {
            let next = self.next(side);
            self.aim = Some(next);
            return next;
        }
        if !look.stationary && look.t_s - visit.since_s > IMPATIENT_S {
            return Instruction::TooMuchMotion { side };
        }
        Instruction::Hold { side, seconds_left }
    }

    /// What is asked for of a vehicle between two sides.
    fn between(&self) -> Instruction {
        let undone =
            || self.sides.iter().find(|s| !s.done && !s.skipped).map(|s| Instruction::Turn { side: s.side });
        self.aim.or_else(undone).unwrap_or(self.instruction)
    }

    /// What comes after a hold on this side.
    fn next(&self, side: Side) -> Instruction {
        let (wanted, can) = (self.wanted(), |side: Side| self.can(side));
        if let Some((axis, side)) = self.turns.next(side, wanted, &can) {
            return Instruction::TurnAbout { axis, side };
        }
        if let Some(side) = self.turns.side_for(wanted, &can) {
            return Instruction::Turn { side };
        }
        let undone = self.sides.iter().find(|s| !s.done && !s.skipped);
        undone.map_or(Instruction::Done, |next| Instruction::AlreadyDone { side, next: next.side })
    }
}

#[cfg(test)]
mod tests;
