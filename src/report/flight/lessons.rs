//! Which parts of a flight taught most, and what the vehicle did there.

use crate::engine::snapshot::{Phase, Snapshot, StateStatus};
use crate::report::plot;
use gaware_nav::math::{hypot, ln};

/// Length of a part, s.
const PART_S: f64 = 15.0;
/// Parts that are reported at most.
const TOLD: usize = 6;
/// A sigma that shrinks by less than this factor is not worth words.
const LEAST_REDUCTION: f64 = 1.08;
/// States that are reported per part at most.
const STATES_TOLD: usize = 4;
/// Banked beyond this counts as a turn, deg.
pub const BANKED_DEG: f64 = 20.0;

/// A part of the flight and what it taught.
#[derive(Debug, Clone, PartialEq)]
pub struct Lesson {
    /// From, s since the first sample.
    pub start_s: f64,
    /// To.
    pub end_s: f64,
    /// Sum over the elements of G of the logarithms by which their sigmas shrank.
    pub gain: f64,
    /// What the vehicle did, in words.
    pub did: String,
    /// Sigmas that shrank, best first: state and factor.
    pub states: Vec<(String, f64)>,
}

/// Whether this is the name of an element of G.
pub fn is_g(name: &str) -> bool {
    matches!(name.as_bytes(), [b'g', b'1'..=b'3', b'1'..=b'3'])
}

/// The parts that taught most about G, in the order of time.
pub fn lessons(snapshots: &[Snapshot]) -> Vec<Lesson> {
    let running: Vec<&Snapshot> = snapshots.iter().filter(|s| s.phase == Phase::Running).collect();
    let mut all = Vec::new();
    let mut rest = running.as_slice();
    while let Some(first) = rest.first() {
        let n = rest.iter().take_while(|s| s.elapsed_s < first.elapsed_s + PART_S).count();
        // The part ends where the next begins.
        let part = rest.get(..(n + 1).min(rest.len())).unwrap_or(rest);
        all.extend(lesson(part));
        rest = rest.get(n..).unwrap_or_default();
    }
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    all.truncate(TOLD);
    all.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    all
}

fn lesson(part: &[&Snapshot]) -> Option<Lesson> {
    let (first, last) = (part.first()?, part.last()?);
    let factor = |before: &StateStatus| {
        let after = last.observability.states.iter().find(|s| s.name == before.name)?;
        Some((before.name.clone(), before.sigma / after.sigma)).filter(|(_, f)| f.is_finite())
    };
    let mut states: Vec<(String, f64)> =
        first.observability.states.iter().filter(|s| is_g(&s.name)).filter_map(factor).collect();
    let gain = states.iter().map(|(_, f)| ln(f.max(1.0))).sum();
    states.retain(|(_, f)| *f > LEAST_REDUCTION);
    states.sort_by(|a, b| b.1.total_cmp(&a.1));
    states.truncate(STATES_TOLD);
    (!states.is_empty()).then(|| Lesson {
        start_s: first.elapsed_s,
        end_s: last.elapsed_s,
        gain,
        did: did(part),
        states,
    })
}

/// Smallest and largest.
fn span(part: &[&Snapshot], of: impl Fn(&Snapshot) -> f64) -> (f64, f64) {
    plot::span(part.iter().map(|s| of(s)))
}

/// Speed over ground, m/s.
pub fn speed(s: &Snapshot) -> f64 {
    let [n, e, _] = s.motion.velocity_ned_m_per_s;
    hypot(n, e)
}

/// Load factor: specific force upward along the body, g.
pub fn load(s: &Snapshot) -> f64 {
    -s.motion.specific_force_g[2]
}

