//! The formulas that are looked for beyond the catalogue: every driver that flights have, up to degree two, on all axes of a sensor; of the specific force
//! the cube too, which the model equation of accelerometers has (IEEE Std 1293-2018).

use super::expression::Expression;
use super::{FORMULA, Target, find};
use crate::effects::Effect;
use crate::identify::flight::Flight;
use crate::math::ln;
use crate::operating::Channel;

/// A driver: its expression, a usual size in SI (RMS about its mean), and whether the accelerometers and the gyros may have it. What the
/// catalogue covers is left to the catalogue.
type Row = (&'static str, f64, [bool; 2]);

const BOTH: [bool; 2] = [true, true];
const GYRO: [bool; 2] = [true, false];
const ACCEL: [bool; 2] = [false, true];

/// Motion: there in every flight. Squares of the specific force of the own axis are in the catalogue, of the other axes not.
const MOTION: [Row; 47] = [
    ("w_x", 0.5, ACCEL),
    ("w_y", 0.3, ACCEL),
    ("w_z", 0.3, ACCEL),
    ("|w_x|", 0.3, BOTH),
    ("|w_y|", 0.2, BOTH),
    ("|w_z|", 0.2, BOTH),
    ("w_x*w_x", 0.2, BOTH),
    ("w_y*w_y", 0.1, BOTH),
    ("w_z*w_z", 0.1, BOTH),
    ("w_x*|w_x|", 0.2, BOTH),
    ("w_y*|w_y|", 0.1, BOTH),
    ("w_z*|w_z|", 0.1, BOTH),
    ("w_x*w_y", 0.1, BOTH),
    ("w_x*w_z", 0.1, BOTH),
    ("w_y*w_z", 0.1, BOTH),
    ("w_x*f_x", 1.5, BOTH),
    ("w_x*f_y", 1.5, BOTH),
    ("w_x*f_z", 5.0, BOTH),
    ("w_y*f_x", 1.0, BOTH),
    ("w_y*f_y", 1.0, BOTH),
    ("w_y*f_z", 3.0, BOTH),
    ("w_z*f_x", 1.0, BOTH),
    ("w_z*f_y", 1.0, BOTH),
    ("w_z*f_z", 3.0, BOTH),
    ("f_x*f_x", 10.0, BOTH),
    ("f_y*f_y", 10.0, BOTH),
    ("f_z*f_z", 100.0, BOTH),
    ("f_x*f_y", 10.0, BOTH),
    ("f_x*f_z", 30.0, BOTH),
    ("f_y*f_z", 30.0, BOTH),
    ("f_x^3", 100.0, ACCEL),
    ("f_y^3", 100.0, ACCEL),
    ("f_z^3", 1000.0, ACCEL),
    ("|f_x|", 3.0, BOTH),
    ("|f_y|", 3.0, BOTH),
    ("wdot_x", 1.0, GYRO),
    ("wdot_y", 1.0, GYRO),
    ("wdot_z", 1.0, GYRO),
    ("dead(w_x,0.3)", 0.3, GYRO),
    ("dead(w_y,0.2)", 0.2, GYRO),
    ("dead(w_z,0.2)", 0.2, GYRO),
    // A dead zone small beside the rates that are flown: what is missing is its half width, whichever way the vehicle turns.
    ("sign(w_x)", 1.0, GYRO),
    ("sign(w_y)", 1.0, GYRO),
    ("sign(w_z)", 1.0, GYRO),
    ("speed*speed", 400.0, BOTH),
    ("time", 100.0, BOTH),
    ("time*time", 1e4, BOTH),
];

/// Where the samples have a temperature.
const TEMPERATURE: [Row; 7] = [
    ("temperature*temperature", 100.0, BOTH),
    ("lag(temperature,10)", 10.0, BOTH),
    ("lag(temperature,30)", 10.0, BOTH),
    ("lag(temperature,100)", 10.0, BOTH),
    ("lag(temperature,300)", 10.0, BOTH),
    ("temperature-lag(temperature,30)", 3.0, BOTH),
    ("temperature-lag(temperature,100)", 5.0, BOTH),
];

/// Where the log reports them: the channel that must vary, by at least so much.
const OPERATING: [(Channel, f64, Row); 9] = [
    (Channel::Throttle, 0.1, ("throttle", 0.3, BOTH)),
    (Channel::Throttle, 0.1, ("throttle*throttle", 0.3, BOTH)),
    (Channel::Throttle, 0.1, ("above(throttle,0.05)", 0.3, BOTH)),
    (Channel::Current, 1.0, ("current", 10.0, BOTH)),
    (Channel::Current, 1.0, ("current*current", 200.0, BOTH)),
    (Channel::Voltage, 0.2, ("voltage", 5.0, BOTH)),
    (Channel::Airspeed, 2.0, ("airspeed", 10.0, BOTH)),
    (Channel::Airspeed, 2.0, ("dynamic_pressure", 200.0, BOTH)),
    (Channel::Airspeed, 2.0, ("airspeed*throttle", 5.0, BOTH)),
];
/// Of fixes, on the position and on the velocity: what the catalogue covers (a delay, an antenna off the unit, a receiver that smooths) is left to it.
const FIXES: [(&str, f64, [bool; 2]); 12] = [
    ("heading", 1.0, BOTH),
    ("sin(heading)", 0.7, BOTH),
    ("cos(heading)", 0.7, BOTH),
    ("sin(2*heading)", 0.7, BOTH),
    ("cos(2*heading)", 0.7, BOTH),
    ("height", 30.0, BOTH),
    ("height*height", 3000.0, BOTH),
    ("speed", 4.0, BOTH),
    ("speed*speed", 400.0, BOTH),
    ("f_z", 3.0, BOTH),
    ("|w_z|", 0.2, BOTH),
    ("time", 100.0, [false, true]),
];

/// Of fixes, where the log reports them.
const FIXES_OPERATING: [(Channel, f64, &str); 2] =
    [(Channel::Throttle, 0.1, "throttle"), (Channel::Current, 1.0, "current")];

/// An output must vary by at least this share of its range.
const OUTPUT_VARIES: f64 = 0.05;
const OUTPUT_TYPICAL: f64 = 0.3;

/// Formulas that flights may have at most, sensors and fixes: what a formula pays for being one of so many.
const COUNT: f64 = 169.0;

/// Of the effects that flights miss, one in so many is outside the catalogue. Without this price a formula that imitates a name (`w_y*f_z` in flight at
/// 1 g a scale factor) took its place on one of four flights.
const OUTSIDE: f64 = 10.0;

/// What a formula pays for the size of the grammar, nats.
pub fn cost() -> f64 {
    ln(COUNT * OUTSIDE)
}

fn rows() -> impl Iterator<Item = Row> {
    let operating = OPERATING.iter().map(|o| o.2);
    MOTION.into_iter().chain(TEMPERATURE).chain(operating).chain(FIXES)
}

/// All drivers but outputs and modes.
#[cfg(test)]
pub(super) fn drivers() -> impl Iterator<Item = &'static str> {
    rows().map(|row| row.0)
}

