//! The page of `explain`: the result in words, what was found, before and after, where, and the fine print.

use super::heat;
use super::page;
pub use super::page::escape;
use super::plot::{AFTER, BEFORE, Line, Plot, lines};
use crate::explain::Explained;
use crate::explain::FlightGap;
use crate::explain::contract::{self, Explanation, Verdict};
use crate::explain::words::{self, number};
use gaware_nav::identify::judge::Judged;
use gaware_nav::identify::limits::NotFound;
use gaware_nav::identify::select::{Added, Settings};
use gaware_nav::identify::whereabouts::{CHANNELS, channel};
use std::fmt::Write;

fn headline(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "Explained",
        Verdict::Ambiguous => "Found, but not yet told apart",
        Verdict::NothingMissing => "Nothing is missing",
        Verdict::Unexplained => "Not explained",
    }
}

/// The whole page.
///
/// # Errors
/// What the drawing library says.
pub fn html(explained: &Explained) -> Result<String, String> {
    let e = &explained.explanation;
    let mut body = String::new();
    let logs = escape(&explained.logs.join(", "));
    let _ = write!(
        body,
        "<h1>{}</h1><p><small>{logs}{}</small></p><p class=\"verdict\">{}</p>",
        headline(e.verdict),
        if explained.validated.is_empty() {
            String::new()
        } else {
            format!(" · judged on {}", escape(&explained.validated.join(", ")))
        },
        words::sentences(&e.summary).map(escape).collect::<Vec<_>>().join("<br>")
    );
    effects(e, explained.judged.as_ref(), &mut body);
    small(e, &mut body);
    gaps(e, &mut body);
    for (k, gap) in explained.gaps.iter().enumerate() {
        let log = explained.logs.get(k).map_or("", String::as_str);
        maps(gap, log, !e.effects.is_empty(), &mut body)?;
    }
    places(e, &explained.logs, &mut body);
    regimes(e, &mut body);
    if let Some(judged) = &explained.judged {
        plots(judged, &mut body)?;
    }
    contributions(e, &mut body);
    terms(e, &mut body);
    noise(e, &mut body);
    not_found(&explained.not_found, &e.not_found, &mut body);
    let _ = write!(body, "<h2>The new model</h2><pre>{}</pre>", escape(&explained.model.to_toml()));
    how_to_read(&mut body);
    Ok(page::page(headline(e.verdict), &body))
}

fn how_to_read(body: &mut String) {
    let least = Settings::default().threshold;
    let _ = write!(
        body,
        "<h2>How to read this</h2><p>The simulation of the sensors is run along the flight; an <em>innovation</em> is the \
         difference between what a GNSS fix said and what the simulation expected. Squared and divided by its expected variance it \
         is 1 on average when nothing is missing. An effect is named when the odds that it is there exceed those of chance over \
         the whole catalogue; <em>log odds</em> of {least} are {:.0} to 1 (what a name needs at least), of 8 are 3000 to 1. \
         Held-out data took no part in choosing or fitting: other flights where given, otherwise every sixth block of five \
         seconds.</p>",
        least.exp()
    );
}

/// Every parameter with its sigma and unit, those that are surely not zero first.
fn values(added: &Added) -> String {
    let setting = &added.setting;
    let mut all: Vec<(f64, String)> = setting
        .parameters()
        .zip(setting.values.iter().zip(&setting.sigmas))
        .map(|((name, unit), (value, sigma))| {
            let text = if added.is_at_limit() {
                format!("{name} = {} {} or more", number(value / unit.si), unit.symbol)
            } else if *sigma > 0.0 {
                format!("{name} = {} ± {} {}", number(value / unit.si), number(sigma / unit.si), unit.symbol)
            } else {
                format!("{name} = {} {}", number(value / unit.si), unit.symbol)
            };
            (if *sigma > 0.0 { (value / sigma).abs() } else { f64::INFINITY }, text)
        })
        .collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let strong = |(z, text): &(f64, String)| {
        if *z > 3.0 { format!("<b>{}</b>", escape(text)) } else { format!("<small>{}</small>", escape(text)) }
    };
    all.iter().map(strong).collect::<Vec<_>>().join("<br>")
}

