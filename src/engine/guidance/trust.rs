//! What predictions of the guidance were worth: a maneuver that did not bring what was predicted is trusted less.
//!
//! The reasons are outside of any prediction (a pilot who cannot fly it here, a fence, a ceiling, weather), so only the share of the gain that came
//! is kept, and forgotten after a while.

use gaware_mission::maneuver::Maneuver;
use gaware_nav::math::{exp, ln};

/// Time after which a disappointment counts for 1/e in the logarithm, s.
const FORGETTING_S: f64 = 300.0;
/// No maneuver is trusted less.
const LEAST: f64 = 0.05;

/// Logarithm of the trust per maneuver and when it was learned, s.
#[derive(Debug, Clone, Default)]
pub(super) struct Trust(Vec<(Maneuver, f64, f64)>);

impl Trust {
    /// These maneuvers, one after the other, brought this share of their predicted gain. Which of them fell short no one knows: each bears
    /// its part until it shows itself in other company.
    pub fn learn(&mut self, t_s: f64, maneuvers: &[Maneuver], share: f64) {
        let each = ln(share.clamp(LEAST, 1.0)) / maneuvers.len().max(1) as f64;
        for maneuver in maneuvers {
            // What worked is trusted again; what failed again is trusted less still.
            let log = if share >= 1.0 { 0.0 } else { (self.log(t_s, *maneuver) + each).max(ln(LEAST)) };
            self.0.retain(|(m, ..)| m != maneuver);
            self.0.push((*maneuver, log, t_s));
        }
    }

    /// Expected share of the predicted gain, at most 1.
    pub fn of(&self, t_s: f64, maneuvers: &[Maneuver]) -> f64 {
        exp(maneuvers.iter().map(|m| self.log(t_s, *m)).sum::<f64>())
    }

    fn log(&self, t_s: f64, maneuver: Maneuver) -> f64 {
        let known = self.0.iter().find(|(m, ..)| *m == maneuver);
        known.map_or(0.0, |(_, log, since_s)| log * exp(-(t_s - since_s).max(0.0) / FORGETTING_S))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_mission::maneuver::Side;

    #[test]
    fn what_failed_is_trusted_less_until_it_works_or_is_forgotten() {
        let (turn, dive, climb) = (Maneuver::SteadyTurn(Side::Right), Maneuver::Descent, Maneuver::Climb);
        let mut trust = Trust::default();
        trust.learn(100.0, &[turn, dive], 0.25);
        assert!((trust.of(100.0, &[turn, dive]) - 0.25).abs() < 1e-9);
        assert!((trust.of(100.0, &[turn, climb]) - 0.5).abs() < 1e-9);
        trust.learn(120.0, &[turn, climb], 1.0);
        assert_eq!(trust.of(120.0, &[turn]), 1.0);
        assert!(trust.of(120.0, &[dive]) < 0.6);
        assert!(trust.of(2000.0, &[dive]) > 0.99);
        (0..20).for_each(|_| trust.learn(3000.0, &[dive], 0.0));
        assert!((trust.of(3000.0, &[dive]) - LEAST).abs() < 1e-9);
    }
}
