//! What the filter estimates of four recorded flights, second by second, against what it estimated when the files in
//! `tests/data/golden` were written: a change of estimates shows in review.
//!
//! `GAWARE_RENEW_GOLDEN=1 cargo test --test main golden` writes the files anew.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::pipeline::{Consumer, Recorded};
use gaware::sensors::ConverterOptions;
use gaware_nav::earth::Geodetic;
use gaware_nav::estimator::Estimator;
use gaware_nav::filter::Filter;
use gaware_nav::filter::layout::index;
use gaware_nav::math::log10;
use gaware_nav::model::Model;
use gaware_nav::rotation::wrap_pi;
use gaware_nav::sample::Sample;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use support::{fixture, flights};

/// Set to anything it lets the test write the files instead of comparing with them.
const RENEW: &str = "GAWARE_RENEW_GOLDEN";
/// Position, m.
const POSITION: f64 = 0.01;
/// Velocity, m/s.
const VELOCITY: f64 = 0.001;
/// Roll, pitch, yaw, deg.
const ATTITUDE: f64 = 0.01;
/// Biases and parameters, as a share of their own sigma; G of 25 deg/h/g thus to half a deg/h/g.
const CONSTANT_SIGMAS: f64 = 0.02;
/// Sigmas, as a share of themselves.
const SIGMA: f64 = 0.01;
/// Times of the rows, s: a row stands at the first fix of its second.
const TIME: f64 = 0.01;

/// One state at one time, in the unit of screens.
#[derive(Debug, Clone, PartialEq)]
struct Value {
    name: String,
    value: f64,
    sigma: f64,
}

impl Value {
    /// How far the value may be from this one.
    fn tolerance(&self) -> f64 {
        match self.name.as_str() {
            "north" | "east" | "down" => POSITION,
            "v_north" | "v_east" | "v_down" => VELOCITY,
            "roll" | "pitch" | "yaw" => ATTITUDE,
            _ => CONSTANT_SIGMAS * self.sigma,
        }
    }

    fn differs(&self, now: &Self) -> bool {
        let mut off = now.value - self.value;
        if self.name == "yaw" || self.name == "roll" {
            off = wrap_pi(off.to_radians()).to_degrees();
        }
        // Half of the last digit written.
        let rounding = 5e-5 * self.value.abs().max(1e-3);
        off.abs() > self.tolerance() + rounding || (now.sigma - self.sigma).abs() > SIGMA * self.sigma
    }
}

/// The estimate once a second.
struct Log {
    estimator: Estimator,
    start: Option<Geodetic>,
    second: f64,
    rows: Vec<(f64, Vec<Value>)>,
}

impl Consumer for Log {
    fn feed(&mut self, sample: &Sample) {
        self.estimator.feed(sample);
        let Some(filter) = self.estimator.filter() else { return };
        if filter.t_s().floor() > self.second {
            self.second = filter.t_s().floor();
            let start = *self.start.get_or_insert(filter.nav().geodetic());
            self.rows.push((filter.t_s(), values(filter, &start)));
        }
    }
}

fn values(filter: &Filter, start: &Geodetic) -> Vec<Value> {
    let nav = filter.nav();
    let c_nb = nav.c_nb();
    let from_start = c_nb * nav.c_eb().transpose() * (nav.r_e - start.to_ecef());
    let [position, velocity] = filter.ned_sigmas();
    let attitude = [nav.euler(), filter.euler_sigma()].map(|a| a.map(f64::to_degrees));
    let three = |names: [&str; 3], value: [f64; 3], sigma: [f64; 3]| {
        (0..3)
            .map(|k| Value { name: names[k].to_owned(), value: value[k], sigma: sigma[k] })
            .collect::<Vec<_>>()
    };
    let mut out = three(["north", "east", "down"], from_start.into(), position.into());
    out.extend(three(["v_north", "v_east", "v_down"], nav.v_n().into(), velocity.into()));
    out.extend(three(["roll", "pitch", "yaw"], attitude[0].into(), attitude[1].into()));
    out.extend(filter.layout().names().iter().enumerate().map(|(k, name)| {
        let state = index::GYRO_BIAS + k;
        Value {
            name: name.name.to_owned(),
            value: filter.calibration().get(filter.layout(), state) / name.unit.si,
            sigma: filter.covariance().sigma(state) / name.unit.si,
        }
    }));
    out
}

fn estimates(log: &Path) -> Vec<(f64, Vec<Value>)> {
    let consumer = Log {
        estimator: Estimator::new(Model::standard()),
        start: None,
        second: f64::NEG_INFINITY,
        rows: Vec::new(),
    };
    let recorded = Recorded::open(log, ConverterOptions::default()).unwrap();
    let (pipeline, _) = recorded.run(consumer, f64::INFINITY, &|_| {}).unwrap();
    pipeline.into_engine().rows
}

/// Five digits are finer than every tolerance.
fn written(rows: &[(f64, Vec<Value>)]) -> String {
    let mut out = String::from("t_s");
    for v in rows.first().map_or(&[][..], |(_, row)| row) {
        write!(out, ",{0},{0}_sigma", v.name).unwrap();
    }
    for (t_s, row) in rows {
        write!(out, "\n{t_s:.3}").unwrap();
        row.iter().for_each(|v| write!(out, ",{},{}", digits(v.value), digits(v.sigma)).unwrap());
    }
    out + "\n"
}

