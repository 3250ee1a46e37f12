//! The planned route for the maps of a run.

use crate::sinks::status::RouteView;
use gaware_mission::fence::{Fence, LocalFrame};
use gaware_mission::item::{Mission, command};
use gaware_nav::math::sin_cos;
use nalgebra::Vector2;

/// Corners of a fence's circle on the map.
const CIRCLE_CORNERS: u32 = 48;

/// Home, the way from item to item, and the fence of a mission file.
pub fn route(mission: &Mission, fence: &Fence) -> RouteView {
    let degrees = |lat_e7: i32, lon_e7: i32| [f64::from(lat_e7) * 1e-7, f64::from(lon_e7) * 1e-7];
    let placed = mission.items.iter().filter(|i| command::has_position(i.command) && (i.x, i.y) != (0, 0));
    let circles = fence.circles.iter().map(|c| {
        let frame = LocalFrame::new(c.center);
        let corner = |k: u32| {
            let (sin, cos) = sin_cos(f64::from(k) / f64::from(CIRCLE_CORNERS) * std::f64::consts::TAU);
            let at = frame.to_place(c.radius_m * Vector2::new(cos, sin));
            [at.lat_deg, at.lon_deg]
        };
        (0..CIRCLE_CORNERS).map(corner).collect()
    });
    let polygons = fence.polygons.iter().map(|p| p.corners.iter().map(|c| [c.lat_deg, c.lon_deg]).collect());
    RouteView {
        home: mission.home.map(|h| degrees(h.lat_e7, h.lon_e7)),
        path: placed.filter(|i| i.x != i32::MAX && i.y != i32::MAX).map(|i| degrees(i.x, i.y)).collect(),
        fence: polygons.chain(circles).collect(),
    }
}
