//! The cases: what is flown, what goes wrong, and where the errors are looked at.

use super::EnduranceError;
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::multirotor::Multirotor;
use gaware_sitl::trajectory::{Flown, Scripted};
use gaware_sitl::truth::Trajectory;

/// Rate of the inertial samples, Hz: slow enough for hours, fast enough for these maneuvers.
pub(super) const IMU_RATE_HZ: f64 = 50.0;
/// Vehicles are at rest until here before the first maneuver, s.
const AT_REST_S: f64 = 5.0;
/// Straight and level at 22 m/s in the fixed-wing flight, s.
const CRUISE_AT_S: f64 = 58.0;
/// In a turn at 40° of bank there, s.
const TURN_AT_S: f64 = 88.0;
/// Straight and level there, after all maneuvers, s.
const FLOWN_AT_S: f64 = 297.0;

/// What goes wrong in a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Fault {
    None,
    /// No fixes: from, to, s.
    Outage(f64, f64),
    /// No inertial samples from here for so long, every 30 s; fixes at this rate, Hz.
    Dropouts {
        from_s: f64,
        length_s: f64,
        fix_rate_hz: f64,
    },
    /// Positions lie this far north from here until there, s.
    Jump {
        from_s: f64,
        to_s: f64,
        north_m: f64,
    },
}

