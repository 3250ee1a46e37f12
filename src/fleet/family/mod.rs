//! What the flights of each inertial unit have in common: a hierarchical model of flights within units within a family.
//!
//! Each parameter is treated by itself: correlations between parameters of one flight are not used. A flight's estimate holds the prior of its own
//! filter, which counts once for each flight although it was assumed once; it is taken out first, and a flight that hardly exceeds its prior
//! is left out. [`fit`] then separates constant part, turn-on spread, drift and shifts with firmware. Drift and shifts are kept where
//! they are significant at 5 % over all units, firmwares and parameters together (Bonferroni); where they are not, the constants are fitted again
//! without them. The constants of the units are in turn values with errors from a family (DerSimonian & Laird 1986), and a unit
//! is out of family where Student's t against the others alone says so.

pub mod findings;
pub mod fit;
mod model;
pub mod tails;

#[cfg(test)]
pub(crate) mod tests;

pub use model::prior_model;

use super::log::FleetLog;
use findings::Finding;
pub use fit::Estimated;
use fit::{Design, Fit, Observation, UnitFit};
use gaware_nav::math::{hypot, powf};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Probability of one false finding of a kind in the whole fleet.
const LEVEL: f64 = 0.05;
/// Flights of a unit from which on a drift can be seen.
const DRIFT_FLIGHTS: usize = 5;
/// Units from which on one can be out of their family.
const FAMILY_UNITS: usize = 4;
const DAY_S: f64 = 86_400.0;
const YEAR_D: f64 = 365.25;

/// What a fleet teaches (`gaware.fleet_family/1`).
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Family {
    /// `gaware.fleet_family/1`.
    pub schema: &'static str,
    /// Flights that were used.
    pub flights: usize,
    /// Inertial units, in order.
    pub units: Vec<String>,
    /// Firmwares in the order in which they were first flown; "" where it is not known.
    pub firmwares: Vec<String>,
    /// Every parameter of which the flights say enough.
    pub parameters: Vec<ParameterFamily>,
    /// Effects that explain identified, by unit.
    pub recurring: Vec<Recurring>,
    /// What stands out, a sentence each.
    pub findings: Vec<String>,
}

/// One parameter over the fleet.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ParameterFamily {
    /// `gyro_bias`, `accel_bias` or the name of an effect.
    pub effect: String,
    /// `bg_x`, `g11`, `latency`.
    pub name: String,
    /// Of all figures.
    pub unit: String,
    /// Flights that say enough of it.
    pub flights: usize,
    /// Standard deviation from flight to flight of one unit.
    pub turn_on_spread: Estimated,
    /// Mean of the units' constant parts; absent with fewer than two units.
    pub family_mean: Option<Estimated>,
    /// Standard deviation of the constant parts between units.
    pub between_units: Option<f64>,
    /// Every unit that has flights.
    pub units: Vec<UnitFamily>,
    /// Every change of firmware that can be separated from the units.
    pub firmware_shifts: Vec<FirmwareShift>,
}

/// One parameter of one unit.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct UnitFamily {
    /// The unit.
    pub unit: String,
    /// Flights that say enough of it.
    pub flights: usize,
    /// Constant part, at the mean time of the flights and with the first firmware.
    pub constant: Estimated,
    /// Drift per year; where it is not significant it is no part of the constant's fit.
    pub drift_per_year: Option<Estimated>,
    /// Whether the drift is significant.
    pub drifts: bool,
    /// Whether its flights scatter more than those of the others.
    pub scatters_more: bool,
    /// Distance from the other units in their standard deviations; absent with fewer than four units.
    pub family_t: Option<f64>,
    /// Whether it is out of family.
    pub out_of_family: bool,
    /// What is expected in its next flight: with its last firmware, the sigma includes the turn-on spread.
    pub next_flight: Estimated,
}

/// A shift that came with a firmware.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct FirmwareShift {
    /// The firmware before.
    pub from: String,
    /// The firmware with which it came.
    pub to: String,
    /// Size.
    pub shift: Estimated,
    /// Whether it is significant.
    pub significant: bool,
}

/// How often explain identified an effect in the flights of a unit.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Recurring {
    /// The unit.
    pub unit: String,
    /// The effect.
    pub effect: String,
    /// Flights in which it was identified.
    pub identified: usize,
    /// Flights that were explained.
    pub explained: usize,
    /// Firmwares of the flights in which it was identified.
    pub firmwares: Vec<String>,
}

/// What a fleet teaches, with the flights that it was found in.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetStudy {
    /// The result.
    pub family: Family,
    /// Its findings, by parameter.
    pub findings: Vec<Finding>,
    /// The flights of each parameter of the family.
    pub flights: Vec<Vec<FlightValue>>,
}

