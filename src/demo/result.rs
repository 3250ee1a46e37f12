//! What a flight of the demonstration found out, beside the ground truth and what the plan had promised.

use super::flight::{Ending, Flight, Stage};
use super::series::Series;
use crate::engine::estimate::Constants;
use crate::engine::snapshot::{Estimate, Status, Summary};
use gaware_mission::planner::{PlannedState, Reach};
use gaware_mission::transfer::verified::Outcome;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::{Layout, index};
use gaware_nav::model::Model;
use gaware_nav::rotation::wrap_180;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// One constant state at the end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StateResult {
    /// Name.
    pub name: String,
    /// Unit of all figures.
    pub unit: String,
    /// Injected truth.
    pub truth: f64,
    /// Estimate.
    pub estimate: f64,
    /// 1-sigma of the estimate.
    pub sigma: f64,
    /// Error over sigma.
    pub normalised_error: f64,
    /// 1-sigma that the plan promised for its end.
    pub planned_sigma: f64,
    /// 1-sigma there: a multirotor then returns and lands, and learns more.
    pub sigma_at_plan_end: f64,
    /// That one over the planned one.
    pub reached_over_planned: f64,
    /// Whether the plan promised that it converges.
    pub promised: bool,
    /// How well known.
    pub status: Status,
}

/// What the plan promised, and whether it was kept.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Promise {
    /// States that the plan makes known.
    pub promised: Vec<String>,
    /// Of these the ones that did not become observable.
    pub missed: Vec<String>,
    /// States that the airframe excites too weakly for their target in the time there is.
    pub too_weak: Vec<String>,
    /// States that no maneuver of the autopilot excites.
    pub dark: Vec<String>,
    /// States that became observable although the plan did not promise them.
    pub beyond_promise: Vec<String>,
}

/// Everything at the end of a flight.
#[derive(Debug, Clone)]
pub struct DemoResult {
    /// How it ended.
    pub ending: Ending,
    /// What the companion knows.
    pub summary: Summary,
    /// Per constant state.
    pub states: Vec<StateResult>,
    /// True roll, pitch, yaw at the end, deg.
    pub attitude_deg: [f64; 3],
    /// What was promised and kept.
    pub promise: Promise,
    /// From the take-off's end to the last maneuver's, s: what the plan took.
    pub plan_flown_s: f64,
    /// Predicted and reached sigmas over time.
    pub series: Series,
    /// The document.
    pub document: Map<String, Value>,
}

/// What a flight that is over (or was broken off) has to show.
pub fn of(flight: &mut Flight, seed: u64) -> DemoResult {
    let ending = match flight.stage() {
        Stage::Over(ending) => ending.clone(),
        _ => Ending::Stopped,
    };
    let attitude_deg = flight.true_attitude_deg();
    let summary = flight.pipeline().summary();
    let states = states(flight, &summary);
    let mut document = flight.pipeline().document();
    document.insert("truth".to_owned(), truth(flight.truth(), attitude_deg));
    document.insert("plan".to_owned(), plan(flight));
    let uploaded = matches!(flight.outcome(), Some(Outcome::Verified { .. }));
    let items = flight.prepared().plan.mission.items.len();
    document.insert("mission".to_owned(), json!({"uploaded": uploaded, "items": items}));
    document.insert("seed".to_owned(), json!(seed));
    document.insert("airframe".to_owned(), json!(flight.prepared().settings.airframe.name));
    document.insert("ending".to_owned(), json!(ending.word()));
    let observable: Vec<&str> =
        states.iter().filter(|s| s.status == Status::Observable).map(|s| s.name.as_str()).collect();
    document.insert("observable".to_owned(), json!(observable));
    document.insert("states".to_owned(), json!(states));
    let promise = promise(flight, &states);
    document.insert("promise".to_owned(), json!(promise));
    document.insert("planned_states".to_owned(), json!(flight.prepared().plan.states));
    document.insert("maneuvers".to_owned(), maneuvers(flight));
    let series = Series::of(flight.prepared(), flight.log());
    document.insert("sigma_series".to_owned(), json!(series));
    let plan_flown_s = plan_flown_s(flight);
    document.insert("plan_flown_s".to_owned(), json!(plan_flown_s));
    DemoResult { ending, summary, states, attitude_deg, promise, plan_flown_s, series, document }
}

