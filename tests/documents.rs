//! What the documents tell a user to type is what the program takes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use clap::Parser;
use gaware::commands::cli::Cli;

const DOCUMENTS: [(&str, &str); 2] =
    [("README.md", include_str!("../README.md")), ("docs/vehicle.md", include_str!("../docs/vehicle.md"))];

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
