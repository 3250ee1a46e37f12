//! The result as a pilot would read it.

use super::Unfit;
use super::contract::{ChannelResidual, EffectEntry, Explanation, ModelResidual, Verdict};
use crate::pipeline::LogPart;
use gaware_nav::effects;
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::select::Added;

/// A value with two or three figures that mean something.
pub fn number(v: f64) -> String {
    let a = v.abs();
    if a == 0.0 || !v.is_finite() {
        "0".to_owned()
    } else if a >= 100.0 {
        format!("{v:.0}")
    } else if a >= 1.0 {
        format!("{v:.2}")
    } else if a >= 0.001 {
        format!("{v:.3}")
    } else {
        format!("{v:.1e}")
    }
}

fn described(name: &str) -> String {
    let text = effects::find(name).map_or("", |e| e.description());
    format!("{text} ({name})")
}

/// The largest parameter in its unit.
fn size(added: &Added) -> String {
    let setting = &added.setting;
    let units: Vec<_> = setting.parameters().collect();
    let significant = (0..units.len()).filter(|k| setting.sigmas[*k] > 0.0).max_by(|a, b| {
        let z = |k: usize| (setting.values[k] / setting.sigmas[k]).abs();
        z(*a).total_cmp(&z(*b))
    });
    let Some(k) = significant else { return String::new() };
    let (name, unit) = units[k];
    let value = number(setting.values[k] / unit.si);
    if added.is_at_limit() {
        return format!(": {name} = {value} {} or more", unit.symbol);
    }
    if setting.values[k].abs() < setting.sigmas[k] {
        return ", of no size beyond its sigma".to_owned();
    }
    format!(": {name} = {value} ± {} {}", number(setting.sigmas[k] / unit.si), unit.symbol)
}

/// The sentences of a summary, for where each has a line.
pub fn sentences(summary: &str) -> impl Iterator<Item = &str> {
    summary.split_inclusive(". ").map(str::trim_end)
}

/// Less than this at the begin of a log, before all its streams have started, is not worth a word, s.
const UNBRIDGED_S: f64 = 20.0;

/// What is said where gaps in the samples left out so many seconds of the logs; empty where they did not.
fn unbridged(seconds: f64) -> Option<String> {
    (seconds >= UNBRIDGED_S).then(|| {
        format!(
            "{seconds:.0} s of the logs are left out: gaps in the inertial samples leave the attitude uncertain there, and no attitude of the \
             autopilot leads across them. Record ATTITUDE beside the inertial samples."
        )
    })
}

/// What is said of fixes on the sphere of a simulator, whose positions stretch by this north and east.
fn simulated([north, east]: [f64; 2]) -> String {
    format!(
        "This is a simulator that flies over a sphere at rest: its positions ({:+.2} % north and {:+.2} % east against the velocities), the rate of \
         the Earth and gravity were put right.",
        100.0 * north,
        100.0 * east
    )
}

/// What is to be known of flights as they were recorded, sentence by sentence.
pub fn notes(flights: &[&Flight], unfit: Option<Unfit>) -> Vec<String> {
    let all = [
        unbridged(flights.iter().map(|f| f.unbridged_s()).sum()),
        flights.iter().find_map(|f| f.sphere()).map(simulated),
        unfit.map(Unfit::sentence),
    ];
    all.into_iter().flatten().collect()
}

/// What is said of logs of which only a part was explained.
pub fn parts(parts: &[LogPart]) -> String {
    let minutes = |s: f64| (s / 60.0).round();
    let one =
        |p: &LogPart| format!(" minutes {} to {} of {}", minutes(p.from_s), minutes(p.to_s), minutes(p.of_s));
    match parts {
        [] => String::new(),
        parts => format!(
            " Of long logs the part with the most motion was explained:{}; --whole explains all of them.",
            parts.iter().map(one).collect::<Vec<_>>().join(",")
        ),
    }
}

