//! The sign of every mapping: the autopilot's own correction, as its sources have it, applied to samples with the effect, gives the
//! ideal sample back once the proposed value is set. And what is proposed at all.

mod units;

use super::table::rows;
use super::*;
use gaware_nav::effects::{self, Antenna, FixInstant, Instant, Older, REGISTRY};
use gaware_nav::rotation::c_nb_from_euler;
use nalgebra::Vector3;
use proptest::prelude::*;

const AXES: [&str; 3] = ["X", "Y", "Z"];

fn on_board(autopilot: Autopilot, parameters: &[(&str, f64)]) -> OnBoard {
    let mut found = OnBoard { autopilot: Some(autopilot), version: Some((4, 6)), ..OnBoard::default() };
    parameters.iter().for_each(|(name, value)| found.learn(name, *value));
    found
}

fn finding(name: &'static str, values: &[f64], sigma: f64) -> Finding {
    Finding { names: vec![name], values: values.to_vec(), sigmas: vec![sigma; values.len()], barred: None }
}

/// A whole list of parameters, which holds these.
fn complete(parameters: &[(&str, f64)]) -> OnBoard {
    let mut board = on_board(Autopilot::ArduPilot, parameters);
    (0..592).for_each(|k| board.learn(&format!("P{k}"), 0.0));
    board.version = None;
    board
}

/// Delays of 215 ms in logs of Copter 3.2 to 3.4, whose lists have no GPS_DELAY_MS.
#[test]
fn a_parameter_that_a_whole_list_lacks_is_not_proposed_and_old_names_are_known() {
    let latency = [finding("gps_latency", &[0.15], 0.003)];
    let proposed = |parameters: &[(&str, f64)]| {
        let advice = advise(&latency, &complete(parameters));
        let names: Vec<_> = advice.proposals.iter().map(|p| (p.parameter, p.proposed)).collect();
        (names, advice)
    };
    let (none, advice) = proposed(&[]);
    assert!(none.is_empty(), "{advice:?}");
    assert!(
        advice.not_proposed[0].reason.contains("has no GPS1_DELAY_MS: it is not among the 592"),
        "{advice:?}"
    );
    let (new, advice) = proposed(&[("EK2_GPS_DELAY", 220.0), ("EKF_VEL_DELAY", 220.0)]);
    assert_eq!(new[0].0, "EK2_GPS_DELAY", "{advice:?}");
    let (old, advice) =
        proposed(&[("EK2_GPS_DELAY", 220.0), ("EKF_VEL_DELAY", 220.0), ("AHRS_EKF_TYPE", 1.0)]);
    assert_eq!(old[0].0, "EKF_VEL_DELAY", "{advice:?}");
    let note = advice.proposals[0].note.clone().unwrap_or_default();
    assert!(note.contains("EKF_POS_DELAY") && !note.contains("driver"), "{note}");
    // A list that broke off, as when the flight begins while it is read, lacks nothing: the name goes by the version.
    let part =
        OnBoard { announced: Some(1348), version: Some((4, 7)), ..complete(&[("INS_ACCEL_FILTER", 20.0)]) };
    let advice = advise(&latency, &part);
    assert_eq!(advice.proposals.first().map(|p| p.parameter), Some("GPS1_DELAY_MS"), "{advice:?}");
    let whole = OnBoard { announced: Some(593), ..part };
    assert!(advise(&latency, &whole).proposals.is_empty());
    // A few parameters are no list either.
    let few = advise(&latency, &on_board(Autopilot::ArduPilot, &[("INS_ACCEL_FILTER", 20.0)]));
    assert_eq!(few.proposals[0].parameter, "GPS1_DELAY_MS");
}

#[test]
fn a_delay_beyond_the_greatest_gets_the_greatest_and_says_so() {
    let board = on_board(Autopilot::ArduPilot, &[("GPS1_DELAY_MS", 0.0), ("INS_ACCEL_FILTER", 20.0)]);
    let advice = advise(&[finding("gps_latency", &[0.270], 0.003)], &board);
    let proposal = &advice.proposals[0];
    assert_eq!(proposal.proposed, Some(250.0));
    let note = proposal.note.clone().unwrap_or_default();
    assert!(note.contains("281 ± 3 ms") && note.contains("no samples older than 250"), "{note}");
    // Twice the greatest is something else, and one that has it already keeps it.
    assert!(advise(&[finding("gps_latency", &[0.6], 0.003)], &board).proposals.is_empty());
    let board = on_board(Autopilot::ArduPilot, &[("GPS1_DELAY_MS", 250.0), ("INS_ACCEL_FILTER", 20.0)]);
    assert!(advise(&[finding("gps_latency", &[0.270], 0.003)], &board).proposals.is_empty());
}

