//! The firmware's own arithmetic, for the tests of signs.
use super::*;
use gaware_nav::model::EffectSetting;

/// `AP_Compass_Backend::correct_field`, mG and A.
fn ardupilot(raw: &Vector3<f64>, current_a: f64, of: &dyn Fn(&str) -> f64, n: &str) -> Vector3<f64> {
    let three = |what: &str| Vector3::from(["X", "Y", "Z"].map(|a| of(&format!("COMPASS_{what}{n}_{a}"))));
    symmetric(&three("DIA"), &three("ODI")) * (raw + three("OFS")) + three("MOT") * current_a
}

/// `calibration::Magnetometer::Correct`, G and A.
fn px4(raw: &Vector3<f64>, current_a: f64, of: &dyn Fn(&str) -> f64, turn: &Matrix3<f64>) -> Vector3<f64> {
    let three = |what: &str| Vector3::from(["X", "Y", "Z"].map(|a| of(&format!("CAL_MAG0_{a}{what}"))));
    let power = current_a * 1e-3;
    turn * symmetric(&three("SCALE"), &three("ODIAG")) * (raw + three("COMP") * power - three("OFF"))
}

#[test]
fn proposals_make_the_firmware_report_the_earths_field() {
    let errors = Errors {
        by_field: symmetric(&Vector3::new(1.05, 0.97, 1.02), &Vector3::new(0.02, -0.01, 0.015)),
        constant: Vector3::new(60.0, -90.0, 40.0),
        current: Vector3::new(3.0, -1.5, 2.0),
    };
    let (b, amps) = (Vector3::new(180.0, -60.0, 430.0), 20.0);
    let now = OnBoardField {
        scale: symmetric(&Vector3::new(1.02, 0.99, 1.0), &Vector3::new(0.01, 0.0, -0.01)),
        offset: Vector3::new(-30.0, 55.0, 12.0),
        current: Vector3::new(0.5, 0.2, -0.3),
    };
    for number in [0.0, 2.0, 9.0] {
        let turn = rotation(number).unwrap();
        // What the vehicle reports, and the raw field behind it.
        let reported = errors.by_field * b + errors.constant + errors.current * amps;
        let raw =
            now.scale.try_inverse().unwrap() * turn.transpose() * reported - now.offset - now.current * amps;
        let new = corrected(&now, &errors, &turn).unwrap();
        let again = turn * new.scale * (raw + new.offset + new.current * amps);
        // The product of two symmetric matrices is not symmetric: what is written is its symmetric part.
        assert!((again - b).norm() < 1.5, "{number}: {again} {b}");
    }
    // By name, through the formulas of the firmware.
    let straight = Errors { by_field: Matrix3::identity(), ..errors };
    let raw = Vector3::new(200.0, 10.0, 400.0);
    let old = OnBoardField { scale: Matrix3::identity(), ..now };
    let new = corrected(&old, &straight, &Matrix3::identity()).unwrap();
    let names = ardupilot_names(1);
    let value = |field: &OnBoardField, name: &str| {
        let at = |names: &[String; 3]| names.iter().position(|n| n == name);
        let px4 = px4_names(0);
        at(&names.offset)
            .map(|k| field.offset[k])
            .or_else(|| at(&names.current).map(|k| field.current[k]))
            .or_else(|| at(&px4.offset).map(|k| -field.offset[k] * 1e-3))
            .or_else(|| at(&px4.current).map(|k| field.current[k]))
            .or_else(|| at(&names.diagonal).map(|_| 1.0))
            .or_else(|| at(&px4.diagonal).map(|_| 1.0))
            .unwrap_or(0.0)
    };
    let change =
        ardupilot(&raw, amps, &|n| value(&new, n), "2") - ardupilot(&raw, amps, &|n| value(&old, n), "2");
    assert!((change + straight.constant + straight.current * amps).norm() < 1e-9, "{change}");
    let id = Matrix3::identity();
    let raw = raw * 1e-3;
    let change = px4(&raw, amps, &|n| value(&new, n), &id) - px4(&raw, amps, &|n| value(&old, n), &id);
    assert!((change * 1e3 + straight.constant + straight.current * amps).norm() < 1e-9, "{change}");
}

