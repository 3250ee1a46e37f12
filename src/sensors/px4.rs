//! PX4's habits.
//!
//! PX4 sends no `RAW_IMU`. Its `HIGHRES_IMU` has EKF2's own bias estimates subtracted, which move in flight and would
//! take part of what is estimated with them; its `SCALED_IMU` is truncated to 1 mrad/s, but honest.
//!
//! Once disarmed it adds what EKF2 has learnt of the accelerometers to their offsets, from 0.05 m/s² on, and all messages carry the new ones
//! (`SENS_IMU_AUTOCAL`, on by default; `modules/sensors/vehicle_imu/VehicleIMU.cpp`, `AccelCalibrationUpdate`).

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

/// Follows the arming of a vehicle.
#[derive(Debug, Clone, Copy, Default)]
pub struct Calibration {
    armed: bool,
}

impl Calibration {
    /// Takes what a heartbeat says, and says whether the calibration may have changed since the one before.
    pub fn may_change(&mut self, armed: bool) -> bool {
        std::mem::replace(&mut self.armed, armed) && !armed
    }
}
