//! `gaware preflight`: is this the vehicle that the plan and the airframe file describe, and is it ready? Asks only.

use super::demo::load_airframe;
use super::mission::ConnectArgs;
use super::{CommandError, output, start};
use crate::mission_link::facts::{self, Wish};
use crate::mission_link::files::{self, Contents, FileError};
use crate::mission_link::session::{Session, SessionError};
use crate::mission_link::wire::Wire;
use crate::preflight::{self, Against, Row, Verdict};
use gaware_mission::item::Autopilot;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio_util::sync::CancellationToken;

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
    let runtime = start::runtime()?;
    let table = runtime.block_on(async {
        let stop = CancellationToken::new();
        start::cancel_on_signal(&stop);
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
    session.close().await;
    let checks = preflight::check(&facts.map_err(SessionError::Conflict)?, against);
    let ready = checks.iter().all(|r| r.verdict != Verdict::Stop);
    Ok(Table { schema: "gaware.preflight/1", ready, checks })
}

/// The messages that a run asks this autopilot for.
fn streams(autopilot: Autopilot) -> Vec<(u32, &'static str)> {
    let inertial = match autopilot {
        Autopilot::ArduPilot => [(105, "HIGHRES_IMU"), (27, "RAW_IMU")],
        Autopilot::Px4 => [(26, "SCALED_IMU"), (105, "HIGHRES_IMU")],
    };
    inertial.into_iter().chain([(24, "GPS_RAW_INT"), (30, "ATTITUDE")]).collect()
}
