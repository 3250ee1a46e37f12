//! Geofences: areas to stay in or out of, and the flat local frame in which distances are measured.

use crate::item::{Frame, LatLon, MissionItem, command};
use gaware_nav::earth::Geodetic;
use gaware_nav::math::cos;
use gaware_nav::rotation::wrap_180;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// Less is no area to fly in, m².
const LEAST_AREA_M2: f64 = 1.0;

/// A polygon of the fence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FencePolygon {
    /// Stay inside (true) or outside.
    pub inclusion: bool,
    /// Corners in order; closed by itself.
    pub corners: Vec<LatLon>,
}

/// A circle of the fence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FenceCircle {
    /// Stay inside (true) or outside.
    pub inclusion: bool,
    /// Centre.
    pub center: LatLon,
    /// Radius, m.
    pub radius_m: f64,
}

/// A geofence; empty means no limits.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Fence {
    /// Polygons.
    pub polygons: Vec<FencePolygon>,
    /// Circles.
    pub circles: Vec<FenceCircle>,
}

impl Fence {
    /// Whether it limits nothing.
    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty() && self.circles.is_empty()
    }

    /// Why distances to it would mean nothing, if so: an area whose edges cross has no inside that a person and an autopilot agree on.
    pub fn problem(&self) -> Option<String> {
        let polygons = self.polygons.iter().zip(1..).find_map(|(p, n)| {
            let why = p.problem()?;
            Some(format!("geofence polygon {n}: {why}"))
        });
        let circles = self.circles.iter().zip(1..).find_map(|(c, n)| {
            let sound = c.center.is_valid() && c.radius_m.is_finite() && c.radius_m > 0.0;
            (!sound).then(|| {
                format!("geofence circle {n}: a radius of {} m around {:?} is none", c.radius_m, c.center)
            })
        });
        polygons.or(circles)
    }
}

/// Why a list of fence items is no fence that a plan file can hold.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FenceItemError {
    /// Not a corner and not a circle.
    #[error("item {number} of the fence is a {name}, which a plan file cannot hold")]
    Command {
        /// Item, from 1.
        number: usize,
        /// What it is.
        name: String,
    },
    /// A polygon that ends before all its corners came.
    #[error("item {number} of the fence: a polygon of {corners} corners ends early")]
    Polygon {
        /// Its first item, from 1.
        number: usize,
        /// Corners that it announces.
        corners: usize,
    },
}

impl Fence {
    /// The fence as items of a vehicle's list (MAVLink, `MAV_CMD_NAV_FENCE_…`): a corner each, with the number of corners of its polygon, and
    /// circles.
    pub fn items(&self) -> Vec<MissionItem> {
        let item = |number, param1: f32, place: LatLon| MissionItem {
            frame: Frame::GLOBAL,
            ..MissionItem::at(number, [param1, 0.0, 0.0, 0.0], place, 0.0)
        };
        let corners = self.polygons.iter().flat_map(|p| {
            let number = match p.inclusion {
                true => command::NAV_FENCE_POLYGON_VERTEX_INCLUSION,
                false => command::NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
            };
            p.corners.iter().map(move |c| item(number, p.corners.len() as f32, *c))
        });
        let circles = self.circles.iter().map(|c| {
            let number = match c.inclusion {
                true => command::NAV_FENCE_CIRCLE_INCLUSION,
                false => command::NAV_FENCE_CIRCLE_EXCLUSION,
            };
            item(number, c.radius_m as f32, c.center)
        });
        corners.chain(circles).collect()
    }

    /// The fence that these items stand for.
    ///
    /// # Errors
    /// Other items, or polygons without all their corners.
    pub fn from_items(items: &[MissionItem]) -> Result<Self, FenceItemError> {
        let mut fence = Self::default();
        let mut k = 0;
        while let Some(item) = items.get(k) {
            let place = LatLon::from_e7(item.x, item.y);
            let corners = item.params[0].clamp(0.0, f32::from(u16::MAX)) as usize;
            match item.command {
                command::NAV_FENCE_CIRCLE_INCLUSION | command::NAV_FENCE_CIRCLE_EXCLUSION => {
                    let inclusion = item.command == command::NAV_FENCE_CIRCLE_INCLUSION;
                    let radius_m = f64::from(item.params[0]);
                    fence.circles.push(FenceCircle { inclusion, center: place, radius_m });
                    k += 1;
                }
                command::NAV_FENCE_POLYGON_VERTEX_INCLUSION | command::NAV_FENCE_POLYGON_VERTEX_EXCLUSION => {
                    let whole = items.get(k..k + corners).filter(|all| {
                        corners > 0
                            && all.iter().all(|i| (i.command, i.params[0]) == (item.command, item.params[0]))
                    });
                    let whole = whole.ok_or(FenceItemError::Polygon { number: k + 1, corners })?;
                    fence.polygons.push(FencePolygon {
                        inclusion: item.command == command::NAV_FENCE_POLYGON_VERTEX_INCLUSION,
                        corners: whole.iter().map(|i| LatLon::from_e7(i.x, i.y)).collect(),
                    });
                    k += corners;
                }
                other => {
                    return Err(FenceItemError::Command { number: k + 1, name: command::describe(other) });
                }
            }
        }
        Ok(fence)
    }

