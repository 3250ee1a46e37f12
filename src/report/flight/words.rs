//! What the estimate means, in sentences.

use super::lessons::is_g;
use crate::engine::snapshot::{EstimateMatrix, Phase, Status, Summary};
use crate::explain::words::number;

/// An element is surely there beyond so many of its sigmas.
pub const SURE: f64 = 3.0;
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];
const COLUMNS: [&str; 3] = ["x", "y", "z"];

/// What to fly for a column of G. An aircraft of unknown type gets no maneuver, only the acceleration that is missing.
fn remedy(column: usize, vehicle: &str) -> &'static str {
    match (vehicle, column) {
        ("fixed_wing", 0) => "fly straight and level, throttle full to idle and back",
        ("fixed_wing", 1) => "fly a sideslip by hand: wings level, full rudder left, then right",
        ("fixed_wing", _) => "fly steep turns and pull-ups",
        ("multirotor", 0) => "dash forward and brake, several times",
        ("multirotor", 1) => "dash sideways and brake, to both sides",
        ("multirotor", _) => "climb and descend with strong changes of thrust",
        (_, 0) => "it needs acceleration along the forward axis",
        (_, 1) => "it needs acceleration along the sideways axis",
        (_, _) => "it needs changes of the acceleration along the vertical axis",
    }
}

/// The largest element of G that is surely there: row, column.
fn largest(g: &EstimateMatrix) -> Option<(usize, usize)> {
    (0..9)
        .map(|k| (k / 3, k % 3))
        .filter(|(r, c)| g.value[*r][*c].abs() > SURE * g.sigma[*r][*c] && g.sigma[*r][*c] > 0.0)
        .max_by(|a, b| g.value[a.0][a.1].abs().total_cmp(&g.value[b.0][b.1].abs()))
}

/// Whether the log has been estimated, though perhaps not to its last second: constants outlive a new alignment.
pub fn has_estimated(summary: &Summary) -> bool {
    summary.phase == Phase::Running || summary.gnss.used > 0
}

/// The result in a few sentences.
pub fn verdict(summary: &Summary) -> String {
    if !has_estimated(summary) {
        return format!("There is no estimate: {}.", summary.waiting_for);
    }
    if summary.phase != Phase::Running {
        let learned = verdict(&Summary { phase: Phase::Running, ..summary.clone() });
        return format!(
            "At the end of the log the attitude was not known ({}). Of the time before: {learned}",
            summary.waiting_for
        );
    }
    let g = &summary.estimate.g_sensitivity_deg_per_h_per_g;
    if !summary.implausible.is_empty() {
        return format!(
            "The values are not usable: the estimates of {} are far outside what the model expects of such a sensor, so these states absorb an \
             unmodelled error. Run `gaware explain`, which tests for sensor errors; where it names one, give its model.toml to this command.",
            summary.implausible.join(", ")
        );
    }
    let estimated = summary.observability.states.iter().any(|s| is_g(&s.name));
    let mut text = match largest(g) {
        _ if !estimated => "G is not estimated: the model has no gyro_g_sensitivity.".to_owned(),
        Some((r, c)) => {
            let (value, sigma) = (g.value[r][c], g.sigma[r][c]);
            let what = ["forward", "sideways", "along the vertical axis"][c];
            format!(
                "Acceleration {what} disturbs the {} gyro: g{}{} is {value:.0} ± {sigma:.0} deg/h/g, {:.1} deg per minute for each g.",
                AXES[r],
                r + 1,
                c + 1,
                (value / 60.0).abs()
            )
        }
        None => "No g-sensitivity stands out of its uncertainty.".to_owned(),
    };
    text.push_str(&columns(summary));
    let nis = summary.consistency.nis_mean_per_dof;
    if nis > 1.5 {
        text.push_str(&format!(
            " The fixes disagree with the model more than it expects ({} sigma RMS, 1 is right): `gaware explain` looks for the unmodelled effect.",
            number(nis.sqrt())
        ));
    }
    text
}

/// Which columns of G have converged, and what shows the others: all of them on the ground, or one by one in flight.
fn columns(summary: &Summary) -> String {
    let (mut text, mut open) = (String::new(), false);
    for (c, axis) in COLUMNS.iter().enumerate() {
        let remedy = remedy(c, &summary.vehicle_type);
        let names: Vec<String> = (1..=3).map(|r| format!("g{r}{}", c + 1)).collect();
        let of_column = || summary.observability.states.iter().filter(|s| names.contains(&s.name));
        let known = of_column().filter(|s| s.status == Status::Observable).count();
        let all = of_column().count();
        if all == 0 {
            continue;
        }
        if known == all {
            text.push_str(&format!(" Column {axis} of G has converged."));
        } else {
            let some = if known == 0 { "has not converged" } else { "has converged in part" };
            text.push_str(&format!(" Column {axis} {some}: {remedy}."));
            open = true;
        }
    }
    if open {
        text.push_str(" Or on the ground: turned to six sides by hand it shows all of G in five minutes (`gaware ground`).");
    }
    text
}

