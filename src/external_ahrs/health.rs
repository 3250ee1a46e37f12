//! Whether the estimate is good enough for an autopilot.

use crate::engine::navigation::Navigation;

/// Larger sigmas of roll and pitch, and of yaw, are unhealthy, deg.
const ATTITUDE_DEG: f64 = 2.0;
const YAW_DEG: f64 = 10.0;
/// A filter that has just begun to run does not count before this, s.
const SETTLED_S: f64 = 10.0;
/// Without a used fix for longer the receiver counts as lost, s …
const FIX_LOST_S: f64 = 1.5;
/// … and for longer than this the attitude does not count any more, s.
const WITHOUT_FIX_S: f64 = 15.0;

/// What the messages say of themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InsMode {
    /// Attitude, velocity and position are good.
    Tracking,
    /// No fix was used lately: attitude only.
    FixesLost,
}

impl InsMode {
    /// `InsStatus`: mode in bits 0 and 1 (2 tracking, 3 fixes lost), bit 2 whether there is a fix.
    pub fn status(self) -> u16 {
        match self {
            Self::Tracking => 0b110,
            Self::FixesLost => 0b011,
        }
    }
}

/// Why nothing is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unhealthy {
    /// The estimator does not run yet, or not any more.
    #[error("the filter is not running")]
    NotRunning,
    /// It has just begun.
    #[error("the filter has been running for less than {SETTLED_S} s")]
    Settling,
    /// Too uncertain.
    #[error("the attitude is uncertain by more than {ATTITUDE_DEG}° (yaw {YAW_DEG}°)")]
    Uncertain,
    /// Fixes absent or rejected.
    #[error("no fix was used for {WITHOUT_FIX_S} s")]
    NoFixes,
    /// A value that is no number.
    #[error("the estimate is no number")]
    NotFinite,
}

/// Follows one run of the filter.
#[derive(Debug, Default)]
pub struct HealthCheck {
    running_since_s: Option<f64>,
}

impl HealthCheck {
    /// Checks the newest state.
    ///
    /// # Errors
    /// Why it is not good enough.
    pub fn check(&mut self, now: &Navigation) -> Result<InsMode, Unhealthy> {
        if !now.running {
            self.running_since_s = None;
            return Err(Unhealthy::NotRunning);
        }
        // Time that goes back is a new start.
        let since_s = self.running_since_s.filter(|since| *since <= now.t_s).unwrap_or(now.t_s);
        self.running_since_s = Some(since_s);
        if !now.is_finite() {
            return Err(Unhealthy::NotFinite);
        }
        if now.t_s - since_s < SETTLED_S {
            return Err(Unhealthy::Settling);
        }
        let [roll, pitch, yaw] = now.attitude_sigma_rad.map(f64::to_degrees);
        if roll > ATTITUDE_DEG || pitch > ATTITUDE_DEG || yaw > YAW_DEG {
            return Err(Unhealthy::Uncertain);
        }
        match now.since_used_fix_s {
            Some(s) if s < FIX_LOST_S => Ok(InsMode::Tracking),
            Some(s) if s < WITHOUT_FIX_S => Ok(InsMode::FixesLost),
            _ => Err(Unhealthy::NoFixes),
        }
    }
}