    /// "2 polygons and 1 circle".
    pub fn describe(&self) -> String {
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        match (self.polygons.len(), self.circles.len()) {
            (0, 0) => "no areas".to_owned(),
            (p, 0) => count(p, "polygon"),
            (0, c) => count(c, "circle"),
            (p, c) => format!("{} and {}", count(p, "polygon"), count(c, "circle")),
        }
    }
}

impl FencePolygon {
    fn problem(&self) -> Option<String> {
        let origin = *self.corners.first()?;
        if self.corners.len() < 3 {
            return Some("it has less than three corners".to_owned());
        }
        if let Some(n) = self.corners.iter().position(|c| !c.is_valid()) {
            return Some(format!("corner {} is not on the Earth", n + 1));
        }
        let frame = LocalFrame::new(origin);
        let corners: Vec<Vector2<f64>> = self.corners.iter().map(|c| frame.to_local(*c)).collect();
        let edges: Vec<_> = corners.iter().zip(corners.iter().cycle().skip(1)).collect();
        for (k, (a, b)) in edges.iter().enumerate() {
            for (j, (c, d)) in edges.iter().enumerate().skip(k + 2) {
                if cross(a, b, c, d) {
                    return Some(format!(
                        "its edges {} and {} cross: are its corners in order?",
                        k + 1,
                        j + 1
                    ));
                }
            }
        }
        let area: f64 = edges.iter().map(|(a, b)| a.perp(b)).sum::<f64>().abs() / 2.0;
        (area < LEAST_AREA_M2).then(|| format!("it has an area of {area:.1} m²"))
    }
}

/// Whether two edges cross (not whether they touch).
fn cross(a: &Vector2<f64>, b: &Vector2<f64>, c: &Vector2<f64>, d: &Vector2<f64>) -> bool {
    let side = |p: &Vector2<f64>, q: &Vector2<f64>, r: &Vector2<f64>| (q - p).perp(&(r - p));
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

/// North and east in metres around an origin; good to 1e-4 of the distance within 10 km.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    origin: LatLon,
    north_m_per_deg: f64,
    east_m_per_deg: f64,
}

impl LocalFrame {
    /// Around this place, by the radii of curvature there.
    pub fn new(origin: LatLon) -> Self {
        let place = Geodetic::from_degrees(origin.lat_deg, origin.lon_deg, 0.0);
        let (north, east) = place.radii();
        Self {
            origin,
            north_m_per_deg: north.to_radians(),
            // Kept off zero so that a place at the pole divides by something.
            east_m_per_deg: (east * cos(place.lat_rad)).to_radians().max(1e-3),
        }
    }

    /// The origin.
    pub fn origin(&self) -> LatLon {
        self.origin
    }

    /// North and east of a place, m.
    pub fn to_local(&self, place: LatLon) -> Vector2<f64> {
        let dlon = wrap_180(place.lon_deg - self.origin.lon_deg);
        Vector2::new((place.lat_deg - self.origin.lat_deg) * self.north_m_per_deg, dlon * self.east_m_per_deg)
    }

    /// The place at north and east, m.
    pub fn to_place(&self, ne: Vector2<f64>) -> LatLon {
        let lon = self.origin.lon_deg + ne.y / self.east_m_per_deg;
        LatLon { lat_deg: self.origin.lat_deg + ne.x / self.north_m_per_deg, lon_deg: wrap_180(lon) }
    }
}

#[derive(Debug, Clone)]
enum Area {
    Polygon(Vec<Vector2<f64>>),
    Circle(Vector2<f64>, f64),
}

/// A fence in metres, ready to measure distances.
#[derive(Debug, Clone)]
pub struct LocalFence {
    areas: Vec<(bool, Area)>,
}

impl LocalFence {
    /// The fence in this frame.
    pub fn new(fence: &Fence, frame: &LocalFrame) -> Self {
        let polygons = fence
            .polygons
            .iter()
            .map(|p| (p.inclusion, Area::Polygon(p.corners.iter().map(|c| frame.to_local(*c)).collect())));
        let circles =
            fence.circles.iter().map(|c| (c.inclusion, Area::Circle(frame.to_local(c.center), c.radius_m)));
        Self { areas: polygons.chain(circles).collect() }
    }

    /// Distance from the nearest limit, m; negative where a limit is broken, infinite without a fence.
    pub fn clearance(&self, p: Vector2<f64>) -> f64 {
        self.areas.iter().fold(f64::INFINITY, |least, (inclusion, area)| {
            let inside = match area {
                Area::Circle(center, radius) => radius - (p - center).norm(),
                Area::Polygon(corners) => inside_polygon(corners, p),
            };
            least.min(if *inclusion { inside } else { -inside })
        })
    }

