//! The result as one would tell it to a pilot.

use super::contract::{Explanation, Verdict};
use gaware_nav::effects;
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
    let units: Vec<_> = added.setting.parameters().collect();
    if added.setting.effect.name() == "gps_latency" {
        return format!("{} s late", number(added.setting.values[0]));
    }
    let significant = (0..units.len()).filter(|k| added.setting.sigmas[*k] > 0.0).max_by(|a, b| {
        let z = |k: usize| (added.setting.values[k] / added.setting.sigmas[k]).abs();
        z(*a).total_cmp(&z(*b))
    });
    significant.map_or_else(String::new, |k| {
        let (name, unit) = units[k];
        format!(
            "{name} = {} ± {} {}",
            number(added.setting.values[k] / unit.si),
            number(added.setting.sigmas[k] / unit.si),
            unit.symbol
        )
    })
}

/// A paragraph.
pub fn summary(e: &Explanation, added: &[&Added]) -> String {
    let mut text = Vec::new();
    match e.verdict {
        Verdict::NothingMissing => text.push(
            "The model explains this flight: no effect of the catalogue is missing beyond what noise does by chance."
                .to_owned(),
        ),
        Verdict::Unexplained if e.effects.is_empty() => {
            text.push("Simulation and measurement disagree, and no effect of the catalogue explains it.".to_owned());
        }
        _ => {}
    }
    for (entry, added) in e.effects.iter().zip(added) {
        let size = size(added);
        let size = if size.is_empty() { size } else { format!(": {size}") };
        if entry.names.len() == 1 {
            text.push(format!("Missing in the model: {}{size}.", described(entry.names[0])));
        } else {
            let names: Vec<String> = entry.names.iter().map(|n| described(n)).collect();
            text.push(format!(
                "This flight cannot tell apart: {}. The first fits best{size}.",
                names.join(" or ")
            ));
            if let Some(maneuver) = &entry.separate_by {
                text.push(format!("To tell them apart: {maneuver}."));
            }
        }
    }
    if let (Some(gap), false) = (&e.gap, e.effects.is_empty()) {
        let most = gap.held_out_channels.iter().max_by(|a, b| {
            let shrink = |c: &super::contract::ChannelGap| c.nis.before - c.nis.after;
            shrink(a).total_cmp(&shrink(b))
        });
        if let Some(c) = most {
            let unit = if c.channel.starts_with("velocity") { "m/s" } else { "m" };
            text.push(format!(
                "On data that took no part, adding {} takes the disagreement in {} from {} to {} {unit} RMS, and squared \
                 normalised innovations from {} to {} per degree of freedom (1 is perfect).",
                if e.effects.len() == 1 { "it" } else { "them" },
                c.channel.replace('_', " "),
                number(c.rms.before),
                number(c.rms.after),
                number(gap.held_out.before),
                number(gap.held_out.after),
            ));
        }
        if let Some(d) = gap.drift_m.get("30_s") {
            text.push(format!(
                "Without fixes the position drifts {} m in 30 s with the new model ({} m before).",
                number(d.after),
                number(d.before)
            ));
        }
    }
    if let Some(place) = e.places.first().filter(|_| !e.effects.is_empty() || !e.unexplained_terms.is_empty())
    {
        text.push(format!(
            "The old model was worst in {} from {:.0} to {:.0} s ({}).",
            place.channel.replace('_', " "),
            place.t_start_s,
            place.t_end_s,
            place.regime
        ));
    }
    for t in &e.unexplained_terms {
        text.push(format!(
            "Left over: {} goes with {} by {} ± {} {}.",
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
            "Also seen, but too small to be told from what any simulation leaves out: {}.",
            names.join(", ")
        ));
    }
    for name in &e.removed {
        text.push(format!("{name} looked likely, but the held-out data did not confirm it; it is left out."));
    }
    text.join(" ")
}
