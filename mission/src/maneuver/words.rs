//! Maneuvers in a pilot's words: one line for `STATUSTEXT` (at most 50 characters of ASCII) and a sentence for screens.

use super::{Maneuver, Side};
use crate::airframe::Airframe;

/// An instruction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Words {
    /// At most 50 characters of ASCII.
    pub short: String,
    /// For screens.
    pub long: String,
    /// What it is good for.
    pub purpose: &'static str,
}

pub(super) fn of(maneuver: Maneuver, airframe: &Airframe) -> Words {
    let seconds = maneuver.duration_s(airframe).round();
    let (short, long) = if airframe.is_fixed_wing() {
        wing(maneuver, airframe, seconds)
    } else {
        rotor(maneuver, airframe, seconds)
    };
    Words { short, long, purpose: purpose(maneuver) }
}

fn side(side: Side) -> &'static str {
    match side {
        Side::Left => "left",
        Side::Right => "right",
    }
}

fn purpose(maneuver: Maneuver) -> &'static str {
    match maneuver {
        Maneuver::VaryingSpeed => "column x of G, accelerometer bias and tilt",
        Maneuver::SteadyTurn(_) => "heading, gyro scale, column z of G",
        Maneuver::Climb | Maneuver::Descent => "columns x and z of G, tilt",
        Maneuver::PullUp => "column z of G apart from the gyro bias",
        Maneuver::FigureEight => "heading, gyro scale in both directions, column z of G",
        Maneuver::Spiral(_) => "columns x and z of G, heading",
        Maneuver::PaperSequence => "attitude, biases and the diagonal of G",
        Maneuver::CrabLegs => "columns x and y of G",
        Maneuver::Sideslip => "column y of G, unobservable in coordinated flight",
        Maneuver::TwoSpeedCircles => "wind, scale of the airspeed, static port, compass on all headings",
        Maneuver::YawTurns => "compass on all headings without flow",
        Maneuver::HoverSteps => "propeller wash and motor current without flow",
    }
}

fn wing(maneuver: Maneuver, airframe: &Airframe, seconds: f64) -> (String, String) {
    let bank = airframe.steep_bank_rad().to_degrees().round();
    match maneuver {
        Maneuver::VaryingSpeed => (
            format!("Straight: throttle full-idle twice, {seconds} s"),
            format!("Straight and level, throttle full to idle and back, twice, {seconds} s."),
        ),
        Maneuver::SteadyTurn(s) => (
            format!("Steep turn {}, {bank} deg bank, one circle", side(s)),
            format!("Steep turn {}, {bank}° bank, one circle, height constant, {seconds} s.", side(s)),
        ),
        Maneuver::Climb => (
            format!("Wings level, full climb, {seconds} s"),
            format!("Wings level: pull into the steepest climb, hold it, push over to level, {seconds} s."),
        ),
        Maneuver::Descent => (
            format!("Wings level, descend, {seconds} s"),
            format!("Wings level: push into a descent with idle throttle, then pull out, {seconds} s."),
        ),
        Maneuver::PullUp => (
            "Wings level, pull up and push over, 3 times".to_owned(),
            format!("Wings level: pull up briskly, push over, three times, {seconds} s."),
        ),
        Maneuver::FigureEight => (
            format!("Figure eight, {bank} deg bank, right then left"),
            format!("Figure eight with {bank}° bank: one circle right, one circle left, {seconds} s."),
        ),
        Maneuver::Spiral(s) => (
            format!("Spiral {}, {bank} deg bank: climb, then descend", side(s)),
            format!(
                "Steep spiral {}, {bank}° bank: one circle at full climb, one in the descent, {seconds} s.",
                side(s)
            ),
        ),
        Maneuver::PaperSequence => (
            format!("Speed up, turn right, slow down, climb, {seconds} s"),
            format!(
                "Straight with changing throttle, steady turn right, slow down, climb straight, {seconds} s."
            ),
        ),
        Maneuver::Sideslip => (
            "MANUAL: level, full rudder left then right".to_owned(),
            format!(
                "Wings near level, full rudder left then right, heading held with bank, {seconds} s: needed for the \
                 y column of G; autopilots do not fly this."
            ),
        ),
        Maneuver::TwoSpeedCircles => (
            format!("Circle right, left: slow, then fast, {seconds} s"),
            format!("One gentle circle right and one left, slow, and both again fast, {seconds} s."),
        ),
        Maneuver::CrabLegs | Maneuver::YawTurns | Maneuver::HoverSteps => {
            ("Not for fixed wings".to_owned(), "This is for multirotors.".to_owned())
        }
    }
}

fn rotor(maneuver: Maneuver, airframe: &Airframe, seconds: f64) -> (String, String) {
    let speed = airframe.speed_max_m_per_s.round();
    match maneuver {
        Maneuver::VaryingSpeed => (
            format!("Dash forward and back at {speed} m/s, {seconds} s"),
            format!(
                "Nose held: full speed forward to {speed} m/s, stop, full speed back, twice, {seconds} s."
            ),
        ),
        Maneuver::SteadyTurn(s) => (
            format!("Fast circle {}, nose ahead, {seconds} s", side(s)),
            format!("Fast circle to the {}, nose along the path, {seconds} s.", side(s)),
        ),
        Maneuver::Climb => (
            format!("Climb at full rate, {seconds} s"),
            format!("Climb at full rate and stop briskly, {seconds} s."),
        ),
        Maneuver::Descent => (
            format!("Descend at full rate, {seconds} s"),
            format!("Descend at full rate and stop briskly, {seconds} s."),
        ),
        Maneuver::PullUp => (
            "Full climb, full descent, 3 times".to_owned(),
            format!("Full climb and full descent in turns, three times, {seconds} s."),
        ),
        Maneuver::FigureEight => (
            format!("Fast figure eight, nose ahead, {seconds} s"),
            format!("Fast figure eight, nose along the path, {seconds} s."),
        ),
        Maneuver::PaperSequence => (
            format!("Dash, circle right, brake, climb, {seconds} s"),
            format!("Dash with changing speed, circle right, brake, climb, {seconds} s."),
        ),
        Maneuver::CrabLegs => (
            format!("Nose held: dash fwd, side, diagonal, {seconds} s"),
            format!(
                "Hold the nose and dash forward, back, right, left and diagonally at {speed} m/s, {seconds} s."
            ),
        ),
        Maneuver::TwoSpeedCircles => (
            format!("Circle right, left: slow, then fast, {seconds} s"),
            format!(
                "One circle right and one left, nose along the path, slow, and both again fast, {seconds} s."
            ),
        ),
        Maneuver::YawTurns => (
            format!("Hover: turn right 360 deg, then left, {seconds} s"),
            format!("Hover, turn the nose right through a full turn, then left, {seconds} s."),
        ),
        Maneuver::HoverSteps => (
            format!("Hover: straight up, straight down, twice, {seconds} s"),
            format!("Hover over one place: full climb, full descent, twice, {seconds} s."),
        ),
        Maneuver::Sideslip | Maneuver::Spiral(_) => {
            ("Not for multirotors".to_owned(), "Fly crab legs instead.".to_owned())
        }
    }
}
