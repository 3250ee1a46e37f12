//! The autopilot's attitude beside ours: in level flight and in turns.

use super::lessons::BANKED_DEG;
use crate::attitudes::Attitudes;
use crate::engine::snapshot::{Phase, Snapshot};

/// Largest shift between the two that is searched, s.
const MAX_SHIFT_S: f64 = 0.1;
/// Fewer differences than this say nothing.
const ENOUGH: usize = 20;
/// Level within this, deg.
const LEVEL_DEG: f64 = 8.0;
/// Our attitude counts once its worst sigma is below this, deg.
pub const SETTLED_DEG: f64 = 3.0;

/// How the two differ while the vehicle does one thing.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What the vehicle did.
    pub regime: &'static str,
    /// Instants compared.
    pub count: usize,
    /// Mean difference in roll, pitch, yaw, autopilot less ours, deg.
    pub mean_deg: [f64; 3],
    /// RMS difference, deg.
    pub rms_deg: [f64; 3],
    /// Our own mean sigma, deg.
    pub sigma_deg: [f64; 3],
}

/// The two attitudes compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// By how much ours lags behind the autopilot's, s; taken out.
    pub shift_s: f64,
    /// Time and difference in roll, pitch, yaw, autopilot less ours, deg.
    pub differences: Vec<(f64, [f64; 3])>,
    /// By regime.
    pub rows: Vec<Row>,
}

/// The snapshot nearest before: bank and sigmas of our attitude, deg.
struct Around {
    bank_deg: f64,
    sigma_deg: [f64; 3],
}

impl Around {
    fn of(s: &Snapshot) -> Self {
        let attitude = &s.estimate.attitude_deg;
        Self { bank_deg: attitude.value[0].abs(), sigma_deg: attitude.sigma }
    }
}

