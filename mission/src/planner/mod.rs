//! The planner: which maneuvers, where and in which order, make the states known soonest, and nothing unsafe among them.
//!
//! A beam search over maneuvers at places inside the fence. Every candidate is flown by the predicted vehicle in the wind given
//! and in others near it; only what stays inside the limits, and from which the hold at the end can still be
//! reached in time, is a candidate at all. Sigmas come from a [`Predictor`], so the search itself knows no filter.

mod landing;
mod outcome;
mod place;
mod search;
mod take_off;

use crate::airframe::Airframe;
use crate::fence::LocalFrame;
use crate::flight::FlightError;
use crate::item::{Home, LatLon, Mission};
use crate::kinematics::Kinematics;
use crate::maneuver::Maneuver;
use crate::predictor::{NamedSigma, Predictor};
use crate::safety::{Limits, Refusal};
use gaware_nav::math::sin_cos;
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Gives every kind of maneuver a chance to be the first: a plan of five minutes then takes seconds.
pub const DEFAULT_BEAM: usize = 9;

/// Share of the best climb rate that a take-off reaches on average.
pub const CLIMB_OUT_SHARE: f64 = 0.8;

/// What to plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// What flies.
    pub airframe: Airframe,
    /// Home: heights count from here.
    pub home: Home,
    /// Whether the mission begins on the ground at home with a take-off; `start` is then where its climb ends, see
    /// [`climb_out`].
    pub take_off: bool,
    /// Whether a fixed wing lands at home after its last maneuver, where there is space for that; otherwise it holds. On PX4 a fixed
    /// wing always lands, or there is no plan. A multirotor always holds: it lands where it is commanded.
    pub landing: bool,
    /// Where the vehicle is when the maneuvers begin.
    pub start: LatLon,
    /// Height above home there, m.
    pub start_height_m: f64,
    /// Course there, deg.
    pub start_heading_deg: f64,
    /// Fence, floor, ceiling, wind.
    pub limits: Limits,
    /// Most time from the start to the arrival at the hold at the end, s.
    pub budget_s: f64,
    /// Ends as soon as everything is known that can be and what stays short of its target hardly gets better; otherwise the rest of the time goes to that.
    pub within_reach_only: bool,
    /// Time between fixes, s.
    pub fix_interval_s: f64,
    /// Plans that are followed up at the same time; 1 is greedy, [`DEFAULT_BEAM`] is usual.
    pub beam: usize,
}

/// One maneuver of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedManeuver {
    /// Which.
    pub maneuver: Maneuver,
    /// Begin of its first item (the way there included), s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// Its items, counted from 1 as on the vehicle.
    pub items: std::ops::RangeInclusive<usize>,
}

/// What the maneuvers of an airframe can do with a state in the time there is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reach {
    /// Make it known.
    Known,
    /// Excite it, but not enough to reach the target.
    Short,
    /// Nothing.
    #[serde(rename = "dark")]
    Unobservable,
}

/// What a plan promises for one state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedState {
    /// `bg_x`, `g11`, …
    pub name: String,
    /// Unit of screens.
    pub unit: String,
    /// 1-sigma at the end of the plan.
    pub sigma: f64,
    /// Sigma below which the state is known.
    pub target: f64,
    /// What was possible.
    pub reach: Reach,
}

/// Predicted sigma over target up to which a state is promised: the flight is never quite the one that was predicted, and a sigma
/// that is reached within a quarter still meets its target.
pub const PROMISED_SHARE: f64 = 0.8;

impl PlannedState {
    /// Whether the plan itself makes it known, with a reserve for the difference between plan and flight.
    pub fn known(&self) -> bool {
        self.sigma <= PROMISED_SHARE * self.target
    }
}

/// Predicted sigmas at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct SigmasAt {
    /// Time since the start of the mission, s.
    pub t_s: f64,
    /// All constant states.
    pub sigmas: Vec<NamedSigma>,
}

/// A plan: safe within the limits it was made for.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Home and items; the last one holds, or lands if that was asked for.
    pub mission: Mission,
    /// In order.
    pub maneuvers: Vec<PlannedManeuver>,
    /// Over time, about once per second.
    pub sigmas: Vec<SigmasAt>,
    /// The predicted flight in the wind given.
    pub path: Vec<Kinematics>,
    /// The frame of the path.
    pub frame: LocalFrame,
    /// When the hold at the end is reached or the vehicle has landed, s.
    pub duration_s: f64,
    /// Per constant state what the plan promises.
    pub states: Vec<PlannedState>,
    /// What the user should know: states that this flight leaves unobservable, settings of the autopilot.
    pub notes: Vec<String>,
}

impl Plan {
    /// The states that it makes known.
    pub fn promised(&self) -> impl Iterator<Item = &PlannedState> {
        self.states.iter().filter(|s| s.known())
    }

