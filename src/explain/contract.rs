//! The `gaware.explanation/1` contract (design, section 3).

use super::size::Size;
use super::{FlightResiduals, advice, consequence, words};
use gaware_nav::effects::Shape;
use gaware_nav::identify::judge::{Gap as NavResidual, Judged};
use gaware_nav::identify::limits::NotFound as NavNotFound;
use gaware_nav::identify::noise::NoiseEntry;
use gaware_nav::identify::select::Added;
use gaware_nav::identify::{survey, terms, whereabouts};
use gaware_nav::model::{EffectSetting, Model};
use gaware_nav::smoother::residual::{self as map, Point};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects were found and each stands alone.
    Explained,
    /// At least one step names effects that this flight cannot separate.
    Ambiguous,
    /// The model explains the flight.
    NothingMissing,
    /// A residual is left that no named effect explains, or too little can be said.
    Unexplained,
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
    pub channel: &'static str,
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

/// Effects that were tested and are not significant, and whether each is likely all the same.
pub fn not_found(all: &[NavNotFound], likely: &[bool]) -> Vec<NotFound> {
    let entry = |(found, likely): (&NavNotFound, &bool)| {
        let (s, mut map) = (&found.setting, Map::new());
        keys(s, &s.values, "value", &mut map);
        keys(s, &s.sigmas, "sigma", &mut map);
        NotFound {
            name: s.effect.name(),
            log_odds: found.evidence,
            likely: *likely,
            reason: found.reason,
            parameters: Value::Object(map),
        }
    };
    all.iter().zip(likely).map(entry).collect()
}

/// The contract.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
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
    /// Terms outside the catalogue.
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
    /// What the autopilot itself can correct, by which parameter.
    pub autopilot: Option<crate::advice::Advice>,
    /// The result in plain words.
    pub summary: String,
}

/// The result of recordings that say too little.
pub fn too_little(why: &str) -> Explanation {
    Explanation {
        schema: "gaware.explanation/1",
        verdict: Verdict::Unexplained,
        effects: Vec::new(),
        places: Vec::new(),
        regimes: Vec::new(),
        residual: None,
        unexplained_terms: Vec::new(),
        leave_one_out: Vec::new(),
        negligible: Vec::new(),
        removed: Vec::new(),
        not_found: Vec::new(),
        assumed: Vec::new(),
        noise: Vec::new(),
        autopilot: None,
        summary: format!("Too little data to identify unmodelled effects: {why}."),
    }
}

/// The model that was given with the effects found and the noise that was fitted. An effect of a group that cannot be separated
/// apart goes in with the best of its names.
pub fn new_model(judged: &Judged, sizes: &[Size]) -> Model {
    let selection = &judged.selection;
    let mut model = selection.noise.of(&selection.base);
    for (added, _) in selection.added.iter().zip(sizes).filter(|(_, size)| !size.negligible) {
        model.set(added.setting.clone().for_filters());
    }
    super::without_receiver(model)
}

/// Values or sigmas of an effect under the keys of `model.toml`.
fn keys(setting: &EffectSetting, values: &[f64], prefix: &str, out: &mut Map<String, Value>) {
    let mut at = 0;
    for group in setting.effect.groups() {
        let own = &values[at..at + group.shape.len()];
        at += group.shape.len();
        let v: Vec<f64> = own.iter().map(|v| v / group.unit.si).collect();
        let value = match group.shape {
            Shape::Scalar => json!(v[0]),
            Shape::Vector | Shape::UpperTriangle => json!(v),
            Shape::Matrix => json!([v[0..3], v[3..6], v[6..9]]),
            Shape::MatrixWithoutDiagonal => json!([[0.0, v[0], v[1]], [v[2], 0.0, v[3]], [v[4], v[5], 0.0]]),
        };
        out.insert(format!("{prefix}_{}", group.unit.suffix), value);
    }
}

