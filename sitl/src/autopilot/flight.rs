//! What the autopilot makes of its vehicle: arming, modes, mission items, and how all that looks on the wire.

use super::mission::Cursor;
use super::{Autopilot, Flavour, feasibility};
use crate::air::WindTrack;
use crate::scenario::Airframe;
use crate::truth::{Trajectory, Truth};
use crate::vehicle::{Mode, PilotEvent, Vehicle};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;

/// PX4 judges a mission this long after its acknowledgement, s.
const JUDGE_AFTER_S: f64 = 0.3;
/// `MAV_CMD_NAV_LAST`: commands up to it are flown (`AP_Mission::is_nav_cmd`).
const LAST_NAV_COMMAND: u32 = 95;
/// Higher than this above its place at the start, m, or faster than this, m/s, it flies.
const STANDS_M: f64 = 1.0;
const TAXIES_M_PER_S: f64 = 3.0;

/// What carries the sensors.
pub(super) enum Body {
    /// An analytic flight; missions can be stored but are not flown.
    Analytic(Box<dyn Trajectory>, Vec<MISSION_ITEM_INT_DATA>),
    /// A vehicle that flies what is uploaded.
    Vehicle(Box<Vehicle>),
}

impl Body {
    pub(super) fn truth_at(&mut self, t_s: f64) -> Truth {
        match self {
            Self::Analytic(trajectory, _) => trajectory.truth_at(t_s),
            Self::Vehicle(vehicle) => vehicle.truth_at(t_s),
        }
    }

    /// The wind at this truth, where it is not that of the sensors.
    pub(super) fn wind(&self, truth: &Truth) -> Option<WindTrack> {
        let Self::Vehicle(vehicle) = self else { return None };
        let air = vehicle.air_velocity(truth);
        Some(WindTrack { mean_n_e: [air.x, air.y], gusts: (0.0, 1.0), ..WindTrack::default() })
    }

    /// Height at which it stands at the start, m.
    pub(super) fn start_height_m(&mut self) -> f64 {
        match self {
            Self::Analytic(trajectory, _) => trajectory.truth_at(0.0).place.height_m,
            Self::Vehicle(vehicle) => vehicle.start().height_m,
        }
    }

    pub(super) fn duration_s(&self) -> f64 {
        match self {
            Self::Analytic(trajectory, _) => trajectory.duration_s(),
            Self::Vehicle(_) => f64::INFINITY,
        }
    }

    pub(super) fn items_mut(&mut self) -> &mut Vec<MISSION_ITEM_INT_DATA> {
        match self {
            Self::Analytic(_, items) => items,
            Self::Vehicle(vehicle) => vehicle.items_mut(),
        }
    }

    pub(super) fn items(&self) -> &[MISSION_ITEM_INT_DATA] {
        match self {
            Self::Analytic(_, items) => items,
            Self::Vehicle(vehicle) => vehicle.items(),
        }
    }

    fn vehicle(&self) -> Option<&Vehicle> {
        match self {
            Self::Analytic(..) => None,
            Self::Vehicle(vehicle) => Some(vehicle),
        }
    }

    fn vehicle_mut(&mut self) -> Option<&mut Vehicle> {
        match self {
            Self::Analytic(..) => None,
            Self::Vehicle(vehicle) => Some(vehicle),
        }
    }
}

/// Modes with their numbers: ArduPlane, ArduCopter, PX4 (main mode, sub mode).
const MODES: &[(Mode, u32, u32, [u8; 2])] = &[
    (Mode::Manual, 0, 0, [1, 0]),
    (Mode::Auto, 10, 3, [4, 4]),
    (Mode::Loiter, 12, 5, [4, 3]),
    (Mode::Rtl, 11, 6, [4, 5]),
    (Mode::Land, u32::MAX, 9, [4, 6]),
];

impl Autopilot {
    /// The vehicle, where there is one that flies missions.
    pub fn vehicle(&self) -> Option<&Vehicle> {
        self.body.vehicle()
    }

    /// Whether a vehicle that flies missions has flown and stands again.
    pub fn has_landed(&self) -> bool {
        self.vehicle().is_some_and(Vehicle::has_landed)
    }

    /// The mission on board, by sequence number.
    pub fn mission(&self) -> &[MISSION_ITEM_INT_DATA] {
        self.body.items()
    }

    /// The geofence on board: polygon corners and circles as items.
    pub fn fence(&self) -> &[MISSION_ITEM_INT_DATA] {
        self.mission.fence()
    }

    /// The rally points on board.
    pub fn rally_points(&self) -> &[MISSION_ITEM_INT_DATA] {
        self.mission.rally_points()
    }

    /// ArduPilot's parameter `FENCE_TOTAL`.
    pub fn fence_total(&self) -> usize {
        self.mission.fence_total()
    }

