//! The ground session: over real wires against hands that make mistakes, and on recordings that other programs made.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use serde_json::Value;
use support::{Folder, Gaware, flights, gaware};

/// Names of the elements of G that a document calls observable.
fn observable(document: &Value) -> usize {
    let states = document["observability"]["states"].as_array().unwrap().iter();
    let g = |s: &&Value| s["name"].as_str().is_some_and(|n| n.len() == 3 && n.starts_with('g'));
    states.filter(g).filter(|s| s["status"] == "observable").count()
}

/// Error over sigma of each element, and its sigma, deg/h/g.
fn against(estimate: &Value, truth: &[[f64; 3]; 3]) -> Vec<(f64, f64)> {
    let g = &estimate["g_sensitivity_deg_per_h_per_g"];
    let cell = |what: &str, i: usize, j: usize| g[what][i][j].as_f64().unwrap();
    let all = (0..9).map(|k| (k / 3, k % 3));
    all.map(|(i, j)| {
        let sigma = cell("sigma", i, j);
        ((cell("value", i, j) - truth[i][j]) / sigma, sigma)
    })
    .collect()
}

/// What the simulated unit has.
const SIMULATED: [[f64; 3]; 3] = [[150.0, 30.0, -60.0], [-45.0, 130.0, 50.0], [25.0, -35.0, -170.0]];

/// No fix in the whole session.
const INDOORS: [&str; 2] = ["--fault", "gnss-loss@0-9000"];

/// A simulated vehicle in people's hands.
fn in_hands(scenario: &str, more: &[&str]) -> Gaware {
    let sim = ["sim", "--scenario", scenario, "--listen", "tcpin:127.0.0.1:0", "--speed", "25"];
    Gaware::start(&[&sim[..], more].concat())
}

/// A simulated vehicle in people's hands, without GNSS, and the session with these arguments; what the session said and gave.
fn session(scenario: &str, more: &[&str]) -> (Vec<String>, support::Ended) {
    let vehicle = in_hands(scenario, &INDOORS);
    let address = vehicle.line();
    let station =
        Gaware::start(&[&["ground", "--connect", &address, "--no-record", "--json"], more].concat());
    let ended = station.ended();
    let said = ended.stderr.lines().map(str::to_owned).collect();
    (said, ended)
}

#[test]
fn hands_that_make_mistakes_are_led_through_six_sides_without_gnss() {
    let folder = Folder::new("ground");
    let unit = folder.file("unit.toml");
    let (said, ended) = session("hand_mistakes", &["--unit", &unit, "--home", "47.4,8.5"]);
    assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
    let result = ended.json();
    assert_eq!(result["schema"], "gaware.ground/1");
    assert_eq!(result["session"]["done"], true, "{result:#}");
    let sides = result["session"]["sides"].as_array().unwrap();
    assert!(sides.iter().all(|s| s["done"] == true), "{sides:#?}");
    let named = result["observable"].as_array().unwrap();
    for element in ["g11", "g12", "g13", "g21", "g22", "g23", "g31", "g32", "g33"] {
        assert!(named.iter().any(|n| n == element), "{element} of {named:?}");
    }
    for (z, sigma) in against(&result["estimate"], &SIMULATED) {
        assert!(z.abs() < 4.0 && sigma < 40.0, "{z} {sigma}: {result:#}");
    }
    // At 25 times real time an instruction between two sides may pass between two looks of the screen; a hold does not.
    for words in ["Hold still nose up", "Hold still upside down"] {
        assert!(said.iter().any(|line| line.contains(words)), "{words}: {said:?}");
    }
    let shown = gaware(&["unit", "show", &unit, "--json"]);
    assert_eq!(shown.code(), Some(0), "{}", shown.stderr);
    let shown = shown.json();
    assert!(shown["measured"].as_array().unwrap().iter().any(|n| n == "g33"), "{shown:#}");
}

/// Without a file's name the result is kept under the hardware id that the vehicle reports, and a replay of the recording finds it by that.
#[test]
fn the_file_of_a_unit_is_kept_and_found_by_its_hardware_id() {
    let folder = Folder::new("ground-units");
    let (log, units) = (folder.file("session.mcap"), folder.file("units"));
    let vehicle = in_hands("hand", &INDOORS);
    let address = vehicle.line();
    let args = [
        "ground",
        "--connect",
        &address,
        "--record",
        &log,
        "--units",
        &units,
        "--home",
        "47.4,8.5,488",
        "--json",
    ];
    let ended = Gaware::start(&args).ended();
    assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
    let file = ended.json()["unit"].as_str().unwrap().to_owned();
    let shown = gaware(&["unit", "show", &file, "--json"]).json();
    let id = shown["unit"]["origin"]["hardware_id"].as_str().unwrap().to_owned();
    assert!(file.starts_with(&units) && file.ends_with(&format!("{id}.toml")), "{file} {id}");
    assert_eq!(shown["unit"]["origin"]["from"], serde_json::json!(["session.mcap"]));
    // The session that made the file is not told by it what it has shown.
    let replayed = gaware(&["replay", &log, "--units", &units, "--json"]);
    assert_eq!(replayed.code(), Some(0), "{}", replayed.stderr);
    assert!(!replayed.stderr.contains("begins from"), "{}", replayed.stderr);
    begins_anew_with(&folder, &units, &format!("unit {id}: begins from {file}"));
}

