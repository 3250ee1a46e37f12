use super::*;
use crate::airframe::EXAMPLES;
use crate::item::{LatLon, command};

fn airframes() -> Vec<Airframe> {
    EXAMPLES.iter().map(|(_, text)| Airframe::from_toml(text).expect("shipped")).collect()
}

fn flown(airframe: &Airframe, maneuver: Maneuver) -> Vec<Kinematics> {
    let entry = Entry::cruising(airframe, Vector3::new(0.0, 0.0, -120.0), 0.3);
    maneuver.kinematics(airframe, &entry, &Vector3::new(2.0, 1.0, 0.0))
}

fn spread(samples: &[Kinematics], axis: usize) -> f64 {
    let values = samples.iter().map(|k| k.force[axis]);
    values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
}

#[test]
fn instructions_fit_into_a_status_text() {
    for airframe in airframes() {
        for maneuver in Maneuver::all(&airframe).into_iter().chain(Maneuver::for_sensors(&airframe)) {
            let words = maneuver.words(&airframe);
            assert!(
                words.short.len() <= 50 && words.short.is_ascii(),
                "{}: {}",
                words.short.len(),
                words.short
            );
            assert!(words.long.len() > words.short.len() / 2);
        }
    }
}

#[test]
fn every_maneuver_is_finite_and_lasts_as_long_as_it_says() {
    for airframe in airframes() {
        for maneuver in Maneuver::all(&airframe).into_iter().chain(Maneuver::for_sensors(&airframe)) {
            let samples = flown(&airframe, maneuver);
            let last = samples[samples.len() - 1];
            assert!((last.t_s - maneuver.duration_s(&airframe)).abs() < 0.1, "{maneuver:?}");
            let load = samples.iter().map(|k| k.force.norm() / 9.80665).fold(0.0, f64::max);
            assert!(load.is_finite() && load < airframe.load_factor_max + 0.4, "{maneuver:?}: {load} g");
        }
    }
}

#[test]
fn maneuvers_excite_the_axes_they_are_for() {
    for airframe in airframes() {
        let mut coordinated = airframe.clone().with_side_force(0.0, 0.0);
        if !airframe.is_fixed_wing() {
            // An autopilot that uses what the rotors can do.
            (coordinated.acceleration_m_per_s2, coordinated.jerk_max_m_per_s3) = (4.0, 0.0);
        }
        let spread = |m, axis| spread(&flown(&coordinated, m), axis);
        assert!(spread(Maneuver::VaryingSpeed, 0) > 2.0);
        assert!(spread(Maneuver::PullUp, 2) > 3.0, "{}: {}", airframe.name, spread(Maneuver::PullUp, 2));
        if airframe.is_fixed_wing() {
            assert!(spread(Maneuver::SteadyTurn(Side::Left), 2) > 2.5);
            assert!(spread(Maneuver::FigureEight, 1) < 1e-6, "coordinated flight leaves y dark");
            assert!(spread(Maneuver::Sideslip, 1) > 2.5);
        } else {
            assert!(spread(Maneuver::CrabLegs, 0) > 3.0 && spread(Maneuver::CrabLegs, 1) > 3.0);
        }
    }
}

#[test]
fn turns_go_the_way_they_say() {
    for airframe in airframes() {
        for side in [Side::Left, Side::Right] {
            let samples = flown(&airframe, Maneuver::SteadyTurn(side));
            let turned: f64 = samples.iter().map(|k| (k.attitude * k.rate).z * 0.05).sum();
            assert!((turned * side.sign() - 6.2).abs() < 1.2, "{} {side:?}: {turned}", airframe.name);
        }
    }
}

fn place(space_m: f64) -> Placement {
    Placement {
        frame: LocalFrame::new(LatLon { lat_deg: 47.4, lon_deg: 8.5 }),
        center_m: Vector2::new(50.0, -30.0),
        space_m,
        heading_rad: 0.7,
        height_m: 100.0,
        band_m: [60.0, 140.0],
        wind_m_per_s: 5.0,
    }
}

#[test]
fn items_stay_within_room_band_and_speed_limits() {
    for airframe in airframes() {
        let place = place(900.0);
        for maneuver in Maneuver::for_sensors(&airframe) {
            let items = maneuver.items(&airframe, &place).unwrap_or_else(|e| panic!("{maneuver:?}: {e}"));
            for item in &items {
                if let Some(at) = item.place() {
                    let away = (place.frame.to_local(at) - place.center_m).norm();
                    assert!(
                        away <= place.space_m && (60.0..=140.0).contains(&f64::from(item.z)),
                        "{maneuver:?}"
                    );
                }
                if item.command == command::DO_CHANGE_SPEED {
                    let speed = f64::from(item.params[1]);
                    assert!(speed >= airframe.speed_min_m_per_s && speed <= airframe.speed_max_m_per_s);
                    assert_eq!(item.params[0] == 0.0, airframe.is_fixed_wing());
                }
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_with_the_reason() {
    let small = Airframe::example("small_fixed_wing").expect("shipped");
    let said = |m: Maneuver, p: &Placement| m.items(&small, p).expect_err("does not fit").to_string();
    assert!(said(Maneuver::VaryingSpeed, &place(60.0)).contains("around its centre, 60 m are there"));
    let flat = Placement { band_m: [95.0, 105.0], ..place(600.0) };
    assert!(said(Maneuver::Climb, &flat).contains("band of 16 m of height, 10 m are there"));
    assert!(said(Maneuver::Sideslip, &place(600.0)).contains("a pilot must"));
}

#[test]
fn px4_gets_only_commands_that_its_missions_know() {
    // Of those used here: PX4 answers UNSUPPORTED to loiter turns and condition yaw in a mission.
    let known = [
        command::NAV_WAYPOINT,
        command::NAV_LOITER_TIME,
        command::NAV_LOITER_TO_ALT,
        command::DO_CHANGE_SPEED,
    ];
    for mut airframe in airframes() {
        airframe.autopilot = crate::item::Autopilot::Px4;
        for maneuver in Maneuver::for_sensors(&airframe) {
            let items = maneuver.items(&airframe, &place(900.0)).expect("space enough");
            assert!(items.iter().all(|i| known.contains(&i.command)), "{maneuver:?}");
        }
    }
}
