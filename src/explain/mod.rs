//! Explain: where simulation and measurement disagree, which effect is unmodelled, and whether adding it helps on
//! held-out data.
//!
//! Reads logs, hands the mathematics to `gaware_nav::identify`, and puts the result into words and the
//! `gaware.explanation/1` contract. It decides nothing about likelihoods itself.

pub mod advice;
mod assembly;
pub mod autopilot;
pub mod consequence;
pub mod contract;
pub mod drivers;
mod files;
pub mod schema;
mod unfit;
pub mod words;

use crate::advice::on_board::OnBoard;
use crate::aids::{self, Aids};
use crate::health::HealthLog;
use crate::inputs::Input;
use crate::logs::LogError;
use crate::outputs::OutputError;
use crate::parallel::{Threads, cores};
use crate::pipeline;
use crate::sensors::ConverterOptions;
use crate::unit::known::KnownUnit;
use contract::Explanation;
pub use files::{check, files, write};
use gaware_nav::earth::Geodetic;
use gaware_nav::effects::RECEIVER;
use gaware_nav::identify::beyond;
use gaware_nav::identify::flight::{Flight, TooLittle};
use gaware_nav::identify::judge::{self, Judged};
use gaware_nav::identify::residual::{self, Point};
use gaware_nav::identify::select::{self, Settings};
use gaware_nav::identify::size::{Flown, Size};
use gaware_nav::identify::survey::NotFound;
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::sample::Sample;
use std::path::PathBuf;
use std::time::Duration;
pub use unfit::Unfit;

/// What to explain.
#[derive(Debug, Clone)]
pub struct Request {
    /// Flights to choose and fit on.
    pub logs: Vec<Input>,
    /// Flights that only judge; empty: blocks of the first ones are held out.
    pub validate: Vec<Input>,
    /// The assumed model: all that the sensors have. `None`: the ordinary one, whose sensors may have the tolerances of any unit.
    pub model: Option<Model>,
    /// Vehicle and source message.
    pub converter: ConverterOptions,
    /// Thresholds.
    pub settings: Settings,
    /// Parameter file of the vehicle, for what the logs do not hold.
    pub parameters: Option<Input>,
    /// All of every log, however long; otherwise an hour at most of all logs together, where the vehicle moves most.
    pub whole: bool,
    /// Where the vehicle is as long as no fix says so.
    pub place: Option<Geodetic>,
}

/// So much flight is explained at once, s: an hour of 200 Hz with 5 fixes per second takes a minute and about half a gigabyte (docs/explain.md).
const MOST_S: f64 = 3600.0;
/// … and of each of many logs at least so much, s.
const LEAST_S: f64 = 600.0;
/// Memory by what there is of it, bytes: as recorded and averaged, of each sample; of all linearised flights, of each fix (docs/explain.md: 260 MB
/// for the samples of an hour, 459 with its fixes).
const BYTES: (f64, f64) = (360.0, 11_000.0);
/// Processor time of each fix, s: least and most of the recordings of docs/explain.md, the most on planes of 12 min in turbulence (2026-11-27).
const FIX_S: (f64, f64) = (1.5e-3, 25e-3);
/// … and where the noise is not the sensors' or many effects are named: .14 on a public log of a wing and on an independent flight of 14 min
/// (2026-11-30), .1 to .4 on four of eight public logs of a copter's hops of a minute and a half, one of which ends at a wall.
const FIX_AT_WORST_S: f64 = 0.15;

/// What is to be explained, once it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Workload {
    /// Inertial samples.
    pub samples: usize,
    /// Fixes.
    pub fixes: usize,
}

impl Workload {
    fn of(samples: &[Sample]) -> Self {
        let count = |wanted: fn(&Sample) -> bool| samples.iter().filter(|s| wanted(s)).count();
        Self {
            samples: count(|s| matches!(s, Sample::Imu(_))),
            fixes: count(|s| matches!(s, Sample::Fix(_))),
        }
    }

