//! `gaware run`: the daemon. Frames of all links go through converter and engine in one task, in the order in which they are
//! recorded, so that a replay of the recording repeats the run.

use super::known::with_known;
use super::{CommandError, demo, load_model, output, print};
use crate::advice::on_board::OnBoard;
use crate::link::address::Address;
use crate::link::endpoint::{Links, ReceiveClock, Received};
use crate::link::guard::Guard;
use crate::link::heartbeat::HeartbeatSource;
use crate::link::timesync::Timesync;
use crate::mission_link::uploader::RawMessage;
use crate::pipeline::{Estimator, Pipeline};
use crate::sensors::ConverterOptions;
use crate::sinks::events::Causes;
use crate::sinks::foxglove::Feed;
use crate::sinks::live::Live;
use crate::sinks::recorder::{Recorder, Setup};
use crate::unit::known::KnownUnit;
use crate::view::mission_watch::MissionWatch;
use gaware_mission::item::Mission;
use gaware_nav::model::Model;
use gaware_nav::observability::words::VehicleKind;
use mavlink::dialects::ardupilotmega::MavMessage;
use serde_json::{Map, Value};
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

mod args;
mod introduction;
mod outcome;
mod session;

pub use args::RunArgs;
pub(in crate::commands) use args::seconds;
use introduction::Introduction;
use outcome::{incomplete, received_anything, report_recording};
use session::Session;

/// Seconds after the first sample from which a simulated flight is compared with its truth; as in `replay`.
const TRUTH_FROM_S: f64 = 150.0;

/// How other tasks take part in a run.
#[derive(Debug)]
pub struct Hooks {
    /// Gets the newest state a few times a second.
    pub live: watch::Sender<Arc<Live>>,
    /// Messages for the vehicle and the ground station (telemetry, mission transfer); sent under our identity.
    pub outbox: mpsc::Receiver<MavMessage>,
    /// Messages by id and payload, for the mission transfer; sent in the same way.
    pub raw_outbox: mpsc::Receiver<RawMessage>,
    /// The mission that is planned, where there is one: what its items are.
    pub mission: Option<Mission>,
    /// Gets a copy of every frame that arrives, for protocols with the vehicle; slow readers lose their own.
    pub frames: tokio::sync::broadcast::Sender<Received>,
    /// Gets what is recorded, where live viewers may be; a slow one loses its own.
    pub foxglove: Option<Feed>,
}

/// Runs the command until `stop` or its duration ends it, and prints the result.
///
/// # Errors
/// When the model cannot be read or the recording cannot be started. A link that does not open is tried again until the
/// end, and only an error when by then none ever did.
pub async fn run<E: Estimator>(
    args: &RunArgs,
    hooks: Hooks,
    stop: CancellationToken,
    make: impl Fn(Model) -> E + Send + 'static,
) -> Result<(), CommandError> {
    let live = hooks.live.subscribe();
    let Served { pipeline, document, .. } = serve(args, hooks, stop, make).await?;
    let heard = received_anything(&pipeline, &live.borrow().links);
    if args.json {
        output::json(&document)?;
    } else if heard.is_ok() {
        output::text(&print::summary(&pipeline.summary(), &document))?;
    }
    heard?;
    incomplete(&document)
}

/// The end of a run.
#[derive(Debug)]
pub struct Served<E> {
    /// The pipeline.
    pub pipeline: Pipeline<E>,
    /// The result.
    pub document: Map<String, Value>,
    /// What the vehicle said of itself.
    pub on_board: OnBoard,
    /// The file of the unit that the estimate began from.
    pub known: Option<KnownUnit>,
    /// The recording.
    pub recording: Option<PathBuf>,
}

