//! The one rule about samples that are missing, for filter and explanation.

/// A gap between samples longer than this is not integrated as if nothing had happened, s.
pub(crate) const GAP_S: f64 = 0.25;
/// What an unseen vehicle may do in a gap of which nothing else is known: rate, rad/s, and acceleration, m/s².
pub(crate) const MOTION: (f64, f64) = (0.5, 5.0);
