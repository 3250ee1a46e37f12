//! The tables of a fleet: `flights`, a row for each log, and `effects`, a row for each parameter of each effect of each flight.

use super::find::Named;
use super::flight::{Flight, FlightEntry};
use crate::export::Table;
use crate::export::table::{Cell, Put, Row};
use gaware_nav::effects::{self, ParameterGroup, Shape};
use serde_json::{Map, Value};

/// A log with its result, or the reason why there is none in this run.
#[derive(Debug, Clone)]
pub struct FleetLog {
    /// Path as it was found.
    pub path: String,
    /// What the name says.
    pub named: Named,
    /// What came of it.
    pub result: Result<FlightEntry, String>,
}

impl FleetLog {
    /// The inertial unit: what the name says, or the board that the log names.
    pub fn unit(&self) -> Option<&str> {
        self.named.unit.as_deref().or(self.flight()?.board.as_deref())
    }

    /// The firmware: what the name says, or what the log does.
    pub fn firmware(&self) -> Option<&str> {
        self.named.firmware.as_deref().or(self.flight()?.firmware.as_deref())
    }

    /// The flight, where there is one.
    pub fn flight(&self) -> Option<&Flight> {
        self.result.as_ref().ok()?.flight.as_ref()
    }

    /// Why there is none.
    pub fn failure(&self) -> Option<&str> {
        match &self.result {
            Ok(entry) => entry.failed.as_deref(),
            Err(reason) => Some(reason),
        }
    }
}

/// Both tables, rows in the order of the logs.
pub fn tables(logs: &[FleetLog]) -> [Table; 2] {
    let mut flights = Table::new("flights", "A row for each log of the fleet.");
    let mut effects = Table::new("effects", "A row for each parameter of each effect of each flight.");
    for log in logs {
        flights.push(&[&Heading(log), &Outcome(log)]);
        effect_rows(log, &mut |row| effects.push(&[&Heading(log), row]));
    }
    [flights, effects]
}

/// One row of each table, for the list of columns.
pub fn example() -> [Table; 2] {
    let mut flights = Table::new("flights", "A row for each log of the fleet.");
    let mut effects = Table::new("effects", "A row for each parameter of each effect of each flight.");
    let log = FleetLog { path: String::new(), named: Named::default(), result: Err(String::new()) };
    flights.push(&[&Heading(&log), &Outcome(&log)]);
    effects.push(&[&Heading(&log), &EffectRow::default()]);
    [flights, effects]
}

struct Heading<'a>(&'a FleetLog);

impl Row for Heading<'_> {
    fn visit(&self, put: &mut Put<'_>) {
        let sha256 = self.0.result.as_ref().map_or("", |e| e.sha256.as_str());
        put("log", "Path of the log", Cell::Text(&self.0.path));
        put("sha256", "SHA-256 of its bytes", Cell::Text(sha256));
        put(
            "unit",
            "Inertial unit: by the name rule, otherwise the board that the log names",
            Cell::Text(self.0.unit().unwrap_or("")),
        );
        put(
            "firmware",
            "Firmware: by the name rule, otherwise as the log has it",
            Cell::Text(self.0.firmware().unwrap_or("")),
        );
        put(
            "start_unix_s",
            "Start of the log, s since 1970, where the log has a date",
            Cell::Number(self.0.flight().and_then(|f| f.start_unix_s).unwrap_or(f64::NAN)),
        );
    }
}

/// Texts and figures of a document that columns are made of: column, meaning, place.
type Places<'a> = [(&'a str, &'a str, &'a str)];

const WORDS: &Places<'static> = &[
    ("autopilot", "ardupilot, px4 or unknown", "/autopilot"),
    ("vehicle_type", "fixed_wing, multirotor or unknown", "/vehicle_type"),
    ("imu_message", "Source of the inertial samples", "/imu/message"),
    ("phase", "Phase of the estimator at the end", "/phase"),
];