/// A change of specific force and the rate error that it makes on each gyro.
#[derive(Debug, Clone, PartialEq)]
pub struct Meaning {
    /// What is flown.
    pub when: &'static str,
    /// Error of the roll, pitch and yaw gyros, deg per minute, with sigma.
    pub error_deg_per_min: [(f64, f64); 3],
}

/// What G does to the gyros in typical flight, against straight and level flight or hover.
pub fn meanings(g: &EstimateMatrix, vehicle: &str) -> Vec<Meaning> {
    // A change of specific force, g, in body axes; level flight and hover have (0, 0, −1).
    let changes = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.5, 0.0, 0.0], [0.0, 0.3, 0.0]];
    let names: [&'static str; 4] = match vehicle {
        "fixed_wing" => [
            "turn with 60° of bank (2 g)",
            "push-over to weightlessness (0 g)",
            "acceleration forward by 0.5 g",
            "sideslip with 0.3 g to the right",
        ],
        _ => [
            "2 g along the vertical axis",
            "weightlessness (0 g)",
            "acceleration forward by 0.5 g",
            "acceleration to the right by 0.3 g",
        ],
    };
    let cases = names.into_iter().zip(changes);
    let error = |row: usize, f: &[f64; 3]| {
        let value: f64 = (0..3).map(|c| g.value[row][c] * f[c]).sum();
        let variance: f64 = (0..3).map(|c| (g.sigma[row][c] * f[c]).powi(2)).sum();
        (value / 60.0, variance.sqrt() / 60.0)
    };
    cases
        .map(|(when, f)| Meaning { when, error_deg_per_min: [error(0, &f), error(1, &f), error(2, &f)] })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::snapshot::StateStatus;

    #[test]
    fn a_known_column_makes_a_turn_cost_degrees() {
        let mut g = EstimateMatrix::default();
        (g.value[2][2], g.sigma[2][2]) = (-360.0, 24.0);
        let turn = &meanings(&g, "fixed_wing")[0];
        assert_eq!(turn.error_deg_per_min[2], (6.0, 0.4));
        let mut summary = Summary { phase: Phase::Running, ..Summary::default() };
        summary.estimate.g_sensitivity_deg_per_h_per_g = g;
        let step = StateStatus { name: "gps_step_n".to_owned(), ..StateStatus::default() };
        summary.observability.states = vec![step];
        assert!(verdict(&summary).contains("G is not estimated"));
        let state =
            StateStatus { name: "g33".to_owned(), sigma: 24.0, sigma_ratio: 0.1, ..StateStatus::default() };
        summary.observability.states = vec![state];
        let text = verdict(&summary);
        assert!(
            text.contains("disturbs the yaw gyro")
                && text.contains("-360 ± 24")
                && text.contains("6.0 deg per minute"),
            "{text}"
        );
    }

    #[test]
    fn values_that_no_sensor_has_are_not_shown() {
        let mut summary = Summary { phase: Phase::Running, ..Summary::default() };
        summary.estimate.g_sensitivity_deg_per_h_per_g.value[1][0] = -2500.0;
        summary.estimate.g_sensitivity_deg_per_h_per_g.sigma[1][0] = 200.0;
        let state =
            StateStatus { name: "g21".to_owned(), sigma: 200.0, sigma_ratio: 0.55, ..StateStatus::default() };
        summary.observability.states = vec![state];
        summary.implausible = vec!["g21".to_owned()];
        assert!(verdict(&summary).contains("not usable: the estimates of g21 are"), "{}", verdict(&summary));
        summary.estimate.g_sensitivity_deg_per_h_per_g.value[1][0] = -1400.0;
        summary.implausible.clear();
        assert!(verdict(&summary).contains("disturbs the pitch gyro"), "{}", verdict(&summary));
    }

    #[test]
    fn without_an_estimate_the_reason_is_told() {
        let summary = Summary { waiting_for: "no GNSS fix yet".to_owned(), ..Summary::default() };
        assert_eq!(verdict(&summary), "There is no estimate: no GNSS fix yet.");
    }

    /// Two public logs of copters end within a second of a new alignment, after minutes of estimation.
    #[test]
    fn what_was_learned_before_the_last_second_is_told() {
        let mut summary = Summary { waiting_for: "levelling".to_owned(), ..Summary::default() };
        summary.gnss.used = 440;
        let said = verdict(&summary);
        assert!(
            said.starts_with("At the end of the log the attitude was not known (levelling). Of"),
            "{said}"
        );
    }
}
