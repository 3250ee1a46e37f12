//! One word per thing: texts that a user reads hold none of the words that the glossary replaces.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

use clap::CommandFactory;
use gaware::commands::cli::Cli;
use std::path::{Path, PathBuf};

/// What a text must not hold, and what it says instead. A `*` at the end stands for any ending.
const REPLACED: [(&str, &str); 58] = [
    ("house", "architecture"),
    ("room", "module, space"),
    ("wall", "boundary"),
    ("dark", "unobservable"),
    ("darkness", "unobservable direction"),
    ("told", "reported"),
    ("tells", "reports"),
    ("tell", "report"),
    ("finished sample", "raw sample"),
    ("cut off", "truncated"),
    ("cuts off", "truncates"),
    ("standing", "stationary"),
    ("stands still", "is stationary"),
    ("stand still", "stationary"),
    ("the gap", "model residual"),
    ("effect is missing", "unmodelled effect"),
    ("effect that is missing", "unmodelled effect"),
    ("missing effect*", "unmodelled effect"),
    ("missing in the model", "unmodelled"),
    ("wander*", "first-order Gauss-Markov error"),
    ("mistake of", "fault"),
    ("mistakes of", "faults"),
    ("passed over", "rejected"),
    ("contradict*", "inconsistent, innovation test failed"),
    ("looked for", "tested"),
    ("took no part", "held-out"),
    ("takes no part", "held-out"),
    ("squared innovation*", "NIS"),
    ("squared normalised innovation*", "NIS"),
    ("log odds", "log Bayes factor"),
    ("as long as it takes", "until every observable parameter converges"),
    ("make known", "make observable"),
    ("makes known", "makes observable"),
    ("known yet", "converged"),
    ("known in part", "partly observable"),
    ("is no address", "invalid address"),
    ("none of the formats", "unsupported format"),
    ("news", "event"),
    ("believe*", "assume, accept"),
    ("enough, not needed", "sufficient, not necessary"),
    ("hide", "inject"),
    ("hides", "injects"),
    ("hidden", "injected"),
    ("seal", "ground truth"),
    ("sealed", "ground truth"),
    ("unseal*", "compare with the ground truth"),
    ("blame*", "absorb"),
    ("left over", "residual"),
    ("stands for", "is"),
    ("hear", "receive"),
    ("hears", "receives"),
    ("nobody", "no one"),
    ("somebody", "the user, another process"),
    ("nowhere", "empty"),
    ("hopeless", "a threshold"),
    ("doubt*", "inconsistency"),
    ("voice*", "heartbeat source"),
    ("court*", "held-out test"),
];

/// What stands all the same: a place (the end of a path, or `--help`), the text around the word, and why.
const EXCEPTIONS: [(&str, &str, &str); 14] = [
    ("", "--hide", "an option's name is a contract"),
    ("", "--sealed", "an option's name is a contract"),
    ("src/commands/sim.rs", "hide", "the identifier of the option"),
    ("src/commands/sim.rs", "sealed", "the identifier of the option"),
    ("lab/src/endurance/cases.rs", "standing", "a key of the JSON result"),
    ("lab/src/observability.rs", "standing", "a scenario's name on the command line"),
    ("src/sinks/web/assets/index.html", "hidden", "an attribute of HTML"),
    ("src/sinks/web/assets/index.html", "light dark", "a value of HTML's colour scheme"),
    ("mission/src/planner/mod.rs", "dark", "a value of the JSON of a plan is a contract"),
    ("docs/snapshot.schema.json", "\"news\"", "a field's name is a contract"),
    ("src/sinks/web/assets/theme.js", "dark", "the dark theme of the page"),
    ("src/sinks/web/assets/", "hidden", "a property of HTML elements"),
    ("src/report/assets/", "hidden", "a property of HTML elements"),
    ("web/page/", "hidden", "a property of HTML elements"),
];

/// Where one of the words stands in a text, with what surrounds it.
fn found(text: &str) -> Vec<(&'static str, &'static str, String)> {
    let lower = text.to_lowercase();
    let mut out = Vec::new();
    for (word, instead) in REPLACED {
        let (word, open) = word.strip_suffix('*').map_or((word, false), |stem| (stem, true));
        for (at, _) in lower.match_indices(word) {
            let inside = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
            let end = at + word.len();
            if inside(lower[..at].chars().next_back()) || !open && inside(lower[end..].chars().next()) {
                continue;
            }
            let before: String = lower[..at].chars().rev().take(40).collect();
            let around = before.chars().rev().chain(lower[at..].chars().take(word.len() + 40)).collect();
            out.push((word, instead, around));
        }
    }
    out
}

/// Complains of every word that no exception allows.
fn judge(place: &str, text: &str, complaints: &mut Vec<String>) {
    for (word, instead, around) in found(text) {
        let allowed = |(at, what, _): &(&str, &str, &str)| place.contains(at) && around.contains(what);
        if !EXCEPTIONS.iter().any(allowed) {
            complaints.push(format!("{place}: \"{word}\" ({instead}) in: {around}"));
        }
    }
}

