//! `gaware demo`: everything at once without hardware.

use super::band::BandArgs;
use super::demo_loop::Dialect;
use super::foxglove::{DEFAULT_ADDRESS, listen_address};
use super::report::ReportError;
use super::{CommandError, OverwriteArgs, foxglove, output, signals, start};
use crate::demo::closed_loop::Correctable;
use crate::demo::flight::{Ending, Flight, Stage};
use crate::demo::ground::GroundSession;
use crate::demo::{Prepared, Settings, result};
use crate::engine::snapshot::Snapshot;
use crate::outputs::{Outputs, mark};
use crate::sensors::Severity;
use crate::sinks::messages::RecordItem;
use crate::sinks::status::{LinkState, LinkView, SinkStatus};
use crate::sinks::terminal::{self, Sources, headless};
use gaware_mission::airframe::{Airframe, EXAMPLES};
use gaware_mission::planner::PlanError;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;

/// Between two looks at the clock.
const TICK: Duration = Duration::from_millis(20);
/// Between two snapshots.
const SNAPSHOT: Duration = Duration::from_millis(200);
/// Most virtual time in one tick, s: a computer that is too slow for the speed asked for stays usable.
const MOST_PER_TICK_S: f64 = 2.0;

/// Arguments of `gaware demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// What flies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE", default_value = "small_fixed_wing")]
    pub airframe: String,
    /// Seed of the simulated sensor errors and of all noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Virtual seconds per second, or max: as fast as it goes, without screens.
    #[arg(long, default_value = "8", value_parser = parse_speed)]
    pub speed: DemoSpeed,
    /// Time for the maneuvers, s (default: until every observable parameter converges, at most the airframe's maneuvers_max_s).
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub budget: Option<f64>,
    /// Heights that the plan and proposed maneuvers keep to.
    #[command(flatten)]
    pub band: BandArgs,
    /// Mean wind toward north and east, m/s.
    #[arg(long, value_name = "N,E", value_delimiter = ',', num_args = 1, allow_hyphen_values = true, default_values_t = [-2.0, 1.5])]
    pub wind: Vec<f64>,
    /// Sensor model that the estimator assumes and from which the true errors are drawn.
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Without the ground session before the flight: the flight alone must show G.
    #[arg(long)]
    pub flight_only: bool,
    /// Address of the web page.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080", value_parser = listen_address, conflicts_with = "no_web")]
    pub web: SocketAddr,
    /// No web page.
    #[arg(long)]
    pub no_web: bool,
    /// Live data for Foxglove, which connects to ws://ADDR. Without an address 127.0.0.1:8765, with a port alone that port of 127.0.0.1;
    /// not with --speed max.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = DEFAULT_ADDRESS, value_parser = listen_address)]
    pub foxglove: Option<SocketAddr>,
    /// Do not draw on the terminal.
    #[arg(long)]
    pub headless: bool,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Write the HTML report here (default: gaware-demo-report.html in the folder for temporary files; with --json or --loop none).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Close the loop instead: inject an error that the autopilot can correct, fly, explain, apply the parameters, fly again,
    /// compare the autopilot's own innovations. As fast as it goes, without screens.
    #[arg(long = "loop", conflicts_with_all = ["web", "model", "foxglove"])]
    pub closed_loop: bool,
    /// With --loop: what is injected.
    #[arg(long, value_enum, requires = "closed_loop", default_value_t = Correctable::GpsLatency)]
    pub effect: Correctable,
    /// With --loop: whose habits the simulated autopilot has (default: the airframe's).
    #[arg(long, value_enum, requires = "closed_loop")]
    pub autopilot: Option<Dialect>,
    /// With --loop: write both recordings, the explanation with its parameter file and the result into this folder.
    #[arg(long, value_name = "DIR", requires = "closed_loop")]
    pub out: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

impl DemoArgs {
    fn outputs(&self) -> Outputs {
        let airframe = Some(Path::new(&self.airframe));
        self.overwrite.outputs([airframe, self.model.as_deref()].into_iter().flatten())
    }
}

/// How fast virtual time runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DemoSpeed {
    /// Virtual seconds per second.
    Times(f64),
    /// As fast as it goes.
    Max,
}

