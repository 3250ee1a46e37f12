//! Operating data in MAVLink messages: throttle, battery, outputs, speed of the air, flight mode (`common.xml`). None but the outputs carry a
//! time; all of them change slowly, so that the time of arrival will do.

use gaware_nav::operating::{Channel, MOTORS, Operating};
use gaware_wire::heartbeat::{Heartbeat, PX4};
use mavlink::dialects::ardupilotmega::MavMessage;

/// Outputs end at about these, µs.
const PWM_US: (f64, f64) = (500.0, 2500.0);

/// An output as share of its range from 1000 to 2000 µs; nothing for one that is not used.
pub fn of_pwm_us(pwm_us: f64) -> Option<f64> {
    (PWM_US.0..=PWM_US.1).contains(&pwm_us).then(|| (pwm_us - 1000.0) / 1000.0)
}

/// The flight mode by its number; PX4 packs a main and a sub-mode (`px4_custom_mode.h`).
pub fn of_heartbeat(heartbeat: &Heartbeat) -> Operating {
    let mode = heartbeat.custom_mode;
    let number = match heartbeat.autopilot {
        PX4 => (mode >> 16 & 0xff) + 256 * (mode >> 24),
        _ => mode,
    };
    Operating::default().with(Channel::Mode, f64::from(number))
}

/// What a message reports; nothing for one of another kind.
pub fn of_message(message: &MavMessage) -> Option<Operating> {
    let out = Operating::default();
    let known = |v: f64| (v >= 0.0).then_some(v);
    Some(match message {
        MavMessage::SYS_STATUS(m) => {
            let volts = Some(m.voltage_battery).filter(|v| !matches!(v, 0 | &u16::MAX));
            out.and(Channel::Voltage, volts.map(|v| 1e-3 * f64::from(v)))
                .and(Channel::Current, known(0.01 * f64::from(m.current_battery)))
        }
        MavMessage::BATTERY_STATUS(m) => {
            let own = Some(m.current_battery).filter(|_| m.id == 0);
            out.and(Channel::Current, own.and_then(|c| known(0.01 * f64::from(c))))
        }
        MavMessage::VFR_HUD(m) => out
            .with(Channel::Throttle, 0.01 * f64::from(m.throttle))
            .and(Channel::Airspeed, known(f64::from(m.airspeed))),
        MavMessage::SERVO_OUTPUT_RAW(m) if m.port == 0 => {
            let outputs: [u16; MOTORS] = [
                m.servo1_raw,
                m.servo2_raw,
                m.servo3_raw,
                m.servo4_raw,
                m.servo5_raw,
                m.servo6_raw,
                m.servo7_raw,
                m.servo8_raw,
            ];
            (0..).zip(outputs).fold(out, |out, (k, us)| out.and(Channel::Motor(k), of_pwm_us(f64::from(us))))
        }
        MavMessage::SERVO_OUTPUT_RAW(_) => out,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA, VFR_HUD_DATA};

    #[test]
    fn messages_report_in_si_and_what_is_unknown_is_absent() {
        let battery =
            SYS_STATUS_DATA { voltage_battery: 15_900, current_battery: 1234, ..Default::default() };
        let found = of_message(&MavMessage::SYS_STATUS(battery)).unwrap();
        assert!((found.get(Channel::Voltage).unwrap() - 15.9).abs() < 1e-4);
        assert!((found.get(Channel::Current).unwrap() - 12.34).abs() < 1e-4);
        let none = SYS_STATUS_DATA { voltage_battery: u16::MAX, current_battery: -1, ..Default::default() };
        assert!(of_message(&MavMessage::SYS_STATUS(none)).unwrap().is_empty());
        let outputs = SERVO_OUTPUT_RAW_DATA { servo1_raw: 1500, servo2_raw: 0, ..Default::default() };
        let found = of_message(&MavMessage::SERVO_OUTPUT_RAW(outputs)).unwrap();
        assert_eq!((found.get(Channel::Motor(0)), found.get(Channel::Motor(1))), (Some(0.5), None));
        let hud = VFR_HUD_DATA { throttle: 75, airspeed: 17.5, ..Default::default() };
        let found = of_message(&MavMessage::VFR_HUD(hud)).unwrap();
        assert_eq!((found.get(Channel::Throttle), found.get(Channel::Airspeed)), (Some(0.75), Some(17.5)));
        assert_eq!(of_message(&MavMessage::ATTITUDE(Default::default())), None);
    }
}
