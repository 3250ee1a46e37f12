//! Recorded flights, of the real firmware and of real vehicles, against what is known about them.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::commands::replay::{ReplayRequest, replay};
use gaware::engine::{Engine, EngineOptions};
use gaware_nav::effects::GpsLeverArm;
use gaware_nav::model::{EffectSetting, Model};
use serde_json::Value;
use std::path::Path;
use support::{fixture, flights, gaware};

/// rad/s per m/s² in deg/h/g.
const DEG_PER_H_PER_G: f64 = 9.80665 * 206_264.806_247;
/// G of `sitl_gsens_typical_dither.tlog` (data/README.md), 1e-4 rad/s per m/s².
const INJECTED_G: [[f64; 3]; 3] = [[1.78, 0.4, -0.5], [-0.6, 1.4, 0.7], [0.3, -0.4, -2.0]];
/// An element may be off by 3 sigma, or by this much where sigma is small, deg/h/g: a fifth of RAW_IMU's 1 mrad/s per g.
const G_TOLERANCE: f64 = 40.0;
/// Columns x and z are known this well after that flight, deg/h/g, if the sensors have no tolerances; y needs sideslip.
const G_SIGMA: f64 = 60.0;
/// With the tolerances of a consumer unit column x is known as well, and z as well as turns tell it from scale factors and axes.
const G_SIGMA_STANDARD: [f64; 2] = [65.0, 125.0];
/// RMS of roll, pitch, yaw against `SIM_STATE`, deg: better than the autopilot's own 0.128/0.121/0.199.
const ATTITUDE_RMS: [f64; 3] = [0.08, 0.08, 0.09];
/// The autopilot's 20 Hz sensor filter delays samples by some 12 ms; more than this is another fault, s.
const TIME_SHIFT: f64 = 0.02;

fn replayed(log: &Path) -> Value {
    replayed_with(log, |model| model)
}

/// With the standard model changed by this.
fn replayed_with(log: &Path, change: impl FnOnce(Model) -> Model) -> Value {
    let request = ReplayRequest { log: log.into(), truth_from_s: 150.0, ..ReplayRequest::default() };
    let (_, document) =
        replay(&request, |model| Engine::new(change(model), EngineOptions::default())).unwrap();
    Value::Object(document)
}

/// Value and sigma of every element of G, by row and column.
fn g(document: &Value) -> Vec<(usize, usize, f64, f64)> {
    let g = &document["estimate"]["g_sensitivity_deg_per_h_per_g"];
    let element = |what: &str, r: usize, c: usize| g[what][r][c].as_f64().unwrap();
    let places = (0..3).flat_map(|r| (0..3).map(move |c| (r, c)));
    places.map(|(r, c)| (r, c, element("value", r, c), element("sigma", r, c))).collect()
}

fn assert_attitude(document: &Value) {
    let truth = &document["truth_comparison"];
    println!("attitude against the truth: {truth}");
    for (k, tolerance) in ATTITUDE_RMS.iter().enumerate() {
        assert!(truth["attitude_rms_deg"][k].as_f64().unwrap() <= *tolerance, "{truth:#}");
    }
    assert!(truth["time_shift_s"].as_f64().unwrap().abs() <= TIME_SHIFT, "{truth:#}");
    assert!(truth["samples"].as_u64().unwrap() > 20_000, "{truth:#}");
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_g_sensitivity_put_into_the_real_firmware_is_found() {
    let folder = flights();
    let log = folder.join("sitl_gsens_typical_dither.tlog");
    let found = |document: &Value, bounds: [f64; 2]| {
        for (r, c, value, sigma) in g(document) {
            let truth = INJECTED_G[r][c] * 1e-4 * DEG_PER_H_PER_G;
            println!("g{}{}: {value:7.1} ± {sigma:5.1}, truth {truth:7.1} deg/h/g", r + 1, c + 1);
            assert!((value - truth).abs() <= G_TOLERANCE.max(3.0 * sigma), "g{}{}", r + 1, c + 1);
            assert!(c == 1 || sigma <= bounds[c / 2], "g{}{}: sigma {sigma}", r + 1, c + 1);
        }
        assert_attitude(document);
    };
    found(&replayed(&log), G_SIGMA_STANDARD);
    found(&replayed_with(&log, Model::without_tolerances), [G_SIGMA; 2]);
}

/// Accelerometer scale factors wrong by up to 1.4 %, three times the tolerance and more; an antenna 1.2 m ahead.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn what_is_wrong_with_scale_and_antenna_is_not_taken_for_g() {
    let folder = flights();
    for file in ["sitl_acc_scale.tlog", "sitl_gps_lever.tlog"] {
        let log = folder.join(file);
        let worst = |document: &Value| {
            g(document).into_iter().map(|(.., value, sigma)| value.abs() / sigma).fold(0.0, f64::max)
        };
        let (standard, exact) =
            (worst(&replayed(&log)), worst(&replayed_with(&log, Model::without_tolerances)));
        println!("{file}: G off by {standard:.1} sigma, without tolerances {exact:.1}");
        assert!(standard <= 3.0, "{file}: {standard} sigma");
        assert!(exact > 5.0, "{file}: {exact} sigma, so that tolerances prove nothing here");
    }
}

