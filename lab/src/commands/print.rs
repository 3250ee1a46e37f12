//! The tables of studies in words.

use crate::{demo, guidance, paper, recorded};
use std::fmt::Write;

pub(super) fn paper(out: &mut String, study: &paper::Study) -> std::fmt::Result {
    writeln!(
        out,
        "The paper's flight, {} runs, initial attitude error {}°",
        study.runs, study.attitude_error_deg
    )?;
    for f in &study.filters {
        let [roll, pitch, yaw] = f.attitude_rms_deg;
        let [low, high] = f.nees_band_95;
        writeln!(
            out,
            "\n{} states: attitude RMS from 60 s {roll:.4}/{pitch:.4}/{yaw:.4}°, NEES/dof {:.3} (95 % band of one epoch {low:.3} to {high:.3}, {:.0} % of epochs inside)",
            f.states,
            f.nees_per_dof,
            100.0 * f.nees_inside_band
        )?;
        writeln!(
            out,
            "{:8}{:>10}{:>12}{:>10}{:>12}{:>12}{:>12}  unit",
            "", "truth", "mean", "± s.e.", "RMS error", "predicted", "bound"
        )?;
        for p in &f.parameters {
            writeln!(
                out,
                "{:8}{:10.3}{:12.4}{:10.4}{:12.4}{:12.4}{:12.4}  {}",
                p.name,
                p.truth,
                p.mean,
                p.mean_standard_error,
                p.rms_error,
                p.predicted_sigma,
                p.bound,
                p.unit
            )?;
        }
    }
    Ok(())
}

pub(super) fn demo(out: &mut String, study: &demo::DemoStudy) -> std::fmt::Result {
    let [low, high] = study.interval_95;
    writeln!(
        out,
        "{}: {} of {} flights completed; {} of {} observable estimates within 2 sigma: {:.3} (95 % interval {low:.3} to {high:.3}), worst {:.2} sigma; planned within a factor 1.5 of reached: {:.3}",
        study.airframe,
        study.completed,
        study.runs,
        study.within_2_sigma,
        study.observable,
        study.share,
        study.worst_normalised_error,
        study.plan_within_factor_1_5
    )?;
    let [low, high] = study.kept_interval_95;
    writeln!(
        out,
        "the plan takes {:.0} s and promises {} states; all of them became observable in {} of {} flights: {:.3} (95 % interval {low:.3} to {high:.3})",
        study.plan_s,
        study.promised.len(),
        study.promise_kept,
        study.completed,
        study.promise_kept as f64 / study.completed.max(1) as f64
    )?;
    if !study.missed.is_empty() {
        let list: Vec<String> =
            study.missed.iter().map(|m| format!("{} {} times", m.name, m.flights)).collect();
        writeln!(out, "promised but not reached: {}", list.join(", "))?;
    }
    if !study.beyond_airframe.is_empty() {
        writeln!(out, "beyond this airframe by the plan's prediction: {}", study.beyond_airframe.join(", "))?;
    }
    let [low, high] = study.reached_over_planned;
    writeln!(
        out,
        "side force {:.2} g at 45° of bank, drawn per flight; flown in {:.2} of the planned time; reached over planned sigma of promised states {low:.2} to {high:.2}, {:.3} of them within 0.8 to 1.25; promised but not observable: {}",
        study.side_force_g,
        study.flown_over_planned_s,
        study.reached_within_0_8_to_1_25,
        study.promised_not_observable
    )?;
    writeln!(
        out,
        "{:>10}{:>10}{:>9}{:>9}{:>9}{:>16}",
        "", "promised", "mean", "lowest", "highest", "not observable"
    )?;
    for r in &study.ratios {
        let promised = if r.promised { "yes" } else { "no" };
        writeln!(
            out,
            "{:>10}{promised:>10}{:9.2}{:9.2}{:9.2}{:16}",
            r.name, r.mean, r.lowest, r.highest, r.not_observable
        )?;
    }
    writeln!(
        out,
        "{:>10}{:>12}{:>10}{:>12}{:>17}",
        "", "observable", "within", "RMS error/σ", "planned/reached"
    )?;
    for s in &study.states {
        writeln!(
            out,
            "{:>10}{:12}{:10}{:12.2}{:17.2}",
            s.name, s.observable, s.within_2_sigma, s.rms_normalised_error, s.planned_over_reached
        )?;
    }
    Ok(())
}

pub(super) fn guidance(out: &mut String, s: &guidance::GuidanceStudy) -> std::fmt::Result {
    writeln!(
        out,
        "{}: columns x and z of G within {} deg/h/g after {:.0} s guided (95 % interval {:.0} to {:.0}), {:.0} s at random (medians of {} from a standstill): {:.0} %",
        s.airframe,
        s.target_deg_per_h_per_g,
        s.guided_median_s,
        s.guided_interval_95_s[0],
        s.guided_interval_95_s[1],
        s.random_median_s,
        s.runs,
        100.0 * s.ratio_of_medians
    )?;
    let [guided, random] = s.from_first_maneuver_s;
    writeln!(
        out,
        "from the first maneuver on {guided:.0} s and {random:.0} s; guided faster in {:.0} % of the pairs; not finished: {} and {}",
        100.0 * s.guided_faster,
        s.unfinished[0],
        s.unfinished[1]
    )?;
    Ok(())
}

pub(super) fn recorded(out: &mut String, r: &recorded::Accuracy) -> std::fmt::Result {
    writeln!(out, "{}: {} epochs, NIS/dof {:.3}", r.set, r.epochs, r.nis_mean_per_dof)?;
    let rows = [
        ("position N/E/D, m", r.position_rms_m),
        ("velocity N/E/D, m/s", r.velocity_rms_m_per_s),
        ("roll/pitch/yaw, deg", r.attitude_rms_deg),
    ];
    for (((name, ours), own), best) in rows.into_iter().zip(r.own_sigma).zip(r.best_of_others) {
        writeln!(
            out,
            "  RMS {name:20} {}   own sigma {}   best of the others {}",
            triple(ours),
            triple(own),
            triple(best)
        )?;
    }
    writeln!(
        out,
        "  the fixes err on average by {} m, which no filter sees; chance gives {}",
        triple(r.fix_mean_error_m),
        triple(r.fix_mean_sigma_m)
    )?;
    Ok(())
}

fn triple([a, b, c]: [f64; 3]) -> String {
    format!("{a:.3} / {b:.3} / {c:.3}")
}
