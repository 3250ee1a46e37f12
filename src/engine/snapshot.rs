//! What the engine sends to every sink: one [`Snapshot`] at a few hertz, one [`Summary`] at the end.
//!
//! The field names are a contract (design, section 3): screens, telemetry, recordings and the web page all read
//! these types and nothing else. Units are in the names.

use super::situation::Situation;
use crate::timeline::Gaps;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A value with its 1-sigma, per axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate3 {
    /// Values of the three axes.
    pub value: [f64; 3],
    /// 1-sigma of the three axes.
    pub sigma: [f64; 3],
}

/// G with its 1-sigmas; row = gyro axis, column = axis of specific force.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EstimateMatrix {
    /// Values, rows of G.
    pub value: [[f64; 3]; 3],
    /// 1-sigmas, rows of G.
    pub sigma: [[f64; 3]; 3],
}

/// One parameter of an estimated effect other than G.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ParameterEstimate {
    /// Effect, for example `gps_latency`.
    pub effect: String,
    /// Parameter, for example `latency`.
    pub name: String,
    /// Unit of value and sigma.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// 1-sigma.
    pub sigma: f64,
}

/// All estimates in the units of screens.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate {
    /// Roll, pitch, yaw.
    pub attitude_deg: Estimate3,
    /// Gyro bias, body axes.
    pub gyro_bias_deg_per_h: Estimate3,
    /// Accelerometer bias, body axes.
    pub accel_bias_mg: Estimate3,
    /// The g-sensitivity matrix.
    pub g_sensitivity_deg_per_h_per_g: EstimateMatrix,
    /// Parameters of every other estimated effect.
    #[serde(default)]
    pub effects: Vec<ParameterEstimate>,
}

/// Whether the error of attitude that G makes in a turn matters to the vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TurnVerdict {
    /// It exceeds the limit by two sigma.
    Matters,
    /// It stays below the limit by two sigma.
    DoesNotMatter,
    /// G is not known well enough.
    #[default]
    NotKnown,
}

/// What G means for the pilot.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TurnError {
    /// Error of roll, pitch, yaw after a turn at 2 g of 60 s without correction.
    pub attitude_deg: Estimate3,
    /// What matters to this vehicle.
    pub limit_deg: f64,
    /// Whether it does.
    pub verdict: TurnVerdict,
    /// In words.
    pub text: String,
}

/// Where the vehicle is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Motion {
    /// Latitude, deg.
    pub lat_deg: f64,
    /// Longitude, deg.
    pub lon_deg: f64,
    /// Height as the fixes count it, m.
    pub height_m: f64,
    /// Velocity north, east, down, m/s.
    pub velocity_ned_m_per_s: [f64; 3],
    /// Specific force, body axes, g, bias removed.
    pub specific_force_g: [f64; 3],
    /// Angular rate, body axes, deg/s, bias and G removed.
    pub rate_deg_per_s: [f64; 3],
    /// 1-sigma of position north, east, down, m.
    pub position_sigma_m: [f64; 3],
}

/// One of the paper's conditions.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Condition {
    /// Whether it is met.
    pub met: bool,
    /// How far, 0 to 1.
    #[serde(default)]
    pub progress: f64,
    /// What is missing, in words; empty when met.
    #[serde(default)]
    pub missing: String,
}

/// The paper's conditions (a), (b), (c).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Conditions {
    /// Two independent changes of specific force on a segment of constant attitude: attitude and biases.
    pub a: Condition,
    /// Every element of specific force changes on such segments: diagonal G.
    pub b: Condition,
    /// Three independent changes on such segments: full G.
    pub c: Condition,
}

/// How well a state is known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Sigma as at the start.
    #[default]
    Unobservable,
    /// Sigma has begun to shrink.
    Weak,
    /// Sigma shrinks and the target is in sight.
    Converging,
    /// Sigma below the target.
    Observable,
}

/// One state of the filter as the pilot sees it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StateStatus {
    /// `g11`, `bg_x`, `ba_z`, …
    pub name: String,
    /// How well known.
    pub status: Status,
    /// Sigma now over sigma at the start.
    pub sigma_ratio: f64,
    /// Sigma in `unit`.
    #[serde(default)]
    pub sigma: f64,
    /// Sigma below which the state counts as observable, in `unit`.
    #[serde(default)]
    pub target: f64,
    /// Unit of sigma and target.
    #[serde(default)]
    pub unit: String,
}

