//! `gaware plan`: excitation maneuvers for an airframe and a place, and what they will make observable of the inertial unit, or of sensors beside it.

use super::band::{self, BandError};
use super::known::with_known;
use super::{CommandError, demo, output};
use crate::compass::world::WorldField;
use crate::demo::predictor;
use crate::figures::counted;
use crate::mission_link::files::{self, Contents, FileError};
use crate::pipeline::{self, Quality};
use crate::sensors::ConverterOptions;
use gaware_mission::fence::{Fence, FenceCircle};
use gaware_mission::item::{Autopilot, Home, LatLon};
use gaware_mission::maneuver::Maneuver;
use gaware_mission::planner::{
    DEFAULT_BEAM, Plan, PlanError, PlannedManeuver, PlannedState, Request, climb_out, plan, radius_that_fits,
};
use gaware_mission::predictor::sensors::SensorPredictor;
use gaware_mission::predictor::{NamedSigma, Predictor};
use gaware_mission::safety::Limits;
use gaware_nav::earth::Geodetic;
use gaware_nav::identify::aids::foreseen::Planned;
use gaware_nav::math::{atan2, hypot};
use gaware_nav::model::Model;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Maneuvers begin no higher than this above the floor, m.
const CLIMB_M: f64 = 60.0;

/// Arguments of `gaware plan`.
#[derive(Debug, Clone, clap::Args)]
pub struct PlanArgs {
    /// small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes the airframe.
    #[arg(long, value_name = "NAME|FILE", default_value = "small_fixed_wing")]
    pub airframe: String,
    /// Home: latitude and longitude in deg, altitude above sea level in m.
    #[arg(
        long,
        value_name = "LAT,LON,ALT",
        value_delimiter = ',',
        num_args = 1,
        required = true,
        allow_hyphen_values = true
    )]
    pub home: Vec<f64>,
    /// Take the geofence of this .plan (default: a circle around home).
    #[arg(long, value_name = "FILE")]
    pub fence: Option<PathBuf>,
    /// Radius of the circle around home where no fence is given, m.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 800.0,
        conflicts_with = "fence",
        allow_negative_numbers = true
    )]
    pub radius: f64,
    /// Lowest height above home for maneuvers, m.
    #[arg(long, value_name = "M", default_value_t = 40.0, allow_negative_numbers = true)]
    pub floor: f64,
    /// Highest height above home, m.
    #[arg(long, value_name = "M", default_value_t = 120.0, allow_negative_numbers = true)]
    pub ceiling: f64,
    /// Wind toward north and east, m/s.
    #[arg(long, value_name = "N,E", value_delimiter = ',', num_args = 1, allow_hyphen_values = true, default_values_t = [0.0, 0.0])]
    pub wind: Vec<f64>,
    /// Course of the take-off, deg (default: into the wind).
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub heading: Option<f64>,
    /// Land at home after the last maneuver, where there is space for it (default: end in a hold; a fixed wing on PX4 always lands).
    #[arg(long)]
    pub land: bool,
    /// Time from the end of the climb to the hold at the end, s (default: until every observable parameter converges, at most the airframe's maneuvers_max_s).
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub budget: Option<f64>,
    /// Model of the sensors (default: as `run`).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Recording of this vehicle, a minute on the ground ("gaware run --record") or an earlier flight: its noise, the rate of its fixes and what
    /// the receiver says of them are planned with, so that the flight keeps what is promised.
    #[arg(long, value_name = "LOG")]
    pub measured: Option<PathBuf>,
    /// Plan for sensors beside the inertial unit instead of it: maneuvers by what they make observable of the errors of these.
    #[arg(long = "for", value_name = "SENSOR", value_enum, value_delimiter = ',')]
    pub sensors: Vec<PlannedSensor>,
    /// What is known of the unit.
    #[command(flatten)]
    pub unit: super::known::UnitFileArgs,
    /// Write the mission here: .plan or .waypoints.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: super::OverwriteArgs,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// A sensor that is planned for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum PlannedSensor {
    /// Offsets, scale factors, motors, mounting and delay of a compass.
    Compass,
    /// Scale, offset and delay of a pitot tube, apart from the wind.
    Airspeed,
    /// Static port, propeller wash, delay and scale of a barometer.
    Barometer,
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
pub enum PlanCommandError {
    /// Arguments that cannot be.
    #[error("--{0}")]
    Numbers(String),
    /// A band of heights that is none.
    #[error(transparent)]
    Band(#[from] BandError),
    /// Refused, with the reason.
    #[error(transparent)]
    Refused(#[from] PlanError),
    /// A circle that is too small.
    #[error("{source}; a circle of {radius_m:.0} m has the space: --radius {radius_m:.0}")]
    Tight {
        /// Why not.
        source: PlanError,
        /// m.
        radius_m: f64,
    },
    /// A recording that says nothing.
    #[error("{path} holds too few inertial samples to measure their noise: record a minute of them", path = .0.display())]
    Measured(PathBuf),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
}

impl PlanCommandError {
    /// Whether the arguments were at fault.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Numbers(_) | Self::Band(_) | Self::File(FileError::Kind(_)))
    }
}

/// Plans, writes and prints.
///
/// # Errors
/// Arguments or files that make no sense; a refusal with its reason.
pub fn run(args: &PlanArgs) -> Result<(), CommandError> {
    let airframe = Some(Path::new(&args.airframe));
    let read = [airframe, args.model.as_deref(), args.fence.as_deref(), args.measured.as_deref()];
    let outputs = args.overwrite.outputs(read.into_iter().flatten());
    if let Some(path) = &args.out {
        files::check_kind(path).map_err(PlanCommandError::from)?;
        outputs.check(path)?;
    }
    // Whose plan this is, only a recording of the vehicle says.
    let known = match &args.measured {
        Some(log) => args.unit.of_log(log, None)?,
        None => args.unit.decide(None)?,
    };
    let model = with_known(args.model.as_deref().map(super::load_model).transpose()?, known.as_ref());
    let mut request = request(args)?;
    let model = measured(args, model.unwrap_or_else(Model::standard), &mut request)?;
    let made = if args.sensors.is_empty() {
        planned(args, &request, predictor(&model, &request))?
    } else {
        planned(args, &request, sensor_predictor(&model, &request, &args.sensors)?)?
    };
    if let Some(path) = &args.out {
        let a = &request.airframe;
        let contents = Contents {
            mission: made.mission.clone(),
            fence: request.limits.fence.clone(),
            airframe: Some(a.clone()),
            ..Contents::default()
        };
        let text =
            files::text_of(path, &contents, a.autopilot, a.mav_type()).map_err(PlanCommandError::from)?;
        outputs.write(path, files::marked(path, text))?;
    }
    if let Some(path) = args.out.as_ref().filter(|p| p.extension().is_some_and(|e| e == "txt")) {
        crate::sinks::log::line(&format!(
            "{} was written as waypoints (QGC WPL 110), without the fence",
            path.display()
        ));
    }
    if args.json {
        output::json(&document(&made, &request, &args.sensors))
    } else {
        output::words(|out| print(out, &made, &request))
    }
}

/// Makes the plan; a refusal for want of space comes with the circle that would have it.
fn planned<P: Predictor>(args: &PlanArgs, request: &Request, predictor: P) -> Result<Plan, PlanCommandError> {
    plan(request, predictor.clone()).map_err(|e| with_radius(args, request, predictor, e))
}

/// What a flight makes observable of these sensors.
///
/// # Errors
/// A place where the world magnetic model does not hold.
pub fn sensor_predictor(
    model: &Model,
    request: &Request,
    sensors: &[PlannedSensor],
) -> Result<SensorPredictor, PlanCommandError> {
    let place = request.home.place();
    let home = Geodetic::from_degrees(place.lat_deg, place.lon_deg, f64::from(request.home.alt_m));
    let world = WorldField::at(&home, None)
        .ok_or_else(|| PlanCommandError::Numbers("for: no magnetic field is known at this place".into()))?;
    let kind = |s: &PlannedSensor| match s {
        PlannedSensor::Compass => Planned::Compass,
        PlannedSensor::Airspeed => Planned::Airspeed,
        PlannedSensor::Barometer => Planned::Barometer,
    };
    let mut own = sensors.to_vec();
    own.sort_unstable();
    own.dedup();
    let planned: Vec<Planned> = own.iter().map(kind).collect();
    let [n, e, _] = request.limits.wind_ned_m_per_s;
    let bound = predictor(model, request);
    Ok(SensorPredictor::new(bound, &request.airframe, &planned, [n, e], world.field_n))
}

fn with_radius(
    args: &PlanArgs,
    request: &Request,
    predictor: impl Predictor,
    source: PlanError,
) -> PlanCommandError {
    use PlanError::{ClimbOut, HomeOutside, NoWayHome, NothingFits};
    let tight = matches!(source, ClimbOut { .. } | HomeOutside { .. } | NoWayHome(_) | NothingFits { .. });
    let wider = if tight && args.fence.is_none() { radius_that_fits(request, predictor) } else { None };
    match wider {
        Some(radius_m) => PlanCommandError::Tight { source, radius_m },
        None => source.into(),
    }
}

fn request(args: &PlanArgs) -> Result<Request, CommandError> {
    let airframe = demo::load_airframe(&args.airframe)?;
    let wrong = |what: &str| CommandError::from(PlanCommandError::Numbers(what.to_owned()));
    check(args)?;
    let [lat, lon, alt] =
        args.home[..].try_into().map_err(|_| wrong("home takes latitude, longitude and altitude"))?;
    let [n, e]: [f64; 2] =
        args.wind[..].try_into().map_err(|_| wrong("wind takes two numbers, toward north and east"))?;
    let place = LatLon { lat_deg: lat, lon_deg: lon };
    if !place.is_valid() || !f64::is_finite(alt) {
        return Err(wrong("home is not on the Earth: give latitude and longitude in degrees"));
    }
    let (lat_e7, lon_e7) = place.to_e7();
    let home = Home { lat_e7, lon_e7, alt_m: alt as f32 };
    let fence = match &args.fence {
        Some(path) => files::read(path).map_err(PlanCommandError::from)?.1,
        None => Fence {
            circles: vec![FenceCircle { inclusion: true, center: place, radius_m: args.radius }],
            ..Fence::default()
        },
    };
    if fence.is_empty() {
        return Err(wrong("fence: the file holds no geofence"));
    }
    let upwind = atan2(-e, -n).to_degrees().rem_euclid(360.0);
    let heading = args.heading.unwrap_or(if hypot(n, e) > 0.1 { upwind } else { 0.0 });
    // Space for maneuvers on both sides, but no long climb before the first.
    let height = (0.5 * (args.floor + args.ceiling)).min(args.floor + CLIMB_M);
    let budget_s = args.budget.unwrap_or(airframe.maneuvers_max_s);
    Ok(Request {
        start: climb_out(&airframe, home, heading, height, &Vector3::new(n, e, 0.0)),
        airframe,
        home,
        take_off: true,
        landing: args.land,
        start_height_m: height,
        start_heading_deg: heading,
        limits: Limits { fence, floor_m: args.floor, ceiling_m: args.ceiling, wind_ned_m_per_s: [n, e, 0.0] },
        budget_s,
        within_reach_only: args.budget.is_none(),
        fix_interval_s: 0.2,
        beam: DEFAULT_BEAM,
    })
}

/// The model with what a recording shows of this vehicle, and the time between its fixes.
fn measured(args: &PlanArgs, model: Model, request: &mut Request) -> Result<Model, CommandError> {
    let Some(log) = &args.measured else { return Ok(model) };
    let samples = pipeline::samples(log, ConverterOptions::default())?;
    let quality = Quality::of(&samples, &model).ok_or_else(|| PlanCommandError::Measured(log.clone()))?;
    crate::sinks::log::line(&format!("measured in {}: {}", log.display(), quality.words()));
    if let Some(receiver) = quality.receiver {
        request.fix_interval_s = receiver.interval_s;
    }
    Ok(quality.applied(model))
}

/// Numbers that cannot be meant, by the name of their argument.
fn check(args: &PlanArgs) -> Result<(), PlanCommandError> {
    let wrong = |text: String| Err(PlanCommandError::Numbers(text));
    let numbers = [
        ("radius", args.radius),
        ("heading", args.heading.unwrap_or(0.0)),
        ("budget", args.budget.unwrap_or(1.0)),
    ];
    let numbers = numbers.into_iter().chain(args.wind.iter().map(|w| ("wind", *w)));
    if let Some((name, value)) = numbers.into_iter().find(|(_, v)| !v.is_finite()) {
        return wrong(format!("{name} {value} is no number to plan with"));
    }
    for (name, value) in [("radius", args.radius), ("budget", args.budget.unwrap_or(1.0))] {
        if value <= 0.0 {
            return wrong(format!("{name} {value} must be positive"));
        }
    }
    band::check([args.floor, args.ceiling])?;
    Ok(())
}

/// A plan (`gaware.plan/1`).
#[derive(Debug, Serialize, JsonSchema)]
pub struct PlanDocument {
    /// `gaware.plan/1`.
    pub schema: &'static str,
    /// Length of the flight, s.
    pub duration_s: f64,
    /// Items without home.
    pub items: usize,
    /// In the order of the flight.
    pub maneuvers: Vec<ManeuverEntry>,
    /// Predicted sigmas over time, about once per second.
    pub sigmas: Vec<SigmasEntry>,
    /// What the plan promises for each state.
    #[schemars(with = "Vec<StateSchema>")]
    pub states: Vec<PlannedState>,
    /// What the plan cannot make observable and why, in words.
    pub notes: Vec<String>,
    /// What the vehicle enforces while it flies the plan, and what it does not, in words.
    pub enforcement: [String; 2],
    /// The sensors that it is for, whose parameters are then the states; without, the inertial unit.
    #[serde(rename = "for")]
    pub sensors: Vec<PlannedSensor>,
}

/// A maneuver of a plan.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ManeuverEntry {
    /// `climb`, or with a side `{"spiral": "left"}`.
    #[schemars(with = "Value")]
    pub maneuver: Maneuver,
    /// From, s.
    pub start_s: f64,
    /// To, s.
    pub end_s: f64,
    /// Its first and its last item.
    pub items: [usize; 2],
}