fn effects(e: &Explanation, judged: Option<&Judged>, body: &mut String) {
    if e.effects.is_empty() {
        return;
    }
    body.push_str(
        "<h2>What is missing</h2><table><tr><th>Effect</th><th>Values</th><th class=\"n\">log odds</th><th class=\"n\">log-likelihood gain</th></tr>",
    );
    for entry in &e.effects {
        let found = entry
            .parameters
            .keys()
            .next()
            .and_then(|name| judged?.selection.added.iter().find(|a| a.setting.effect.name() == *name));
        let what = gaware_nav::effects::find(entry.names.first().copied().unwrap_or_default())
            .map_or("", |effect| effect.description());
        let _ = write!(
            body,
            "<tr><td><b>{}</b><br>{what}{}</td><td>{}</td><td class=\"n\">{:.0}</td><td class=\"n\">{:.0}</td></tr>",
            escape(&entry.names.join(" or ")),
            entry
                .separate_by
                .as_ref()
                .map_or_else(String::new, |s| format!("<br><small>to tell apart: {}</small>", escape(s))),
            found.map_or_else(String::new, values),
            entry.evidence.log_odds,
            entry.evidence.log_likelihood_gain
        );
    }
    body.push_str("</table>");
}

fn small(e: &Explanation, body: &mut String) {
    if e.negligible.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Too small to matter</h2><p><small>There by the odds, but no more than what any simulation leaves out; not in the new \
         model.</small></p><table><tr><th>Effect</th><th class=\"n\">on the gyros, deg/s RMS</th><th class=\"n\">on the \
         accelerometers, m/s² RMS</th><th class=\"n\">on positions, m</th></tr>",
    );
    for n in &e.negligible {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            n.name,
            number(n.gyro_rad_per_s.to_degrees()),
            number(n.accel_m_per_s2),
            number(n.position_m)
        );
    }
    body.push_str("</table>");
}

/// What the vehicle did, and where it disagreed.
fn maps(gap: &FlightGap, log: &str, changed: bool, body: &mut String) -> Result<(), String> {
    if gap.before.is_empty() {
        return Ok(());
    }
    let _ = write!(
        body,
        "<h2>Where in the flight{}</h2><p><small>The sensors simulated along the best trajectory against what they measured. \
         Blank: they agree as well as their noise allows. The stronger the colour, the more they disagree.</small></p>",
        if log.is_empty() { String::new() } else { format!(" ({})", escape(log)) }
    );
    let series = |of: &dyn Fn(&gaware_nav::smoother::gap::Motion) -> f64| -> Vec<(f64, f64)> {
        let mut seconds: std::collections::BTreeMap<i64, (f64, f64)> = std::collections::BTreeMap::new();
        for p in &gap.before {
            let cell = seconds.entry(p.motion.elapsed_s as i64).or_default();
            *cell = (cell.0 + of(&p.motion), cell.1 + 1.0);
        }
        seconds.into_iter().map(|(t, (sum, n))| (t as f64, sum / n)).collect()
    };
    let load = series(&|m| -m.force.z / gaware_nav::earth::STANDARD_GRAVITY);
    let speed = series(&|m| m.speed);
    body.push_str(&Plot::new("speed", "m/s").line("speed", AFTER, speed).since(0.0).svg()?);
    body.push_str(&Plot::new("load", "g").line("load", AFTER, load).since(0.0).close().svg()?);
    body.push_str(&heat::map("with the model that was given", &gap.before, "#d6604d"));
    if changed {
        body.push_str(&heat::map("with the new model", &gap.after, "#d6604d"));
    }
    Ok(())
}

/// What a vehicle does for more than this share of a flight tells nothing.
const USUAL: f64 = 0.6;
/// Cells of the table of regimes that are shown at most.
const REGIMES_SHOWN: usize = 12;