/// A paragraph.
pub fn summary(e: &Explanation, added: &[&Added]) -> String {
    let mut text = Vec::new();
    match e.verdict {
        Verdict::NothingMissing => text.push(
            "The model explains this flight: no further effect of the catalogue is significant.".to_owned(),
        ),
        Verdict::Unexplained if e.effects.is_empty() => {
            text.push(
                "The residuals exceed the noise, and no effect of the catalogue explains them.".to_owned(),
            );
        }
        _ => {}
    }
    let found = if e.verdict == Verdict::Unexplained {
        "A candidate, in a flight that the model does not explain"
    } else {
        "Unmodelled effect"
    };
    e.effects.iter().zip(added).for_each(|(entry, added)| missing(found, entry, added, &mut text));
    implausible(e, &mut text);
    let at_limit: Vec<&str> =
        added.iter().filter(|a| a.is_at_limit()).map(|a| a.setting.effect.name()).collect();
    if !at_limit.is_empty() {
        text.push(format!(
            "No bias of such a sensor changes as fast as {} requires: it absorbs an error that is not in the \
             catalogue, such as vibration.",
            at_limit.join(" or ")
        ));
    }
    if let (Some(residual), false) = (&e.residual, e.effects.is_empty()) {
        shrunk(residual, e.effects.len(), &mut text);
    }
    let worst = e.places.first().filter(|_| !e.effects.is_empty() || !e.unexplained_terms.is_empty());
    text.extend(worst.map(|place| {
        format!(
            "The residuals of the given model are largest in {} from {:.0} to {:.0} s ({}).",
            place.channel.replace('_', " "),
            place.t_start_s,
            place.t_end_s,
            place.regime
        )
    }));
    remaining(e, &mut text);
    text.join(" ")
}

/// Noise that no sensor which does what it claims has.
fn implausible(e: &Explanation, text: &mut Vec<String>) {
    let mut named: Vec<&str> = Vec::new();
    for n in e.noise.iter().filter(|n| !n.plausible) {
        let Some(finding) = n.finding.filter(|f| !named.contains(f)) else { continue };
        named.push(finding);
        let figures = e.noise.iter().filter(|o| o.finding == Some(finding));
        let figures: Vec<String> = figures
            .map(|o| format!("{} is {} {}, {} assumed", o.name, number(o.fitted), o.unit, number(o.assumed)))
            .collect();
        text.push(format!(
            "{finding}: the model explains the flight only with implausible noise ({}). The noise absorbs an error that is not \
             in the catalogue, or the assumed figures are wrong.",
            figures.join(", ")
        ));
    }
}

/// What one step of the selection found.
fn missing(found: &str, entry: &EffectEntry, added: &Added, text: &mut Vec<String>) {
    let size = size(added);
    if entry.names.len() == 1 {
        text.push(format!("{found}: {}{size}.", described(entry.names[0])));
    } else {
        let names: Vec<String> = entry.names.iter().map(|n| described(n)).collect();
        text.push(format!(
            "This flight does not separate {}. The first fits best{size}.",
            names.join(" or ")
        ));
        text.extend(
            entry
                .separate_by
                .as_ref()
                .map(|maneuver| format!("To separate them: {}.", maneuver.trim_end_matches('.'))),
        );
    }
    text.extend(entry.consequence.as_ref().map(|c| format!("Consequence: {c}.")));
    text.push(format!("Remedy: {}.", entry.remedy));
}

/// What the effects do to held-out data.
fn shrunk(residual: &ModelResidual, effects: usize, text: &mut Vec<String>) {
    let most = residual.held_out_channels.iter().max_by(|a, b| {
        let shrink = |c: &ChannelResidual| c.nis.before - c.nis.after;
        shrink(a).total_cmp(&shrink(b))
    });
    let shrinks = residual.held_out.after < residual.held_out.before;
    // Innovations are weighted by what is expected of them: a channel may have larger ones, and fit better.
    let channel = most.filter(|c| shrinks && c.rms.after < c.rms.before).map_or_else(String::new, |c| {
        let unit = if c.channel.starts_with("velocity") { "m/s" } else { "m" };
        format!(
            "the innovations of {} from {} to {} {unit} RMS, and ",
            c.channel.replace('_', " "),
            number(c.rms.before),
            number(c.rms.after),
        )
    });
    text.push(format!(
        "On held-out data, adding {} {} {channel}the NIS per degree of freedom from {} to {} (1 is expected).",
        if effects == 1 { "it" } else { "them" },
        if shrinks { "reduces" } else { "does not reduce" },
        number(residual.held_out.before),
        number(residual.held_out.after),
    ));
    if let Some(d) = residual.drift_m.get("30_s") {
        text.push(format!(
            "Without fixes the position drifts {} m in 30 s with the new model ({} m before).",
            number(d.after),
            number(d.before)
        ));
    }
}

