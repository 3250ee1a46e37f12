//! No command overwrites what it reads, nor a file that it did not write; on a full disk no part of a file is left.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use crate::support;
use std::path::Path;
use support::{Folder, Gaware, fixture, gaware};

const FIXTURE: &str = "small_gsens_typical_dither.tlog";
const HOME: &str = "47.4,8.5,400";

/// A copy of a recording that a test may lose.
fn copy(folder: &Folder, name: &str) -> String {
    let path = folder.file(name);
    std::fs::copy(fixture(FIXTURE), &path).unwrap();
    path
}

/// The names in a folder, sorted.
fn names(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn no_command_overwrites_the_recording_that_it_reads() {
    let folder = Folder::new("outputs-input");
    let original = std::fs::read(fixture(FIXTURE)).unwrap();
    let log = copy(&folder, "flight.tlog");
    // The same file under the names that commands write.
    std::fs::create_dir(folder.file("out")).unwrap();
    let aliases = ["second.csv", "link.mcap", "out/report.html", "out/model.toml", "out/fleet.json"];
    for (k, name) in aliases.iter().enumerate() {
        let alias = folder.file(name);
        if k % 2 == 0 {
            std::fs::hard_link(&log, &alias).unwrap();
        } else {
            std::os::unix::fs::symlink(&log, &alias).unwrap();
        }
    }
    let [csv, mcap, page, model, _] = aliases.map(|name| folder.file(name));
    let out = folder.file("out");
    for args in [
        &["replay", &log, "--export", &csv][..],
        &["replay", &log, "--export", &mcap, "--force"],
        &["report", &log, "--out", &log],
        &["report", &log, "--out", &page, "--force"],
        &["compare", &log, &csv, "--report", &page],
        &["explain", &log, "--out", &out],
        &["fleet", &log, "--out", &out, "--no-explain"],
        &["airframe", "fit", &log, "--out", &log],
        &["airframe", "fit", &log, "--out", &model, "--force"],
    ] {
        let ended = gaware(args);
        assert_eq!(ended.code(), Some(2), "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("is read by this command"), "{args:?}: {}", ended.stderr);
        assert!(std::fs::read(&log).unwrap() == original, "{args:?}");
    }
}

#[test]
fn files_of_others_are_overwritten_only_with_force() {
    let folder = Folder::new("outputs-foreign");
    let log = copy(&folder, "flight.tlog");
    let (page, plan) = (folder.file("page.html"), folder.file("plan.plan"));
    let (waypoints, tables) = (folder.file("plan.waypoints"), folder.file("states.parquet"));
    let out = folder.file("explained");
    std::fs::create_dir(&out).unwrap();
    let record = folder.file("recorded.tlog");
    let hand_written = "written by hand";
    let plans = ["plan", "--airframe", "quadrotor", "--home", HOME, "--budget", "60", "--out"];
    let sim =
        ["sim", "--listen", "tcpin:127.0.0.1:0", "--speed", "max", "--until", "2", "--no-wait", "--record"];
    let cases: [(&str, Vec<&str>); 6] = [
        (&page, vec!["report", &log, "--out", &page]),
        (&plan, [&plans[..], &[&plan]].concat()),
        (&waypoints, [&plans[..], &[&waypoints]].concat()),
        (&tables, vec!["replay", &log, "--export", &tables]),
        (&record, [&sim[..], &[&record]].concat()),
        (&folder.file("explained/autopilot.param"), vec!["explain", &log, "--out", &out]),
    ];
    for (file, args) in &cases {
        std::fs::write(file, hand_written).unwrap();
        let ended = gaware(args);
        assert_eq!(ended.code(), Some(1), "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("--force"), "{args:?}: {}", ended.stderr);
        assert_eq!(std::fs::read_to_string(file).unwrap(), hand_written, "{args:?}");
    }
    // With --force it is written, and then the same command takes it for its own, where the format has room to say so.
    let own = [true, true, false, true, false];
    for ((file, args), own) in cases.iter().zip(own) {
        let forced = gaware(&[&args[..], &["--force"]].concat());
        assert_eq!(forced.code(), Some(0), "{args:?}: {}", forced.stderr);
        let again = gaware(args);
        assert_eq!(again.code(), Some(if own { 0 } else { 1 }), "{args:?}: {}", again.stderr);
        assert_ne!(std::fs::read(file).unwrap(), hand_written.as_bytes());
    }
    // An edit makes it a file of another.
    let edited = std::fs::read_to_string(&page).unwrap() + "<!-- my notes -->";
    std::fs::write(&page, &edited).unwrap();
    assert_eq!(gaware(&cases[0].1).code(), Some(1));
    assert_eq!(std::fs::read_to_string(&page).unwrap(), edited);
}

#[test]
fn on_a_full_disk_the_file_before_stays_and_no_part_is_left() {
    let folder = Folder::new("outputs-full");
    let log = copy(&folder, "flight.tlog");
    std::fs::create_dir(folder.file("out")).unwrap();
    let (page, plan) = (folder.file("out/page.html"), folder.file("out/plan.plan"));
    let report = ["report", &log, "--out", &page];
    let before = {
        assert_eq!(gaware(&report).code(), Some(0));
        std::fs::read(&page).unwrap()
    };
    let (table, model) = (folder.file("out/states.csv"), folder.file("out/model"));
    for args in [
        &report[..],
        &["replay", &log, "--export", &table],
        &["plan", "--airframe", "quadrotor", "--home", HOME, "--budget", "60", "--out", &plan],
        &["airframe", "fit", &log, "--out", &model],
    ] {
        let ended = Gaware::start_on_a_small_disk(1, args).ended();
        assert_eq!(ended.code(), Some(1), "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("cannot write"), "{args:?}: {}", ended.stderr);
    }
    assert!(std::fs::read(&page).unwrap() == before);
    assert_eq!(names(&folder.file("out")), ["page.html"]);
    assert!(Path::new(&log).exists());
}

#[test]
fn a_backup_of_parameters_is_there_whole_or_not_at_all() {
    let folder = Folder::new("outputs-backup");
    let sim = [
        "sim",
        "--scenario",
        "mission_multirotor",
        "--listen",
        "tcpin:127.0.0.1:0",
        "--speed",
        "10",
        "--no-wait",
    ];
    let sim = Gaware::start(&sim);
    let address = sim.line_with("tcp").split_whitespace().last().unwrap().to_owned();
    std::fs::create_dir(folder.file("out")).unwrap();
    for (file, action) in [("a.param", ["params", "backup"]), ("b.plan", ["mission", "download"])] {
        let file = folder.file(&format!("out/{file}"));
        let args = [action[0], action[1], "--connect", &address, &file];
        let ended = Gaware::start_on_a_small_disk(0, &args).ended();
        assert_eq!(ended.code(), Some(1), "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("cannot write"), "{args:?}: {}", ended.stderr);
        assert_eq!(names(&folder.file("out")), Vec::<String>::new());
    }
}
