//! `gaware preflight`: is this the vehicle that the plan and the airframe file describe, and is it ready? Asks only.

use super::demo::load_airframe;
use super::mission::ConnectArgs;
use super::{CommandError, OverwriteArgs, output, signals, start};
use crate::mission_link::facts::{self, Wish};
use crate::mission_link::files::{self, Contents, FileError};
use crate::mission_link::measure;
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::wire::Wire;
use crate::outputs::{OutputError, mark};
use crate::pipeline::Quality;
use crate::preflight::{self, Against, Row, Verdict};
use gaware_mission::item::Autopilot;
use gaware_nav::model::Model;
use gaware_nav::sample::Sample;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Rate of the inertial samples that are measured, Hz: that of a run.
const MEASURED_HZ: u16 = 200;
/// From so many times the model's noise on it is said.
const NOISY: f64 = 1.5;

/// Arguments of `gaware preflight`.
#[derive(Debug, Clone, clap::Args)]
pub struct PreflightArgs {
    /// The link and the vehicle.
    #[command(flatten)]
    pub to: ConnectArgs,
    /// Plan that is to be flown, .plan or .waypoints.
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
    /// What flies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Measure the noise of the samples and what the receiver says of its fixes for so long, s: 30 are enough. Rates are asked for as by a run, and
    /// given back.
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u16).range(2..=600))]
    pub measure: Option<u16>,
    /// Write the standard model with what was measured here, for "gaware plan --model".
    #[arg(long, value_name = "FILE", requires = "measure")]
    pub model_out: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Why there is no check, or what it found.
#[derive(Debug, thiserror::Error)]
pub enum PreflightError {
    /// The plan.
    #[error(transparent)]
    File(#[from] FileError),
    /// No vehicle, or too many.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The model is not written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A vehicle whose noise cannot be measured.
    #[error("the vehicle sent too few inertial samples in {0} s to measure their noise")]
    TooFewSamples(u16),
    /// The table says stop.
    #[error("not ready to fly: {0}")]
    Stop(String),
}

/// The table (`gaware.preflight/1`).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Table {
    /// `gaware.preflight/1`.
    pub schema: &'static str,
    /// Whether nothing says stop.
    pub ready: bool,
    /// The checks.
    pub checks: Vec<Row>,
}

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.checks.iter().try_for_each(|row| writeln!(f, "{row}"))
    }
}

/// Checks and prints the table.
///
/// # Errors
/// No vehicle, files that cannot be read, or a check that says stop.
pub fn run(args: &PreflightArgs) -> Result<(), CommandError> {
    let airframe = args.airframe.as_deref().map(load_airframe).transpose()?;
    let plan = args.plan.as_deref().map(read_plan).transpose()?;
    let against = Against { plan: plan.as_ref(), airframe: airframe.as_ref() };
    let outputs = args.overwrite.outputs(args.plan.iter());
    args.model_out.iter().try_for_each(|path| outputs.check(path))?;
    let runtime = start::runtime()?;
    let table = runtime.block_on(async {
        let stop = CancellationToken::new();
        signals::cancel_on_signal(&stop);
        check(args, against, &stop).await
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    let table = table?;
    if args.to.json {
        output::json(&table)?
    } else {
        output::text(&table.to_string())?
    }
    let stops = table.checks.iter().filter(|r| r.verdict == Verdict::Stop);
    let stops: Vec<&str> = stops.map(|r| r.text.as_str()).collect();
    if stops.is_empty() { Ok(()) } else { Err(PreflightError::Stop(stops.join("; ")).into()) }
}

fn read_plan(path: &Path) -> Result<Contents, PreflightError> {
    Ok(files::read_contents(path)?)
}

/// Asks the vehicle and makes the table.
///
/// # Errors
/// No vehicle, or several to choose from.
pub async fn check(
    args: &PreflightArgs,
    against: Against<'_>,
    stop: &CancellationToken,
) -> Result<Table, PreflightError> {
    let mut session = Session::open(&args.to.opening(), stop).await?;
    let autopilot = session.vehicle().autopilot;
    let wish = Wish { parameters: preflight::parameters(autopilot), streams: streams(autopilot) };
    let facts = facts::gather(&mut session, wish).await;
    let samples = match args.measure {
        Some(seconds) => Some(measure::listen(&mut session, f64::from(seconds), MEASURED_HZ).await),
        None => None,
    };
    session.close().await;
    let mut checks = preflight::check(&facts.map_err(SessionError::Conflict)?, against);
    if let (Some(seconds), Some(samples)) = (args.measure, samples) {
        let (row, model) = measured(seconds, &samples.map_err(SessionError::Conflict)?)?;
        checks.push(row);
        if let Some(path) = &args.model_out {
            let outputs = args.overwrite.outputs(args.plan.iter());
            outputs.write(path, mark::text(model.to_toml(), mark::Style::Hash))?;
        }
    }
    let ready = checks.iter().all(|r| r.verdict != Verdict::Stop);
    Ok(Table { schema: "gaware.preflight/1", ready, checks })
}

/// What the unit and its receiver are worth, and the standard model with it.
fn measured(seconds: u16, samples: &[Sample]) -> Result<(Row, Model), PreflightError> {
    let model = Model::standard();
    let quality = Quality::of(samples, &model).ok_or(PreflightError::TooFewSamples(seconds))?;
    let noisy = quality.gyro_noise > NOISY * model.imu.gyro_noise
        || quality.accel_noise > NOISY * model.imu.accel_noise;
    let (verdict, advice) = if noisy {
        (
            Verdict::Warn,
            "; noisier than the standard model: plan with --model (--model-out writes it), or the flight shows less than is promised",
        )
    } else {
        (Verdict::Ok, "")
    };
    Ok((Row::new("sensors", verdict, format!("{}{advice}", quality.words())), quality.applied(model)))
}

/// The messages that a run asks this autopilot for.
fn streams(autopilot: Autopilot) -> Vec<(u32, &'static str)> {
    let inertial = match autopilot {
        Autopilot::ArduPilot => [(105, "HIGHRES_IMU"), (27, "RAW_IMU")],
        Autopilot::Px4 => [(26, "SCALED_IMU"), (105, "HIGHRES_IMU")],
    };
    inertial.into_iter().chain([(24, "GPS_RAW_INT"), (30, "ATTITUDE")]).collect()
}
