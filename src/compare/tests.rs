//! Verdicts on synthetic flights, and on recorded ones.

use super::*;
use crate::engine::{Engine, EngineOptions};
use crate::logs::filter::Origin;
use crate::sensors::ConverterOptions;
use gaware_nav::model::Model;
use std::collections::BTreeMap;

const NORTH: Quantity = Quantity::Channel(Channel::VelocityNorth);

/// Innovations like those of a filter: correlated over a second or so at 10 Hz, with a larger part in turns.
pub(crate) fn flight(seed: u64, scale: f64, in_turns: f64) -> FilterFlight {
    let mut state = seed;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let mut series = || {
        let mut x = 0.0;
        let point = |k: usize| {
            let turning = k / 300 % 2 == 1;
            let normal: f64 = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            x = 0.9 * x + 0.43 * normal;
            let regime = if turning { Regime::Turns } else { Regime::Level };
            let value = x * scale * if turning { in_turns } else { 1.0 };
            Point { t_s: 0.1 * k as f64, value, regime: (k > 200).then_some(regime) }
        };
        (0..6000).map(point).collect::<Vec<Point>>()
    };
    let channels =
        [Channel::VelocityNorth, Channel::VelocityEast, Channel::PositionNorth, Channel::VelocityRatio];
    let series = channels.map(|c| (Quantity::Channel(c), series()));
    FilterFlight { autopilot: "ardupilot", origin: Some(Origin::Log), series: BTreeMap::from(series) }
}

fn verdict_of(before: &FilterFlight, after: &FilterFlight) -> Comparison {
    compare(("a", before), ("b", after)).unwrap()
}

#[test]
fn a_smaller_innovation_is_named_with_its_size_and_its_regime() {
    let c = verdict_of(&flight(1, 0.5, 3.0), &flight(2, 0.5, 1.0));
    assert_eq!(c.verdict, Verdict::Smaller);
    let row = |regime| c.rows.iter().find(|r| r.quantity == NORTH && r.regime == regime).unwrap();
    assert_eq!(row(Regime::Turns).ratio.change, Change::Smaller);
    assert!((row(Regime::Turns).ratio.value - 1.0 / 3.0).abs() < 0.08, "{:?}", row(Regime::Turns));
    assert_eq!(row(Regime::Level).ratio.change, Change::Unchanged);
    assert!(
        c.text.contains("smaller after the change") && c.text.contains("velocity north 0."),
        "{}",
        c.text
    );
    assert!(!c.text.contains("test ratio"), "{}", c.text);
}

/// Three channels are judged at once; by chance alone at most 5 % of pairs may differ: of 200 that is 10, and 2.3 sigma more 17.
#[test]
fn the_same_flight_flown_again_is_unchanged_in_95_of_100_cases() {
    let verdict = |k: u64| verdict_of(&flight(2 * k, 0.5, 2.0), &flight(2 * k + 1, 0.5, 2.0)).verdict;
    let differing = (0..200).filter(|k| verdict(*k) != Verdict::Unchanged).count();
    assert!(differing <= 17, "{differing} of 200");
}

#[test]
fn larger_innovations_are_called_larger() {
    let c = verdict_of(&flight(5, 0.5, 1.0), &flight(6, 0.8, 1.0));
    assert_eq!(c.verdict, Verdict::Larger);
    assert!(c.text.contains("larger after the change: it made them worse"), "{}", c.text);
}

#[test]
fn a_few_seconds_of_flight_decide_nothing() {
    let mut short = flight(1, 0.5, 1.0);
    short.series.values_mut().for_each(|points| points.truncate(230));
    let c = verdict_of(&flight(2, 0.5, 1.0), &short);
    assert_eq!(c.verdict, Verdict::Undecided, "{}", c.text);
    assert!(c.rows.iter().all(|r| r.ratio.interval.is_some() == (r.ratio.change != Change::Undecided)));
}

/// The sentence, the table and the page show one interval for one ratio.
#[test]
fn a_ratio_has_one_interval() {
    let (before, after) = (flight(1, 0.5, 3.0), flight(2, 0.5, 1.0));
    let c = compare(("a.bin", &before), ("b.bin", &after)).unwrap();
    let html = page::html(&c, &before, &after).unwrap();
    assert!(c.judged.len() > 1);
    for judged in &c.judged {
        let own = |r: &&Row| r.quantity == judged.quantity && r.regime == judged.regime;
        assert_eq!(c.rows.iter().find(own).map(|r| r.ratio), Some(judged.ratio));
        let words = ratio_with_interval(&judged.ratio);
        assert!(html.contains(&words), "{words}");
        assert!(judged.ratio.change == Change::Unchanged || c.text.contains(&words), "{words} in {}", c.text);
    }
}

#[test]
fn flights_that_cannot_be_compared_are_refused_with_the_reason() {
    let good = flight(1, 1.0, 1.0);
    let error =
        |a: &FilterFlight, b: &FilterFlight| compare(("a.bin", a), ("b.bin", b)).unwrap_err().to_string();
    let other = FilterFlight { autopilot: "px4", ..good.clone() };
    assert!(error(&good, &other).contains("different autopilots: ardupilot and px4"));
    let empty = FilterFlight { series: BTreeMap::new(), ..good.clone() };
    assert!(error(&good, &empty).starts_with("b.bin has no innovations"));
    let link = FilterFlight { origin: Some(Origin::Link), ..good.clone() };
    assert!(error(&good, &link).contains("two logs of one kind"));
    let points = good.series[&NORTH].clone();
    let series = BTreeMap::from([(Quantity::Channel(Channel::Heading), points)]);
    let heading = FilterFlight { series, ..good.clone() };
    assert!(error(&good, &heading).contains("b.bin has heading"));
}

#[test]
fn the_page_shows_both_flights_and_escapes_their_names() {
    let (before, after) = (flight(1, 0.5, 3.0), flight(2, 0.5, 1.0));
    let c = compare(("<a>.bin", &before), ("b.bin", &after)).unwrap();
    let html = page::html(&c, &before, &after).unwrap();
    assert!(
        html.contains("&lt;a&gt;.bin") && html.contains("Innovations smaller") && html.contains("before")
    );
}

fn recorded(name: &str) -> FilterFlight {
    let folder = std::env::var_os("GAWARE_FLIGHTS").map_or_else(
        || std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        Into::into,
    );
    let engine = Engine::new(Model::standard(), EngineOptions::default());
    FilterFlight::read(folder.join(name), ConverterOptions::default(), engine, &|_, _| ()).unwrap()
}

/// The same aircraft, mission and firmware; in the second flight fixes are some 0.25 s older than the filter assumes.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_recorded_flight_with_late_fixes_has_larger_innovations() {
    let [clean, late] = ["sitl_clean_dither.tlog", "sitl_gps_lag350.tlog"].map(recorded);
    let c = compare(("clean", &clean), ("late", &late)).unwrap();
    assert_eq!(c.verdict, Verdict::Larger, "{}", c.text);
    let c = compare(("late", &late), ("clean", &clean)).unwrap();
    assert_eq!(c.verdict, Verdict::Smaller, "{}", c.text);
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn innovations_of_a_ulog_are_read() {
    let ulog = recorded("real_px4_ekf_failure.ulg");
    assert!(ulog.series.contains_key(&NORTH), "{:?}", ulog.series.keys());
    assert_eq!(ulog.origin, Some(Origin::Log));
    let c = compare(("a", &ulog), ("b", &ulog)).unwrap();
    assert!(matches!(c.verdict, Verdict::Unchanged | Verdict::Undecided), "{}", c.text);
}