#[test]
fn a_place_that_someone_has_set_may_be_better_than_the_flight() {
    let parameters = [
        ("GPS1_POS_X", 0.0),
        ("GPS1_POS_Y", 0.0),
        ("GPS1_POS_Z", -0.24),
        ("INS_POS1_X", 0.0),
        ("INS_POS1_Y", 0.0),
        ("INS_POS1_Z", 0.0),
    ];
    let advice = advise(
        &[finding("gps_lever_arm", &[0.4, 0.0, -0.12], 0.02)],
        &on_board(Autopilot::ArduPilot, &parameters),
    );
    let note = |name: &str| {
        let proposal = advice.proposals.iter().find(|p| p.parameter == name);
        proposal.and_then(|p| p.note.clone()).unwrap_or_default()
    };
    assert!(note("GPS1_POS_Z").contains("measured with a tape"), "{advice:?}");
    assert_eq!(note("GPS1_POS_X"), "", "nobody has measured that one");
}

/// The values of a calibration on board, and how it corrects a raw sample.
#[derive(Clone, Copy, Debug)]
struct Calibration {
    factor: [f64; 3],
    offset: [f64; 3],
    /// First-order coefficient in SI and the temperature at which it is zero.
    temperature: [f64; 3],
    reference_degc: f64,
}

impl Calibration {
    /// Temperature, offset, factor: `AP_InertialSensor_Backend.cpp:129-140`, `lib/sensor_calibration/Accelerometer.hpp:84`.
    fn correct(&self, raw: Vector3<f64>, degc: f64) -> Vector3<f64> {
        Vector3::from_fn(|i, _| {
            (raw[i] - self.temperature[i] * (degc - self.reference_degc) - self.offset[i]) * self.factor[i]
        })
    }

    /// What the sensor must have measured for this corrected sample.
    fn raw(&self, corrected: Vector3<f64>, degc: f64) -> Vector3<f64> {
        Vector3::from_fn(|i, _| {
            corrected[i] / self.factor[i]
                + self.offset[i]
                + self.temperature[i] * (degc - self.reference_degc)
        })
    }
}

/// The parameters of a calibration as an autopilot names them.
fn named(autopilot: Autopilot, accel: bool, c: &Calibration) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for (i, axis) in AXES.iter().enumerate() {
        match (autopilot, accel) {
            (Autopilot::ArduPilot, true) => all.extend([
                (format!("INS_ACCSCAL_{axis}"), c.factor[i]),
                (format!("INS_ACCOFFS_{axis}"), c.offset[i]),
                (format!("INS_TCAL1_ACC1_{axis}"), c.temperature[i] * 1e6),
            ]),
            (Autopilot::ArduPilot, false) => all.extend([
                (format!("INS_GYROFFS_{axis}"), c.offset[i]),
                (format!("INS_TCAL1_GYR1_{axis}"), c.temperature[i] * 1e6),
            ]),
            (Autopilot::Px4, true) => all.extend([
                (format!("CAL_ACC0_{axis}SCALE"), c.factor[i]),
                (format!("CAL_ACC0_{axis}OFF"), c.offset[i]),
                (format!("TC_A0_X1_{i}"), c.temperature[i]),
            ]),
            (Autopilot::Px4, false) => all.extend([
                (format!("CAL_GYRO0_{axis}OFF"), c.offset[i]),
                (format!("TC_G0_X1_{i}"), c.temperature[i]),
            ]),
        }
    }
    all.extend(["INS_TCAL1_ENABLE", "TC_A_ENABLE", "TC_G_ENABLE"].map(|n| (n.to_owned(), 1.0)));
    all.extend(["AHRS_ORIENTATION", "SENS_BOARD_ROT"].map(|n| (n.to_owned(), 0.0)));
    all
}

