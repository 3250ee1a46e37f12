//! What to fly so that effects that imitate each other come apart (field notes, "Which effects imitate which").

/// Names of two effects, and what tells them apart.
const PAIRS: &[(&str, &str, &str)] = &[
    (
        "gps_latency",
        "gps_lever_arm",
        "change speed in straight flight (10 m/s within 5 s), then turn to both sides",
    ),
    (
        "gyro_g_sensitivity",
        "gyro_misalignment",
        "pull up and push over with wings level: specific force changes, the rates about roll and yaw do not",
    ),
    (
        "gyro_g_sensitivity",
        "gyro_scale_factor",
        "roll from side to side at constant load: rates change, specific force hardly does",
    ),
    (
        "gyro_g_sensitivity",
        "gyro_g2_sensitivity",
        "pull up to 2.5 g and push over to 0.2 g: a square and a line part there",
    ),
    ("gyro_g_sensitivity", "gyro_bias_drift", "repeat the same turn early and late in the flight"),
    ("gyro_g_sensitivity", "gyro_bias_step", "repeat the same turn early and late in the flight"),
    ("gyro_g2_sensitivity", "gyro_misalignment", "pull up and push over with wings level"),
    ("gyro_g2_sensitivity", "gyro_scale_factor", "roll from side to side at constant load"),
    (
        "gyro_scale_factor",
        "gyro_misalignment",
        "rotate about more than one axis: roll quickly in level flight, then yaw flat with the rudder",
    ),
    (
        "accel_scale_factor",
        "accel_nonlinearity",
        "steep turns at 45 and 60 degrees of bank and a push-over: three loads tell a line from a square",
    ),
    ("accel_scale_factor", "accel_misalignment", "sideslips to both sides and changes of speed"),
    ("accel_misalignment", "accel_nonlinearity", "sideslips to both sides and changes of speed"),
    (
        "imu_truncation",
        "gyro_scale_factor",
        "hold slow turns of different rates: half a count does not grow with the rate",
    ),
    (
        "imu_truncation",
        "gyro_g_sensitivity",
        "hold slow turns of different rates: half a count does not grow with the load",
    ),
    ("gyro_temperature", "gyro_bias_drift", "a second flight that starts with a warm autopilot"),
    ("accel_temperature", "accel_bias_drift", "a second flight that starts with a warm autopilot"),
    ("gyro_temperature", "gyro_bias_step", "a second flight that starts with a warm autopilot"),
    ("gyro_bias_drift", "gyro_bias_step", "fly on for some minutes: a step happens once"),
];

/// The maneuver that tells the members of a group apart; `None` for a single effect.
pub fn separate(group: &[&str]) -> Option<String> {
    if group.len() < 2 {
        return None;
    }
    let mut found: Vec<&str> = Vec::new();
    for (a, b, text) in PAIRS {
        if group.contains(a) && group.contains(b) && !found.contains(text) {
            found.push(text);
        }
    }
    if found.is_empty() {
        return Some(
            "fly turns to both sides, pull-ups and push-overs, changes of speed and sideslips, each for itself".into(),
        );
    }
    Some(found.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::effects;

    #[test]
    fn the_table_speaks_of_effects_that_exist() {
        for (a, b, _) in PAIRS {
            assert!(effects::find(a).is_some() && effects::find(b).is_some(), "{a} {b}");
        }
    }

    #[test]
    fn a_single_effect_needs_no_maneuver() {
        assert_eq!(separate(&["gps_latency"]), None);
        assert!(separate(&["gps_lever_arm", "gps_latency"]).is_some_and(|t| t.contains("speed")));
        assert!(separate(&["gps_latency", "accel_bias_drift"]).is_some());
    }
}
