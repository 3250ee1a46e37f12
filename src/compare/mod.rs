//! Two flights of one vehicle, before and after a change: are the autopilot's own innovations smaller?
//!
//! The verdict counts only what the autopilot itself reports: innovations and test ratios of its filter, in flight. Its attitude less ours
//! stands beside it. Two flights are never flown alike, so each regime counts with the same weight in both.

pub mod flight;
pub mod page;
pub mod statistics;

use crate::logs::filter::Channel;
use flight::{FilterFlight, Point, Regime};
use schemars::JsonSchema;
use serde::Serialize;
use statistics::{Change, MeanSquare, Ratio, Rms, pair, ratio, standardised};

/// Probability that any of the intervals that decide misses its true ratio.
const ALPHA: f64 = 0.05;

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Quantity {
    /// What the autopilot's filter reports.
    Channel(Channel),
    /// Its attitude less ours.
    Attitude(AttitudeAngle),
}

/// An angle of the autopilot's attitude less ours, deg.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeAngle {
    /// Roll, deg.
    AttitudeRoll,
    /// Pitch, deg.
    AttitudePitch,
    /// Yaw, deg.
    AttitudeYaw,
}

impl Quantity {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Channel(channel) => channel.words(),
            Self::Attitude(AttitudeAngle::AttitudeRoll) => "roll against ours",
            Self::Attitude(AttitudeAngle::AttitudePitch) => "pitch against ours",
            Self::Attitude(AttitudeAngle::AttitudeYaw) => "yaw against ours",
        }
    }

    /// Unit; empty for ratios.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Channel(channel) => channel.unit(),
            Self::Attitude(_) => "deg",
        }
    }

    fn kind(self) -> Kind {
        match self {
            Self::Channel(channel) if channel.unit().is_empty() => Kind::TestRatio,
            Self::Channel(_) => Kind::Innovation,
            Self::Attitude(_) => Kind::Attitude,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Innovation,
    TestRatio,
    Attitude,
}

/// One quantity in one regime.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Row {
    /// What.
    pub quantity: Quantity,
    /// Unit of the RMS; empty for test ratios.
    pub unit: &'static str,
    /// While the vehicle did this.
    pub regime: Regime,
    /// RMS before.
    pub before: Rms,
    /// RMS after.
    pub after: Rms,
    /// After over before, with an interval so wide that those of all channels in a regime together hold with 95 %.
    pub ratio: Ratio,
}

/// The result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// At least one channel is smaller beyond chance, and none larger.
    Smaller,
    /// No channel differs beyond chance.
    Unchanged,
    /// At least one channel is larger beyond chance, and none smaller.
    Larger,
    /// Some are smaller and some larger.
    Mixed,
    /// Too few effective samples.
    Undecided,
}

/// The comparison (`gaware.comparison/1`).
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Comparison {
    /// `gaware.comparison/1`.
    pub schema: &'static str,
    /// Of the innovations over all regimes (of the test ratios where there are no innovations).
    pub verdict: Verdict,
    /// Autopilot of both.
    pub autopilot: &'static str,
    /// Name of the first log.
    pub before: String,
    /// Name of the second one.
    pub after: String,
    /// What decided the verdict: of the rows, those of the innovations over all regimes.
    pub judged: Vec<Row>,
    /// Every quantity in every regime.
    pub rows: Vec<Row>,
    /// The verdict in a sentence.
    pub text: String,
}

/// Why two flights cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// Two vehicles.
    #[error("the logs are of different autopilots: {0} and {1}")]
    Autopilots(&'static str, &'static str),
    /// Test ratios of a link are low-passed, those of a log are not.
    #[error(
        "one of the logs is of a link, the other of the autopilot itself: their test ratios are defined differently; compare two logs of one kind"
    )]
    Origins,
    /// Nothing of the autopilot's filter.
    #[error(
        "{0} has no innovations or test ratios of the autopilot's filter in flight (.bin: XKF3 and XKF4 or NKF3 and NKF4, .ulg: estimator_innovations, links: \
         EKF_STATUS_REPORT or ESTIMATOR_STATUS)"
    )]
    NoFilter(String),
    /// Nothing in common.
    #[error("the logs have no channel in common: {0} has {1}, {2} has {3}")]
    NoCommon(String, String, String, String),
}

/// Compares.
///
/// # Errors
/// Logs of different autopilots or kinds, or without anything in common.
pub fn compare(
    (name_before, before): (&str, &FilterFlight),
    (name_after, after): (&str, &FilterFlight),
) -> Result<Comparison, CompareError> {
    if before.autopilot != after.autopilot {
        return Err(CompareError::Autopilots(before.autopilot, after.autopilot));
    }
    for (name, flight) in [(name_before, before), (name_after, after)] {
        let mut channels = flight.series.iter().filter(|(q, _)| q.kind() != Kind::Attitude);
        if !channels.any(|(_, points)| points.iter().any(|p| p.regime.is_some())) {
            return Err(CompareError::NoFilter(name.to_owned()));
        }
    }
    if before.origin != after.origin {
        return Err(CompareError::Origins);
    }
    let kind = deciding(before, after);
    let rows = rows(before, after, kind);
    if !rows.iter().any(|r| r.quantity.kind() != Kind::Attitude) {
        let [a, b] = [before, after].map(channel_words);
        return Err(CompareError::NoCommon(name_before.to_owned(), a, name_after.to_owned(), b));
    }
    let of_all = |r: &&Row| r.regime == Regime::All && r.quantity.kind() == kind;
    let judged: Vec<Row> = rows.iter().filter(of_all).cloned().collect();
    let verdict = verdict(&judged);
    Ok(Comparison {
        schema: "gaware.comparison/1",
        verdict,
        autopilot: before.autopilot,
        before: name_before.to_owned(),
        after: name_after.to_owned(),
        text: words(verdict, &judged),
        judged,
        rows,
    })
}