    /// What it will take, in words: processor time and memory.
    pub fn words(self) -> String {
        let (samples, fixes) = (self.samples as f64, self.fixes as f64);
        let mb = 20.0 + (BYTES.0 * samples + BYTES.1 * fixes) / 1e6;
        let seconds = |each: f64| (each * fixes).max(1.0);
        let time = match (seconds(FIX_S.0), seconds(FIX_S.1)) {
            (_, most) if most < 2.0 => "a second".to_owned(),
            (least, most) => format!("{least:.0} to {most:.0} s"),
        };
        let worst = seconds(FIX_AT_WORST_S);
        format!(
            "{} samples and {} fixes: about {time} of processor time (up to {worst:.0} s where much is missing) and {mb:.0} MB of memory",
            self.samples, self.fixes
        )
    }
}

/// What is being done, for a progress bar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading log number so many.
    Reading(usize),
    /// Everything is read.
    Read(Workload),
    /// Fitting noise and adding effects.
    Choosing,
    /// Judging on held-out data.
    Judging,
    /// Simulating the sensors along the smoothed trajectories.
    Smoothing,
}

/// Number of steps that the progress counts.
pub const STEPS: usize = 4;

impl Phase {
    /// Its number among the steps, and in words.
    pub fn step(self) -> (usize, String) {
        match self {
            Self::Reading(k) => (1, format!("reading log {}", k + 1)),
            Self::Read(_) | Self::Choosing => (2, "fitting noise, comparing effects".to_owned()),
            Self::Judging => (3, "judging on held-out data".to_owned()),
            Self::Smoothing => (STEPS, "simulating the sensors along the smoothed trajectory".to_owned()),
        }
    }

    /// What is left at the beginning of a step, by what the step before took. How long the second step takes depends on how many effects there
    /// are, which only it finds out, so that nothing is said before its end. From then on all that is left took at most these shares of the step
    /// before on four recorded flights of 2.5 to 11 minutes with none to three effects: .80, .95 and .64.
    pub fn time_left(self, last: Duration) -> String {
        let share = match self {
            Self::Reading(_) | Self::Read(_) | Self::Choosing => return String::new(),
            Self::Judging => 0.8,
            Self::Smoothing => 0.7,
        };
        format!(", at most about {:.0} s left", (share * last.as_secs_f64()).max(1.0).ceil())
    }
}

/// Why there is no explanation.
#[derive(Debug, thiserror::Error)]
pub enum ExplainError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The parameter file cannot be used.
    #[error("{path}: {reason}", path = path.display())]
    Parameters {
        /// File.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// No log was given.
    #[error("no log was given")]
    NoLog,
    /// The result is not written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A plot cannot be drawn.
    #[error("cannot draw a plot: {0}")]
    Plot(String),
}

/// The result with everything that the report shows.
#[derive(Debug, Clone, Default)]
pub struct Explained {
    /// The contract.
    pub explanation: Explanation,
    /// The model with the effects added (values with the sigmas of the estimate).
    pub model: Model,
    /// The numbers behind it; `None` where the flights say too little.
    pub judged: Option<Judged>,
    /// What is to be known of the recordings themselves, sentence by sentence.
    pub notes: Vec<String>,
    /// Why no value is to be used, where the inertial samples are not good enough.
    pub unfit: Option<Unfit>,
    /// Where simulation and measurement disagree, flight by flight.
    pub residuals: Vec<FlightResiduals>,
    /// Residuals against what drives effects that the catalogue does not hold.
    pub drivers: Vec<drivers::DriverPlot>,
    /// Effects that were tested and are not significant.
    pub not_found: Vec<NotFound>,
    /// Names of the logs.
    pub logs: Vec<String>,
    /// Names of the logs that only judged.
    pub validated: Vec<String>,
    /// What the logs say of the vehicle's own parameters.
    pub on_board: OnBoard,
    /// States and events of the vehicle, log by log; empty where no logs were read.
    pub health: Vec<HealthLog>,
}

