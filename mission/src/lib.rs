//! Maneuvers, airframes, the planner, mission files and the mission transfer of `gaware`.
//!
//! Everything here is deterministic and does no I/O: files are strings, the transfer is a state machine fed with messages
//! and times, flights are predicted with a point-mass model. It knows MAVLink only by its command and result numbers;
//! turning [`transfer::MissionMessage`] into frames is the caller's work. It never arms, starts or changes modes.

pub mod airframe;
pub mod change;
pub mod compare;
pub mod fence;
pub mod files;
pub mod flight;
pub mod identity;
pub mod item;
pub mod kinematics;
pub mod maneuver;
pub mod params;
pub mod planner;
pub mod predictor;
pub mod rules;
pub mod safety;
pub mod transfer;
