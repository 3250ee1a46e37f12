use super::*;
use crate::aids::of_samples;
use crate::aids::testing::flown;
use crate::link::frame::{Frame, Sender};
use crate::sensors::{Converter, ConverterOptions};
use gaware_mission::item::Autopilot;
use gaware_nav::effects::{self, unit};
use gaware_nav::model::EffectSetting;
use gaware_nav::sample::Sample;
use gaware_sitl::autopilot::{Autopilot as SimulatedAutopilot, AutopilotConfig, Flavour};
use gaware_sitl::magnetometer::EARTH_FIELD_T;
use gaware_sitl::scenario;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// 2026-07-01: the simulation's field is that of 2026.
const DATE: Option<f64> = Some(1_782_864_000.0);
const MG: f64 = 1e-7;

fn flight(name: &str, injected: &[(&str, Vec<f64>)], seed: u64) -> Vec<Sample> {
    flown(name, injected, seed, |s| s.field_rate_hz = 20.0)
}

fn judged(samples: &[Sample]) -> CompassReport {
    of_samples(samples, DATE, &OnBoard::default()).compasses.unwrap()
}

fn names(entry: &CompassEntry) -> Vec<&str> {
    entry.effects.iter().map(|e| e.names[0]).collect()
}

#[test]
fn compasses_in_order_are_and_nothing_is_named() {
    for (name, seed) in [("multirotor", 1), ("fixed_wing", 2), ("fixed_wing_gusts", 3), ("multirotor", 4)] {
        let report = judged(&flight(name, &[], seed));
        assert_eq!(report.compasses.len(), 2, "{:?}", report.notes);
        for entry in &report.compasses {
            println!(
                "{name} {} off {:?} own {:.2} rms {:?} residual {:?}",
                entry.text,
                entry.heading_off_deg,
                entry.own_heading_sigma_deg,
                entry.heading_rms_deg,
                entry.residual_mgauss
            );
            assert_eq!((entry.status, names(entry)), (Status::Ok, vec![]), "{name}: {entry:?}");
            assert!(entry.heading_off_deg.value.abs() < 3.0 * entry.heading_off_deg.sigma + 0.3, "{entry:?}");
        }
    }
}