/// The disagreement along one flight, with the model that was given and with the new one.
#[derive(Debug, Clone, Default)]
pub struct FlightResiduals {
    /// With the model that was given.
    pub before: Vec<Point>,
    /// With the new one.
    pub after: Vec<Point>,
}

/// Explains from what a unit's file says on this day (as `2026-11-24`), where there is one. Where the recordings contradict it, `left_out` gets
/// the sentence that says so, and they are explained without it.
///
/// # Errors
/// As [`run`].
pub fn run_from(
    known: Option<&KnownUnit>,
    today: &str,
    request: &Request,
    progress: &dyn Fn(Phase),
    left_out: &dyn Fn(&str),
) -> Result<Explained, ExplainError> {
    let Some(known) = known else { return run(request, progress) };
    let before = known.model(request.model.clone(), today);
    let explained = run(&Request { model: Some(before.clone()), ..request.clone() }, progress)?;
    let Some(said) = known.unit.contradicted_by(&before, &explained.model) else { return Ok(explained) };
    let words = known.contradicted_words(&said);
    left_out(&words);
    let mut explained = run(request, progress)?;
    explained.explanation.summary = format!("{words}. {}", explained.explanation.summary);
    Ok(explained)
}

/// Reads and explains.
///
/// # Errors
/// Logs that cannot be read. Logs that say too little are no error: the verdict says so.
pub fn run(request: &Request, progress: &dyn Fn(Phase)) -> Result<Explained, ExplainError> {
    if request.logs.is_empty() {
        return Err(ExplainError::NoLog);
    }
    let settings = Settings { tolerances: request.model.is_none(), ..request.settings };
    let model = request.model.clone().unwrap_or_default();
    // Of each log only what was prepared is kept, and what its inertial messages are.
    let streams = std::cell::RefCell::new(Vec::new());
    let mut parts = Vec::new();
    let mut load = Workload { samples: 0, fixes: 0 };
    let count = (request.logs.len() + request.validate.len()) as f64;
    let most_s = if request.whole { f64::INFINITY } else { (MOST_S / count).max(LEAST_S) };
    let mut read_all = |logs: &[Input], first: usize| -> Result<Vec<Prepared>, ExplainError> {
        logs.iter()
            .enumerate()
            .map(|(k, log)| {
                progress(Phase::Reading(first + k));
                let pipeline::Excerpt { mut samples, part } =
                    pipeline::most_motion(log, request.converter, most_s)?;
                samples.splice(0..0, request.place.map(Sample::Place));
                parts.extend(part);
                let own = Workload::of(&samples);
                load = Workload { samples: load.samples + own.samples, fixes: load.fixes + own.fixes };
                streams
                    .borrow_mut()
                    .extend(samples.iter().filter(|s| matches!(s, Sample::Stream(_))).cloned());
                Ok(Flight::prepare(&samples, &model))
            })
            .collect()
    };
    let flights = read_all(&request.logs, 0)?;
    let flown = streams.take();
    let validate = read_all(&request.validate, request.logs.len())?;
    progress(Phase::Read(load));
    let read = |log: &Input| pipeline::Beside::read(log, request.converter.vehicle);
    let beside: Vec<pipeline::Beside> = request.logs.iter().map(read).collect::<Result<_, _>>()?;
    let own = flights.iter().position(Result::is_ok).and_then(|k| beside.get(k));
    let sensors = |flight: &Flight, judged: &Judged| {
        let Some(beside) = own else { return Aids::default() };
        let (model, noise) = (judged.selection.model(), judged.selection.noise);
        aids::of_flight(flight, &model, Some(noise), beside.start_unix_s(), &beside.on_board)
    };
    let mut explained = flights_of(flights, validate, (&model, &settings), &sensors, progress);
    explained.explanation.summary.push_str(&words::parts(&parts));
    explained.logs = request.logs.iter().map(Input::name).collect();
    explained.validated = request.validate.iter().map(Input::name).collect();
    let dates = beside.iter().map(pipeline::Beside::date);
    for (name, date) in explained.logs.iter_mut().zip(dates).filter(|(_, date)| !date.is_empty()) {
        name.push_str(&format!(" ({date})"));
    }
    let mut on_board = autopilot::on_board(request, &beside)?;
    on_board.samples_are(&flown);
    explained.explanation.autopilot =
        Some(crate::advice::advise(&autopilot::findings(&explained), &on_board));
    explained.on_board = on_board;
    explained.health = beside.into_iter().map(|b| b.health).collect();
    Ok(explained)
}