/// What is there beside the effects named.
fn remaining(e: &Explanation, text: &mut Vec<String>) {
    for t in &e.unexplained_terms {
        text.push(format!(
            "Residual: {} correlates with {} (coefficient {} ± {} {}).",
            t.channel.replace('_', " "),
            t.term,
            number(t.coefficient),
            number(t.sigma),
            t.unit
        ));
    }
    if !e.negligible.is_empty() {
        let names: Vec<&str> = e.negligible.iter().map(|n| n.name).collect();
        text.push(format!(
            "Significant but negligible, below what the simulation itself leaves out: {}.",
            names.join(", ")
        ));
    }
    let likely: Vec<&str> = e.not_found.iter().filter(|n| n.likely).map(|n| n.name).collect();
    if !likely.is_empty() {
        text.push(format!(
            "Likely, but not added: {}. The search ends after a few effects, and held-out data must confirm \
             each.",
            likely.join(", ")
        ));
    }
    for name in &e.removed {
        text.push(format!("{name} fitted well, but held-out data did not confirm it; it is left out."));
    }
}

#[cfg(test)]
mod tests {
    use super::super::contract::{self, NotFound};
    use super::*;
    use gaware_nav::effects::{Effect, GYRO_SCALE_FACTOR, GyroBiasDrift};
    use gaware_nav::model::EffectSetting;

    fn entry(name: &'static str) -> EffectEntry {
        let evidence = contract::Evidence { log_likelihood_gain: 9.0, bic_gain: 5.0, log_odds: 7.0 };
        EffectEntry {
            names: vec![name],
            log: None,
            parameters: std::collections::BTreeMap::new(),
            evidence,
            separate_by: None,
            consequence: None,
            cause: "",
            remedy: "",
        }
    }

    #[test]
    fn a_drift_at_its_limit_is_told_as_what_it_is() {
        let drift = |deg_per_h_per_rth: f64| {
            let si = deg_per_h_per_rth.to_radians() / 3600.0 / 60.0;
            let setting = EffectSetting { values: vec![si], ..EffectSetting::unknown(&GyroBiasDrift) };
            Added { setting: EffectSetting { sigmas: vec![2.2 * si], ..setting }, prior: vec![(si, 0.0)] }
        };
        let mut e = contract::too_little("");
        e.effects = vec![entry("gyro_bias_drift")];
        let text = summary(&e, &[&drift(3000.0)]);
        let told =
            text.contains("gyro_walk = 3000 deg/h/√h or more.") && text.contains("No bias of such a sensor");
        assert!(told, "{text}");
        let text = summary(&e, &[&drift(100.0)]);
        // A value within its sigma is no result.
        assert!(text.contains("of no size beyond its sigma.") && !text.contains("No bias"), "{text}");
    }

    #[test]
    fn what_is_likely_but_was_not_added_is_told() {
        let mut e = contract::too_little("");
        let of = |likely| NotFound {
            name: GYRO_SCALE_FACTOR.name(),
            log_odds: 40.0,
            likely,
            parameters: serde_json::Value::Null,
            reason: None,
        };
        e.not_found = vec![of(true)];
        assert!(summary(&e, &[]).contains("Likely, but not added: gyro_scale_factor."));
        e.not_found = vec![of(false)];
        assert!(!summary(&e, &[]).contains("gyro_scale_factor"));
    }
}
