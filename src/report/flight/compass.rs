//! The compasses of the vehicle: a table with the answer first, what moves each, what corrects it, and the circle of its field.

use crate::compass::advice::SensorProposal;
use crate::compass::{CompassEntry, CompassReport, SensorEffect, Status};
use crate::report::page::{escape, table};
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
         the heading that acceleration and GNSS velocity show. No compass takes part in our estimate.</p>",
    );
    let rows = report.compasses.iter().map(|c| {
        [
            c.compass.to_string(),
            status(c.status).to_owned(),
            format!("{:.1} ± {:.1}", c.heading_off_deg.value, c.heading_off_deg.sigma),
            format!("{:.1}", c.own_heading_sigma_deg),
            format!("{:.1}, {:.1}", c.heading_rms_deg.before, c.heading_rms_deg.after),
            format!("{:.0} ({:.0})", c.length_mgauss[0], c.length_mgauss[1]),
            format!("{:.0}, {:.0}", c.held_out_mgauss.before, c.held_out_mgauss.after),
        ]
    });
    let titles = [
        "compass",
        "",
        "#heading off, deg",
        "#our sigma, deg",
        "#RMS, deg: reported, corrected",
        "#field, mG (Earth)",
        "#residual on held-out data, mG",
    ];
    body.push_str(&table(titles, rows));
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
    let rows = effects.iter().map(|e| {
        let value = |p: &crate::compass::SensorParameter| {
            format!("{} {:.2} ± {:.2} {}", p.name, p.value, p.sigma, p.unit)
        };
        let values: Vec<String> = e.parameters.iter().map(value).collect();
        let (names, what) = (escape(&e.names.join(" or ")), escape(e.description));
        [
            format!("{names}<br><small>{what}</small>"),
            escape(&values.join(", ")),
            format!("{:.0}", e.evidence),
            format!("{:.0}", e.held_out_gain),
            escape(e.remedy),
        ]
    });
    body.push_str(&table(["effect", "values ± sigma", "#evidence", "#held-out gain", "remedy"], rows));
    proposals(advice, body);
}

/// What the autopilot can correct, as a table; the same for reports of a flight and of an explanation.
fn proposals((proposals, not_proposed): (&[SensorProposal], &[String]), body: &mut String) {
    let rows = proposals.iter().map(|p| {
        [
            escape(&p.parameter),
            p.on_board.to_string(),
            p.proposed.to_string(),
            p.unit.to_string(),
            p.effect.to_string(),
            format!("<small>{}</small>", escape(p.source)),
        ]
    });
    body.push_str(&table(["parameter", "#on board", "#proposed", "unit", "for", "source"], rows));
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
