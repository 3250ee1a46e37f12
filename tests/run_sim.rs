//! `gaware run` against `gaware sim`, both as processes over real wires, and the replay of what was recorded.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use gaware::logs::{self, Item};
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use mcap::MessageStream;
use mcap::read::Options;
use std::io::{Read, Write};
use std::path::Path;
use support::{Folder, Gaware, gaware};

/// Flies `sim` with these arguments, lets `run` listen until the flight is over, and replays its recording: both must
/// print the same document to the last byte.
fn replay_repeats_run(name: &str, sim: &[&str]) -> serde_json::Value {
    let folder = Folder::new(name);
    let recording = folder.file("flight.mcap");
    let vehicle = Gaware::start(&[&["sim"], sim].concat());
    let address = vehicle.line();
    let station =
        Gaware::start(&["run", "--connect", &address, "--record", &recording, "--headless", "--json"]);
    let flown = vehicle.ended();
    assert_eq!(flown.code(), Some(0), "{}", flown.stderr);
    if address.starts_with("tcpout:") {
        // Everything has been read when the end is.
        station.line_with("link is down");
    }
    station.terminate();
    let live = station.ended();
    assert_eq!(live.code(), Some(0), "{}", live.stderr);
    let again = gaware(&["replay", &recording, "--json"]);
    assert_eq!(again.code(), Some(0), "{}", again.stderr);
    assert_eq!(live.stdout, again.stdout, "run and replay of {name} differ\n{}", live.stderr);
    let document = live.json();
    assert_eq!(document["schema"], "gaware.summary/1");
    assert_eq!(document["phase"], "running", "{document:#}");
    support::assert_finite(&document, name);
    document
}

#[test]
fn over_tcp_the_replay_equals_the_run_byte_for_byte() {
    let document = replay_repeats_run(
        "tcp",
        &["--scenario", "fixed_wing", "--listen", "tcpin:127.0.0.1:0", "--speed", "max", "--until", "60"],
    );
    assert_eq!(document["autopilot"], "ardupilot");
    // The flight runs ahead while a busy station still asks for its rates; the rest has to arrive.
    assert!(document["imu"]["samples"].as_u64().unwrap() > 3_000, "{document:#}");
    assert!(document["gnss"]["used"].as_u64().unwrap() > 50, "{document:#}");
}

#[test]
fn over_udp_the_replay_equals_the_run_byte_for_byte() {
    let document = replay_repeats_run(
        "udp",
        &["--scenario", "fixed_wing", "--listen", "udpin:127.0.0.1:0", "--speed", "10", "--until", "40"],
    );
    assert!(document["imu"]["samples"].as_u64().unwrap() > 3_000, "{document:#}");
}

#[test]
fn over_a_pseudo_terminal_the_replay_equals_the_run_byte_for_byte() {
    let document = replay_repeats_run(
        "pty",
        &[
            "--scenario",
            "fixed_wing",
            "--autopilot",
            "px4",
            "--listen",
            "pty",
            "--speed",
            "10",
            "--until",
            "40",
        ],
    );
    assert_eq!(document["autopilot"], "px4");
    assert!(document["imu"]["samples"].as_u64().unwrap() > 3_000, "{document:#}");
}

#[test]
fn a_link_that_loses_and_damages_frames_and_a_reboot_change_nothing_about_that() {
    let document = replay_repeats_run(
        "faults",
        &[
            "--scenario",
            "fixed_wing",
            "--listen",
            "tcpin:127.0.0.1:0",
            "--speed",
            "10",
            "--until",
            "60",
            "--fault",
            "loss=0.02",
            "--fault",
            "reboot@30",
            "--fault",
            "gnss-loss@40-50",
        ],
    );
    let told = document["warnings"].to_string();
    assert!(told.contains("restart") || told.contains("reboot"), "{told}");
}

/// Flight time of the last inertial message of a log, s, and how many frames it holds.
fn end_of(log: &Path) -> (f64, usize) {
    let (mut last_s, mut frames) = (0.0, 0);
    for record in logs::open(log).unwrap().map_while(Result::ok) {
        let Item::Frame(frame) = record.item else { continue };
        frames += 1;
        if let Ok(MavMessage::RAW_IMU(imu)) = frame.decode() {
            last_s = imu.time_usec as f64 * 1e-6;
        }
    }
    (last_s, frames)
}

