//! The landing of a fixed wing after the last maneuver: down in a circle to the height of the approach, out to a point on the extended
//! runway line, in to it, and along a glide slope to home. As ArduPilot's own plane missions do it, and only where every
//! piece stays inside the fence in every wind.

use super::Rejection;
use super::search::{Flown, Search};
use crate::flight::Flyer;
use crate::item::{Autopilot, MissionItem, command};
use crate::kinematics::Kinematics;
use crate::safety::Refusal;
use gaware_nav::math::{atan2, cos, sin};
use nalgebra::{Rotation2, Vector2, Vector3};

/// Height of the approach above the floor, m: what a circle and a turn may sink below it.
const ABOVE_FLOOR_M: f64 = 6.0;
/// Descent over distance of the glide.
const SLOPE: f64 = 0.1;
/// The same on PX4, which rejects a slope above `FW_LND_ANG`, 5.0 deg (0.0875): a tenth less.
const PX4_SLOPE: f64 = 0.079;
/// Directions of landing that are tried, from the one into the wind.
const TURNED_DEG: [f64; 7] = [0.0, 20.0, -20.0, 45.0, -45.0, 70.0, -70.0];
/// With less wind than this, m/s, every direction will do.
const CALM_M_PER_S: f64 = 1.0;
/// Distances between the turn onto the approach and the begin of the glide, in turn radii.
const STRAIGHT: [f64; 3] = [3.0, 1.5, 0.7];
/// Half way down the glide no wind has left the aircraft further from the line than this, m.
const ALIGNED_M: f64 = 12.0;
/// A flare carries the aircraft on for so long, s.
const FLARE_S: f64 = 4.0;
/// Points of the roll-out that are checked.
const ROLL_CHECKS: u32 = 10;

/// A landing that fits.
pub(super) struct Landing<'a> {
    pub items: Vec<MissionItem>,
    pub samples: Vec<Kinematics>,
    pub flyers: Vec<Flyer<'a>>,
}