/// One long flight.
pub(super) struct Case {
    pub(super) name: String,
    pub(super) trajectory: Flown,
    pub(super) fault: Fault,
    pub(super) truncated: bool,
    pub(super) hint: bool,
    /// Where the errors are looked at: name and time, s.
    pub(super) checkpoints: Vec<(&'static str, f64)>,
}

fn stand_names() -> [(&'static str, f64); 5] {
    [("5min", 300.0), ("15min", 900.0), ("30min", 1800.0), ("60min", 3600.0), ("180min", 10800.0)]
}

/// Names of all cases with what builds them; building integrates the whole path.
fn registry() -> Vec<(String, Box<dyn Fn() -> Case>)> {
    let mut all: Vec<(String, Box<dyn Fn() -> Case>)> = Vec::new();
    let mut add = |name: String, build: Box<dyn Fn(String) -> Case>| {
        let own = name.clone();
        all.push((name, Box::new(move || build(own.clone()))));
    };
    for rotor in [false, true] {
        for truncated in [true, false] {
            let kind = kind(rotor, truncated);
            for (length, stand_s) in stand_names() {
                add(
                    format!("stand-{length}-{kind}"),
                    Box::new(move |name| standing(name, rotor, truncated, stand_s, true)),
                );
            }
            add(format!("landings-{kind}"), Box::new(move |name| landings(name, rotor, truncated)));
            if !rotor {
                for (length, dull_s) in [("15min", 900.0), ("3h", 10800.0)] {
                    for (what, at_s) in [("cruise", CRUISE_AT_S), ("turn", TURN_AT_S), ("after", FLOWN_AT_S)]
                    {
                        add(
                            format!("{what}-{length}-{kind}"),
                            Box::new(move |name| dull(name, truncated, at_s, dull_s)),
                        );
                    }
                }
            }
        }
    }
    add("nohint-15min-wing-raw".into(), Box::new(|name| standing(name, false, true, 900.0, false)));
    for (length, outage_s) in [("10min", 600.0), ("1h", 3600.0), ("3h", 10800.0)] {
        add(format!("outage-{length}-wing-raw"), Box::new(move |name| outage(name, outage_s)));
    }
    for length_s in [0.3, 1.0, 5.0, 20.0] {
        for fix_rate_hz in [1.0, 5.0, 10.0] {
            add(
                format!("dropout-{length_s}s-{fix_rate_hz}hz-wing-raw"),
                Box::new(move |name| dropouts(name, length_s, fix_rate_hz)),
            );
        }
    }
    for (length, to_s) in [("10s", 210.0), ("lasting", f64::INFINITY)] {
        for north_m in [55.0, 500.0] {
            add(
                format!("jump-{north_m}m-{length}-wing-raw"),
                Box::new(move |name| jump(name, north_m, to_s)),
            );
        }
    }
    all
}

fn kind(rotor: bool, truncated: bool) -> String {
    let (what, source) = (if rotor { "rotor" } else { "wing" }, if truncated { "raw" } else { "highres" });
    format!("{what}-{source}")
}

fn path(
    rotor: bool,
    wing: impl FnOnce(FixedWing) -> FixedWing,
    rotors: impl FnOnce(Multirotor) -> Multirotor,
) -> Flown {
    const STEP_S: f64 = 1.0 / IMU_RATE_HZ;
    if rotor {
        Flown::with_step(rotors(Multirotor::new()), STEP_S)
    } else {
        Flown::with_step(wing(FixedWing::new(true)), STEP_S)
    }
}

fn case(name: String, trajectory: Flown, truncated: bool, checkpoints: Vec<(&'static str, f64)>) -> Case {
    Case { name, trajectory, fault: Fault::None, truncated, hint: true, checkpoints }
}

fn standing(name: String, rotor: bool, truncated: bool, stand_s: f64, hint: bool) -> Case {
    let trajectory = path(rotor, |w| w.paused(AT_REST_S, stand_s), |r| r.paused(AT_REST_S, stand_s));
    let end = trajectory.duration_s();
    let checkpoints = vec![("1 min", 62.0), ("standing", AT_REST_S + stand_s), ("flight", end - 1.0)];
    Case { hint, ..case(name, trajectory, truncated, checkpoints) }
}

fn landings(name: String, rotor: bool, truncated: bool) -> Case {
    const STAND_S: f64 = 300.0;
    let trajectory = path(
        rotor,
        |w| w.landed().paused(AT_REST_S, STAND_S).repeated(3),
        |r| r.paused(AT_REST_S, STAND_S).repeated(3),
    );
    let once = trajectory.duration_s() / 3.0;
    let mut checkpoints = Vec::new();
    for (k, (stood, flown)) in
        [("standing 1", "flight 1"), ("standing 2", "flight 2"), ("standing 3", "flight 3")]
            .into_iter()
            .enumerate()
    {
        let from = k as f64 * once;
        checkpoints.push((stood, from + AT_REST_S + STAND_S));
        checkpoints.push((flown, from + once - if rotor { 12.0 } else { 45.0 }));
    }
    case(name, trajectory, truncated, checkpoints)
}

/// A minute on the ground, take-off, then nothing new for hours, then the rest of the flight.
fn dull(name: String, truncated: bool, at_s: f64, dull_s: f64) -> Case {
    const GROUND_S: f64 = 60.0;
    let trajectory = path(false, |w| w.paused(at_s, dull_s).paused(AT_REST_S, GROUND_S), |r| r);
    let end = trajectory.duration_s();
    let from = at_s + GROUND_S;
    let checkpoints = vec![("before", from), ("dull", from + dull_s), ("flight", end - 1.0)];
    case(name, trajectory, truncated, checkpoints)
}

/// The whole flight, GNSS gone in cruise, and the flight's second part again with fixes.
fn outage(name: String, outage_s: f64) -> Case {
    let trajectory = path(false, |w| w.landed().repeated(2).paused(340.0 + CRUISE_AT_S, outage_s), |r| r);
    let (from, end) = (340.0 + CRUISE_AT_S, trajectory.duration_s());
    let to = from + outage_s;
    let checkpoints = vec![("before", from), ("1 min after", to + 60.0), ("flight", end - 45.0)];
    Case { fault: Fault::Outage(from, to), ..case(name, trajectory, true, checkpoints) }
}

fn dropouts(name: String, length_s: f64, fix_rate_hz: f64) -> Case {
    let trajectory = path(false, |w| w, |r| r);
    let checkpoints = vec![("after 130 s", 129.0), ("flight", 299.0)];
    let fault = Fault::Dropouts { from_s: 60.0, length_s, fix_rate_hz };
    Case { fault, ..case(name, trajectory, true, checkpoints) }
}

fn jump(name: String, north_m: f64, to_s: f64) -> Case {
    let trajectory = path(false, |w| w, |r| r);
    let checkpoints = vec![("before", 199.0), ("10 s later", 209.5), ("flight", 299.0)];
    Case { fault: Fault::Jump { from_s: 200.0, to_s, north_m }, ..case(name, trajectory, true, checkpoints) }
}

/// Name of a case, and what builds it.
pub(super) type Builder = (String, Box<dyn Fn() -> Case>);

/// The cases whose name contains one of these; all without any.
pub(super) fn chosen(asked: &[String]) -> Result<Vec<Builder>, EnduranceError> {
    let all = registry();
    let known = || all.iter().map(|c| c.0.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(wrong) = asked.iter().find(|a| !all.iter().any(|c| c.0.contains(a.as_str()))) {
        return Err(EnduranceError::NoCase { asked: wrong.clone(), known: known() });
    }
    Ok(all
        .into_iter()
        .filter(|c| asked.is_empty() || asked.iter().any(|a| c.0.contains(a.as_str())))
        .collect())
}
