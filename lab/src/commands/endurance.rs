//! `gaware study endurance`: do the sigmas hold for hours and through faults?

use super::{StudyError, show, with_bar};
use crate::endurance::{self, Endurance, Settings};
use std::fmt::Write;

/// Arguments of `study endurance`.
#[derive(Debug, Clone, clap::Args)]
pub struct EnduranceArgs {
    /// Vehicles per case.
    #[arg(long, default_value_t = 24)]
    pub seeds: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only cases whose name contains this (repeatable), for example `stand-15min` or `wing-raw`.
    #[arg(long, value_name = "NAME")]
    pub case: Vec<String>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the study and prints it.
///
/// # Errors
/// What the study says.
pub fn run(args: &EnduranceArgs) -> Result<(), StudyError> {
    let settings = Settings { seeds: args.seeds, seed: args.seed, cases: args.case.clone() };
    let flights = endurance::flights(&settings)?;
    let study = with_bar(flights, "flights", |bar| endurance::run(&settings, bar))?;
    show(args.json, &study, print)
}

fn print(out: &mut String, study: &Endurance) -> std::fmt::Result {
    for case in &study.cases {
        write!(out, "{}, {} vehicles", case.case, case.seeds)?;
        if let Some(s) = case.recovered_after_s {
            write!(out, "; position right again {s:.0} s after the first fix (worst)")?;
        }
        if let Some(s) = case.followed_jump_for_s {
            write!(out, "; longest time on the wrong side of the jump {s:.1} s")?;
        }
        writeln!(out)?;
        writeln!(
            out,
            "  {:12}{:>8}{:>5}{:>10}{:>10}{:>9}{:>9}{:>9}{:>9}{:>9}{:>11}  RMS error m, m/s, deg",
            "",
            "t, s",
            "run",
            "NEES/dof",
            "worst",
            "G > 3σ",
            "yaw σ",
            "tilt σ",
            "(by b_a)",
            "latency",
            "rest deg/h"
        )?;
        for c in &case.checkpoints {
            let [r, v, a] = c.rms_error;
            writeln!(
                out,
                "  {:12}{:8.0}{:5}{:10.2}{:10.2}{:8.1}%{:9.2}{:9.3}{:9.3}{:9.3}{:11.2}  {r:.2} {v:.3} {a:.2}",
                c.name,
                c.t_s,
                c.running,
                c.nees_mean_per_dof,
                c.nees_worst_per_dof,
                100.0 * c.g_beyond_3_sigma,
                c.yaw_sigma_deg,
                c.tilt_sigma_deg,
                c.tilt_by_accel_bias_deg,
                c.latency_sigma_ratio,
                c.rest_rate_sigma_deg_per_h,
            )?;
        }
    }
    Ok(())
}
