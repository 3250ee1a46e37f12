//! The end-to-end tests, a module for each subject, linked once: `cargo test --test main mission` runs those of `mission.rs`.

mod advice;
mod demo;
mod documents;
mod explain;
mod export;
mod fleet;
mod flight_day;
mod golden;
mod ground;
mod mission;
mod noise_levels;
mod outputs;
mod params;
mod recorded_flights;
mod report;
mod rubbish;
mod run_sim;
mod service;
mod snapshot_schema;
mod standing;
mod support;
mod upload_safety;
mod web;
mod wrong_vehicle;