/// A receiver that interpolates between states 200 ms apart cuts corners short: T²/8.
const SMOOTHING_S2: f64 = 0.005;

/// What it makes of a turn and of the roll into it is not taken for an antenna elsewhere, nor for a delay.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_antenna_of_the_real_firmware_is_found_where_it_is() {
    for (log, antenna_m) in [("sitl_gps_lever.tlog", [1.2, 0.4, -0.3]), ("sitl_clean_dither.tlog", [0.0; 3])]
    {
        let document = replayed_with(&flights().join(log), |mut model| {
            model.set(EffectSetting::unknown(&GpsLeverArm));
            model
        });
        let effects = document["estimate"]["effects"].as_array().unwrap();
        let truth = antenna_m.into_iter().chain([SMOOTHING_S2]);
        for (name, truth) in ["lever_x", "lever_y", "lever_z", "smoothing"].into_iter().zip(truth) {
            let effect = effects.iter().find(|e| e["name"] == name).unwrap();
            let (value, sigma) = (effect["value"].as_f64().unwrap(), effect["sigma"].as_f64().unwrap());
            println!("{log} {name}: {value:.4} ± {sigma:.4}, true {truth}");
            assert!((value - truth).abs() <= 3.0 * sigma && sigma < 0.07, "{log} {name}: {value} ± {sigma}");
        }
    }
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn where_nothing_was_put_in_nothing_is_found() {
    let folder = flights();
    let document = replayed(&folder.join("sitl_clean_dither.tlog"));
    for (r, c, value, sigma) in g(&document) {
        println!("g{}{}: {value:7.1} ± {sigma:5.1} deg/h/g", r + 1, c + 1);
        assert!(value.abs() <= 3.0 * sigma, "g{}{}: {value} ± {sigma}", r + 1, c + 1);
    }
    assert_attitude(&document);
}

/// The results of the fixtures as they were when last looked at. After a change that is meant to change them:
/// `gaware replay tests/data/NAME.tlog --json`, and copy the fields that `NAME.baseline.json` has.
#[test]
fn the_small_flights_give_what_they_gave() {
    for name in ["small_clean_dither", "small_gsens_typical_dither"] {
        let (log, baseline) = (fixture(&format!("{name}.tlog")), fixture(&format!("{name}.baseline.json")));
        let (log, baseline) = (log.to_str().unwrap(), baseline.to_str().unwrap());
        let ended = gaware(&["replay", log, "--json", "--baseline", baseline]);
        assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
    }
    let (log, other) =
        (fixture("small_clean_dither.tlog"), fixture("small_gsens_typical_dither.baseline.json"));
    let ended = gaware(&["replay", log.to_str().unwrap(), "--json", "--baseline", other.to_str().unwrap()]);
    assert_eq!(ended.code(), Some(1));
    assert!(ended.stderr.contains("left its baseline"), "{}", ended.stderr);
}

/// The prior sigma of every element of G where no model is given, deg/h/g.
const PRIOR: f64 = 360.0;
/// What a flight must not claim.
struct Real {
    file: &'static str,
    phase: &'static str,
    /// Said in `waiting_for` or a warning.
    said: &'static str,
    /// Whether it flew with fixes; otherwise G must stay unknown.
    learns: bool,
    /// Mean NIS per degree of freedom, within a fifth.
    nis: f64,
    /// The largest element of G, deg/h/g: sensors of real vehicles have errors that the standard model lacks or expects to be smaller,
    /// and G absorbs them.
    g_within: f64,
}