fn channel_words(flight: &FilterFlight) -> String {
    let channels = flight.series.keys().filter(|q| q.kind() != Kind::Attitude);
    channels.map(|q| q.words()).collect::<Vec<_>>().join(", ")
}

/// What decides: the innovations, the test ratios where the flights have no innovations in common.
fn deciding(before: &FilterFlight, after: &FilterFlight) -> Kind {
    let common = common(before, after, Kind::Innovation);
    if common > 0 { Kind::Innovation } else { Kind::TestRatio }
}

/// How many quantities of a kind both flights have in flight.
fn common(before: &FilterFlight, after: &FilterFlight, kind: Kind) -> usize {
    let flown = |flight: &FilterFlight, q: &Quantity| {
        flight.series.get(q).is_some_and(|points| points.iter().any(|p| p.regime.is_some()))
    };
    before.series.keys().filter(|q| q.kind() == kind && flown(before, q) && flown(after, q)).count()
}

/// Every quantity in every regime, with one interval each: it holds for all that decide together (Bonferroni).
fn rows(before: &FilterFlight, after: &FilterFlight, deciding: Kind) -> Vec<Row> {
    let alpha = ALPHA / common(before, after, deciding).max(1) as f64;
    let mut rows = Vec::new();
    for (quantity, a) in &before.series {
        let Some(b) = after.series.get(quantity) else { continue };
        let (values_a, values_b) = (values(a), values(b));
        let both = |regime: Regime| {
            let of = |values: &[f64], points: &[Point]| {
                MeanSquare::of(values, |k| points.get(k).is_some_and(|p| p.regime == Some(regime)))
            };
            Some([of(&values_a, a)?, of(&values_b, b)?])
        };
        let each: Vec<(Regime, [MeanSquare; 2])> =
            Regime::EACH.into_iter().filter_map(|r| Some((r, both(r)?))).collect();
        let pairs: Vec<[MeanSquare; 2]> = each.iter().map(|(_, pair)| *pair).collect();
        let all = standardised(&pairs).map(|rms| (Regime::All, rms));
        for (regime, [before, after]) in
            all.into_iter().chain(each.iter().map(|(r, [a, b])| (*r, pair(a, b))))
        {
            if let Some(ratio) = ratio(&before, &after, alpha) {
                rows.push(Row { quantity: *quantity, unit: quantity.unit(), regime, before, after, ratio });
            }
        }
    }
    rows
}

fn values(points: &[Point]) -> Vec<f64> {
    points.iter().map(|p| p.value).collect()
}

fn verdict(judged: &[Row]) -> Verdict {
    let is = |change: Change| judged.iter().any(|r| r.ratio.change == change);
    match (is(Change::Smaller), is(Change::Larger)) {
        (true, true) => Verdict::Mixed,
        (true, false) => Verdict::Smaller,
        (false, true) => Verdict::Larger,
        (false, false) if is(Change::Unchanged) => Verdict::Unchanged,
        (false, false) => Verdict::Undecided,
    }
}

/// `0.31 (0.27 to 0.36)`.
pub fn ratio_with_interval(ratio: &Ratio) -> String {
    let value = ratio.value;
    ratio.interval.map_or_else(
        || format!("{value:.2} (too few samples)"),
        |[low, high]| format!("{value:.2} ({low:.2} to {high:.2})"),
    )
}

/// `velocity north 0.31 (0.27 to 0.36)`.
fn ratio_words(r: &Row) -> String {
    format!("{} {}", r.quantity.words(), ratio_with_interval(&r.ratio))
}

fn words(verdict: Verdict, judged: &[Row]) -> String {
    let list = |which: fn(Change) -> bool| {
        judged.iter().filter(|r| which(r.ratio.change)).map(ratio_words).collect::<Vec<_>>().join(", ")
    };
    let changed = list(|c| matches!(c, Change::Smaller | Change::Larger));
    const HOW: &str = "RMS after over before, with intervals that all hold together with 95 %";
    match verdict {
        Verdict::Smaller => {
            format!("The autopilot's innovations are smaller after the change. {HOW}: {changed}.")
        }
        Verdict::Larger => {
            format!(
                "The autopilot's innovations are larger after the change: it made them worse. {HOW}: {changed}."
            )
        }
        Verdict::Mixed => {
            format!(
                "Some of the autopilot's innovations are smaller after the change and some larger, which is worse. {HOW}: {changed}."
            )
        }
        Verdict::Unchanged => {
            let all = list(|c| c == Change::Unchanged);
            format!("The autopilot's innovations do not differ beyond chance. {HOW}: {all}.")
        }
        Verdict::Undecided => {
            "The flights are too short to decide: in no regime do both have enough independent innovations."
                .to_owned()
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