/// Parameters of an added effect as in `model.toml`.
pub fn parameters(added: &Added) -> Value {
    let mut map = Map::new();
    keys(&added.setting, &added.setting.values, "value", &mut map);
    keys(&added.setting, &added.setting.sigmas, "sigma", &mut map);
    let informed = survey::informed(added);
    if added.setting.estimated() > 0 {
        map.insert("informed".to_owned(), json!(informed.contains(&true)));
    }
    let names = added.setting.parameters().map(|p| p.0);
    let prior_only: Vec<&str> =
        names.zip(&informed).filter(|(_, informed)| !**informed).map(|p| p.0).collect();
    if !prior_only.is_empty() {
        map.insert("prior_only".to_owned(), json!(prior_only));
    }
    Value::Object(map)
}

/// The effects that are worth a name, with the values behind them.
fn entries<'a>(
    judged: &'a Judged,
    sizes: &[Size],
    events: &[Option<usize>],
    fixed_wing: bool,
    speed_m_per_s: f64,
) -> Vec<(EffectEntry, &'a Added)> {
    let selection = &judged.selection;
    let worth = sizes.iter().zip(events);
    let steps = selection.steps.iter().zip(&selection.added).zip(worth).filter(|(_, w)| !w.0.negligible);
    steps
        .map(|((step, added), (_, log))| {
            let entry = EffectEntry {
                names: step.group.clone(),
                log: *log,
                parameters: BTreeMap::from([(added.setting.effect.name(), parameters(added))]),
                evidence: Evidence {
                    log_likelihood_gain: step.log_likelihood_gain,
                    bic_gain: step.bic_gain,
                    log_odds: step.evidence,
                },
                separate_by: advice::separate(&step.group, fixed_wing),
                consequence: consequence::of(&added.setting, speed_m_per_s),
                cause: added.setting.effect.cause(),
                remedy: added.setting.effect.remedy(),
            };
            (entry, added)
        })
        .collect()
}

/// A vehicle that is faster than this for half of its flight is taken for an aircraft, m/s.
const AIRCRAFT_M_PER_S: f64 = 9.0;

/// Speed that half of the flight is faster than, m/s.
fn typical_speed(residuals: &[FlightResiduals]) -> f64 {
    let mut speeds: Vec<f64> = residuals.iter().flat_map(|g| &g.after).map(|p| p.motion.speed).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() / 2).copied().unwrap_or(0.0)
}

/// What the model assumes and no other list holds.
fn assumed(judged: &Judged) -> Vec<Assumed> {
    let elsewhere = |a: &&Added| !judged.removed.contains(&a.setting.effect.name());
    let entry = |a: &Added| Assumed { name: a.setting.effect.name(), parameters: parameters(a) };
    judged.survey.assumed.iter().filter(elsewhere).map(entry).collect()
}

fn negligible(judged: &Judged, sizes: &[Size]) -> Vec<Negligible> {
    let small = judged.selection.added.iter().zip(sizes).filter(|(_, size)| size.negligible);
    small
        .map(|(added, size)| Negligible {
            name: added.setting.effect.name(),
            parameters: parameters(added),
            gyro_rad_per_s: size.gyro,
            accel_m_per_s2: size.accel,
            position_m: size.position,
        })
        .collect()
}

fn places(residuals: &[FlightResiduals]) -> Vec<Where> {
    let mut out: Vec<Where> = Vec::new();
    for (log, flight) in residuals.iter().enumerate() {
        out.extend(map::places(&flight.before).into_iter().map(|p| Where {
            log,
            channel: map::CHANNELS[p.channel],
            t_start_s: p.start_s,
            t_end_s: p.end_s,
            regime: p.regime,
            share: p.share / residuals.len() as f64,
        }));
    }
    out.sort_by(|a, b| b.share.total_cmp(&a.share));
    out
}