const REAL: [Real; 7] = [
    Real {
        file: "real_ardusub_bench.tlog",
        phase: "waiting_for_gnss",
        said: "no GNSS fix",
        learns: false,
        nis: 0.0,
        g_within: 1.0,
    },
    Real {
        // After the reboot the autopilot sends one sample a second, and its attitude later than the first fix: that ends the search for the heading.
        file: "sitl_probe_udp_reboot_gpsloss.tlog",
        phase: "running",
        said: "rebooted",
        learns: false,
        nis: 0.0,
        g_within: 1.0,
    },
    Real {
        file: "real_copter_sample.BIN",
        phase: "running",
        said: "",
        learns: true,
        nis: 0.180,
        g_within: 100.0,
    },
    Real {
        file: "real_px4_sample.ulg",
        phase: "running",
        said: "no GNSS fix",
        learns: false,
        nis: 0.0,
        g_within: 30.0,
    },
    Real {
        file: "real_px4_ekf_failure.ulg",
        phase: "running",
        said: "",
        learns: true,
        nis: 0.264,
        g_within: 250.0,
    },
    Real {
        file: "real_apmplane_testlog2.tlog",
        phase: "running",
        said: "RAW_IMU",
        learns: true,
        nis: 0.552,
        g_within: 1600.0,
    },
    Real {
        file: "real_px4plane_swiss.tlog",
        phase: "running",
        said: "RAW_IMU",
        learns: true,
        nis: 0.593,
        g_within: 1050.0,
    },
];

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn real_logs_give_finite_numbers_and_an_honest_status() {
    let folder = flights();
    for real in &REAL {
        let document = replayed(&folder.join(real.file));
        support::assert_finite(&document, real.file);
        assert_eq!(document["phase"], real.phase, "{}", real.file);
        let told = format!("{} {}", document["waiting_for"], document["warnings"]);
        assert!(told.contains(real.said), "{}: {told}", real.file);
        let nis = document["consistency"]["nis_mean_per_dof"].as_f64().unwrap();
        assert!((nis - real.nis).abs() <= 0.2 * real.nis + 1e-3, "{}: NIS/dof {nis}", real.file);
        let elements = g(&document);
        for (r, c, value, sigma) in &elements {
            assert!(*sigma > 0.0 && *sigma <= 1.001 * PRIOR, "{}: g{r}{c} ± {sigma}", real.file);
            assert!(value.abs() < real.g_within, "{}: g{r}{c} {value}", real.file);
        }
        assert!(real.learns || elements.iter().all(|(.., sigma)| *sigma >= 0.97 * PRIOR), "{}", real.file);
        if !real.learns {
            let observability = &document["observability"];
            for condition in ["a", "b", "c"] {
                assert_eq!(
                    observability["conditions"][condition]["met"], false,
                    "{}: {condition}",
                    real.file
                );
            }
            let states = observability["states"].as_array().unwrap();
            for state in states.iter().filter(|s| s["name"].as_str().unwrap().starts_with('g')) {
                let status = state["status"].as_str().unwrap();
                assert!(!["observable", "converging"].contains(&status), "{}: {state}", real.file);
            }
        }
        let smallest = elements.iter().map(|e| e.3).fold(f64::INFINITY, f64::min);
        println!("{}: NIS/dof {nis:.3}, smallest sigma of G {smallest:.0} deg/h/g; {told}", real.file);
    }
}

/// Fixes that the autopilot takes for fresh turn its attitude in turns; ours is within 0.1° of the truth. What the motion does not decide is nobody's fault.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_worse_yaw_is_found_by_the_motion() {
    let folder = support::Folder::new("whose-yaw");
    let said = |log: &str| {
        let (log, page) = (flights().join(log), folder.file("report.html"));
        gaware(&["report", log.to_str().unwrap(), "--out", &page, "--force"]);
        std::fs::read_to_string(page).unwrap()
    };
    for late in ["sitl_gsens_lag280.tlog", "sitl_gps_lag350.tlog"] {
        assert!(said(late).contains("The autopilot's fits worse"), "{late}");
    }
    // An early autopilot with a compass and late fixes: 3.6 standard errors.
    assert!(
        said("real_px4plane_swiss.tlog").contains("The autopilot's is wrong</b>, its yaw off by -2"),
        "swiss"
    );
    assert!(said("sitl_clean_dither.tlog").contains("Both fit the motion alike"), "clean");
}