fn digits(x: f64) -> String {
    let places = (4.0 - log10(x.abs().max(1e-3)).floor()).max(0.0) as usize;
    format!("{x:.places$}")
}

fn read(text: &str) -> Vec<(f64, Vec<Value>)> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').skip(1).step_by(2).collect();
    let number = |s: &str| -> f64 { s.parse().unwrap() };
    lines
        .map(|line| {
            let cells: Vec<f64> = line.split(',').map(number).collect();
            let values = names.iter().zip(cells[1..].chunks_exact(2));
            let row = values.map(|(n, v)| Value { name: (*n).to_owned(), value: v[0], sigma: v[1] });
            (cells[0], row.collect())
        })
        .collect()
}

/// What differs, one line per state: since when, how often, and by how much at worst.
fn differences(golden: &[(f64, Vec<Value>)], now: &[(f64, Vec<Value>)]) -> Vec<String> {
    let mut out = Vec::new();
    let names = |rows: &[(f64, Vec<Value>)]| -> Vec<String> {
        rows.first().map_or(Vec::new(), |(_, row)| row.iter().map(|v| v.name.clone()).collect())
    };
    if names(golden) != names(now) {
        return vec![format!("other states: {:?} instead of {:?}", names(now), names(golden))];
    }
    if golden.len() != now.len() {
        out.push(format!("{} seconds instead of {}", now.len(), golden.len()));
    }
    let rows = || golden.iter().zip(now);
    if let Some(((a, _), (b, _))) = rows().find(|((a, _), (b, _))| (a - b).abs() > TIME) {
        out.push(format!("a row at {b} s instead of {a} s"));
    }
    for (k, name) in names(golden).iter().enumerate() {
        let off: Vec<_> = rows().filter(|((_, a), (_, b))| a[k].differs(&b[k])).collect();
        let Some(((first, _), _)) = off.first() else { continue };
        let share = |(a, b): (&Value, &Value)| (b.value - a.value).abs() / a.tolerance();
        let worst = off.iter().map(|((t, a), (_, b))| (share((&a[k], &b[k])), *t, &a[k], &b[k]));
        let Some((_, t, a, b)) = worst.max_by(|x, y| x.0.total_cmp(&y.0)) else { continue };
        out.push(format!(
            "{name}: {} s off from {first} s on, worst at {t} s: {:.5} ± {:.5} instead of {:.5} ± {:.5}",
            off.len(),
            b.value,
            b.sigma,
            a.value,
            a.sigma
        ));
    }
    out
}

fn compare(name: &str, log: &Path) {
    let file: PathBuf = fixture("golden").join(format!("{name}.csv"));
    let now = estimates(log);
    assert!(now.len() > 100, "{name}: {} seconds", now.len());
    if std::env::var_os(RENEW).is_some() {
        std::fs::write(&file, written(&now)).unwrap();
        return;
    }
    let golden = read(&std::fs::read_to_string(&file).unwrap());
    let off = differences(&golden, &now);
    assert!(
        off.is_empty(),
        "the estimates of {name} have changed; if that is meant, {RENEW}=1 cargo test --test main golden\n{}",
        off.join("\n")
    );
}

#[test]
fn a_flight_without_faults_is_estimated_as_before() {
    compare("small_clean_dither", &fixture("small_clean_dither.tlog"));
}

#[test]
fn a_flight_with_g_sensitivity_is_estimated_as_before() {
    compare("small_gsens_typical_dither", &fixture("small_gsens_typical_dither.tlog"));
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_real_aircraft_is_estimated_as_before() {
    let folder = flights();
    compare("real_px4plane_swiss", &folder.join("real_px4plane_swiss.tlog"));
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_consumer_unit_with_correlated_fixes_is_estimated_as_before() {
    let folder = flights();
    compare("independent_gsens_consumer", &folder.join("independent_gsens_consumer.tlog"));
}

/// What is written reads back within the tolerances, and a change beyond them is told with its state and time.
#[test]
fn a_change_beyond_its_tolerance_is_told() {
    let row = |yaw: f64, g: f64| {
        vec![
            Value { name: "yaw".into(), value: yaw, sigma: 0.2 },
            Value { name: "g11".into(), value: g, sigma: 25.0 },
        ]
    };
    let before = vec![(1.0, row(179.999, 100.0)), (2.0, row(10.0, 100.123_456))];
    let golden = read(&written(&before));
    assert_eq!(differences(&golden, &before), Vec::<String>::new());
    let within = vec![(1.0, row(-179.995, 100.4)), (2.0, row(10.009, 100.0))];
    assert_eq!(differences(&golden, &within), Vec::<String>::new());
    let off = differences(&golden, &[(1.0, row(179.999, 100.0)), (2.0, row(10.02, 101.0))]);
    assert_eq!(off.len(), 2);
    assert!(off[0].starts_with("yaw: 1 s off from 2 s on") && off[1].starts_with("g11"), "{off:?}");
    let mut narrower = before.clone();
    narrower[1].1[0].sigma = 0.19;
    assert_eq!(differences(&golden, &narrower).len(), 1);
    let fewer = differences(&golden, &before[..1]);
    assert!(fewer[0].contains("1 seconds instead of 2"), "{fewer:?}");
}
