//! The engine: samples in, snapshots out. Synchronous and deterministic: no clock, no I/O, no randomness.

pub mod snapshot;
