//! `gaware ground --connect ADDR`: the guided ground session alone. It runs as `run` does, gives its instructions line by line and to the ground
//! station, ends when nothing is left to do, and keeps the result in the file of the unit.

use super::effects::EffectsArgs;
use super::known::{KnownArgs, PlaceArgs, UnitFileArgs};
use super::run::{self, Hooks, RunArgs, Served, seconds};
use super::unit::{doubt, origin};
use super::{CommandError, ListenArgs, OverwriteArgs, band, file_name, output, signals, start};
use crate::engine::meaning::LIMIT_DEG;
use crate::engine::snapshot::{Estimate, GroundStatus, Snapshot};
use crate::engine::{Engine, EngineOptions};
use crate::link::address::Address;
use crate::pipeline::Beside;
use crate::sinks::events::cause_of;
use crate::sinks::live::Live;
use crate::sinks::log;
use crate::sinks::telemetry::{Telemetry, TelemetryLevel};
use crate::unit::Unit;
use gaware_nav::ground::session::Side;
use mavlink::dialects::ardupilotmega::MavMessage;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Messages for the vehicle that may wait.
const OUTBOX: usize = 64;

/// Arguments of `ground`.
#[derive(Debug, Clone, clap::Args)]
pub struct GroundArgs {
    /// Link to the vehicle, as for `run`; may be given several times.
    #[arg(long, value_name = "ADDR", required = true)]
    pub connect: Vec<Address>,
    /// Keep what is found in this file (see `gaware unit`); what it already says of this unit is where the estimate begins.
    #[arg(long, value_name = "FILE")]
    pub unit: Option<PathBuf>,
    /// Folder of unit files: without --unit what is found is kept there under the vehicle's hardware id.
    #[arg(long, value_name = "DIR", default_value = "units")]
    pub units: PathBuf,
    /// Model of the sensors (default: as for `run`).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// A side that this vehicle cannot stand on (repeatable): level, nose-up, nose-down, right-side, left-side, upside-down.
    #[arg(long, value_name = "SIDE", value_parser = side)]
    pub skip: Vec<Side>,
    /// Where to record: a folder, or a file that ends in .mcap.
    #[arg(long, value_name = "PATH", default_value = "recordings", conflicts_with = "no_record")]
    pub record: PathBuf,
    /// Do not record.
    #[arg(long)]
    pub no_record: bool,
    /// Rate of inertial messages to ask for, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub rate: u16,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Where the vehicle is.
    #[command(flatten)]
    pub place: PlaceArgs,
    /// Messages to the ground station: off, or instructions as texts and values.
    #[arg(long, value_enum, value_name = "LEVEL", default_value = "low")]
    pub telemetry: TelemetryLevel,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// End after this many seconds with what there is.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub duration: Option<Duration>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// A session that gives no result.
#[derive(Debug, thiserror::Error)]
pub enum GroundError {
    /// Armed or flying.
    #[error("no ground session: {0}")]
    Refused(String),
    /// It ended before all sides were held.
    #[error(
        "the ground session ended early, {done} of {all} sides done: what was measured is kept, start it again to go on"
    )]
    Early {
        /// Sides that are done.
        done: usize,
        /// Sides that the vehicle can stand on.
        all: usize,
    },
}

/// The result (`gaware.ground/1`).
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct GroundResult {
    /// `gaware.ground/1`.
    pub schema: &'static str,
    /// What each side has brought, and what is left to do.
    pub session: GroundStatus,
    /// Estimates at the end.
    pub estimate: Estimate,
    /// Names of the states that are observable now, of all that are judged.
    pub observable: Vec<String>,
    /// Names of those that are not.
    pub unobservable: Vec<String>,
    /// The file of the unit, where one is kept.
    pub unit: Option<String>,
    /// Where the session disagrees with what the file said before, in words.
    pub inconsistencies: Vec<String>,
}

fn side(text: &str) -> Result<Side, String> {
    let known = |s: Side| s.words().trim_start_matches("on its ").replace(' ', "-");
    let names = || Side::ALL.map(known).join(", ");
    Side::ALL.into_iter().find(|s| known(*s) == text).ok_or_else(|| format!("write one of {}", names()))
}

/// Runs the command.
///
/// # Errors
/// The vehicle is armed or flies, the session ends early, or a file or a link fails.
pub fn run(args: GroundArgs) -> Result<(), CommandError> {
    let outputs = args.overwrite.outputs::<&std::path::Path>([]);
    args.unit.iter().try_for_each(|path| outputs.check(path))?;
    let runtime = start::runtime()?;
    let result = runtime.block_on(session(&args));
    runtime.shutdown_timeout(Duration::from_secs(2));
    result
}