    /// Corners of the box around all inclusions, if there is one.
    pub fn bounds(&self) -> Option<(Vector2<f64>, Vector2<f64>)> {
        let mut bounds: Option<(Vector2<f64>, Vector2<f64>)> = None;
        for (_, area) in self.areas.iter().filter(|(inclusion, _)| *inclusion) {
            let (low, high) = match area {
                Area::Circle(c, r) => (c.add_scalar(-*r), c.add_scalar(*r)),
                Area::Polygon(corners) => corners.iter().fold(
                    (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY)),
                    |(low, high), c| (low.inf(c), high.sup(c)),
                ),
            };
            // Several inclusions: all must hold, so the boxes intersect.
            bounds = Some(bounds.map_or((low, high), |(l, h)| (l.sup(&low), h.inf(&high))));
        }
        bounds
    }
}

/// Signed distance from the edge of a polygon, m; positive inside.
fn inside_polygon(corners: &[Vector2<f64>], p: Vector2<f64>) -> f64 {
    let mut inside = false;
    let mut nearest = f64::INFINITY;
    let Some(mut a) = corners.last().copied() else { return f64::NEG_INFINITY };
    for &b in corners {
        let edge = b - a;
        let along = ((p - a).dot(&edge) / edge.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        nearest = nearest.min((p - a - edge * along).norm());
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + edge.x * (p.y - a.y) / edge.y {
            inside = !inside;
        }
        a = b;
    }
    if inside { nearest } else { -nearest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn square(frame: &LocalFrame, half: f64, inclusion: bool) -> FencePolygon {
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)]
            .map(|(n, e)| frame.to_place(Vector2::new(n * half, e * half)))
            .to_vec();
        FencePolygon { inclusion, corners }
    }

    #[test]
    fn distances_to_inclusion_and_exclusion() {
        let frame = LocalFrame::new(LatLon { lat_deg: 47.4, lon_deg: 8.55 });
        let hole =
            FenceCircle { inclusion: false, center: frame.to_place(Vector2::new(50.0, 0.0)), radius_m: 10.0 };
        let fence = Fence { polygons: vec![square(&frame, 100.0, true)], circles: vec![hole] };
        let local = LocalFence::new(&fence, &frame);
        let at = |n, e| local.clearance(Vector2::new(n, e));
        assert!((at(-30.0, 0.0) - 70.0).abs() < 1e-6);
        assert!((at(55.0, 0.0) + 5.0).abs() < 1e-6);
        assert!((at(0.0, 130.0) + 30.0).abs() < 1e-6);
        assert!((at(30.0, 0.0) - 10.0).abs() < 1e-6);
        assert_eq!(LocalFence::new(&Fence::default(), &frame).clearance(Vector2::zeros()), f64::INFINITY);
    }

    #[test]
    fn a_fence_survives_its_items() {
        let frame = LocalFrame::new(LatLon { lat_deg: 47.4, lon_deg: 8.55 });
        let hole = FenceCircle {
            inclusion: false,
            center: LatLon::from_e7(474_000_000, 85_500_000),
            radius_m: 80.5,
        };
        let e7 = |p: FencePolygon| FencePolygon {
            corners: p.corners.iter().map(|c| LatLon::from_e7(c.to_e7().0, c.to_e7().1)).collect(),
            ..p
        };
        let polygons = vec![e7(square(&frame, 400.0, true)), e7(square(&frame, 50.0, false))];
        let fence = Fence { polygons, circles: vec![hole] };
        let items = fence.items();
        assert_eq!((items.len(), items[0].params[0], items[8].params[0]), (9, 4.0, 80.5));
        assert_eq!(Fence::from_items(&items), Ok(fence.clone()));
        assert_eq!(fence.describe(), "2 polygons and 1 circle");
        let early = Fence::from_items(&items[..3]).expect_err("three of four corners");
        assert_eq!(early.to_string(), "item 1 of the fence: a polygon of 4 corners ends early");
        let way_home = MissionItem { command: command::NAV_FENCE_RETURN_POINT, ..items[0] };
        let named = Fence::from_items(&[way_home]).expect_err("no area");
        assert!(named.to_string().contains("fence return point"), "{named}");
    }

    proptest! {
        #[test]
        fn local_frame_round_trip(lat in -85.0..85.0f64, lon in -180.0..180.0f64, n in -5e3..5e3f64, e in -5e3..5e3f64) {
            let frame = LocalFrame::new(LatLon { lat_deg: lat, lon_deg: lon });
            let ne = Vector2::new(n, e);
            prop_assert!((frame.to_local(frame.to_place(ne)) - ne).norm() < 1e-6);
        }
    }
}