/// Predicted sigmas at one time.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SigmasEntry {
    /// Time since the start of the mission, s.
    pub t_s: f64,
    /// One entry for each state.
    #[schemars(with = "Vec<SigmaSchema>")]
    pub sigmas: Vec<NamedSigma>,
}

/// A sigma with its target.
#[derive(JsonSchema)]
#[allow(dead_code, reason = "describes `NamedSigma`, whose crate knows no schemas")]
struct SigmaSchema {
    /// `bg_x`, `g11`, `latency`, …
    name: String,
    /// 1-sigma in `unit`.
    sigma: f64,
    /// Sigma below which the state counts as observable, in `unit`.
    target: f64,
    /// Unit.
    unit: String,
}

/// What a plan promises for one state.
#[derive(JsonSchema)]
#[allow(dead_code, reason = "describes `PlannedState`, whose crate knows no schemas")]
struct StateSchema {
    /// `bg_x`, `g11`, …
    name: String,
    /// Unit.
    unit: String,
    /// 1-sigma at the end of the plan.
    sigma: f64,
    /// Sigma below which the state counts as observable.
    target: f64,
    /// Whether the target is reached, and if not, why.
    reach: String,
}

fn document(made: &Plan, request: &Request, sensors: &[PlannedSensor]) -> PlanDocument {
    let maneuver = |m: &PlannedManeuver| ManeuverEntry {
        maneuver: m.maneuver,
        start_s: m.start_s,
        end_s: m.end_s,
        items: [*m.items.start(), *m.items.end()],
    };
    let sigmas = made.sigmas.iter().map(|at| SigmasEntry { t_s: at.t_s, sigmas: at.sigmas.clone() });
    PlanDocument {
        schema: "gaware.plan/1",
        duration_s: made.duration_s,
        items: made.mission.items.len(),
        maneuvers: made.maneuvers.iter().map(maneuver).collect(),
        sigmas: sigmas.collect(),
        states: made.states.clone(),
        notes: made.notes.clone(),
        enforcement: enforcement(request),
        sensors: sensors.to_vec(),
    }
}