/// A run finds the file of the vehicle once that has named itself, begins anew with it, and its replay is the same to the last byte; other logs
/// of the vehicle find it too.
fn begins_anew_with(folder: &Folder, units: &str, said: &str) {
    let (log, tlog) = (folder.file("run.mcap"), folder.file("run.tlog"));
    let vehicle = in_hands("hand", &["--until", "40", "--record", &tlog]);
    let address = vehicle.line();
    let run = ["run", "--connect", &address, "--record", &log, "--units", units, "--headless", "--json"];
    let station = Gaware::start(&run);
    assert_eq!(vehicle.ended().code(), Some(0));
    station.line_with(said);
    station.line_with("link is down");
    station.terminate();
    let live = station.ended();
    assert_eq!(live.code(), Some(0), "{}", live.stderr);
    // One side alone shows nothing of G: what is known comes from the file.
    let sigmas = live.json()["estimate"]["g_sensitivity_deg_per_h_per_g"]["sigma"].clone();
    let known = |v: &Value| v.as_f64().is_some_and(|s| s < 30.0);
    assert!(sigmas.as_array().unwrap().iter().flat_map(|r| r.as_array().unwrap()).all(known), "{sigmas}");
    let again = gaware(&["replay", &log, "--json"]);
    assert_eq!(live.stdout, again.stdout, "{}", live.stderr);
    let of_log = |more: &[&str]| gaware(&[&["replay", &tlog, "--units", units, "--json"], more].concat());
    let found = of_log(&[]);
    assert!(found.code() == Some(0) && found.stderr.contains(said), "{}", found.stderr);
    assert!(!of_log(&["--no-unit"]).stderr.contains("begins from"));
}

#[test]
fn an_armed_vehicle_is_refused() {
    let vehicle = Gaware::start(&[
        "sim",
        "--scenario",
        "fixed_wing",
        "--listen",
        "tcpin:127.0.0.1:0",
        "--speed",
        "5",
        "--no-wait",
    ]);
    let address = vehicle.line();
    let ended = gaware(&["ground", "--connect", &address, "--no-record"]);
    assert_eq!(ended.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("no ground session: the vehicle is armed"), "{}", ended.stderr);
}

#[test]
fn a_session_that_ends_early_says_what_is_left_and_wrong_arguments_are_named() {
    let (_, ended) = session("hand", &["--duration", "4"]);
    assert_eq!(ended.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("of 6 sides done"), "{}", ended.stderr);
    let wrong = gaware(&["ground", "--connect", "udpin:127.0.0.1:0", "--skip", "sideways"]);
    assert_eq!(wrong.code(), Some(2), "{}", wrong.stderr);
    assert!(wrong.stderr.contains("nose-up"), "{}", wrong.stderr);
    let place = gaware(&["replay", "x.tlog", "--home", "95,8"]);
    let said = ["--home", "in degrees, as in 47.4,8.5"].iter().all(|part| place.stderr.contains(part));
    assert!(place.code() == Some(2) && said, "{}", place.stderr);
}

/// G of a recording's truth, deg/h/g.
fn truth(name: &str) -> [[f64; 3]; 3] {
    part_of_truth(name, "G")
}

fn part_of_truth<T: serde::de::DeserializeOwned>(name: &str, part: &str) -> T {
    let text = std::fs::read_to_string(flights().join(format!("{name}.truth.json"))).unwrap();
    let truth: Value = serde_json::from_str(&text).unwrap();
    serde_json::from_value(truth[part].clone()).unwrap()
}

/// Nine of nine elements at 5 to 16 deg/h/g and within three sigma.
fn judge(document: &Value, truth: &[[f64; 3]; 3]) {
    assert_eq!(observable(document), 9, "{document:#}");
    for (z, sigma) in against(&document["estimate"], truth) {
        assert!(z.abs() < 3.0 && (4.0..16.5).contains(&sigma), "{z} {sigma}");
    }
}

