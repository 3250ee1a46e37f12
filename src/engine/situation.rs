//! What may be said to the pilot now: one decision, read by every screen, the telemetry and the log.
//!
//! [`decide`] is a pure function of what the engine knows of its data and of what the vehicle reports of its flight. A maneuver is proposed in one
//! of its results only. What makes an estimate useless comes before everything else, then who flies.

mod words;

use super::snapshot::Phase;
use gaware_nav::observability::words::VehicleKind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Without any frame of the vehicle for so long nothing is known of it, s.
pub const SILENT_S: f64 = 3.0;
/// After so long without a fix the status says so, s.
pub(super) const FIX_PATIENCE_S: f64 = 3.0;
/// Inertial samples that stop for so long are missing, s.
const SAMPLES_PATIENCE_S: f64 = 2.0;
/// From this share of lost samples on the loss is said first. With 5 % lost nothing suffers, with 20 % requests to the vehicle get lost as
/// well (docs/faults.md, `loss-5`, `loss-20`).
pub const LOSS: f64 = 0.1;
/// Below these rates of samples and fixes a maneuver cannot be followed, Hz. Receivers give at least one fix a second.
pub const LOW_RATE_HZ: [f64; 2] = [20.0, 0.7];
/// For so long after a position was rejected as a jump the fixes have to prove themselves, s: as long as the filter takes to accept the new place.
const JUMP_S: f64 = 30.0;
/// A vehicle that stands lower than this above the place where it stood before is on the ground, m.
const GROUND_M: f64 = 3.0;

/// Who flies.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Not reported.
    #[default]
    Unknown,
    /// No one: it is disarmed or has not taken off.
    Ground,
    /// A pilot.
    Pilot,
    /// The autopilot.
    Autopilot,
}

/// What a flight mode means for whoever would fly a maneuver.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FlightMode {
    /// Not reported, or a mode that this program does not know.
    #[default]
    Unknown,
    /// The pilot's sticks decide.
    Pilot,
    /// The autopilot flies its mission.
    Mission,
    /// The autopilot holds a place, circles or follows somebody else's orders.
    Hold,
    /// The autopilot takes off.
    TakeOff,
    /// The autopilot returns.
    Return,
    /// The autopilot lands.
    Landing,
}

/// What the vehicle reports of its flight.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FlightReport {
    /// Whether a heartbeat came.
    pub has_heartbeat: bool,
    /// Whether it is armed.
    pub armed: bool,
    /// Whether it says that it has not taken off or has landed.
    pub on_ground: bool,
    /// Whether it says that it is in the air (`EXTENDED_SYS_STATE`; a heartbeat alone cannot).
    pub in_air: bool,
    /// Whether it has flown since it was armed last.
    pub flown: bool,
    /// What its mode means.
    pub mode: FlightMode,
    /// Its mode by name.
    pub mode_name: String,
    /// Whether it reports a failsafe.
    pub failsafe: bool,
    /// The last severe text of its autopilot, for a while.
    pub alarm: String,
    /// The item of its mission that is current.
    pub item: Option<u16>,
    /// Its kind by its heartbeat.
    pub kind: Option<VehicleKind>,
    /// All vehicles on the link where there are several and none was chosen; empty otherwise.
    pub several: String,
    /// Whether the receiver says that it has no three-dimensional fix.
    pub no_fix: bool,
    /// Share of the inertial samples that were lost on the way, over the last seconds.
    pub loss: f64,
    /// Since the last inertial message, s.
    pub samples_age_s: f64,
}

impl FlightReport {
    /// Who flies.
    pub fn control(&self) -> Control {
        match self.mode {
            _ if !self.has_heartbeat => Control::Unknown,
            _ if !self.armed || self.on_ground => Control::Ground,
            FlightMode::Pilot => Control::Pilot,
            FlightMode::Unknown => Control::Unknown,
            _ => Control::Autopilot,
        }
    }
}

