//! What to fly so that effects that imitate each other come apart: the table `separate.toml`, in the words of the planner's maneuvers.

use gaware_mission::airframe::Airframe;
use gaware_mission::maneuver::{Maneuver, Side};
use serde::Deserialize;
use std::sync::OnceLock;

/// Two effects, and what tells them apart.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pair {
    effects: [String; 2],
    fly: Vec<Maneuver>,
    why: String,
}

#[derive(Debug, Default, Deserialize)]
struct Table {
    pair: Vec<Pair>,
}

fn table() -> &'static [Pair] {
    static TABLE: OnceLock<Table> = OnceLock::new();
    // A test reads the same text.
    &TABLE.get_or_init(|| toml::from_str(include_str!("separate.toml")).unwrap_or_default()).pair
}

/// Maneuvers that excite everything, for groups that the table does not know.
const EVERYTHING: [Maneuver; 4] =
    [Maneuver::FigureEight, Maneuver::PullUp, Maneuver::VaryingSpeed, Maneuver::Sideslip];

fn words(maneuver: Maneuver, airframe: &Airframe) -> String {
    let maneuver = match maneuver {
        Maneuver::Sideslip if !airframe.is_fixed_wing() => Maneuver::CrabLegs,
        // One side alone may be the wind.
        Maneuver::SteadyTurn(Side::Left) => Maneuver::SteadyTurn(Side::Right),
        other => other,
    };
    maneuver.words(airframe).long
}

/// The maneuvers that tell the members of a group apart, for a typical airframe of this kind; `None` for a single effect.
pub fn separate(group: &[&str], fixed_wing: bool) -> Option<String> {
    if group.len() < 2 {
        return None;
    }
    let airframe = &Airframe::example(if fixed_wing { "small_fixed_wing" } else { "quadrotor" })?;
    let mut told: Vec<String> = Vec::new();
    for pair in table().iter().filter(|p| p.effects.iter().all(|e| group.contains(&e.as_str()))) {
        let fly: Vec<String> = pair.fly.iter().map(|m| words(*m, airframe)).collect();
        told.push(format!("{} ({})", fly.join(" "), pair.why));
    }
    if told.is_empty() {
        told.extend(EVERYTHING.iter().map(|m| words(*m, airframe)));
    }
    told.dedup();
    Some(told.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::effects;

    #[test]
    fn the_table_speaks_of_effects_that_exist() {
        let table: Table = toml::from_str(include_str!("separate.toml")).unwrap();
        assert!(table.pair.len() >= 18);
        for pair in table.pair {
            assert!(pair.effects.iter().all(|e| effects::find(e).is_some()), "{:?}", pair.effects);
            assert!(!pair.fly.is_empty());
        }
    }

    #[test]
    fn a_single_effect_needs_no_maneuver() {
        assert_eq!(separate(&["gps_latency"], true), None);
        let told = separate(&["gps_lever_arm", "gps_latency"], true).unwrap();
        assert!(told.contains("throttle") && told.contains("grows with the speed"), "{told}");
        assert!(separate(&["gps_latency", "accel_bias_drift"], true).is_some());
        let rotor = separate(&["accel_scale_factor", "accel_misalignment"], false).unwrap();
        assert!(!rotor.contains("rudder"), "{rotor}");
    }
}