fn parse_speed(text: &str) -> Result<DemoSpeed, String> {
    if text == "max" {
        return Ok(DemoSpeed::Max);
    }
    match text.parse::<f64>() {
        Ok(factor) if factor.is_finite() && factor > 0.0 => Ok(DemoSpeed::Times(factor)),
        _ => Err("write a positive number or max".to_owned()),
    }
}

/// Why there is no demonstration.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// No such airframe.
    #[error("there is no airframe or file \"{name}\"; known airframes are {known}")]
    UnknownAirframe {
        /// As written.
        name: String,
        /// All names.
        known: String,
    },
    /// The description is wrong.
    #[error("{path}: {source}")]
    Airframe {
        /// File.
        path: PathBuf,
        /// Why.
        source: gaware_mission::airframe::AirframeError,
    },
    /// Not two numbers.
    #[error("--wind takes two numbers, toward north and toward east in m/s: --wind 3,-2")]
    Wind,
    /// No one could watch it.
    #[error("--foxglove shows a flight at the speed of a clock: choose another --speed than max")]
    FoxgloveAtMax,
    /// No time.
    #[error("--budget {0} must be a positive number of seconds")]
    Budget(f64),
    /// Values that no airframe has.
    #[error(transparent)]
    Values(#[from] gaware_mission::airframe::AirframeError),
    /// No plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The loop.
    #[error(transparent)]
    Loop(Box<crate::demo::closed_loop::LoopError>),
    /// The mission could not be uploaded, or the flight did not end.
    #[error("{0}")]
    Flight(String),
}

impl DemoError {
    /// Whether the arguments were at fault.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::UnknownAirframe { .. }
                | Self::Wind
                | Self::FoxgloveAtMax
                | Self::Budget(_)
                | Self::Values(_)
        )
    }
}

/// An airframe by name or from a file.
///
/// # Errors
/// There is none, or the file does not describe one.
pub fn load_airframe(name: &str) -> Result<Airframe, CommandError> {
    if let Some(airframe) = Airframe::example(name) {
        return Ok(airframe);
    }
    let path = Path::new(name);
    if !path.exists() {
        let known = EXAMPLES.map(|(n, _)| n).join(", ");
        return Err(DemoError::UnknownAirframe { name: name.to_owned(), known }.into());
    }
    let text =
        crate::inputs::text(path).map_err(|source| CommandError::Read { path: path.to_owned(), source })?;
    Ok(Airframe::from_toml(&text).map_err(|source| DemoError::Airframe { path: path.to_owned(), source })?)
}

/// A budget that can be one.
///
/// # Errors
/// It cannot.
pub fn check_budget(budget: Option<f64>) -> Result<Option<f64>, DemoError> {
    match budget {
        Some(s) if !s.is_finite() || s <= 0.0 => Err(DemoError::Budget(s)),
        budget => Ok(budget),
    }
}

/// Where the report goes without --out: not the working directory.
fn default_report() -> PathBuf {
    std::env::temp_dir().join("gaware-demo-report.html")
}

/// What these arguments ask for.
///
/// # Errors
/// Arguments that make no sense.
fn settings(args: &DemoArgs) -> Result<Settings, CommandError> {
    let mut settings = Settings::new(load_airframe(&args.airframe)?, check_budget(args.budget)?);
    settings.wind_n_e_m_per_s = args.wind[..].try_into().map_err(|_| DemoError::Wind)?;
    if settings.wind_n_e_m_per_s.iter().any(|w| !w.is_finite()) {
        return Err(DemoError::Wind.into());
    }
    settings.band_m = args.band.or(settings.band_m)?;
    if let Some(path) = &args.model {
        settings.belief = super::load_model(path)?.with_receiver();
        settings.drawn = settings.belief.clone();
    }
    Ok(settings)
}

/// Plans, and says what the plan promises.
pub(super) fn plan(settings: Settings) -> Result<Prepared, CommandError> {
    crate::sinks::log::line("planning …");
    let prepared = Prepared::new(settings).map_err(DemoError::from)?;
    crate::sinks::log::line(&prepared.plan.summary());
    prepared.plan.notes.iter().for_each(|note| crate::sinks::log::line(note));
    Ok(prepared)
}