/// A usual size of a driver, in SI.
pub fn typical(driver: &Expression) -> f64 {
    let name = driver.text();
    rows()
        .find(|row| row.0 == name)
        .map_or(if name.starts_with("motor_") { OUTPUT_TYPICAL } else { 1.0 }, |row| row.1)
}

/// What usually causes that a target goes with this driver.
pub fn cause(target: Target, driver: &Expression) -> &'static str {
    let has = |part: &str| driver.text().contains(part);
    if target.is_of_fix() {
        return if target.turns_with(driver) {
            "a place of the antenna that is corrected twice, or in the position or the velocity alone, or reflections that turn with the vehicle"
        } else if has("heading") {
            "reflections that turn with the vehicle, an antenna whose pattern is not even, or a map of another datum or grid"
        } else if has("current") || has("throttle") {
            "interference of motors or speed controllers with the receiver"
        } else if has("height") {
            "a height of another model of the Earth, or an atmosphere that the receiver's model does not have"
        } else {
            "a receiver whose tracking gives way under the motion, or a filter in it"
        };
    }
    if has("current") || has("motor") || has("throttle") {
        "magnetic or supply coupling of motors and speed controllers into the inertial unit, or a board that bends with their thrust or heat"
    } else if has("voltage") {
        "a sensor supply that follows the battery"
    } else if has("temperature") {
        "a sensor that is warmer or colder than the thermometer beside it: the board lags, or heats itself"
    } else if has("airspeed") || has("dynamic_pressure") || has("speed") {
        "air loads that bend the airframe between inertial unit and the rest, or a mounting that gives way with them"
    } else if has("mode") {
        "something that is switched with the flight mode"
    } else if has("sign") {
        "a sensor that does not answer to small rates (a dead zone), or integers that were truncated on the way"
    } else if has("time") {
        "warming up or settling since power-on"
    } else if has("wdot") {
        "a delay between sensor and time stamp, or a mounting that twists"
    } else {
        "a response of the sensor of higher order, or a mounting that gives way under load"
    }
}

