//! The tables of a fleet: `flights`, a row for each log, and `effects`, a row for each parameter of each effect of each flight.

use super::flight::FlightParameter;
use super::log::{FleetLog, Named};
use crate::export::Table;
use crate::export::table::{Cell, Put, Row};
use gaware_nav::effects::{self, ParameterGroup, Shape};
use serde_json::{Map, Value};

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
            "Inertial unit: by the name rule, otherwise the board that the log names, otherwise the calibration of its accelerometers",
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
            "Why the log has no estimate; empty where it has one",
            Cell::Text(log.failure().unwrap_or("")),
        );
        let summary = log.flight().map(|f| Value::Object(f.summary.clone())).unwrap_or_default();
        let nothing = Value::Null;
        let explanation = log.flight().and_then(|f| f.explanation.as_ref()).unwrap_or(&nothing);
        for (name, about, place) in WORDS {
            put(name, about, Cell::Text(text(&summary, place)));
        }
        let class = log.flight().and_then(|f| f.vehicle.as_deref());
        put(
            "vehicle_type",
            "fixed_wing, multirotor, helicopter, vtol, rover, submarine or unknown",
            Cell::Text(class.unwrap_or_else(|| text(&summary, "/vehicle_type"))),
        );
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
            let [value, sigma] = result(p);
            let about = format!("{}, {}; empty where the flight says nothing of it", p.effect, p.unit);
            put(&format!("{}_{unit}", p.name), &about, Cell::Number(value));
            put(&format!("{}_sigma_{unit}", p.name), "Its 1-sigma", Cell::Number(sigma));
        }
    }
}

/// Value and sigma, where the flight says anything of them: a prior is no result.
fn result(p: &FlightParameter) -> [f64; 2] {
    if p.is_informed() { [p.value, p.sigma] } else { [f64::NAN; 2] }
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
            "estimated: by replay with its model; identified, assumed, negligible, not_found: by explain (not_found: with the sigma that the flight leaves it)",
            Cell::Text(self.source),
        );
        put("effect", "Effect of the catalogue, or gyro_bias, accel_bias", Cell::Text(self.effect));
        put("parameter", "Parameter of the effect", Cell::Text(self.parameter));
        put("measured_in", "Unit of value, sigma and prior", Cell::Text(self.unit));
        put(
            "value",
            "Value; empty where it is no result: nothing but the prior, or of an effect that was not found within its own sigma",
            Cell::Number(self.value),
        );
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
        let [value, sigma] = result(p);
        push(&EffectRow {
            effect: &p.effect,
            parameter: &p.name,
            unit: &p.unit,
            value,
            sigma,
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
    let prior_only = map.get("prior_only").and_then(Value::as_array).into_iter().flatten();
    let prior_only: Vec<&str> = prior_only.filter_map(Value::as_str).collect();
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
            let (value, sigma) = (at(&values), at(&sigmas));
            let is_prior = prior_only.contains(name);
            let is_nothing = is_prior || (row.source == "not_found" && value.abs() <= sigma);
            push(&EffectRow {
                parameter: name,
                unit: group.unit.symbol,
                value: if is_nothing { f64::NAN } else { value },
                sigma: if is_prior { f64::NAN } else { sigma },
                ..row.clone()
            });
        }
    }
}

/// The parameters of a group in their order, from the layout of files.
fn flat(group: &ParameterGroup, value: &Value) -> Vec<f64> {
    let without_diagonal = group.shape == Shape::MatrixWithoutDiagonal;
    let all = numbers(value).into_iter().enumerate();
    all.filter(|(k, _)| !without_diagonal || k % 4 != 0).map(|(_, v)| v).collect()
}

/// All numbers of a list of lists in their order.
fn numbers(value: &Value) -> Vec<f64> {
    match value.as_array() {
        Some(list) => list.iter().flat_map(numbers).collect(),
        None => vec![value.as_f64().unwrap_or(f64::NAN)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fleet::flight::{Flight, FlightEntry};
    use serde_json::json;

    fn rows(explanation: Option<Value>, parameters: Vec<FlightParameter>) -> Vec<(String, f64, f64)> {
        let flight = Flight { parameters, explanation, ..Flight::default() };
        let entry = FlightEntry { flight: Some(flight), ..FlightEntry::default() };
        let log = FleetLog { path: "a.bin".into(), named: Named::default(), result: Ok(entry) };
        let mut out = Vec::new();
        effect_rows(&log, &mut |row| out.push((row.parameter.to_owned(), row.value, row.sigma)));
        out
    }

    #[test]
    fn what_a_flight_says_nothing_of_has_no_value() {
        let g = |name: &str, sigma: f64| FlightParameter {
            effect: "gyro_g_sensitivity".into(),
            name: name.into(),
            unit: "deg/h/g".into(),
            value: 12.0,
            sigma,
            prior_value: 0.0,
            prior_sigma: 360.0,
        };
        let found = rows(None, vec![g("g11", 30.0), g("g33", 359.0)]);
        assert_eq!(found[0], ("g11".into(), 12.0, 30.0));
        assert!(found[1].1.is_nan() && found[1].2.is_nan(), "{found:?}");
    }

    #[test]
    fn an_effect_that_was_not_found_has_a_value_only_beyond_its_sigma() {
        let not_found = |value: f64| json!({"not_found": [{"name": "gps_latency", "parameters": {"value_s": value, "sigma_s": 0.02}}]});
        let inside = rows(Some(not_found(0.01)), Vec::new());
        assert!(inside[0].1.is_nan() && inside[0].2 == 0.02, "{inside:?}");
        assert_eq!(rows(Some(not_found(0.05)), Vec::new())[0].1, 0.05);
        let named = json!({"effects": [{"names": ["gps_latency"], "parameters": {"gps_latency":
            {"value_s": 0.1, "sigma_s": 0.2, "prior_only": ["latency"]}}}]});
        assert!(rows(Some(named), Vec::new())[0].1.is_nan());
    }
}