/// The calibration after every new value is set, as the autopilot stores it but without its rounding.
fn after(
    autopilot: Autopilot,
    mapping: &Mapping,
    values: &[f64],
    before: &Calibration,
    accel: bool,
) -> Calibration {
    let names = named(autopilot, accel, before);
    let names: Vec<(&str, f64)> = names.iter().map(|(n, v)| (n.as_str(), *v)).collect();
    let board = on_board(autopilot, &names);
    let mut c = *before;
    for (k, value) in values.iter().enumerate() {
        let derived = rule::derive(mapping, k, *value, 1e-6, &board);
        assert!(derived.needs.is_empty(), "{derived:?}");
        let new = derived.value.expect("all that it depends on is on board");
        match mapping.rule {
            Rule::Factor => c.factor[k] = new,
            Rule::Offset { .. } => c.offset[k] = new,
            Rule::Temperature { scale, .. } => c.temperature[k] = new / scale,
            other => panic!("{other:?} is no calibration"),
        }
    }
    c
}

fn row(effect: &str, autopilot: Autopilot) -> &'static Mapping {
    rows().find(|m| m.effect == effect && m.autopilot == autopilot).expect("a row")
}

/// What an effect of the registry, or a bias, adds to an ideal sample.
fn added(effect: &str, p: &[f64], ideal: Vector3<f64>, degc: f64) -> Vector3<f64> {
    if effect.ends_with("_bias") {
        return Vector3::from_column_slice(p);
    }
    let x = Instant {
        t_s: 0.0,
        rate: ideal,
        force: ideal,
        temperature_above_25_degc: degc - 25.0,
        ..effects::Instant::default()
    };
    let imu = effects::find(effect).expect("an effect on samples");
    if effect.starts_with("accel") { imu.accel(p, &x) } else { imu.gyro(p, &x) }
}

