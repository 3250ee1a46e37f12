//! What to fly so that effects that imitate each other come apart: what their files say, in the words of the planner's maneuvers.

use gaware_mission::airframe::Airframe;
use gaware_mission::maneuver::{Maneuver, Side};
use gaware_nav::effects::{self, Excitation, Separation};

/// The maneuver that makes an excitation.
fn maneuver(excitation: Excitation) -> Maneuver {
    match excitation {
        Excitation::VaryingSpeed => Maneuver::VaryingSpeed,
        Excitation::SteadyTurn => Maneuver::SteadyTurn(Side::Right),
        Excitation::PullUp => Maneuver::PullUp,
        Excitation::FigureEight => Maneuver::FigureEight,
        Excitation::Sideslip => Maneuver::Sideslip,
    }
}

/// What separates any two of a group.
fn separations(group: &[&str]) -> Vec<&'static Separation> {
    let members = group.iter().filter_map(|name| effects::find(name));
    let all = members.flat_map(|effect| effect.separations());
    all.filter(|s| group.contains(&s.from)).collect()
}

/// Maneuvers that excite everything, for groups of which no file says more.
const EVERYTHING: [Maneuver; 4] =
    [Maneuver::FigureEight, Maneuver::PullUp, Maneuver::VaryingSpeed, Maneuver::Sideslip];

fn words(maneuver: Maneuver, airframe: &Airframe) -> String {
    let maneuver = match maneuver {
        Maneuver::Sideslip if !airframe.is_fixed_wing() => Maneuver::CrabLegs,
        other => other,
    };
    maneuver.words(airframe).long
}

/// With a capital and a full stop.
fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|c| c.to_uppercase().collect::<String>()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// The maneuvers that separate the members of a group, for a typical airframe of this kind; `None` for a single effect.
pub fn separate(group: &[&str], fixed_wing: bool) -> Option<String> {
    if group.len() < 2 {
        return None;
    }
    let airframe = &Airframe::example(if fixed_wing { "small_fixed_wing" } else { "quadrotor" })?;
    let mut advice: Vec<String> = Vec::new();
    for pair in separations(group) {
        let fly: Vec<String> = pair.fly.iter().map(|e| words(maneuver(*e), airframe)).collect();
        advice.push(if fly.is_empty() {
            sentence(pair.why)
        } else {
            format!("{} ({})", fly.join(" "), pair.why)
        });
    }
    if advice.is_empty() {
        advice.extend(EVERYTHING.iter().map(|m| words(*m, airframe)));
    }
    advice.dedup();
    Some(advice.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_separation_is_from_another_effect_that_exists() {
        let mut pairs = 0;
        for effect in effects::REGISTRY {
            for separation in effect.separations() {
                let other = effects::find(separation.from).unwrap();
                assert_ne!(other.name(), effect.name());
                // Where nothing is to be flown, the reason says what else to do.
                assert!(!separation.why.is_empty(), "{}", effect.name());
                assert!(
                    !separation.fly.is_empty() || separation.why.contains("measure"),
                    "{}",
                    effect.name()
                );
                // A pair stands in one file.
                assert!(other.separations().iter().all(|s| s.from != effect.name()), "{}", effect.name());
                pairs += 1;
            }
        }
        assert!(pairs >= 20, "{pairs}");
    }

    #[test]
    fn a_single_effect_needs_no_maneuver() {
        assert_eq!(separate(&["gps_latency"], true), None);
        let advice = separate(&["gps_lever_arm", "gps_latency"], true).unwrap();
        assert!(advice.contains("throttle") && advice.contains("grows with the speed"), "{advice}");
        assert!(separate(&["gps_latency", "accel_bias_drift"], true).is_some());
        let told = separate(&["gps_lever_arm", "accel_lever_arm"], true).unwrap();
        assert!(told.starts_with("No motion separates them: measure"), "{told}");
        let rotor = separate(&["accel_scale_factor", "accel_misalignment"], false).unwrap();
        assert!(!rotor.contains("rudder"), "{rotor}");
    }
}