fn print(out: &mut String, made: &Plan, request: &Request) -> std::fmt::Result {
    writeln!(
        out,
        "{}: {}, {:.0} s",
        request.airframe.name,
        counted(made.mission.items.len(), "item"),
        made.duration_s
    )?;
    for m in &made.maneuvers {
        writeln!(out, "{:6.0} s  {}", m.start_s, m.maneuver.words(&request.airframe).long)?;
    }
    let ends = made.maneuvers.iter().map(|m| m.end_s).chain([made.duration_s]);
    let columns: Vec<_> = std::iter::once(0.0)
        .chain(ends)
        .filter_map(|t| made.sigmas.iter().min_by(|a, b| (a.t_s - t).abs().total_cmp(&(b.t_s - t).abs())))
        .collect();
    let Some(first) = columns.first() else { return Ok(()) };
    write!(out, "{:>10}", "sigma at")?;
    for c in &columns {
        write!(out, "{:>8.0} s", c.t_s)?;
    }
    writeln!(out, "{:>10}  unit", "target")?;
    for (k, state) in first.sigmas.iter().enumerate() {
        write!(out, "{:>10}", state.name)?;
        for s in columns.iter().filter_map(|c| c.sigmas.get(k)) {
            write!(out, "{:>10.3}", s.sigma)?;
        }
        writeln!(out, "{:>10.3}  {}", state.target, state.unit)?;
    }
    writeln!(out, "{}", made.summary())?;
    made.notes.iter().try_for_each(|note| writeln!(out, "note: {note}"))?;
    enforcement(request).iter().try_for_each(|text| writeln!(out, "{text}"))
}