/// Explains flights that are already in memory.
pub fn samples(
    flights: &[Vec<Sample>],
    validate: &[Vec<Sample>],
    model: &Model,
    settings: &Settings,
    progress: &dyn Fn(Phase),
) -> Explained {
    let prepare = |all: &[Vec<Sample>]| all.iter().map(|samples| Flight::prepare(samples, model)).collect();
    flights_of(prepare(flights), prepare(validate), (model, settings), &|_, _| Aids::default(), progress)
}

/// A recording made ready, or why it says too little.
type Prepared = Result<Flight, TooLittle>;

fn flights_of(
    flights: Vec<Prepared>,
    validate: Vec<Prepared>,
    (model, settings): (&Model, &Settings),
    sensors: &dyn Fn(&Flight, &Judged) -> Aids,
    progress: &dyn Fn(Phase),
) -> Explained {
    let workers = Threads(cores());
    progress(Phase::Choosing);
    let (good, bad) = sorted(flights);
    let (judging, _) = sorted(validate);
    if good.is_empty() {
        let why = bad.first().map_or_else(|| "there is no flight".to_owned(), ToString::to_string);
        let explanation = contract::too_little(&why);
        return Explained { explanation, model: model.clone(), ..Explained::default() };
    }
    // Those that only judge come first: an event of the others has then not happened in them.
    let (judging, good) = in_a_row(judging, good);
    let good: Vec<&Flight> = good.iter().collect();
    let judging: Vec<&Flight> = judging.iter().collect();
    let base = model.clone().with_receiver();
    let selection = select::select(&good, &base, settings, &workers);
    progress(Phase::Judging);
    let selection = beyond::select(&good, &base, selection, settings, &workers);
    let mut judged = judge::judge(&good, &judging, selection, settings, &workers);
    let mut left_over = beyond::left_over(&good, &judged, settings, &workers);
    progress(Phase::Smoothing);
    let residuals = smoothed(&good, &judged, settings, &workers);
    let flown = flown_as(&good, &judged, &residuals);
    let size = |setting: &EffectSetting| flown.size(setting, &judged.selection.base);
    left_over.retain(|setting| !size(setting).negligible);
    let own: Vec<Size> = judged.selection.added.iter().map(|a| size(&a.setting)).collect();
    let not_found = only_tested(&judged, &own);
    let likely = |n: &NotFound| n.evidence > settings.threshold && !size(&n.setting).negligible;
    let likely: Vec<bool> = not_found.iter().map(likely).collect();
    let events = to_own_time(&mut judged, &good);
    let listed = assembly::not_found(&not_found, &likely);
    let drivers = drivers::plots(&judged, &residuals, &good);
    let mut explanation = assembly::explanation(&judged, &own, &residuals, &left_over, listed, &events);
    let unfit = Unfit::of(&good);
    let notes = words::notes(&good, unfit);
    notes.iter().for_each(|note| explanation.summary.push_str(&format!(" {note}")));
    let beside = good.first().map(|flight| sensors(flight, &judged)).unwrap_or_default();
    explanation.summary.push_str(&beside.wrong());
    (explanation.compasses, explanation.air) = (beside.compasses, beside.air);
    Explained {
        explanation,
        model: assembly::new_model(&judged, &own),
        judged: Some(judged),
        notes,
        unfit,
        drivers,
        residuals,
        not_found,
        ..Explained::default()
    }
}

