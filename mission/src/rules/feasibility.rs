//! PX4's second check: `src/modules/navigator/MissionFeasibility/FeasibilityChecker.cpp` runs after the upload was acknowledged
//! and reports by EVENT (410) alone; a mission that fails cannot be started.

use crate::airframe::Kind;
use crate::fence::LocalFrame;
use crate::item::{AltitudeReference, Mission, MissionItem, command};
use gaware_nav::math::atan;

/// The parameters of the vehicle that decide, with PX4's defaults for fixed wings and multirotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// `MIS_TKO_LAND_REQ` 2, the default of fixed wings (`rc.fw_defaults`): a landing is required.
    pub wings_must_land: bool,
    /// `FW_LND_ANG`, deg.
    pub landing_angle_deg: f64,
    /// `NAV_ACC_RAD`, m: a take-off climbs 1 m higher at least.
    pub acceptance_radius_m: f32,
    /// `MIS_DIST_1WP`, m: the first item is nearer to home than this.
    pub first_item_max_m: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            wings_must_land: true,
            landing_angle_deg: 5.0,
            acceptance_radius_m: 10.0,
            first_item_max_m: 10_000.0,
        }
    }
}

/// Why PX4 would reject a mission that it has taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Infeasible {
    /// `navigator_mis_land_missing`.
    #[error(
        "PX4 would reject the mission: a fixed wing's mission needs a landing (MIS_TKO_LAND_REQ is 2); plan again with one, or where it fits"
    )]
    LandingMissing,
    /// `navigator_mis_glide_slope_too_steep`.
    #[error(
        "PX4 would reject the mission: item {item} (land) is approached at {slope_deg:.1}°, FW_LND_ANG allows {most_deg:.1}°; begin the approach further away or lower"
    )]
    TooSteep {
        /// Item, counted from 1.
        item: usize,
        /// Of the approach, deg.
        slope_deg: f64,
        /// Allowed, deg.
        most_deg: f64,
    },
    /// `navigator_mis_approach_wp_below_land`, `navigator_mis_unsupported_landing_approach_wp`,
    /// `navigator_mis_land_wp_inside_orbit_radius`.
    #[error(
        "PX4 would reject the mission: item {item} (land) must follow a waypoint or a loiter to altitude above it and outside its circle"
    )]
    Approach {
        /// Item, counted from 1.
        item: usize,
    },
    /// `navigator_mis_takeoff_too_low`.
    #[error(
        "PX4 would reject the mission: item {item} (take-off) climbs to {height_m:.1} m, NAV_ACC_RAD asks for {least_m:.1} m; take off higher"
    )]
    TakeOffTooLow {
        /// Item, counted from 1.
        item: usize,
        /// Of the item, m.
        height_m: f32,
        /// Needed, m.
        least_m: f32,
    },
    /// `navigator_mis_takeoff_not_first`.
    #[error("PX4 would reject the mission: item {item} (take-off) must come before every other place")]
    TakeOffNotFirst {
        /// Item, counted from 1.
        item: usize,
    },
    /// `navigator_mis_starts_w_landing`.
    #[error("PX4 would reject the mission: it begins with its landing")]
    BeginsWithLanding,
    /// `navigator_mis_first_wp_too_far`.
    #[error(
        "PX4 would reject the mission: its first place is {distance_m:.0} m from home, MIS_DIST_1WP allows {most_m:.0} m"
    )]
    TooFar {
        /// From home, m.
        distance_m: f64,
        /// Allowed, m.
        most_m: f64,
    },
}

/// Judges a mission as PX4 does after its upload.
///
/// # Errors
/// The first rule that it breaks.
pub fn check(mission: &Mission, kind: Kind, limits: &Limits) -> Result<(), Infeasible> {
    let items = &mission.items;
    if items.first().is_some_and(|i| i.command == command::NAV_LAND) {
        return Err(Infeasible::BeginsWithLanding);
    }
    first_place(mission, limits)?;
    let height = |item: &MissionItem| match (item.frame.altitude_reference(), mission.home) {
        (AltitudeReference::MeanSeaLevel, Some(home)) => item.z - home.alt_m,
        _ => item.z,
    };
    let mut place_seen = false;
    for (k, item) in items.iter().enumerate() {
        if item.command == command::NAV_TAKEOFF {
            let least_m = limits.acceptance_radius_m + 1.0;
            if height(item) < least_m {
                return Err(Infeasible::TakeOffTooLow { item: k + 1, height_m: height(item), least_m });
            }
            if place_seen {
                return Err(Infeasible::TakeOffNotFirst { item: k + 1 });
            }
        }
        place_seen |= command::has_position(item.command);
        if item.command == command::NAV_LAND && kind == Kind::FixedWing {
            approach(&items[..k], item, &height, limits)?;
        }
    }
    let lands = items.iter().any(|i| i.command == command::NAV_LAND);
    if kind == Kind::FixedWing && limits.wings_must_land && !lands && !items.is_empty() {
        return Err(Infeasible::LandingMissing);
    }
    Ok(())
}

fn first_place(mission: &Mission, limits: &Limits) -> Result<(), Infeasible> {
    let (Some(home), Some(first)) = (mission.home, mission.items.iter().find_map(MissionItem::place)) else {
        return Ok(());
    };
    let distance_m = LocalFrame::new(home.place()).to_local(first).norm();
    let most_m = limits.first_item_max_m;
    if distance_m < most_m { Ok(()) } else { Err(Infeasible::TooFar { distance_m, most_m }) }
}

/// `checkFixedWindLandApproach`: the slope from the item before the landing, from where the tangent leaves the circle of a loiter.
fn approach(
    before: &[MissionItem],
    land: &MissionItem,
    height: &dyn Fn(&MissionItem) -> f32,
    limits: &Limits,
) -> Result<(), Infeasible> {
    /// What PX4 itself adds for rounding, deg.
    const SLACK_DEG: f64 = 0.1;
    let item = before.len() + 1;
    let Some(from) = before.last() else { return Ok(()) };
    // An item without a place before it is not judged.
    let (Some(start), Some(end)) = (from.place(), land.place()) else { return Ok(()) };
    let distance = LocalFrame::new(end).to_local(start).norm();
    let run = match from.command {
        command::NAV_WAYPOINT => distance,
        command::NAV_LOITER_TO_ALT => {
            let radius = f64::from(from.params[1].abs());
            if distance <= radius {
                return Err(Infeasible::Approach { item });
            }
            (distance * distance - radius * radius).sqrt()
        }
        _ => return Err(Infeasible::Approach { item }),
    };
    let drop = f64::from(height(from) - height(land));
    if drop <= f64::EPSILON {
        return Err(Infeasible::Approach { item });
    }
    let slope_deg = atan(drop / run).to_degrees();
    if slope_deg > limits.landing_angle_deg + SLACK_DEG {
        return Err(Infeasible::TooSteep { item, slope_deg, most_deg: limits.landing_angle_deg });
    }
    Ok(())
}