/// What the companion can say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SituationKind {
    /// The estimator does not run yet.
    #[default]
    Starting,
    /// Nothing arrives from the vehicle.
    NoData,
    /// Several vehicles on the link, and none was chosen.
    SeveralVehicles,
    /// The airframe of the options is not the vehicle's.
    WrongAirframe,
    /// No fixes.
    NoGnss,
    /// A position was rejected as a jump.
    GnssJump,
    /// Too many samples are lost on the link.
    PacketLoss,
    /// Samples or fixes come too slowly.
    LowRate,
    /// The estimate is inconsistent with its measurements.
    Inconsistent,
    /// On the ground.
    Ground,
    /// The autopilot reports a failsafe or an alarm.
    Failsafe,
    /// The autopilot returns.
    Returning,
    /// The autopilot approaches and lands.
    Landing,
    /// The autopilot takes off.
    TakeOff,
    /// Everything that the airframe can excite is known, or the flight is over.
    Done,
    /// The autopilot flies its mission.
    Mission,
    /// The autopilot holds, circles or follows orders.
    Hold,
    /// No one reports who flies.
    UnknownControl,
    /// The pilot flies, too low for a maneuver.
    TooLow,
    /// The pilot flies, and the airframe is not known.
    NoAirframe,
    /// The pilot flies, and nothing is proposed now.
    Monitoring,
    /// The pilot is asked to fly a maneuver.
    Maneuver,
}

impl SituationKind {
    /// Whether a maneuver may be proposed.
    pub fn allows_maneuver(self) -> bool {
        matches!(self, Self::Monitoring | Self::Maneuver)
    }

    /// How it looks.
    pub fn level(self) -> Level {
        match self {
            Self::Starting => Level::Wait,
            Self::NoData
            | Self::SeveralVehicles
            | Self::WrongAirframe
            | Self::NoGnss
            | Self::GnssJump
            | Self::PacketLoss
            | Self::LowRate
            | Self::Inconsistent
            | Self::Failsafe => Level::Lost,
            Self::Returning | Self::Landing | Self::TakeOff | Self::Mission | Self::Hold => Level::Auto,
            Self::Done => Level::Done,
            Self::Ground | Self::UnknownControl | Self::TooLow | Self::NoAirframe | Self::Monitoring => {
                Level::Idle
            }
            Self::Maneuver => Level::Fly,
        }
    }
}

/// How a situation looks on a screen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Something is still missing.
    #[default]
    Wait,
    /// Something is wrong.
    Lost,
    /// The autopilot flies.
    Auto,
    /// Nothing to do.
    Idle,
    /// The pilot is asked for something.
    Fly,
    /// Nothing is left to do.
    Done,
}

/// The situation in words, as every screen shows it first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Situation {
    /// Which.
    pub kind: SituationKind,
    /// How it looks.
    pub level: Level,
    /// Who flies.
    pub control: Control,
    /// The vehicle's mode by name; empty where it is not known.
    #[serde(default)]
    pub mode: String,
    /// A few words: "No GNSS", "Autopilot flies".
    pub headline: String,
    /// What it is: a maneuver, a fault, what the autopilot does.
    pub text: String,
    /// What belongs to it: why, and what to do.
    #[serde(default)]
    pub detail: String,
}