fn regimes(residuals: &[FlightResiduals]) -> Vec<Regime> {
    let all = |of: fn(&FlightResiduals) -> &Vec<Point>| -> Vec<Point> {
        residuals.iter().flat_map(of).cloned().collect()
    };
    let (before, after) = (map::cells(&all(|g| &g.before)), map::cells(&all(|g| &g.after)));
    // Speeds are those of each model's own trajectory, so that a limit may differ in its last digit.
    before
        .into_iter()
        .zip(after)
        .filter(|(a, b)| a.channel == b.channel && a.quantity == b.quantity)
        .map(|(a, b)| Regime {
            channel: map::CHANNELS[a.channel],
            quantity: a.quantity,
            regime: a.regime,
            share: a.share,
            nis: BeforeAfter { before: a.mean_square, after: b.mean_square },
            rms: BeforeAfter { before: a.rms, after: b.rms },
        })
        .collect()
}

fn residual(judged: &Judged) -> ModelResidual {
    let pair = |g: &[NavResidual; 2]| BeforeAfter { before: g[0].nis_per_dof, after: g[1].nis_per_dof };
    let [before, after] = &judged.held_out;
    let channels = whereabouts::CHANNELS.iter().enumerate().filter_map(|(c, channel)| {
        Some(ChannelResidual {
            channel,
            rms: BeforeAfter { before: before.rms[c]?, after: after.rms[c]? },
            nis: BeforeAfter { before: before.channels[c]?, after: after.channels[c]? },
        })
    });
    let drift = gaware_nav::identify::judge::DRIFT_S.iter().enumerate().filter_map(|(k, seconds)| {
        let both = BeforeAfter { before: before.drift_m[k]?, after: after.drift_m[k]? };
        Some((format!("{seconds:.0}_s"), both))
    });
    ModelResidual {
        metric: "nis_mean_per_dof",
        fit: pair(&judged.fit),
        held_out: pair(&judged.held_out),
        held_out_channels: channels.collect(),
        drift_m: drift.collect(),
    }
}

/// What it all comes to. Noise that is not plausible has a cause; an effect that had to grow beyond what it can be explains nothing, nor do effects that leave the
/// residual on held-out data as it was.
fn verdict(
    effects: &[EffectEntry],
    added: &[&Added],
    residual: &ModelResidual,
    terms: &[terms::Found],
    noise: &[NoiseEntry],
) -> Verdict {
    let shrinks = residual.held_out.after < residual.held_out.before;
    if effects.iter().any(|e| e.names.len() > 1) {
        Verdict::Ambiguous
    } else if !terms.is_empty() || added.iter().any(|a| a.is_at_limit()) || noise.iter().any(|n| !n.plausible)
    {
        Verdict::Unexplained
    } else if effects.is_empty() {
        Verdict::NothingMissing
    } else if shrinks {
        Verdict::Explained
    } else {
        Verdict::Unexplained
    }
}

/// The contract of a judged selection.
pub fn explanation(
    judged: &Judged,
    sizes: &[Size],
    residuals: &[FlightResiduals],
    found: Vec<terms::Found>,
    not_found: Vec<NotFound>,
    events: &[Option<usize>],
) -> Explanation {
    let speed = typical_speed(residuals);
    let (effects, added): (Vec<_>, Vec<_>) =
        entries(judged, sizes, events, speed > AIRCRAFT_M_PER_S, speed).into_iter().unzip();
    let (residual, noise) = (residual(judged), judged.noise.clone());
    let mut explanation = Explanation {
        schema: "gaware.explanation/1",
        verdict: verdict(&effects, &added, &residual, &found, &noise),
        effects,
        places: places(residuals),
        regimes: regimes(residuals),
        residual: Some(residual),
        negligible: negligible(judged, sizes),
        unexplained_terms: found
            .into_iter()
            .map(|t| Term {
                channel: t.channel,
                term: t.term,
                coefficient: t.coefficient,
                sigma: t.sigma,
                unit: t.unit,
            })
            .collect(),
        leave_one_out: judged
            .left_out
            .iter()
            .map(|l| LeaveOneOut { name: l.name, evidence: l.evidence, held_out_log_likelihood: l.held_out })
            .collect(),
        removed: judged.removed.clone(),
        not_found,
        assumed: assumed(judged),
        noise,
        autopilot: None,
        summary: String::new(),
    };
    explanation.summary = words::summary(&explanation, &added);
    explanation
}
