//! How a change of parameters ended.

use crate::params::ParamName;
use serde::Serialize;

/// A parameter of which it is not certain that it has the old or the new value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Doubtful {
    /// Which.
    pub name: ParamName,
    /// Before.
    pub old: f64,
    /// To be afterwards.
    pub new: f64,
    /// As it was read last, after the last setting; `None`: it could not be read, and may be either.
    pub on_board: Option<f64>,
}

impl std::fmt::Display for Doubtful {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, old, new) = (self.name, self.old as f32, self.new as f32);
        match self.on_board.map(|v| v as f32) {
            _ if old == new => write!(f, "{name} {old}, not changed"),
            Some(v) if v == new => write!(f, "{name} {v}, the new value"),
            Some(v) if v == old => write!(f, "{name} {v}, the old value"),
            Some(v) => write!(f, "{name} {v}, neither the old value {old} nor the new one {new}"),
            None => write!(f, "{name} not known, {old} (old) or {new} (new)"),
        }
    }
}

/// What is on the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum ApplyOutcome {
    /// Every new value, read back and compared.
    Verified {
        /// Parameters whose value is another one than before.
        changed: usize,
        /// Parameters in all.
        values: usize,
    },
    /// Every old value, read back and compared, or never touched.
    Previous {
        /// Why not the new ones.
        why: String,
    },
    /// Some of each, or not known. [`VerifiedChange::link_restored`](crate::change::VerifiedChange::link_restored) puts the old ones back.
    Mixed {
        /// Which is which.
        values: Vec<Doubtful>,
        /// Why.
        why: String,
    },
}

impl std::fmt::Display for ApplyOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Verified { changed, values } => {
                write!(f, "{values} parameters were read back and compared, {changed} of them changed")
            }
            Self::Previous { why } => write!(f, "no parameter on the vehicle was changed in the end: {why}"),
            Self::Mixed { values, why } => {
                let list: Vec<String> = values.iter().map(ToString::to_string).collect();
                write!(f, "the change did not come to its end ({why}); on the vehicle: {}", list.join("; "))
            }
        }
    }
}
