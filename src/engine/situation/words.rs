//! What is said in every situation.

use super::*;

const NO_MANEUVER: &str = "No maneuver is proposed until then.";

/// Headline, text and detail.
pub(super) fn of(kind: SituationKind, i: &Inputs<'_>) -> [String; 3] {
    let none = FlightReport::default();
    let flight = i.flight.unwrap_or(&none);
    let say = |headline: &str, text: String, detail: String| [headline.to_owned(), text, detail];
    match kind {
        SituationKind::NoData => no_data_words(),
        SituationKind::Starting => {
            say(crate::engine::events::phase_words(i.phase), i.waiting_for.to_owned(), String::new())
        }
        SituationKind::SeveralVehicles => say(
            "Several vehicles",
            "Several vehicles send on this link".to_owned(),
            format!("{}: choose one (--vehicle). {NO_MANEUVER}", flight.several),
        ),
        SituationKind::WrongAirframe => say(
            "Wrong airframe",
            format!("The vehicle is a {}", kind_words(i.mismatch().unwrap_or_default())),
            format!(
                "The airframe that was chosen (--airframe) is a {}: start again with the right one. {NO_MANEUVER}",
                kind_words(i.airframe.unwrap_or_default())
            ),
        ),
        SituationKind::NoGnss => no_gnss_words(i, flight),
        SituationKind::GnssJump => say(
            "GNSS jump",
            format!("A GNSS position {:.0} m away was rejected", i.jump.map_or(0.0, |(_, m)| m)),
            format!("Which place is right shows within {JUMP_S:.0} s. {NO_MANEUVER}"),
        ),
        SituationKind::PacketLoss => say(
            "Packets are lost",
            format!("{:.0} % of the inertial samples are lost on the link", flight.loss * 100.0),
            format!("Check antenna, baud rate and what else uses the link. {NO_MANEUVER}"),
        ),
        SituationKind::LowRate => low_rate_words(i, flight),
        SituationKind::Inconsistent => say(
            "Estimate inconsistent",
            "The estimate is inconsistent with the fixes".to_owned(),
            format!("Do not use the values below. {NO_MANEUVER}"),
        ),
        _ => flight_words(kind, i, flight),
    }
}

fn no_data_words() -> [String; 3] {
    let Situation { headline, text, detail, .. } = no_data(SILENT_S);
    [headline, text, detail]
}

fn no_gnss_words(i: &Inputs<'_>, flight: &FlightReport) -> [String; 3] {
    let age_s = i.age_of_fixes_s();
    let text = match flight.no_fix {
        true if age_s < FIX_PATIENCE_S => "The GNSS receiver has no 3-D fix".to_owned(),
        true => format!("The GNSS receiver has no 3-D fix for {age_s:.0} s"),
        false => format!("No GNSS fix for {age_s:.0} s"),
    };
    let detail = format!("G cannot be estimated further. {NO_MANEUVER}");
    ["No GNSS".to_owned(), text, detail]
}

fn low_rate_words(i: &Inputs<'_>, flight: &FlightReport) -> [String; 3] {
    let [samples_hz, fixes_hz] = i.rates_hz;
    let [least_hz, least_fixes_hz] = LOW_RATE_HZ;
    let text = if flight.samples_age_s >= SAMPLES_PATIENCE_S {
        format!("No inertial samples for {:.0} s", flight.samples_age_s)
    } else if samples_hz < least_hz {
        format!("Inertial samples arrive at {samples_hz:.0} Hz, {least_hz:.0} Hz are needed")
    } else {
        format!("GNSS fixes arrive at {fixes_hz:.1} Hz, {least_fixes_hz:.1} Hz are needed")
    };
    let detail =
        format!("Another station may have changed the rates, or the link is too slow. {NO_MANEUVER}");
    ["Rate too low".to_owned(), text, detail]
}