    pub(super) fn is_armed(&self) -> bool {
        self.vehicle().map_or(!self.is_waiting() && !self.config.by_hand, Vehicle::is_armed)
    }

    /// Whether it flies, as ArduPilot's heartbeat says it (`is_flying` of ArduPlane, `land_complete` of ArduCopter).
    pub(super) fn is_airborne(&mut self) -> bool {
        let truth = self.truth();
        let above_m = (truth.place.height_m - self.body.start_height_m()).abs();
        self.is_armed() && (above_m > STANDS_M || truth.v_n.norm() > TAXIES_M_PER_S)
    }

    pub(super) fn custom_mode(&self) -> u32 {
        let mode = self.vehicle().map_or(Mode::Manual, Vehicle::mode);
        let Some((_, plane, copter, [main, sub])) = MODES.iter().find(|(m, ..)| *m == mode) else { return 0 };
        match (self.config.flavour, self.config.airframe) {
            (Flavour::Px4, _) => u32::from(*main) << 16 | u32::from(*sub) << 24,
            (Flavour::ArduPilot, Airframe::FixedWing) => *plane,
            (Flavour::ArduPilot, Airframe::Multirotor) => *copter,
        }
    }

    /// `SET_MODE`, `MAV_CMD_DO_SET_MODE`: the custom mode as it stands in a heartbeat.
    pub(super) fn set_custom_mode(&mut self, custom: u32) -> MavResult {
        let (flavour, airframe) = (self.config.flavour, self.config.airframe);
        let mode = MODES.iter().find(|(_, plane, copter, [main, sub])| match (flavour, airframe) {
            (Flavour::Px4, _) => custom == u32::from(*main) << 16 | u32::from(*sub) << 24,
            (Flavour::ArduPilot, Airframe::FixedWing) => custom == *plane,
            (Flavour::ArduPilot, Airframe::Multirotor) => custom == *copter,
        });
        let rejected = self.mission_rejected;
        let Some(vehicle) = self.body.vehicle_mut() else { return MavResult::MAV_RESULT_UNSUPPORTED };
        match mode {
            Some((Mode::Auto, ..)) if rejected => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            None => MavResult::MAV_RESULT_DENIED,
            Some((mode, ..)) if vehicle.set_mode(*mode) => MavResult::MAV_RESULT_ACCEPTED,
            Some(_) => MavResult::MAV_RESULT_FAILED,
        }
    }

