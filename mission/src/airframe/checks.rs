//! Ranges of every number of an airframe, and of the numbers against each other: what is outside no flight is predicted for, and some
//! of it would need more memory or time than there is.

use super::{Airframe, AirframeError};
use gaware_nav::math::cos;

/// Longest change from cruise to the fastest speed or back, s.
const LONGEST_CHANGE_S: f64 = 60.0;

pub(super) fn run(a: &Airframe) -> Result<(), AirframeError> {
    ranges(a)?;
    if a.is_fixed_wing() {
        if a.speed_min_m_per_s <= 0.0 {
            return wrong("speed_min_m_per_s", a.speed_min_m_per_s, "a fixed wing cannot hover");
        }
        wing_turns(a)?;
    } else if a.load_factor_max <= 1.0 {
        return wrong("load_factor_max", a.load_factor_max, "a multirotor that hovers has more than 1");
    }
    speeds(a)
}

fn wrong(key: &'static str, value: f64, reason: impl Into<String>) -> Result<(), AirframeError> {
    Err(AirframeError::Value { key, value, reason: reason.into() })
}

/// Every number alone.
fn ranges(a: &Airframe) -> Result<(), AirframeError> {
    let ranges = [
        ("speed_min_m_per_s", a.speed_min_m_per_s, 0.0, 200.0),
        ("speed_cruise_m_per_s", a.speed_cruise_m_per_s, 1.0, 200.0),
        ("speed_max_m_per_s", a.speed_max_m_per_s, 1.0, 200.0),
        ("acceleration_m_per_s2", a.acceleration_m_per_s2, 0.1, 100.0),
        ("braking_m_per_s2", a.braking_m_per_s2, 0.1, 100.0),
        ("bank_max_deg", a.bank_max_deg, 5.0, 75.0),
        ("pitch_max_deg", a.pitch_max_deg, 1.0, 75.0),
        ("roll_rate_max_deg_per_s", a.roll_rate_max_deg_per_s, 1.0, 2000.0),
        ("yaw_rate_max_deg_per_s", a.yaw_rate_max_deg_per_s, 1.0, 2000.0),
        ("load_factor_max", a.load_factor_max, 1.0, 20.0),
        ("climb_max_m_per_s", a.climb_max_m_per_s, 0.1, 100.0),
        ("descent_max_m_per_s", a.descent_max_m_per_s, 0.1, 100.0),
        ("turn_radius_min_m", a.turn_radius_min_m, 1.0, 10_000.0),
        ("radius_step_above_255_m", a.radius_step_above_255_m, 0.0, 1000.0),
        ("drag_per_s", a.drag_per_s, 0.0, 10.0),
        ("jerk_max_m_per_s3", a.jerk_max_m_per_s3, 0.0, 1000.0),
        ("side_force_g", a.side_force_g, 0.0, 0.4),
        ("roll_side_force_g", a.roll_side_force_g, -0.5, 0.5),
        ("load_overshoot", a.load_overshoot, 1.0, 4.0),
        ("speed_sag_m_per_s", a.speed_sag_m_per_s, 0.0, 50.0),
        ("maneuvers_max_s", a.maneuvers_max_s, 10.0, 36_000.0),
    ];
    for (key, value, low, high) in ranges {
        // NaN is in no range.
        if !(low..=high).contains(&value) {
            return wrong(key, value, format!("it must be between {low} and {high}"));
        }
    }
    Ok(())
}

fn speeds(a: &Airframe) -> Result<(), AirframeError> {
    let (slow, cruise, fast) = (a.speed_min_m_per_s, a.speed_cruise_m_per_s, a.speed_max_m_per_s);
    if slow > cruise {
        return wrong("speed_min_m_per_s", slow, "it is above speed_cruise_m_per_s");
    }
    if fast < cruise {
        return wrong("speed_max_m_per_s", fast, "it is below speed_cruise_m_per_s");
    }
    let from = if a.is_fixed_wing() { cruise } else { 0.0 };
    for (key, value) in
        [("acceleration_m_per_s2", a.acceleration_m_per_s2), ("braking_m_per_s2", a.braking_m_per_s2)]
    {
        let seconds = (fast - from) / value;
        if seconds > LONGEST_CHANGE_S {
            return wrong(
                key,
                value,
                format!("that is {seconds:.0} s from {from} to {fast} m/s, more than {LONGEST_CHANGE_S} s"),
            );
        }
    }
    let jerk = a.jerk_max_m_per_s3;
    if jerk > 0.0 && a.acceleration_m_per_s2.max(a.braking_m_per_s2) / jerk > LONGEST_CHANGE_S {
        return wrong("jerk_max_m_per_s3", jerk, "the acceleration then takes more than a minute to begin");
    }
    Ok(())
}

fn wing_turns(a: &Airframe) -> Result<(), AirframeError> {
    let bank = a.bank_max_deg.to_radians();
    let needed = 1.0 / cos(bank);
    if a.load_factor_max < needed {
        return wrong(
            "load_factor_max",
            a.load_factor_max,
            format!("a level turn at {:.0}° bank needs {needed:.2}", a.bank_max_deg),
        );
    }
    let possible = a.turn_radius_m(a.speed_min_m_per_s, bank);
    if a.turn_radius_min_m < possible {
        return wrong(
            "turn_radius_min_m",
            a.turn_radius_min_m,
            format!(
                "even at {} m/s and {:.0}° bank a circle has {possible:.0} m",
                a.speed_min_m_per_s, a.bank_max_deg
            ),
        );
    }
    Ok(())
}
