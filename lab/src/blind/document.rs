//! `docs/effects.md`, written by the program: the catalogue, which effects were taken for which in a blind campaign, and what
//! to fly to separate each pair.

use super::Outcome;
use gaware::explain::advice;
use gaware_nav::effects::{DrawRange, Effect, REGISTRY, Shape};
use gaware_nav::math::log10;
use std::collections::BTreeMap;
use std::fmt::{Error, Write};

/// What a campaign flew, for the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flown {
    /// Flights with an injected effect.
    pub flights: usize,
    /// Flights without.
    pub clean: usize,
    /// First seed.
    pub seed: u64,
}

/// The effects of the catalogue: parameters, cause, remedy.
pub fn catalogue() -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _: Result<(), Error> = REGISTRY.iter().enumerate().try_for_each(|(k, e)| entry(&mut out, k, *e));
    out
}

fn entry(out: &mut String, k: usize, effect: &dyn Effect) -> Result<(), Error> {
    writeln!(out, "### {}. `{}`\n", k + 1, effect.name())?;
    writeln!(out, "- What it is: {}.", effect.description())?;
    for group in effect.groups() {
        let shape = match group.shape {
            Shape::Scalar => "one value",
            Shape::Vector => "three values",
            Shape::Matrix => "3×3 values",
            Shape::MatrixWithoutDiagonal => "3×3 values without the diagonal",
            Shape::UpperTriangle => "three values (xy, xz, yz)",
            Shape::Symmetric => "six values (xx, yy, zz, xy, xz, yz)",
        };
        write!(out, "- Parameters: {shape} in {}", group.unit.symbol)?;
        if group.prior_sigma > 0.0 {
            write!(out, ", prior sigma {}", rounded(group.prior_sigma / group.unit.si))?;
        }
        if let DrawRange::LogUniform(low, high) = effect.draw_range() {
            let unit = group.unit;
            write!(out, ", studies draw {} to {}", rounded(low / unit.si), rounded(high / unit.si))?;
        }
        writeln!(out, ".")?;
    }
    writeln!(out, "- Usual cause: {}.", effect.cause())?;
    writeln!(out, "- Remedy: {}.\n", effect.remedy())
}