#[test]
fn after_kill_9_the_recording_lacks_at_most_a_second() {
    let folder = Folder::new("kill");
    let (recording, truth) = (folder.file("flight.mcap"), folder.file("flight.tlog"));
    // At the speed of the wall clock, as the second that may be missing is one of the wall clock.
    let vehicle = Gaware::start(&[
        "sim",
        "--scenario",
        "fixed_wing",
        "--listen",
        "udpin:127.0.0.1:0",
        "--until",
        "7",
        "--no-wait",
        "--record",
        &truth,
    ]);
    let address = vehicle.line();
    let station =
        Gaware::start(&["run", "--connect", &address, "--record", &recording, "--headless", "--json"]);
    // The vehicle ends while the station, over UDP, still believes in the flight.
    assert_eq!(vehicle.ended().code(), Some(0));
    station.kill();

    let (sent_s, _) = end_of(Path::new(&truth));
    let (recorded_s, frames) = end_of(Path::new(&recording));
    assert!(sent_s > 6.0, "the flight was too short to prove anything: {sent_s} s");
    assert!(recorded_s <= sent_s && sent_s - recorded_s <= 1.0, "{recorded_s} s recorded of {sent_s} s");

    // By the rules of the mcap crate, without its own reader: every message up to the unfinished end.
    let bytes = std::fs::read(&recording).unwrap();
    let whole = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into())
        .unwrap()
        .map_while(Result::ok)
        .filter(|m| m.channel.topic.starts_with("/mavlink/"))
        .count();
    assert!(whole >= frames && frames > 500, "{whole} by the crate, {frames} by our reader");

    let again = gaware(&["replay", &recording, "--json"]);
    assert_eq!(again.code(), Some(0), "{}", again.stderr);
    let document = again.json();
    assert_eq!(document["log_damage"]["truncated"], true, "{document:#}");
    assert!(document["imu"]["samples"].as_u64().unwrap() > 500);
    support::assert_finite(&document, "killed");
}

/// A vehicle that flies for a minute at ten times the speed of time, and ends.
fn a_minute_of_flight() -> Gaware {
    let flight = ["--scenario", "fixed_wing", "--speed", "10", "--until", "60"];
    Gaware::start(&[&["sim", "--listen", "tcpin:127.0.0.1:0"][..], &flight[..]].concat())
}

/// Messages that a status line says were skipped.
fn skipped(line: &str) -> u64 {
    let words: Vec<&str> = line.split("; ").collect();
    words.iter().find_map(|w| w.strip_suffix(" skipped")?.parse().ok()).unwrap_or(0)
}

#[test]
fn a_full_disk_costs_only_what_it_cannot_hold_and_that_is_counted_and_shown() {
    let folder = Folder::new("full");
    let recording = folder.file("flight.mcap");
    let vehicle = a_minute_of_flight();
    let address = vehicle.line();
    // 256 kB: some seconds of this flight.
    let station = Gaware::start_on_a_small_disk(
        512,
        &["run", "--connect", &address, "--record", &recording, "--headless", "--json"],
    );
    station.line_with("recording failed, messages are lost");
    let shown = station.line_with("RECORDER FAILED");
    assert!(shown.contains("not written"), "{shown}");
    assert_eq!(vehicle.ended().code(), Some(0));
    // Told once, so before the next count.
    station.line_with("link is down");
    let last = station.line_with(" skipped");
    assert!(skipped(&last) > 0, "{last}");
    station.terminate();
    let ended = station.ended();
    // The recording is not what was asked for: told in the sentence, the status and the result.
    assert_eq!(ended.code(), Some(1), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("gaware: the recording") && ended.stderr.contains(" lacks "),
        "{}",
        ended.stderr
    );
    // The estimation has seen the whole flight.
    let document = ended.json();
    assert!(document["recording"]["failed"].as_u64().unwrap() > 0, "{document:#}");
    assert!(document["warnings"].to_string().contains(" lacks "), "{document:#}");
    assert_eq!(document["phase"], "running", "{document:#}");
    assert!(document["duration_s"].as_f64().unwrap() > 50.0, "{document:#}");
    assert!(document["imu"]["samples"].as_u64().unwrap() > 3_000, "{document:#}");
    // What the disk could hold is there and can be read.
    assert!(std::fs::metadata(&recording).unwrap().len() <= 512 * 1024);
    let (recorded_s, frames) = end_of(Path::new(&recording));
    assert!(recorded_s > 1.0 && frames > 100, "{recorded_s} s, {frames} frames");
}

/// What the page's metrics say of a figure.
fn metric(page: &str, name: &str) -> f64 {
    let mut stream = std::net::TcpStream::connect(page).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let line = answer.lines().find_map(|l| l.strip_prefix(name));
    line.map_or(0.0, |value| value.trim().parse().unwrap())
}

