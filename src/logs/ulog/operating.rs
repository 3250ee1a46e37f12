//! Operating data in PX4's log: thrust, battery, outputs, speed of the air, flight mode.

use super::fields::Fields;
use crate::sensors::operating::of_pwm_us;
use gaware_nav::operating::{Channel, MOTORS, Operating};

/// What a topic reports; nothing for one of another kind.
pub(super) fn of(fields: &Fields) -> Option<Operating> {
    let out = Operating::default();
    let positive = |name: &str| fields.number(name).filter(|v| *v > 0.0);
    let found = match fields.topic.name.as_str() {
        "battery_status" => out
            .and(Channel::Voltage, positive("voltage_filtered_v").or(positive("voltage_v")))
            .and(Channel::Current, positive("current_filtered_a").or(positive("current_a"))),
        "airspeed" | "airspeed_validated" => {
            out.and(Channel::Airspeed, positive("true_airspeed_m_s").or(positive("indicated_airspeed_m_s")))
        }
        "vehicle_status" => out.and(Channel::Mode, fields.number("nav_state")),
        "vehicle_thrust_setpoint" => {
            let axes = [0, 1, 2].map(|k| fields.element("xyz", k));
            let square: f64 = axes.iter().flatten().map(|v| v * v).sum();
            out.and(Channel::Throttle, axes.iter().any(Option::is_some).then(|| square.sqrt()))
        }
        // Motors from 0 to 1 (PX4 1.13 and later), or outputs in µs before.
        "actuator_motors" => outputs(out, |k| fields.element("control", k)),
        "actuator_outputs" => outputs(out, |k| fields.element("output", k).and_then(of_pwm_us)),
        _ => return None,
    };
    Some(found).filter(|found| !found.is_empty())
}

fn outputs(out: Operating, of: impl Fn(usize) -> Option<f64>) -> Operating {
    (0..MOTORS).fold(out, |out, k| out.and(Channel::Motor(k as u8), of(k)))
}