/// The plan counts from the end of the climb to the arrival at its end; the flight likewise, from the first item to the last.
fn plan_flown_s(flight: &Flight) -> f64 {
    let items = &flight.log().items;
    let climbed = items.first().map_or(0.0, |(_, t)| *t);
    let planned_end = flight.prepared().plan.maneuvers.last().map_or(0.0, |m| m.end_s);
    let flown = flight.milestones().last().map_or(climbed, |m| m.t_s) - climbed;
    // What follows the last maneuver is flown as planned.
    flown + (flight.prepared().plan.duration_s - planned_end)
}

fn promise(flight: &Flight, states: &[StateResult]) -> Promise {
    let plan = &flight.prepared().plan;
    let observable = |name: &str| states.iter().any(|s| s.name == name && s.status == Status::Observable);
    let of = |wanted: &dyn Fn(&PlannedState) -> bool| {
        plan.states.iter().filter(|s| wanted(s)).map(|s| s.name.clone()).collect::<Vec<_>>()
    };
    Promise {
        promised: of(&PlannedState::known),
        missed: of(&|s| s.known() && !observable(&s.name)),
        too_weak: of(&|s| s.reach == Reach::Short && !s.known()),
        dark: of(&|s| s.reach == Reach::Unobservable),
        beyond_promise: of(&|s| !s.known() && observable(&s.name)),
    }
}

impl Ending {
    /// For people.
    pub fn sentence(&self) -> String {
        match self {
            Self::Holding => "the mission was flown to the hold at its end".to_owned(),
            Self::Landed => "the mission was flown, and the vehicle has landed".to_owned(),
            Self::NotUploaded(why) => format!("nothing was flown: {why}"),
            Self::OutOfTime => "the flight did not come to its end in time".to_owned(),
            Self::Stopped => "the demonstration was ended in the middle of the flight".to_owned(),
        }
    }

    /// For documents.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Holding => "holding",
            Self::Landed => "landed",
            Self::NotUploaded(_) => "not_uploaded",
            Self::OutOfTime => "out_of_time",
            Self::Stopped => "stopped",
        }
    }
}

fn states(flight: &Flight, summary: &Summary) -> Vec<StateResult> {
    let Some(filter) = flight.pipeline().engine().filter() else { return Vec::new() };
    let truth = (Layout::new(flight.truth()), Calibration::new(flight.truth()));
    let planned = &flight.prepared().prediction.sigmas;
    let known = &summary.observability.states;
    let at_end = &flight.log().at_end;
    let promised: Vec<&str> = flight.prepared().plan.promised().map(|s| s.name.as_str()).collect();
    let names = filter.layout().names().iter().enumerate();
    names
        .filter_map(|(k, name)| {
            let state = index::GYRO_BIAS + k;
            let true_value = truth.1.get(&truth.0, truth.0.find(name.name)?) / name.unit.si;
            let estimate = filter.calibration().get(filter.layout(), state) / name.unit.si;
            let sigma = filter.covariance().sigma(state) / name.unit.si;
            let planned_sigma = planned.iter().find(|p| p.name == name.name)?.sigma;
            let sigma_at_plan_end = at_end.iter().find(|(n, _)| n == name.name).map_or(sigma, |(_, s)| *s);
            Some(StateResult {
                name: name.name.to_owned(),
                unit: name.unit.symbol.to_owned(),
                truth: true_value,
                estimate,
                sigma,
                normalised_error: (estimate - true_value) / sigma,
                planned_sigma,
                sigma_at_plan_end,
                reached_over_planned: sigma_at_plan_end / planned_sigma,
                promised: promised.contains(&name.name),
                status: known.iter().find(|s| s.name == name.name)?.status,
            })
        })
        .collect()
}

/// The shape of `estimate` with values only.
fn truth(model: &Model, attitude_deg: [f64; 3]) -> Value {
    let mut estimate = Constants::of_model(model).estimate(model);
    estimate.attitude_deg.value = attitude_deg;
    without(estimate, "sigma")
}

/// The shape of `estimate` with sigmas only.
fn plan(flight: &Flight) -> Value {
    let belief = &flight.prepared().settings.belief;
    let prediction = &flight.prepared().prediction;
    let mut constants = Constants::of_model(belief);
    for (name, sigma) in constants.layout.names().iter().zip(&mut constants.sigma) {
        if let Some(planned) = prediction.sigmas.iter().find(|p| p.name == name.name) {
            *sigma = planned.sigma * name.unit.si;
        }
    }
    let mut estimate = constants.estimate(belief);
    estimate.attitude_deg.sigma = prediction.attitude_sigma_deg;
    without(estimate, "value")
}

