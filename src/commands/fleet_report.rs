//! `gaware fleet report` and `gaware fleet prior`: what the flights of each inertial unit have in common.

use super::report::ReportError;
use super::{CommandError, OverwriteArgs, file_name, load_model, output};
use crate::figures::{counted, two_figures, with_sigma};
use crate::fleet::FleetError;
use crate::fleet::family::{self, Family};
use crate::fleet::find::NameRule;
use crate::fleet::flight::FlightEntry;
use crate::fleet::log::{FleetLog, Named};
use crate::outputs::{OutputError, Outputs, mark};
use crate::report::fleet;
use gaware_nav::model::Model;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `fleet report`.
#[derive(Debug, Clone, clap::Args)]
pub struct ReportArgs {
    /// Folder of a fleet (--out of "gaware fleet").
    #[arg(value_name = "DIR")]
    pub fleet: PathBuf,
    /// Where a path has the inertial unit and the firmware (default: as in the run of the fleet).
    #[arg(long, value_name = "RULE")]
    pub names: Option<String>,
    /// Write the page here (default: report.html in the folder of the fleet; with --json there is none unless this names it).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `fleet prior`.
#[derive(Debug, Clone, clap::Args)]
pub struct PriorArgs {
    /// The inertial unit.
    #[arg(value_name = "UNIT")]
    pub unit: String,
    /// Folder of a fleet (--out of "gaware fleet").
    #[arg(long, value_name = "DIR")]
    pub fleet: PathBuf,
    /// Model whose priors the flights sharpen (default: the standard model).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Where a path has the inertial unit and the firmware (default: as in the run of the fleet).
    #[arg(long, value_name = "RULE")]
    pub names: Option<String>,
    /// The model file to write.
    #[arg(long, value_name = "FILE", default_value = "model.toml")]
    pub out: PathBuf,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// `fleet.json`: the logs of a fleet and their results, in the order of the tables.
#[derive(Debug, Serialize, Deserialize)]
struct FleetFile {
    /// `gaware.fleet_logs/1`.
    schema: String,
    logs: Vec<LogEntry>,
}

#[derive(Debug, Serialize, Deserialize)]
struct LogEntry {
    log: String,
    unit: Option<String>,
    firmware: Option<String>,
    result: Option<FlightEntry>,
    failed: Option<String>,
}

const FLEET_SCHEMA: &str = "gaware.fleet_logs/1";
/// Its name.
const LIST: &str = "fleet.json";

/// Where the list of a fleet lies.
pub fn list(folder: &Path) -> PathBuf {
    folder.join(LIST)
}

/// Writes which logs a fleet has, with their results: what the report reads.
///
/// # Errors
/// What the system says.
pub fn write_fleet(folder: &Path, logs: &[FleetLog], outputs: &Outputs) -> Result<PathBuf, FleetError> {
    let path = list(folder);
    let entry = |l: &FleetLog| LogEntry {
        log: l.path.clone(),
        unit: l.named.unit.clone(),
        firmware: l.named.firmware.clone(),
        result: l.result.as_ref().ok().cloned(),
        failed: l.result.as_ref().err().cloned(),
    };
    let file = FleetFile { schema: FLEET_SCHEMA.to_owned(), logs: logs.iter().map(entry).collect() };
    let wrong = |e: serde_json::Error| OutputError::Write { path: path.clone(), source: e.into() };
    outputs.write(&path, mark::json(&serde_json::to_string(&file).map_err(wrong)?))?;
    Ok(path)
}

/// Reads which logs a fleet has, with their results. `names`: a rule for names in place of that of the fleet's run.
///
/// # Errors
/// A folder without a fleet, or a rule that is none.
pub fn read_fleet(folder: &Path, names: Option<&str>) -> Result<Vec<FleetLog>, FleetError> {
    let none = || FleetError::NoFleet(folder.to_owned());
    let rule = names.map(NameRule::new).transpose()?;
    let path = list(folder);
    let text = std::fs::read(&path).map_err(|_| none())?;
    // What stands in it decides on models and on what is said of a unit.
    if !mark::is_sealed(std::io::Cursor::new(&text), b"").unwrap_or(false) {
        return Err(FleetError::Edited { path });
    }
    let file: FleetFile = serde_json::from_slice(&text).map_err(|_| none())?;
    if file.schema != FLEET_SCHEMA {
        return Err(none());
    }
    let log = |entry: LogEntry| FleetLog {
        named: match &rule {
            Some(rule) => rule.read(Path::new(&entry.log)),
            None => Named { unit: entry.unit, firmware: entry.firmware },
        },
        path: entry.log,
        result: entry.result.ok_or_else(|| entry.failed.unwrap_or_default()),
    };
    Ok(file.logs.into_iter().map(log).collect())
}

/// `gaware fleet report`.
///
/// # Errors
/// A folder without a fleet, or a page that cannot be written.
pub fn report(args: &ReportArgs) -> Result<(), CommandError> {
    let page = match &args.out {
        None if args.json => None,
        None => Some(args.fleet.join("report.html")),
        Some(path) => Some(path.clone()),
    };
    let outputs = args.overwrite.outputs([list(&args.fleet)]);
    page.iter().try_for_each(|path| outputs.check(path))?;
    let logs = read_fleet(&args.fleet, args.names.as_deref())?;
    let study = family::study(&logs);
    if let Some(path) = &page {
        let html = fleet::html(&name_of(&args.fleet), &logs, &study).map_err(ReportError::Draw)?;
        outputs.write(path, mark::text(html, mark::Style::Angle))?;
    }
    if args.json {
        return output::json(&study.family);
    }
    output::words(|out| print(out, &study.family, page.as_deref()))
}

/// The folder's own name, also where it is given as `.`.
fn name_of(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    file_name(&whole)
}

/// `gaware fleet prior`.
///
/// # Errors
/// A folder without a fleet, a unit that it does not have, or a file that cannot be written.
pub fn prior(args: &PriorArgs) -> Result<(), CommandError> {
    let outputs = args.overwrite.outputs(args.model.iter().chain([&list(&args.fleet)]));
    outputs.check(&args.out)?;
    let base = args.model.as_deref().map_or_else(|| Ok(Model::standard()), load_model)?;
    let family = family::family(&read_fleet(&args.fleet, args.names.as_deref())?);
    let model = family::prior_model(&family, &args.unit, &base)
        .ok_or_else(|| FleetError::NoUnit { unit: args.unit.clone(), known: family.units.join(", ") })?;
    outputs.write(&args.out, mark::text(model.to_toml(), mark::Style::Hash))?;
    output::words(|out| writeln!(out, "written: {}", args.out.display()))
}

fn print(out: &mut String, family: &Family, page: Option<&Path>) -> std::fmt::Result {
    writeln!(
        out,
        "flights: {}, inertial units: {}, firmwares: {}",
        family.flights,
        family.units.len(),
        family.firmwares.len()
    )?;
    if family.units.is_empty() {
        writeln!(out, "No log names its inertial unit: give a rule for names, such as --names '{{unit}}/*'")?;
    }
    if family.findings.is_empty() {
        writeln!(out, "Nothing stands out.")?;
    }
    for sentence in &family.findings {
        writeln!(out, "{sentence}")?;
    }
    for p in &family.parameters {
        writeln!(out, "\n{} {} ({}), {}", p.effect, p.name, p.unit, counted(p.flights, "flight"))?;
        writeln!(out, "  turn-on spread {}", with_sigma(p.turn_on_spread.value, p.turn_on_spread.sigma))?;
        if let (Some(mean), Some(between)) = (p.family_mean, p.between_units) {
            let places = two_figures(mean.sigma);
            let mean = with_sigma(mean.value, mean.sigma);
            writeln!(out, "  family mean {mean}, between units {between:.places$}")?;
        }
        for u in &p.units {
            let mark = if u.out_of_family { " (out of family)" } else { "" };
            let constant = with_sigma(u.constant.value, u.constant.sigma);
            writeln!(out, "  {:<16} {constant} in {}{mark}", u.unit, counted(u.flights, "flight"))?;
        }
    }
    for r in &family.recurring {
        writeln!(out, "{}: {} identified in {} of {} flights", r.unit, r.effect, r.identified, r.explained)?;
    }
    match page {
        Some(path) => writeln!(out, "\nreport: {}", path.display()),
        None => Ok(()),
    }
}
