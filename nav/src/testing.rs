//! What tests of several modules need.

use crate::math::{cos, ln};

/// Numbers with a standard normal distribution (Box & Muller 1958), of a linear congruential sequence (Knuth's MMIX).
pub(crate) struct Normal(pub(crate) u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub(crate) fn next(&mut self) -> f64 {
        (-2.0 * ln(self.uniform())).sqrt() * cos(std::f64::consts::TAU * self.uniform())
    }
}