fn regimes(e: &Explanation, body: &mut String) {
    let mut worst: Vec<_> =
        e.regimes.iter().filter(|r| (0.02..USUAL).contains(&r.share) && r.nis.before > 2.0).collect();
    if worst.is_empty() {
        return;
    }
    worst.sort_by(|a, b| (b.nis.before * (1.0 - b.share)).total_cmp(&(a.nis.before * (1.0 - a.share))));
    body.push_str(
        "<h2>What goes with the disagreement</h2><table><tr><th>Channel</th><th>When</th><th class=\"n\">share of the flight</th>\
         <th class=\"n\">squared residual before</th><th class=\"n\">after</th></tr>",
    );
    for r in worst.into_iter().take(REGIMES_SHOWN) {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{:.0} %</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            r.channel.replace('_', " "),
            escape(&r.regime),
            100.0 * r.share,
            number(r.nis.before),
            number(r.nis.after)
        );
    }
    body.push_str("</table>");
}

fn gaps(e: &Explanation, body: &mut String) {
    let Some(gap) = &e.gap else { return };
    body.push_str("<h2>Before and after</h2><table><tr><th></th><th class=\"n\">before</th><th class=\"n\">after</th></tr>");
    let mut row = |name: &str, before: f64, after: f64| {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            escape(name),
            number(before),
            number(after)
        );
    };
    row("squared normalised innovation, data that chose and fitted", gap.fit.before, gap.fit.after);
    row("squared normalised innovation, held-out data", gap.held_out.before, gap.held_out.after);
    for c in &gap.held_out_channels {
        let unit = if c.channel.starts_with("velocity") { "m/s" } else { "m" };
        row(&format!("{}, held out, {unit} RMS", c.channel.replace('_', " ")), c.rms.before, c.rms.after);
    }
    let mut drifts: Vec<_> = gap.drift_m.iter().collect();
    drifts.sort_by_key(|(time, _)| time.split('_').next().and_then(|t| t.parse::<u32>().ok()));
    for (time, drift) in drifts {
        row(
            &format!("drift without fixes after {}, m RMS", time.replace('_', " ")),
            drift.before,
            drift.after,
        );
    }
    body.push_str("</table>");
}

fn plots(judged: &Judged, body: &mut String) -> Result<(), String> {
    body.push_str("<h2>Innovations over time</h2><p><small>Innovations over their sigmas, mean of a second; ±1 is what noise does.</small></p>");
    for (c, name) in CHANNELS.iter().enumerate() {
        let series = |k: usize| -> Vec<(f64, f64)> {
            let mut seconds: std::collections::BTreeMap<i64, (f64, f64)> = std::collections::BTreeMap::new();
            for i in &judged.innovations[k] {
                if let Some(v) = channel(i, c) {
                    let cell = seconds.entry(i.elapsed_s as i64).or_default();
                    *cell = (cell.0 + v, cell.1 + 1.0);
                }
            }
            seconds.into_iter().map(|(t, (sum, n))| (t as f64, sum / n)).collect()
        };
        let mut shown = vec![Line { name: "before", color: BEFORE, points: series(0) }];
        if !judged.selection.added.is_empty() {
            shown.push(Line { name: "after", color: AFTER, points: series(1) });
        }
        body.push_str(&lines(&name.replace('_', " "), "sigma", &shown)?);
    }
    Ok(())
}

fn places(e: &Explanation, logs: &[String], body: &mut String) {
    if e.places.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Where the given model was worst</h2><table><tr><th>Channel</th><th>Time</th><th>What the vehicle did</th><th class=\"n\">Share</th></tr>",
    );
    for p in &e.places {
        let _ = write!(
            body,
            "<tr><td>{}{}</td><td>{:.0} to {:.0} s</td><td>{}</td><td class=\"n\">{:.0} %</td></tr>",
            p.channel.replace('_', " "),
            match logs.get(p.log).filter(|_| logs.len() > 1) {
                Some(log) => format!(" <small>({})</small>", escape(log)),
                None => String::new(),
            },
            p.t_start_s,
            p.t_end_s,
            escape(&p.regime),
            100.0 * p.share
        );
    }
    body.push_str("</table>");
}