fn run_args(args: &GroundArgs) -> RunArgs {
    RunArgs {
        effects: EffectsArgs::default(),
        connect: args.connect.clone(),
        config: None,
        model: args.model.clone(),
        record: args.record.clone(),
        record_limit: None,
        no_record: args.no_record,
        headless: true,
        rate: args.rate,
        airframe: None,
        band: band::BandArgs::default(),
        listen: args.listen.clone(),
        known: KnownArgs {
            place: args.place.clone(),
            unit: UnitFileArgs {
                unit: args.unit.clone().filter(|path| path.exists()),
                units: args.units.clone(),
                no_unit: false,
            },
            limit: LIMIT_DEG,
        },
        signing_key: None,
        telemetry: args.telemetry,
        web: None,
        foxglove: None,
        web_token: None,
        mission: None,
        params: None,
        json: args.json,
        duration: None,
    }
}

async fn session(args: &GroundArgs) -> Result<(), CommandError> {
    let (asked, stop) = (CancellationToken::new(), CancellationToken::new());
    signals::cancel_on_signal(&asked);
    let (live, live_rx) = watch::channel(Arc::new(Live::default()));
    let (outbox, outbox_rx) = mpsc::channel(OUTBOX);
    let (frames, _) = broadcast::channel(OUTBOX);
    let (_raw, raw_outbox) = mpsc::channel(1);
    let guide = Guide { telemetry: args.telemetry.config().map(Telemetry::new), outbox, said: String::new() };
    let ends = (asked, stop.clone(), args.duration);
    let guide = tokio::spawn(guide.until_done(live_rx, ends));
    let options =
        EngineOptions { place: args.place.home, ground: Some(args.skip.clone()), ..EngineOptions::default() };
    let hooks = Hooks { live, outbox: outbox_rx, raw_outbox, mission: None, frames, foxglove: None };
    let make = move |model| Engine::new(model, options.clone());
    let served = run::serve(&run_args(args), hooks, stop, make).await?;
    // It ends with the run.
    let refused = guide.await.unwrap_or_default();
    if let Some(reason) = refused {
        return Err(GroundError::Refused(reason).into());
    }
    finish(args, &served)
}

/// Gives the instructions.
struct Guide {
    telemetry: Option<Telemetry>,
    outbox: mpsc::Sender<MavMessage>,
    said: String,
}