/// The recorded sessions, explained: G and the scale factors are named with their values, and no formula is: nothing that other programs put in needs one.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn recorded_sessions_are_explained_with_and_without_gnss() {
    let folder = Folder::new("ground-explain");
    for name in ["independent_hand_six", "independent_hand_six_no_gnss"] {
        let log = flights().join(format!("{name}.tlog"));
        let out = folder.file(name);
        let ended = gaware(&["explain", log.to_str().unwrap(), "--out", &out, "--json"]);
        assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
        let found = ended.json();
        let of = |effect: &str| {
            let named = found["effects"].as_array().unwrap().iter();
            let mut own = named
                .filter(|e| e["names"] == serde_json::json!([effect]))
                .map(|e| e["parameters"][effect].clone());
            own.next_back().unwrap_or_else(|| panic!("{effect} of {name}: {}", found["summary"]))
        };
        let g = of("gyro_g_sensitivity");
        for (i, row) in truth(name).iter().enumerate() {
            for (j, truth) in row.iter().enumerate() {
                let cell = |what: &str| g[what][i][j].as_f64().unwrap();
                let (value, sigma) = (cell("value_deg_per_h_per_g"), cell("sigma_deg_per_h_per_g"));
                assert!(
                    (value - truth).abs() < 3.0 * sigma && sigma < 16.0,
                    "{name} g{i}{j}: {value} ± {sigma}, {truth}"
                );
            }
        }
        // Without fixes scale factors of the gyros are too small to be named.
        let gyros = (!name.ends_with("no_gnss")).then_some(("gyro_scale_factor", "gs"));
        for (effect, axes) in [("accel_scale_factor", "sa")].into_iter().chain(gyros) {
            let own = of(effect);
            for (k, truth) in part_of_truth::<[f64; 3]>(name, axes).iter().enumerate() {
                let ppm = |what: &str| own[what][k].as_f64().unwrap();
                let (value, sigma) = (ppm("value_ppm"), ppm("sigma_ppm"));
                assert!((value - truth).abs() < 3.0 * sigma, "{name} {axes}{k}: {value} ± {sigma}, {truth}");
            }
        }
        // White noise of .06 deg/s at 50 Hz, which fixes show, or the samples where there are none.
        let noise = found["noise"].as_array().unwrap().iter().find(|n| n["name"] == "gyro").unwrap();
        let fitted = noise["fitted"].as_f64().unwrap();
        assert!((fitted / 0.0085 - 1.0).abs() < 0.15, "{name}: {fitted} deg/s/√Hz");
        let named = found["effects"].as_array().unwrap().iter().flat_map(|e| e["names"].as_array().unwrap());
        let formulas: Vec<_> = named.filter(|n| n.as_str().unwrap().starts_with("formula:")).collect();
        assert!(formulas.is_empty(), "{name}: {formulas:?}");
    }
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn all_of_g_is_observable_on_recorded_sessions_with_and_without_gnss() {
    for name in ["independent_hand_six", "independent_hand_six_no_gnss"] {
        let log = flights().join(format!("{name}.tlog"));
        let replayed = gaware(&["replay", log.to_str().unwrap(), "--json"]);
        assert_eq!(replayed.code(), Some(0), "{name}: {}", replayed.stderr);
        judge(&replayed.json(), &truth(name));
    }
}

/// The frames of a recording that `keep` lets through, by message id and whether the vehicle was level then.
fn thinned(name: &str, to: &str, keep: impl Fn(u32, bool) -> bool) {
    const GPS_RAW_INT: u32 = 24;
    const ATTITUDE: u32 = 30;
    let log = std::fs::read(flights().join(format!("{name}.tlog"))).unwrap();
    let (mut out, mut at, mut level) = (Vec::new(), 0, true);
    while at + 20 <= log.len() {
        let frame = &log[at + 8..];
        let length = 12 + usize::from(frame[1]);
        let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
        if id == ATTITUDE {
            let angle = |k: usize| f32::from_le_bytes(frame[k..k + 4].try_into().unwrap());
            level = angle(14).abs() < 0.5 && angle(18).abs() < 0.5;
        }
        if id != GPS_RAW_INT || keep(id, level) {
            out.extend_from_slice(&log[at..at + 8 + length]);
        }
        at += 8 + length;
    }
    std::fs::write(to, out).unwrap();
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn an_antenna_that_is_covered_unless_the_vehicle_is_level_costs_nothing() {
    let folder = Folder::new("covered");
    let name = "independent_hand_six";
    let log = folder.file("covered.tlog");
    thinned(name, &log, |_, level| level);
    let replayed = gaware(&["replay", &log, "--json"]);
    assert_eq!(replayed.code(), Some(0), "{}", replayed.stderr);
    judge(&replayed.json(), &truth(name));
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_unit_keeps_what_a_recording_shows_and_finds_another_unit_out() {
    let folder = Folder::new("unit");
    let unit = folder.file("unit.toml");
    let [first, second] = ["independent_hand_six", "independent_hand_six_no_gnss"]
        .map(|name| flights().join(format!("{name}.tlog")).to_str().unwrap().to_owned());
    let added = gaware(&["unit", "add", &unit, &first, "--json"]);
    assert_eq!(added.code(), Some(0), "{}", added.stderr);
    assert_eq!(added.json()["inconsistencies"].as_array().unwrap().len(), 0);
    let same = gaware(&["unit", "check", &unit, &first]);
    assert_eq!(same.code(), Some(0), "{}", same.stderr);
    let other = gaware(&["unit", "check", &unit, &second]);
    assert_eq!(other.code(), Some(1), "{}", other.stdout);
    assert!(other.stdout.contains("inconsistent: ") && other.stdout.contains("g33"), "{}", other.stdout);
}