#[test]
fn a_dead_ground_station_link_costs_only_its_own_messages_and_they_are_counted_and_shown() {
    let vehicle = a_minute_of_flight();
    let address = vehicle.line();
    // Accepts nobody: bound, but nobody listens.
    let dead = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let ground = format!("tcpout:{dead}");
    let station = Gaware::start(&[
        "run",
        "--connect",
        &address,
        "--connect",
        &ground,
        "--no-record",
        "--headless",
        "--json",
        "--web",
        "127.0.0.1:0",
    ]);
    let line = station.line_with("web page: http://");
    let page = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
    let told = station.line_with("link is down");
    assert!(told.contains(&ground), "{told}");
    while metric(&page, "gaware_sink_dropped_total{sink=\"links\"}") == 0.0 {}
    assert_eq!(vehicle.ended().code(), Some(0));
    station.line_with("the other side closed the connection");
    station.terminate();
    let document = station.ended().json();
    assert!(document["duration_s"].as_f64().unwrap() > 50.0, "{document:#}");
    assert!(document["imu"]["samples"].as_u64().unwrap() > 3_000, "{document:#}");
}

/// Rate of a message from `from_s` to `to_s` of the flight, Hz, by the frames of a log.
fn rate_between(log: &Path, id: u32, from_s: f64, to_s: f64) -> f64 {
    let (mut now_s, mut count) = (0.0, 0.0);
    for record in logs::open(log).unwrap().map_while(Result::ok) {
        let Item::Frame(frame) = record.item else { continue };
        if let Ok(MavMessage::ATTITUDE(m)) = frame.decode() {
            now_s = f64::from(m.time_boot_ms) * 1e-3;
        }
        if frame.message_id == id && frame.component_id == 1 && (from_s..to_s).contains(&now_s) {
            count += 1.0;
        }
    }
    count / (to_s - from_s)
}

/// Flies beside a `run` that ends in mid-flight; gives the log of the vehicle and when its first and last request came, by ATTITUDE.
fn flown_beside_a_run(folder: &Folder, sim: &[&str]) -> std::path::PathBuf {
    let log = folder.file("vehicle.tlog");
    let fly = ["sim", "--scenario", "fixed_wing", "--listen", "tcpin:127.0.0.1:0", "--record", &log];
    let vehicle = Gaware::start(&[&fly[..], sim].concat());
    let address = vehicle.line();
    let station = Gaware::start(&["run", "--connect", &address, "--no-record", "--headless"]);
    station.line_with("running");
    station.terminate();
    assert_eq!(station.ended().code(), Some(0));
    vehicle.terminate();
    vehicle.ended();
    log.into()
}

/// What a station asked of a vehicle in a log: message and interval, µs.
fn asked(log: &Path) -> Vec<(u32, f32)> {
    let frames = logs::open(log).unwrap().map_while(Result::ok).filter_map(|r| match r.item {
        Item::Frame(frame) => frame.decode().ok(),
        Item::Measurement(_) | Item::Note(_) => None,
    });
    let sets = frames.filter_map(|m| match m {
        MavMessage::COMMAND_LONG(c) if c.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
            Some((c.param1 as u32, c.param2))
        }
        _ => None,
    });
    sets.collect()
}

#[test]
fn rates_are_given_back_at_the_end_and_nothing_is_asked_for_that_is_not_there() {
    let folder = Folder::new("rates");
    let sealed = folder.file("sealed.toml");
    // Hidden effects come without HIGHRES_IMU.
    let log = flown_beside_a_run(&folder, &["--speed", "10", "--hide-random", "1", "--sealed", &sealed]);
    let asked = asked(&log);
    assert_eq!(
        asked,
        [(27, 5000.0), (24, 100_000.0), (30, 100_000.0), (27, 500_000.0), (24, 500_000.0), (30, 250_000.0)]
    );
    let texts = logs::open(&log).unwrap().map_while(Result::ok).filter(|r| match &r.item {
        Item::Frame(frame) => frame.message_id == 253 && frame.component_id == 1,
        Item::Measurement(_) | Item::Note(_) => false,
    });
    assert_eq!(texts.count(), 0, "texts for the pilot");
}

#[test]
fn px4_sends_what_was_asked_for() {
    let folder = Folder::new("px4-rates");
    let log = flown_beside_a_run(&folder, &["--speed", "10", "--autopilot", "px4"]);
    let hz = rate_between(&log, 26, 5.0, 10.0);
    assert!(hz > 200.0, "{hz} Hz of SCALED_IMU");
}

