//! Barometers, airspeed sensors and the wind: a table with the answer first, what moves each, what corrects it, and its error against the speed.

use super::compass::{found, status};
use crate::air::{AirEntry, AirReport};
use crate::report::page::escape;
use crate::report::plot::{AFTER, BEFORE};
use std::fmt::Write;

/// Width and height of a drawing, px.
const SIZE: (f64, f64) = (480.0, 240.0);

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
        "<h2 id=\"air\">Barometers, airspeed and wind</h2><p>The pressure height against the height of the trajectory, with an offset that walks; the airspeed against \
         velocity less wind. Neither takes part in our estimate.</p><div class=\"wide\"><table><tr><th>sensor</th><th></th><th class=\"n\">largest error, at speed</th>\
         <th class=\"n\">RMS: reported, corrected</th><th class=\"n\">unseen up to (1 sigma)</th></tr>",
    );
    for s in &report.sensors {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{:.1} {unit} at {:.0} m/s</td><td class=\"n\">{:.2}, {:.2} {unit}</td><td class=\"n\">{:.1} {unit}</td></tr>",
            s.sensor,
            status(s.status),
            s.largest_error,
            s.at_m_per_s,
            s.residual.before,
            s.residual.after,
            s.known_to,
            unit = s.unit
        );
    }
    body.push_str("</table></div>");
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

/// Error by speed, as reported and as corrected.
fn drawing(s: &AirEntry) -> String {
    let most = |of: &dyn Fn(&[f64; 3]) -> f64| s.points.iter().map(of).fold(0.0, f64::max);
    let (speed, error) = (most(&|p| p[0]), most(&|p| p[1].abs().max(p[2].abs())));
    if !(speed > 0.0 && error > 0.0 && speed.is_finite() && error.is_finite()) {
        return String::new();
    }
    let (width, height) = SIZE;
    let dots = |which: usize, color: &str| {
        let mut path = String::new();
        for p in &s.points {
            let (x, y) = (width * p[0] / speed, 0.5 * height * (1.0 - p[which] / error));
            let _ = write!(path, "M{x:.1} {y:.1}h0");
        }
        format!(
            "<path d=\"{path}\" stroke=\"{color}\" stroke-width=\"3\" stroke-linecap=\"round\" fill=\"none\"/>"
        )
    };
    format!(
        "<figure><figcaption><b>error of {}</b> <small>by speed through the air, 0 to {speed:.0} m/s; ±{error:.1} {}</small> <span class=\"key\"><i \
         style=\"background:{BEFORE}\"></i>as reported</span><span class=\"key\"><i style=\"background:{AFTER}\"></i>corrected</span></figcaption><svg viewBox=\"0 0 {width} {height}\" \
         width=\"{width}\" style=\"max-width:100%\" role=\"img\" aria-label=\"error by speed, before and after\"><path d=\"M0 {half}H{width}\" stroke=\"currentColor\" opacity=\".3\"/>{}{}</svg></figure>",
        s.sensor,
        s.unit,
        dots(1, BEFORE),
        dots(2, AFTER),
        half = 0.5 * height
    )
}
