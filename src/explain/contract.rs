//! The `gaware.explanation/1` contract (design, section 3): its types. `assembly` fills them.

use gaware_nav::identify::noise::NoiseEntry;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects were found and each stands alone.
    Explained,
    /// At least one step names effects that this flight cannot separate.
    Ambiguous,
    /// The model explains the flight.
    NothingMissing,
    /// A residual is left that no named effect explains.
    Unexplained,
    /// Too short, without fixes, without motion: the recordings do not answer the question.
    #[default]
    TooLittleData,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Explained => "explained",
            Self::Ambiguous => "ambiguous",
            Self::NothingMissing => "nothing missing",
            Self::Unexplained => "unexplained",
            Self::TooLittleData => "too little data",
        }
    }
}

/// Evidence of one step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Evidence {
    /// Gain of the log-likelihood of the innovations.
    pub log_likelihood_gain: f64,
    /// The same less half the number of parameters times the logarithm of the number of fixes.
    pub bic_gain: f64,
    /// Logarithm of the odds that the effect is there against that it is not: what decided.
    pub log_odds: f64,
}

/// One step: an effect, or several that this flight cannot separate.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct EffectEntry {
    /// Names, the best first.
    pub names: Vec<&'static str>,
    /// Number of the log that an event belongs to, from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log: Option<usize>,
    /// Values and sigmas with units in the keys, by effect.
    pub parameters: BTreeMap<&'static str, Value>,
    /// How sure.
    pub evidence: Evidence,
    /// Maneuver that would separate them.
    pub separate_by: Option<String>,
    /// What it does to the vehicle's navigation, in numbers.
    pub consequence: Option<String>,
    /// What usually causes the best of the names.
    pub cause: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
}

/// An effect that the model assumes.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Assumed {
    /// Which.
    pub name: &'static str,
    /// Values and sigmas with units in the keys: those of the model, learned where it leaves them open.
    pub parameters: Value,
}

/// An effect that the data show and that is too small to be separated from what simulation and model leave out.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Negligible {
    /// Which.
    pub name: &'static str,
    /// Values and sigmas with units in the keys.
    pub parameters: Value,
    /// RMS of what it adds to the gyros about the mean, rad/s.
    pub gyro_rad_per_s: f64,
    /// RMS of what it adds to the accelerometers about the mean, m/s².
    pub accel_m_per_s2: f64,
    /// RMS of what it adds to the position of fixes, m.
    pub position_m: f64,
}

/// The disagreement of one channel in one regime, on the smoothed trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Regime {
    /// `gyro_y`.
    pub channel: &'static str,
    /// What the regime is a range of.
    pub quantity: &'static str,
    /// `specific force z above 1.5 g`.
    pub regime: String,
    /// Share of the flights.
    pub share: f64,
    /// Mean squared normalised residual.
    pub nis: BeforeAfter,
    /// RMS residual, rad/s, m/s², m, m/s.
    pub rms: BeforeAfter,
}

/// A place that stands out.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Where {
    /// Number of the log, from 0.
    pub log: usize,
    /// `velocity_north`, `gyro_y`, …
    pub channel: &'static str,
    /// From, s.
    pub t_start_s: f64,
    /// To, s.
    pub t_end_s: f64,
    /// What the vehicle did.
    pub regime: String,
    /// Share of the excess of all residuals.
    pub share: f64,
}

/// Before and after.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, JsonSchema)]
pub struct BeforeAfter {
    /// With the model that was given.
    pub before: f64,
    /// With the new one.
    pub after: f64,
}

/// Before and after per channel, RMS of the innovations.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ChannelResidual {
    /// `velocity_north`.
    pub channel: &'static str,
    /// m or m/s.
    pub rms: BeforeAfter,
    /// Normalised innovation squared (NIS) per degree of freedom.
    pub nis: BeforeAfter,
}

/// The model residual, by its measure.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ModelResidual {
    /// `nis_mean_per_dof`.
    pub metric: &'static str,
    /// On the data that chose and fitted.
    pub fit: BeforeAfter,
    /// On held-out data.
    pub held_out: BeforeAfter,
    /// Held out, by channel.
    pub held_out_channels: Vec<ChannelResidual>,
    /// Held out: horizontal position after so many seconds without fixes, m RMS.
    pub drift_m: BTreeMap<String, BeforeAfter>,
}

/// One line of the leave-one-out table.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct LeaveOneOut {
    /// Effect left out.
    pub name: &'static str,
    /// Evidence lost, nats.
    pub evidence: f64,
    /// Log-likelihood of the held-out data lost.
    pub held_out_log_likelihood: f64,
}

/// A term outside the catalogue.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Term {
    /// `gyro_y`.
    pub channel: String,
    /// `f_x*f_z`.
    pub term: &'static str,
    /// Value.
    pub coefficient: f64,
    /// 1-sigma.
    pub sigma: f64,
    /// Unit of both.
    pub unit: String,
}

/// An effect that was tested and is not significant.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct NotFound {
    /// Which.
    pub name: &'static str,
    /// Logarithm of the odds that it is there.
    pub log_odds: f64,
    /// Whether the odds speak for it all the same: the search ends after a few effects, and held-out data may have spoken
    /// against it.
    pub likely: bool,
    /// Why there is no better limit, where there is a reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<&'static str>,
    /// Values that suit the flights best with the sigmas that the flights alone leave them, units in the keys.
    pub parameters: Value,
}

/// Name of the contract.
pub const SCHEMA: &str = "gaware.explanation/1";

/// The contract.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct Explanation {
    /// `gaware.explanation/1`.
    pub schema: &'static str,
    /// What came of it.
    pub verdict: Verdict,
    /// One entry per step, in the order found.
    pub effects: Vec<EffectEntry>,
    /// Places that stand out with the model that was given.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
    /// The same over regimes, for every channel.
    pub regimes: Vec<Regime>,
    /// Before and after; `null` where too little can be said.
    #[serde(rename = "gap")]
    pub residual: Option<ModelResidual>,
    /// Where the search ended because it had enough effects: formulas that would come next, axis by axis.
    pub unexplained_terms: Vec<Term>,
    /// What each effect contributes.
    pub leave_one_out: Vec<LeaveOneOut>,
    /// Effects that are there but too small to matter.
    pub negligible: Vec<Negligible>,
    /// Effects that were found and that the held-out data did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects of the catalogue that were tested and are not significant, and how small one must be to stay unseen.
    pub not_found: Vec<NotFound>,
    /// Effects that the model assumes, and that the flights are consistent with.
    pub assumed: Vec<Assumed>,
    /// Noise, as claimed and as the flights have it.
    #[schemars(with = "Vec<super::schema::NoiseFigure>")]
    pub noise: Vec<NoiseEntry>,
    /// The compasses of the first flight, against its motion; absent where it holds none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compasses: Option<crate::compass::CompassReport>,
    /// Its barometers, airspeed sensors and wind; absent where it holds none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub air: Option<crate::air::AirReport>,
    /// What the autopilot itself can correct, by which parameter.
    pub autopilot: Option<crate::advice::Advice>,
    /// The result in plain words.
    pub summary: String,
}

/// The result of recordings that say too little.
pub fn too_little(why: &str) -> Explanation {
    Explanation {
        schema: SCHEMA,
        summary: format!("Too little data to identify unmodelled effects: {why}."),
        ..Explanation::default()
    }
}
