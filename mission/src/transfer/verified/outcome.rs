//! How a verified upload ended.

use crate::item::MissionKind;

/// What is on the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The new mission, read back and compared.
    Verified {
        /// Items without home.
        items: usize,
    },
    /// The previous mission, read back and compared, or never touched.
    RestoredPrevious {
        /// Why not the new one.
        why: String,
    },
    /// Somebody else's, which came meanwhile and was left alone.
    Foreign {
        /// What is on the vehicle.
        on_vehicle: String,
        /// What to do.
        what_to_do: String,
    },
    /// It is not known. [`VerifiedChange::link_restored`](crate::change::VerifiedChange::link_restored) takes up the restoration.
    Unknown {
        /// What may be on the vehicle.
        on_vehicle: String,
        /// What to do.
        what_to_do: String,
    },
}

impl Outcome {
    /// In a sentence about this list.
    pub fn about(&self, kind: MissionKind) -> String {
        match self {
            Self::Verified { items } => {
                format!("the new {kind} of {items} items is on the vehicle, read back and compared")
            }
            Self::RestoredPrevious { why } => {
                format!("the previous {kind} is on the vehicle; the new one is not, because {why}")
            }
            Self::Foreign { on_vehicle, what_to_do } | Self::Unknown { on_vehicle, what_to_do } => {
                format!("{on_vehicle}. {what_to_do}")
            }
        }
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.about(MissionKind::Mission))
    }
}