proptest! {
    /// Whatever is on board, the new value makes the corrected sample ideal: scale, offset and temperature of both autopilots.
    #[test]
    fn the_documented_correction_with_the_new_value_gives_the_ideal_sample(
        factor in proptest::array::uniform3(0.8..1.2_f64),
        offset in proptest::array::uniform3(-3.5..3.5_f64),
        temperature in proptest::array::uniform3(-0.01..0.01_f64),
        ideal in proptest::array::uniform3(-160.0..160.0_f64),
        degc in -20.0..80.0_f64,
        p in proptest::array::uniform3(-0.1..0.1_f64),
    ) {
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            for effect in ["accel_scale_factor", "accel_bias", "gyro_bias", "accel_temperature", "gyro_temperature"] {
                let accel = effect.starts_with("accel");
                let factor = if accel { factor } else { [1.0; 3] };
                // Where a calibration begins to count its temperature is a constant, part of the bias: 25 °C as the effect does.
                let before = Calibration { factor, offset, temperature, reference_degc: 25.0 };
                let ideal = Vector3::from(ideal);
                let raw = before.raw(ideal + added(effect, &p, ideal, degc), degc);
                let now = after(autopilot, row(effect, autopilot), &p, &before, accel).correct(raw, degc);
                prop_assert!((now - ideal).norm() < 1e-9 * (1.0 + ideal.norm()), "{effect} {autopilot}: {now} {ideal}");
            }
        }
    }

    /// `AP_NavEKF3_PosVelFusion.cpp:416-429`, `gps_control.cpp:299-304,337-340`: the antenna's place less that of the unit is taken
    /// off position and velocity.
    #[test]
    fn the_antenna_correction_with_the_new_place_gives_the_path_of_the_unit(
        arm in proptest::array::uniform3(-4.0..4.0_f64),
        unit in proptest::array::uniform3(-0.9..0.9_f64),
        rate in proptest::array::uniform3(-2.0..2.0_f64),
        attitude in proptest::array::uniform3(-1.0..1.0_f64),
    ) {
        let x = FixInstant {
            t_s: 0.0,
            v_n: Vector3::zeros(),
            a_n: Vector3::zeros(),
            smoothed_a_n: Vector3::zeros(),
            skewed_n: Vector3::zeros(),
            c_nb: c_nb_from_euler(attitude[0], attitude[1], attitude[2]),
            rate_eb: rate.into(),
            force_rate: Vector3::zeros(),
            antenna: Antenna::default(),
            older: Older::default(),
            elapsed_s: 0.0,
            conditions: gaware_nav::effects::Conditions::default(),
        };
        let effect = effects::find("gps_lever_arm").expect("an effect on fixes");
        let [position, velocity] = effect.fix(&arm, &x);
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            let mapping = row("gps_lever_arm", autopilot);
            let Rule::Antenna { unit: names } = mapping.rule else { panic!("no antenna") };
            let board: Vec<(&str, f64)> = names.into_iter().zip(unit).collect();
            let board = on_board(autopilot, &board);
            let place = Vector3::from_fn(|k, _| rule::derive(mapping, k, arm[k], 0.01, &board).value.unwrap());
            let offset = place - Vector3::from(unit);
            prop_assert!((position - x.c_nb * offset).norm() < 1e-9);
            prop_assert!((velocity - x.c_nb * Vector3::from(rate).cross(&offset)).norm() < 1e-9);
        }
    }

    /// `AP_NavEKF3_Measurements.cpp:590`, `estimator_interface.cpp:180-182`: the stamp less the parameter is when the fix was valid.
    #[test]
    fn the_delay_dates_a_fix_back_to_when_it_was_valid(latency in 0.0..0.4_f64, hz in 5.0..200.0_f64, arrived in 10.0..1e4_f64) {
        let effect = effects::find("gps_latency").expect("an effect on fixes");
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            let board = on_board(autopilot, &[("INS_ACCEL_FILTER", hz)]);
            let derived = rule::derive(row("gps_latency", autopilot), 0, latency, 1e-3, &board);
            // Samples in ArduPilot's logs are behind a low-pass that its filter does not see.
            let samples_s = if autopilot == Autopilot::ArduPilot { 0.225_08 / hz } else { 0.0 };
            let valid_s = arrived - effect.fix_delay_s(&[latency], 0.0) - samples_s;
            let dated_s = arrived - derived.value.unwrap() * 1e-3;
            prop_assert!((dated_s - valid_s).abs() < 1e-5 / hz + 1e-9, "{dated_s} {valid_s}");
        }
    }

    /// Nothing outside its range, off its step, or without a change is ever proposed.
    #[test]
    fn what_is_proposed_is_in_range_on_step_and_a_change(
        effect in 0..rows().count(),
        values in proptest::collection::vec(-2.0..2.0_f64, 3),
        sigma in 1e-6..0.5_f64,
        held in proptest::collection::vec(-6.0..6.0_f64, 12),
    ) {
        let mapping = rows().nth(effect).unwrap();
        let mut board = on_board(mapping.autopilot, &[("AHRS_ORIENTATION", 0.0), ("SENS_BOARD_ROT", 0.0)]);
        for name in ["INS_TCAL1_ENABLE", "TC_A_ENABLE", "TC_G_ENABLE"] {
            board.learn(name, 1.0);
        }
        let names = rows().filter(|m| m.autopilot == mapping.autopilot).flat_map(|m| m.parameters);
        for (name, value) in names.zip(&held) {
            board.learn(name, *value);
        }
        let advice = advise(&[finding(mapping.effect, &values[..mapping.parameters.len()], sigma)], &board);
        for p in &advice.proposals {
            let Some(v) = p.proposed else { continue };
            prop_assert!(v.is_finite() && p.range.is_none_or(|(low, high)| (low..=high).contains(&v)), "{p:?}");
            prop_assert!(((v / p.step).round() * p.step - v).abs() < 1e-6 * p.step.max(v.abs()), "{p:?}");
            prop_assert!(p.on_board.is_none_or(|old| (old - v).abs() >= 0.49 * p.step), "{p:?}");
            prop_assert!(p.needs.is_empty());
        }
        let all = advice.proposals.len() + advice.not_proposed.len();
        prop_assert!(all >= 1, "an effect is proposed or it is said why not");
    }
}

#[test]
fn every_effect_has_a_parameter_or_a_reason_and_every_row_a_source() {
    for effect in REGISTRY {
        let of_effect: Vec<_> = rows().filter(|m| m.effect == effect.name()).collect();
        for row in &of_effect {
            assert_eq!(row.parameters.len(), effect.len(), "{}", effect.name());
        }
        let named = of_effect.iter().any(|m| m.autopilot == Autopilot::Px4) && of_effect.len() >= 2;
        assert!(named || !table::why_not(effect.name()).contains("is known"), "{}", effect.name());
    }
    for row in rows() {
        assert!(row.source.contains(':') && row.step > 0.0, "{row:?}");
        for name in row.parameters {
            assert!(name.parse::<gaware_mission::params::ParamName>().is_ok(), "{name}");
        }
    }
}

