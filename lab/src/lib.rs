//! Studies: claims about accuracy that anybody can repeat with one command.
//!
//! The laboratory drives the very code of the daemon (filter, explanation, transfer, engine), and no part of the daemon knows of it.

#![cfg_attr(not(test), deny(clippy::print_stdout))]

pub mod agreement;
pub mod blind;
pub mod closed_loop;
pub mod commands;
pub mod demo;
pub mod drift;
pub mod endurance;
pub mod faults;
pub mod ground;
pub mod guidance;
pub mod honesty;
pub mod observability;
pub mod paper;
pub mod planned;
pub mod recorded;
pub mod statistics;
pub mod transfer;
pub mod unknown;
pub mod withheld;
