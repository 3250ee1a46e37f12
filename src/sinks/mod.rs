//! Where results go: each sink takes what it can and never holds up the engine.

pub mod recorder;