/// Runs until `stop` or the duration, and gives the pipeline at the end with the result.
///
/// # Errors
/// When the model cannot be read or the recording cannot be started.
pub async fn serve<E: Estimator>(
    args: &RunArgs,
    hooks: Hooks,
    stop: CancellationToken,
    make: impl Fn(Model) -> E + Send + 'static,
) -> Result<Served<E>, CommandError> {
    args.effects.load()?;
    let given = args.model.as_deref().map(load_model).transpose()?;
    let begun = args.known.unit.decide(None)?;
    let model = model(given.clone(), begun.as_ref());
    let clock = ReceiveClock::start();
    let options = args.listen.options();
    let guard = args.signing_key.as_deref().map(Guard::load).transpose()?;
    let setup = setup(args, &model, options)?;
    let recorder = start_recorder(args, &setup, clock.now_us())?;
    let mut hooks = hooks;
    let hooks_mission = hooks.mission.take();
    let mut pipeline = Pipeline::new(options, make(model), TRUTH_FROM_S);
    pipeline.decide_vehicle_kind(args.airframe.as_deref().map(airframe_kind).transpose()?);
    let introduction =
        Introduction::new(&args.known.unit, given, begun, setup, Box::new(make), &mut pipeline);
    let mut session = Session {
        pipeline,
        // The links outlive a cancellation: the rates are given back over them.
        links: Links::start(&args.connect, clock, &CancellationToken::new()),
        clock,
        recorder,
        voice: HeartbeatSource::new(),
        rates: None,
        on_board: OnBoard::default(),
        introduction,
        unit_said: None,
        inventory: None,
        timesync: Timesync::new(),
        hooks,
        guard,
        events: Vec::new(),
        causes: Causes::default(),
        mission: MissionWatch::new(hooks_mission),
        systems_named: (0, 0),
        received_us: None,
        imu_hz: usable_rate(args),
        source: args.listen.source,
    };
    session.until(stop, args.duration).await;
    let mut document = session.pipeline.document();
    session.give_rates_back().await;
    if let Some(guard) = &mut session.guard {
        guard.close();
    }
    session.links.stop().await;
    let recording = session.recorder.as_ref().map(|r| r.path().to_owned());
    if let Some(recorder) = session.recorder {
        let path = recorder.path().to_owned();
        // The writer may have seconds of work left.
        let stats = tokio::task::spawn_blocking(move || recorder.finish()).await.unwrap_or_default();
        tracing::info!(path = %path.display(), ?stats, "recording closed");
        report_recording(&path, stats, &mut document);
    }
    let known = session.introduction.begun;
    Ok(Served { pipeline: session.pipeline, document, on_board: session.on_board, known, recording })
}

/// The model of a run, as a replay will read it, to the last digit.
fn model(given: Option<Model>, known: Option<&KnownUnit>) -> Model {
    let model = with_known(given, known).unwrap_or_else(Model::standard).with_receiver();
    Model::from_toml(&model.to_toml()).unwrap_or(model)
}

fn setup(args: &RunArgs, model: &Model, converter: ConverterOptions) -> Result<Setup, CommandError> {
    Ok(Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        links: args.connect.iter().map(Address::to_string).collect(),
        converter,
        model_toml: model.to_toml(),
        vehicle: args.airframe.as_deref().map(airframe_kind).transpose()?,
        place: args.known.place.home,
    })
}

fn start_recorder(args: &RunArgs, setup: &Setup, now_us: u64) -> Result<Option<Recorder>, CommandError> {
    if args.no_record {
        return Ok(None);
    }
    let recorder = Recorder::start_in(&args.record, now_us, setup, args.record_limit)?;
    tracing::info!(path = %recorder.path().display(), "recording");
    Ok(Some(recorder))
}

/// What flies by the airframe that the user names: a replay must speak of the same.
fn airframe_kind(name: &str) -> Result<VehicleKind, CommandError> {
    let wing = demo::load_airframe(name)?.is_fixed_wing();
    Ok(if wing { VehicleKind::FixedWing } else { VehicleKind::Multirotor })
}

/// The rate asked for, lowered to what a serial line can carry: `RAW_IMU` alone takes 41 bytes of 10 bits, and a third
/// is left to others (FIELD_NOTES: 140 Hz at 57600 baud is the ceiling).
fn usable_rate(args: &RunArgs) -> u16 {
    let slowest = args.connect.iter().filter_map(|a| match a {
        Address::Serial { baud, .. } => Some(baud / 10 / 41 * 2 / 3),
        _ => None,
    });
    slowest.min().map_or(args.rate, |hz| args.rate.min(u16::try_from(hz).unwrap_or(u16::MAX)).max(1))
}

#[cfg(test)]
mod tests;