#[test]
fn an_orientation_is_undone_by_the_one_proposed() {
    for (old, turned) in [(0_u8, 2_u8), (0, 9), (3, 8), (6, 1), (10, 12)] {
        let fault = rotation(f64::from(turned)).unwrap();
        let board = OnBoard {
            autopilot: Some(Autopilot::ArduPilot),
            parameters: [("COMPASS_ORIENT".to_owned(), f64::from(old)), ("COMPASS_EXTERNAL".to_owned(), 1.0)]
                .into(),
            ..OnBoard::default()
        };
        let mut advice = (Vec::new(), Vec::new());
        orientation(
            0,
            &Orientation { turned: fault, evidence: 99.0, others: Vec::new() },
            &board,
            &mut advice,
        );
        let new = rotation(advice.0[0].proposed).unwrap();
        // The sensor is mounted so that the right orientation is `fault⁻¹ old`.
        let b = Vector3::new(200.0, 30.0, 430.0);
        let raw = rotation(f64::from(old)).unwrap().transpose() * fault * b;
        assert!((new * raw - b).norm() < 1e-9, "{old} {turned}");
    }
}

#[test]
fn compasses_are_found_by_their_priority() {
    let parameters = [("COMPASS_PRIO1_ID", 97.0), ("COMPASS_DEV_ID", 11.0), ("COMPASS_DEV_ID2", 97.0)];
    let parameters = parameters.map(|(n, v)| (n.to_owned(), v)).into();
    let board = OnBoard { parameters, ..OnBoard::default() };
    assert_eq!((ardupilot_place(0, &board), ardupilot_place(2, &board)), (1, 2));
    assert_eq!(ardupilot_names(1).offset[0], "COMPASS_OFS2_X");
    assert_eq!(ardupilot_names(0).current[2], "COMPASS_MOT_Z");
}

/// What a firmware's simulation with 1.76, 4.15 and -1.76 mG/A gave: two of three components are within chance, and without them half of the field
/// of the motors stays.
#[test]
fn a_vector_is_proposed_whole() {
    let mut setting = EffectSetting::unknown(gaware_nav::effects::find("mag_current").unwrap());
    setting.values = vec![1.78 * MGAUSS, 4.15 * MGAUSS, -2.03 * MGAUSS];
    setting.sigmas = vec![0.99 * MGAUSS, 1.17 * MGAUSS, 1.20 * MGAUSS];
    let names = ardupilot_names(0);
    let board = OnBoard {
        parameters: names.current.iter().map(|n| (n.clone(), 0.0)).collect(),
        ..OnBoard::default()
    };
    let proposed = |size: f64| {
        let mut setting = setting.clone();
        setting.values.iter_mut().for_each(|v| *v *= size);
        let finding = CompassFinding { setting, evidence: 274.0, held_out_gain: 9.0, others: vec![] };
        let new = Vector3::new(-1.78, -4.15, 2.03) * size;
        let mut advice = (Vec::new(), Vec::new());
        propose(&finding, &board, &names.current, &new, ("mG/A", MGAUSS, ARDUPILOT_SOURCE), &mut advice);
        advice.0.iter().map(|p| (p.parameter.clone(), p.proposed)).collect::<Vec<_>>()
    };
    let all = [("COMPASS_MOT_X", -1.78), ("COMPASS_MOT_Y", -4.15), ("COMPASS_MOT_Z", 2.03)];
    assert_eq!(proposed(1.0), all.map(|(n, v)| (n.to_owned(), v)));
    // Nothing of it is beyond chance.
    assert!(proposed(0.1).is_empty());
}
