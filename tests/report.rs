//! `gaware report`: the page that a pilot and an engineer read after a flight.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use std::fs;
use support::{Folder, fixture, flights, gaware};

#[test]
fn the_page_tells_what_replay_tells_and_needs_nothing_else() {
    let folder = Folder::new("report");
    let log = fixture("small_gsens_typical_dither.tlog");
    let (log, out) = (log.to_str().unwrap(), folder.file("page.html"));
    let made = gaware(&["report", log, "--out", &out]);
    assert_eq!(made.code(), Some(0), "{}", made.stderr);
    assert!(made.stdout.contains(&out), "{}", made.stdout);
    let page = fs::read_to_string(&out).unwrap();
    let replayed = gaware(&["replay", log, "--json"]).json();
    let g = &replayed["estimate"]["g_sensitivity_deg_per_h_per_g"];
    for (row, column) in (0..9).map(|k| (k / 3, k % 3)) {
        let of = |what: &str| g[what][row][column].as_f64().unwrap();
        let told = format!("{:.0} ± {:.0}", of("value"), of("sigma"));
        assert!(page.contains(&told), "g{}{} = {told} is not on the page", row + 1, column + 1);
    }
    for part in
        ["Track over the ground", "deg per minute", "The autopilot's own attitude", "in turns", "Innovations"]
    {
        assert!(page.contains(part), "{part} is missing");
    }
    let (body, scripts) = page.split_once("<script>").unwrap();
    for foreign in ["src=", "href=\"http", "<link", "NaN", "inf ", "RMS ["] {
        assert!(!body.contains(foreign), "{foreign} is on the page");
    }
    assert!(scripts.contains("uPlot") && !scripts.contains("import "), "plots need nothing else");
    for first in [
        "Is G large",
        "in a turn",
        "could not be seen",
        "Whose attitude",
        "What now",
        "gyro bias",
        "download=",
    ] {
        assert!(body.contains(first), "{first} is missing");
    }
}

#[test]
fn a_log_without_fixes_has_a_page_that_says_what_it_cannot_answer() {
    let folder = Folder::new("report-bench");
    let recording = folder.file("bench.tlog");
    let line =
        ["sim", "--scenario", "bench", "--listen", "tcpin:127.0.0.1:0", "--speed", "max", "--until", "30"];
    let faults = ["--fault", "gnss-loss@0-100", "--record", &recording];
    let vehicle = support::Gaware::start(&[&line[..], &faults[..]].concat());
    let address = vehicle.line();
    let station =
        support::Gaware::start(&["run", "--connect", &address, "--no-record", "--headless", "--json"]);
    assert_eq!(vehicle.ended().code(), Some(0));
    station.terminate();
    assert_eq!(station.ended().code(), Some(0));
    let out = folder.file("bench.html");
    let made = gaware(&["report", &recording, "--out", &out]);
    assert_eq!(made.code(), Some(0), "{}", made.stderr);
    let page = fs::read_to_string(&out).unwrap();
    // On the ground the place takes the part of the receiver: attitude is estimated, and nothing is said of G.
    for said in [
        "no 3-D fix in the whole flight",
        "It cannot answer g-sensitivity",
        "No g-sensitivity stands out of its uncertainty",
        "9 of 9 elements of G have not converged",
    ] {
        assert!(page.contains(said), "{said}: {page}");
    }
}

#[test]
fn a_page_that_cannot_be_written_is_told_with_its_place() {
    let log = fixture("small_gsens_typical_dither.tlog");
    let made = gaware(&["report", log.to_str().unwrap(), "--out", "/no/such/folder/page.html"]);
    assert_eq!(made.code(), Some(1));
    assert!(made.stderr.contains("/no/such/folder/page.html"), "{}", made.stderr);
}

/// Words of maneuvers that only an aircraft with wings flies.
const FIXED_WING: [&str; 9] = [
    "throttle",
    "rudder",
    "sideslip",
    "pull-up",
    "pull up",
    "wings level",
    "steep turn",
    "push-over",
    "bank beyond 45",
];

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn no_fixed_wing_maneuver_is_named_for_a_rotorcraft() {
    let recorded = flights();
    let folder = Folder::new("report-rotor");
    let out = folder.file("page.html");
    for (log, kind) in [
        ("qdr_p4rtk_xsensdot", "unknown"),
        ("real_copter_sample.BIN", "multirotor"),
        ("real_px4_sample.ulg", "multirotor"),
    ] {
        let path = recorded.join(log);
        let path = path.to_str().unwrap();
        for more in [&[][..], &["--airframe", "quadrotor"][..]] {
            let made = gaware(&[&["report", path, "--out", &out][..], more].concat());
            assert_eq!(made.code(), Some(0), "{}", made.stderr);
            let page = fs::read_to_string(&out).unwrap().to_lowercase();
            let page = page.split("<script").next().unwrap();
            for word in FIXED_WING {
                assert!(!page.contains(word), "{log}, {more:?}: {word}");
            }
        }
        let summary = gaware(&["replay", path, "--json"]);
        let document = summary.json();
        assert_eq!(document["vehicle_type"], kind, "{log}");
        let text = document["observability"].to_string().to_lowercase();
        assert!(FIXED_WING.iter().all(|w| !text.contains(w)), "{log}: {text}");
    }
}

/// The recorded flight of a copter, of which the logger says that it lost as many entries as it wrote.
fn half_lost(log: &mut [u8]) {
    // "FMT" of "DSF": type, length and name; the count of what was dropped stands behind the time.
    let format = log.windows(9).position(|w| w[..3] == [0xa3, 0x95, 0x80] && &w[5..9] == b"DSF\0").unwrap();
    let (kind, length) = (log[format + 3], usize::from(log[format + 4]));
    let entries: Vec<usize> =
        (0..log.len() - length).filter(|k| log[*k..*k + 3] == [0xa3, 0x95, kind]).collect();
    assert!(entries.len() > 50, "{}", entries.len());
    for (k, at) in entries.into_iter().enumerate() {
        log[at + 11..at + 15].copy_from_slice(&(1000 * k as u32).to_le_bytes());
    }
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_log_that_lost_much_of_its_flight_says_so_before_any_answer() {
    let folder = Folder::new("report-lossy");
    let mut bytes = fs::read(flights().join("real_copter_sample.BIN")).unwrap();
    let page_of = |bytes: &[u8], name: &str| {
        let (log, out) = (folder.file(&format!("{name}.bin")), folder.file(&format!("{name}.html")));
        fs::write(&log, bytes).unwrap();
        let made = gaware(&["report", &log, "--out", &out]);
        assert_eq!(made.code(), Some(0), "{}", made.stderr);
        fs::read_to_string(&out).unwrap()
    };
    assert!(!page_of(&bytes, "whole").contains("Rests on a part of the flight"));
    half_lost(&mut bytes);
    let page = page_of(&bytes, "lossy");
    let at = |what: &str| page.find(what).unwrap_or_else(|| panic!("{what}"));
    let told = at("Rests on a part of the flight: the logger lost");
    assert!(told < at("This log can answer") && told < at("Whose attitude is right?"));
    assert!(page.contains("For the next flight: log less"), "what to do about it");
}
