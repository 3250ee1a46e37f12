//! `gaware replay LOG… --export`: the tables have what the summary has, in every format; baselines and JUnit for CI.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "helpers of tests may panic, as tests do"
)]

use crate::support;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use support::{Folder, fixture, gaware};

/// The rows of a CSV file, by column.
fn columns(path: &str) -> BTreeMap<String, Vec<String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let mut out: BTreeMap<String, Vec<String>> = names.iter().map(|n| (n.clone(), Vec::new())).collect();
    for record in reader.records().map(|r| r.unwrap()) {
        for (name, field) in names.iter().zip(&record) {
            out.get_mut(name).unwrap().push(field.to_owned());
        }
    }
    out
}

#[test]
fn the_last_row_of_states_is_the_summary_and_rows_of_two_logs_carry_their_names() {
    let folder = Folder::new("export-csv");
    let (log, second) = (fixture("small_gsens_typical_dither.tlog"), folder.file("second.tlog"));
    std::fs::copy(&log, &second).unwrap();
    let out = folder.file("states.csv");
    let ended = gaware(&["replay", log.to_str().unwrap(), &second, "--json", "--export", &out]);
    let document = ended.json();
    assert_eq!(document["schema"], "gaware.replay/1");
    let summary = &document["flights"][1]["summary"];
    let table = columns(&out);
    let logs = &table["log"];
    assert_eq!(logs[0], "small_gsens_typical_dither.tlog");
    assert_eq!(logs.last().unwrap(), "second.tlog");
    assert_eq!(logs.iter().filter(|l| *l == "second.tlog").count() * 2, logs.len());
    let last = |name: &str| table[name].last().unwrap().parse::<f64>().unwrap();
    let g = &summary["estimate"]["g_sensitivity_deg_per_h_per_g"];
    // The last row is up to 0.2 s before the end.
    let sigma = g["sigma"][0][0].as_f64().unwrap();
    assert!((last("g11_deg_per_h_per_g") - g["value"][0][0].as_f64().unwrap()).abs() < 0.2 * sigma);
    assert!((last("g11_sigma_deg_per_h_per_g") / sigma - 1.0).abs() < 0.02);
    assert!((summary["duration_s"].as_f64().unwrap() - last("elapsed_s")).abs() < 0.3);
    // Before there is an estimate there is no value.
    assert_eq!(
        (table["phase"][0].as_str(), table["g11_deg_per_h_per_g"][0].as_str()),
        ("waiting_for_gnss", "")
    );
}

#[test]
fn a_folder_and_an_mcap_file_have_all_tables() {
    let folder = Folder::new("export-all");
    let log = fixture("small_gsens_typical_dither.tlog");
    let (tables, file) = (folder.file("tables"), folder.file("all.mcap"));
    for target in [&tables, &file] {
        let ended = gaware(&["replay", log.to_str().unwrap(), "--json", "--export", target]);
        assert!(ended.json()["imu"]["samples"].as_u64().unwrap() > 1000);
    }
    let mut files: Vec<String> =
        std::fs::read_dir(&tables).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    files.sort();
    assert_eq!(
        files,
        ["autopilot_attitude.parquet", "events.parquet", "fixes.parquet", "imu.parquet", "states.parquet"]
    );
    for name in files {
        let bytes = std::fs::read(PathBuf::from(&tables).join(&name)).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{name}");
    }
    let bytes = std::fs::read(&file).unwrap();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap()) {
        let row: Value = serde_json::from_slice(&message.data).unwrap();
        assert_eq!(row["log"], "small_gsens_typical_dither.tlog");
        *counts.entry(message.channel.topic.clone()).or_default() += 1;
    }
    assert_eq!(
        counts.keys().collect::<Vec<_>>(),
        ["/autopilot_attitude", "/events", "/fixes", "/imu", "/states"]
    );
    let summary = gaware(&["replay", log.to_str().unwrap(), "--json"]).json();
    assert_eq!(counts["/imu"] as u64, summary["imu"]["samples"].as_u64().unwrap());
    assert_eq!(counts["/fixes"] as u64, summary["gnss"]["fixes"].as_u64().unwrap());
}

#[test]
fn baselines_of_several_logs_are_judged_each_and_written_for_ci() {
    let folder = Folder::new("export-junit");
    let (log, second) = (fixture("small_gsens_typical_dither.tlog"), folder.file("second.tlog"));
    std::fs::copy(&log, &second).unwrap();
    let summary = gaware(&["replay", log.to_str().unwrap(), "--json"]);
    let baselines = folder.file("baselines");
    std::fs::create_dir(&baselines).unwrap();
    let path = |name: &str| PathBuf::from(&baselines).join(format!("{name}.json"));
    std::fs::write(path("small_gsens_typical_dither.tlog"), &summary.stdout).unwrap();
    let mut other = summary.json();
    other["duration_s"] = 1.0.into();
    std::fs::write(path("second.tlog"), other.to_string()).unwrap();
    let junit = folder.file("results.xml");
    let ended = gaware(&[
        "replay",
        log.to_str().unwrap(),
        &second,
        "--json",
        "--baseline",
        &baselines,
        "--junit",
        &junit,
    ]);
    assert_eq!(ended.code(), Some(1));
    assert!(ended.stderr.contains("second.tlog /duration_s"), "{}", ended.stderr);
    let text = std::fs::read_to_string(&junit).unwrap();
    assert!(text.contains("failures=\"1\""), "{text}");
    assert!(text.contains("<testcase classname=\"second.tlog\" name=\"duration_s\"><failure"), "{text}");
    assert!(
        text.contains("<testcase classname=\"small_gsens_typical_dither.tlog\" name=\"duration_s\"/>"),
        "{text}"
    );
}

#[test]
fn a_wrong_target_is_refused_before_the_work() {
    let log = fixture("small_gsens_typical_dither.tlog");
    let ended = gaware(&["replay", log.to_str().unwrap(), "--export", "states.xlsx"]);
    assert_eq!(ended.code(), Some(2));
    assert!(ended.stderr.contains(".csv, .parquet or .mcap"), "{}", ended.stderr);
    let twice = gaware(&["replay", log.to_str().unwrap(), log.to_str().unwrap(), "--export", "states.csv"]);
    assert!(twice.code() == Some(2) && twice.stderr.contains("rename one"), "{}", twice.stderr);
}

/// `UPDATE_DOCS=1` writes the lists anew.
#[test]
fn the_columns_in_the_documentation_are_those_of_the_program() {
    const MARK: &str = "<!-- columns: written by the program -->";
    let fleet = gaware::export::in_words(&gaware::fleet::tables::example());
    for (name, columns) in [("export.md", gaware::export::columns_in_words()), ("fleet.md", fleet)] {
        let path = format!("{}/docs/{name}", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).unwrap();
        let (before, _) = text.split_once(MARK).unwrap();
        let now = format!("{before}{MARK}\n{columns}");
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(&path, &now).unwrap();
        }
        assert!(
            std::fs::read_to_string(&path).unwrap() == now,
            "docs/{name} is stale: run `UPDATE_DOCS=1 cargo test --test main export`"
        );
    }
}
