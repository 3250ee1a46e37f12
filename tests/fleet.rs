//! `gaware fleet`: a run that was killed goes on where it was and comes to the same tables; broken files are counted; flights of one unit are put together.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "helpers of tests may panic, as tests do"
)]

use crate::support;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use support::{Folder, Gaware, fixture, gaware};

const FIXTURE: &str = "small_gsens_typical_dither.tlog";

/// A folder with flights of two units (a log shortened at several places), a copy of the same bytes and a broken file.
fn archive(name: &str) -> Folder {
    let folder = Folder::new(name);
    let log = std::fs::read(fixture(FIXTURE)).unwrap();
    for (file, share) in [("u1/4.5_a", 1.0), ("u1/4.6_b", 0.9), ("u2/4.5_c", 0.8), ("u2/4.6_d", 1.0)] {
        let path = folder.file(&format!("logs/{file}.tlog"));
        std::fs::create_dir_all(Path::new(&path).parent().unwrap()).unwrap();
        std::fs::write(path, &log[..(share * log.len() as f64) as usize]).unwrap();
    }
    std::fs::write(folder.file("logs/u2/4.6_broken.ulg"), "no flight at all").unwrap();
    std::fs::write(folder.file("logs/notes.txt"), "no log").unwrap();
    folder
}

/// Everything in a folder but parts that a killed process left.
fn content(folder: &str) -> BTreeMap<String, Vec<u8>> {
    let mut out = BTreeMap::new();
    for place in [folder.to_owned(), format!("{folder}/results")] {
        for entry in std::fs::read_dir(&place).unwrap().map(|e| e.unwrap().path()) {
            let name = entry.file_name().unwrap().to_str().unwrap().to_owned();
            if entry.is_file() && !name.ends_with(".part") {
                out.insert(name, std::fs::read(&entry).unwrap());
            }
        }
    }
    out
}

fn fleet(folder: &Folder, out: &str, more: &[&str]) -> Value {
    let (logs, out) = (folder.file("logs"), folder.file(out));
    let names = "{unit}/{firmware}_*.*";
    let mut args = vec!["fleet", &logs, "--out", &out, "--no-explain", "--names", names, "--json"];
    args.extend(more);
    gaware(&args).json()
}

#[test]
fn a_killed_run_goes_on_and_comes_to_the_same_content() {
    let folder = archive("fleet-killed");
    let whole = fleet(&folder, "whole", &["--jobs", "2"]);
    assert_eq!((&whole["logs"], &whole["analysed"], &whole["resumed"]), (&5.into(), &4.into(), &0.into()));
    // The reason is in one sentence, and the other logs are there.
    let failed = whole["failed"].as_array().unwrap();
    assert_eq!(failed.len(), 1);
    assert!(failed[0]["log"].as_str().unwrap().ends_with("4.6_broken.ulg"));
    assert!(failed[0]["reason"].as_str().unwrap().contains("unsupported format"), "{failed:?}");
    assert_eq!(whole["units"], serde_json::json!({"u1": 2, "u2": 2}));

    let (logs, out) = (folder.file("logs"), folder.file("killed"));
    let names = "{unit}/{firmware}_*.*";
    let run =
        Gaware::start(&["fleet", &logs, "--out", &out, "--no-explain", "--jobs", "1", "--names", names]);
    run.line_with("2 of 5 logs, about");
    run.kill();
    assert!(!Path::new(&out).join("flights.parquet").exists());

    let resumed = fleet(&folder, "killed", &[]);
    assert!(resumed["resumed"].as_u64().unwrap() >= 2, "{resumed}");
    let (one, two) = (content(&folder.file("whole")), content(&folder.file("killed")));
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    assert!(one == two, "the same names with different content");
    // Two logs of the same bytes are one result: four contents, tables and list.
    assert_eq!(one.keys().filter(|n| n.len() == 64 + 5).count(), 4, "{:?}", one.keys());
    // And a third run has nothing to do.
    assert_eq!(fleet(&folder, "killed", &[])["resumed"], 5);
}

/// The memory that a process takes is more than 1 MB whatever the log; results of an earlier run need no process.
#[test]
fn a_log_over_its_limit_is_named_with_the_option_and_fails_no_other() {
    let folder = archive("fleet-limit");
    let late = folder.file("logs/u2/4.6_d.tlog");
    let log = std::fs::read(&late).unwrap();
    std::fs::remove_file(&late).unwrap();
    assert_eq!(fleet(&folder, "out", &[])["analysed"], 3);
    std::fs::write(&late, &log[..log.len() / 2]).unwrap();
    let limited = fleet(&folder, "out", &["--limit-memory", "1"]);
    assert_eq!((&limited["analysed"], &limited["resumed"]), (&3.into(), &4.into()), "{limited}");
    let failed = limited["failed"].as_array().unwrap();
    let reason = |end: &str| {
        let of = failed.iter().find(|f| f["log"].as_str().unwrap().ends_with(end));
        of.unwrap_or_else(|| panic!("{failed:?}"))["reason"].as_str().unwrap().to_owned()
    };
    assert!(
        reason("4.6_d.tlog").contains("its limit of 1 MB of memory; give it more with --limit-memory"),
        "{failed:?}"
    );
    assert!(reason("4.6_broken.ulg").contains("unsupported format"));
    // Its result is not kept: with more it is analysed.
    assert_eq!(fleet(&folder, "out", &["--limit-memory", "4000", "--limit-time", "3000"])["analysed"], 4);
}