/// Of a vehicle whose estimate is good.
fn flight_words(kind: SituationKind, i: &Inputs<'_>, flight: &FlightReport) -> [String; 3] {
    let mode = if flight.mode_name.is_empty() { "its mode" } else { &flight.mode_name };
    let say = |headline: &str, text: String, detail: String| [headline.to_owned(), text, detail];
    let done = if i.done { "Everything that this airframe can excite is known." } else { "" };
    match kind {
        SituationKind::Ground if let Some([text, detail]) = i.by_hand => {
            say("On the ground", text.to_owned(), detail.to_owned())
        }
        SituationKind::Ground => say(
            "On the ground",
            if flight.armed { "Armed, ready for take-off" } else { "Ready for take-off" }.to_owned(),
            match i.airframe {
                Some(_) => "Maneuvers are proposed in flight, while a pilot flies.".to_owned(),
                None => missing_airframe(i, flight),
            },
        ),
        SituationKind::Failsafe if flight.alarm.is_empty() => say(
            "Failsafe",
            format!("The autopilot reports a failsafe; it flies {mode}"),
            "No maneuver is proposed.".to_owned(),
        ),
        SituationKind::Failsafe => say(
            "Alarm",
            format!("The autopilot reports: {}", flight.alarm),
            format!("It flies {mode}. No maneuver is proposed."),
        ),
        SituationKind::Returning => {
            say("Autopilot returns", format!("The vehicle returns ({mode})"), done.to_owned())
        }
        SituationKind::Landing => {
            say("Landing", format!("The vehicle approaches and lands ({mode})"), done.to_owned())
        }
        SituationKind::TakeOff => say("Take-off", format!("The vehicle takes off ({mode})"), String::new()),
        SituationKind::Mission => say(
            "Autopilot flies",
            flight.item.map_or_else(|| "Its mission".to_owned(), |item| format!("Mission item {item}")),
            String::new(),
        ),
        SituationKind::Hold => say(
            "Autopilot flies",
            format!("The autopilot holds or follows orders ({mode})"),
            "Maneuvers are proposed while a pilot flies.".to_owned(),
        ),
        SituationKind::UnknownControl if flight.has_heartbeat => say(
            "Who flies?",
            format!("{mode} is not known to this program"),
            "No maneuver is proposed.".to_owned(),
        ),
        SituationKind::UnknownControl => {
            say("Who flies?", "No heartbeat of the vehicle".to_owned(), "No maneuver is proposed.".to_owned())
        }
        SituationKind::TooLow => say(
            "Pilot flies",
            format!("No maneuver below {:.0} m", i.floor_m),
            "Height above the place of the take-off.".to_owned(),
        ),
        SituationKind::NoAirframe => say(
            "Pilot flies",
            "No maneuver: the airframe is not known".to_owned(),
            missing_airframe(i, flight),
        ),
        SituationKind::Done => done_words(i),
        SituationKind::Maneuver => say("Fly now", i.instruction[0].to_owned(), i.instruction[1].to_owned()),
        _ => say(
            "Monitoring",
            "No maneuver proposed now".to_owned(),
            "Fly on as planned; the next maneuver is being ranked.".to_owned(),
        ),
    }
}

fn done_words(i: &Inputs<'_>) -> [String; 3] {
    let text = match i.mode() {
        _ if i.is_on_ground() => "Landed: evaluate the flight",
        // No one takes over from an autopilot because of this.
        FlightMode::Mission | FlightMode::Hold => "Nothing more to fly: the autopilot may land",
        _ => "Land",
    };
    let (names, open, all) = i.open;
    let shown = match open {
        0 => "All parameters have converged.".to_owned(),
        _ if !i.done => format!("{} of {all} parameters have converged.", all - open),
        _ => format!("{} of {all} parameters have converged; {names} cannot with this airframe.", all - open),
    };
    let detail =
        format!("{shown} Then: gaware report and gaware explain on the recording or the autopilot's log.");
    ["Done".to_owned(), text.to_owned(), detail]
}

/// Which option is missing, with the value that fits what the heartbeat says.
fn missing_airframe(i: &Inputs<'_>, flight: &FlightReport) -> String {
    let start = "No maneuver can be proposed: start again with --airframe";
    match flight.kind.unwrap_or(i.vehicle) {
        VehicleKind::FixedWing => {
            format!("{start} small_fixed_wing or large_fixed_wing, or a file that describes this fixed wing.")
        }
        VehicleKind::Multirotor => format!("{start} quadrotor, or a file that describes this multirotor."),
        VehicleKind::Unknown => format!("{start} and the name or the file of what flies."),
    }
}

fn kind_words(kind: VehicleKind) -> &'static str {
    match kind {
        VehicleKind::FixedWing => "fixed wing",
        VehicleKind::Multirotor => "multirotor",
        VehicleKind::Unknown => "vehicle of unknown kind",
    }
}
