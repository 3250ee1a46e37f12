//! Unobservable directions in words: which states, and what to fly.

use super::gramian::Gramian;
use crate::filter::layout::StateName;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What flies: the same excitation is flown differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleKind {
    /// Not reported: remedies name the acceleration that is missing and no maneuver.
    #[default]
    Unknown,
    /// An aircraft.
    FixedWing,
    /// A multirotor or helicopter.
    Multirotor,
}

impl VehicleKind {
    /// `fixed_wing`, `multirotor` or `unknown`.
    pub fn word(self) -> &'static str {
        match self {
            Self::FixedWing => "fixed_wing",
            Self::Multirotor => "multirotor",
            Self::Unknown => "unknown",
        }
    }
}

/// One unobservable direction, or several that have the same cause and remedy.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservableGroup {
    /// Weight of each state; 1 for each of several states that are unobservable by themselves.
    pub states: BTreeMap<&'static str, f64>,
    /// Which states, why, and the remedy.
    pub text: String,
}

/// What is missing for a state, in the order in which remedies are named.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Cause {
    Forward,
    Sideways,
    Vertical,
    Turn,
    Rotation,
    Speed,
    Temperature,
    Motion,
}

impl Cause {
    fn of(state: &StateName) -> Self {
        match (state.effect, state.name) {
            ("gyro_g_sensitivity", name) => match name.as_bytes().last() {
                Some(b'1') => Self::Forward,
                Some(b'2') => Self::Sideways,
                _ => Self::Vertical,
            },
            ("accel_bias", "ba_z")
            | ("accel_scale_factor" | "accel_nonlinearity" | "gyro_g2_sensitivity", _) => Self::Vertical,
            ("accel_bias" | "gps_lever_arm", _) => Self::Turn,
            ("gps_latency", _) => Self::Speed,
            ("gyro_scale_factor" | "gyro_misalignment" | "accel_misalignment", _) => Self::Rotation,
            ("gyro_temperature" | "accel_temperature", _) => Self::Temperature,
            _ => Self::Motion,
        }
    }

    fn why(self) -> &'static str {
        match self {
            Self::Forward => "speed has hardly changed",
            Self::Sideways => "the vehicle has hardly been accelerated sideways",
            Self::Vertical => "vertical acceleration has hardly changed",
            Self::Turn => "one heading cannot separate tilt from bias",
            Self::Rotation => "the vehicle has hardly rotated about all axes",
            Self::Speed => "the velocity has hardly changed",
            Self::Temperature => "the temperature has hardly changed",
            Self::Motion => "acceleration and heading have hardly changed",
        }
    }

    fn remedy(self, vehicle: VehicleKind) -> &'static str {
        use VehicleKind::{FixedWing, Multirotor, Unknown};
        match (self, vehicle) {
            (Self::Forward, FixedWing) => "straight and level, throttle full to idle and back",
            (Self::Forward, Multirotor) => "dash forward and brake",
            (Self::Forward, Unknown) => "accelerate and brake along the forward axis",
            (Self::Sideways, FixedWing) => "fly a sideslip",
            (Self::Sideways, Multirotor) => "dash sideways and brake",
            (Self::Sideways, Unknown) => "accelerate along the sideways axis, to both sides",
            (Self::Vertical, FixedWing) => "pull up, or bank beyond 45°",
            (Self::Vertical, Multirotor) => "climb and descend with full thrust changes",
            (Self::Vertical, Unknown) => "change the acceleration along the vertical axis",
            (Self::Turn, _) => "turn onto other headings",
            (Self::Rotation, _) => "roll, pitch and turn to both sides",
            (Self::Speed, _) => "change speed, or turn",
            (Self::Temperature, _) => "let the unit warm up",
            (Self::Motion, _) => "accelerate and turn",
        }
    }
}