/// What one flight says of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightValue {
    /// Index of the log.
    pub log: usize,
    /// Index of the unit.
    pub unit: usize,
    /// Value without the prior of the flight's own filter.
    pub value: f64,
    /// Its 1-sigma.
    pub sigma: f64,
    /// What the other flights make of it: constant part, drift and shifts as far as they are significant.
    pub expected: f64,
    /// Distance from that in standard deviations, the turn-on spread included.
    pub z: f64,
    /// Whether it is unlike the other flights of its unit: beyond what chance does in one of twenty fleets.
    pub unlike: bool,
}

/// Values of one parameter: what is fitted, and the logs that they come from.
#[derive(Default)]
struct Values {
    observations: Vec<Observation>,
    logs: Vec<usize>,
}

/// The flights that count, with indices for names.
struct Flights<'a> {
    units: Vec<String>,
    firmwares: Vec<String>,
    flights: Vec<KnownFlight<'a>>,
}

/// A flight of a known unit.
#[derive(Clone, Copy)]
struct KnownFlight<'a> {
    unit: usize,
    firmware: usize,
    /// Its place among the logs.
    index: usize,
    log: &'a FleetLog,
}

impl<'a> Flights<'a> {
    fn new(logs: &'a [FleetLog]) -> Self {
        let known = |(_, l): &(usize, &FleetLog)| l.flight().is_some() && l.unit().is_some();
        let of: Vec<(usize, &FleetLog)> = logs.iter().enumerate().filter(known).collect();
        let unit = |l: &FleetLog| l.unit().unwrap_or_default().to_owned();
        let firmware = |l: &FleetLog| l.firmware().unwrap_or_default().to_owned();
        let units: Vec<String> =
            of.iter().map(|(_, l)| unit(l)).collect::<BTreeSet<_>>().into_iter().collect();
        // In the order of their first flights; by name where there are no dates.
        let mut first: BTreeMap<String, f64> = BTreeMap::new();
        for (_, log) in &of {
            let start = log.flight().and_then(|f| f.start_unix_s).unwrap_or(f64::INFINITY);
            first.entry(firmware(log)).and_modify(|t| *t = t.min(start)).or_insert(start);
        }
        let mut firmwares: Vec<String> = first.keys().cloned().collect();
        firmwares.sort_by(|a, b| first[a].total_cmp(&first[b]).then_with(|| a.cmp(b)));
        let index = |names: &[String], name: &str| names.iter().position(|n| n == name).unwrap_or(0);
        let known = |(k, log): (usize, &'a FleetLog)| KnownFlight {
            unit: index(&units, &unit(log)),
            firmware: index(&firmwares, &firmware(log)),
            index: k,
            log,
        };
        let flights = of.into_iter().map(known).collect();
        Self { units, firmwares, flights }
    }

    /// Every parameter with the flights that say enough of it.
    fn parameters(&self) -> BTreeMap<(String, String, String), Values> {
        let start = |f: &KnownFlight<'_>| f.log.flight().and_then(|f| f.start_unix_s);
        // Between flights with and without a date there is no time.
        let undated: BTreeSet<usize> =
            self.flights.iter().filter(|f| start(f).is_none()).map(|f| f.unit).collect();
        let mut out: BTreeMap<_, Values> = BTreeMap::new();
        for known in &self.flights {
            let Some(flight) = known.log.flight() else { continue };
            let dated = flight.start_unix_s.filter(|_| !undated.contains(&known.unit));
            let time_d = dated.unwrap_or(0.0) / DAY_S;
            for p in &flight.parameters {
                let Some(own) = without_prior(p) else { continue };
                let key = (p.effect.clone(), p.name.clone(), p.unit.clone());
                let values = out.entry(key).or_default();
                values.logs.push(known.index);
                values.observations.push(Observation {
                    unit: known.unit,
                    firmware: known.firmware,
                    time_d,
                    value: own.value,
                    sigma: own.sigma,
                });
            }
        }
        out
    }
}

/// What the flight alone says: the posterior over the prior, both normal.
fn without_prior(p: &super::flight::FlightParameter) -> Option<Estimated> {
    if !p.is_informed() {
        return None;
    }
    let (after, before) = (p.sigma.powi(-2), p.prior_sigma.powi(-2));
    let own = after - before;
    let value = (p.value * after - p.prior_value * before) / own;
    let sigma = powf(own, -0.5);
    (value.is_finite() && sigma.is_finite()).then_some(Estimated { value, sigma })
}

/// Finds what the flights of each unit have in common. Logs without a result or without a known unit do not count.
pub fn family(logs: &[FleetLog]) -> Family {
    study(logs).family
}