    /// What it promises, in a sentence.
    pub fn summary(&self) -> String {
        let names: Vec<&str> = self.promised().map(|s| s.name.as_str()).collect();
        let (duration_s, all) = (self.duration_s, self.states.len());
        let predicted = match names.len() {
            0 => format!("none of {all} states will have converged"),
            n if n == all => format!("all {all} states will have converged"),
            n => format!("{n} of {all} states will have converged: {}", names.join(", ")),
        };
        format!("The planned mission takes {duration_s:.0} s; by its end {predicted}")
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A request with values that are no numbers, or a budget of nothing.
    #[error("{0}")]
    Request(&'static str),
    /// The limits themselves, or the start.
    #[error("no plan: {0}")]
    Limits(#[from] Refusal),
    /// The way from home to the start after a take-off.
    #[error(
        "no plan: the climb after take-off, {length_m:.0} m straight ahead, comes {by_m:.0} m too close to the fence or leaves it; take off in another direction, begin lower, or widen the fence"
    )]
    ClimbOut {
        /// Length of the climb, m.
        length_m: f64,
        /// m.
        by_m: f64,
    },
    /// Home.
    #[error("no plan: home itself is {by_m:.0} m too close to the fence or outside it{hint}")]
    HomeOutside {
        /// m.
        by_m: f64,
        /// What may be wrong.
        hint: &'static str,
    },
    /// Not one maneuver fits into the time.
    #[error("no plan: {budget_s:.0} s are too short for any maneuver; allow more time")]
    NoTime {
        /// s.
        budget_s: f64,
    },
    /// The hold at the end cannot be reached safely.
    #[error("no plan: the hold at the end cannot be reached safely from the start: {0}")]
    NoWayHome(String),
    /// PX4 rejects the mission of a fixed wing without a landing (`MIS_TKO_LAND_REQ` 2).
    #[error(
        "no plan: PX4 starts no mission of a fixed wing without a landing, and none fits: {0}; widen the fence, lower the floor, or choose another home"
    )]
    NoLanding(String),
    /// Not one maneuver fits.
    #[error("no plan: not one maneuver fits; {}", .reasons.join("; "))]
    NothingFits {
        /// Per maneuver the reason of its best try.
        reasons: Vec<String>,
    },
}

/// Why one candidate is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
enum Rejection {
    #[error(transparent)]
    NoSpace(#[from] crate::maneuver::NoSpace),
    #[error(transparent)]
    Unsafe(#[from] Refusal),
    #[error(transparent)]
    NotPredicted(#[from] FlightError),
    /// Two equal ones have been flown, and a third gains less than a tenth; or nothing of a sensor gets better by a twentieth.
    #[error("it brings little beyond what is flown before it")]
    InVain,
}

impl Rejection {
    /// Whether only time is short.
    fn is_late(&self) -> bool {
        matches!(self, Self::NotPredicted(FlightError::OutOfTime { .. }))
    }
}

/// Where a take-off from home on this course ends at the latest: a multirotor goes straight up, a fixed wing rolls, gathers
/// speed and climbs straight ahead at no more than [`CLIMB_OUT_SHARE`] of its best rate.
pub fn climb_out(
    airframe: &Airframe,
    home: Home,
    heading_deg: f64,
    height_m: f64,
    wind_ned: &Vector3<f64>,
) -> LatLon {
    if !airframe.is_fixed_wing() {
        return home.place();
    }
    let (s, c) = sin_cos(heading_deg.to_radians());
    let course = Vector2::new(c, s);
    let cruise = airframe.speed_cruise_m_per_s;
    let ground = (cruise + wind_ned.xy().dot(&course)).max(1.0);
    let roll = cruise * cruise / (2.0 * airframe.acceleration_m_per_s2);
    let seconds = height_m / (CLIMB_OUT_SHARE * airframe.climb_max_m_per_s);
    LocalFrame::new(home.place()).to_place(course * (roll + ground * seconds))
}

/// Plans.
///
/// # Errors
/// A request that cannot be met safely; the reason is in the error.
pub fn plan<P: Predictor>(request: &Request, predictor: P) -> Result<Plan, PlanError> {
    let finite = [request.start_height_m, request.start_heading_deg, request.budget_s];
    if finite.iter().any(|v| !v.is_finite()) || !request.start.is_valid() {
        return Err(PlanError::Request("start and time budget must be numbers on the Earth"));
    }
    if request.budget_s <= 0.0 || request.fix_interval_s.is_nan() || request.fix_interval_s <= 0.0 {
        return Err(PlanError::Request("time budget and fix interval must be positive"));
    }
    search::Search::new(request)?.run(predictor)
}

/// Radii are tried up to so many times the one that is too small, in steps of this factor.
const RADII: (f64, f64) = (12.0, 1.15);

/// The least radius of a circle, in steps of 50 m, inside which at least one maneuver fits, where that of the request is too small.
pub fn radius_that_fits<P: Predictor>(request: &Request, predictor: P) -> Option<f64> {
    let radius_m = request.limits.fence.circles.first()?.radius_m;
    let radii = std::iter::successors(Some(radius_m * RADII.1), |r| Some(r * RADII.1));
    let mut rounded = radii.map(|r| (r / 50.0).ceil() * 50.0).take_while(|r| *r <= RADII.0 * radius_m);
    rounded.find(|radius_m| {
        let mut wider = request.clone();
        wider.limits.fence.circles.iter_mut().for_each(|c| c.radius_m = *radius_m);
        search::Search::new(&wider).is_ok_and(|search| search.begins(predictor.clone()))
    })
}

#[cfg(test)]
mod tests;
