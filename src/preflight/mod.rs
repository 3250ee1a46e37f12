//! The pre-flight check: facts about a vehicle in, a table with ok, warn and stop out. Pure; the facts are gathered by
//! [`crate::mission_link::facts`].

mod fence;
mod heights;
mod limits;
mod vehicle;

pub use fence::{enforcement, fence_parameters};

use crate::mission_link::files::Contents;
use crate::mission_link::vehicle::Vehicle;
use gaware_mission::airframe::Airframe;
use gaware_mission::item::{Autopilot, LatLon};
use gaware_mission::params::{ParamName, Parameters};
use schemars::JsonSchema;
use serde::Serialize;

/// The check of whether the vehicle may be changed in its present state.
pub const STATE: &str = "state";
/// The check of where the mission would begin, which an upload sets.
pub const FIRST_ITEM: &str = "first item";

/// What a line of the table means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// To be looked at; flying is possible.
    Warn,
    /// Not to be flown like this.
    Stop,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Stop => "STOP",
        })
    }
}

/// A line of the table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Row {
    /// What was checked.
    pub check: &'static str,
    /// What came of it.
    pub verdict: Verdict,
    /// In a sentence.
    pub text: String,
}

impl Row {
    /// A line.
    pub fn new(check: &'static str, verdict: Verdict, text: impl Into<String>) -> Self {
        Self { check, verdict, text: text.into() }
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:<5} {:<14} {}", self.verdict.to_string(), self.check, self.text)
    }
}

/// A message that the estimator needs, and whether the vehicle sends it on request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamFact {
    /// Its name.
    pub name: &'static str,
    /// Whether it came.
    pub works: bool,
}

/// What is known of the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// The one that was chosen.
    pub vehicle: Vehicle,
    /// Other vehicles on the link; empty where the user has chosen.
    pub others: Vec<Vehicle>,
    /// System id of the vehicle on the screen of a run, where there is one.
    pub on_screen: Option<u8>,
    /// Where it is.
    pub position: Option<LatLon>,
    /// Major, minor and patch version of its firmware.
    pub firmware: Option<[u8; 3]>,
    /// Its parameters, as far as they were asked for.
    pub parameters: Parameters,
    /// Messages that it was asked for.
    pub streams: Vec<StreamFact>,
    /// The index of the mission item that it would go on with (`MISSION_CURRENT`).
    pub current_item: Option<u16>,
}

impl Facts {
    /// Nothing is known but the heartbeat.
    pub fn new(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            others: Vec::new(),
            on_screen: None,
            position: None,
            firmware: None,
            parameters: Parameters::default(),
            streams: Vec::new(),
            current_item: None,
        }
    }
}

/// What the vehicle is to be checked against.
#[derive(Debug, Clone, Copy, Default)]
pub struct Against<'a> {
    /// The plan.
    pub plan: Option<&'a Contents>,
    /// The airframe that it was made for.
    pub airframe: Option<&'a Airframe>,
}

/// The whole table, before every flight and every upload. The airframe that the plan names counts where no other one is given.
pub fn check(facts: &Facts, against: Against<'_>) -> Vec<Row> {
    let of_plan = against.plan.and_then(|p| p.airframe.as_ref());
    let against = Against { airframe: against.airframe.or(of_plan), ..against };
    let mut rows = vehicle::check(facts, against);
    rows.extend(limits::check(facts, against));
    rows.extend(against.plan.and_then(|plan| vehicle::current_item(facts, plan)));
    rows.extend(fence::check(facts, against));
    rows.extend(against.plan.into_iter().flat_map(heights::check));
    rows
}

/// The parameters that [`check`] looks at.
pub fn parameters(autopilot: Autopilot) -> Vec<ParamName> {
    let mut names = fence_parameters(autopilot);
    match autopilot {
        Autopilot::ArduPilot => names.extend(valid(limits::ARDUPILOT)),
        Autopilot::Px4 => {
            names.extend(valid(limits::PX4_MISSION));
            names.extend(valid(limits::PX4));
        }
    }
    names
}

fn valid(names: &[&str]) -> Vec<ParamName> {
    names.iter().filter_map(|n| n.parse().ok()).collect()
}

#[cfg(test)]
mod tests;