/// The same with the flights that it was found in.
pub fn study(logs: &[FleetLog]) -> FleetStudy {
    let flights = Flights::new(logs);
    let all = flights.parameters();
    // Tests of each kind in the whole fleet.
    let tests = (all.len() * flights.units.len().max(1)) as f64;
    let found = all.iter().filter_map(|(key, own)| parameter(key, own, &flights, tests));
    let (parameters, mut values): (Vec<ParameterFamily>, Vec<Vec<FlightValue>>) = found.unzip();
    let count = values.iter().map(Vec::len).sum::<usize>() as f64;
    for value in values.iter_mut().flatten() {
        value.unlike = tails::normal(value.z) * count < LEVEL;
    }
    let findings = findings::of(&parameters);
    let family = Family {
        schema: "gaware.fleet_family/1",
        flights: flights.flights.len(),
        recurring: recurring(&flights),
        units: flights.units,
        firmwares: flights.firmwares,
        parameters,
        findings: findings.iter().map(|f| f.sentence.clone()).collect(),
    };
    FleetStudy { family, findings, flights: values }
}

fn parameter(
    (effect, name, unit): &(String, String, String),
    values: &Values,
    flights: &Flights<'_>,
    tests: f64,
) -> Option<(ParameterFamily, Vec<FlightValue>)> {
    let own = &values.observations[..];
    let units = flights.units.len();
    let open = open_design(own, flights);
    let whole = fit::fit(own, units, &open).or_else(|| fit::fit(own, units, &Design::default()))?;
    let significant = |u: &Estimated| tails::student(u.value / u.sigma, whole.freedom) * tests < LEVEL;
    let chosen = Design {
        slopes: whole
            .units
            .iter()
            .map(|u| u.and_then(|u| u.slope).is_some_and(|s| significant(&s)))
            .collect(),
        shifts: whole.shifts.iter().map(|s| s.is_some_and(|s| significant(&s))).collect(),
    };
    let last = fit::fit(own, units, &chosen)?;
    let constants: Vec<Option<Estimated>> = last.units.iter().map(|u| u.map(|u| u.constant)).collect();
    let there: Vec<Estimated> = constants.iter().flatten().copied().collect();
    let family = fit::mean_and_spread(&there);
    let rows = last.units.iter().enumerate().filter_map(|(k, unit)| {
        let of = UnitOf { index: k, unit: (*unit)?, last: &last, own, tests };
        let drift = whole.units.get(k).copied().flatten().and_then(|u| u.slope);
        Some(of.row(flights.units.get(k)?, drift, &constants))
    });
    let shift = |k: usize| {
        let found = last.shifts.get(k).copied().flatten().or(whole.shifts.get(k).copied().flatten())?;
        Some(FirmwareShift {
            from: flights.firmwares.get(k.checked_sub(1)?)?.clone(),
            to: flights.firmwares.get(k)?.clone(),
            shift: found,
            significant: chosen.shifts.get(k).copied().unwrap_or(false),
        })
    };
    let found = ParameterFamily {
        effect: effect.clone(),
        name: name.clone(),
        unit: unit.clone(),
        flights: own.len(),
        turn_on_spread: last.spread,
        family_mean: family.map(|(mean, _)| mean),
        between_units: family.map(|(_, spread)| spread),
        units: rows.collect(),
        firmware_shifts: (1..flights.firmwares.len()).filter_map(shift).collect(),
    };
    Some((found, flight_values(values, &last)))
}

/// The flights against what the fit expects of them.
fn flight_values(values: &Values, fit: &Fit) -> Vec<FlightValue> {
    let flight = |(o, log): (&Observation, &usize)| {
        let expected = fit.expected(o)?;
        let z = (o.value - expected) / hypot(o.sigma, fit.spread.value);
        Some(FlightValue {
            log: *log,
            unit: o.unit,
            value: o.value,
            sigma: o.sigma,
            expected,
            z,
            unlike: false,
        })
    };
    values.observations.iter().zip(&values.logs).filter_map(flight).collect()
}

/// Every drift and shift that the flights can show.
fn open_design(own: &[Observation], flights: &Flights<'_>) -> Design {
    let drifts = |unit: usize| {
        let times: Vec<f64> = own.iter().filter(|o| o.unit == unit).map(|o| o.time_d).collect();
        let range = times.iter().copied().fold(f64::NEG_INFINITY, f64::max)
            - times.iter().copied().fold(f64::INFINITY, f64::min);
        times.len() >= DRIFT_FLIGHTS && range > 1.0
    };
    Design {
        slopes: (0..flights.units.len()).map(drifts).collect(),
        shifts: vec![true; flights.firmwares.len()],
    }
}

