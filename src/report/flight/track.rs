//! The track over the ground, with the parts that taught most.

use super::lessons::Lesson;
use crate::engine::snapshot::{Phase, Snapshot};
use gaware_nav::rotation::wrap_pi;
use std::fmt::Write;

/// Size of the drawing.
const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 420.0;
const MARGIN: f64 = 28.0;
/// Metres per degree of latitude, near enough for a drawing.
const M_PER_DEG: f64 = 111_200.0;

/// East and north of the first point, m, with the time; nothing while there is no estimate.
fn points(snapshots: &[Snapshot]) -> Vec<(f64, f64, f64)> {
    let running = || snapshots.iter().filter(|s| s.phase == Phase::Running);
    let Some(first) = running().next().map(|s| s.motion) else { return Vec::new() };
    let east = M_PER_DEG * first.lat_deg.to_radians().cos();
    running()
        .map(|s| {
            let lon = wrap_pi((s.motion.lon_deg - first.lon_deg).to_radians()).to_degrees();
            (s.elapsed_s, east * lon, M_PER_DEG * (s.motion.lat_deg - first.lat_deg))
        })
        .filter(|(_, e, n)| e.is_finite() && n.is_finite())
        .collect()
}

/// The longest of 1, 2, 5 · 10^k that is not above this.
fn round_length(m: f64) -> f64 {
    let power = 10_f64.powf(m.max(1.0).log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|f| f * power).find(|l| *l <= m).unwrap_or(power)
}

/// A place for a number near the one wanted that lies on none before.
fn free_place(taken: &mut Vec<(f64, f64)>, wanted: (f64, f64)) -> (f64, f64) {
    const STEPS: [(f64, f64); 9] = [
        (0.0, 0.0),
        (0.0, -18.0),
        (18.0, 0.0),
        (0.0, 18.0),
        (-30.0, 0.0),
        (18.0, -18.0),
        (18.0, 18.0),
        (-30.0, -18.0),
        (-30.0, 18.0),
    ];
    let places = (1..=4).flat_map(|ring| {
        STEPS.map(|(dx, dy)| (wanted.0 + f64::from(ring) * dx, wanted.1 + f64::from(ring) * dy))
    });
    let free = |p: &(f64, f64)| taken.iter().all(|t| (t.0 - p.0).abs() > 16.0 || (t.1 - p.1).abs() > 16.0);
    let place = places
        .filter(|p| p.0 > 4.0 && p.0 < WIDTH - 20.0 && p.1 > 16.0 && p.1 < HEIGHT)
        .find(free)
        .unwrap_or(wanted);
    taken.push(place);
    place
}

/// The drawing as inline SVG; empty where there is no track. North is up; numbers are those of the lessons.
pub fn svg(snapshots: &[Snapshot], lessons: &[Lesson]) -> String {
    let points = points(snapshots);
    let span = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
        points.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    };
    let ((west, east), (south, north)) = (span(&|p| p.1), span(&|p| p.2));
    let (Some(start), Some(end)) = (points.first(), points.last()) else { return String::new() };
    let scale = ((WIDTH - 2.0 * MARGIN) / (east - west).max(10.0))
        .min((HEIGHT - 2.0 * MARGIN) / (north - south).max(10.0));
    let left = 0.5 * (WIDTH - scale * (east - west));
    let x = |e: f64| left + scale * (e - west);
    let y = |n: f64| HEIGHT - MARGIN - scale * (n - south);
    let path = |of: &mut dyn Iterator<Item = &(f64, f64, f64)>| {
        of.map(|(_, e, n)| format!("{:.1},{:.1}", x(*e), y(*n))).collect::<Vec<_>>().join(" ")
    };
    let mut out = format!(
        "<div class=\"drawing\"><svg class=\"plot\" role=\"img\" viewBox=\"0 0 {WIDTH:.0} {HEIGHT:.0}\" font-family=\"sans-serif\" font-size=\"15\" \
         fill=\"currentColor\"><title>Track over the ground, north up</title><polyline points=\"{}\" fill=\"none\" \
         stroke=\"currentColor\" stroke-opacity=\".45\"/>",
        path(&mut points.iter())
    );
    let mut taken = Vec::new();
    for (lesson, k) in lessons.iter().zip(1..) {
        let part = || points.iter().filter(|p| (lesson.start_s..=lesson.end_s).contains(&p.0));
        let _ = write!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"#2a82be\" stroke-width=\"3\"/>",
            path(&mut part())
        );
        if let Some((_, e, n)) = part().nth(part().count() / 2) {
            let at = free_place(&mut taken, (x(*e) + 8.0, y(*n) - 6.0));
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"15\" font-weight=\"bold\" stroke=\"var(--paper)\" \
                 stroke-width=\"4\" paint-order=\"stroke\">{k}</text>",
                at.0, at.1
            );
        }
    }
    for (point, name, anchor) in [(start, "start", "end"), (end, "end", "start")] {
        let dx = if anchor == "end" { -7.0 } else { 7.0 };
        let _ = write!(
            out,
            "<circle cx=\"{0:.1}\" cy=\"{1:.1}\" r=\"4\"/><text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"{anchor}\">{name}</text>",
            x(point.1),
            y(point.2),
            x(point.1) + dx,
            y(point.2) + 4.0
        );
    }
    let bar = round_length(150.0 / scale);
    let _ = write!(
        out,
        "<path d=\"M10 {0:.0}h{1:.1}\" stroke=\"currentColor\" stroke-width=\"2\"/><text x=\"10\" y=\"{2:.0}\">{bar:.0} m</text></svg></div>",
        HEIGHT - 8.0,
        scale * bar,
        HEIGHT - 13.0
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_over_the_date_line_stays_small() {
        let at = |lon_deg: f64, elapsed_s: f64| {
            let mut s = Snapshot { phase: Phase::Running, elapsed_s, ..Snapshot::default() };
            (s.motion.lat_deg, s.motion.lon_deg) = (-17.0, lon_deg);
            s
        };
        let track = points(&[at(179.999, 0.0), at(-179.999, 1.0)]);
        assert!((track[1].1 - 0.002 * M_PER_DEG * 17.0_f64.to_radians().cos()).abs() < 1.0, "{track:?}");
        assert_eq!(svg(&[], &[]), "");
        assert!(svg(&[at(10.0, 0.0)], &[]).contains("start"));
    }

    #[test]
    fn lengths_of_the_scale_are_round() {
        assert_eq!([round_length(7.0), round_length(23.0), round_length(512.0)], [5.0, 20.0, 500.0]);
    }
}
