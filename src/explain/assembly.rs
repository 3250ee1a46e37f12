//! A judged selection put together as the `gaware.explanation/1` contract.

use super::contract::{
    Assumed, BeforeAfter, ChannelResidual, EffectEntry, Evidence, Explanation, LeaveOneOut, ModelResidual,
    Negligible, NotFound, Regime, SCHEMA, Term, Verdict, Where,
};
use super::{FlightResiduals, advice, consequence, words};
use gaware_nav::effects::{Shape, data};
use gaware_nav::identify::judge::{DRIFT_S, Judged, ResidualMeasure};
use gaware_nav::identify::noise::NoiseEntry;
use gaware_nav::identify::pass::CHANNELS;
use gaware_nav::identify::residual::{self as map, Point};
use gaware_nav::identify::select::Added;
use gaware_nav::identify::size::Size;
use gaware_nav::identify::survey;
use gaware_nav::identify::survey::NotFound as NavNotFound;
use gaware_nav::model::{EffectSetting, Model};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

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
            Shape::Vector | Shape::UpperTriangle | Shape::Symmetric => json!(v),
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
        map.insert("informed".to_owned(), json!(survey::is_informed(added)));
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
    let pair = |g: &[ResidualMeasure; 2]| BeforeAfter { before: g[0].nis_per_dof, after: g[1].nis_per_dof };
    let [before, after] = &judged.held_out;
    let channels = CHANNELS.iter().enumerate().filter_map(|(c, channel)| {
        Some(ChannelResidual {
            channel,
            rms: BeforeAfter { before: before.rms[c]?, after: after.rms[c]? },
            nis: BeforeAfter { before: before.channels[c]?, after: after.channels[c]? },
        })
    });
    let drift = DRIFT_S.iter().enumerate().filter_map(|(k, seconds)| {
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
/// residual on held-out data as it was; those that show in the samples themselves need no residual.
fn verdict(
    effects: &[EffectEntry],
    added: &[&Added],
    residual: &ModelResidual,
    left_over: &[EffectSetting],
    noise: &[NoiseEntry],
) -> Verdict {
    let shown = added.iter().all(|a| a.setting.effect.needs_neighbours());
    let shrinks = shown || residual.held_out.after < residual.held_out.before;
    // What no model explains comes first: several candidates for one of its effects do not make the values of the others right.
    if !left_over.is_empty() || added.iter().any(|a| a.is_at_limit()) || noise.iter().any(|n| !n.plausible) {
        Verdict::Unexplained
    } else if effects.iter().any(|e| e.names.len() > 1) {
        Verdict::Ambiguous
    } else if effects.is_empty() {
        Verdict::NothingMissing
    } else if shrinks {
        Verdict::Explained
    } else {
        Verdict::Unexplained
    }
}

/// An axis is listed where its coefficient is so many sigmas, or the greatest of the formula.
const SIGMAS_OF_TERM: f64 = 3.0;

/// A formula that was left over, axis by axis.
fn terms(setting: &EffectSetting) -> Vec<Term> {
    let Some(definition) = data::definition(setting.effect.name()) else { return Vec::new() };
    let Some(driver) = definition.drivers.iter().flatten().next() else { return Vec::new() };
    let values = || setting.values.iter().zip(&setting.sigmas);
    let sigmas = |(value, sigma): (&f64, &f64)| (value / sigma).abs();
    let least = values().map(sigmas).fold(0.0, f64::max).min(SIGMAS_OF_TERM);
    let axes = definition.axes().iter().zip(values()).filter(|(_, v)| sigmas(*v) >= least);
    let term = |(axis, (coefficient, sigma)): (&&str, (&f64, &f64))| Term {
        channel: format!("{}_{axis}", definition.target.name()),
        term: driver.text(),
        coefficient: *coefficient,
        sigma: *sigma,
        unit: data::si_unit(definition),
    };
    axes.map(term).collect()
}

/// The contract of a judged selection.
pub fn explanation(
    judged: &Judged,
    sizes: &[Size],
    residuals: &[FlightResiduals],
    left_over: &[EffectSetting],
    not_found: Vec<NotFound>,
    events: &[Option<usize>],
) -> Explanation {
    let speed = typical_speed(residuals);
    let (effects, added): (Vec<_>, Vec<_>) =
        entries(judged, sizes, events, speed > AIRCRAFT_M_PER_S, speed).into_iter().unzip();
    let (residual, noise) = (residual(judged), judged.noise.clone());
    let mut explanation = Explanation {
        schema: SCHEMA,
        verdict: verdict(&effects, &added, &residual, left_over, &noise),
        effects,
        places: places(residuals),
        regimes: regimes(residuals),
        residual: Some(residual),
        negligible: negligible(judged, sizes),
        unexplained_terms: left_over.iter().flat_map(terms).collect(),
        leave_one_out: judged
            .left_out
            .iter()
            .map(|l| LeaveOneOut {
                name: l.name,
                evidence: l.evidence,
                held_out_log_likelihood: l.held_out(),
            })
            .collect(),
        removed: judged.removed.clone(),
        not_found,
        assumed: assumed(judged),
        noise,
        ..Explanation::default()
    };
    explanation.summary = words::summary(&explanation, &added);
    explanation
}