impl ParameterFamily {
    /// Mean and spread of the units that are not out of family; absent with fewer than two.
    pub fn in_family(&self) -> Option<(Estimated, f64)> {
        let own = self.units.iter().filter(|u| !u.out_of_family);
        fit::mean_and_spread(&own.map(|u| u.constant).collect::<Vec<_>>())
    }
}

/// One unit within a fit.
struct UnitOf<'a> {
    index: usize,
    unit: UnitFit,
    last: &'a Fit,
    own: &'a [Observation],
    tests: f64,
}

impl UnitOf<'_> {
    fn row(&self, name: &str, drift: Option<Estimated>, constants: &[Option<Estimated>]) -> UnitFamily {
        let unit = &self.unit;
        let (family_t, others) = self.against_the_others(constants);
        let per_year = |s: Estimated| Estimated { value: s.value * YEAR_D, sigma: s.sigma * YEAR_D };
        let scatter = tails::chi2_above(unit.squares, unit.freedom);
        UnitFamily {
            unit: name.to_owned(),
            flights: unit.flights,
            constant: unit.constant,
            drift_per_year: unit.slope.or(drift).map(per_year),
            drifts: unit.slope.is_some(),
            scatters_more: scatter * self.tests < LEVEL,
            family_t,
            out_of_family: family_t
                .is_some_and(|t| tails::student(t, others.saturating_sub(1)) * self.tests < LEVEL),
            next_flight: self.next_flight(),
        }
    }

    /// Student's t against the family of the others, and their number.
    fn against_the_others(&self, constants: &[Option<Estimated>]) -> (Option<f64>, usize) {
        let others: Vec<Estimated> =
            constants.iter().enumerate().filter(|(k, _)| *k != self.index).filter_map(|(_, c)| *c).collect();
        if others.len() + 1 < FAMILY_UNITS {
            return (None, others.len());
        }
        let t = fit::mean_and_spread(&others).map(|(mean, spread)| {
            let own = self.unit.constant;
            (own.value - mean.value) / (own.sigma.powi(2) + spread.powi(2) + mean.sigma.powi(2)).sqrt()
        });
        (t, others.len())
    }

    fn next_flight(&self) -> Estimated {
        let mine = self.own.iter().filter(|o| o.unit == self.index);
        let Some(latest) =
            mine.max_by(|a, b| a.time_d.total_cmp(&b.time_d).then(a.firmware.cmp(&b.firmware)))
        else {
            return self.unit.constant;
        };
        let (mut value, mut variance) = (self.unit.constant.value, self.unit.constant.sigma.powi(2));
        if let Some(slope) = self.unit.slope {
            let ahead_d = latest.time_d - self.unit.mean_time_d;
            value += slope.value * ahead_d;
            variance += (slope.sigma * ahead_d).powi(2);
        }
        for shift in self.last.shifts.iter().take(latest.firmware + 1).flatten() {
            value += shift.value;
            variance += shift.sigma.powi(2);
        }
        // A unit that scatters more has a spread of its own.
        let spread2 = self.last.spread.value.powi(2) * (unit_scatter(&self.unit)).max(1.0);
        Estimated { value, sigma: (variance + spread2).sqrt() }
    }
}

/// Squares per degree of freedom; 1 is that of the fleet.
fn unit_scatter(unit: &UnitFit) -> f64 {
    if unit.freedom == 0 { 1.0 } else { unit.squares / unit.freedom as f64 }
}

/// How often each effect was identified, by unit.
fn recurring(flights: &Flights<'_>) -> Vec<Recurring> {
    let mut out = Vec::new();
    for (k, unit) in flights.units.iter().enumerate() {
        let mut found: BTreeMap<String, (usize, BTreeSet<String>)> = BTreeMap::new();
        let mut explained = 0;
        for known in flights.flights.iter().filter(|f| f.unit == k) {
            let Some(document) = known.log.flight().and_then(|f| f.explanation.as_ref()) else { continue };
            explained += 1;
            let steps = document.get("effects").and_then(|v| v.as_array()).into_iter().flatten();
            let names: BTreeSet<&str> = steps.filter_map(|s| s.pointer("/names/0")?.as_str()).collect();
            for name in names {
                let entry = found.entry(name.to_owned()).or_default();
                entry.0 += 1;
                entry.1.extend(flights.firmwares.get(known.firmware).filter(|f| !f.is_empty()).cloned());
            }
        }
        out.extend(found.into_iter().map(|(effect, (identified, firmwares))| Recurring {
            unit: unit.clone(),
            effect,
            identified,
            explained,
            firmwares: firmwares.into_iter().collect(),
        }));
    }
    out
}
