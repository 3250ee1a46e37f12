//! The track over the ground, with the parts that taught most.

use super::lessons::Lesson;
use crate::engine::snapshot::{Phase, Snapshot};
use crate::report::plot::span;
use gaware_mission::fence::LocalFrame;
use gaware_mission::item::LatLon;
use gaware_nav::math::{hypot, log10, powf};
use std::fmt::Write;

/// Size of the drawing.
const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 420.0;
const MARGIN: f64 = 28.0;
/// A vehicle that never went further than this from any point of its track has not flown, m: what is drawn would be the noise of its position.
const AT_REST_M: f64 = 10.0;
/// Half the height and half the width of a number, and of the words at start and end, with some space around them.
const NUMBER: (f64, f64) = (8.0, 8.0);
const WORD: (f64, f64) = (24.0, 8.0);

/// East and north of the first point, m, with the time; nothing while there is no estimate.
fn points(snapshots: &[Snapshot]) -> Vec<(f64, f64, f64)> {
    let running = || snapshots.iter().filter(|s| s.phase == Phase::Running);
    let place = |s: &Snapshot| LatLon { lat_deg: s.motion.lat_deg, lon_deg: s.motion.lon_deg };
    let Some(frame) = running().next().map(|s| LocalFrame::new(place(s))) else { return Vec::new() };
    running()
        .map(|s| {
            let at = frame.to_local(place(s));
            (s.elapsed_s, at.y, at.x)
        })
        .filter(|(_, e, n)| e.is_finite() && n.is_finite())
        .collect()
}

/// The longest of 1, 2, 5 · 10^k that is not above this.
fn round_length(m: f64) -> f64 {
    let power = powf(10_f64, log10(m.max(1.0)).floor());
    [5.0, 2.0, 1.0].into_iter().map(|f| f * power).find(|l| *l <= m).unwrap_or(power)
}

/// Something that is written: its middle, and half its width and height.
type Label = ((f64, f64), (f64, f64));

/// A place for a number near the one wanted that lies on nothing written before.
fn free_place(taken: &mut Vec<Label>, wanted: (f64, f64)) -> (f64, f64) {
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
    let free = |p: &(f64, f64)| {
        taken.iter().all(|((x, y), (width, height))| {
            (x - p.0).abs() > width + NUMBER.0 || (y - p.1).abs() > height + NUMBER.1
        })
    };
    let place = places
        .filter(|p| p.0 > 4.0 && p.0 < WIDTH - 20.0 && p.1 > 16.0 && p.1 < HEIGHT)
        .find(free)
        .unwrap_or(wanted);
    taken.push((place, NUMBER));
    place
}

/// Names start and end, each on the side away from the other, so that they never lie on one another.
fn ends(start: (f64, f64), end: (f64, f64), taken: &mut Vec<Label>) -> String {
    let mut out = String::new();
    for (point, other, name, on_a_line) in [(start, end, "start", -1.0), (end, start, "end", 1.0)] {
        let side = if point.0 == other.0 { on_a_line } else { (point.0 - other.0).signum() };
        let anchor = if side < 0.0 { "end" } else { "start" };
        // The middle of the text, as numbers have theirs at the left of their baseline.
        taken.push(((point.0 + side * (7.0 + WORD.0) - NUMBER.0, point.1 + 4.0), WORD));
        let _ = write!(
            out,
            "<circle cx=\"{0:.1}\" cy=\"{1:.1}\" r=\"4\"/><text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"{anchor}\" stroke=\"var(--paper)\" \
             stroke-width=\"4\" paint-order=\"stroke\">{name}</text>",
            point.0,
            point.1,
            point.0 + 7.0 * side,
            point.1 + 4.0
        );
    }
    out
}

/// The drawing as inline SVG; a sentence of a vehicle that was at rest; empty where there is no track. North is up; numbers are those of
/// the lessons.
pub fn svg(snapshots: &[Snapshot], lessons: &[Lesson]) -> String {
    let points = points(snapshots);
    let ((west, east), (south, north)) = (span(points.iter().map(|p| p.1)), span(points.iter().map(|p| p.2)));
    let (Some(start), Some(end)) = (points.first(), points.last()) else { return String::new() };
    let size_m = hypot(east - west, north - south);
    if size_m < AT_REST_M {
        return format!(
            "<p>The vehicle stayed within {:.0} m: there is no track to draw.</p>",
            size_m.max(1.0).ceil()
        );
    }
    let scale = ((WIDTH - 2.0 * MARGIN) / (east - west)).min((HEIGHT - 2.0 * MARGIN) / (north - south));
    let (left, bottom) = (0.5 * (WIDTH - scale * (east - west)), 0.5 * (HEIGHT + scale * (north - south)));
    let x = |e: f64| left + scale * (e - west);
    let y = |n: f64| bottom - scale * (n - south);
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
    let ends = ends((x(start.1), y(start.2)), (x(end.1), y(end.2)), &mut taken);
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
    out.push_str(&ends);
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
        assert!(
            (track[1].1 - 0.002 * 111_320.0 * gaware_nav::math::cos(17.0_f64.to_radians())).abs() < 1.0,
            "{track:?}"
        );
        assert_eq!(svg(&[], &[]), "");
        assert!(svg(&[at(10.0, 0.0)], &[]).contains("stayed within 1 m"));
        assert!(svg(&[at(10.0, 0.0), at(10.001, 1.0)], &[]).contains("start"));
    }

    /// Position and side of the words at start and end.
    fn words(html: &str) -> [(f64, bool); 2] {
        ["start", "end"].map(|name| {
            let text = &html[..html.find(&format!(">{name}</text>")).unwrap()];
            let text = &text[text.rfind("<text").unwrap()..];
            let x = text.split("x=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
            (x, text.contains("text-anchor=\"start\""))
        })
    }

    #[test]
    fn the_words_at_start_and_end_lie_apart_wherever_the_flight_ends() {
        for end in [10.0005, 9.9995, 10.0] {
            let track = [10.0, 10.004, end].map(|lon_deg| {
                let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
                (s.motion.lat_deg, s.motion.lon_deg) = (47.0, lon_deg);
                s
            });
            let [(start, start_to_the_right), (end, end_to_the_right)] = words(&svg(&track, &[]));
            assert_ne!(start_to_the_right, end_to_the_right);
            assert_eq!(start > end, start_to_the_right, "{start} {end}");
        }
    }

    #[test]
    fn numbers_keep_away_from_the_words() {
        let mut taken = Vec::new();
        let _ = ends((400.0, 200.0), (430.0, 200.0), &mut taken);
        let at = free_place(&mut taken, (400.0 - 30.0, 204.0));
        assert!((at.1 - 204.0).abs() > 16.0 || at.0 + 16.0 < 345.0 || at.0 > 393.0, "{at:?}");
    }

    #[test]
    fn lengths_of_the_scale_are_round() {
        assert_eq!([round_length(7.0), round_length(23.0), round_length(512.0)], [5.0, 20.0, 500.0]);
    }
}