/// A combination of states that the flight has not made known, or several states that lack the same excitation.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Direction {
    /// Weight of each state that takes part, in units of its remaining sigma; 1 for each of several states that are
    /// unknown by themselves.
    pub states: std::collections::BTreeMap<String, f64>,
    /// The same in words, with the remedy.
    pub text: String,
}

/// The three views together.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Observability {
    /// The paper's conditions.
    pub conditions: Conditions,
    /// Covariance per state.
    pub states: Vec<StateStatus>,
    /// Weak directions of the whitened Gramian.
    pub unobservable_directions: Vec<Direction>,
    /// Which view is stricter where they disagree, and why; empty where they agree.
    #[serde(default)]
    pub disagreement: String,
    /// Directions of the whitened Gramian that are not weak …
    #[serde(default)]
    pub gramian_rank: usize,
    /// … of so many constant states.
    #[serde(default)]
    pub gramian_states: usize,
}

/// What the pilot is asked to fly.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Guidance {
    /// The instruction as a pilot would say it; empty when there is none.
    pub instruction: String,
    /// The state it is for and why, in words.
    pub reason: String,
    /// Progress of the maneuver that is being flown, 0 to 1.
    pub progress: f64,
    /// What the last maneuver brought, in words.
    pub last_result: String,
    /// Whether everything the airframe can excite is known.
    pub done: bool,
}

/// How far the autopilot is with its own mission.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MissionProgress {
    /// Whether the autopilot flies its mission now.
    pub flying: bool,
    /// The current item, as the autopilot counts.
    pub item: u16,
    /// Time at this item, s.
    pub at_item_s: f64,
    /// That the item takes much longer than it should, in words; empty while it does not.
    pub stuck: String,
}

/// The phase the estimator is in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// No inertial samples yet.
    #[default]
    WaitingForImu,
    /// Inertial samples, but no fix.
    WaitingForGnss,
    /// Levelling.
    Aligning,
    /// Roll and pitch known, several headings possible.
    SearchingHeading,
    /// Running.
    Running,
}

/// The inertial source.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImuStatus {
    /// Message name.
    pub message: String,
    /// Samples used so far.
    pub samples: u64,
    /// Rate over the last seconds (summary: over the whole run), Hz.
    pub rate_hz: f64,
    /// Rate that was asked for, Hz; 0 where none was.
    #[serde(default)]
    pub asked_hz: f64,
    /// Share of the samples that were lost on the way over the last seconds.
    #[serde(default)]
    pub loss: f64,
    /// Samples that were lost on the way (gaps, missing messages) or rejected.
    pub dropped: u64,
    /// Gaps between the samples.
    #[serde(default)]
    pub gaps: Gaps,
}

/// The fixes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GnssStatus {
    /// Fixes received.
    pub fixes: u64,
    /// Of these used.
    pub used: u64,
    /// Of these rejected.
    pub rejected: u64,
    /// Rate over the last seconds, Hz.
    #[serde(default)]
    pub rate_hz: f64,
    /// Gaps between the fixes.
    #[serde(default)]
    pub gaps: Gaps,
}

/// Filter consistency.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Consistency {
    /// Mean normalised innovation squared per degree of freedom; 1 is right.
    pub nis_mean_per_dof: f64,
    /// The last fix's normalised innovations: position n, e, d, velocity n, e, d; NaN-free, 0 where absent.
    #[serde(default)]
    pub last_normalised_innovation: [f64; 6],
}

/// What one side of the vehicle has brought in the ground session.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GroundSide {
    /// In words: `level`, `nose up`.
    pub side: String,
    /// For how long it was held, s …
    pub held_s: f64,
    /// … and for how long it must be, by the noise of the gyros, s.
    pub wanted_s: f64,
    /// Whether that is enough.
    pub done: bool,
    /// Whether the vehicle cannot stand so.
    pub skipped: bool,
    /// The largest sigma of an element of G before and after, where a filter ran.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub g_sigma_deg_per_h_per_g: Option<[f64; 2]>,
}

