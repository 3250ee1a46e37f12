//! Operating data in ArduPilot's log: throttle, battery, outputs, speed of the air, flight mode.

use super::Entry;
use crate::logs::VehicleClass;
use crate::sensors::operating::of_pwm_us;
use gaware_nav::operating::{Channel, MOTORS, Operating};

const OUTPUTS: [&str; MOTORS] = ["C1", "C2", "C3", "C4", "C5", "C6", "C7", "C8"];
const OLD_OUTPUTS: [&str; MOTORS] = ["Ch1", "Ch2", "Ch3", "Ch4", "Ch5", "Ch6", "Ch7", "Ch8"];

/// What a message reports; nothing for one of another kind.
pub(super) fn of(entry: &Entry, class: Option<VehicleClass>) -> Option<Operating> {
    let number = |label: &str| entry.number(label);
    let out = Operating::default();
    let first = number("Inst").or(number("Instance")).is_none_or(|i| i == 0.0);
    let found = match entry.format.name.as_str() {
        "BAT" | "CURR" if first => {
            // Firmware before 3.3 counts in integers of 10 mV and 10 mA.
            let whole =
                |label: &str| entry.bytes(label).is_some_and(|(kind, _)| matches!(kind, b'h' | b'H' | b'I'));
            let scaled = |label: &str| Some(number(label)? * if whole(label) { 0.01 } else { 1.0 });
            out.and(Channel::Voltage, scaled("Volt").filter(|v| *v > 0.0))
                .and(Channel::Current, scaled("Curr").filter(|c| *c >= 0.0))
        }
        "CTUN" => {
            // Percent on aircraft; a share on rotors since 3.4, thousandths before.
            let wings = class.is_some_and(VehicleClass::has_wings);
            let share = |v: f64| match (wings, v) {
                (true, v) => 0.01 * v,
                (_, v) if v > 1.5 => 1e-3 * v,
                (_, v) => v,
            };
            out.and(Channel::Throttle, number("ThO").or(number("ThrOut")).map(share))
        }
        "ARSP" => out.and(Channel::Airspeed, number("Airspeed").filter(|v| *v >= 0.0)),
        "MODE" => out.and(Channel::Mode, number("ModeNum").or(number("Mode"))),
        "RCOU" => (0..).zip(OUTPUTS.iter().zip(OLD_OUTPUTS)).fold(out, |out, (k, (label, old))| {
            out.and(Channel::Motor(k), number(label).or(number(old)).and_then(of_pwm_us))
        }),
        _ => return None,
    };
    Some(found).filter(|found| !found.is_empty())
}
