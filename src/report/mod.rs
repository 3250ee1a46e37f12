//! Self-contained HTML reports: inline plots, no scripts, light and dark, printable.

pub mod demo;
pub mod explanation;
pub mod flight;
pub mod heat;
mod page;
pub mod plot;