    /// Commands that concern the flight.
    pub(super) fn flight_command(&mut self, command: MavCmd, params: &[f32; 7]) -> MavResult {
        let done = |ok| if ok { MavResult::MAV_RESULT_ACCEPTED } else { MavResult::MAV_RESULT_FAILED };
        match command {
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let custom = match self.config.flavour {
                    Flavour::ArduPilot => params[1] as u32,
                    Flavour::Px4 => (params[1] as u32) << 16 | (params[2] as u32) << 24,
                };
                self.set_custom_mode(custom)
            }
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM if params[0] == 1.0 && self.mission_rejected => {
                let text = "Arming denied: Resolve system health failures first";
                self.send_text(MavSeverity::MAV_SEVERITY_CRITICAL, text);
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED
            }
            MavCmd::MAV_CMD_MISSION_START if self.mission_rejected => MavResult::MAV_RESULT_DENIED,
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self
                .body
                .vehicle_mut()
                .map_or(MavResult::MAV_RESULT_UNSUPPORTED, |v| done(v.arm(params[0] == 1.0))),
            MavCmd::MAV_CMD_MISSION_START => {
                let Some(vehicle) = self.body.vehicle_mut() else {
                    return MavResult::MAV_RESULT_UNSUPPORTED;
                };
                done(vehicle.is_armed() && vehicle.set_mode(Mode::Auto))
            }
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT => done(self.set_current(params[0].max(0.0) as u16)),
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        }
    }

    /// ArduPilot begins at the next item that is flown and takes 0 for the first (`AP_Mission::set_current_cmd`); PX4 ignores the wish
    /// during a transfer (`handle_mission_set_current`).
    fn set_current(&mut self, seq: u16) -> bool {
        let mut index = usize::from(seq);
        match self.config.flavour {
            Flavour::ArduPilot => {
                let flown = |i: &MISSION_ITEM_INT_DATA| i.command as u32 <= LAST_NAV_COMMAND;
                let found = self.body.items().iter().enumerate().skip(index.max(1)).find(|(_, i)| flown(i));
                let Some((next, _)) = found else { return false };
                index = next;
            }
            Flavour::Px4 if self.mission.is_busy() => {
                self.send_text(MavSeverity::MAV_SEVERITY_CRITICAL, "WPM: IGN WP CURR CMD: Busy");
                return false;
            }
            Flavour::Px4 => {}
        }
        self.body.vehicle_mut().is_some_and(|v| v.set_current(index))
    }

    /// PX4's index after an upload or a clearing.
    fn move_cursor(&mut self) {
        let Some(cursor) = self.mission.take_cursor() else { return };
        if let (Flavour::Px4, Some(vehicle)) = (self.config.flavour, self.body.vehicle_mut()) {
            let last = vehicle.items().len().saturating_sub(1);
            vehicle.put_current(match cursor {
                Cursor::At(seq) => usize::from(seq),
                Cursor::Stays => vehicle.current().min(last),
            });
        }
    }

    /// Messages of the mission protocol and the old ways to command.
    pub(super) fn handle_flight(&mut self, from: &MavHeader, message: &MavMessage) {
        match message {
            MavMessage::SET_MODE(m) => {
                self.set_custom_mode(m.custom_mode);
            }
            MavMessage::MISSION_SET_CURRENT(m) => {
                // ArduPilot answers with the number that was asked for; PX4's next report of once a second says it.
                if self.set_current(m.seq) && self.config.flavour == Flavour::ArduPilot {
                    let MavMessage::MISSION_CURRENT(now) = self.mission_current() else { return };
                    self.send(&MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq: m.seq, ..now }));
                }
            }
            _ => {
                let answers = self.mission.handle(self.body.items_mut(), from, message, self.now_s);
                self.move_cursor();
                for answer in answers {
                    self.send(&answer);
                }
            }
        }
    }

    /// What the mission protocol and the pilot have to say by themselves.
    pub(super) fn report_mission(&mut self) {
        for message in self.mission.tick(self.now_s) {
            self.send(&message);
        }
        self.judge_mission();
        for text in self.mission.take_texts() {
            self.send_text(MavSeverity::MAV_SEVERITY_INFO, text);
        }
        let events = self.body.vehicle_mut().map(Vehicle::take_events).unwrap_or_default();
        for event in events {
            let message = match event {
                PilotEvent::Reached(seq) => {
                    MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq: seq as u16 })
                }
                PilotEvent::Landed => {
                    self.send_text(MavSeverity::MAV_SEVERITY_INFO, "Landed, disarmed");
                    continue;
                }
            };
            self.send(&message);
        }
    }

    /// PX4 judges a mission some time after it was acknowledged; ArduPilot does not.
    fn judge_mission(&mut self) {
        if self.mission.take_changed() && self.config.flavour == Flavour::Px4 {
            self.judge_s = self.now_s + JUDGE_AFTER_S;
        }
        if self.now_s < self.judge_s {
            return;
        }
        self.judge_s = f64::INFINITY;
        let found = feasibility::judge(self.body.items(), self.config.airframe, self.mission.home());
        self.mission_rejected = !found.is_empty();
        let boot_ms = (self.boot_s() * 1e3) as u32;
        for event in found {
            self.send(&event.message(boot_ms, self.events_sent));
            self.events_sent = self.events_sent.wrapping_add(1);
        }
    }

    fn send_text(&mut self, severity: MavSeverity, text: &str) {
        let message = STATUSTEXT_DATA { severity, text: text.into(), ..Default::default() };
        self.send(&MavMessage::STATUSTEXT(message));
    }

    pub(super) fn mission_current(&self) -> MavMessage {
        let items = self.body.items();
        let vehicle = self.vehicle();
        let last = items.len().saturating_sub(1);
        let seq = vehicle.map_or(0, Vehicle::current);
        // PX4's index stays at the last item when the mission is over.
        let seq = if self.config.flavour == Flavour::Px4 { seq.min(last) } else { seq };
        let mission_state = match vehicle {
            _ if items.is_empty() || self.mission_rejected => MissionState::MISSION_STATE_NO_MISSION,
            Some(v) if v.mode() == Mode::Auto && v.is_armed() => MissionState::MISSION_STATE_ACTIVE,
            Some(v) if v.current() >= items.len() => MissionState::MISSION_STATE_COMPLETE,
            _ => MissionState::MISSION_STATE_NOT_STARTED,
        };
        // ArduPilot does not count home.
        let total = match self.config.flavour {
            Flavour::ArduPilot => items.len().saturating_sub(1),
            Flavour::Px4 => items.len(),
        };
        MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq: seq.min(usize::from(u16::MAX)) as u16,
            total: total.min(usize::from(u16::MAX)) as u16,
            mission_state,
            mission_id: self.mission.opaque_id(items),
            fence_id: self.mission.opaque_id(self.fence()),
            rally_points_id: self.mission.opaque_id(self.rally_points()),
            ..Default::default()
        })
    }
}
