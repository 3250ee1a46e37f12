//! Hide, fly, explain, unseal: as a user does it, with the processes and files that a user has.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware_nav::math::hypot;
use gaware_nav::model::Model;
use support::{Folder, Gaware, Processors, flights, gaware};

/// A seed of `--hide-random` under which a delay of the fixes is hidden.
const SEED_OF_A_DELAY: &str = "34";

/// Flies a blind vehicle against `run`, which records; returns what the vehicle's process said.
fn fly(folder: &Folder, seed: &str) -> String {
    // With less than a processor the flight is another one.
    let _processor = Processors::take();
    let (recording, sealed) = (folder.file("flight.mcap"), folder.file("truth.toml"));
    let line = [
        "sim",
        "--scenario",
        "fixed_wing",
        "--listen",
        "tcpin:127.0.0.1:0",
        "--speed",
        "5",
        "--until",
        "140",
        "--hide-random",
        seed,
        "--sealed",
        &sealed,
    ];
    let vehicle = Gaware::start(&line);
    let address = vehicle.line();
    let station =
        Gaware::start(&["run", "--connect", &address, "--record", &recording, "--headless", "--json"]);
    let flown = vehicle.ended();
    assert_eq!(flown.code(), Some(0), "{}", flown.stderr);
    station.line_with("link is down");
    station.terminate();
    assert_eq!(station.ended().code(), Some(0));
    format!("{address}\n{}\n{}", flown.stdout, flown.stderr)
}

#[test]
fn what_was_hidden_by_chance_is_found_and_only_then_unsealed() {
    let folder = Folder::new("blind");
    let said = fly(&folder, SEED_OF_A_DELAY);
    let out = folder.file("out");
    let explained = gaware(&["explain", &folder.file("flight.mcap"), "--out", &out, "--json"]);
    assert_eq!(explained.code(), Some(0), "{}", explained.stderr);
    let document = explained.json();
    // Now the truth.
    let sealed = std::fs::read_to_string(folder.file("truth.toml")).unwrap();
    let truth = Model::from_toml(&sealed).unwrap();
    let hidden =
        truth.get("gps_latency").unwrap_or_else(|| panic!("another effect under this seed:\n{sealed}"));
    assert!(!said.contains("latency") && !said.contains("hidden"), "the process told: {said}");
    assert_eq!(document["effects"][0]["names"], serde_json::json!(["gps_latency"]), "{document:#}");
    let found = &document["effects"][0]["parameters"]["gps_latency"];
    let (value, sigma) = (found["value_s"].as_f64().unwrap(), found["sigma_s"].as_f64().unwrap());
    // Samples are stamped when they are sent, up to a loop of 2.5 ms late.
    assert!(
        (value - hidden.values[0]).abs() < 4.0 * sigma + 0.005,
        "{value} ± {sigma}, hidden {:?}",
        hidden.values
    );
    assert_eq!(document["verdict"], "explained", "{document:#}");
    let held_out = &document["gap"]["held_out"];
    assert!(held_out["after"].as_f64() < held_out["before"].as_f64(), "{held_out}");
    // The new model is one that every command reads.
    let model = std::fs::read_to_string(std::path::Path::new(&out).join("model.toml")).unwrap();
    assert!(Model::from_toml(&model).unwrap().get("gps_latency").is_some());
}

/// A model is the simulation: what it says is what flies, and what an estimation that knows nothing of it finds.
#[test]
fn a_model_given_to_the_simulation_is_what_flies() {
    let folder = Folder::new("model");
    let model = folder.file("model.toml");
    let text = "schema = \"gaware.model/1\"\n[effects.gps_latency]\nvalue_s = 0.31\nsigma_s = 0.004\n\
                [effects.accel_bias_drift]\nvalue_mg_per_rth = 2.0\n";
    std::fs::write(&model, text).unwrap();
    let line =
        ["sim", "--listen", "tcpin:127.0.0.1:0", "--speed", "max", "--until", "110", "--model", &model];
    let vehicle = Gaware::start(&line);
    let address = vehicle.line();
    let station = Gaware::start(&["run", "--connect", &address, "--no-record", "--headless", "--json"]);
    assert_eq!(vehicle.ended().code(), Some(0));
    station.line_with("link is down");
    station.terminate();
    let summary = station.ended().json();
    let latency = &summary["estimate"]["effects"][0];
    let (value, sigma) = (latency["value"].as_f64().unwrap(), latency["sigma"].as_f64().unwrap());
    // Samples are stamped when they are sent, up to a loop of 2.5 ms late.
    assert!((value - 0.31).abs() < 4.0 * sigma + 0.005, "{value} ± {sigma}");
    let g = &summary["estimate"]["g_sensitivity_deg_per_h_per_g"];
    let (g33, sigma) = (g["value"][2][2].as_f64().unwrap(), g["sigma"][2][2].as_f64().unwrap());
    assert!(g33.abs() < 3.0 * sigma, "the scenario's own G is gone: {g33} ± {sigma}");
}

