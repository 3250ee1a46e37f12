//! Studies: claims about accuracy that anybody can repeat with one command.

pub mod blind;
pub mod closed_loop;
pub mod demo;
pub mod drift;
pub mod endurance;
pub mod faults;
pub mod guidance;
pub mod honesty;
pub mod observability;
pub mod paper;
pub mod recorded;
pub mod statistics;
pub mod transfer;
