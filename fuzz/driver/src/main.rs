//! The driver for the stable toolchain: each target in a process of its own, so that neither an abort nor the memory of one counts for
//! another.
//!
//! `cargo run --profile fuzz -p gaware-fuzz -- --inputs 10000000 framer decode` is the long campaign; the tests of this crate run a short one.

#![forbid(unsafe_code)]

use clap::Parser;
use gaware_fuzz::campaign::{self, Finding, Inputs, Report};
use gaware_fuzz::{TARGETS, Target, by_name, corpus};
use serde_json::{Value, json};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

/// Run mutated inputs through the fuzz targets.
#[derive(Debug, Parser)]
struct Arguments {
    /// Targets; all without any.
    targets: Vec<String>,
    /// Inputs per target.
    #[arg(long, default_value_t = 10_000)]
    inputs: u64,
    /// Number of the first input.
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Seed of the mutations.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Run the inputs in this process, and keep the number of the present one in this file.
    #[arg(long, hide = true)]
    state: Option<PathBuf>,
    /// Write one input to stdout instead of running it.
    #[arg(long)]
    show: Option<u64>,
    /// List the targets.
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("gaware-fuzz: {error}");
            ExitCode::FAILURE
        }
    }
}

/// False where something was found.
fn run(arguments: &Arguments) -> io::Result<bool> {
    let unknown =
        |name: &String| io::Error::other(format!("there is no target \"{name}\"; --list names them"));
    let targets: Vec<&'static Target> = if arguments.targets.is_empty() {
        TARGETS.iter().collect()
    } else {
        arguments.targets.iter().map(|n| by_name(n).ok_or_else(|| unknown(n))).collect::<io::Result<_>>()?
    };
    let mut out = io::stdout();
    if arguments.list {
        targets.iter().try_for_each(|t| writeln!(out, "{}", t.name))?;
        return Ok(true);
    }
    if let Some(number) = arguments.show {
        for target in targets {
            out.write_all(&Inputs::new(target, arguments.seed)?.at(number))?;
        }
        return Ok(true);
    }
    if let Some(state) = &arguments.state {
        for target in targets {
            let inputs = Inputs::new(target, arguments.seed)?;
            let report = campaign::run(inputs, arguments.first, arguments.inputs, &File::create(state)?)?;
            writeln!(out, "{}", document(&report))?;
        }
        return Ok(true);
    }
    let mut clean = true;
    writeln!(
        out,
        "{:<12}{:>12}{:>10}{:>12}{:>12}{:>10}",
        "", "inputs", "s", "slowest ms", "peak MB", "findings"
    )?;
    for target in targets {
        clean &= in_a_process(target, arguments, &mut out)?;
    }
    Ok(clean)
}

/// Runs one target in a process of its own and prints its line; false where something was found.
fn in_a_process(target: &'static Target, arguments: &Arguments, out: &mut impl Write) -> io::Result<bool> {
    let state = std::env::temp_dir().join(format!("gaware-fuzz-{}-{}", std::process::id(), target.name));
    let ended = Command::new(std::env::current_exe()?)
        .arg(target.name)
        .args(["--inputs", &arguments.inputs.to_string(), "--first", &arguments.first.to_string()])
        .args(["--seed", &arguments.seed.to_string(), "--state"])
        .arg(&state)
        .stderr(Stdio::inherit())
        .output()?;
    let report = String::from_utf8_lossy(&ended.stdout).lines().last().and_then(report);
    let report = match report.filter(|_| ended.status.success()) {
        Some(report) => report,
        None => {
            let number = fs::read(&state)?.first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
            corpus::keep(target, &Inputs::new(target, arguments.seed)?.at(number))?;
            let what = format!("the process ended with {} | see stderr", ended.status);
            let inputs = number.saturating_sub(arguments.first);
            Report { inputs, findings: vec![Finding { number, what }], ..Report::default() }
        }
    };
    fs::remove_file(&state)?;
    writeln!(
        out,
        "{:<12}{:>12}{:>11}{:>10.1}{:>12.1}{:>10.1}{:>10}",
        target.name,
        report.inputs,
        report.accepted,
        report.elapsed_s,
        report.slowest_s * 1e3,
        report.peak_kib as f64 / 1024.0,
        report.findings.len()
    )?;
    for finding in &report.findings {
        writeln!(out, "  input {}: {}", finding.number, finding.what)?;
    }
    Ok(report.findings.is_empty())
}

fn document(report: &Report) -> Value {
    let findings: Vec<Value> = report.findings.iter().map(|f| json!([f.number, f.what])).collect();
    json!([report.inputs, report.accepted, report.elapsed_s, report.slowest_s, report.peak_kib, findings])
}

fn report(line: &str) -> Option<Report> {
    let (inputs, accepted, elapsed_s, slowest_s, peak_kib, findings): (_, _, _, _, _, Vec<(u64, String)>) =
        serde_json::from_str(line).ok()?;
    let findings = findings.into_iter().map(|(number, what)| Finding { number, what }).collect();
    Some(Report { inputs, accepted, elapsed_s, slowest_s, peak_kib, findings })
}