/// Contents of the string literals of a Rust source before its unit tests, without comments.
fn literals(source: &str) -> Vec<String> {
    let source = source.split("#[cfg(test)]\nmod tests").next().unwrap_or(source);
    let mut rest = source;
    let mut out = Vec::new();
    while let Some(at) = rest.find(['"', '/', '\'']) {
        let (tail, before) = (&rest[at..], rest[..at].chars().next_back());
        let skipped = if tail.starts_with("//") {
            tail.find('\n').unwrap_or(tail.len())
        } else if let Some(escaped) = tail.strip_prefix("'\\") {
            escaped.find('\'').map_or(1, |end| end + 3)
        } else if tail.starts_with('\'') {
            // A character, else a lifetime.
            let mut chars = tail.char_indices().skip(1);
            let _ = chars.next();
            chars.next().filter(|(_, c)| *c == '\'').map_or(1, |(end, _)| end + 1)
        } else if tail.starts_with('"') && matches!(before, Some('r' | '#')) {
            let hashes = rest[..at].chars().rev().take_while(|c| *c == '#').count();
            let close = format!("\"{}", "#".repeat(hashes));
            let end = tail[1..].find(&close).unwrap_or(tail.len() - 1);
            out.push(tail[1..=end].to_owned());
            end + 1 + close.len()
        } else if let Some(text) = tail.strip_prefix('"') {
            let mut escaped = false;
            let end = text.char_indices().find(|(_, c)| {
                let ends = *c == '"' && !escaped;
                escaped = *c == '\\' && !escaped;
                ends
            });
            let end = end.map_or(tail.len() - 1, |(end, _)| end);
            // Lines that the source breaks are one.
            out.push(text[..end].replace("\\\n", "").split_whitespace().collect::<Vec<_>>().join(" "));
            end + 2
        } else {
            1
        };
        rest = rest.get(at + skipped..).unwrap_or_default();
    }
    out
}

