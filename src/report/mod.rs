//! Self-contained HTML reports: interactive plots with a drawing for readers without scripts, light and dark, printable.

#[cfg(not(target_family = "wasm"))]
pub mod demo;
pub mod explanation;
pub mod fleet;
pub mod flight;
pub mod heat;
pub(crate) mod page;
pub mod plot;
mod spectrum;
