//! PX4's habits.
//!
//! PX4 sends no `RAW_IMU`. Its `HIGHRES_IMU` has EKF2's own bias estimates subtracted, which move in flight and would
//! take part of what is estimated with them; its `SCALED_IMU` is truncated to 1 mrad/s, but honest.

use super::source::ImuSource;

/// Best first.
pub const PREFERENCE: &[ImuSource] = &[
    ImuSource::ScaledImu,
    ImuSource::HighresImu,
    ImuSource::RawImu,
    ImuSource::ScaledImu2,
    ImuSource::ScaledImu3,
];

/// What a choice means for the result.
pub fn consequence(source: ImuSource) -> Option<&'static str> {
    match source {
        ImuSource::HighresImu => Some(
            "the autopilot has subtracted its own moving bias estimates; biases and g-sensitivity found here are what it left",
        ),
        ImuSource::RawImu | ImuSource::ScaledImu => {
            Some("values are truncated to 1 mrad/s and 1 mg; the filter models this")
        }
        ImuSource::ScaledImu2 | ImuSource::ScaledImu3 => {
            Some("this is not the primary inertial unit, and values are truncated to 1 mrad/s and 1 mg")
        }
    }
}