/// Runs the command and prints its result.
///
/// # Errors
/// Arguments that make no sense, no safe plan, and a flight that did not come to its end.
pub fn run(args: &DemoArgs) -> Result<(), CommandError> {
    let settings = settings(args)?;
    let outputs = args.outputs();
    if args.closed_loop {
        return super::demo_loop::run(args, settings, &outputs);
    }
    let report = args.report.clone().or_else(|| (!args.json).then(default_report));
    report.iter().try_for_each(|path| outputs.check(path))?;
    let mut by_hand = (!args.flight_only).then(|| GroundSession::new(&settings, args.seed));
    let mut flight = match args.speed {
        DemoSpeed::Max if args.foxglove.is_some() => return Err(DemoError::FoxgloveAtMax.into()),
        DemoSpeed::Max => {
            by_hand.iter_mut().for_each(|session| session.go_on(f64::INFINITY));
            let settings = after(by_hand.as_ref(), settings);
            let mut flight = Flight::new(plan(settings)?, args.seed);
            flight.run();
            flight
        }
        DemoSpeed::Times(factor) => {
            let runtime = start::runtime()?;
            let flight = runtime.block_on(show(args, settings, by_hand.as_mut(), factor))?;
            runtime.shutdown_timeout(Duration::from_secs(2));
            let Some(flight) = flight else {
                crate::sinks::log::line("stopped before the flight; nothing was written");
                return Ok(());
            };
            flight
        }
    };
    let mut result = result::of(&mut flight, args.seed);
    if let Some(session) = &by_hand {
        result.document.insert("ground".to_owned(), session.document());
    }
    let reported = report.map_or(Ok(()), |path| write_report(&path, &flight, &result, &outputs));
    // A page that cannot be written takes the result with it no more.
    if args.json {
        output::json(&result.document)?;
    } else {
        let ground = by_hand.map_or_else(String::new, |session| session.words() + "\n");
        output::text(&(ground + &result.text()))?;
    }
    reported?;
    match &result.ending {
        // Whoever ends it has seen what was to be seen.
        Ending::Holding | Ending::Landed | Ending::Stopped => Ok(()),
        Ending::NotUploaded(why) => Err(DemoError::Flight(why.clone()).into()),
        Ending::OutOfTime => Err(DemoError::Flight("the flight did not come to its end".to_owned()).into()),
    }
}

fn write_report(
    path: &Path,
    flight: &Flight,
    result: &result::DemoResult,
    outputs: &Outputs,
) -> Result<(), CommandError> {
    let page = crate::report::demo::html(&flight.prepared().settings.airframe.name, result, &result.series);
    outputs.write(path, mark::text(page.map_err(ReportError::Draw)?, mark::Style::Angle))?;
    crate::sinks::log::line(&format!("report: {}", path.display()));
    Ok(())
}

/// What a session by hand leaves to plan for.
fn after(by_hand: Option<&GroundSession>, settings: Settings) -> Settings {
    let Some(session) = by_hand else { return settings };
    crate::sinks::log::line(&session.words());
    session.unit().map_or_else(|| settings.clone(), |unit| settings.clone().knowing(&unit))
}

/// Shows a session by hand at the speed of the clock, to its end or until somebody stops it.
async fn by_hand_first(
    session: &mut GroundSession,
    factor: f64,
    snapshots: &watch::Sender<Arc<Snapshot>>,
    stop: &CancellationToken,
) {
    let mut tick = tokio::time::interval(SNAPSHOT);
    tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let (mut last, mut target_s) = (Instant::now(), 0.0);
    while !session.is_over() {
        tokio::select! {
            () = stop.cancelled() => return,
            _ = tick.tick() => {}
        }
        let most_s = SNAPSHOT.as_secs_f64() / TICK.as_secs_f64() * MOST_PER_TICK_S;
        target_s = (target_s + last.elapsed().as_secs_f64() * factor).min(session.now_s() + most_s);
        last = Instant::now();
        tokio::task::block_in_place(|| session.go_on(target_s));
        snapshots.send_replace(Arc::new(session.snapshot()));
    }
    snapshots.send_replace(Arc::new(planning()));
}

/// What screens show while the planner works.
fn planning() -> Snapshot {
    Snapshot {
        waiting_for: "planning the maneuvers; this takes some seconds".to_owned(),
        ..Snapshot::default()
    }
}

