//! The measured part of `docs/faults.md`, written by the program.

use super::{Consistency, FaultResult, Faults, Lost};
use std::fmt::{Error, Write};

/// The measured part stands between these lines.
const BEGIN: &str = "<!-- gaware study faults: begin -->\n";
const END: &str = "<!-- gaware study faults: end -->\n";

/// The document with the measured part anew; nothing where it has no place for that.
pub fn renewed(document: &str, study: &Faults, vehicles: usize) -> Option<String> {
    let (head, rest) = document.split_once(BEGIN)?;
    let (_, tail) = rest.split_once(END)?;
    let mut measured = String::new();
    // Writing to a string cannot fail.
    let _: Result<(), Error> = write_measured(&mut measured, study, vehicles);
    Some([head, BEGIN, &measured, END, tail].concat())
}

fn write_measured(out: &mut String, study: &Faults, vehicles: usize) -> Result<(), Error> {
    writeln!(
        out,
        "Measured with {vehicles} vehicles of each kind, first seed {}; times since the begin of the fault, in how many flights.",
        study.seed
    )?;
    writeln!(out, "NEES: mean (worst flight).\n")?;
    writeln!(
        out,
        "| Fault | The pilot can read (first after, in flights) | Right again (median/worst) | Lost in a flight | NEES/dof before, while it lasts (constants), 40 s after, at the end |"
    )?;
    writeln!(out, "|---|---|---|---|---|")?;
    study.faults.iter().try_for_each(|f| row(out, f))?;
    let failures = study.failures();
    if failures.is_empty() {
        return writeln!(out, "\nAll of them pass.");
    }
    writeln!(out, "\nWhat fails:\n")?;
    failures.iter().try_for_each(|failure| writeln!(out, "- {failure}"))
}

fn row(out: &mut String, f: &FaultResult) -> Result<(), Error> {
    let fails = if f.failures.is_empty() { "" } else { " **fails**" };
    write!(out, "| `{}`: {}{fails} | {} | ", f.fault, f.happens, shown(f))?;
    match f.recovered_after_s {
        Some([median, worst]) => write!(out, "{median:.0}/{worst:.0} s")?,
        None => write!(out, "not in every flight")?,
    }
    let all = |c: &Consistency| format!("{:.2} ({:.2})", c.mean, c.worst);
    let constants = |c: &Consistency| format!("{:.2} ({:.2})", c.constants_mean, c.constants_worst);
    let during = f.during.as_ref().map_or_else(|| "-".to_owned(), constants);
    writeln!(out, " | {} | {}, {during}, {}, {} |", lost(&f.lost), all(&f.before), all(&f.after), all(&f.end))
}

/// Sentences of at least half of the flights.
fn shown(f: &FaultResult) -> String {
    let often = f.shown.iter().filter(|s| 2 * s.flights >= f.flights);
    let all: Vec<String> = often
        .map(|s| {
            let text = s.text.split(": ").next().filter(|_| s.text.len() > 160).unwrap_or(&s.text);
            format!("{} ({:.0} s, {}/{})", text.replace('|', "/"), s.after_s, s.flights, f.flights)
        })
        .collect();
    if all.is_empty() { "nothing".to_owned() } else { all.join("; ") }
}

fn lost(lost: &Lost) -> String {
    let items = [
        (lost.frames, "frames"),
        (lost.samples, "samples"),
        (lost.gaps_s, "s without samples"),
        (lost.fixes, "fixes"),
        (lost.restarts, "restarts"),
    ];
    let some: Vec<String> =
        items.iter().filter(|(n, _)| *n >= 0.5).map(|(n, what)| format!("{n:.0} {what}")).collect();
    if some.is_empty() { "nothing".to_owned() } else { some.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_measured_part_is_written_anew() {
        let study = Faults { schema: "gaware.study/1", seed: 7, faults: Vec::new() };
        let document = format!("# Faults\n\n{BEGIN}old\n{END}\nThe rest.\n");
        let again = renewed(&document, &study, 6).unwrap();
        assert!(again.starts_with("# Faults\n\n") && again.ends_with("\nThe rest.\n"), "{again}");
        assert!(again.contains("first seed 7") && !again.contains("old"), "{again}");
        assert_eq!(renewed(&again, &study, 6), Some(again.clone()));
        assert_eq!(renewed("no place", &study, 6), None);
    }
}
