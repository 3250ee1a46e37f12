//! Truncation: integer samples are cut toward zero, as a C cast does. A discrete effect; what it does to a sample
//! stands in [`crate::quantisation`].

use super::{Effect, ParameterGroup};

/// Integer samples truncated toward zero instead of rounded.
#[derive(Debug)]
pub struct ImuTruncation;

impl Effect for ImuTruncation {
    fn name(&self) -> &'static str {
        "imu_truncation"
    }

    fn description(&self) -> &'static str {
        "integer inertial samples are truncated toward zero"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[]
    }

    fn truncates_samples(&self) -> bool {
        true
    }
}
