//! The first screen: headline, verdict with the improvement on held-out data, and for each effect its size, consequence and remedy.

use super::effects::{self, description};
use super::{channel_unit, found, spoken, values};
use crate::explain::Explained;
use crate::explain::contract::{ChannelResidual, EffectEntry, Explanation, ModelResidual, Verdict};
use crate::explain::words::number;
use crate::report::page::{answers, capitalised, escape};
use std::fmt::Write;

/// The verdict in words.
pub fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "Explained",
        Verdict::Ambiguous => "Explained by several effects alike",
        Verdict::NothingMissing => "No unmodelled effect",
        Verdict::Unexplained => "Not explained",
        Verdict::TooLittleData => "Too little data",
    }
}

/// The result in one short sentence.
pub fn headline(explained: &Explained) -> String {
    let e = &explained.explanation;
    let names: Vec<String> = e.effects.iter().map(|x| x.names.join(" or ")).collect();
    match (e.verdict, &e.effects[..]) {
        (Verdict::TooLittleData, _) => e.summary.clone(),
        (Verdict::NothingMissing, _) => "No unmodelled effect is significant.".to_owned(),
        (Verdict::Explained, [one]) => format!("{}.", sized(one, explained)),
        (Verdict::Explained, _) => format!("{} unmodelled effects: {}.", names.len(), names.join(", ")),
        (Verdict::Ambiguous, [one]) => format!("Unmodelled effect: one of {}.", one.names.join(", ")),
        (Verdict::Ambiguous, all) => {
            let alone: Vec<_> = all.iter().filter(|x| x.names.len() == 1).collect();
            let open = all.len() - alone.len();
            match &alone[..] {
                [] => format!("{open} unmodelled effects, each with more than one candidate."),
                // As certain as in a flight that is explained: its value belongs to the first line.
                [one] => format!("{}; beside it {open} with more than one candidate.", sized(one, explained)),
                several => {
                    let names: Vec<_> = several.iter().map(|x| x.names.concat()).collect();
                    format!("{}; beside them {open} with more than one candidate.", names.join(", "))
                }
            }
        }
        (Verdict::Unexplained, _) => format!("Not explained: {}.", open(e)),
    }
}

/// What an effect is, and how large.
fn sized(one: &EffectEntry, explained: &Explained) -> String {
    let size = found(one, explained.judged.as_ref()).map(values).unwrap_or_default();
    let size = size.first().map_or_else(String::new, |v| format!(": {}", v.text));
    format!("{}{size}", capitalised(description(one)))
}

/// What is left open.
fn open(e: &Explanation) -> String {
    if let Some(term) = e.unexplained_terms.first() {
        return format!(
            "{} has a residual that correlates with {}",
            term.channel.replace('_', " "),
            spoken(term.term)
        );
    }
    if let Some(finding) = e.noise.iter().filter(|n| !n.plausible).find_map(|n| n.finding) {
        return format!("{} beyond what such a sensor has", finding.replace('_', " "));
    }
    if e.effects.is_empty() {
        return "no effect of the catalogue reduces the residuals".to_owned();
    }
    let names: Vec<String> = e.effects.iter().map(|x| x.names.join(" or ")).collect();
    format!("{} fits, but not as a physical effect", names.join(", "))
}

/// Headline, origin, verdict, effects.
pub fn section(explained: &Explained, body: &mut String) {
    let e = &explained.explanation;
    let validated = if explained.validated.is_empty() {
        String::new()
    } else {
        format!(" · held out: {}", escape(&explained.validated.join(", ")))
    };
    let seconds: f64 =
        explained.residuals.iter().filter_map(|g| g.before.last()).map(|p| p.motion.elapsed_s).sum();
    let length = if seconds > 0.0 { format!(" · {seconds:.0} s analysed") } else { String::new() };
    let _ = write!(
        body,
        "<h1>{}</h1><p class=\"quiet\">{}{validated}{length} · gaware {}</p><p class=\"verdict\"><b>{}.</b> {}</p>",
        escape(&headline(explained)),
        escape(&explained.logs.join(", ")),
        env!("CARGO_PKG_VERSION"),
        verdict(e.verdict),
        e.residual.as_ref().map_or_else(String::new, |residual| improvement(residual, e.effects.is_empty()))
    );
    effects::first_screen(explained, body);
    let now = match (explained.unfit, e.effects.is_empty()) {
        (None, _) => next(e),
        (Some(unfit), true) => unfit.remedy(),
        (Some(unfit), false) => format!("Do not set the values above. {}", unfit.remedy()),
    };
    let notes: Vec<_> = explained.notes.iter().map(|note| escape(note)).collect();
    body.push_str(&answers(&[
        ("What now?", now),
        ("What is left?", left(e)),
        ("What of the recording?", notes.join("<br>")),
    ]));
}