/// What explain finds on the recorded flights of ArduPilot's firmware (its standard accelerometer factor is 1.001), as numbers.
#[test]
fn the_recorded_flights_of_ardupilot_get_the_right_parameter_sign_and_size() {
    let stock = [
        ("INS_ACCSCAL_X", 1.001),
        ("INS_ACCSCAL_Y", 1.001),
        ("INS_ACCSCAL_Z", 1.001),
        ("AHRS_ORIENTATION", 0.0),
        ("INS_ACCEL_FILTER", 20.0),
        ("INS_POS1_X", 0.0),
        ("INS_POS1_Y", 0.0),
        ("INS_POS1_Z", 0.0),
        ("GPS1_DELAY_MS", 0.0),
        ("GPS1_POS_X", 0.0),
        ("GPS1_POS_Y", 0.0),
        ("GPS1_POS_Z", 0.0),
    ];
    let board = on_board(Autopilot::ArduPilot, &stock);
    // sitl_gps_lag350: 335 ms old.
    let lag = advise(&[finding("gps_latency", &[0.3227], 0.0021)], &board);
    let greatest = &lag.proposals[0];
    assert_eq!((greatest.parameter, greatest.proposed), ("GPS1_DELAY_MS", Some(250.0)));
    assert!(greatest.note.as_ref().is_some_and(|n| n.contains("says 334 ± 2 ms")), "{greatest:?}");
    // sitl_gps_lever: 1.2, 0.4, -0.3 m.
    let lever = advise(&[finding("gps_lever_arm", &[1.178, 0.393, -0.297], 0.01)], &board);
    let found: Vec<_> = lever.proposals.iter().map(|p| (p.parameter, p.proposed)).collect();
    assert_eq!(found, [("GPS1_POS_X", Some(1.18)), ("GPS1_POS_Y", Some(0.39)), ("GPS1_POS_Z", Some(-0.3))]);
    // sitl_acc_scale: measured values were divided by 1.01, 0.99, 1.015.
    let scale = advise(&[finding("accel_scale_factor", &[-8911e-6, 11_111e-6, -13_793e-6], 300e-6)], &board);
    for (p, truth) in scale.proposals.iter().zip([1.01, 0.99, 1.015]) {
        assert!(p.proposed.is_some_and(|v| (v - truth).abs() < 2e-6), "{p:?}");
    }
    assert_eq!(scale.proposals.len(), 3);
    // sitl_clean_dither: no effect is named.
    assert_eq!(advise(&[], &board).proposals, []);
}

#[test]
fn what_the_log_lacks_is_said_and_not_guessed() {
    let board = on_board(Autopilot::ArduPilot, &[]);
    let advice = advise(
        &[
            finding("accel_scale_factor", &[-8911e-6, 0.0, 0.0], 300e-6),
            finding("gps_lever_arm", &[1.2, 0.4, -0.3], 0.01),
        ],
        &board,
    );
    let scale = &advice.proposals[0];
    assert_eq!((scale.parameter, scale.proposed), ("INS_ACCSCAL_X", None));
    assert_eq!(scale.needs, ["INS_ACCSCAL_X", "AHRS_ORIENTATION"]);
    assert!(matches!(scale.change, Change::Multiply(f) if (f - 1.008_991).abs() < 1e-6));
    assert_eq!(advice.not_proposed.iter().filter(|n| n.reason.starts_with("not significant")).count(), 2);
    let arm = advice.proposals.iter().find(|p| p.parameter == "GPS1_POS_Z").unwrap();
    assert_eq!(
        (arm.proposed, &arm.change, arm.needs.as_slice()),
        (None, &Change::UnitPlus(-0.3), &["INS_POS1_Z"][..])
    );
    let text = file::text(&advice, Autopilot::ArduPilot, &board, "a.tlog");
    assert!(text.lines().all(|line| line.starts_with('#')), "{text}");
    assert!(text.contains("INS_ACCSCAL_X: multiply by 1.008991"), "{text}");
    let none = advise(&[finding("gps_latency", &[0.1], 0.01)], &OnBoard::default());
    assert!(none.proposals.is_empty() && none.notes[0].contains("which autopilot"));
}

#[test]
fn names_follow_the_vehicle_then_its_version() {
    let with = |autopilot, version, parameters: &[(&str, f64)]| {
        let board = OnBoard { version, ..on_board(autopilot, parameters) };
        mapping("gps_latency", autopilot, &board).unwrap().parameters[0]
    };
    let (a, p) = (Autopilot::ArduPilot, Autopilot::Px4);
    assert_eq!(with(a, Some((4, 5)), &[]), "GPS_DELAY_MS");
    assert_eq!(with(a, Some((4, 7)), &[]), "GPS1_DELAY_MS");
    assert_eq!(with(a, Some((4, 7)), &[("GPS_DELAY_MS", 0.0)]), "GPS_DELAY_MS");
    assert_eq!(with(a, None, &[]), "GPS1_DELAY_MS");
    assert_eq!(with(p, Some((1, 15)), &[]), "EKF2_GPS_DELAY");
    assert_eq!(with(p, None, &[]), "EKF2_GPS_DELAY");
    assert_eq!(with(p, None, &[("SENS_GPS0_DELAY", 110.0)]), "SENS_GPS0_DELAY");
}