/// The unobservable directions of a Gramian whose states have these names.
pub fn describe(gramian: &Gramian, names: &[StateName], vehicle: VehicleKind) -> Vec<UnobservableGroup> {
    let mut alone: BTreeMap<(&str, Cause), Vec<&StateName>> = BTreeMap::new();
    let mut tied = Vec::new();
    for direction in &gramian.unobservable {
        let states: Vec<(&StateName, f64)> =
            direction.weights.iter().filter_map(|(k, w)| Some((names.get(*k)?, *w))).collect();
        match states.as_slice() {
            [] => {}
            [(state, _)] => alone.entry((state.effect, Cause::of(state))).or_default().push(state),
            _ => tied.push(tied_text(&states, vehicle)),
        }
    }
    let mut out: Vec<UnobservableGroup> =
        alone.iter().map(|((effect, cause), states)| alone_text(effect, *cause, states, vehicle)).collect();
    out.extend(tied);
    out
}

fn alone_text(effect: &str, cause: Cause, states: &[&StateName], vehicle: VehicleKind) -> UnobservableGroup {
    let column = match cause {
        Cause::Forward => "column x of G",
        Cause::Sideways => "column y of G",
        _ => "column z of G",
    };
    let who = if effect == "gyro_g_sensitivity" && states.len() == 3 {
        column.to_owned()
    } else {
        listed(states.iter().map(|s| s.name))
    };
    UnobservableGroup {
        states: states.iter().map(|s| (s.name, 1.0)).collect(),
        text: format!("{who}: {}: {}", cause.why(), cause.remedy(vehicle)),
    }
}

fn tied_text(states: &[(&StateName, f64)], vehicle: VehicleKind) -> UnobservableGroup {
    let is_bias = |s: &StateName| s.effect == "gyro_bias" || s.effect == "accel_bias";
    // A bias is known once its partner is: the partner's cause counts.
    let partners: Vec<_> = states.iter().filter(|(s, _)| !is_bias(s)).collect();
    let mut causes: Vec<Cause> = if partners.is_empty() {
        states.iter().map(|(s, _)| Cause::of(s)).collect()
    } else {
        partners.iter().map(|(s, _)| Cause::of(s)).collect()
    };
    causes.sort_unstable();
    causes.dedup();
    let remedies: Vec<_> = causes.iter().map(|c| c.remedy(vehicle)).collect();
    let manner = if states.len() == 2 { "only as a sum" } else { "only in combination" };
    UnobservableGroup {
        states: states.iter().map(|(s, w)| (s.name, *w)).collect(),
        text: format!("{} {manner}: {}", listed(states.iter().map(|(s, _)| s.name)), remedies.join("; ")),
    }
}

/// `a`, `a and b`, `a, b and c`.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    match names.split_last() {
        None => String::new(),
        Some((last, [])) => (*last).to_owned(),
        Some((last, before)) => format!("{} and {last}", before.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::layout::Layout;
    use crate::model::{GElements, Model};
    use crate::observability::gramian::UnobservableDirection;

    fn texts(unobservable: &[&[(&str, f64)]], vehicle: VehicleKind) -> Vec<String> {
        let layout = Layout::new(&Model::default().with_g(GElements::Full, None));
        let names = layout.names();
        let index = |name: &str| names.iter().position(|n| n.name == name).unwrap();
        let unobservable = unobservable
            .iter()
            .map(|d| UnobservableDirection { weights: d.iter().map(|(n, w)| (index(n), *w)).collect() })
            .collect();
        let gramian = Gramian { unobservable, ..Gramian::default() };
        describe(&gramian, names, vehicle).into_iter().map(|d| d.text).collect()
    }

    #[test]
    fn a_dark_column_is_named_as_such_with_its_remedy() {
        let unobservable: [&[_]; 3] = [&[("g12", 1.0)], &[("g22", 1.0)], &[("g32", 1.0)]];
        assert_eq!(
            texts(&unobservable, VehicleKind::FixedWing),
            ["column y of G: the vehicle has hardly been accelerated sideways: fly a sideslip"]
        );
    }

    #[test]
    fn a_tied_pair_asks_for_what_parts_it() {
        let unobservable: [&[_]; 1] = [&[("bg_z", 0.7), ("g33", -0.7)]];
        assert_eq!(
            texts(&unobservable, VehicleKind::FixedWing),
            ["bg_z and g33 only as a sum: pull up, or bank beyond 45°"]
        );
        assert_eq!(
            texts(&unobservable, VehicleKind::Multirotor),
            ["bg_z and g33 only as a sum: climb and descend with full thrust changes"]
        );
    }
}