/// Compares once our own attitude is settled; nothing where the log has too little of the autopilot's.
pub fn compare(attitudes: &Attitudes, snapshots: &[Snapshot]) -> Option<Comparison> {
    let shift_s = attitudes.best_shift_s(MAX_SHIFT_S)?;
    let mut next = 0;
    let mut kept = Vec::new();
    for (t, difference) in attitudes.differences(shift_s) {
        while snapshots.get(next + 1).is_some_and(|s| s.elapsed_s <= t) {
            next += 1;
        }
        let Some(s) = snapshots.get(next).filter(|s| s.phase == Phase::Running) else { continue };
        let around = Around::of(s);
        if around.sigma_deg.iter().any(|sigma| *sigma > SETTLED_DEG) {
            continue;
        }
        kept.push((t, difference.map(|d| -d.to_degrees()), around));
    }
    let regimes: [(&'static str, &dyn Fn(f64) -> bool); 3] = [
        ("the whole flight", &|_| true),
        ("level (bank below 8°)", &|bank| bank < LEVEL_DEG),
        ("in turns (bank beyond 20°)", &|bank| bank > BANKED_DEG),
    ];
    let rows: Vec<Row> = regimes.iter().filter_map(|(name, within)| row(name, within, &kept)).collect();
    (!rows.is_empty()).then(|| Comparison {
        shift_s,
        differences: kept.into_iter().map(|(t, d, _)| (t, d)).collect(),
        rows,
    })
}

/// Whether all three angles became known.
pub fn has_settled(snapshots: &[Snapshot]) -> bool {
    let running = snapshots.iter().filter(|s| s.phase == Phase::Running);
    running.map(|s| s.estimate.attitude_deg.sigma).any(|sigma| sigma.iter().all(|v| *v < SETTLED_DEG))
}

/// Why there is no comparison, in a sentence.
pub fn why_not_compared(attitudes: &Attitudes, snapshots: &[Snapshot]) -> String {
    if snapshots.is_empty() {
        return "Not compared: there is no estimate of this program.".to_owned();
    }
    if attitudes.newest_reference_s().is_none() {
        return "The log has no attitude of the autopilot to compare with.".to_owned();
    }
    let running = || snapshots.iter().filter(|s| s.phase == Phase::Running);
    let sigmas = running().map(|s| s.estimate.attitude_deg.sigma);
    let worst = |sigma: [f64; 3]| sigma.into_iter().fold(0.0, f64::max);
    let best = sigmas.map(worst).fold(f64::INFINITY, f64::min);
    if best.is_finite() && best > SETTLED_DEG {
        return format!(
            "Not compared: the sigma of this estimate's own attitude never fell below {best:.1}°, {SETTLED_DEG:.0}° are needed."
        );
    }
    "Not compared: the log has too few attitudes of the autopilot while there was an estimate.".to_owned()
}

fn row(regime: &'static str, within: &dyn Fn(f64) -> bool, all: &[(f64, [f64; 3], Around)]) -> Option<Row> {
    let (mut count, mut sum, mut squares, mut sigma_deg) = (0_usize, [0.0; 3], [0.0; 3], [0.0; 3]);
    for (_, difference, around) in all.iter().filter(|(_, _, around)| within(around.bank_deg)) {
        count += 1;
        for k in 0..3 {
            sum[k] += difference[k];
            squares[k] += difference[k].powi(2);
            sigma_deg[k] += around.sigma_deg[k];
        }
    }
    let n = count as f64;
    (count >= ENOUGH).then(|| Row {
        regime,
        count,
        mean_deg: sum.map(|v| v / n),
        rms_deg: squares.map(|v| (v / n).sqrt()),
        sigma_deg: sigma_deg.map(|v| v / n),
    })
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::{cos, sin};

    use super::*;

    #[test]
    fn an_error_in_turns_is_told_apart_from_level_flight() {
        // Banked from 20 to 40 s; there the autopilot reads 2 deg too little of roll.
        let bank = |t: f64| if (20.0..40.0).contains(&t) { 40.0_f64 } else { 0.0 };
        let mut attitudes = Attitudes::default();
        let mut snapshots = Vec::new();
        for k in 0..600 {
            let t = 0.1 * f64::from(k);
            let error = if bank(t) > 0.0 { -2.0_f64 } else { 0.0 };
            attitudes.push_estimate(t, [bank(t).to_radians(), 0.0, 0.1 * t]);
            attitudes.push_reference(t, [(bank(t) + error).to_radians(), 0.0, 0.1 * t]);
            let mut s = Snapshot { elapsed_s: t, phase: Phase::Running, ..Snapshot::default() };
            s.estimate.attitude_deg.value[0] = bank(t);
            s.estimate.attitude_deg.value[2] = (0.1 * t).to_degrees();
            s.estimate.attitude_deg.sigma = [0.1; 3];
            s.motion.velocity_ned_m_per_s = [20.0 * cos(0.1 * t), 20.0 * sin(0.1 * t), 0.0];
            snapshots.push(s);
        }
        let found = compare(&attitudes, &snapshots).unwrap();
        let by = |name: &str| found.rows.iter().find(|r| r.regime.starts_with(name)).unwrap().clone();
        assert!((by("in turns").mean_deg[0] + 2.0).abs() < 0.05, "{found:?}");
        assert!(by("level").rms_deg[0] < 0.05);
        assert_eq!(found.shift_s, 0.0);
        assert_eq!(compare(&Attitudes::default(), &snapshots), None);
    }

    #[test]
    fn why_nothing_is_compared_is_said_as_it_is() {
        let mut attitudes = Attitudes::default();
        let mut s = Snapshot { phase: Phase::Running, ..Snapshot::default() };
        s.estimate.attitude_deg.sigma = [1.0, 1.0, 8.0];
        let snapshots = [s];
        assert!(why_not_compared(&attitudes, &snapshots).contains("has no attitude of the autopilot"));
        attitudes.push_reference(1.0, [0.0; 3]);
        let why = why_not_compared(&attitudes, &snapshots);
        assert!(why.contains("never fell below 8.0°"), "{why}");
        assert!(why_not_compared(&attitudes, &[]).contains("no estimate of this program"));
    }
}
