//! The report of `explain`: the answer on the first screen, then the evidence: residuals before and after, every effect with its
//! Bayes factor, noise, where in the flight, spectra.

mod answers;
mod autopilot;
mod catalogue;
mod effects;
mod evidence;
mod formulas;

pub use super::page::escape;
pub use answers::{headline, verdict};

use super::page;
use crate::explain::Explained;
use crate::explain::contract::EffectEntry;
use crate::explain::words::number;
use crate::figures::with_sigma;
use crate::health::checks::checks;
use gaware_mission::item::Autopilot;
use gaware_nav::identify::judge::Judged;
use gaware_nav::identify::select::{Added, Settings};
use gaware_nav::math::exp;
use std::fmt::Write;

/// An effect of the selection with its values.
type Found<'a> = &'a Added;

/// The whole report.
///
/// # Errors
/// A plot cannot be described.
pub fn html(explained: &Explained) -> Result<String, String> {
    let e = &explained.explanation;
    let mut body = String::new();
    answers::section(explained, &mut body);
    health(explained, &mut body);
    effects::details(explained, &mut body);
    formulas::section(&explained.drivers, &mut body);
    evidence::before_and_after(e, &mut body);
    autopilot::section(e, &mut body);
    if let Some(compasses) = &e.compasses {
        super::flight::compass_section(compasses, &mut body);
    }
    if let Some(air) = &e.air {
        super::flight::air_section(air, &mut body);
    }
    catalogue::effects(explained, &mut body);
    evidence::contributions(e, &mut body);
    if let Some(judged) = &explained.judged {
        evidence::innovations(judged, &mut body)?;
        evidence::spectra(judged, &mut body)?;
    }
    evidence::whereabouts(explained, &mut body)?;
    catalogue::noise(e, &mut body);
    if e.residual.is_some() {
        let _ = write!(body, "<h2>New model</h2><pre>{}</pre>", escape(&explained.model.to_toml()));
    }
    how_to_read(&mut body);
    Ok(page::page(verdict(e.verdict), &body))
}

/// How the vehicle was in each of the logs: what killed its estimator is no sensor error.
fn health(explained: &Explained, body: &mut String) {
    let px4 = explained.on_board.autopilot == Some(Autopilot::Px4);
    for (log, name) in explained.health.iter().zip(&explained.logs) {
        if explained.health.len() > 1 && !log.is_empty() {
            let _ = write!(body, "<p><small>{}</small></p>", escape(name));
        }
        super::flight::health_section(log, &checks(log, px4, &explained.on_board), body);
    }
}

fn how_to_read(body: &mut String) {
    let least = Settings::default().threshold;
    let _ = write!(
        body,
        "<h2>How to read this</h2><p>The sensors are simulated along the flight. An <em>innovation</em> is a GNSS fix minus its \
         prediction; its square over its predicted variance is the NIS, 1 per degree of freedom under a right model. An effect is \
         named at a log Bayes factor of at least {least} ({:.0} to 1) after a correction for the size of the catalogue. Held-out data \
         are not used for choosing or fitting: validation logs where given, otherwise every sixth block of five seconds.</p>",
        exp(least)
    );
}

/// A parameter of an effect in words.
pub(super) struct Value {
    /// `latency = 0.071 ± 0.002 s`.
    pub text: String,
    /// Whether it differs from zero by more than 3 sigma.
    pub significant: bool,
    /// Whether it has a sigma.
    pub estimated: bool,
}

/// Every parameter with its sigma and unit, the most significant first; what was not estimated, such as the instant of a step, last.
fn values(added: &Added) -> Vec<Value> {
    let setting = &added.setting;
    let mut all: Vec<(f64, Value)> = setting
        .parameters()
        .zip(setting.values.iter().zip(&setting.sigmas))
        .map(|((name, unit), (value, sigma))| {
            let text = if added.is_at_limit() {
                format!("{name} = {} {} or more", number(value / unit.si), unit.symbol)
            } else if *sigma > 0.0 {
                format!("{name} = {} {}", with_sigma(value / unit.si, sigma / unit.si), unit.symbol)
            } else {
                format!("{name} = {} {}", number(value / unit.si), unit.symbol)
            };
            let z = if *sigma > 0.0 { (value / sigma).abs() } else { 0.0 };
            (z, Value { text, significant: z > 3.0, estimated: *sigma > 0.0 })
        })
        .collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.into_iter().map(|(_, value)| value).collect()
}

/// What the selection knows about an entry.
fn found<'a>(entry: &EffectEntry, judged: Option<&'a Judged>) -> Option<Found<'a>> {
    let name = entry.parameters.keys().next()?;
    judged?.selection.added.iter().find(|a| a.setting.effect.name() == *name)
}

/// A Bayes factor from its natural logarithm.
fn bayes(log: f64) -> String {
    if log.abs() < 10.0 {
        format!("{:.0} (log {log:.1})", exp(log))
    } else {
        format!("above 20 000 (log {log:.0})")
    }
}

/// A term of rates and forces as one writes it.
fn spoken(term: &str) -> String {
    term.replace("w_", "ω_").replace('*', " · ")
}

/// Unit of a channel of fixes.
fn channel_unit(channel: &str) -> &'static str {
    if channel.starts_with("velocity") { "m/s" } else { "m" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::contract;

    #[test]
    fn a_recording_that_says_too_little_has_a_report_with_the_reason_and_what_to_do() {
        let explained = Explained {
            explanation: contract::too_little("no GNSS fixes"),
            notes: vec!["Some of it <b> is new.".to_owned()],
            logs: vec!["<bench>.tlog".to_owned()],
            ..Explained::default()
        };
        let html = html(&explained).unwrap();
        assert!(html.contains("no GNSS fixes.</h1>") && html.contains("Record at least 40 s"), "{html}");
        assert!(
            html.contains("What of the recording?") && html.contains("Some of it &lt;b&gt; is new."),
            "{html}"
        );
        assert!(html.contains("&lt;bench&gt;.tlog") && !html.contains("Every effect"));
    }

    #[test]
    fn bayes_factors_and_terms_read_as_one_writes_them() {
        assert_eq!(bayes(3.3), "27 (log 3.3)");
        assert_eq!(bayes(120.4), "above 20 000 (log 120)");
        assert_eq!(spoken("w_z*f_x"), "ω_z · f_x");
    }
}
