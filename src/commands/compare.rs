//! `gaware compare BEFORE AFTER`: the autopilot's own innovations of two flights.

use super::report::ReportError;
use super::{CommandError, ListenArgs, OverwriteArgs, file_name, load_model, output};
use crate::compare::flight::FilterFlight;
use crate::compare::{Comparison, compare, page};
use crate::engine::{Engine, EngineOptions};
use crate::outputs::mark;
use gaware_nav::model::Model;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `compare`.
#[derive(Debug, Clone, clap::Args)]
pub struct CompareArgs {
    /// Flight before the change (.tlog, .bin, .ulg, .mcap).
    pub before: PathBuf,
    /// Flight after it.
    pub after: PathBuf,
    /// Write an HTML report with both flights on common axes here.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Model of the sensors for the attitude comparison (default: the standard model).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Print the comparison as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
}

/// Compares, prints the verdict, writes the report.
///
/// # Errors
/// Logs that cannot be read or compared, or a report that cannot be written.
pub fn run(args: &CompareArgs) -> Result<(), CommandError> {
    let outputs = args.overwrite.outputs([&args.before, &args.after].into_iter().chain(&args.model));
    args.report.iter().try_for_each(|path| outputs.check(path))?;
    let model = args.model.as_deref().map_or_else(|| Ok(Model::standard()), load_model)?;
    let read = |path: &Path| {
        let bar = indicatif::ProgressBar::new(0).with_message(file_name(path));
        let engine = Engine::new(model.clone(), EngineOptions::default());
        let progress = |done: u64, total: u64| {
            bar.set_length(total);
            bar.set_position(done);
        };
        let flight = FilterFlight::read(path, args.listen.options(), engine, &progress);
        bar.finish_and_clear();
        flight
    };
    let (before, after) = (read(&args.before)?, read(&args.after)?);
    let compared = compare((&file_name(&args.before), &before), (&file_name(&args.after), &after))?;
    if let Some(path) = &args.report {
        let html = page::html(&compared, &before, &after).map_err(ReportError::Draw)?;
        outputs.write(path, mark::text(html, mark::Style::Angle))?;
    }
    if args.json {
        return output::json_pretty(&compared);
    }
    output::words(|out| print(out, &compared, args.report.as_deref()))
}

pub(super) fn print(out: &mut String, c: &Comparison, report: Option<&Path>) -> std::fmt::Result {
    writeln!(out, "{}\n", c.text)?;
    writeln!(
        out,
        "{:<22} {:<14} {:>10} {:>10} {:<4} {:>6}  interval, all hold with 95 %",
        "", "regime", "before", "after", "", "ratio"
    )?;
    let mut last = None;
    for row in &c.rows {
        let name = if last == Some(row.quantity) { "" } else { row.quantity.words() };
        last = Some(row.quantity);
        writeln!(
            out,
            "{name:<22} {:<14} {:>10.3} {:>10.3} {:<4} {:>6.2}  {:<15} {}",
            row.regime.words(),
            row.before.value,
            row.after.value,
            row.unit,
            row.ratio.value,
            row.ratio
                .interval
                .map_or_else(|| "too few samples".to_owned(), |[low, high]| format!("{low:.2} to {high:.2}")),
            page::result(row)
        )?;
    }
    match report {
        Some(path) => writeln!(out, "\nreport: {}", path.display()),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::tests::flight;

    #[test]
    fn the_text_is_as_it_was() {
        let (before, after) = (flight(1, 0.5, 3.0), flight(2, 0.5, 1.0));
        let compared = compare(("before.bin", &before), ("after.bin", &after)).unwrap();
        let mut text = String::new();
        print(&mut text, &compared, Some(Path::new("compare.html"))).unwrap();
        insta::assert_snapshot!(text);
    }
}
