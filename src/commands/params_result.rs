//! How an action on parameters ended, in words for people and as a document for machines.

use super::params::ParamsError;
use crate::advice::rule_free;
use crate::mission_link::param_delivery::mapping;
use gaware_mission::item::Autopilot;
use gaware_mission::params::apply::{ApplyOutcome, Doubtful};
use gaware_mission::params::{ParamName, ParamType, ParamValue};
use serde::Serialize;
use std::path::PathBuf;

/// What was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// `gaware params show`.
    Show,
    /// `gaware params backup`.
    Backup,
    /// `gaware params apply`.
    Apply,
    /// `gaware params restore`.
    Restore,
}

/// What is on the vehicle now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnVehicle {
    /// Nothing was changed.
    Unchanged,
    /// Every new value, read back and compared.
    New,
    /// Every old value, read back and compared, or never touched.
    Previous,
    /// Some of each, or not known: see `values`.
    Mixed,
}

impl OnVehicle {
    /// As a change reports.
    pub fn of(outcome: &ApplyOutcome) -> Self {
        match outcome {
            ApplyOutcome::Verified { .. } => Self::New,
            ApplyOutcome::Previous { .. } => Self::Previous,
            ApplyOutcome::Mixed { .. } => Self::Mixed,
        }
    }
}

/// A parameter with its meaning for this program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shown {
    /// Parameter.
    pub name: String,
    /// Value on board.
    pub value: f64,
    /// Its type.
    #[serde(rename = "type")]
    pub kind: String,
    /// The effect that it corrects, by its name in explain.
    pub corrects: Option<&'static str>,
    /// Unit, where this program knows it.
    pub unit: Option<&'static str>,
    /// Documented range.
    pub range: Option<(f64, f64)>,
    /// Whether it counts only after a reboot.
    pub reboot: Option<bool>,
}

impl Shown {
    /// A value that was read.
    pub fn new(name: ParamName, value: ParamValue, autopilot: Autopilot) -> Self {
        let mapping = mapping(name.as_str(), autopilot);
        // Single-precision values read as they were written.
        let single = (value.value as f32).to_string().parse().unwrap_or(value.value);
        Self {
            name: name.to_string(),
            value: if value.kind == ParamType::Real32 { single } else { value.value },
            kind: value.kind.to_string(),
            corrects: mapping.map(|m| m.effect),
            unit: mapping.map(|m| m.unit),
            range: mapping.and_then(|m| m.range),
            reboot: mapping.map(|m| m.reboot),
        }
    }
}

impl std::fmt::Display for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value = format!("{} {}", rule_free(self.value), self.unit.unwrap_or_default());
        write!(f, "{:<17} {:<16}", self.name, value)?;
        if let Some(effect) = self.corrects {
            write!(f, "corrects {effect}")?;
        }
        if let Some((low, high)) = self.range {
            write!(f, ", {low} to {high}")?;
        }
        if self.reboot == Some(true) {
            write!(f, ", after a reboot")?;
        }
        Ok(())
    }
}

/// The end of an action (`gaware.params/1`).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParamsResult {
    /// `gaware.params/1`.
    pub schema: &'static str,
    /// What was asked for.
    pub action: Action,
    /// Whether that is what came of it; the exit status says the same.
    pub done: bool,
    /// What is on the vehicle now.
    pub on_vehicle: OnVehicle,
    /// Parameters whose value is another one than before.
    pub changed: Option<usize>,
    /// Whether the autopilot has to be rebooted for all of them to count.
    pub reboot_due: bool,
    /// Parameters read.
    pub count: Option<usize>,
    /// PX4's hash of them.
    pub hash: Option<u32>,
    /// The parameters, for `show`.
    pub parameters: Option<Vec<Shown>>,
    /// Which value is which, where it is neither set.
    pub values: Option<Vec<Doubtful>>,
    /// Where parameters that were read are now.
    pub file: Option<PathBuf>,
    /// Where the old values are.
    pub backup: Option<PathBuf>,
    /// Journal from which `gaware params restore` goes on.
    pub journal: Option<PathBuf>,
    /// The same in a sentence.
    pub text: String,
}

impl ParamsResult {
    /// An action with no more to report than this.
    pub fn new(action: Action, done: bool, on_vehicle: OnVehicle, text: String) -> Self {
        Self {
            schema: "gaware.params/1",
            action,
            done,
            on_vehicle,
            changed: None,
            reboot_due: false,
            count: None,
            hash: None,
            parameters: None,
            values: None,
            file: None,
            backup: None,
            journal: None,
            text,
        }
    }

    /// An error where it is not what was asked for.
    ///
    /// # Errors
    /// Itself.
    pub fn settled(self) -> Result<Self, ParamsError> {
        if self.done { Ok(self) } else { Err(ParamsError::NotVerified(Box::new(self))) }
    }
}

impl std::fmt::Display for ParamsResult {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}
