//! ArduPilot's habits.
//!
//! All its inertial messages carry the same filtered sample; they differ in rounding only. `RAW_IMU` and `SCALED_IMU*`
//! are truncated by a C cast, `HIGHRES_IMU` (4.6 and later, bigger boards) is not. Stamps are of sending.

use super::source::ImuSource;

/// Best first.
pub const PREFERENCE: &[ImuSource] = &[
    ImuSource::HighresImu,
    ImuSource::RawImu,
    ImuSource::ScaledImu,
    ImuSource::ScaledImu2,
    ImuSource::ScaledImu3,
];

/// What a choice means for the result.
pub fn consequence(source: ImuSource) -> Option<&'static str> {
    match source {
        ImuSource::HighresImu => None,
        ImuSource::RawImu | ImuSource::ScaledImu => {
            Some("values are truncated to 1 mrad/s and 1 mg; the filter models this")
        }
        ImuSource::ScaledImu2 | ImuSource::ScaledImu3 => {
            Some("this is not the primary inertial unit, and values are truncated to 1 mrad/s and 1 mg")
        }
    }
}