/// Flies at the speed of the clock, with screens: the page is there before the planning begins. Nothing where someone
/// stopped it before the flight.
async fn show(
    args: &DemoArgs,
    settings: Settings,
    mut by_hand: Option<&mut GroundSession>,
    factor: f64,
) -> Result<Option<Flight>, CommandError> {
    let stop = CancellationToken::new();
    signals::cancel_on_signal(&stop);
    let status = SinkStatus::new();
    let (snapshots, snapshots_rx) = watch::channel(Arc::new(planning()));
    let sources = || Sources { snapshots: snapshots_rx.clone(), status: status.clone(), requests: None };
    let page =
        if args.no_web { None } else { Some(start::serve_web(args.web, None, sources(), &stop).await?) };
    let feed = match args.foxglove {
        Some(address) => Some(foxglove::serve(address, None, &status, &stop)?),
        None => None,
    };
    let options = terminal::Options::from_env(|name| std::env::var(name).ok());
    let on_screen = !args.headless && !args.json && std::io::stdout().is_terminal();
    let screen = if on_screen { terminal::spawn(sources(), options, stop.clone()).ok() } else { None };
    if screen.is_none() {
        tokio::spawn(headless::run(sources(), headless::PERIOD, crate::sinks::log::Stderr, stop.clone()));
    }
    if let Some(session) = by_hand.as_deref_mut() {
        by_hand_first(session, factor, &snapshots, &stop).await;
    }
    let settings = after(by_hand.as_deref(), settings);
    let planned = tokio::task::spawn_blocking(move || plan(settings));
    let prepared = tokio::select! {
        () = stop.cancelled() => return Ok(None),
        prepared = planned => match prepared {
            Ok(prepared) => prepared?,
            Err(failed) => return Err(DemoError::Flight(failed.to_string()).into()),
        },
    };
    status.set_route(prepared.route());
    let mut flight = Flight::new(prepared, args.seed);
    let viewers = feed.map(|feed| feed.counting_from(foxglove::now_us()));
    if let Some(viewers) = &viewers {
        flight = flight.watched(viewers.clone());
    }
    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let (mut last, mut shown) = (Instant::now(), None::<Instant>);
    let mut target_s = 0.0;
    while !matches!(flight.stage(), Stage::Over(_)) && !stop.is_cancelled() {
        tokio::select! {
            () = stop.cancelled() => break,
            _ = tick.tick() => {}
        }
        target_s = (target_s + last.elapsed().as_secs_f64() * factor).min(flight.now_s() + MOST_PER_TICK_S);
        last = Instant::now();
        tokio::task::block_in_place(|| {
            while flight.now_s() < target_s && !matches!(flight.stage(), Stage::Over(_)) {
                flight.turn();
            }
        });
        for text in flight.take_messages() {
            if let Some(viewers) = &viewers {
                viewers.offer(&RecordItem::Log(flight.now_us(), Severity::Info, text.clone()));
            }
            if screen.is_none() {
                crate::sinks::log::line(&text);
            }
        }
        // The end is shown too: the page keeps it.
        if matches!(flight.stage(), Stage::Over(_)) || shown.is_none_or(|t| t.elapsed() >= SNAPSHOT) {
            shown = Some(Instant::now());
            status.set_link(link_view(&flight));
            status.set_vehicle(flight.vehicle_view());
            let snapshot = flight.snapshot();
            if let Some(viewers) = &viewers {
                viewers.offer(&RecordItem::Snapshot(flight.now_us(), Box::new(snapshot.clone())));
            }
            snapshots.send_replace(Arc::new(snapshot));
        }
    }
    stop.cancel();
    if let Some(page) = page {
        // Open pages get the end; the server gives them a moment only.
        let _ = page.await;
    }
    if let Some(screen) = screen {
        // The terminal is given back before the result is printed.
        let _ = screen.await;
    }
    Ok(Some(flight))
}

fn link_view(flight: &Flight) -> LinkView {
    LinkView {
        state: if flight.frames() > 0 { LinkState::Up } else { LinkState::Connecting },
        detail: format!("simulated {}", flight.prepared().settings.airframe.name),
        frames: flight.frames(),
        rate_hz: flight.frames() as f64 / flight.now_s().max(1.0),
        ..LinkView::default()
    }
}
