//! What an effect does to the vehicle's navigation, in numbers that the model itself gives.

use super::words::number;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::effects::{Antenna, Conditions, FixInstant, Instant, Older, Surroundings};
use gaware_nav::math::{acos, cos, sin, tan};
use gaware_nav::model::EffectSetting;
use gaware_nav::rotation::c_nb_from_euler;
use nalgebra::Vector3;

/// The turn that consequences are computed for: load, g, and length, s.
const TURN: (f64, f64) = (2.0, 60.0);
/// Slower vehicles hover and dash instead, m/s: at 8 m/s a level turn at 2 g has a radius of 4 m.
const TURNS_FROM_M_PER_S: f64 = 8.0;
/// Acceleration of a dash, g.
const DASH: f64 = 0.5;
/// Fixes are looked at so long after the start, s.
const AFTER_S: f64 = 600.0;
/// A roll that begins within a second reaches this rate, deg/s.
const ROLL_DEG_PER_S: f64 = 60.0;
/// Consequences below these are not worth telling: deg, m, m/s.
const LEAST_SHOWN: [f64; 3] = [0.01, 0.02, 0.005];

fn turns(speed_m_per_s: f64) -> bool {
    speed_m_per_s >= TURNS_FROM_M_PER_S
}

/// The maneuver in words.
fn maneuver(speed_m_per_s: f64) -> String {
    if turns(speed_m_per_s) { format!("turn at {:.0} g", TURN.0) } else { format!("dash at {DASH} g") }
}

/// A coordinated level turn with this load at this speed, or the dash of a slow vehicle: rate, rad/s, and specific force, m/s².
fn turn(load: f64, speed_m_per_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    if !turns(speed_m_per_s) {
        let ahead = if load > 1.0 { DASH } else { 0.0 };
        return (Vector3::zeros(), Vector3::new(ahead, 0.0, -1.0) * STANDARD_GRAVITY);
    }
    let bank = acos(load.recip().clamp(-1.0, 1.0));
    let rate = STANDARD_GRAVITY * tan(bank) / speed_m_per_s;
    (Vector3::new(0.0, rate * sin(bank), rate * cos(bank)), Vector3::new(0.0, 0.0, -load * STANDARD_GRAVITY))
}

/// Vibration of 1 g RMS on each axis.
fn shaken() -> Surroundings {
    Surroundings {
        vibration: Vector3::repeat(STANDARD_GRAVITY * STANDARD_GRAVITY),
        ..Surroundings::default()
    }
}