fn without(estimate: Estimate, field: &str) -> Value {
    let mut value = json!(estimate);
    if let Value::Object(groups) = &mut value {
        for group in groups.values_mut() {
            let entries: Vec<&mut Value> = match group {
                Value::Array(list) => list.iter_mut().collect(),
                one => vec![one],
            };
            for entry in entries {
                if let Value::Object(fields) = entry {
                    fields.remove(field);
                }
            }
        }
    }
    value
}

/// Per maneuver when it was flown, and predicted beside reached sigmas at its end.
fn maneuvers(flight: &Flight) -> Value {
    let plan = &flight.prepared().plan;
    let rows = flight.milestones().iter().filter_map(|m| {
        let planned = plan.maneuvers.get(m.maneuver)?;
        let at_end = plan
            .sigmas
            .iter()
            .min_by(|a, b| (a.t_s - planned.end_s).abs().total_cmp(&(b.t_s - planned.end_s).abs()))?;
        let predicted: Map<String, Value> =
            at_end.sigmas.iter().map(|s| (s.name.to_string(), json!(s.sigma))).collect();
        let reached: Map<String, Value> = m.sigmas.iter().map(|(n, s)| (n.clone(), json!(s))).collect();
        let ratio = |(name, sigma): &(String, f64)| {
            let planned = at_end.sigmas.iter().find(|s| s.name == *name)?;
            Some((name.clone(), json!(sigma / planned.sigma)))
        };
        let ratios: Map<String, Value> = m.sigmas.iter().filter_map(ratio).collect();
        Some(json!({"maneuver": planned.maneuver, "planned_end_s": planned.end_s, "flown_end_s": m.t_s,
            "predicted_sigma": predicted, "reached_sigma": reached, "reached_over_predicted": ratios}))
    });
    Value::Array(rows.collect())
}

impl Promise {
    /// For people.
    pub fn lines(&self) -> Vec<String> {
        let kept = if self.missed.is_empty() {
            format!("all {} states that the plan promised became observable", self.promised.len())
        } else {
            format!(
                "{} of {} states that the plan promised did not become observable: {}",
                self.missed.len(),
                self.promised.len(),
                self.missed.join(", ")
            )
        };
        let others = [
            ("no maneuver of the autopilot excites", &self.dark),
            ("excited, but too weakly for the target in the time there is", &self.too_weak),
            ("observable beyond the plan's promise", &self.beyond_promise),
        ];
        let others = others.into_iter().filter(|(_, names)| !names.is_empty());
        std::iter::once(kept)
            .chain(others.map(|(words, names)| format!("{words}: {}", names.join(", "))))
            .collect()
    }
}

impl DemoResult {
    /// For people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "{:.0} s: {}", self.summary.duration_s, self.ending.sentence())?;
        let found = &self.summary.estimate.attitude_deg;
        for (k, axis) in ["roll", "pitch", "yaw"].into_iter().enumerate() {
            let error = wrap_180(found.value[k] - self.attitude_deg[k]);
            writeln!(out, "{axis:>10} error {error:8.2} deg, sigma {:.2}", found.sigma[k])?;
        }
        writeln!(
            out,
            "  {:<7}{:>11}{:>11}{:>10}{:>7}{:>10}{:>9} unit",
            "", "truth", "estimate", "sigma", "error", "planned", "reached"
        )?;
        for s in &self.states {
            writeln!(
                out,
                "{} {:<7}{:11.3}{:11.3}{:10.3}{:7.2}{:10.3}{:8.2}× {}",
                if s.status == Status::Observable { "●" } else { " " },
                s.name,
                s.truth,
                s.estimate,
                s.sigma,
                s.normalised_error,
                s.planned_sigma,
                s.reached_over_planned,
                s.unit
            )?;
        }
        writeln!(
            out,
            "● observable; error in sigmas; planned: sigma of the plan; reached: sigma over the planned one"
        )?;
        for line in self.promise.lines() {
            writeln!(out, "{line}")?;
        }
        for direction in &self.summary.observability.unobservable_directions {
            writeln!(out, "not observable: {}", direction.text)?;
        }
        Ok(())
    }
}
