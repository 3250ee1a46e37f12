use super::*;
use crate::aids::of_samples;
use crate::aids::testing::flown;
use gaware_mission::item::Autopilot;
use gaware_nav::effects;
use gaware_nav::math::{hypot, powf};
use gaware_nav::model::EffectSetting;
use gaware_nav::sample::Sample;
use gaware_sitl::air::WindTrack;
use gaware_sitl::scenario;
use gaware_sitl::sensors::Flight;
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::signal::Signal;

const WIND: WindTrack = WindTrack { mean_n_e: [4.0, -3.0], swing: (0.8, 160.0), gusts: (0.4, 5.0) };

fn flight(name: &str, injected: &[(&str, Vec<f64>)], seed: u64) -> Vec<Sample> {
    flown(name, injected, seed, |s| (s.air_rate_hz, s.wind) = (10.0, WIND))
}

fn judged(name: &str, injected: &[(&str, Vec<f64>)], seed: u64) -> AirReport {
    let board = OnBoard { fixed_wing: Some(name.starts_with("fixed")), ..OnBoard::default() };
    let report = of_samples(&flight(name, injected, seed), None, &board).air.unwrap();
    for s in &report.sensors {
        println!(
            "{name} {injected:?}: {} {:?} known to {:.2} residual {:?} wind {:?} removed {:?}",
            s.text,
            s.status,
            s.known_to,
            s.residual,
            s.wind.as_ref().map(|w| &w.text),
            s.removed
        );
        for e in &s.effects {
            println!(
                "   {:?} {:.0} {:.0} {:?}",
                e.names,
                e.evidence,
                e.held_out_gain,
                e.parameters.iter().map(|p| (p.value, p.sigma)).collect::<Vec<_>>()
            );
        }
    }
    report
}

fn names(entry: &AirEntry) -> Vec<&str> {
    entry.effects.iter().map(|e| e.names[0]).collect()
}

/// What is named of a sensor with these effects; the simulated multirotor has drag in proportion to its speed.
fn expected<'e>(s: &AirEntry, own: &str, effects: &[&'e str]) -> Vec<&'e str> {
    match &*s.sensor {
        "Drag" => vec!["drag_rotor"],
        sensor if sensor == own => effects.to_vec(),
        _ => vec![],
    }
}

#[test]
fn sensors_in_order_are_and_the_wind_is_found() {
    for (name, seed) in [("fixed_wing", 1), ("fixed_wing_gusts", 2), ("multirotor", 3)] {
        let report = judged(name, &[], seed);
        for s in &report.sensors {
            assert_eq!((s.status, names(s)), (Status::Ok, expected(s, "", &[])), "{name}: {s:?}");
        }
        let winds: Vec<&WindEntry> = report.sensors.iter().filter_map(|s| s.wind.as_ref()).collect();
        assert_eq!(winds.len(), if name == "multirotor" { 2 } else { 1 }, "{name}");
        for wind in winds {
            for k in 0..2 {
                let off = (wind.north_east_m_per_s[k] - WIND.mean_n_e[k]).abs();
                assert!(off < 3.0 * hypot(wind.sigma_m_per_s[k], 0.15), "{name} {wind:?}");
            }
        }
    }
}