#[test]
fn a_terminal_that_goes_away_ends_the_run_with_a_whole_recording() {
    let folder = Folder::new("hangup");
    let recording = folder.file("flight.mcap");
    let vehicle = a_minute_of_flight();
    let address = vehicle.line();
    let station =
        Gaware::start(&["run", "--connect", &address, "--record", &recording, "--headless", "--json"]);
    station.line_with("running");
    station.signal("-HUP");
    let live = station.ended();
    assert_eq!(live.code(), Some(0), "{}", live.stderr);
    let again = gaware(&["replay", &recording, "--json"]);
    assert_eq!(live.stdout, again.stdout, "the recording is whole");
    assert!(!live.json().as_object().unwrap().contains_key("log_damage"));
}

/// A vehicle on a pseudo-terminal, and the terminal's name.
fn on_a_port(seed: &str) -> (Gaware, String) {
    let vehicle = Gaware::start(&[
        "sim",
        "--scenario",
        "fixed_wing",
        "--listen",
        "pty",
        "--speed",
        "10",
        "--no-wait",
        "--seed",
        seed,
    ]);
    let address = vehicle.line();
    let port = address.split(':').nth(1).unwrap().to_owned();
    (vehicle, port)
}

#[test]
fn a_port_that_vanishes_and_comes_back_under_another_name_is_found_by_its_link() {
    let folder = Folder::new("port");
    // As udev names a device by its identity, whatever number it gets.
    let link = folder.file("autopilot");
    let (first, port) = on_a_port("1");
    std::os::unix::fs::symlink(&port, &link).unwrap();
    let address = format!("serial:{link}:921600");
    let run = ["run", "--connect", &address, "--no-record", "--headless", "--json", "--web", "127.0.0.1:0"];
    let station = Gaware::start(&run);
    let line = station.line_with("web page: http://");
    let page = line.split("//").nth(1).unwrap().split('/').next().unwrap().to_owned();
    station.line_with("running");
    std::fs::remove_file(&link).unwrap();
    first.kill();
    let told = station.line_with("link is down");
    assert!(told.contains(&link), "{told}");
    let samples = || metric(&page, "gaware_imu_samples_total");
    let before = samples();
    assert!(before > 100.0, "{before}");
    let (second, port) = on_a_port("2");
    std::os::unix::fs::symlink(&port, &link).unwrap();
    station.line_with("link is up again");
    while samples() < before + 1000.0 {}
    station.line_with("; link up;");
    station.terminate();
    let ended = station.ended();
    assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
    assert_eq!(ended.json()["phase"], "running", "{}", ended.stdout);
    drop(second);
}

#[test]
fn with_a_limit_recordings_become_several_files_that_all_replay_and_what_was_removed_is_reported() {
    let folder = Folder::new("limit");
    let records = folder.file("recordings");
    let vehicle = a_minute_of_flight();
    let address = vehicle.line();
    let limited = ["--record", &records, "--record-limit", "1MB", "--headless", "--json"];
    let station = Gaware::start(&[&["run", "--connect", &address][..], &limited].concat());
    assert_eq!(vehicle.ended().code(), Some(0));
    let mut said = String::new();
    while !said.contains("link is down") {
        said += &station.line();
    }
    station.terminate();
    let ended = station.ended();
    said += &ended.stderr;
    assert_eq!(ended.code(), Some(0), "{}", ended.stderr);
    let document = ended.json();
    let figure = |name: &str| document["recording"][name].as_u64().unwrap();
    assert_eq!((figure("failed"), figure("dropped")), (0, 0), "{document:#}");
    assert!(figure("files") > 8 && figure("removed_files") > 0, "{document:#}");
    assert!(document["warnings"].to_string().contains("older recordings"), "{document:#}");
    assert!(said.contains("the oldest recording was removed"), "{said}");
    let files: Vec<_> = std::fs::read_dir(&records).unwrap().map(|e| e.unwrap().path()).collect();
    let total: u64 = files.iter().map(|f| f.metadata().unwrap().len()).sum();
    assert!(total <= 1_000_000 && total > 500_000, "{total}");
    assert_eq!(files.len() as u64, figure("files") - figure("removed_files"));
    for file in files {
        // By the mcap crate's own reader, to its end.
        let bytes = std::fs::read(&file).unwrap();
        assert!(mcap::Summary::read(&bytes).unwrap().is_some(), "{}", file.display());
        assert!(mcap::MessageStream::new(&bytes).unwrap().all(|m| m.is_ok()), "{}", file.display());
        let again = gaware(&["replay", file.to_str().unwrap(), "--json"]);
        if again.stderr.contains("there are no MAVLink frames in it") {
            // The part that began after the link went down holds no frame of the vehicle.
            assert!(bytes.len() < 100_000, "{}: {}", file.display(), again.stderr);
            continue;
        }
        assert_eq!(again.code(), Some(0), "{}: {}", file.display(), again.stderr);
        assert!(!again.json().as_object().unwrap().contains_key("log_damage"), "{}", file.display());
    }
}