/// What the situation follows from.
#[derive(Debug, Clone, Default)]
pub struct Inputs<'a> {
    /// What the estimator is doing, …
    pub phase: Phase,
    /// … and what it waits for, in words.
    pub waiting_for: &'a str,
    /// Since the last fix, s.
    pub fix_age_s: Option<f64>,
    /// Since a position was rejected as a jump, s, and how far it was off, m.
    pub jump: Option<(f64, f64)>,
    /// Rates of samples and fixes, Hz.
    pub rates_hz: [f64; 2],
    /// Whether the estimate is inconsistent with its measurements.
    pub inconsistent: bool,
    /// Whether the vehicle does not move.
    pub stationary: bool,
    /// Height above the place where it stood, m.
    pub height_m: Option<f64>,
    /// Lowest height of maneuvers, m.
    pub floor_m: f64,
    /// What flies by the airframe of the options, where there is one.
    pub airframe: Option<VehicleKind>,
    /// What flies by all that is known.
    pub vehicle: VehicleKind,
    /// Whether everything that the airframe can excite is known.
    pub done: bool,
    /// States that have not converged, of how many.
    pub open: (&'a str, usize, usize),
    /// The maneuver that is asked for and why; empty where there is none.
    pub instruction: [&'a str; 2],
    /// What the ground session asks for, and how far it is; nothing where it asks for nothing.
    pub by_hand: Option<[&'a str; 2]>,
    /// Whether a place on the ground takes the part of the fixes.
    pub without_fixes: bool,
    /// What the vehicle reports; nothing where samples come from no vehicle (a simulation, an autopilot's own log).
    pub flight: Option<&'a FlightReport>,
}

impl Inputs<'_> {
    fn is_wing(&self) -> bool {
        self.airframe.unwrap_or(self.vehicle) == VehicleKind::FixedWing
    }

    /// A wing that does not move is on the ground, a multirotor may hover.
    fn is_on_ground(&self) -> bool {
        let reported = self.flight.is_some_and(|f| f.control() == Control::Ground);
        let low = self.height_m.is_some_and(|h| h < GROUND_M);
        reported
            || self.by_hand.is_some()
            || self.without_fixes
            || (self.stationary && (self.is_wing() || (low && self.flight.is_none())))
    }

    fn mismatch(&self) -> Option<VehicleKind> {
        let real = self.flight?.kind?;
        self.airframe.is_some_and(|a| a != real).then_some(real)
    }

    fn age_of_fixes_s(&self) -> f64 {
        self.fix_age_s.unwrap_or(0.0)
    }

    fn mode(&self) -> FlightMode {
        self.flight.map_or(FlightMode::Pilot, |f| f.mode)
    }
}

/// Which situation it is.
pub fn decide(i: &Inputs<'_>) -> SituationKind {
    if let Some(fault) = fault(i) {
        return fault;
    }
    let flight = i.flight;
    if i.is_on_ground() {
        let evaluate = i.done || flight.is_some_and(|f| f.flown);
        return if evaluate { SituationKind::Done } else { SituationKind::Ground };
    }
    if flight.is_some_and(|f| f.failsafe || !f.alarm.is_empty()) {
        return SituationKind::Failsafe;
    }
    match i.mode() {
        FlightMode::Return => SituationKind::Returning,
        FlightMode::Landing => SituationKind::Landing,
        FlightMode::TakeOff => SituationKind::TakeOff,
        _ if i.done => SituationKind::Done,
        FlightMode::Mission => SituationKind::Mission,
        FlightMode::Hold => SituationKind::Hold,
        FlightMode::Unknown => SituationKind::UnknownControl,
        FlightMode::Pilot if i.airframe.is_none() => SituationKind::NoAirframe,
        FlightMode::Pilot if i.height_m.is_some_and(|h| h < i.floor_m) => SituationKind::TooLow,
        FlightMode::Pilot if i.instruction[0].is_empty() => SituationKind::Monitoring,
        FlightMode::Pilot => SituationKind::Maneuver,
    }
}

/// What makes the estimate useless, or belongs to another vehicle.
fn fault(i: &Inputs<'_>) -> Option<SituationKind> {
    let flight = i.flight;
    let slow = i.rates_hz[0] < LOW_RATE_HZ[0] || (i.rates_hz[1] < LOW_RATE_HZ[1] && !i.without_fixes);
    let lacks_fixes = flight.is_some_and(|f| f.no_fix) || i.age_of_fixes_s() >= FIX_PATIENCE_S;
    Some(if flight.is_some_and(|f| !f.several.is_empty()) {
        SituationKind::SeveralVehicles
    } else if i.mismatch().is_some() {
        SituationKind::WrongAirframe
    } else if i.phase != Phase::Running {
        SituationKind::Starting
    } else if lacks_fixes && !i.without_fixes {
        SituationKind::NoGnss
    } else if i.jump.is_some_and(|(since_s, _)| since_s < JUMP_S) {
        SituationKind::GnssJump
    } else if flight.is_some_and(|f| f.loss >= LOSS) {
        SituationKind::PacketLoss
    } else if slow || flight.is_some_and(|f| f.samples_age_s >= SAMPLES_PATIENCE_S) {
        SituationKind::LowRate
    } else if i.inconsistent {
        SituationKind::Inconsistent
    } else {
        return None;
    })
}

/// The situation in words.
pub fn describe(i: &Inputs<'_>) -> Situation {
    let kind = decide(i);
    let [headline, text, detail] = words::of(kind, i);
    let control = match i.flight.map(FlightReport::control) {
        _ if i.is_on_ground() => Control::Ground,
        Some(control) => control,
        None => Control::Unknown,
    };
    let mode = i.flight.map_or_else(String::new, |f| f.mode_name.clone());
    Situation { kind, level: kind.level(), control, mode, headline, text, detail }
}

/// Nothing arrives any more; only who waits for frames can know.
pub fn no_data(silent_s: f64) -> Situation {
    let kind = SituationKind::NoData;
    Situation {
        kind,
        level: kind.level(),
        headline: "No data".to_owned(),
        text: "No data from the vehicle".to_owned(),
        detail: format!("Nothing for {silent_s:.0} s: everything below is old. Fly by your own instruments."),
        ..Situation::default()
    }
}

#[cfg(test)]
mod tests;
