//! Barometers, airspeed sensors, drag and the wind: a table with the answer first, what moves each, what corrects it, and its error against the speed.

use super::compass::{found, status};
use crate::air::{AirEntry, AirReport};
use crate::report::page::{escape, table};
use crate::report::plot::{AFTER, BEFORE, SMALL as SIZE, label, short, ticks};
use std::fmt::Write;

/// Left, right, above and below the axes, px.
const MARGIN: [f64; 4] = [38.0, 10.0, 8.0, 38.0];
/// The axes reach so much farther than the outermost dots.
const REACH: f64 = 1.06;
/// A smaller error is of no interest, m or m/s.
const LEAST: f64 = 0.1;

/// The answer to what is wrong; the reason where nothing was judged.
pub fn answer(report: &AirReport) -> String {
    let wind = report.sensors.iter().filter_map(|s| s.wind.as_ref().map(|w| format!("By it: {}.", w.text)));
    let texts: Vec<String> = report.sensors.iter().map(|c| c.text.clone()).chain(wind).collect();
    if texts.is_empty() { report.notes.join(" ") } else { texts.join(" ") }
}

/// The section of the page.
pub fn section(report: &AirReport, body: &mut String) {
    if report.sensors.is_empty() {
        return;
    }
    body.push_str(
        "<h2 id=\"air\">Barometers, airspeed, drag and wind</h2><p>The pressure height against the height of the trajectory, about its mean over two minutes; the airspeed against \
         velocity less the wind that goes with it; the specific force of a multirotor along body x and y against its drag in such a wind. None of it takes part in our estimate. RMS: on every third block of 20 s, corrected by what the others show; an effect is named only \
         where that makes it smaller.</p>",
    );
    let rows = report.sensors.iter().map(|s| {
        let largest = match s.effects.is_empty() && s.largest_error.abs() < LEAST {
            true => "none found".to_owned(),
            false => format!("{:.1} {} at {:.0} m/s", s.largest_error, s.unit, s.at_m_per_s),
        };
        let unseen = if s.known_to < LEAST { format!("under {LEAST}") } else { format!("{:.1}", s.known_to) };
        [
            s.sensor.to_string(),
            status(s.status).to_owned(),
            largest,
            format!("{:.2}, {:.2} {}", s.held_out.before, s.held_out.after, s.unit),
            format!("{unseen} {}", s.unit),
        ]
    });
    let titles = [
        "sensor",
        "",
        "#largest error, at speed",
        "#RMS on held-out data: reported, corrected",
        "#error that would not have shown (1 sigma)",
    ];
    body.push_str(&table(titles, rows));
    for s in &report.sensors {
        let _ = write!(body, "<h3>{}</h3><p>{}</p>", s.sensor, escape(&s.text));
        if let Some(wind) = &s.wind {
            let _ = write!(body, "<p>By it: {}.</p>", escape(&wind.text));
        }
        found(&s.effects, (&s.proposals, &s.not_proposed), body);
        body.push_str(&drawing(s));
    }
    for note in &report.notes {
        let _ = write!(body, "<p><small>{}</small></p>", escape(note));
    }
}