/// The consequence of an effect at a speed; `None` where it has none that is worth a word. A value within twice its sigma is none.
pub fn of(setting: &EffectSetting, speed_m_per_s: f64) -> Option<String> {
    let found = |(value, sigma): (&f64, &f64)| if value.abs() > 2.0 * *sigma { *value } else { 0.0 };
    let values = setting.values.iter().zip(&setting.sigmas).map(found).collect();
    let setting = &EffectSetting { values, ..setting.clone() };
    let (effect, p) = (setting.effect, &setting.values);
    if effect.is_source_mistake() || effect.is_empty() {
        return None;
    }
    let instant = |load: f64| {
        let (rate, force) = turn(load, speed_m_per_s);
        // Long after any event, and ten degrees warmer than the reference.
        Instant {
            t_s: f64::MAX,
            rate,
            force,
            temperature_above_25_degc: 10.0 * f64::from(u8::from(load > 1.0)),
            around: if load > 1.0 { shaken() } else { Surroundings::default() },
            conditions: Conditions { speed: speed_m_per_s, ..Conditions::default() },
        }
    };
    let (straight, turning) = (instant(1.0), instant(TURN.0));
    let event = effect.event().is_some() || effect.needs_temperature();
    let change = |of: &dyn Fn(&Instant) -> Vector3<f64>| {
        if effect.event().is_some() { of(&turning) } else { of(&turning) - of(&straight) }
    };
    let rate = change(&|x| effect.gyro(p, x));
    let force = change(&|x| effect.accel(p, x));
    let walk = effect.bias_walk(p);
    let when = if event {
        format!("after {:.0} s without correction", TURN.1)
    } else {
        format!("after {:.0} s of a {} without correction", TURN.1, maneuver(speed_m_per_s))
    };
    let mut parts = Vec::new();
    let drift = (rate * TURN.1).map(f64::to_degrees);
    if drift.norm() > LEAST_SHOWN[0] {
        parts.push(format!(
            "{when}: {} deg of roll, {} deg of pitch, {} deg of yaw",
            number(drift.x.abs()),
            number(drift.y.abs()),
            number(drift.z.abs())
        ));
    }
    let tilt = (force.norm() / STANDARD_GRAVITY).to_degrees();
    if tilt > LEAST_SHOWN[0] {
        let turn = format!("in a {}", maneuver(speed_m_per_s));
        parts.push(format!(
            "{} m/s² of specific force {}, as much as {} deg of tilt",
            number(force.norm()),
            if effect.needs_vibration() { "under vibration of 1 g RMS" } else { &turn },
            number(tilt)
        ));
    }
    let begun = Vector3::new(ROLL_DEG_PER_S.to_radians(), 0.0, 0.0);
    let rolling = Instant {
        around: Surroundings { rate_derivatives: [begun, Vector3::zeros()], ..straight.around },
        ..straight
    };
    // Over the second in which the roll begins.
    let behind = (effect.gyro(p, &rolling) - effect.gyro(p, &straight)).norm().to_degrees();
    if behind > LEAST_SHOWN[0] {
        parts.push(format!("{} deg of attitude while rolling at {ROLL_DEG_PER_S:.0} deg/s", number(behind)));
    }
    // A random walk of rate integrates to an angle with sigma q \u{221a}(T\u{b3}/3).
    let walked = (walk.gyro * (TURN.1.powi(3) / 3.0).sqrt()).to_degrees();
    if walked > LEAST_SHOWN[0] {
        parts.push(format!(
            "{} deg of attitude (1 sigma) after {:.0} s without correction",
            number(walked),
            TURN.1
        ));
    }
    let leaned = (walk.accel * TURN.1.sqrt() / STANDARD_GRAVITY).to_degrees();
    if leaned > LEAST_SHOWN[0] {
        parts.push(format!("as much as {} deg of tilt (1 sigma) after {:.0} s", number(leaned), TURN.1));
    }
    parts.extend(on_fixes(setting, speed_m_per_s));
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// What is wrong with fixes in the same turn.
fn on_fixes(setting: &EffectSetting, speed_m_per_s: f64) -> Option<String> {
    let (effect, p) = (setting.effect, &setting.values);
    let (rate, _) = turn(TURN.0, speed_m_per_s);
    let bank = if turns(speed_m_per_s) { acos(TURN.0.recip()) } else { 0.0 };
    let ahead = if turns(speed_m_per_s) { 0.0 } else { DASH * STANDARD_GRAVITY };
    let x = FixInstant {
        t_s: f64::MAX,
        v_n: Vector3::new(speed_m_per_s, 0.0, 0.0),
        a_n: Vector3::new(ahead, STANDARD_GRAVITY * tan(bank), 0.0),
        smoothed_a_n: Vector3::new(ahead, STANDARD_GRAVITY * tan(bank), 0.0),
        skewed_n: Vector3::zeros(),
        c_nb: c_nb_from_euler(bank, 0.0, 0.0),
        rate_eb: rate,
        force_rate: Vector3::zeros(),
        antenna: Antenna::default(),
        older: Older::default(),
        elapsed_s: AFTER_S,
        conditions: Conditions { speed: speed_m_per_s, ..Conditions::default() },
    };
    let late_s = effect.fix_delay_s(p, AFTER_S);
    let [position, velocity] = effect.fix(p, &x);
    let (position, velocity) = (position - x.v_n * late_s, velocity - x.a_n * late_s);
    (position.norm() > LEAST_SHOWN[1] || velocity.norm() > LEAST_SHOWN[2]).then(|| {
        format!(
            "fixes are off by {} m and {} m/s in a {} and {} m/s",
            number(position.norm()),
            number(velocity.norm()),
            maneuver(speed_m_per_s),
            number(speed_m_per_s)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_nav::effects::{self, unit};

    fn known(effect: &'static dyn effects::Effect, values: &[f64]) -> EffectSetting {
        EffectSetting::known(effect, values).unwrap()
    }

    /// One more g for a minute: the column z of G, 54 deg/h/g, is 0.9 deg.
    #[test]
    fn the_consequence_is_what_the_model_says() {
        let mut g = [0.0; 9];
        g[2] = 54.0 * unit::DEG_PER_H_PER_G.si;
        let parts = of(&known(&effects::GYRO_G_SENSITIVITY, &g), 20.0).unwrap();
        assert!(
            parts.starts_with("after 60 s of a turn at 2 g without correction: 0.900 deg of roll, 0 deg"),
            "{parts}"
        );
        let late = of(&known(&effects::GpsLatency, &[0.1]), 20.0).unwrap();
        assert!(late.contains("off by 2.00 m and 1.70 m/s"), "{late}");
        assert_eq!(of(&known(&effects::GpsLatency, &[0.0]), 20.0), None);
        let hover = of(&known(&effects::GpsLatency, &[0.1]), 0.6).unwrap();
        assert!(hover.contains("0.490 m/s in a dash at 0.5 g and 0.600 m/s"), "{hover}");
        let behind = of(&known(&effects::GyroAccelDelay, &[0.02]), 20.0).unwrap();
        assert_eq!(behind, "1.20 deg of attitude while rolling at 60 deg/s");
        let shaken = of(&known(&effects::VIBRATION_RECTIFICATION, &[1e-3, 0.0, 0.0]), 20.0).unwrap();
        assert!(shaken.contains("under vibration of 1 g RMS"), "{shaken}");
        // What its sigma covers moves nothing; a copter that hovers with ArduPilot 4.7 does not turn at 250 deg/s.
        let mut hovered = known(&effects::GYRO_MISALIGNMENT, &[0.0, 0.0, 0.0, 0.4e-3, 0.0, -2.29e-3]);
        hovered.sigmas = vec![0.5e-3, 0.1e-3, 0.5e-3, 0.1e-3, 1.6e-3, 2.0e-3];
        assert_eq!(of(&hovered, 3.86), None);
        let parts = of(&hovered, 10.0).unwrap();
        assert!(parts.ends_with("correction: 0 deg of roll, 1.17 deg of pitch, 0 deg of yaw"), "{parts}");
        // 100 ppm in ten minutes are 60 ms.
        let drifted = of(&known(&effects::ClockDrift, &[1e-4]), 20.0).unwrap();
        assert!(drifted.contains("off by 1.20 m"), "{drifted}");
    }
}
