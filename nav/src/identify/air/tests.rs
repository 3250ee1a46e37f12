use super::*;
use crate::math::{atan, cos, exp, sin};
use nalgebra::Vector2;

/// A draw of mean 0 and sigma 1.
fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

const STEP_S: f64 = 0.2;
const DURATION_S: f64 = 480.0;
/// Descent, and at its end the roll.
const LANDING_S: [f64; 2] = [45.0, 15.0];
const WIND: [f64; 2] = [3.0, -2.0];

/// A pitot tube with a scale factor and an offset of pressure, Pa.
#[derive(Clone, Copy)]
struct Pitot(f64, f64);

/// Circles both ways and straight legs at four airspeeds in gusts of .4 m/s: the airspeed has them at once, and the autopilot, which holds it with a time constant of 5 s (`TECS_TIME_CONST`,
/// `FW_T_TAS_TC`), turns them into speed over ground. With `lands` the wind goes down to none on the last 20 m, and the vehicle rolls until it stands.
fn in_gusts(pitot: Pitot, lands: bool, mut seed: u64) -> (Vec<Carriage>, Vec<AirSample>) {
    let (mut yaw, mut speed, mut gust, mut carried) = (0.0f64, 15.0f64, Vector2::zeros(), Vector2::zeros());
    let (mut carriage, mut samples) = (Vec::new(), Vec::new());
    for k in 0..(DURATION_S / STEP_S) as usize {
        let t_s = k as f64 * STEP_S;
        let left_s = if lands { DURATION_S - t_s } else { DURATION_S };
        let (descends, rolls) = (left_s < LANDING_S[0], left_s < LANDING_S[1]);
        let height_m = 500.0 - 2.0 * (LANDING_S[0] - left_s.max(LANDING_S[1])).max(0.0);
        let wanted = [15.0, 20.0, 13.0, 17.0][(t_s / 60.0) as usize % 4];
        speed += if rolls { -(1.5 * STEP_S).min(speed) } else { (wanted - speed) / 3.0 * STEP_S };
        let rate = if descends { 0.0 } else { [0.15, -0.15, 0.0][(t_s / 20.0) as usize % 3] };
        yaw += rate * STEP_S;
        let kept = exp(-STEP_S / 5.0);
        gust = gust * kept
            + 0.4 * (1.0 - kept * kept).sqrt() * Vector2::new(normal(&mut seed), normal(&mut seed));
        let ahead = Vector2::new(cos(yaw), sin(yaw));
        carried += (gust - carried) * (STEP_S / 5.0);
        let [along, felt] = [carried, gust - carried].map(|g| if rolls { 0.0 } else { g.dot(&ahead) });
        let v = ahead * (speed + along) + Vector2::from(WIND) * ((height_m - 440.0) / 20.0).min(1.0);
        carriage.push(Carriage {
            elapsed_s: t_s,
            c_nb: Rotation3::from_euler_angles(atan(speed * rate / 9.8), 0.0, yaw),
            v_n: Vector3::new(v.x, v.y, 0.0),
            height_m,
            throttle: 0.4,
            force: None,
        });
        let equivalent = (1.0 + pitot.0) * (speed - felt) * (density(height_m) / SEA_LEVEL_DENSITY).sqrt();
        let shown = (equivalent.powi(2) + 2.0 * pitot.1 / SEA_LEVEL_DENSITY).max(0.0).sqrt();
        let value = shown + 0.3 * normal(&mut seed);
        samples.push(AirSample { t_s, kind: AirKind::Airspeed, sensor: 0, value, temperature_degc: None });
    }
    (carriage, samples)
}

/// Names, values and sigmas of what is found.
fn found(pitot: Pitot, lands: bool, seed: u64) -> Vec<(&'static str, f64, f64)> {
    let (carriage, samples) = in_gusts(pitot, lands, seed);
    let air = Air { samples: &samples, start_s: 0.0, is_wing: true, carriage };
    let all = air.all().remove(0);
    assert!(all.effects.iter().all(|e| e.others.is_empty()), "{:?}", all.effects);
    all.effects.iter().map(|e| (e.setting.effect.name(), e.setting.values[0], e.setting.sigmas[0])).collect()
}

/// Gusts that an autopilot turns into speed over ground are neither an offset nor do they hide one, with a landing in a weaker wind or without.
#[test]
fn an_airspeed_that_is_held_in_gusts_gets_the_right_name() {
    let (scale, offset) = (Pitot(0.2, 0.0), Pitot(0.0, -35.0));
    for (lands, seed) in [(false, 1), (false, 2), (false, 3), (true, 1), (true, 2), (true, 3)] {
        for (pitot, name, truth) in [(scale, "airspeed_scale", 0.2), (offset, "airspeed_offset", -35.0)] {
            let found = found(pitot, lands, seed);
            let holds = |f: &(&str, f64, f64)| f.0 == name && (f.1 - truth).abs() < 3.0 * f.2;
            assert!(found.len() == 1 && holds(&found[0]), "{name}, lands {lands}, seed {seed}: {found:?}");
        }
        assert_eq!(found(Pitot(0.0, 0.0), lands, seed), vec![], "lands {lands}, seed {seed}");
    }
}

/// Near the ground is what is connected with a place where the vehicle stands; a flight that only begins low is not.
#[test]
fn only_where_a_wing_stands_there_is_ground() {
    let near = |all: &[(f64, bool)]| near_ground(all).iter().map(|n| u8::from(*n)).collect::<Vec<_>>();
    let stands =
        [(0.0, true), (6.0, false), (12.0, false), (6.0, false), (40.0, false), (33.0, false), (31.0, true)];
    assert_eq!(near(&stands), [1, 1, 0, 0, 1, 1, 1]);
    assert_eq!(near(&[(0.0, false), (3.0, false), (60.0, false), (0.5, false)]), [0; 4]);
}