/// The flights as the model that was judged has them.
fn flown_as(flights: &[&Flight], judged: &Judged, residuals: &[FlightResiduals]) -> Flown {
    let motions = residuals.iter().map(|r| r.after.iter().map(|p| &p.motion));
    Flown::new(flights, motions, judged.fit[1].nis_per_dof)
}

/// The recordings that say enough, and why the others do not.
fn sorted(all: Vec<Prepared>) -> (Vec<Flight>, Vec<TooLittle>) {
    let (mut good, mut bad) = (Vec::new(), Vec::new());
    for prepared in all {
        match prepared {
            Ok(flight) => good.push(flight),
            Err(why) => bad.push(why),
        }
    }
    (good, bad)
}

/// What was not found and stands in no other list either.
fn only_tested(judged: &Judged, sizes: &[Size]) -> Vec<NotFound> {
    let selection = &judged.selection;
    let named = selection.steps.iter().zip(sizes).filter(|(_, size)| !size.negligible);
    let named: Vec<&str> = named.flat_map(|(step, _)| step.group.iter().copied()).collect();
    let told = |name: &str| named.contains(&name) || judged.removed.contains(&name);
    judged.survey.not_found.iter().filter(|n| !told(n.setting.effect.name())).cloned().collect()
}

/// Seconds between two flights on the common line of time.
const PAUSE_S: f64 = 1000.0;

/// All flights one after the other on one line of time; the first of `flights` keeps its own.
fn in_a_row(judging: Vec<Flight>, flights: Vec<Flight>) -> (Vec<Flight>, Vec<Flight>) {
    let mut next_s: Option<f64> = None;
    let flights: Vec<Flight> = flights
        .into_iter()
        .map(|flight| {
            let by_s = next_s.map_or(0.0, |t| t - flight.span_s().0);
            let flight = flight.moved(by_s);
            next_s = Some(flight.span_s().1 + PAUSE_S);
            flight
        })
        .collect();
    let mut end_s = flights.first().map_or(0.0, |f| f.span_s().0) - PAUSE_S;
    let judging = judging.into_iter().map(|flight| {
        let flight_end_s = flight.span_s().1;
        let flight = flight.moved(end_s - flight_end_s);
        end_s = flight.span_s().0 - PAUSE_S;
        flight
    });
    (judging.collect(), flights)
}

/// Puts the instants of events back on the time of their own flight; says which flight that is, effect by effect.
fn to_own_time(judged: &mut Judged, flights: &[&Flight]) -> Vec<Option<usize>> {
    let own = |added: &mut select::Added| {
        let instant_s = added.setting.values.first_mut().filter(|_| select::is_jump(added.setting.effect))?;
        let log = flights.iter().rposition(|f| f.span_s().0 <= *instant_s)?;
        *instant_s -= flights[log].moved_s();
        Some(log)
    };
    judged.selection.added.iter_mut().map(own).collect()
}

/// The model without what every receiver does, for files.
fn without_receiver(mut model: Model) -> Model {
    model.remove(RECEIVER.name());
    model
}

/// Simulates the sensors along the best trajectory, with both models and the noise of the better one.
fn smoothed(
    flights: &[&Flight],
    judged: &Judged,
    settings: &Settings,
    workers: &Threads,
) -> Vec<FlightResiduals> {
    let both = residual::before_and_after(flights, &judged.selection, settings, workers);
    both.into_iter().map(|[before, after]| FlightResiduals { before, after }).collect()
}

/// Without line ends, so that a comment stays one.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod ground_tests;
#[cfg(test)]
mod tests;
