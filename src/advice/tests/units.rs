//! Boards with several inertial units, and what PX4 corrects by itself.

use super::{AXES, finding, on_board};
use crate::advice::on_board::OnBoard;
use crate::advice::{Advice, advise};
use crate::logs::{Item, LogNote};
use gaware_mission::item::Autopilot;
use gaware_nav::sample::{ImuStream, Sample};

/// Increments and raw samples of a log are taken before the low-pass, whose delay is no part of what they show.
#[test]
fn samples_before_the_low_pass_are_not_late_by_it() {
    let proposed = |message: &str| {
        let mut board = on_board(Autopilot::ArduPilot, &[("GPS1_DELAY_MS", 0.0), ("INS_ACCEL_FILTER", 20.0)]);
        let stream = ImuStream { message: message.to_owned(), ..Default::default() };
        board.samples_are(&[Sample::Stream(stream)]);
        advise(&[finding("gps_latency", &[0.14], 1e-3)], &board).proposals[0].proposed.unwrap()
    };
    assert_eq!(["IMU", "IMT[0]", "ACC/GYR[0]"].map(proposed), [151.0, 140.0, 140.0]);
}

/// Every real board has several calibrated units: the message that brings the samples, or the log's device id, says whose parameters count.
#[test]
fn of_several_units_the_one_that_the_samples_are_of_is_corrected() {
    let stream =
        |message: &str| [Sample::Stream(ImuStream { message: message.to_owned(), ..Default::default() })];
    let proposed = |board: &OnBoard| {
        let advice = advise(&[finding("accel_scale_factor", &[0.01, 0.02, 0.0], 1e-4)], board);
        let names: Vec<_> = advice.proposals.iter().map(|p| (p.parameter, p.proposed.is_some())).collect();
        (names, advice)
    };
    let mut values: Vec<(String, f64)> = (0..3)
        .flat_map(|unit| {
            AXES.map(|axis| (format!("CAL_ACC{unit}_{axis}SCALE"), 1.0 + 0.001 * f64::from(unit)))
        })
        .collect();
    values.extend(
        [("CAL_ACC0_ID", 1_310_988.0), ("CAL_ACC1_ID", -1_310_996.0), ("CAL_ACC2_ID", 0.0)]
            .map(|(n, v)| (n.to_owned(), v)),
    );
    values.push(("SENS_BOARD_ROT".to_owned(), 0.0));
    let values: Vec<(&str, f64)> = values.iter().map(|(n, v)| (n.as_str(), *v)).collect();
    let board = on_board(Autopilot::Px4, &values);

    let of_message = |message| {
        let mut board = board.clone();
        board.samples_are(&stream(message));
        proposed(&board)
    };
    let (first, advice) = of_message("SCALED_IMU");
    assert_eq!(first, [("CAL_ACC0_XSCALE", true), ("CAL_ACC0_YSCALE", true)], "{advice:?}");
    assert!(
        advice.notes.iter().any(|n| n.contains("CAL_ACC1_ID") && n.contains("CAL_ACC0_ID 1310988")),
        "{advice:?}"
    );
    let (second, advice) = of_message("SCALED_IMU2");
    assert_eq!(second, [("CAL_ACC1_XSCALE", true), ("CAL_ACC1_YSCALE", true)], "{advice:?}");
    assert!((advice.proposals[0].proposed.unwrap() - 1.001 / 1.01).abs() < 1e-6);
    let (third, advice) = of_message("SCALED_IMU3");
    assert!(third.is_empty() && advice.not_proposed[0].reason.contains("CAL_ACC2_ID is 0"), "{advice:?}");
    // The unit in use, of which the message does not say which one it is.
    let (selected, advice) = of_message("HIGHRES_IMU");
    assert!(
        selected.is_empty() && advice.not_proposed[0].reason.contains("several inertial units"),
        "{advice:?}"
    );
    // A .ulg has the id; ids have 32 bits, their parameters a sign.
    let of_device = |id| {
        let mut board = board.clone();
        board.take(&Item::Note(LogNote::Accelerometer(id)), None);
        board.samples_are(&stream("sensor_combined"));
        (proposed(&board), board)
    };
    assert_eq!(of_device((-1_310_996_i32) as u32).0.0[0].0, "CAL_ACC1_XSCALE");
    let (unknown, advice) = of_device(7).0;
    assert!(unknown.is_empty() && advice.not_proposed[0].reason.contains("accelerometer 7"), "{advice:?}");
    // Two units in turn are none.
    let mut both = of_device(1_310_988).1;
    both.take(&Item::Note(LogNote::Accelerometer(7)), None);
    assert!(proposed(&both).0.is_empty());
    // ArduPilot counts from 1 and leaves the 1 out.
    let mut plane = on_board(Autopilot::ArduPilot, &[("INS_ACC_ID", 5.0), ("INS_ACC2_ID", 6.0)]);
    plane.samples_are(&stream("SCALED_IMU2"));
    assert_eq!(proposed(&plane).0[0].0, "INS_ACC2SCAL_X");
}

/// PX4 takes the share of a scale factor at 1 g into its offset when it is disarmed.
#[test]
fn what_px4_has_committed_by_itself_is_not_corrected_twice() {
    let parameters = |autocal: Option<f64>| {
        let mut board = on_board(
            Autopilot::Px4,
            &[
                ("CAL_ACC0_XSCALE", 1.0),
                ("CAL_ACC0_YSCALE", 1.0),
                ("CAL_ACC0_ZSCALE", 1.0),
                ("CAL_ACC0_ZOFF", -0.11),
                ("SENS_BOARD_ROT", 0.0),
            ],
        );
        autocal.iter().for_each(|v| board.learn("SENS_IMU_AUTOCAL", *v));
        board
    };
    let advice =
        |z: f64, board: &OnBoard| advise(&[finding("accel_scale_factor", &[0.01, 0.01, z], 1e-4)], board);
    let names = |advice: &Advice| advice.proposals.iter().map(|p| p.parameter).collect::<Vec<_>>();
    for autocal in [None, Some(1.0)] {
        let large = advice(0.01, &parameters(autocal));
        assert_eq!(names(&large), ["CAL_ACC0_XSCALE", "CAL_ACC0_YSCALE"], "{large:?}");
        let not = &large.not_proposed[0];
        assert_eq!(not.parameter, Some("CAL_ACC0_ZSCALE"));
        assert!(
            not.reason.contains("correct twice")
                && not.reason.contains("CAL_ACC0_ZOFF")
                && not.reason.contains("-0.11"),
            "{not:?}"
        );
        // Below what it commits nothing was taken over.
        assert_eq!(names(&advice(0.004, &parameters(autocal))).len(), 3);
    }
    assert_eq!(names(&advice(0.01, &parameters(Some(0.0)))).len(), 3);
    // A backup of the time after the flight is not what flew.
    let file = gaware_mission::params::file::ParamFile::read("CAL_ACC0_XOFF,0.2\n").unwrap();
    let mut board = parameters(Some(1.0));
    board.add_file(&file);
    assert!(board.notes().iter().any(|n| n.contains("not those that flew")), "{:?}", board.notes());
}
