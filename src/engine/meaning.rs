//! What G means for the pilot: the attitude after a turn that nothing corrects, and whether that matters to the vehicle.

use super::snapshot::{Estimate3, EstimateMatrix, TurnError, TurnVerdict};

/// Error of attitude that matters, deg: where the user says nothing. Autopilots hold a bank to about as much.
pub const LIMIT_DEG: f64 = 0.5;
/// The turn: load, g, and length, s; as for the consequences of `explain`.
const TURN: (f64, f64) = (2.0, 60.0);
/// Sigmas on either side of the limit beyond which the verdict is one.
const SIGMAS: f64 = 2.0;
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// The attitude after a turn at 2 g of 60 s: the specific force is 1 g more along the vertical axis than straight and level, where the autopilot has
/// found its gyro biases.
pub fn after_a_turn(g: &EstimateMatrix, limit_deg: f64) -> TurnError {
    let per_deg_per_h = (TURN.0 - 1.0) * TURN.1 / 3600.0;
    let column = |m: &[[f64; 3]; 3]| [m[0][2], m[1][2], m[2][2]].map(|x| x * per_deg_per_h);
    let value = column(&g.value).map(|x| -x);
    let sigma = column(&g.sigma);
    if value.iter().chain(&sigma).all(|x| *x == 0.0) {
        // The model has no G.
        return TurnError::default();
    }
    let worst = (0..3).max_by(|a, b| value[*a].abs().total_cmp(&value[*b].abs())).unwrap_or(0);
    let matters = (0..3).any(|k| value[k].abs() - SIGMAS * sigma[k] > limit_deg);
    let harmless = (0..3).all(|k| value[k].abs() + SIGMAS * sigma[k] < limit_deg);
    let verdict = match (matters, harmless) {
        (true, _) => TurnVerdict::Matters,
        (_, true) => TurnVerdict::DoesNotMatter,
        _ => TurnVerdict::NotKnown,
    };
    let said = match verdict {
        TurnVerdict::Matters => "it matters",
        TurnVerdict::DoesNotMatter => "it does not matter",
        TurnVerdict::NotKnown => "whether it matters is open",
    };
    let text = format!(
        "after a {:.0} s turn at {:.0} g without correction: {} {:.1}° ± {:.1}°; {said} (limit {limit_deg}°)",
        TURN.1,
        TURN.0,
        AXES[worst],
        value[worst].abs(),
        sigma[worst]
    );
    TurnError { attitude_deg: Estimate3 { value, sigma }, limit_deg, verdict, text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(value: [f64; 3], sigma: f64) -> EstimateMatrix {
        let of = |x: f64| [0.0, 0.0, x];
        EstimateMatrix { value: value.map(of), sigma: [of(sigma); 3] }
    }

    #[test]
    fn the_column_along_the_vertical_axis_makes_the_error_and_its_sigma_the_verdict() {
        for (value, sigma, verdict, said) in [
            ([54.0, 0.0, 0.0], 6.0, TurnVerdict::Matters, "roll 0.9° ± 0.1°; it matters (limit 0.5°)"),
            ([-6.0, 12.0, 3.0], 6.0, TurnVerdict::DoesNotMatter, "pitch 0.2° ± 0.1°; it does not matter"),
            (
                [0.0, 0.0, -40.0],
                60.0,
                TurnVerdict::NotKnown,
                "yaw 0.7° ± 1.0°; whether it matters is open (limit 0.5°)",
            ),
        ] {
            let found = after_a_turn(&column(value, sigma), LIMIT_DEG);
            assert_eq!(found.verdict, verdict);
            assert!(found.text.contains(said), "{}", found.text);
        }
        let strict = after_a_turn(&column([-6.0, 12.0, 3.0], 1.0), 0.05);
        assert_eq!(strict.verdict, TurnVerdict::Matters);
    }
}
