use super::SituationKind::*;
use super::*;

fn flown(mode: FlightMode) -> FlightReport {
    FlightReport {
        has_heartbeat: true,
        armed: true,
        mode,
        mode_name: "MODE".to_owned(),
        kind: Some(VehicleKind::FixedWing),
        ..FlightReport::default()
    }
}

/// A fixed wing high in the air, with good data and a maneuver to propose.
fn good(flight: &FlightReport) -> Inputs<'_> {
    Inputs {
        phase: Phase::Running,
        fix_age_s: Some(0.2),
        rates_hz: [50.0, 5.0],
        height_m: Some(80.0),
        floor_m: 40.0,
        airframe: Some(VehicleKind::FixedWing),
        vehicle: VehicleKind::FixedWing,
        instruction: ["Steep turn right", "g33 is known to 300 deg/h/g"],
        open: ("g12", 1, 9),
        flight: Some(flight),
        ..Inputs::default()
    }
}

/// Every reason against a maneuver, alone and with any other: the more urgent one is said, and none lets a maneuver pass.
#[test]
fn one_thing_alone_is_enough_against_a_maneuver_and_the_most_urgent_is_said() {
    type Spoil = (SituationKind, fn(&mut FlightReport), fn(&mut Inputs<'_>));
    fn no_report(_: &mut FlightReport) {}
    fn no_input(_: &mut Inputs<'_>) {}
    let spoils: [Spoil; 19] = [
        (SeveralVehicles, |f| f.several = "system 1, system 2".to_owned(), no_input),
        (WrongAirframe, |f| f.kind = Some(VehicleKind::Multirotor), no_input),
        (Starting, no_report, |i| i.phase = Phase::Aligning),
        (NoGnss, |f| f.no_fix = true, no_input),
        (NoGnss, no_report, |i| i.fix_age_s = Some(3.0)),
        (GnssJump, no_report, |i| i.jump = Some((29.0, 131.0))),
        (PacketLoss, |f| f.loss = 0.3, no_input),
        (LowRate, no_report, |i| i.rates_hz = [12.0, 5.0]),
        (LowRate, |f| f.samples_age_s = 4.0, no_input),
        (Inconsistent, no_report, |i| i.inconsistent = true),
        (Ground, |f| f.armed = false, no_input),
        (Ground, |f| f.on_ground = true, no_input),
        (Ground, no_report, |i| i.stationary = true),
        (Failsafe, |f| f.failsafe = true, no_input),
        (Failsafe, |f| f.alarm = "EKF3 lane switch 1".to_owned(), no_input),
        (Done, no_report, |i| i.done = true),
        (NoAirframe, no_report, |i| i.airframe = None),
        (TooLow, no_report, |i| i.height_m = Some(30.0)),
        (Monitoring, no_report, |i| i.instruction = [""; 2]),
    ];
    let with = |of: &[&Spoil]| {
        let mut flight = flown(FlightMode::Pilot);
        of.iter().for_each(|(_, spoil, _)| spoil(&mut flight));
        let mut inputs = good(&flight);
        of.iter().for_each(|(_, _, spoil)| spoil(&mut inputs));
        (decide(&inputs), describe(&inputs))
    };
    assert_eq!(with(&[]).0, Maneuver);
    for (k, one) in spoils.iter().enumerate() {
        let (kind, said) = with(&[one]);
        assert_eq!(kind, one.0, "{k}");
        assert!(!said.headline.is_empty() && kind != Maneuver, "{said:?}");
        assert!(!said.text.contains("turn right"), "{said:?}");
        for other in &spoils[k..] {
            let (kind, _) = with(&[one, other]);
            // On the ground with everything known the flight is over; without an airframe the vehicle has no other kind.
            let expected = match (one.0, other.0) {
                (Ground, Done) => Done,
                (WrongAirframe, NoAirframe) => NoAirframe,
                (first, _) => first,
            };
            assert_eq!(kind, expected, "{:?} with {:?}", one.0, other.0);
        }
    }
}

#[test]
fn a_maneuver_is_proposed_to_a_pilot_alone() {
    let table = [
        (FlightMode::Pilot, Maneuver, Control::Pilot),
        (FlightMode::Mission, Mission, Control::Autopilot),
        (FlightMode::Hold, Hold, Control::Autopilot),
        (FlightMode::TakeOff, TakeOff, Control::Autopilot),
        (FlightMode::Return, Returning, Control::Autopilot),
        (FlightMode::Landing, Landing, Control::Autopilot),
        (FlightMode::Unknown, UnknownControl, Control::Unknown),
    ];
    for (mode, kind, control) in table {
        let flight = flown(mode);
        let said = describe(&good(&flight));
        assert_eq!((said.kind, said.control), (kind, control), "{mode:?}");
        assert_eq!(said.text.contains("Steep turn"), mode == FlightMode::Pilot, "{said:?}");
        // Who returns or lands is not told that he is done, …
        let done = decide(&Inputs { done: true, ..good(&flight) });
        let ends = matches!(kind, TakeOff | Returning | Landing);
        assert_eq!(done, if ends { kind } else { Done }, "{mode:?}");
        let order = describe(&Inputs { done: true, ..good(&flight) }).text;
        assert_eq!(
            order == "Land",
            matches!(mode, FlightMode::Pilot | FlightMode::Unknown),
            "{mode:?}: {order}"
        );
        // … and who has landed has landed in any mode.
        let landed = FlightReport { on_ground: true, ..flight.clone() };
        assert_eq!(decide(&good(&landed)), Ground, "{mode:?}");
    }
    // After a flight nobody is told to take off, also where the flight has not shown everything.
    let over = FlightReport { armed: false, flown: true, ..flown(FlightMode::Mission) };
    let said = describe(&good(&over));
    assert_eq!((said.kind, said.text.as_str()), (Done, "Landed: evaluate the flight"));
    assert!(
        said.detail.starts_with("8 of 9 parameters have converged. Then: gaware report"),
        "{}",
        said.detail
    );
    let unheard = FlightReport::default();
    assert_eq!(describe(&good(&unheard)).text, "No heartbeat of the vehicle");
}

#[test]
fn a_hovering_multirotor_is_not_on_the_ground_and_a_wing_that_stands_is() {
    let report = FlightReport { kind: Some(VehicleKind::Multirotor), ..flown(FlightMode::Pilot) };
    let rotor = Inputs { airframe: Some(VehicleKind::Multirotor), stationary: true, ..good(&report) };
    assert_eq!(decide(&rotor), Maneuver);
    assert_eq!(decide(&Inputs { flight: None, ..rotor.clone() }), Maneuver);
    assert_eq!(decide(&Inputs { flight: None, height_m: Some(0.5), ..rotor }), Ground);
    let wing = flown(FlightMode::Pilot);
    assert_eq!(decide(&Inputs { stationary: true, ..good(&wing) }), Ground);
}

#[test]
fn the_missing_option_is_named_with_a_value_that_fits_on_the_ground_and_in_the_air() {
    for (kind, named) in [
        (Some(VehicleKind::FixedWing), "--airframe small_fixed_wing"),
        (Some(VehicleKind::Multirotor), "--airframe quadrotor"),
        (None, "--airframe and the name"),
    ] {
        for armed in [false, true] {
            let report = FlightReport { kind, armed, ..flown(FlightMode::Pilot) };
            let inputs = Inputs { airframe: None, vehicle: VehicleKind::Unknown, ..good(&report) };
            let said = describe(&inputs);
            assert!(said.detail.contains(named), "{said:?}");
        }
    }
}