/// The formulas that flights may show.
pub fn formulas(flights: &[&Flight]) -> Vec<&'static dyn Effect> {
    let varies = |channel, by: f64| {
        flights.iter().any(|f| f.operating().range(channel).is_some_and(|(low, high)| high - low > by))
    };
    let mut drivers: Vec<(String, [bool; 2])> =
        MOTION.iter().map(|(name, _, on)| ((*name).to_owned(), *on)).collect();
    if flights.iter().any(|f| f.has_temperature()) {
        drivers.extend(TEMPERATURE.iter().map(|(name, _, on)| ((*name).to_owned(), *on)));
    }
    drivers.extend(
        OPERATING.iter().filter(|o| varies(o.0, o.1)).map(|(_, _, (name, _, on))| ((*name).to_owned(), *on)),
    );
    let outputs = Channel::all().filter(|c| matches!(c, Channel::Motor(_)) && varies(*c, OUTPUT_VARIES));
    drivers.extend(outputs.map(|c| (c.name().to_owned(), BOTH)));
    drivers.extend(modes(flights).into_iter().map(|mode| (format!("is(mode,{mode})"), BOTH)));
    let reported = FIXES_OPERATING.iter().filter(|o| varies(o.0, o.1)).map(|o| (o.2, BOTH));
    let of_fixes = FIXES.iter().map(|(name, _, on)| (*name, *on)).chain(reported);
    let of_fixes: Vec<(String, [bool; 2])> = of_fixes.map(|(name, on)| (name.to_owned(), on)).collect();
    let sensors = names(&drivers, [Target::Gyro, Target::Accel]);
    let fixes = names(&of_fixes, [Target::Position, Target::Velocity]);
    sensors.chain(fixes).filter_map(|name| find(&name)).collect()
}

/// Names of the formulas with these drivers, of the one target and then of the other.
fn names(drivers: &[(String, [bool; 2])], targets: [Target; 2]) -> impl Iterator<Item = String> {
    let of = move |(k, target): (usize, Target)| {
        let own = drivers.iter().filter(move |d| d.1[k]);
        own.map(move |d| format!("{FORMULA}{}~{}", target.name(), d.0))
    };
    targets.into_iter().enumerate().flat_map(of)
}

/// Flight modes that were flown for a part of the time, of at most so many.
fn modes(flights: &[&Flight]) -> Vec<u32> {
    const MOST: usize = 4;
    const SHARE: (f64, f64) = (0.1, 0.9);
    let mut seconds: std::collections::BTreeMap<u32, f64> = std::collections::BTreeMap::new();
    for flight in flights {
        for (mode, share) in flight.operating().modes() {
            *seconds.entry(mode).or_default() += share / flights.len() as f64;
        }
    }
    let within = seconds.into_iter().filter(|(_, share)| (SHARE.0..=SHARE.1).contains(share));
    within.map(|(mode, _)| mode).take(MOST).collect()
}