/// Error by speed, as reported and as corrected: what the RMS of the table is of.
fn drawing(s: &AirEntry) -> String {
    let finite = |p: &&[f64; 3]| p.iter().all(|v| v.is_finite());
    let points: Vec<&[f64; 3]> = s.points.iter().filter(finite).collect();
    let most = |of: &dyn Fn(&[f64; 3]) -> f64| points.iter().map(|p| of(p)).fold(0.0, f64::max);
    let (speed, error) = (most(&|p| p[0]) * REACH, most(&|p| p[1].abs().max(p[2].abs())) * REACH);
    if !(speed > 0.0 && error > 0.0) {
        return String::new();
    }
    let ([left, right, top, bottom], (width, height)) = (MARGIN, SIZE);
    let x = |v: f64| left + (width - left - right) * v / speed;
    let y = |v: f64| top + (height - top - bottom) * 0.5 * (1.0 - v / error);
    let mut svg = format!(
        "<path d=\"M{left} {top}V{:.1}H{:.1}M{left} {:.1}H{:.1}\" stroke=\"currentColor\" opacity=\".3\" fill=\"none\"/>",
        height - bottom,
        width - right,
        y(0.0),
        width - right
    );
    for v in ticks([0.0, speed]) {
        label(&mut svg, (x(v), height - bottom + 15.0), "middle", &short(v));
    }
    for v in ticks([-error, error]) {
        label(&mut svg, (left - 5.0, y(v) + 4.0), "end", &short(v));
    }
    label(&mut svg, (0.5 * (left + width - right), height - 4.0), "middle", "speed through the air, m/s");
    for (which, color) in [(1, BEFORE), (2, AFTER)] {
        let mut path = String::new();
        for p in &points {
            let _ = write!(path, "M{:.1} {:.1}h0", x(p[0]), y(p[which]));
        }
        let _ = write!(
            svg,
            "<path d=\"{path}\" stroke=\"{color}\" stroke-width=\"3\" stroke-linecap=\"round\" fill=\"none\"/>"
        );
    }
    let about = match s.unit {
        "m" => "error of the height, m, about its mean over two minutes",
        "m/s" => "error of the airspeed, m/s, in the wind that it shows",
        _ => "specific force against the motion, m/s², along body x and y; corrected: less the drag",
    };
    format!(
        "<figure><figcaption><b>{}</b> <small>{about}</small> <span class=\"key\"><i style=\"background:{BEFORE}\"></i>as reported</span><span class=\"key\"><i \
         style=\"background:{AFTER}\"></i>corrected</span></figcaption><svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" style=\"max-width:100%\" role=\"img\" \
         aria-label=\"error by speed through the air, before and after\">{svg}</svg></figure>",
        s.sensor
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compass::Status;
    use crate::explain::contract::BeforeAfter;

    fn entry(points: Vec<[f64; 3]>) -> AirEntry {
        AirEntry {
            sensor: "Barometer 1".to_owned(),
            status: Status::Ok,
            text: "Barometer 1 is.".to_owned(),
            unit: "m",
            largest_error: 0.0,
            at_m_per_s: 0.0,
            residual: BeforeAfter { before: 1.0, after: 1.0 },
            held_out: BeforeAfter { before: 1.25, after: 0.75 },
            known_to: 0.02,
            effects: Vec::new(),
            removed: Vec::new(),
            not_found: Vec::new(),
            wind: None,
            proposals: Vec::new(),
            not_proposed: Vec::new(),
            points,
        }
    }

    /// Places of dots or letters in a drawing.
    fn places(of: &str, start: &str) -> Vec<(f64, f64)> {
        let place = |part: &str| {
            let mut numbers = part.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'));
            let mut next = || numbers.find(|n| !n.is_empty()).and_then(|n| n.parse().ok());
            Some((next()?, next()?))
        };
        of.split(start).skip(1).filter_map(place).collect()
    }

    /// Axes have numbers and units, no dot touches the border, and no letter shrinks on a phone of 390 pixels.
    #[test]
    fn a_drawing_has_axes_with_units_and_its_dots_lie_inside() {
        let svg = drawing(&entry(vec![[0.5, 3.0, 0.4], [22.0, -4.0, 0.2], [11.0, f64::NAN, 0.0]]));
        let dots = svg.split_once("stroke-width").map(|_| svg.split("<path").skip(2).collect::<String>());
        let dots = places(&dots.unwrap(), "M");
        assert_eq!(dots.len(), 4, "{svg}");
        for (x, y) in dots {
            assert!(x > MARGIN[0] + 1.5 && x < SIZE.0 - MARGIN[1] - 1.5, "{x}");
            assert!(y > MARGIN[2] + 1.5 && y < SIZE.1 - MARGIN[3] - 1.5, "{y}");
        }
        for text in
            ["speed through the air, m/s", "error of the height, m", ">20</text>", ">-4</text>", ">0</text>"]
        {
            assert!(svg.contains(text), "{text}: {svg}");
        }
        assert!(
            SIZE.0 <= 358.0,
            "wider than the text of a page of 390 pixels, it would shrink with its letters"
        );
        assert_eq!(drawing(&entry(vec![])), "");
    }

    #[test]
    fn the_table_shows_what_decided_and_no_error_of_nothing() {
        let mut body = String::new();
        section(&AirReport { sensors: vec![entry(vec![])], notes: vec![] }, &mut body);
        assert!(
            body.contains("1.25, 0.75 m") && body.contains("under 0.1 m") && !body.contains(">0.0 m<"),
            "{body}"
        );
    }
}