impl Guide {
    /// Until nothing is left to do, the vehicle refuses (then why), or somebody asks for the end.
    async fn until_done(
        mut self,
        mut live: watch::Receiver<Arc<Live>>,
        (asked, stop, after): (CancellationToken, CancellationToken, Option<Duration>),
    ) -> Option<String> {
        let _end = stop.clone().drop_guard();
        let began = Instant::now();
        let over = async {
            match after {
                Some(after) => tokio::time::sleep(after).await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(over);
        loop {
            tokio::select! {
                () = asked.cancelled() => return None,
                () = stop.cancelled() => return None,
                () = &mut over => return None,
                changed = live.changed() => if changed.is_err() { return None },
            }
            let now = live.borrow_and_update().clone();
            let ground = &now.snapshot.ground;
            if !ground.refused.is_empty() {
                return Some(ground.refused.clone());
            }
            self.say(began.elapsed().as_secs_f64(), &now.snapshot);
            if ground.done {
                return None;
            }
        }
    }

    fn say(&mut self, now_s: f64, snapshot: &Snapshot) {
        let instruction = &snapshot.ground.instruction;
        let cause = cause_of(instruction);
        if cause != self.said {
            log::line(instruction);
            self.said = cause;
        }
        let texts = self.telemetry.as_mut().map(|t| t.feed(now_s, snapshot)).unwrap_or_default();
        // A full outbox loses a text; the next instruction comes.
        texts.into_iter().for_each(|text| drop(self.outbox.try_send(text)));
    }
}

/// The result, and the file of the unit.
fn finish(args: &GroundArgs, served: &Served<Engine>) -> Result<(), CommandError> {
    let (engine, snapshot) = (served.pipeline.engine(), served.pipeline.snapshot());
    let mut beside = Beside::default();
    beside.on_board = served.on_board.clone();
    let mut file = match (&args.unit, &beside.on_board.board) {
        (Some(path), _) => Some(path.clone()),
        (None, Some(id)) => Some(crate::unit::file_of(&args.units, id)),
        (None, None) => None,
    };
    // Where the estimate began, and what it could not begin from any more: the vehicle named itself too late, or is another.
    let begun = served.known.as_ref().map(|k| k.unit.clone());
    let before = match (&begun, &file) {
        (None, Some(path)) if path.exists() => Some(Unit::read(path)?),
        _ => begun.clone(),
    };
    let session = &snapshot.ground;
    let states = &snapshot.observability.states;
    let of = |observable: bool| {
        use crate::engine::snapshot::Status::Observable;
        states.iter().filter(|s| (s.status == Observable) == observable).map(|s| s.name.clone()).collect()
    };
    let mut inconsistencies = Vec::new();
    if let (Some(path), Some(filter)) = (file.clone(), engine.filter()) {
        let from = served.recording.as_deref().map_or_else(|| "ground session".to_owned(), file_name);
        let mut new = Unit::of_filter(filter, origin(&beside, &from));
        if let Some(before) = &before {
            before.check_hardware(&path, new.origin.hardware_id.as_deref())?;
            if begun.is_some() && filter.model().joint.is_some() {
                new = new.after(before);
            } else {
                // It is not where the estimate began, or is not believed any more: what it says is compared, and replaced.
                inconsistencies.extend(before.contradictions(&new));
            }
            let far = engine.summary().implausible;
            inconsistencies
                .extend(far.into_iter().map(|name| format!("{name} is far from what the file says")));
        }
        // What contradicts the file is said above; without one nothing else tells an axis that is the wrong way round.
        if let Some(why) = doubt(engine).filter(|_| before.is_none() && !args.overwrite.force) {
            inconsistencies.push(format!(
                "{why}; the file of the unit was not written (--force writes it all the same)"
            ));
            file = None;
        } else if !new.measured().is_empty() {
            if let Some(folder) = path.parent().filter(|_| args.unit.is_none()) {
                args.overwrite.outputs::<&std::path::Path>([]).folder(folder)?;
            }
            new.write(&path, &args.overwrite.outputs::<&std::path::Path>([]))?;
        }
    }
    let result = GroundResult {
        schema: "gaware.ground/1",
        session: session.clone(),
        estimate: snapshot.estimate.clone(),
        observable: of(true),
        unobservable: of(false),
        unit: file.as_ref().map(|p| p.display().to_string()),
        inconsistencies,
    };
    if args.json {
        output::json(&result)?;
    } else {
        output::text(&text(&result))?;
    }
    if session.done {
        return Ok(());
    }
    let done = session.sides.iter().filter(|s| s.done).count();
    let all = session.sides.iter().filter(|s| !s.skipped).count();
    Err(GroundError::Early { done, all }.into())
}

/// In words and columns.
fn text(r: &GroundResult) -> String {
    use std::fmt::Write;
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(out, "ground session of {:.0} s", r.session.duration_s);
    for s in &r.session.sides {
        let brought = s.g_sigma_deg_per_h_per_g.map_or_else(String::new, |[before, after]| {
            format!(", largest sigma of G {before:.0} → {after:.0} deg/h/g")
        });
        let state = match (s.done, s.skipped) {
            (true, _) => "done",
            (_, true) => "left out",
            _ => "not done",
        };
        let _ =
            writeln!(out, "{:>18}: {state}, held {:.0} of {:.0} s{brought}", s.side, s.held_s, s.wanted_s);
    }
    let g = &r.estimate.g_sensitivity_deg_per_h_per_g;
    for (k, (values, sigmas)) in g.value.iter().zip(g.sigma).enumerate() {
        let _ = write!(out, "{:>22}", if k == 0 { "g-sensitivity, deg/h/g" } else { "" });
        for (value, sigma) in values.iter().zip(sigmas) {
            let _ = write!(out, " {value:>9.1} ± {sigma:<6.1}");
        }
        out.push('\n');
    }
    if r.session.turn_sigma.iter().any(|s| *s > 0.0) {
        let [roll, pitch, yaw] = r.session.turn_sigma.map(|s| 100.0 * s);
        let _ = writeln!(
            out,
            "gyro scale factors and axes: sigma {roll:.0} % of 300 ppm and 0.5 mrad by turns around the roll axis, {pitch:.0} % pitch, {yaw:.0} % yaw"
        );
    }
    if r.session.turned_on_support_mrad > 0.0 {
        let _ = writeln!(
            out,
            "the support gave way by up to {:.1} mrad in one hold: biases, scale factors and axes of the gyros may be off by three of their sigmas, G is not affected; repeat the session on something firm",
            r.session.turned_on_support_mrad
        );
    }
    if !r.session.reference_known {
        out +=
            "place or heading unknown: the Earth's rate counts as an unknown of 15 deg/h (--home LAT,LON)\n";
    }
    if !r.unobservable.is_empty() {
        let _ = writeln!(out, "not observable yet: {}", r.unobservable.join(", "));
    }
    for said in &r.inconsistencies {
        let _ = writeln!(out, "inconsistent: {said}");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_named_as_the_help_names_them() {
        for (text, wanted) in
            [("level", Side::Level), ("right-side", Side::RightSide), ("upside-down", Side::UpsideDown)]
        {
            assert_eq!(side(text), Ok(wanted));
        }
        assert!(side("sideways").is_err_and(|e| e.contains("nose-up")));
    }
}