/// Each effect alone: it is named alone, and its values hold; the second barometer has none.
#[test]
fn each_effect_is_named_with_values_that_hold() {
    let cases: [(&str, &str, Vec<f64>); 4] = [
        ("fixed_wing", "baro_dynamic_pressure", vec![0.2, 0.0, 0.0, 0.0, 0.0]),
        ("multirotor", "baro_thrust", vec![60.0]),
        ("fixed_wing", "baro_delay", vec![0.8]),
        ("fixed_wing", "airspeed_scale", vec![0.15]),
    ];
    let mut wrong = Vec::new();
    for (seed, (name, effect, truth)) in (10..).zip(cases) {
        let report = judged(name, &[(effect, truth.clone())], seed);
        let own = if effect.starts_with("baro") { "Barometer 1" } else { "Airspeed sensor 1" };
        for s in &report.sensors {
            if names(s) != expected(s, own, &[effect]) {
                wrong.push(format!("{name} {effect} {}: {:?}", s.sensor, names(s)));
            }
            let parameters = s.effects.iter().filter(|e| e.names[0] == effect).flat_map(|e| &e.parameters);
            let groups = effects::find(effect).unwrap().groups();
            for ((p, truth), group) in parameters.zip(&truth).zip(groups) {
                let off = (p.value - truth / group.unit.si) / p.sigma;
                if off.abs() > 3.0 {
                    wrong.push(format!(
                        "{name} {effect} {}: {off:.1} sigma, {} ± {}",
                        p.name, p.value, p.sigma
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// An error that stays the same for minutes is no gust, however fast a gust begins: the noise leaves it to the effect.
#[test]
fn a_pitot_tube_with_an_offset_or_a_delay_is_found_in_gusts() {
    for (seed, effect, truth) in
        [(16, "airspeed_offset", -35.0), (116, "airspeed_offset", -35.0), (17, "airspeed_delay", 1.2)]
    {
        for s in &judged("fixed_wing", &[(effect, vec![truth])], seed).sensors {
            let own = s.sensor == "Airspeed sensor 1";
            assert_eq!(names(s), if own { vec![effect] } else { vec![] }, "{effect} {}", s.sensor);
            for p in s.effects.iter().flat_map(|e| &e.parameters) {
                assert!((p.value - truth).abs() < 3.0 * p.sigma, "{effect} {} ± {}", p.value, p.sigma);
                assert!(s.held_out.after < s.held_out.before, "{:?}", s.held_out);
            }
        }
    }
}

/// What warms up as slowly as the height of the trajectory errs may stay unseen; then nothing else is named in its place.
#[test]
fn a_barometer_that_warms_up_slowly_gets_no_wrong_name() {
    for s in &judged("fixed_wing", &[("baro_temperature", vec![0.6])], 14).sensors {
        let is_allowed = |name: &&str| s.sensor == "Barometer 1" && *name == "baro_temperature";
        assert!(names(s).iter().all(is_allowed), "{}: {:?}", s.sensor, names(s));
    }
}

/// Each side of a multirotor's port, in several flights: sigmas that hold.
#[test]
fn the_sides_of_a_port_are_within_their_sigmas() {
    let truth = [50.0, 40.0, 30.0, 30.0];
    let mut off = Vec::new();
    for seed in 1..9 {
        let report = judged("multirotor", &[("baro_dynamic_pressure", vec![0.5, 0.4, 0.3, 0.3, 0.0])], seed);
        let own = report.sensors.iter().find(|s| s.sensor == "Barometer 1").unwrap();
        assert_eq!(names(own), ["baro_dynamic_pressure"], "{}", own.text);
        off.extend(own.effects[0].parameters.iter().zip(truth).map(|(p, truth)| (p.value - truth) / p.sigma));
    }
    let within = |sigmas: f64| off.iter().filter(|o: &&f64| o.abs() < sigmas).count();
    assert!(within(2.0) >= 28 && within(3.0) >= 31, "of 32: {off:.1?}");
}

/// On one straight leg wind and scale are the same.
#[test]
fn a_straight_leg_asks_for_circles_both_ways() {
    let mut scenario = scenario::scenario("fixed_wing").unwrap();
    scenario.sensors.air_rate_hz = 10.0;
    scenario.sensors.wind = WIND;
    let speed = Signal::constant(0.0).step(5.0, 8.0, 18.0).wave(40.0, 180.0, 1.0, 0.05, 10.0);
    let still = || Signal::constant(0.0);
    let leg = FixedWing::from_signals(200.0, speed, still(), still(), still());
    let flight = Flight::new(Box::new(Flown::new(leg)), &scenario.model, scenario.sensors.clone(), 5);
    let samples: Vec<Sample> = flight.map(|(sample, _)| sample).collect();
    let board = OnBoard { fixed_wing: Some(true), ..OnBoard::default() };
    let report = of_samples(&samples, None, &board).air.unwrap();
    let pitot = report.sensors.iter().find(|s| s.sensor == "Airspeed sensor 1").unwrap();
    assert_eq!((pitot.status, names(pitot)), (Status::NotKnown, vec![]), "{}", pitot.text);
    assert!(pitot.text.contains("fly circles both ways"), "{}", pitot.text);
}

fn found(kind: AirQuantity, held_out: [f64; 2], known_to: f64) -> AirFound {
    AirFound {
        kind,
        sensor: 0,
        instants: 1000,
        largest: (0.0, 20.0),
        largest_sigma: 0.0,
        residual: held_out,
        held_out,
        unexplained: held_out[1],
        shared: Vec::new(),
        noise: [0.2, 0.02],
        known_to,
        effects: Vec::new(),
        removed: Vec::new(),
        not_found: Vec::new(),
        wind: None,
        points: Vec::new(),
        density: 0.0,
    }
}

/// What is left has to be that of a sensor in order before one is called so.
#[test]
fn a_sensor_of_which_much_is_left_is_not_in_order() {
    for (kind, small, large) in [(AirQuantity::Airspeed, 0.6, 1.8), (AirQuantity::Height, 1.0, 3.5)] {
        assert_eq!(super::status(&found(kind, [small; 2], 0.2)), Status::Ok);
        let scatters = found(kind, [large; 2], 0.2);
        assert_eq!(super::status(&scatters), Status::NotKnown);
        let text = super::text(&scatters, Status::NotKnown);
        assert!(text.contains("RMS of its error are left"), "{text}");
        assert_eq!(super::status(&found(kind, [small; 2], 5.0)), Status::NotKnown);
    }
}

/// Two effects that are each within what sensors differ by add up to an error that no pilot wants: it is reported, though this flight shows of none that it is there.
#[test]
fn an_error_within_tolerances_is_told() {
    let setting = |effect: &'static dyn effects::Effect, value, sigma| {
        let mut setting = EffectSetting::unknown(effect);
        (setting.values[0], setting.sigmas[0]) = (value, sigma);
        setting
    };
    let shared =
        vec![setting(&effects::AIRSPEED_SCALE, 0.08, 0.02), setting(&effects::AIRSPEED_OFFSET, 12.0, 4.0)];
    let of = |largest, largest_sigma| AirFound {
        largest,
        largest_sigma,
        unexplained: 0.4,
        shared: shared.clone(),
        ..found(AirQuantity::Airspeed, [2.0, 2.0], 0.3)
    };
    let wrong = of((2.7, 24.0), 0.4);
    assert_eq!(super::status(&wrong), Status::Wrong);
    assert_eq!(
        super::text(&wrong, Status::Wrong),
        "Airspeed sensor 1 reads up to 2.7 m/s too fast (at 24 m/s); by airspeed_scale 8.0 ± 2.0 % and airspeed_offset 12.0 ± 4.0 Pa, within what sensors of its kind differ by."
    );
    let slight = of((-1.4, 24.0), 0.4);
    assert_eq!(super::status(&slight), Status::Ok);
    assert!(super::text(&slight, Status::Ok).contains("in order but for up to 1.4 m/s too slow"));
    let by_chance = of((1.4, 24.0), 0.9);
    assert!(super::text(&by_chance, Status::Ok).contains("agrees with motion and wind"));
    let board = OnBoard::default();
    assert_eq!([&wrong, &by_chance].map(|f| super::entry(f, &board).largest_error), [2.7, 0.0]);
}

/// On a firmware's flight the port's forward coefficient was −27 ± 3 %, and that for a flow from the right, which never came, −38 ± 128 %: the words are of the first.
#[test]
fn the_words_are_of_what_the_flight_shows() {
    let mut setting = EffectSetting::unknown(&effects::BARO_DYNAMIC_PRESSURE);
    setting.values = vec![-0.27, 0.0, -0.38, -0.11, -0.09];
    setting.sigmas = vec![0.03, 0.3, 1.28, 0.42, 0.24];
    assert_eq!(super::words(&setting), "its port feels -27 % of the dynamic pressure (forward flow)");
    assert_eq!(super::strongest(&setting), "baro_dynamic_pressure -27.0 ± 3.0 %");
}

/// The same errors behind the new parameters: what each firmware's formula makes of the proposal.
#[test]
fn the_proposals_undo_the_errors_by_the_formulas_of_both_firmwares() {
    let board = |autopilot, parameters: &[(&str, f64)]| OnBoard {
        autopilot: Some(autopilot),
        fixed_wing: Some(true),
        parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
        ..OnBoard::default()
    };
    let samples = flight(
        "fixed_wing",
        &[("baro_dynamic_pressure", vec![0.2, 0.0, 0.0, 0.0, 0.0]), ("airspeed_scale", vec![0.15])],
        40,
    );
    let of = |board: &OnBoard| -> Vec<(String, f64)> {
        let report = of_samples(&samples, None, board).air.unwrap();
        let all = report.sensors.into_iter().flat_map(|s| s.proposals);
        all.map(|p| (p.parameter, p.proposed)).collect()
    };
    let near = |found: &[(String, f64)], name: &str, value: f64, within: f64| {
        let own = found.iter().find(|f| f.0 == name).map(|f| f.1);
        assert!(own.is_some_and(|v| (v - value).abs() < within), "{name}: {own:?}, not {value}; {found:?}");
    };
    let ours = of(&board(
        Autopilot::ArduPilot,
        &[("BARO1_WCF_ENABLE", 0.0), ("BARO1_WCF_FWD", 0.0), ("BARO1_WCF_BCK", 0.0), ("ARSPD_RATIO", 2.0)],
    ));
    near(&ours, "BARO1_WCF_ENABLE", 1.0, 1e-9);
    near(&ours, "BARO1_WCF_FWD", 0.2, 0.04);
    // √(ratio p) is 15 % too much.
    near(&ours, "ARSPD_RATIO", 2.0 / 1.15f64.powi(2), 0.06);
    assert!(ours.iter().all(|p| p.0 != "BARO1_WCF_BCK"), "a wing does not fly backwards: {ours:?}");
    let px4 = of(&board(Autopilot::Px4, &[("EKF2_PCOEF_XP", 0.0), ("ASPD_SCALE_1", 1.0)]));
    near(&px4, "EKF2_PCOEF_XP", 0.2, 0.04);
    near(&px4, "ASPD_SCALE_1", 1.0 / 1.15, 0.03);
    assert_eq!(of(&board(Autopilot::Px4, &[])), vec![], "only what the log's own list has");
}

/// Drag of rotors, 1/s, and of the body along x and y, m²/kg.
const DRAG: [f64; 3] = [0.2, 0.035, 0.06];

fn dragged(drag: [f64; 3], seed: u64, board: &OnBoard) -> AirEntry {
    let injected = [("drag_rotor", vec![drag[0]]), ("drag_quadratic", vec![drag[1], drag[2]])];
    let report = of_samples(&flight("multirotor", &injected, seed), None, board).air.unwrap();
    report.sensors.into_iter().find(|s| s.sensor == "Drag").unwrap()
}

fn copter(autopilot: Autopilot, parameters: &[(&str, f64)]) -> OnBoard {
    OnBoard {
        autopilot: Some(autopilot),
        fixed_wing: Some(false),
        parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
        ..OnBoard::default()
    }
}

/// No airspeed sensor, gusts, a frame that is not straight and accelerometers with biases: drag by speed, and the wind that goes with it.
#[test]
fn a_multirotor_shows_its_drag_and_the_wind() {
    for seed in [1, 2] {
        let s = dragged(DRAG, seed, &copter(Autopilot::Px4, &[]));
        let mut found: Vec<(&str, Vec<f64>)> = Vec::new();
        for e in &s.effects {
            assert_eq!(e.names.len(), 1, "{:?}", e.names);
            found.push((e.names[0], e.parameters.iter().map(|p| p.value).collect()));
            let truth = if e.names[0] == "drag_rotor" { &DRAG[..1] } else { &DRAG[1..] };
            for (p, truth) in e.parameters.iter().zip(truth) {
                assert!(
                    (p.value - truth).abs() < 3.0 * p.sigma,
                    "{} {} ± {}, not {truth}",
                    p.name,
                    p.value,
                    p.sigma
                );
                assert!(p.sigma < 0.3 * truth, "{} ± {}", p.name, p.sigma);
            }
        }
        assert_eq!((s.status, found.len()), (Status::Ok, 2), "{found:?}");
        assert!(s.held_out.after < 0.2 * s.held_out.before, "{:?}", s.held_out);
        let wind = s.wind.unwrap();
        for k in 0..2 {
            let off = (wind.north_east_m_per_s[k] - WIND.mean_n_e[k]).abs();
            assert!(off < 3.0 * wind.sigma_m_per_s[k] && wind.sigma_m_per_s[k] < 0.6, "{wind:?}");
        }
    }
}

/// Where much of the force is left neither drag nor wind is to be believed.
#[test]
fn a_force_of_which_much_is_left_shows_no_drag() {
    let mut setting = EffectSetting::unknown(&effects::DRAG_ROTOR);
    (setting.values[0], setting.sigmas[0]) = (0.22, 0.04);
    let named = Finding { setting, evidence: 20.0, held_out_gain: 20.0, others: Vec::new() };
    let of = |held_out| AirFound { effects: vec![named.clone()], ..found(AirQuantity::Drag, held_out, 0.1) };
    let board = copter(Autopilot::Px4, &[("EKF2_MCOEF", 0.05)]);
    let good = super::entry(&of([1.2, 0.2]), &board);
    assert_eq!((good.status, good.proposals.len()), (Status::Ok, 1), "{:?}", good.proposals);
    let bad = super::entry(&of([2.0, 0.8]), &board);
    assert_eq!((bad.status, bad.proposals.len()), (Status::NotKnown, 0), "{:?}", bad.proposals);
    assert!(bad.text.starts_with("Drag and wind are not judged: 0.8 m/s²"), "{}", bad.text);
}

/// Without drag nothing is said of it, nor of the wind; and wings have none that this finds.
#[test]
fn no_drag_has_no_name() {
    let s = dragged([0.0; 3], 3, &copter(Autopilot::Px4, &[("EKF2_MCOEF", 0.15)]));
    assert_eq!((s.status, names(&s), &s.wind), (Status::NotKnown, vec![], &None), "{}", s.text);
    assert_eq!((s.proposals, s.not_proposed), (vec![], vec![]));
    let wings = judged("fixed_wing", &[], 1);
    assert!(wings.sensors.iter().all(|s| s.sensor != "Drag"));
}

/// With the parameters proposed both firmwares' formulas predict the specific force of the simulated vehicle, with its sign.
#[test]
fn the_drag_parameters_predict_the_force_by_the_formulas_of_both_firmwares() {
    let names = [
        ["EK3_DRAG_MCOEF", "EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y"],
        ["EKF2_MCOEF", "EKF2_BCOEF_X", "EKF2_BCOEF_Y"],
    ];
    let height_m: f64 = 488.0 + 25.0;
    let density = 1.225 * powf(1.0 - 2.2558e-5 * height_m, 4.2559);
    for (autopilot, names, on_board, momentum) in [
        (Autopilot::ArduPilot, names[0], [0.1, 0.0, 0.0], density / 1.225),
        (Autopilot::Px4, names[1], [0.15, 100.0, 100.0], (density / 1.225).sqrt()),
    ] {
        let listed: Vec<(&str, f64)> = names.into_iter().zip(on_board).collect();
        let s = dragged(DRAG, 1, &copter(autopilot, &listed));
        let [m, x, y] = names.map(|n| s.proposals.iter().find(|p| p.parameter == n).unwrap().proposed);
        for (axis, ballistic) in [x, y].into_iter().enumerate() {
            for v in [-12.0f64, 6.0, 12.0] {
                let firmware = -0.5 * density / ballistic * v * v.abs() - v * m * momentum;
                let truth =
                    -0.5 * density * DRAG[1 + axis] * v * v.abs() - v * DRAG[0] * (density / 1.225).sqrt();
                assert!(
                    (firmware - truth).abs() < 0.06 * truth.abs(),
                    "{autopilot:?} {v}: {firmware} {truth}"
                );
            }
        }
        assert_eq!(
            dragged(DRAG, 1, &copter(autopilot, &[])).proposals,
            vec![],
            "only what the log's own list has"
        );
    }
    // Drag is off on board: that stays its owner's decision.
    let off = dragged(DRAG, 1, &copter(Autopilot::ArduPilot, &names[0].map(|n| (n, 0.0))));
    assert_eq!((off.proposals.len(), off.not_proposed.len()), (0, 3), "{:?}", off.not_proposed);
    assert!(
        off.not_proposed.iter().all(|n| n.contains("estimates no wind by drag")),
        "{:?}",
        off.not_proposed
    );
    let listed = names[0].map(|n| (n, 0.0));
    let off = dragged([0.25, 0.0, 0.0], 2, &copter(Autopilot::ArduPilot, &listed));
    assert_eq!(off.not_proposed.len(), 1, "nothing is said of what stays 0: {:?}", off.not_proposed);
    // A rotor alone: what is on board of the body would count twice.
    let listed = [("EKF2_MCOEF", 0.15), ("EKF2_BCOEF_X", 100.0), ("EKF2_BCOEF_Y", 100.0)];
    let s = dragged([0.25, 0.0, 0.0], 2, &copter(Autopilot::Px4, &listed));
    let proposed: Vec<(&str, f64)> = s.proposals.iter().map(|p| (&*p.parameter, p.proposed)).collect();
    assert_eq!(proposed[1..], [("EKF2_BCOEF_X", 0.0), ("EKF2_BCOEF_Y", 0.0)], "{proposed:?}");
    assert!(proposed[0].0 == "EKF2_MCOEF" && (proposed[0].1 - 0.25).abs() < 0.015, "{proposed:?}");
}

/// Real vehicles: what is named of a barometer is never there without a smaller residual; two multirotors show their drag, and one whose estimator failed none that is believed.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn recorded_flights_show_their_barometers() {
    for name in ["public/quiver_088.bin", "public/copter_0036.bin", "real_px4_ekf_failure.ulg"] {
        let log = crate::inputs::Input::from(crate::testing::flights().join(name));
        let part =
            crate::pipeline::most_motion(&log, crate::sensors::ConverterOptions::default(), 900.0).unwrap();
        let beside = crate::pipeline::Beside::read(log, None).unwrap();
        let report = of_samples(&part.samples, beside.start_unix_s(), &beside.on_board).air.unwrap();
        println!("{name}: {}", serde_json::to_string(&report).unwrap());
        assert!(report.sensors.iter().any(|s| s.sensor == "Barometer 1"), "{name}: {:?}", report.notes);
        for s in report.sensors.iter().filter(|s| !s.effects.is_empty()) {
            assert!(s.held_out.after < s.held_out.before, "{name}: {s:?}");
        }
        let drag = report.sensors.iter().find(|s| s.sensor == "Drag").unwrap();
        let fails = name.contains("ekf_failure");
        assert_eq!(
            (drag.status == Status::Ok, drag.wind.is_some()),
            (!fails, !fails),
            "{name}: {}",
            drag.text
        );
    }
}