fn contributions(e: &Explanation, body: &mut String) {
    if e.leave_one_out.is_empty() {
        return;
    }
    body.push_str(
        "<h2>What each effect contributes</h2><table><tr><th>Left out</th><th class=\"n\">log odds lost</th><th class=\"n\">held-out log-likelihood lost</th></tr>",
    );
    for l in &e.leave_one_out {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{:.1}</td><td class=\"n\">{:.1}</td></tr>",
            l.name, l.evidence, l.held_out_log_likelihood
        );
    }
    body.push_str("</table>");
}

fn terms(e: &Explanation, body: &mut String) {
    if e.unexplained_terms.is_empty() {
        return;
    }
    body.push_str("<h2>What no named effect explains</h2><table><tr><th>Channel</th><th>goes with</th><th class=\"n\">by</th></tr>");
    for t in &e.unexplained_terms {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{} ± {} {}</td></tr>",
            t.channel,
            escape(t.term),
            number(t.coefficient),
            number(t.sigma),
            escape(&t.unit)
        );
    }
    body.push_str("</table>");
}

fn noise(e: &Explanation, body: &mut String) {
    if e.noise.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Noise</h2><table><tr><th>Figure</th><th class=\"n\">claimed</th><th class=\"n\">fitted</th><th></th></tr>",
    );
    for n in &e.noise {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{} {}</td><td class=\"n\">{} ± {} {}</td><td>{}</td></tr>",
            n.name,
            number(n.assumed),
            n.unit,
            number(n.fitted),
            number(n.sigma),
            n.unit,
            n.finding.unwrap_or_default()
        );
    }
    body.push_str("</table>");
    if !e.assumed.is_empty() {
        let names: Vec<&str> = e.assumed.iter().map(|a| a.name).collect();
        let _ = write!(body, "<p>Assumed by the model: {}.</p>", escape(&names.join(", ")));
    }
}

/// An effect of this many sigmas would have been seen.
const SEEN: f64 = 3.0;

fn not_found(all: &[NotFound], told: &[contract::NotFound], body: &mut String) {
    if all.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Looked for and not found</h2><p><small>What these flights could not have shown: an effect smaller than the last column \
         (three sigmas of what the flights can know, on the best and on the worst of its axes) may be there all the same.</small></p>\
         <table><tr><th>Effect</th><th class=\"n\">log odds</th><th class=\"n\">unseen below</th></tr>",
    );
    for (found, told) in all.iter().zip(told) {
        let setting = &found.setting;
        let sizes = setting.parameters().zip(&setting.sigmas).filter(|(_, sigma)| **sigma > 0.0);
        let sizes: Vec<(f64, &str)> =
            sizes.map(|((_, unit), sigma)| (SEEN * sigma / unit.si, unit.symbol)).collect();
        let least = sizes.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
        let most = sizes.iter().map(|s| s.0).fold(0.0, f64::max);
        let Some((_, unit)) = sizes.first() else {
            let _ = write!(
                body,
                "<tr><td>{}</td><td class=\"n\">{:.1}</td><td>{}</td></tr>",
                setting.effect.name(),
                found.evidence,
                found.reason.unwrap_or_default()
            );
            continue;
        };
        let range =
            if most > 1.05 * least { format!("{} to {}", number(least), number(most)) } else { number(most) };
        let _ = write!(
            body,
            "<tr><td>{}{}</td><td class=\"n\">{:.1}</td><td class=\"n\">{range} {unit}{}</td></tr>",
            setting.effect.name(),
            if told.likely { " <small>not added, but likely</small>" } else { "" },
            found.evidence,
            found.reason.map_or_else(String::new, |r| format!(" <small>{r}</small>"))
        );
    }
    body.push_str("</table>");
}