impl<'a> Search<'a> {
    /// The first landing that is safe in every wind, from where the maneuvers end; or the reason of the last try.
    pub(super) fn landing(&self, from: &[Flyer<'a>]) -> Result<Landing<'a>, Rejection> {
        if !self.request.airframe.is_fixed_wing() {
            return self.vertical_landing(from);
        }
        let wind = self.request.limits.wind().xy();
        let (into_wind, turned): (f64, Vec<f64>) = if wind.norm() < CALM_M_PER_S {
            (self.request.start_heading_deg.to_radians(), (0..8).map(|k| 45.0 * f64::from(k)).collect())
        } else {
            (atan2(-wind.y, -wind.x), TURNED_DEG.to_vec())
        };
        let mut reason = Refusal::NoSafeEnd.into();
        for deg in turned {
            for straight in STRAIGHT {
                for side in [1.0, -1.0] {
                    let course = into_wind + deg.to_radians();
                    match self.landing_on(from, course, straight, side) {
                        Ok(landing) => return Ok(landing),
                        Err(e) => reason = e,
                    }
                }
            }
        }
        Err(reason)
    }

    /// Over home at the height of the hold, then straight down. Not a return to launch: its height is a parameter of the vehicle, and
    /// the plan could not check it against the ceiling.
    fn vertical_landing(&self, from: &[Flyer<'a>]) -> Result<Landing<'a>, Rejection> {
        let Some(hold) = self.end_items().first().copied() else { return Err(Refusal::NoSafeEnd.into()) };
        let home = self.request.home.place();
        let params = [0.0, 0.0, 0.0, self.request.airframe.autopilot.free_heading()];
        let above = MissionItem::at(command::NAV_WAYPOINT, params, home, hold.z);
        let land = MissionItem::at(command::NAV_LAND, params, home, 0.0);
        // The landing comes after the time for maneuvers.
        let unhurried: Vec<Flyer<'a>> = from.iter().map(|f| f.clone().within(f64::INFINITY)).collect();
        let Flown { mut flyers, mut samples } = self.fly(&unhurried, &[above])?;
        for (k, flyer) in flyers.iter_mut().enumerate() {
            let down = flyer.fly(&[land])?.samples;
            let places: Vec<_> = down.iter().map(|s| (s.t_s, s.position_ned_m)).collect();
            self.checker().ground_track(&places)?;
            if k == 0 {
                samples.extend(down);
            }
        }
        Ok(Landing { items: vec![above, land], samples, flyers })
    }

    fn landing_on(
        &self,
        from: &[Flyer<'a>],
        course: f64,
        straight: f64,
        side: f64,
    ) -> Result<Landing<'a>, Rejection> {
        let airframe = &self.request.airframe;
        let limits = &self.request.limits;
        let fastest = airframe.speed_cruise_m_per_s + limits.wind_speed();
        let radius = airframe.planned_radius_m(fastest);
        let height = limits.floor_m + ABOVE_FLOOR_M;
        let home = self.frame.to_local(self.request.home.place());
        let at = |back: f64, right: f64| home + Rotation2::new(course) * Vector2::new(-back, right);
        let slope = if airframe.autopilot == Autopilot::Px4 { PX4_SLOPE } else { SLOPE };
        let glide = height / slope;
        let (turn, gate) = (at(glide + straight * radius, side * 2.0 * radius), at(glide, 0.0));
        let waypoint = |p: Vector2<f64>| {
            let params = [0.0, 0.0, 0.0, airframe.autopilot.free_heading()];
            MissionItem::at(command::NAV_WAYPOINT, params, self.frame.to_place(p), height as f32)
        };
        let down = self.circle_down(height)?;
        let params = [0.0, 0.0, 0.0, airframe.autopilot.free_heading()];
        let land = MissionItem::at(command::NAV_LAND, params, self.request.home.place(), 0.0);
        let approach = [down, waypoint(turn), waypoint(at(glide + 0.3 * radius, 0.0)), waypoint(gate)];
        self.checker().landing(&approach, &land)?;
        // The landing comes after the time for maneuvers.
        let unhurried: Vec<Flyer<'a>> = from.iter().map(|f| f.clone().within(f64::INFINITY)).collect();
        let flown = self.fly(&unhurried, &approach)?;
        let (mut flyers, mut samples) = (flown.flyers, flown.samples);
        let line = Vector2::new(cos(course), sin(course));
        for (k, flyer) in flyers.iter_mut().enumerate() {
            let down = flyer.fly(&[land])?.samples;
            let places: Vec<_> = down.iter().map(|s| (s.t_s, s.position_ned_m)).collect();
            self.checker().ground_track(&places)?;
            aligned(&places, home, line, glide)?;
            if k == 0 {
                samples.extend(down);
            }
        }
        let v = airframe.speed_min_m_per_s;
        let roll_out = v * v / (2.0 * airframe.braking_m_per_s2) + FLARE_S * v;
        let ends: Vec<_> = (0..=ROLL_CHECKS)
            .map(|k| home + line * (roll_out * f64::from(k) / f64::from(ROLL_CHECKS)))
            .map(|p| (samples.last().map_or(0.0, |s: &Kinematics| s.t_s), Vector3::new(p.x, p.y, 0.0)))
            .collect();
        self.checker().ground_track(&ends)?;
        let mut items = approach.to_vec();
        items.push(land);
        Ok(Landing { items, samples, flyers })
    }

    /// Whether the autopilot rejects a mission that does not land: PX4's fixed wings (`MIS_TKO_LAND_REQ` 2).
    pub(super) fn landing_required(&self) -> bool {
        let airframe = &self.request.airframe;
        airframe.autopilot == Autopilot::Px4 && airframe.is_fixed_wing()
    }

    /// The circle of the hold, flown until the height is right.
    fn circle_down(&self, height: f64) -> Result<MissionItem, Rejection> {
        let Some(hold) = self.end_items().first().copied() else { return Err(Refusal::NoSafeEnd.into()) };
        Ok(MissionItem {
            command: command::NAV_LOITER_TO_ALT,
            params: [0.0, hold.params[2], 0.0, 1.0],
            z: height as f32,
            ..hold
        })
    }
}

/// Whether the aircraft is on the line by half way down.
fn aligned(
    places: &[(f64, Vector3<f64>)],
    home: Vector2<f64>,
    line: Vector2<f64>,
    glide: f64,
) -> Result<(), Rejection> {
    let late = places.iter().filter(|(_, p)| (home - p.xy()).dot(&line) < 0.5 * glide);
    let off = late.map(|(t_s, p)| (*t_s, line.perp(&(p.xy() - home)).abs()));
    match off.max_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((t_s, off_m)) if off_m > ALIGNED_M => Err(Refusal::NotAligned { t_s, off_m }.into()),
        Some(_) => Ok(()),
        None => Err(Refusal::NoSafeEnd.into()),
    }
}