/// What the vehicle watches over while it flies the plan, and what only the pilot does.
///
/// ArduPilot: `AC_Fence.cpp`, parameters FENCE_ENABLE, FENCE_ACTION, FENCE_TYPE, FENCE_ALT_MIN, FENCE_ALT_MAX; PX4: `geofence_params.c`,
/// GF_ACTION, GF_MAX_VER_DIST.
fn enforcement(request: &Request) -> [String; 2] {
    let (when, heights) = match request.airframe.autopilot {
        Autopilot::ArduPilot => (
            "FENCE_ENABLE is 1, FENCE_ACTION is not 0 and FENCE_TYPE includes polygons and circles",
            "FENCE_ALT_MIN and FENCE_ALT_MAX",
        ),
        Autopilot::Px4 => ("GF_ACTION is 2 or more", "GF_MAX_VER_DIST, an upper limit only,"),
    };
    let limits = &request.limits;
    [
        format!(
            "enforced by the vehicle: the geofence, uploaded with the mission, if {when} (gaware preflight reads these)"
        ),
        format!(
            "not enforced: heights of {:.0} to {:.0} m above home (the mission keeps to them; the vehicle would by {heights} which a plan does not set), \
             the predicted load factor and the airspeed between the limits of the airframe",
            limits.floor_m, limits.ceiling_m
        ),
    ]
}