#[test]
fn what_cannot_be_corrected_is_named_with_its_reason() {
    let px4 = [
        ("SENS_BOARD_ROT", 0.0),
        ("CAL_ACC0_XSCALE", 1.0),
        ("CAL_ACC0_YSCALE", 1.0),
        ("CAL_ACC0_ZSCALE", 1.0),
        ("CAL_ACC1_ID", 0.0),
        ("SENS_IMU_AUTOCAL", 0.0),
        ("EKF2_GPS_DELAY", 110.0),
    ];
    let reason = |extra: &[(&str, f64)], finding: Finding| {
        let mut board = on_board(Autopilot::Px4, &px4);
        extra.iter().for_each(|(name, value)| _ = board.parameters.insert((*name).to_owned(), *value));
        let advice = advise(&[finding], &board);
        assert!(advice.proposals.is_empty(), "{:?}", advice.proposals);
        advice.not_proposed[0].reason.clone()
    };
    let scale = || finding("accel_scale_factor", &[0.01, 0.01, 0.01], 1e-4);
    assert!(reason(&[], finding("gyro_g_sensitivity", &[1e-4; 9], 1e-6)).contains("no parameter exists"));
    assert!(reason(&[("SENS_BOARD_ROT", 2.0)], scale()).contains("SENS_BOARD_ROT is 2"));
    assert!(reason(&[("CAL_ACC1_ID", 99.0)], scale()).contains("several inertial units"));
    assert!(reason(&[], finding("gps_latency", &[0.112], 0.002)).contains("not significant"));
    assert!(
        reason(&[], finding("accel_temperature", &[0.01; 3], 1e-4)).contains("TC_A_ENABLE is not in the log")
    );
    let both =
        Finding { names: vec!["gps_latency", "gps_lever_arm"], ..finding("gps_latency", &[0.2], 0.002) };
    assert!(reason(&[], both).contains("does not separate gps_latency and gps_lever_arm"));
    let barred = Finding { barred: Some("the held-out data do not confirm it"), ..scale() };
    assert!(reason(&[], barred).contains("held-out"));
}

#[test]
fn a_parameter_that_changed_on_the_way_does_not_count() {
    let mut board = on_board(Autopilot::ArduPilot, &[("GPS1_DELAY_MS", 100.0)]);
    board.learn("GPS1_DELAY_MS", 120.0);
    board.learn("GPS1_DELAY_MS", 120.0);
    assert_eq!(board.get("GPS1_DELAY_MS"), None);
    assert!(board.notes()[0].contains("GPS1_DELAY_MS"));
    let file =
        gaware_mission::params::file::ParamFile::read("GPS1_DELAY_MS,80\nINS_ACCSCAL_X,1.002\n").unwrap();
    board.add_file(&file);
    assert_eq!((board.get("GPS1_DELAY_MS"), board.get("INS_ACCSCAL_X")), (None, Some(1.002)));
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn parameters_and_version_of_recorded_logs_are_read() {
    let folder = crate::testing::flights();
    let bin = OnBoard::read(folder.join("sitl_gsens_typical_dither_cut.BIN"), None).unwrap();
    assert_eq!(
        (bin.autopilot, bin.get("INS_ACCSCAL_X")),
        (Some(Autopilot::ArduPilot), Some(f64::from(1.001_f32)))
    );
    assert!(bin.get("GPS1_DELAY_MS").is_some(), "{:?}", bin.parameters.keys().take(5).collect::<Vec<_>>());
    let ulog = OnBoard::read(folder.join("real_px4_ekf_failure.ulg"), None).unwrap();
    assert_eq!(ulog.autopilot, Some(Autopilot::Px4));
    assert!(ulog.version.is_some() && ulog.get("EKF2_GPS_DELAY").is_some(), "{:?}", ulog.version);
    let tlog = OnBoard::read(folder.join("real_ardusub_bench.tlog"), None).unwrap();
    assert_eq!((tlog.version, tlog.get("INS_ACCSCAL_X")), (Some((4, 1)), Some(1.0)));
}
