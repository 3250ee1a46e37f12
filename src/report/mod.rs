//! Self-contained HTML reports: inline plots, no scripts, light and dark, printable.

pub mod explanation;
pub mod heat;
pub mod plot;