/// What the new model does to held-out data.
fn improvement(residual: &ModelResidual, same: bool) -> String {
    let held = &residual.held_out;
    if same {
        return format!("Held-out data: NIS {} per degree of freedom (1 is expected).", number(held.before));
    }
    let mut text = format!(
        "Held-out data: NIS {} → {} per degree of freedom (1 is expected)",
        number(held.before),
        number(held.after)
    );
    let shrink = |c: &ChannelResidual| c.nis.before - c.nis.after;
    if let Some(c) = residual.held_out_channels.iter().max_by(|a, b| shrink(a).total_cmp(&shrink(b))) {
        let _ = write!(
            text,
            "; {} {} → {} {} RMS",
            c.channel.replace('_', " "),
            number(c.rms.before),
            number(c.rms.after),
            channel_unit(c.channel)
        );
    }
    if let Some(d) = residual.drift_m.get("30_s") {
        let _ = write!(
            text,
            "; position error after 30 s without fixes {} → {} m RMS",
            number(d.before),
            number(d.after)
        );
    }
    text + "."
}

/// What to do with the result.
fn next(e: &Explanation) -> String {
    let model = "<code>model.toml</code>, written beside this report, holds the new values: <code>gaware replay LOG --model model.toml</code>.";
    match e.verdict {
        Verdict::Explained => format!("Apply the remedy, or use the new model: {model}"),
        Verdict::Ambiguous => {
            let maneuver = if e.effects.len() > 1 { "<a href=\"#detail\">maneuver that separates the candidates</a>" } else { "maneuver above" };
            format!("Fly the {maneuver} and run <code>gaware explain</code> on both logs. Until then: {model}")
        }
        Verdict::NothingMissing => {
            "Keep the model. <a href=\"#effects\">Detection limits</a> say how large an effect could still be.".to_owned()
        }
        Verdict::TooLittleData => {
            "Record at least 40 s of flight with GNSS fixes and maneuvers, then run <code>gaware explain</code> again.".to_owned()
        }
        Verdict::Unexplained => "Do not use the values above. Look at <a href=\"#where\">where the residuals are large</a> and at \
                                 the <a href=\"#noise\">noise</a>: vibration, clipping and wrong time stamps are not in the \
                                 catalogue."
            .to_owned(),
    }
}

/// What the effects named do not cover.
fn left(e: &Explanation) -> String {
    let mut out: Vec<String> = e
        .unexplained_terms
        .iter()
        .map(|t| {
            format!(
                "{} correlates with {}: {} ± {} {}.",
                t.channel.replace('_', " "),
                escape(&spoken(t.term)),
                number(t.coefficient),
                number(t.sigma),
                escape(&t.unit.replace("m/s2", "m/s²").replace("^2", "²").replace('*', "·"))
            )
        })
        .collect();
    let mut list = |names: Vec<&str>, why: &str| {
        if !names.is_empty() {
            out.push(format!("{}: {why}.", names.join(", ")));
        }
    };
    list(e.not_found.iter().filter(|n| n.likely).map(|n| n.name).collect(), "likely, not added");
    list(e.removed.clone(), "not confirmed by held-out data, left out");
    list(e.negligible.iter().map(|n| n.name).collect(), "significant, but negligible");
    out.join("<br>")
}
