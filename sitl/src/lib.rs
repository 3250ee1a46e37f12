//! Simulation for `gaware`: trajectories, sensors, the simulated autopilot and faulty links.
//!
//! The sensors go through the very same [effects](gaware_nav::effects) that the filter assumes, so what a model
//! says is what the simulation does. The vehicles are kinematically exact (position, velocity, attitude, specific
//! force and rate belong together to better than a micrometre), but they are not aerodynamic models: use them to
//! test estimators and protocols, not to design a control loop.

pub mod air;
pub mod autopilot;
pub mod blind;
pub mod faults;
pub mod magnetometer;
pub mod noise;
pub mod powertrain;
pub mod scenario;
pub mod sensors;
pub mod shell;
pub mod trajectory;
pub mod truth;
pub mod vehicle;
