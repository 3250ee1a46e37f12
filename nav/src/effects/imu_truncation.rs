//! Truncation: integer samples are cut toward zero, as a C cast does. A discrete effect; what it does to a sample
//! stands in [`crate::quantisation`].

use super::{Effect, Excitation, ParameterGroup, Separation};

/// Integer samples truncated toward zero instead of rounded.
#[derive(Debug)]
pub struct ImuTruncation;

impl Effect for ImuTruncation {
    words! {
        name: "imu_truncation",
        description: "integer inertial samples are truncated toward zero",
        cause: "a driver or message casts samples to integers instead of rounding them",
        remedy: "round in the driver, or log inertial samples at full resolution",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[]
    }

    fn truncates_samples(&self) -> bool {
        true
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gyro_scale_factor",
                fly: &[Excitation::SteadyTurn, Excitation::FigureEight],
                why: "half a count does not grow with the rate",
            },
            Separation {
                from: "gyro_g_sensitivity",
                fly: &[Excitation::SteadyTurn, Excitation::PullUp],
                why: "half a count does not grow with the load",
            },
        ]
    }
}