/// The ground session.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GroundStatus {
    /// Whether its instructions are given.
    pub active: bool,
    /// Whether nothing is left to do.
    pub done: bool,
    /// Why there can be no session: armed, flying; empty where there can.
    pub refused: String,
    /// What to do now, one sentence.
    pub instruction: String,
    /// Seconds that the vehicle is to be held still, by the noise of its mean rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds_left: Option<f64>,
    /// Since the first look, s.
    pub duration_s: f64,
    /// Holds that ended too early; they count as far as they went.
    pub interruptions: u32,
    /// The six sides.
    pub sides: Vec<GroundSide>,
    /// How far it was turned about its axes in all.
    pub turned_deg: [f64; 3],
    /// What turns about roll, pitch and yaw show of the gyros: sigma (RMS) of scale factors and axes as a share of 300 ppm and 0.5 mrad. Beyond 1, turns are asked for.
    #[serde(default)]
    pub turn_sigma: [f64; 3],
    /// How far the vehicle turned on its support during the hold in which it did most, mrad; zero on a firm one. What turns show of the gyros is worth less then.
    #[serde(default)]
    pub turned_on_support_mrad: f64,
    /// Whether no fix aids the filter.
    pub without_fixes: bool,
    /// Whether place and heading are known; otherwise the Earth's rate counts as an unknown of 15 deg/h.
    pub reference_known: bool,
}

/// The state of the estimator at one instant.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Snapshot {
    /// `gaware.snapshot/1`.
    pub schema: String,
    /// Counts snapshots from 1; a reader that finds numbers missing has missed so many.
    #[serde(default)]
    pub sequence: u64,
    /// Time on the autopilot's base, s.
    pub t_s: f64,
    /// Seconds since the first sample.
    pub elapsed_s: f64,
    /// `ardupilot`, `px4` or `unknown`.
    pub autopilot: String,
    /// `fixed_wing`, `multirotor` or `unknown`.
    #[serde(default)]
    pub vehicle_type: String,
    /// What the estimator is doing.
    pub phase: Phase,
    /// Whether the vehicle is recognised as stationary: position, velocity and heading are held.
    #[serde(default)]
    pub stationary: bool,
    /// What may be said now: the first place of every screen.
    #[serde(default)]
    pub situation: Situation,
    /// Why it does not learn, in words: no fix, no heading, stationary; empty while it does.
    pub waiting_for: String,
    /// Inertial source.
    pub imu: ImuStatus,
    /// Fixes.
    pub gnss: GnssStatus,
    /// Estimates.
    pub estimate: Estimate,
    /// What G means for the pilot.
    #[serde(default)]
    pub turn: TurnError,
    /// Where the vehicle is.
    pub motion: Motion,
    /// The three views.
    pub observability: Observability,
    /// What to fly.
    pub guidance: Guidance,
    /// The ground session: what to do by hand before the flight.
    #[serde(default)]
    pub ground: GroundStatus,
    /// The autopilot's own mission; a live run alone knows of it.
    #[serde(default)]
    pub mission: MissionProgress,
    /// Filter health.
    pub consistency: Consistency,
    /// What the user should know, newest last.
    pub warnings: Vec<String>,
    /// What has just happened and is no cause for worry, newest last.
    #[serde(default)]
    pub news: Vec<String>,
}

/// The result of a run or a replay (`gaware.summary/1`).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// `gaware.summary/1`.
    pub schema: String,
    /// Seconds from first to last sample.
    pub duration_s: f64,
    /// `ardupilot`, `px4` or `unknown`.
    pub autopilot: String,
    /// `fixed_wing`, `multirotor` or `unknown`.
    #[serde(default)]
    pub vehicle_type: String,
    /// Inertial source.
    pub imu: ImuStatus,
    /// Fixes.
    pub gnss: GnssStatus,
    /// Estimates at the end.
    pub estimate: Estimate,
    /// What G means for the pilot.
    #[serde(default)]
    pub turn: TurnError,
    /// The three views at the end.
    pub observability: Observability,
    /// Filter consistency over the run.
    pub consistency: Consistency,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Phase at the end.
    #[serde(default)]
    pub phase: Phase,
    /// Why it does not estimate, in words.
    #[serde(default)]
    pub waiting_for: String,
    /// States whose estimates left what the model expects of them by far: the model lacks an effect, which they
    /// absorb.
    #[serde(default)]
    pub implausible: Vec<String>,
}