const FIGURES: &Places<'static> = &[
    ("duration_s", "From first to last sample, s", "/duration_s"),
    ("imu_samples", "Inertial samples", "/imu/samples"),
    ("imu_rate_hz", "Their rate, Hz", "/imu/rate_hz"),
    ("imu_dropped", "Samples that were lost or rejected", "/imu/dropped"),
    ("gnss_used", "Fixes used", "/gnss/used"),
    ("gnss_rejected", "Fixes rejected", "/gnss/rejected"),
    (
        "nis_mean_per_dof",
        "Mean normalised innovation squared per degree of freedom; 1 is right",
        "/consistency/nis_mean_per_dof",
    ),
];

const EXPLAINED: &Places<'static> = &[
    (
        "held_out_nis_before",
        "NIS per degree of freedom of held-out data with the model given",
        "/gap/held_out/before",
    ),
    ("held_out_nis_after", "The same with the identified effects", "/gap/held_out/after"),
];

struct Outcome<'a>(&'a FleetLog);

impl Row for Outcome<'_> {
    fn visit(&self, put: &mut Put<'_>) {
        let log = self.0;
        put(
            "failed",
            "Why the log could not be analysed; empty where it was",
            Cell::Text(log.failure().unwrap_or("")),
        );
        let summary = log.flight().map(|f| Value::Object(f.summary.clone())).unwrap_or_default();
        let nothing = Value::Null;
        let explanation = log.flight().and_then(|f| f.explanation.as_ref()).unwrap_or(&nothing);
        for (name, about, place) in WORDS {
            put(name, about, Cell::Text(text(&summary, place)));
        }
        for (name, about, place) in FIGURES {
            put(name, about, Cell::Number(number(&summary, place)));
        }
        put(
            "verdict",
            "Result of explain; empty where it was not run",
            Cell::Text(text(explanation, "/verdict")),
        );
        for (name, about, place) in EXPLAINED {
            put(name, about, Cell::Number(number(explanation, place)));
        }
        let named = |key: &str| {
            let steps = explanation.get(key).and_then(Value::as_array).into_iter().flatten();
            let best = steps.filter_map(|s| s.pointer("/names/0")?.as_str()).collect::<Vec<_>>();
            best.join(" ")
        };
        put(
            "identified",
            "Effects that explain identified, the best name of each step",
            Cell::Text(&named("effects")),
        );
        for p in log.flight().into_iter().flat_map(|f| &f.parameters) {
            let unit = suffix(&p.unit);
            put(&format!("{}_{unit}", p.name), &format!("{}, {}", p.effect, p.unit), Cell::Number(p.value));
            put(&format!("{}_sigma_{unit}", p.name), "Its 1-sigma", Cell::Number(p.sigma));
        }
    }
}

/// A unit in the name of a column.
fn suffix(unit: &str) -> String {
    let spelled = unit.replace("√h", "rth").replace('²', "2").replace('°', "deg").replace('/', "_per_");
    spelled.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect()
}

fn text<'a>(document: &'a Value, place: &str) -> &'a str {
    document.pointer(place).and_then(Value::as_str).unwrap_or("")
}

fn number(document: &Value, place: &str) -> f64 {
    document.pointer(place).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

#[derive(Debug, Clone)]
struct EffectRow<'a> {
    source: &'static str,
    effect: &'a str,
    parameter: &'a str,
    unit: &'a str,
    value: f64,
    sigma: f64,
    prior_value: f64,
    prior_sigma: f64,
    step: f64,
    alternatives: String,
    log_bayes_factor: f64,
}

impl Default for EffectRow<'_> {
    fn default() -> Self {
        let none = f64::NAN;
        Self {
            source: "estimated",
            effect: "",
            parameter: "",
            unit: "",
            value: none,
            sigma: none,
            prior_value: none,
            prior_sigma: none,
            step: none,
            alternatives: String::new(),
            log_bayes_factor: none,
        }
    }
}