/// Three digits.
fn rounded(value: f64) -> String {
    let digits = (2.0 - log10(value.abs().max(1e-12)).floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// How often an effect was named: alone, and in a group with others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Named {
    alone: usize,
    group: usize,
}

impl Named {
    fn cell(self) -> String {
        match (self.alone, self.group) {
            (0, 0) => String::new(),
            (alone, 0) => alone.to_string(),
            (0, group) => format!("({group})"),
            (alone, group) => format!("{alone} ({group})"),
        }
    }
}

/// Injected effect (`None`: nothing) and named effect → how often.
fn counted(outcomes: &[Outcome]) -> BTreeMap<(Option<usize>, usize), Named> {
    let place = |name: &str| REGISTRY.iter().position(|e| e.name() == name);
    let mut counts: BTreeMap<(Option<usize>, usize), Named> = BTreeMap::new();
    for outcome in outcomes.iter().filter(|o| o.hidden.len() < 2) {
        let hidden = outcome.hidden.first().and_then(|name| place(name));
        for group in &outcome.groups {
            for column in group.iter().filter_map(|name| place(name)) {
                let named = counts.entry((hidden, column)).or_default();
                if group.len() == 1 { named.alone += 1 } else { named.group += 1 }
            }
        }
    }
    counts
}

/// The confusion matrix: rows are what was injected, columns what was named.
pub fn matrix(outcomes: &[Outcome]) -> String {
    let counts = counted(outcomes);
    let columns = 0..REGISTRY.len();
    let mut out = String::from("| injected | flights | nothing |");
    columns.clone().for_each(|k| out.push_str(&format!(" {} |", k + 1)));
    out.push_str("\n|---|---|---|");
    columns.clone().for_each(|_| out.push_str("---|"));
    out.push('\n');
    for row in columns.clone().map(Some).chain([None]) {
        let name = row.and_then(|k| REGISTRY.get(k)).map(|e| e.name());
        let own = outcomes.iter().filter(|o| o.hidden.len() < 2 && o.hidden.first().copied() == name);
        let (flights, nothing) = own.fold((0, 0), |(n, m), o| (n + 1, m + usize::from(o.groups.is_empty())));
        let title = match (row, name) {
            (Some(k), Some(name)) => format!("{}. `{name}`", k + 1),
            _ => "nothing".to_owned(),
        };
        out.push_str(&format!("| {title} | {flights} | {nothing} |"));
        for column in columns.clone() {
            let cell = counts.get(&(row, column)).copied().unwrap_or_default().cell();
            out.push_str(&format!(" {cell} |"));
        }
        out.push('\n');
    }
    out
}

/// Every pair that some file of an effect calls alike or that a campaign named together or one for the other, with what separates it.
pub fn pairs(outcomes: &[Outcome]) -> String {
    let place = |name: &str| REGISTRY.iter().position(|e| e.name() == name);
    let sorted = |a: usize, b: usize| (a.min(b), a.max(b));
    let mut confused: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for (k, effect) in REGISTRY.iter().enumerate() {
        for other in effect.separations().iter().filter_map(|s| place(s.from)) {
            confused.entry(sorted(k, other)).or_default();
        }
    }
    for ((hidden, column), named) in counted(outcomes) {
        if let Some(hidden) = hidden.filter(|h| *h != column) {
            *confused.entry(sorted(hidden, column)).or_default() += named.alone + named.group;
        }
    }
    let mut out = String::from("| pair | confused | what separates them |\n|---|---|---|\n");
    for ((a, b), times) in confused {
        let names = [a, b].map(|k| REGISTRY.get(k).map_or("", |e| e.name()));
        let fly = advice::separate(&names, true).unwrap_or_default();
        out.push_str(&format!("| `{}`, `{}` | {times} | {fly} |\n", names[0], names[1]));
    }
    out
}

/// The whole document.
pub fn write(outcomes: &[Outcome], flown: &Flown) -> String {
    let Flown { flights, clean, seed } = flown;
    format!(
        "# Effects\n\nThis file is written by the program:\n\n```sh\ngaware study blind --flights {flights} --clean {clean} --seed {seed} \
         --document docs/effects.md\n```\n\nAn effect is one named way in which a real sensor differs from an ideal one. `gaware explain` \
         tests all of them; names, units and parameters are those of `model.toml`.\n\n## Catalogue\n\n{}## Confusion matrix\n\nOne effect is \
         injected in each simulated flight of four minutes, with a size between just detectable and typical; the last row has \
         none. A cell is how often the effect of the column was named alone, in brackets how often in a group. Sizes too small \
         for any method are part of it: they end in the column `nothing`.\n\n{}\n## What separates each pair\n\nPairs that imitate each other, \
         with the number of flights in which one was named for the other or beside it. A pair that is not listed was never confused: \
         figure eights, pull-ups, changes of speed and sideslips together separate it.\n\n{}",
        catalogue(),
        matrix(outcomes),
        pairs(outcomes)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blind::{Kind, Seen};

    fn outcome(hidden: &[&'static str], groups: &[&[&'static str]]) -> Outcome {
        Outcome {
            hidden: hidden.to_vec(),
            kind: Kind::Rich,
            seed: 1,
            groups: groups.iter().map(|g| g.to_vec()).collect(),
            evidence: Vec::new(),
            removed: Vec::new(),
            sizes: Vec::new(),
            held_out: Vec::new(),
            oracle: Vec::<Seen>::new(),
            errors_in_sigmas: Vec::new(),
            noise: Vec::new(),
            looks: Vec::new(),
            verdict: None,
        }
    }

    #[test]
    fn cells_count_what_was_named_for_what_was_injected() {
        let outcomes = [
            outcome(&["gps_latency"], &[&["gps_latency"]]),
            outcome(&["gps_latency"], &[&["gps_lever_arm", "gps_latency"]]),
            outcome(&["gps_latency"], &[]),
            outcome(&[], &[&["gyro_bias_step"]]),
        ];
        let table = matrix(&outcomes);
        let row = |name: &str| table.lines().find(|l| l.contains(name)).unwrap().to_owned();
        let cells: Vec<String> =
            row("`gps_latency`").split('|').map(|c| c.trim().to_owned()).filter(|c| !c.is_empty()).collect();
        assert_eq!(&cells[1..], ["3", "1", "1 (1)", "(1)"]);
        assert!(row("| nothing | 1").contains("| 1 |"));
        assert_eq!(table.lines().count(), REGISTRY.len() + 3);
        let listed = pairs(&outcomes);
        let pair = listed.lines().find(|l| l.contains("`gps_latency`, `gps_lever_arm`")).unwrap();
        assert!(pair.contains("| 1 |") && pair.contains("throttle"), "{pair}");
    }

    /// The document in the repository has the catalogue that the program has.
    #[test]
    fn the_document_holds_the_catalogue() {
        let document = include_str!("../../../docs/effects.md");
        assert!(
            document.contains(&catalogue()),
            "write it again: gaware study blind --document docs/effects.md"
        );
        for (k, effect) in REGISTRY.iter().enumerate() {
            assert!(document.contains(&format!("| {}. `{}` |", k + 1, effect.name())), "{}", effect.name());
        }
    }
}