#[test]
fn flights_are_put_together_by_unit_and_give_a_model_for_the_next() {
    let folder = archive("fleet-units");
    fleet(&folder, "out", &[]);
    let out = folder.file("out");
    let family = gaware(&["fleet", "report", &out, "--json"]).json();
    assert_eq!(family["schema"], "gaware.fleet_family/1");
    assert_eq!(family["units"], serde_json::json!(["u1", "u2"]));
    let names = |p: &Value| p["name"].as_str().unwrap().to_owned();
    let parameters: Vec<String> = family["parameters"].as_array().unwrap().iter().map(names).collect();
    assert!(parameters.contains(&"latency".to_owned()), "{parameters:?}");
    // The page lies beside the tables; with --json only where --out names it.
    let page = folder.file("out/report.html");
    assert!(!Path::new(&page).exists());
    let reported = gaware(&["fleet", "report", &out]);
    assert_eq!(reported.code(), Some(0), "{}", reported.stderr);
    assert!(reported.stdout.contains(&format!("report: {page}")), "{}", reported.stdout);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(
        html.contains("4 flights of 2 inertial units with 2 firmwares") && html.contains("4.6_broken.ulg")
    );
    let other = folder.file("other.html");
    let both = gaware(&["fleet", "report", &out, "--json", "--out", &other]);
    assert_eq!(both.json(), family);
    assert_eq!(std::fs::read_to_string(&other).unwrap(), html);
    let nowhere = gaware(&["fleet", "report", &out, "--out", &folder.file("none/page.html")]);
    assert_eq!(nowhere.code(), Some(1));
    assert!(nowhere.stderr.contains("cannot write"), "{}", nowhere.stderr);
    let model = folder.file("u1.toml");
    gaware(&["fleet", "prior", "u1", "--fleet", &out, "--out", &model]);
    // The model is one that replay takes, and it begins with what the flights said.
    let log = fixture(FIXTURE);
    let summary = gaware(&["replay", log.to_str().unwrap(), "--model", &model, "--json"]).json();
    assert!(summary["imu"]["samples"].as_u64().unwrap() > 1000);
    let ended = Gaware::start(&["fleet", "prior", "u9", "--fleet", &out, "--out", &model]).ended();
    assert_eq!(ended.code(), Some(1));
    assert!(ended.stderr.contains("no flight of unit u9; units of this fleet: u1, u2"), "{}", ended.stderr);
}

#[test]
fn a_fleet_of_broken_files_fails_with_the_reason() {
    let folder = Folder::new("fleet-broken");
    std::fs::write(folder.file("a.ulg"), "").unwrap();
    let ended = Gaware::start(&["fleet", &folder.file("a.ulg"), "--out", &folder.file("out")]).ended();
    assert_eq!(ended.code(), Some(1));
    assert!(
        ended.stderr.contains("none of 1 logs could be analysed") && ended.stderr.contains("is empty"),
        "{}",
        ended.stderr
    );
    let ended = Gaware::start(&["fleet", &folder.file("*.none"), "--out", &folder.file("out")]).ended();
    assert!(ended.stderr.contains("no log at"), "{}", ended.stderr);
    assert!(Gaware::start(&["fleet", "a.ulg"]).ended().code() == Some(2));
}

#[test]
fn what_explain_identified_is_in_the_table_of_effects() {
    let folder = Folder::new("fleet-explained");
    let (log, out) = (fixture("small_clean_dither.tlog"), folder.file("out"));
    let result = gaware(&["fleet", log.to_str().unwrap(), "--out", &out, "--json"]).json();
    assert_eq!(result["verdicts"].as_object().unwrap().values().filter_map(Value::as_u64).sum::<u64>(), 1);
    for table in ["flights", "effects"] {
        let bytes = std::fs::read(format!("{out}/{table}.parquet")).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
    }
}

/// A recording without the messages of these ids.
fn without_messages(log: &[u8], ids: &[u32]) -> Vec<u8> {
    let (mut out, mut rest) = (Vec::new(), log);
    while rest.len() > 18 {
        let payload = usize::from(rest[9]);
        let (length, id) = match rest[8] {
            0xfe => (payload + 8, u32::from(rest[13])),
            _ => (
                payload + 12 + 13 * usize::from(rest[10] & 1),
                u32::from_le_bytes([rest[15], rest[16], rest[17], 0]),
            ),
        };
        let Some((record, more)) = rest.split_at_checked(8 + length) else { break };
        if !ids.contains(&id) {
            out.extend_from_slice(record);
        }
        rest = more;
    }
    out
}

/// A bench recording without GNSS: the filter never ran, and what it was told before is in no table as its result.
#[test]
fn a_log_without_gnss_says_so_and_a_prior_is_no_result() {
    let folder = Folder::new("fleet-no-gnss");
    let log = without_messages(&std::fs::read(fixture("small_clean_dither.tlog")).unwrap(), &[24, 33, 124]);
    std::fs::write(folder.file("bench.tlog"), log).unwrap();
    std::fs::copy(fixture(FIXTURE), folder.file("flown.tlog")).unwrap();
    let out = folder.file("out");
    let logs = folder.file("*.tlog");
    let result = gaware(&["fleet", &logs, "--out", &out, "--no-explain", "--json"]).json();
    assert_eq!((&result["logs"], &result["analysed"]), (&2.into(), &1.into()), "{result}");
    let reason = result["failed"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("no GNSS fix"), "{reason}");
}
