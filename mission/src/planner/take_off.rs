//! What a mission begins with: the take-off along a straight line that stays inside the fence, and the airframe's speed.

use super::PlanError;
use super::search::Search;
use crate::item::{MissionItem, command};
use crate::maneuver::speed_item;
use nalgebra::Vector2;

/// Points of a climb-out that are checked.
const CLIMB_CHECKS: u32 = 50;
/// A fence further away than this is hardly meant, m.
const FAR_M: f64 = 5000.0;
/// Pitch of a fixed wing's take-off, deg: ArduPlane's usual minimum.
const TAKE_OFF_PITCH_DEG: f32 = 12.0;

impl Search<'_> {
    /// What comes before the first maneuver: the take-off, and the airframe's speed, for the autopilot otherwise flies at its own
    /// parameter.
    pub(super) fn begin(&self, start: Vector2<f64>) -> Result<Vec<MissionItem>, PlanError> {
        let mut items = self.take_off(start)?;
        let airframe = &self.request.airframe;
        items.push(speed_item(airframe, airframe.speed_cruise_m_per_s));
        Ok(items)
    }

    /// The take-off, if the mission begins with one. Its climb is a straight line from home to the start.
    fn take_off(&self, start: Vector2<f64>) -> Result<Vec<MissionItem>, PlanError> {
        let request = self.request;
        if !request.take_off {
            return Ok(Vec::new());
        }
        let home = self.checker().clearance_at(Vector2::zeros());
        if home < 0.0 {
            let hint = match -home {
                by if by > FAR_M => {
                    "; are latitude and longitude swapped, or is this the fence of another place?"
                }
                _ => "",
            };
            return Err(PlanError::HomeOutside { by_m: -home, hint });
        }
        let along = |k: u32| start * (f64::from(k) / f64::from(CLIMB_CHECKS));
        let space =
            (0..=CLIMB_CHECKS).map(|k| self.checker().clearance_at(along(k))).fold(f64::INFINITY, f64::min);
        if space < 0.0 {
            return Err(PlanError::ClimbOut { length_m: start.norm(), by_m: -space });
        }
        let pitch = if request.airframe.is_fixed_wing() { TAKE_OFF_PITCH_DEG } else { 0.0 };
        let height = request.start_height_m as f32;
        let params = [pitch, 0.0, 0.0, request.airframe.autopilot.free_heading()];
        Ok(vec![MissionItem::at(command::NAV_TAKEOFF, params, request.start, height)])
    }
}