impl Row for EffectRow<'_> {
    fn visit(&self, put: &mut Put<'_>) {
        put(
            "source",
            "estimated: by replay with its model; identified, assumed, negligible, not_found: by explain (not_found: the value that suits best, with the sigma that the flight leaves it)",
            Cell::Text(self.source),
        );
        put("effect", "Effect of the catalogue, or gyro_bias, accel_bias", Cell::Text(self.effect));
        put("parameter", "Parameter of the effect", Cell::Text(self.parameter));
        put("measured_in", "Unit of value, sigma and prior", Cell::Text(self.unit));
        put("value", "Value", Cell::Number(self.value));
        put("sigma", "Its 1-sigma", Cell::Number(self.sigma));
        put("prior_value", "What the model assumed before (estimated only)", Cell::Number(self.prior_value));
        put("prior_sigma", "Its 1-sigma", Cell::Number(self.prior_sigma));
        put("step", "Step of the search that found it, from 1 (identified only)", Cell::Number(self.step));
        put(
            "alternatives",
            "Other effects that this flight cannot separate from it (identified only)",
            Cell::Text(&self.alternatives),
        );
        put(
            "log_bayes_factor",
            "Logarithm of the odds that the effect is there (identified, not_found)",
            Cell::Number(self.log_bayes_factor),
        );
    }
}

fn effect_rows(log: &FleetLog, push: &mut dyn FnMut(&EffectRow<'_>)) {
    let Some(flight) = log.flight() else { return };
    for p in &flight.parameters {
        push(&EffectRow {
            effect: &p.effect,
            parameter: &p.name,
            unit: &p.unit,
            value: p.value,
            sigma: p.sigma,
            prior_value: p.prior_value,
            prior_sigma: p.prior_sigma,
            ..EffectRow::default()
        });
    }
    let Some(explanation) = &flight.explanation else { return };
    for (k, step) in entries(explanation, "effects").enumerate() {
        let names: Vec<&str> = step
            .get("names")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        for name in &names {
            let others: Vec<&str> = names.iter().copied().filter(|n| n != name).collect();
            let row = EffectRow {
                source: "identified",
                effect: name,
                step: (k + 1) as f64,
                alternatives: others.join(" "),
                log_bayes_factor: number(step, "/evidence/log_odds"),
                ..EffectRow::default()
            };
            parameter_rows(&row, step.pointer(&format!("/parameters/{name}")), push);
        }
    }
    for source in ["assumed", "negligible", "not_found"] {
        for entry in entries(explanation, source) {
            let row = EffectRow {
                source,
                effect: text(entry, "/name"),
                log_bayes_factor: number(entry, "/log_odds"),
                ..EffectRow::default()
            };
            parameter_rows(&row, entry.get("parameters"), push);
        }
    }
}

fn entries<'a>(explanation: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    explanation.get(key).and_then(Value::as_array).into_iter().flatten()
}

/// A row for each parameter; an effect without parameters has one row.
fn parameter_rows(row: &EffectRow<'_>, values: Option<&Value>, push: &mut dyn FnMut(&EffectRow<'_>)) {
    let nothing = Map::new();
    let map = values.and_then(Value::as_object).unwrap_or(&nothing);
    let groups = effects::find(row.effect).map_or(&[][..], |e| e.groups());
    if groups.is_empty() {
        push(row);
    }
    for group in groups {
        let of = |prefix: &str| {
            map.get(&format!("{prefix}_{}", group.unit.suffix)).map(|v| flat(group, v)).unwrap_or_default()
        };
        let (values, sigmas) = (of("value"), of("sigma"));
        for (k, name) in group.names.iter().enumerate() {
            let at = |v: &[f64]| v.get(k).copied().unwrap_or(f64::NAN);
            push(&EffectRow {
                parameter: name,
                unit: group.unit.symbol,
                value: at(&values),
                sigma: at(&sigmas),
                ..row.clone()
            });
        }
    }
}

/// The parameters of a group in their order, from the layout of files.
fn flat(group: &ParameterGroup, value: &Value) -> Vec<f64> {
    let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
    let list = |v: &Value| v.as_array().cloned().unwrap_or_default();
    match group.shape {
        Shape::Scalar => vec![number(value)],
        Shape::Vector | Shape::UpperTriangle => list(value).iter().map(number).collect(),
        Shape::Matrix => list(value).iter().flat_map(list).map(|v| number(&v)).collect(),
        Shape::MatrixWithoutDiagonal => {
            let all = list(value).iter().flat_map(list).map(|v| number(&v)).collect::<Vec<_>>();
            all.into_iter().enumerate().filter(|(k, _)| k % 4 != 0).map(|(_, v)| v).collect()
        }
    }
}
