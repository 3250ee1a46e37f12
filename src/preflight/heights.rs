//! The heights of a plan's items, as far as home alone judges them: what the ground is like elsewhere no plan says.

use super::{Row, Verdict};
use crate::mission_link::files::Contents;
use gaware_mission::item::{AltitudeReference, MissionItem, command};

/// Higher than this above home a mission of these vehicles is not flown: a plan in another unit, or with a digit too many, m.
const CEILING_M: f64 = 1000.0;

/// Whether its altitude is flown at: a landing ends at the ground, wherever that is.
fn is_flown_at(item: &MissionItem) -> bool {
    let ends = matches!(
        item.command,
        command::NAV_LAND | command::NAV_VTOL_LAND | command::DO_LAND_START | command::NAV_RALLY_POINT
    );
    // What only has a place (a region of interest, a home) may lie anywhere.
    item.command <= command::NAV_LAST && command::has_altitude(item.command) && !ends
}

pub(super) fn check(plan: &Contents) -> Vec<Row> {
    let home_m = plan.mission.home.map(|home| f64::from(home.alt_m));
    let above_home = |item: &MissionItem| {
        let z = f64::from(item.z);
        match item.frame.altitude_reference() {
            AltitudeReference::Home | AltitudeReference::Terrain => Some(z),
            AltitudeReference::MeanSeaLevel => Some(z - home_m?),
            AltitudeReference::None => None,
        }
    };
    let items = plan.mission.items.iter().enumerate().filter(|(_, item)| is_flown_at(item));
    let heights: Vec<(usize, f64, AltitudeReference)> = items
        .filter_map(|(k, item)| Some((k + 1, above_home(item)?, item.frame.altitude_reference())))
        .filter(|(_, height, _)| height.is_finite())
        .collect();
    let by_height =
        |a: &&(usize, f64, AltitudeReference), b: &&(usize, f64, AltitudeReference)| a.1.total_cmp(&b.1);
    let (Some(lowest), Some(highest)) = (heights.iter().min_by(by_height), heights.iter().max_by(by_height))
    else {
        return Vec::new();
    };
    let row = |verdict, text: String| Row::new("heights", verdict, text);
    let mut rows = Vec::new();
    let relative = heights.iter().find(|h| h.1 < 0.0 && h.2 != AltitudeReference::MeanSeaLevel);
    if let Some((number, height, reference)) = relative {
        let ground = if *reference == AltitudeReference::Terrain { "the ground" } else { "home" };
        rows.push(row(
            Verdict::Stop,
            format!(
                "item {number} lies {:.0} m below {ground}: where a valley is meant, write the altitude above sea level",
                -height
            ),
        ));
    } else if highest.1 < 0.0 {
        rows.push(row(
            Verdict::Stop,
            format!(
                "all items lie below home, the highest (item {}) by {:.0} m: are these heights above sea level?",
                highest.0, -highest.1
            ),
        ));
    } else if lowest.1 < 0.0 {
        let text = format!("item {} lies {:.0} m below home", lowest.0, -lowest.1);
        rows.push(row(Verdict::Warn, text));
    }
    if highest.1 > CEILING_M {
        let text = format!("item {} lies {:.0} m above home: is that in metres?", highest.0, highest.1);
        rows.push(row(Verdict::Warn, text));
    }
    rows
}
