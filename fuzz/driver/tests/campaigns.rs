//! A short campaign over every target, by the driver itself: no panic, no input over a second, less than 200 MB.
//!
//! The number of inputs is fixed, so that a run is the same everywhere; the long campaigns are in `docs/hardening.md`. What a campaign
//! finds is kept as a file in `fuzz/corpus`, which is the first input of all later ones.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic, as tests do")]

use gaware_fuzz::{TARGETS, corpus};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

fn campaign(target: &str, inputs: u32) {
    let ended = Command::new(env!("CARGO_BIN_EXE_gaware-fuzz"))
        .args([target, "--inputs", &inputs.to_string()])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&ended.stdout) + String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{text}");
    let line = text.lines().find(|l| l.starts_with(target)).unwrap_or_default();
    let mut numbers = line.split_whitespace().skip(1).filter_map(|n| n.parse::<u32>().ok());
    assert_eq!(numbers.next(), Some(inputs), "not all inputs were run: {text}");
    // What is refused at once says nothing about what lies behind.
    let accepted = numbers.next().unwrap_or(0);
    assert!(accepted > inputs / 20, "only {accepted} inputs were not refused at the first look");
}

macro_rules! campaigns {
    ($($target:ident: $inputs:literal,)*) => {
        $(
            #[test]
            fn $target() {
                campaign(stringify!($target), $inputs);
            }
        )*

        #[test]
        fn every_target_has_a_campaign() {
            let with: BTreeSet<&str> = [$(stringify!($target)),*].into();
            assert_eq!(with, TARGETS.iter().map(|t| t.name).collect());
        }
    };
}

campaigns! {
    framer: 50_000,
    decode: 5_000,
    address: 100_000,
    tlog: 10_000,
    dataflash: 3_000,
    ulog: 3_000,
    mcap: 1_000,
    table: 10_000,
    plan: 5_000,
    waypoints: 20_000,
    model: 3_000,
    effects: 10_000,
    airframe: 3_000,
    parameters: 10_000,
    transfer: 5_000,
    uploader: 200,
    engine: 500,
    web: 5_000,
    foxglove: 5_000,
}

/// `cargo fuzz` runs the same functions: a file of three lines each, and a folder of inputs that belongs to a target.
#[test]
fn files_and_folders_of_cargo_fuzz_belong_to_targets() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let manifest = std::fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
    let names: BTreeSet<String> = TARGETS.iter().map(|t| t.name.to_owned()).collect();
    for name in &names {
        let text = std::fs::read_to_string(fuzz.join(format!("fuzz_targets/{name}.rs"))).unwrap();
        assert_eq!(text.lines().count(), 3, "{name}");
        assert!(text.contains(&format!("::{name}(data)")), "{name}");
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
    }
    let of = |folder: &Path| -> BTreeSet<String> {
        let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
        entries.map(|p| p.file_stem().unwrap().to_string_lossy().into_owned()).collect()
    };
    assert_eq!(of(&fuzz.join("fuzz_targets")), names);
    assert!(of(&corpus::folder()).is_subset(&names), "{:?}", corpus::folder());
}
