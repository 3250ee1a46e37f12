//! Where maneuvers can be: centres inside the fence with the most space around them.

use crate::airframe::Airframe;
use crate::fence::LocalFrame;
use crate::maneuver::Placement;
use crate::safety::{Checker, Limits};
use gaware_nav::math::atan2;
use nalgebra::Vector2;

/// Cells of the grid over the fence, each way.
const GRID: usize = 24;
/// Space where there is no fence, in seconds at cruise speed.
const OPEN_ROOM_S: f64 = 30.0;

/// The best centre and the space around it, m: the centre of about the largest circle that fits, or the start where there is
/// no fence around it.
fn centre(checker: &Checker<'_>, airframe: &Airframe, start: Vector2<f64>) -> (Vector2<f64>, f64) {
    let open = OPEN_ROOM_S * airframe.speed_cruise_m_per_s;
    // Beyond what is of use more space is not better, but a shorter way is.
    let value = |p: Vector2<f64>| {
        let space = checker.clearance_at(p).min(open);
        (space - 0.05 * (p - start).norm(), space)
    };
    let (mut best, (mut best_value, mut best_room)) = (start, value(start));
    let (low, high) =
        checker.fence().bounds().unwrap_or((start.add_scalar(-2.0 * open), start.add_scalar(2.0 * open)));
    let mut look = |p: Vector2<f64>| {
        let (v, space) = value(p);
        if v > best_value {
            (best, best_value, best_room) = (p, v, space);
        }
        best
    };
    let cell = (high - low) / GRID as f64;
    let mut at = start;
    for i in 0..=GRID {
        for j in 0..=GRID {
            at = look(low + Vector2::new(cell.x * i as f64, cell.y * j as f64));
        }
    }
    let mut step = cell * 0.5;
    for _ in 0..6 {
        for (n, e) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
            at = look(at + Vector2::new(n * step.x, e * step.y));
        }
        step *= 0.5;
    }
    (best, best_room)
}

/// Placements at the best centre with some headings.
pub(super) fn placements(
    checker: &Checker<'_>,
    airframe: &Airframe,
    limits: &Limits,
    frame: LocalFrame,
    start: Vector2<f64>,
    start_height_m: f64,
) -> Vec<Placement> {
    let (center_m, space_m) = centre(checker, airframe, start);
    let wind = limits.wind();
    // Along and across the wind, and in between; runs are flown both ways.
    let first = if limits.wind_speed() > 0.5 { atan2(wind.y, wind.x) } else { 0.0 };
    // Climbs overshoot: not to the very floor and ceiling.
    let height_m = start_height_m.clamp(limits.floor_m + 3.0, limits.ceiling_m - 3.0);
    let headings = [0.0, 0.5, 0.25, 0.75].map(|share| first + share * std::f64::consts::PI);
    headings
        .map(|heading_rad| Placement {
            frame,
            center_m,
            space_m,
            heading_rad,
            height_m,
            band_m: [limits.floor_m, limits.ceiling_m],
            wind_m_per_s: limits.wind_speed(),
        })
        .to_vec()
}