/// PX4 from standing to after landing, with fixes that are 120 ms old and nothing else. It slows down along one line after touchdown, and PX4
/// changes the offsets of the accelerometers by 7 mg when it is disarmed.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_landing_is_no_step() {
    let folder = Folder::new("landing");
    let (log, out) = (flights().join("px4_touchdown.tlog"), folder.file("out"));
    let document = gaware(&["explain", log.to_str().unwrap(), "--out", &out, "--json"]).json();
    assert_eq!(document["verdict"], "explained", "{document:#}");
    let names: Vec<String> =
        document["effects"].as_array().unwrap().iter().map(|e| e["names"].to_string()).collect();
    assert_eq!(names, [r#"["gps_latency"]"#], "{document:#}");
    let found = &document["effects"][0]["parameters"]["gps_latency"];
    let (value, sigma) = (found["value_s"].as_f64().unwrap(), found["sigma_s"].as_f64().unwrap());
    assert!((value - 0.12).abs() < 2.5 * sigma, "{value} ± {sigma}");
}

/// The link and the autopilot's own log date a fix by its arrival: `GPS_RAW_INT` and `GPA.SMS` are the same stamp (82 ms after the time of
/// validity in this simulation, `SIM2` against `GPS`; the log's own time is 22 ms later), and EKF3 counts from it.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn both_recordings_of_one_flight_show_the_same_latency() {
    let data = flights();
    let folder = Folder::new("both");
    let latency = |name: &str| {
        let (log, out) = (data.join(name), folder.file(name));
        let document = gaware(&["explain", log.to_str().unwrap(), "--out", &out, "--json"]).json();
        let found = &document["effects"][0]["parameters"]["gps_latency"];
        (found["value_s"].as_f64().unwrap(), found["sigma_s"].as_f64().unwrap(), document)
    };
    let (link, link_sigma, _) = latency("sitl_gsens_typical_dither.tlog");
    let (log, log_sigma, document) = latency("sitl_gsens_typical_dither_cut.BIN");
    println!("link {link} ± {link_sigma} s, log {log} ± {log_sigma} s");
    assert!((link - log).abs() < 2.0 * hypot(link_sigma, log_sigma), "{link} and {log}");
    // Behind the low-pass of the samples; before it, where EKF3 takes them, it is what the truth says.
    let proposals = document["autopilot"]["proposals"].as_array().unwrap();
    let delay = proposals.iter().find(|p| p["parameter"] == "GPS1_DELAY_MS").unwrap();
    let (value, sigma) = (delay["proposed"].as_f64().unwrap(), delay["sigma"].as_f64().unwrap());
    assert!((value - 83.0).abs() < 2.0 * sigma, "{delay:#}");
}

/// A telemetry log without the frames that were lost, by the seconds since its start, their number and their message.
fn without(log: &[u8], lost: impl Fn(f64, usize, u32) -> bool) -> Vec<u8> {
    let stamp = |at: usize| u64::from_be_bytes(log[at..at + 8].try_into().unwrap());
    let (mut out, mut at, mut number) = (Vec::new(), 0, 0);
    while at + 18 < log.len() {
        let payload = usize::from(log[at + 9]);
        let length = match log[at + 8] {
            0xfd => 12 + payload + if log[at + 10] & 1 == 1 { 13 } else { 0 },
            0xfe => 8 + payload,
            other => panic!("no frame begins with {other:#x}"),
        };
        let end = (at + 8 + length).min(log.len());
        let message = match log[at + 8] {
            0xfd => u32::from_le_bytes([log[at + 15], log[at + 16], log[at + 17], 0]),
            _ => u32::from(log[at + 13]),
        };
        if !lost((stamp(at) - stamp(0)) as f64 * 1e-6, number, message) {
            out.extend_from_slice(&log[at..end]);
        }
        (at, number) = (end, number + 1);
    }
    out
}