/// What the vehicle did in this part, as a pilot would say it.
fn did(part: &[&Snapshot]) -> String {
    let mut words = Vec::new();
    let (left, right) = span(part, |s| s.estimate.attitude_deg.value[0]);
    match (left < -BANKED_DEG, right > BANKED_DEG) {
        (true, true) => words.push(format!("banks from {left:.0}° to {right:.0}°")),
        (true, false) => words.push(format!("banks left up to {:.0}°", -left)),
        (false, true) => words.push(format!("banks right up to {right:.0}°")),
        (false, false) => {}
    }
    let (low, high) = span(part, load);
    if high - low > 0.25 {
        words.push(format!("load {low:.1} to {high:.1} g"));
    }
    let (ahead_low, ahead_high) = span(part, |s| s.motion.specific_force_g[0]);
    if ahead_high - ahead_low > 0.2 {
        words.push(format!("forward force {ahead_low:.1} to {ahead_high:.1} g"));
    }
    let (side_low, side_high) = span(part, |s| s.motion.specific_force_g[1]);
    if side_high - side_low > 0.2 {
        words.push(format!("side force {side_low:.1} to {side_high:.1} g"));
    }
    let (slow, fast) = span(part, speed);
    if fast - slow > 3.0 {
        words.push(format!("speed {slow:.0} to {fast:.0} m/s"));
    }
    if words.is_empty() { "steady".to_owned() } else { words.join(", ") }
}

/// When each state fell below its target for good, s since the first sample; states that never did are left out.
pub fn known_since(snapshots: &[Snapshot]) -> Vec<(String, f64)> {
    let Some(last) = snapshots.last() else { return Vec::new() };
    let below = |s: &Snapshot, name: &str| {
        s.observability.states.iter().any(|state| state.name == name && state.sigma <= state.target)
    };
    last.observability
        .states
        .iter()
        .filter(|state| state.sigma <= state.target)
        .filter_map(|state| {
            let since = snapshots.iter().rev().take_while(|s| below(s, &state.name)).last()?;
            Some((state.name.clone(), since.elapsed_s))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::cos;

    use super::*;

    /// Sigmas of g11 and g33 and a bank every half second.
    fn flight(of: impl Fn(f64) -> (f64, f64, f64)) -> Vec<Snapshot> {
        (0..180)
            .map(|k| {
                let t = 0.5 * f64::from(k);
                let (g11, g33, bank) = of(t);
                let mut s = Snapshot { elapsed_s: t, phase: Phase::Running, ..Snapshot::default() };
                let state = |name: &str, sigma| StateStatus {
                    name: name.to_owned(),
                    sigma,
                    target: 40.0,
                    ..StateStatus::default()
                };
                s.observability.states = vec![state("g11", g11), state("g33", g33)];
                s.estimate.attitude_deg.value[0] = bank;
                s.motion.specific_force_g = [0.0, 0.0, -1.0 / cos(bank.to_radians())];
                s
            })
            .collect()
    }

    #[test]
    fn the_turn_that_made_g33_known_is_told() {
        let snapshots = flight(|t| match t {
            t if t < 30.0 => (300.0, 300.0, 0.0),
            t if t < 45.0 => (300.0, 300.0 - 18.0 * (t - 30.0), -50.0),
            _ => (300.0, 30.0, 0.0),
        });
        let told = lessons(&snapshots);
        assert_eq!(told.len(), 1, "{told:?}");
        assert_eq!((told[0].start_s, told[0].end_s), (30.0, 45.0));
        assert!(
            told[0].did.contains("left up to 50") && told[0].did.contains("load 1.0 to 1.6 g"),
            "{}",
            told[0].did
        );
        assert!(told[0].states[0].0 == "g33" && (told[0].states[0].1 - 10.0).abs() < 1e-9);
        let known = known_since(&snapshots);
        assert_eq!(known.len(), 1);
        assert!(known[0].0 == "g33" && (44.0..46.0).contains(&known[0].1), "{known:?}");
    }

    #[test]
    fn a_flight_that_taught_nothing_has_no_lessons() {
        assert_eq!(lessons(&flight(|_| (300.0, 300.0, 0.0))), vec![]);
        assert_eq!(lessons(&[]), vec![]);
    }
}