/// Files below a folder with one of these endings, without tests.
fn files(folder: &Path, endings: &[&str], out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        let name = entry.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if entry.is_dir() && name != "tests" && name != "snapshots" {
            files(&entry, endings, out);
        } else if endings.iter().any(|e| name.ends_with(e))
            && name != "tests.rs"
            && !name.starts_with("uplot")
        {
            out.push(entry);
        }
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn place(file: &Path) -> String {
    file.strip_prefix(root()).unwrap_or(file).display().to_string()
}

fn none(complaints: &[String]) {
    assert!(
        complaints.is_empty(),
        "{} words of the glossary's left column:\n{}",
        complaints.len(),
        complaints.join("\n")
    );
}

#[test]
fn documents_and_pages_use_the_words_of_the_field() {
    let mut all =
        vec![root().join("README.md"), root().join("ARCHITECTURE.md"), root().join("web/README.md")];
    files(&root().join("web/page"), &[".html", ".js"], &mut all);
    files(&root().join("docs"), &[".md", ".svg", ".schema.json"], &mut all);
    files(&root().join("src/sinks/web/assets"), &[".html", ".js"], &mut all);
    files(&root().join("src/report/assets"), &[".js"], &mut all);
    assert!(all.len() > 15, "{all:?}");
    let mut complaints = Vec::new();
    for file in all {
        let text = std::fs::read_to_string(&file).unwrap();
        // Pictures of the terminal have spaces that do not break.
        text.replace('\u{a0}', " ").lines().for_each(|line| judge(&place(&file), line, &mut complaints));
    }
    none(&complaints);
}

#[test]
fn the_help_of_every_command_uses_the_words_of_the_field() {
    fn visit(mut command: clap::Command, path: &str, complaints: &mut Vec<String>) -> usize {
        let help = command.render_long_help().to_string();
        judge(&format!("{path} --help"), &help.split_whitespace().collect::<Vec<_>>().join(" "), complaints);
        let children: Vec<_> = command.get_subcommands().cloned().collect();
        1 + children
            .into_iter()
            .map(|c| {
                let path = format!("{path} {}", c.get_name());
                visit(c, &path, complaints)
            })
            .sum::<usize>()
    }
    let mut complaints = Vec::new();
    assert!(visit(Cli::command(), "gaware", &mut complaints) > 15);
    none(&complaints);
}

#[test]
fn strings_of_the_program_use_the_words_of_the_field() {
    let mut all = Vec::new();
    for folder in ["src", "nav/src", "mission/src", "sitl/src", "lab/src"] {
        files(&root().join(folder), &[".rs"], &mut all);
    }
    let (mut complaints, mut strings) = (Vec::new(), 0);
    for file in all {
        for literal in literals(&std::fs::read_to_string(&file).unwrap()) {
            strings += 1;
            judge(&place(&file), &literal, &mut complaints);
        }
    }
    assert!(strings > 3000, "{strings}");
    none(&complaints);
}

#[test]
fn every_exception_is_needed() {
    let mut all = vec![root().join("docs/snapshot.schema.json")];
    files(&root().join("src"), &[".rs", ".js", ".html"], &mut all);
    files(&root().join("mission/src"), &[".rs"], &mut all);
    files(&root().join("lab/src"), &[".rs"], &mut all);
    files(&root().join("web/page"), &[".html", ".js"], &mut all);
    for (at, what, why) in EXCEPTIONS.iter().filter(|e| !e.0.is_empty() && !e.0.contains("--help")) {
        let stands = |file: &&PathBuf| {
            place(file).contains(at) && std::fs::read_to_string(file).unwrap().to_lowercase().contains(what)
        };
        assert!(all.iter().find(stands).is_some(), "{at}: {what} ({why})");
    }
}

#[test]
fn literals_and_words_are_found_where_they_stand() {
    let source = r##"let a = 'x'; // "told"
    let b: &'static str = "one \"two\" \
        three"; let c = r#"raw "told" text"#; let d = '"'; let e = "";"##;
    assert_eq!(literals(source), ["one \\\"two\\\" three", "raw \"told\" text", ""]);
    let words = |text: &str| found(text).into_iter().map(|f| f.0).collect::<Vec<_>>();
    assert_eq!(words("It was told; the bias WANDERS, hidden_state foretold"), ["told", "wander"]);
}

/// Words that a public name must not hold, between underscores or capitals.
const NOT_IN_NAMES: [&str; 19] = [
    "told", "tell", "doubt", "court", "dark", "darkness", "voice", "hopeless", "nowhere", "hear", "heard",
    "standing", "hide", "hidden", "house", "room", "wall", "nobody", "believe",
];

/// Public names that hold one all the same: a contract.
const NAMES: [(&str, &str, &str); 5] = [
    ("src/commands/sim.rs", "hide", "an option of the command line"),
    ("src/commands/sim.rs", "hide_random", "an option of the command line"),
    ("src/demo/result.rs", "dark", "a key of the JSON result"),
    ("lab/src/blind/", "hidden", "a key of the JSON result"),
    ("lab/src/observability.rs", "dark", "a key of the JSON result"),
];

/// Names of public items and fields before the unit tests.
fn public_names(source: &str) -> impl Iterator<Item = &str> {
    let source = source.split("#[cfg(test)]\nmod tests").next().unwrap_or(source);
    let named = |line: &'_ str| -> Option<(usize, usize)> {
        let rest = line.trim_start().strip_prefix("pub ")?;
        let kinds = [
            "const fn ",
            "async fn ",
            "fn ",
            "struct ",
            "enum ",
            "trait ",
            "type ",
            "mod ",
            "const ",
            "static ",
        ];
        let name = kinds.iter().find_map(|k| rest.strip_prefix(k)).unwrap_or(rest);
        let len = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
        Some((line.len() - name.len(), len))
    };
    source.lines().filter_map(move |line| named(line).map(|(at, len)| &line[at..at + len]))
}

/// `ReceivedMessages`, `take_told` → received, messages, take, told.
fn parts(name: &str) -> Vec<String> {
    let (mut out, mut small) = (vec![String::new()], false);
    for c in name.chars() {
        if c == '_' || c.is_uppercase() && small {
            out.push(String::new());
        }
        if let Some(last) = out.last_mut().filter(|_| c != '_') {
            last.extend(c.to_lowercase());
        }
        small = c.is_lowercase();
    }
    out
}

#[test]
fn public_names_use_the_words_of_the_field() {
    let mut all = Vec::new();
    for folder in ["src", "nav/src", "mission/src", "sitl/src", "lab/src"] {
        files(&root().join(folder), &[".rs"], &mut all);
    }
    let (mut complaints, mut names) = (Vec::new(), 0);
    for file in all {
        let source = std::fs::read_to_string(&file).unwrap();
        for name in public_names(&source) {
            names += 1;
            let at = place(&file);
            let allowed = NAMES.iter().any(|(place, exception, _)| at.contains(place) && name == *exception);
            if !allowed && parts(name).iter().any(|p| NOT_IN_NAMES.contains(&p.as_str())) {
                complaints.push(format!("{at}: {name}"));
            }
        }
    }
    assert!(names > 1500, "{names}");
    none(&complaints);
    assert_eq!(
        public_names("pub fn take_told(x: u8)\n  pub room_m: f64,\n").collect::<Vec<_>>(),
        ["take_told", "room_m"]
    );
    assert_eq!(parts("HideError"), ["hide", "error"]);
    assert_eq!(parts("DARK_SIGMA"), ["dark", "sigma"]);
}
