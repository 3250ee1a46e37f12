//! What the documents tell a user to type is what the program takes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use clap::Parser;
use gaware::commands::cli::Cli;

const DOCUMENTS: [(&str, &str); 5] = [
    ("README.md", include_str!("../README.md")),
    ("docs/vehicle.md", include_str!("../docs/vehicle.md")),
    ("docs/install.md", include_str!("../docs/install.md")),
    ("docs/fleet.md", include_str!("../docs/fleet.md")),
    ("docs/foxglove.md", include_str!("../docs/foxglove.md")),
];

/// Lines of code blocks that call the program, and the calls in a systemd unit, without comments.
fn calls(text: &str) -> Vec<Vec<String>> {
    let mut inside = false;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.starts_with("```") {
            inside = !inside;
            continue;
        }
        let line = line.split(" # ").next().unwrap_or(line).trim();
        let call = line
            .strip_prefix("ExecStart=/usr/local/bin/")
            .or(line.starts_with("gaware ").then_some(line))
            .or(line.strip_prefix("cargo run --release -- ").map(|_| line));
        if let Some(call) = call.filter(|_| inside) {
            let call = call.replace("cargo run --release -- ", "gaware ");
            found.push(call.split_whitespace().map(str::to_owned).collect());
        }
    }
    found
}

#[test]
fn every_command_line_of_the_documents_is_accepted() {
    for (name, text) in DOCUMENTS {
        let calls = calls(text);
        assert!(calls.len() >= 3, "{name}: {calls:?}");
        for call in calls {
            if let Err(error) = Cli::try_parse_from(&call) {
                panic!("{name}: {}\n{error}", call.join(" "));
            }
        }
    }
}

#[test]
fn the_readme_lists_every_command() {
    use clap::CommandFactory;
    let readme = DOCUMENTS[0].1;
    for command in Cli::command().get_subcommands().map(|c| c.get_name().to_owned()) {
        assert!(readme.contains(&format!("`gaware {command}")), "{command} is not in the README");
    }
}

#[test]
fn cargo_run_without_a_name_is_the_program() {
    // The first command of the README; the workspace has a second program.
    let readme = DOCUMENTS[0].1;
    assert!(readme.contains("cargo run --release -- demo"));
    let manifest = include_str!("../Cargo.toml");
    assert!(manifest.lines().any(|line| line == "default-run = \"gaware\""), "cargo run has a choice of two");
}

/// Every Rust source below a folder.
fn sources(folder: &std::path::Path, found: &mut String) {
    for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            sources(&entry, found);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            found.push_str(&std::fs::read_to_string(entry).unwrap());
        }
    }
}

#[test]
fn every_test_that_the_documents_name_exists() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut text = String::new();
    for folder in ["src", "mission/src", "nav/src", "sitl/src", "lab/src", "sitl/tests", "tests"] {
        sources(&root.join(folder), &mut text);
    }
    for (name, at_least) in [("docs/safety.md", 10), ("docs/faults.md", 25), ("docs/hardening.md", 12)] {
        let case = std::fs::read_to_string(root.join(name)).unwrap();
        // Tables whose last column says what shows the row.
        let mut shows = false;
        let mut rows = 0;
        for row in case.lines().filter(|l| l.starts_with('|')) {
            let Some(shown) = row.trim_end_matches('|').rsplit('|').next() else { continue };
            if ["Fault |", "Hazard |", "Found |"].iter().any(|head| row.contains(head)) {
                shows = shown.contains("Shown by");
            } else if shows && !row.starts_with("|---") {
                let named: Vec<&str> = shown.split('`').skip(1).step_by(2).collect();
                assert!(!named.is_empty(), "nothing shows: {row}");
                for test in named {
                    assert!(text.contains(&format!("fn {test}(")), "{name}: {test} is no test");
                }
                rows += 1;
            }
        }
        assert!(rows >= at_least, "{name}: {rows}");
    }
}

#[test]
fn every_file_of_tests_is_run() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let (manifest, main) = (include_str!("../Cargo.toml"), include_str!("main.rs"));
    for entry in std::fs::read_dir(root.join("tests")).unwrap() {
        let path = entry.unwrap().path();
        let Some(name) = path.file_name().unwrap().to_str().unwrap().strip_suffix(".rs") else { continue };
        let of_its_own = manifest.contains(&format!("[[test]]\nname = \"{name}\""));
        assert!(
            of_its_own || main.contains(&format!("\nmod {name};")),
            "tests/{name}.rs is not in tests/main.rs"
        );
    }
}