/// Each effect alone on both kinds of vehicle: it is named alone, its values hold, and the corrected heading is right; the other compass has none.
#[test]
fn each_effect_is_named_with_values_that_hold() {
    let deg = unit::DEG.si;
    let cases = [
        ("mag_hard_iron", vec![120.0 * MG, -80.0 * MG, 60.0 * MG]),
        ("mag_current", vec![5.0 * MG, -4.0 * MG, 2.0 * MG]),
        ("mag_rotation", vec![4.0 * deg, -3.0 * deg, 14.0 * deg]),
        ("mag_soft_iron", vec![0.15, -0.1, 0.05, 0.08, -0.06, 0.05]),
    ];
    let mut wrong = Vec::new();
    for (seed, (effect, truth)) in (10..).zip(cases) {
        for name in ["multirotor", "fixed_wing"] {
            let report = judged(&flight(name, &[(effect, truth.clone())], seed));
            let [first, second] = &report.compasses[..] else { panic!("{report:?}") };
            println!(
                "{name} {effect}: {} rms {:?} residual {:?} held out {:?}",
                first.text, first.heading_rms_deg, first.residual_mgauss, first.held_out_mgauss
            );
            for e in &first.effects {
                println!(
                    "   {:?} {:.0} {:.0} {:?}",
                    e.names,
                    e.evidence,
                    e.held_out_gain,
                    e.parameters.iter().map(|p| (p.value, p.sigma)).collect::<Vec<_>>()
                );
            }
            let mut check = |holds: bool, what: String| {
                if !holds {
                    wrong.push(format!("{name} {effect}: {what}"));
                }
            };
            check(names(first) == [effect], format!("{:?}", names(first)));
            let scale = effects::find(effect).unwrap().groups()[0].unit.si;
            let own = first.effects.iter().filter(|e| e.names[0] == effect).flat_map(|e| &e.parameters);
            for (p, truth) in own.zip(&truth) {
                let off = (p.value - truth / scale) / p.sigma;
                check(off.abs() < 3.0, format!("{}: {off:.1} sigma, {} ± {}", p.name, p.value, p.sigma));
            }
            check(first.heading_rms_deg.after < 2.5, format!("{:?}", first.heading_rms_deg));
            let held_out = first.held_out_mgauss;
            check(held_out.after < 0.6 * held_out.before, format!("{held_out:?}"));
            check((second.status, names(second)) == (Status::Ok, vec![]), format!("{second:?}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The compasses up to the given one turned.
fn turned_up_to(compass: u8, by: Matrix3<f64>, samples: &[Sample]) -> Vec<Sample> {
    let one = |s: &Sample| match s {
        Sample::Field(f) if f.compass <= compass => {
            Sample::Field(gaware_nav::sample::FieldSample { field: by * f.field, ..*f })
        }
        other => other.clone(),
    };
    samples.iter().map(one).collect()
}

#[test]
fn compasses_that_are_off_alike_are_not_blamed_alone() {
    let samples = flight("multirotor", &[], 33);
    let by = Rotation3::from_euler_angles(0.0, 0.0, 19f64.to_radians()).into_inner();
    let said = |upto: u8| judged(&turned_up_to(upto, by, &samples));
    let (one, both) = (said(0).wrong(), said(1).wrong());
    assert!(one.contains("Compass 1 points 18°") && !one.contains("alike"), "{one}");
    assert!(both.contains("Compass 2 points 18°") && both.contains("All compasses are off alike"), "{both}");
    let first_screen = crate::report::flight::compass_answer(&said(1));
    assert!(first_screen.contains("All compasses are off alike"), "{first_screen}");
}

/// A receiver whose fixes jump by 60 m every two seconds: no compass is called turned, no barometer wrong.
#[test]
fn where_fixes_and_inertial_data_contradict_each_other_no_sensor_is_judged() {
    let mut samples = flown("multirotor", &[], 34, |s| (s.field_rate_hz, s.air_rate_hz) = (20.0, 10.0));
    for sample in &mut samples {
        if let Sample::Fix(fix) = sample
            && fix.t_s % 4.0 > 2.0
        {
            fix.position.lat_rad += 60.0 / 6.37e6;
        }
    }
    let aids = of_samples(&samples, DATE, &OnBoard::default());
    let (compasses, air) = (aids.compasses.unwrap(), aids.air.unwrap());
    assert!(compasses.compasses.is_empty() && compasses.notes[0].contains("inconsistent with each other"));
    assert!(
        air.sensors.is_empty() && air.notes[0].contains("inconsistent with each other"),
        "{:?}",
        air.notes
    );
}

#[test]
fn a_compass_with_too_few_samples_is_said_to_have_them() {
    let report = judged(&flown("multirotor", &[], 35, |s| s.field_rate_hz = 0.05));
    assert!(
        report.compasses.is_empty() && report.notes[0].contains("not judged: none has samples beside 60"),
        "{:?}",
        report.notes
    );
}

#[test]
fn a_wrong_orientation_and_a_reversed_axis_are_named() {
    let samples = flight("multirotor", &[], 30);
    let quarter = Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2).into_inner();
    let turned = |by: Matrix3<f64>| turned_up_to(0, by, &samples);
    let reversed = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    let eighth =
        Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, std::f64::consts::FRAC_PI_4).into_inner();
    for (by, words) in [
        (quarter, "turned by 270° to the right"),
        (eighth, "upside down and turned by 45°"),
        (reversed, "x, −y, z"),
    ] {
        let report = judged(&turned(by));
        let first = &report.compasses[0];
        assert_eq!(first.status, Status::Wrong);
        assert!(first.orientation.as_deref().is_some_and(|o| o.contains(words)), "{words}: {first:?}");
        assert!(first.heading_rms_deg.after < 2.0, "{first:?}");
        assert_eq!(report.compasses[1].orientation, None);
    }
}

/// PX4 numbers its calibrations by itself: the compass of message 0 may be CAL_MAG1.
#[test]
fn the_orientation_of_px4_is_that_of_the_calibration_that_is_known_to_be_this_ones() {
    let samples = flight("multirotor", &[], 30);
    let quarter = Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2).into_inner();
    let turned = turned_up_to(0, quarter, &samples);
    let of = |parameters: &[(&str, f64)]| {
        let parameters = parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
        let board = OnBoard { autopilot: Some(Autopilot::Px4), parameters, ..OnBoard::default() };
        of_samples(&turned, DATE, &board).compasses.unwrap()
    };
    let rotations = [("CAL_MAG0_ROT", 0.0), ("CAL_MAG1_ROT", 0.0)];
    let one = of(&[&rotations[..], &[("CAL_MAG0_ID", 0.0), ("CAL_MAG1_ID", 7.0)]].concat());
    let [proposal] = &one.compasses[0].proposals[..] else { panic!("{:?}", one.compasses[0]) };
    assert_eq!(proposal.parameter, "CAL_MAG1_ROT");
    assert!(proposal.source.contains("Magnetometer.cpp"), "{proposal:?}");
    let two = of(&[&rotations[..], &[("CAL_MAG0_ID", 5.0), ("CAL_MAG1_ID", 7.0)]].concat());
    assert!(two.compasses[0].proposals.is_empty(), "{:?}", two.compasses[0].proposals);
}

/// `correct_field` adds the motor compensation behind the matrix, and one factor before it.
#[test]
fn the_motor_compensation_is_proposed_as_the_firmware_applies_it() {
    let (iron, motors) = ([60.0, -40.0, 30.0], [5.0, -4.0, 2.0]);
    let injected = [("mag_hard_iron", iron), ("mag_current", motors)];
    let injected = injected.map(|(name, v)| (name, v.map(|v| v * MG).to_vec()));
    let old = [
        ("COMPASS_SCALE", 1.1),
        ("COMPASS_OFS_X", -20.0),
        ("COMPASS_OFS_Y", 35.0),
        ("COMPASS_OFS_Z", 5.0),
        ("COMPASS_DIA_X", 1.2),
        ("COMPASS_DIA_Y", 0.85),
        ("COMPASS_DIA_Z", 1.0),
        ("COMPASS_MOT_X", 3.0),
        ("COMPASS_MOT_Y", -2.0),
        ("COMPASS_MOT_Z", 4.0),
        ("COMPASS_MOTCT", 2.0),
    ];
    let parameters = old.map(|(n, v)| (n.to_owned(), v)).into();
    let board = OnBoard { autopilot: Some(Autopilot::ArduPilot), parameters, ..OnBoard::default() };
    let samples = flight("multirotor", &injected, 41);
    let report = of_samples(&samples, DATE, &board).compasses.unwrap();
    let of =
        |name: &str| report.compasses[0].proposals.iter().find(|p| p.parameter == name).map(|p| p.proposed);
    for (k, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        let new = of(&format!("COMPASS_MOT_{axis}")).unwrap();
        assert!((new - (old[7 + k].1 - motors[k])).abs() < 0.8, "{axis}: {new}");
        let new = of(&format!("COMPASS_OFS_{axis}")).unwrap();
        let expected = old[1 + k].1 - iron[k] / (1.1 * old[4 + k].1);
        assert!((new - expected).abs() < 15.0, "{axis}: {new} {expected}");
    }
}

/// What the program's proposal would make of the next flight: the same errors behind the new parameters.
#[test]
fn the_proposal_corrects_the_next_flight() {
    let truth = [120.0 * MG, -80.0 * MG, 60.0 * MG];
    let old = [("COMPASS_OFS_X", -20.0), ("COMPASS_OFS_Y", 35.0), ("COMPASS_OFS_Z", 5.0)];
    let parameters = old.map(|(n, v)| (n.to_owned(), v)).into();
    let board = OnBoard { autopilot: Some(Autopilot::ArduPilot), parameters, ..OnBoard::default() };
    let samples = flight("multirotor", &[("mag_hard_iron", truth.to_vec())], 40);
    let report = of_samples(&samples, DATE, &board).compasses.unwrap();
    let proposals = &report.compasses[0].proposals;
    assert_eq!(proposals.len(), 3, "{proposals:?}");
    for ((p, truth), (name, old)) in proposals.iter().zip(truth).zip(old) {
        assert_eq!((p.parameter.as_str(), p.on_board), (name, old));
        // The reported field holds the old offset; the error goes out of it.
        assert!((p.proposed - (old - truth / MG)).abs() < 12.0, "{p:?}");
    }
}

/// The simulation's field is a constant of its own; the estimator's is the world model's. They must agree, or the tests prove nothing.
#[test]
fn the_simulated_field_is_that_of_the_place() {
    let place = gaware_nav::earth::Geodetic::from_degrees(47.397_7, 8.545_6, 488.0);
    let world = WorldField::at(&place, DATE).unwrap();
    assert!((world.field_n - Vector3::from(EARTH_FIELD_T)).norm() < 2e-7, "{world:?}");
}

fn recorded(name: &str) -> CompassReport {
    let log = crate::inputs::Input::from(crate::testing::flights().join(name));
    let part =
        crate::pipeline::most_motion(&log, crate::sensors::ConverterOptions::default(), 900.0).unwrap();
    let beside = crate::pipeline::Beside::read(log, None).unwrap();
    let report = of_samples(&part.samples, beside.start_unix_s(), &beside.on_board).compasses.unwrap();
    println!("{name}: {}", serde_json::to_string_pretty(&report).unwrap());
    report
}

/// Real vehicles: what a public log shows of its compasses.
#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn recorded_flights_show_their_compasses() {
    let quiver = recorded("public/quiver_088.bin");
    assert!(quiver.compasses.iter().any(|c| c.status == Status::Wrong), "{quiver:?}");
    // What is named corrects the field alone: soft iron was, with values that only the tolerances of other effects made right.
    let copter = recorded("public/copter_0036.bin");
    for c in copter.compasses.iter().filter(|c| !c.effects.is_empty()) {
        assert!(c.held_out_mgauss.after < c.held_out_mgauss.before, "{c:?}");
    }
}

/// A flight as its autopilot sends it, through frames, converter and time line.
fn linked(flavour: Flavour, name: &str, injected: (&str, &[f64])) -> Vec<Sample> {
    let mut scenario = scenario::scenario(name).unwrap();
    scenario.model.set(EffectSetting::known(effects::find(injected.0).unwrap(), injected.1).unwrap());
    let config = AutopilotConfig { flavour, wait_for_station: false, seed: 50, ..AutopilotConfig::default() };
    let mut autopilot = SimulatedAutopilot::playing(config, &scenario);
    let station = Sender { system_id: 255, component_id: 190 };
    // SYS_STATUS, GPS_RAW_INT, SCALED_IMU, RAW_IMU, ATTITUDE, HIGHRES_IMU of PX4.
    let wanted = [(1_u32, 5.0), (24, 10.0), (26, 50.0), (27, 50.0), (30, 10.0), (105, 50.0)];
    let wanted = wanted.iter().filter(|(id, _)| *id != if flavour == Flavour::Px4 { 27 } else { 105 });
    for (k, (id, hz)) in (0..).zip(wanted) {
        let command = COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system: 1,
            target_component: 1,
            param1: *id as f32,
            param2: 1e6 / hz,
            ..Default::default()
        };
        autopilot.receive(Frame::encode(station, k, &MavMessage::COMMAND_LONG(command)).raw());
    }
    let (mut converter, mut samples, mut now_s) =
        (Converter::new(ConverterOptions::default()), Vec::new(), 0.0);
    while !autopilot.is_over() && now_s < 400.0 {
        now_s += 0.05;
        autopilot.step(now_s);
        for out in autopilot.take_output() {
            converter.feed(out.t_us, &Frame::parse(out.bytes.into()).unwrap(), &mut samples);
        }
    }
    samples
}

/// Both firmwares, over the messages that each of them sends, truncated to milligauss or in gauss.
#[test]
fn both_firmwares_compasses_are_judged_over_the_link() {
    let truth = [120.0 * MG, -80.0 * MG, 60.0 * MG];
    for (flavour, name) in [(Flavour::ArduPilot, "fixed_wing"), (Flavour::Px4, "multirotor")] {
        let report = judged(&linked(flavour, name, ("mag_hard_iron", &truth)));
        let [first] = &report.compasses[..] else { panic!("{report:?}") };
        println!(
            "{flavour:?} {name}: {} {:?} {:?}",
            first.text, first.heading_rms_deg, first.held_out_mgauss
        );
        assert_eq!((first.status, names(first)), (Status::Wrong, vec!["mag_hard_iron"]), "{first:?}");
        for (p, truth) in first.effects[0].parameters.iter().zip(truth) {
            assert!(
                (p.value - truth / MG).abs() < 3.0 * p.sigma,
                "{flavour:?} {}: {} ± {}",
                p.name,
                p.value,
                p.sigma
            );
        }
        assert!(first.heading_rms_deg.after < 3.0, "{first:?}");
    }
}
