//! The compasses of the vehicle: a table with the answer first, what moves each, what corrects it, and the circle of its field.

use crate::compass::advice::SensorProposal;
use crate::compass::{CompassEntry, CompassReport, SensorEffect, Status};
use crate::report::page::escape;
use crate::report::plot::{AFTER, BEFORE};
use std::fmt::Write;

/// Side of a drawing, px.
const SIDE: f64 = 320.0;

/// The answer to "which compass is wrong?"; empty where the log holds none.
pub fn answer(report: &CompassReport) -> String {
    let texts: Vec<&str> = report.texts(|_| true).collect();
    if texts.is_empty() { report.notes.join(" ") } else { texts.join(" ") }
}

/// The section of the page.
pub fn section(report: &CompassReport, body: &mut String) {
    if report.compasses.is_empty() {
        return;
    }
    body.push_str(
        "<h2 id=\"compasses\">Compasses</h2><p>The heading of each compass, levelled by our roll and pitch and with the declination of the world model, against \
         the heading that acceleration and GNSS velocity show. No compass takes part in our estimate.</p><div class=\"wide\"><table><tr><th>compass</th><th></th>\
         <th class=\"n\">heading off, deg</th><th class=\"n\">our sigma, deg</th><th class=\"n\">RMS, deg: reported, corrected</th><th class=\"n\">field, mG (Earth)</th>\
         <th class=\"n\">residual on held-out data, mG</th></tr>",
    );
    for c in &report.compasses {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{:.1} ± {:.1}</td><td class=\"n\">{:.1}</td><td class=\"n\">{:.1}, {:.1}</td><td class=\"n\">{:.0} ({:.0})</td>\
             <td class=\"n\">{:.0}, {:.0}</td></tr>",
            c.compass,
            status(c.status),
            c.heading_off_deg.value,
            c.heading_off_deg.sigma,
            c.own_heading_sigma_deg,
            c.heading_rms_deg.before,
            c.heading_rms_deg.after,
            c.length_mgauss[0],
            c.length_mgauss[1],
            c.held_out_mgauss.before,
            c.held_out_mgauss.after
        );
    }
    body.push_str("</table></div>");
    for c in &report.compasses {
        compass(c, body);
    }
    for note in &report.notes {
        let _ = write!(body, "<p><small>{}</small></p>", escape(note));
    }
}

pub(super) fn status(status: Status) -> &'static str {
    match status {
        Status::Ok => "ok",
        Status::Wrong => "<b>wrong</b>",
        Status::NotKnown => "not known",
    }
}

fn compass(c: &CompassEntry, body: &mut String) {
    let _ = write!(body, "<h3>Compass {}</h3><p>{}</p>", c.compass, escape(&c.text));
    found(&c.effects, (&c.proposals, &c.not_proposed), body);
    body.push_str(&circle(c));
}

/// What a flight shows of a sensor, and what corrects it.
pub(super) fn found(effects: &[SensorEffect], advice: (&[SensorProposal], &[String]), body: &mut String) {
    if !effects.is_empty() {
        body.push_str(
            "<div class=\"wide\"><table><tr><th>effect</th><th>values ± sigma</th><th class=\"n\">evidence</th><th class=\"n\">held-out gain</th><th>remedy</th></tr>",
        );
        for e in effects {
            let value = |p: &crate::compass::SensorParameter| {
                format!("{} {:.2} ± {:.2} {}", p.name, p.value, p.sigma, p.unit)
            };
            let values: Vec<String> = e.parameters.iter().map(value).collect();
            let _ = write!(
                body,
                "<tr><td>{}<br><small>{}</small></td><td>{}</td><td class=\"n\">{:.0}</td><td class=\"n\">{:.0}</td><td>{}</td></tr>",
                escape(&e.names.join(" or ")),
                escape(e.description),
                escape(&values.join(", ")),
                e.evidence,
                e.held_out_gain,
                escape(e.remedy)
            );
        }
        body.push_str("</table></div>");
    }
    proposals(advice, body);
}

/// What the autopilot can correct, as a table; the same for reports of a flight and of an explanation.
fn proposals((proposals, not_proposed): (&[SensorProposal], &[String]), body: &mut String) {
    if !proposals.is_empty() {
        body.push_str(
            "<div class=\"wide\"><table><tr><th>parameter</th><th class=\"n\">on board</th><th class=\"n\">proposed</th><th>unit</th><th>for</th><th>source</th></tr>",
        );
        for p in proposals {
            let _ = write!(
                body,
                "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td><td><small>{}</small></td></tr>",
                escape(&p.parameter),
                p.on_board,
                p.proposed,
                p.unit,
                p.effect,
                escape(p.source)
            );
        }
        body.push_str("</table></div>");
    }
    for why in not_proposed {
        let _ = write!(body, "<p><small>Not proposed: {}.</small></p>", escape(why));
    }
}

/// The horizontal field in the axes of the levelled vehicle: a compass in order draws the circle of the Earth's field.
fn circle(c: &CompassEntry) -> String {
    let most = |p: &[f64; 2]| p[0].abs().max(p[1].abs());
    let reach = c.circle.iter().flatten().map(most).fold(1.1 * c.horizontal_mgauss, f64::max) * 1.05;
    if c.circle.is_empty() || !reach.is_finite() {
        return String::new();
    }
    let half = 0.5 * SIDE;
    let at = |v: f64| half * v / reach;
    let dots = |which: usize, color: &str| {
        let mut path = String::new();
        for pair in &c.circle {
            // Forward is up, right is right.
            let _ = write!(path, "M{:.1} {:.1}h0", half + at(pair[which][1]), half - at(pair[which][0]));
        }
        format!(
            "<path d=\"{path}\" stroke=\"{color}\" stroke-width=\"3\" stroke-linecap=\"round\" fill=\"none\"/>"
        )
    };
    format!(
        "<figure><figcaption><b>horizontal field of compass {}</b> <small>mG, forward up; the circle is the Earth's {:.0} mG</small> <span class=\"key\"><i \
         style=\"background:{BEFORE}\"></i>as reported</span><span class=\"key\"><i style=\"background:{AFTER}\"></i>corrected</span></figcaption><svg viewBox=\"0 0 {SIDE} {SIDE}\" \
         width=\"{SIDE}\" role=\"img\" aria-label=\"horizontal field, before and after\"><path d=\"M0 {half}H{SIDE}M{half} 0V{SIDE}\" stroke=\"currentColor\" opacity=\".3\"/>\
         {}{}<circle cx=\"{half}\" cy=\"{half}\" r=\"{:.1}\" fill=\"none\" stroke=\"currentColor\"/></svg></figure>",
        c.compass,
        c.horizontal_mgauss,
        dots(0, BEFORE),
        dots(1, AFTER),
        at(c.horizontal_mgauss)
    )
}
