//! `gaware effects`: effects that are data. `--effects FILE` defines a user's, and `effects confirm` asks a new flight for those of a model.

use super::{CommandError, ListenArgs, load_model, output};
use crate::explain::words::number;
use crate::parallel::{Threads, cores};
use crate::pipeline;
use gaware_nav::effects::{Effect, data};
use gaware_nav::identify::beyond::{self, Confirmation};
use gaware_nav::identify::flight::Flight;
use gaware_nav::identify::select::Settings;
use gaware_nav::model::{EffectSetting, Model};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;

/// Effects that a user defines.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct EffectsArgs {
    /// Effects beside the catalogue, from this file (gaware.effects/1; repeatable).
    #[arg(long, value_name = "FILE")]
    pub effects: Vec<PathBuf>,
}

impl EffectsArgs {
    /// Defines them; to be called before a model is read that names them.
    ///
    /// # Errors
    /// A file that cannot be read, or is none.
    pub fn load(&self) -> Result<Vec<&'static dyn Effect>, CommandError> {
        let mut all = Vec::new();
        for path in &self.effects {
            let read = |source| CommandError::Read { path: path.clone(), source };
            let text = crate::inputs::text(path).map_err(read)?;
            let own =
                data::load(&text).map_err(|source| CommandError::Effects { path: path.clone(), source })?;
            all.extend(own);
        }
        Ok(all)
    }
}

/// Arguments of `effects`.
#[derive(Debug, Clone, clap::Args)]
pub struct EffectsCommand {
    /// What to do.
    #[command(subcommand)]
    pub command: EffectsKind,
}

/// What `effects` does.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum EffectsKind {
    /// Whether new flights agree with the effects of a model that the catalogue does not hold: value, sign, evidence.
    Confirm(ConfirmArgs),
}

/// Arguments of `effects confirm`.
#[derive(Debug, Clone, clap::Args)]
pub struct ConfirmArgs {
    /// New flights of the same vehicle.
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// The model that `explain` wrote from earlier flights.
    #[arg(long, value_name = "FILE", default_value = "model.toml")]
    pub model: PathBuf,
    /// Effects that a user defines.
    #[command(flatten)]
    pub effects: EffectsArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Evidence from which on an effect is there, nats: that which `explain` asks for.
fn enough() -> f64 {
    Settings::default().threshold
}
/// Values further apart than this, in sigmas of both, disagree: one true value in 370 does.
const APART: f64 = 3.0;

/// What a new flight says of an effect.
fn verdict(c: &Confirmation) -> &'static str {
    let apart = c.differences().iter().any(|z| z.abs() > APART);
    match (c.evidence > enough(), apart) {
        (true, false) => "confirmed",
        (_, true) => "inconsistent",
        (false, false) => "not shown",
    }
}

/// Runs the command.
///
/// # Errors
/// Files that cannot be read, flights that say too little, a model without such effects.
pub fn run(args: &EffectsCommand) -> Result<(), CommandError> {
    let EffectsKind::Confirm(args) = &args.command;
    let users = args.effects.load()?;
    let mut base: Model = load_model(&args.model)?;
    let own = |s: &EffectSetting| {
        let name = s.effect.name();
        name.starts_with(data::FORMULA) || users.iter().any(|e| e.name() == name)
    };
    let asked: Vec<EffectSetting> = base.effects.iter().filter(|s| own(s)).cloned().collect();
    if asked.is_empty() {
        let text = format!("{} holds no effect outside the catalogue", args.model.display());
        return Err(CommandError::Arguments(text));
    }
    asked.iter().for_each(|s| base.remove(s.effect.name()));
    let base = base.with_receiver();
    let mut flights = Vec::new();
    for log in &args.logs {
        let samples = pipeline::samples(log, args.listen.options())?;
        let flight = Flight::prepare(&samples, &base);
        flights.push(flight.map_err(|e| CommandError::TooLittleData(format!("{}: {e}", log.display())))?);
    }
    let flights: Vec<&Flight> = flights.iter().collect();
    let found = beyond::confirm(&flights, &base, &asked, &Settings::default(), &Threads(cores()));
    if args.json {
        let all: Vec<Value> = found.iter().map(document).collect();
        return output::json_pretty(&json!({"schema": "gaware.confirmation/1", "effects": all}));
    }
    output::words(|out| found.iter().try_for_each(|c| words(out, c)))
}

fn document(c: &Confirmation) -> Value {
    let group = c.here.effect.groups().first();
    let si = group.map_or(1.0, |g| g.unit.si);
    let of = |values: &[f64]| values.iter().map(|v| v / si).collect::<Vec<f64>>();
    json!({
        "name": c.here.effect.name(),
        "verdict": verdict(c),
        "unit": group.map_or("", |g| g.unit.symbol),
        "earlier": {"value": of(&c.earlier.values), "sigma": of(&c.earlier.sigmas)},
        "here": {"value": of(&c.here.values), "sigma": of(&c.here.sigmas)},
        "differences_sigma": c.differences(),
        "log_odds": c.evidence,
    })
}

fn words(out: &mut String, c: &Confirmation) -> std::fmt::Result {
    writeln!(out, "{}: {} (log Bayes factor {:.1})", c.here.effect.name(), verdict(c), c.evidence)?;
    for (k, (name, unit)) in c.here.parameters().enumerate() {
        let of = |s: &EffectSetting| {
            let sigma = s.sigmas[k] / unit.si;
            let value = number(s.values[k] / unit.si);
            if sigma > 0.0 { format!("{value} ± {}", number(sigma)) } else { value }
        };
        writeln!(out, "  {name}: earlier {}, here {} {}", of(&c.earlier), of(&c.here), unit.symbol)?;
    }
    Ok(())
}