/// Gaps of a second or two in turns, and single frames lost: the same is found, with the same value.
#[test]
fn losses_of_telemetry_change_nothing() {
    let folder = Folder::new("losses");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/small_clean_dither.tlog");
    let log = std::fs::read(path).unwrap();
    let gaps = [(37.3, 38.2), (72.8, 73.5), (98.3, 99.7), (115.7, 117.5)];
    let in_gap = |t_s: f64, _: usize, _: u32| gaps.iter().any(|(from, to)| (*from..*to).contains(&t_s));
    // Begin and length; most in turns, a fifth of the flight.
    let many = [
        (37.7, 1.85),
        (43.9, 0.92),
        (49.1, 2.62),
        (59.0, 2.86),
        (66.9, 1.97),
        (74.3, 1.6),
        (81.0, 1.74),
        (87.0, 1.62),
        (95.7, 1.65),
        (103.4, 2.47),
        (110.0, 1.03),
        (115.2, 1.14),
        (122.8, 1.58),
        (129.7, 0.58),
        (134.5, 0.57),
        (139.2, 2.65),
    ];
    let in_many =
        |t_s: f64, _: usize, _: u32| many.iter().any(|(from, long)| (*from..from + long).contains(&t_s));
    let one_in_33 = |_: f64, number: usize, _: u32| (number * 7919 + 13).is_multiple_of(33);
    let latency = |name: &str, log: &[u8]| {
        let file = folder.file(&format!("{name}.tlog"));
        std::fs::write(&file, log).unwrap();
        let explained = gaware(&["explain", &file, "--out", &folder.file(name), "--json"]);
        let document = explained.json();
        let names: Vec<_> =
            document["effects"].as_array().unwrap().iter().map(|e| e["names"].clone()).collect();
        assert_eq!(names, [serde_json::json!(["gps_latency"])], "{name}: {document:#}");
        let found = &document["effects"][0]["parameters"]["gps_latency"];
        (found["value_s"].as_f64().unwrap(), found["sigma_s"].as_f64().unwrap())
    };
    let (value, sigma) = latency("whole", &log);
    for (name, cut, wider) in [
        ("gaps", without(&log, in_gap), 1.5),
        ("single", without(&log, one_in_33), 1.5),
        ("sixteen", without(&log, in_many), 2.0),
    ] {
        assert!(cut.len() < log.len() - 10_000);
        let (other, other_sigma) = latency(name, &cut);
        assert!((other - value).abs() < sigma, "{name}: {other}, whole {value} ± {sigma}");
        assert!(other_sigma < wider * sigma, "{name}: ± {other_sigma}, whole ± {sigma}");
    }
}

/// Gaps in which the vehicle rolled by 76° unseen: the autopilot's own attitude says how much they hide, so that no correct name is lost
/// and no other comes.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_turn_that_no_sample_shows_costs_no_name() {
    let data = flights();
    let folder = Folder::new("unseen");
    let log = std::fs::read(data.join("sitl_gps_lever.tlog")).unwrap();
    // The last three minutes, with gaps.
    let gaps = [(480.0, 2.85), (521.9, 1.04), (553.9, 0.57), (603.7, 1.59), (633.4, 1.08)];
    let lost = |t_s: f64, _: usize, _: u32| {
        t_s < 430.0 || gaps.iter().any(|(from, long)| (*from..from + long).contains(&t_s))
    };
    let file = folder.file("gaps.tlog");
    std::fs::write(&file, without(&log, lost)).unwrap();
    let explained = gaware(&["explain", &file, "--out", &folder.file("out"), "--json"]);
    let document = explained.json();
    let mut names: Vec<_> =
        document["effects"].as_array().unwrap().iter().map(|e| e["names"].to_string()).collect();
    names.sort_unstable();
    assert_eq!(names, [r#"["gps_latency"]"#, r#"["gps_lever_arm"]"#], "{document:#}");
    let lever =
        document["effects"].as_array().unwrap().iter().find(|e| e["names"][0] == "gps_lever_arm").unwrap();
    let parameters = &lever["parameters"]["gps_lever_arm"];
    for (axis, truth) in [1.2, 0.4, -0.3].into_iter().enumerate() {
        let value = parameters["value_m"][axis].as_f64().unwrap();
        let sigma = parameters["sigma_m"][axis].as_f64().unwrap();
        assert!((value - truth).abs() < 3.0 * sigma && sigma < 0.1, "{axis}: {value} ± {sigma}");
    }
}

/// Without the autopilot's attitude a gap that may hide a roll ends what can be explained: the result says how much is left out.
#[test]
fn without_an_attitude_gaps_are_left_out_and_the_result_says_so() {
    let folder = Folder::new("blind_gaps");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/small_clean_dither.tlog");
    let log = std::fs::read(path).unwrap();
    const ATTITUDE: u32 = 30;
    let lost = |t_s: f64, _: usize, message: u32| {
        message == ATTITUDE || (20.0..22.5).contains(&t_s) || (110.0..112.8).contains(&t_s)
    };
    let file = folder.file("blind.tlog");
    std::fs::write(&file, without(&log, lost)).unwrap();
    let explained = gaware(&["explain", &file, "--out", &folder.file("out"), "--json"]);
    let document = explained.json();
    let names: Vec<_> = document["effects"].as_array().unwrap().iter().map(|e| e["names"].clone()).collect();
    assert!(names.is_empty() || names == [serde_json::json!(["gps_latency"])], "{document:#}");
    let summary = document["summary"].as_str().unwrap();
    assert!(summary.contains("left out") && summary.contains("ATTITUDE"), "{summary}");
}

#[test]
fn an_interrupted_explanation_says_so_and_leaves_nothing() {
    let folder = Folder::new("interrupted");
    let out = folder.file("out");
    let log = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/small_clean_dither.tlog");
    let explained = Gaware::start(&["explain", log, "--out", &out]);
    explained.line_with("step 2 of 4");
    explained.signal("-INT");
    explained.line_with("interrupted: no report was written");
    assert_eq!(explained.ended().code(), Some(130));
    assert!(!std::path::Path::new(&out).exists());
}
