//! How far the autopilot is with its own mission, and whether it gets on.
//!
//! Sans I/O: it follows `HEARTBEAT` (who flies) and `MISSION_CURRENT` (which item). An item that takes more than twice as long as
//! it should is reported: a circle whose altitude is out of reach never ends, and the autopilot says nothing.

use crate::engine::snapshot::{MissionProgress, Snapshot};
use crate::link::frame::Frame;
use crate::link::vehicle::Vehicle;
use crate::sensors::AUTOPILOT_COMPONENT;
use gaware_mission::fence::LocalFrame;
use gaware_mission::item::{Autopilot, Mission, MissionItem, command};
use gaware_wire::heartbeat;
use mavlink::dialects::ardupilotmega::MavMessage;

/// Id of `MISSION_CURRENT`.
const MISSION_CURRENT: u32 = 42;
/// An item that this program does not know may take so long, s.
const UNKNOWN_ITEM_S: f64 = 240.0;
/// What any item may take beside its own work: getting there, turning in, s.
const ALLOWANCE_S: f64 = 30.0;
/// Slow vehicles fly and climb like this, m/s.
const SLOW_M_PER_S: (f64, f64) = (8.0, 1.0);
/// An item is overdue after so many times its expected duration.
const OVERDUE: f64 = 2.0;

/// Follows the mission of one vehicle.
#[derive(Debug, Default)]
pub struct MissionWatch {
    planned: Option<Mission>,
    vehicle: Option<Vehicle>,
    item: Option<u16>,
    total: u16,
    since_s: f64,
    reported: bool,
}

impl MissionWatch {
    /// A watch; with the planned mission it knows what each item is.
    pub fn new(planned: Option<Mission>) -> Self {
        Self { planned, ..Self::default() }
    }

    /// Takes a frame of the vehicle that is followed, at `t_s` of any monotonic clock.
    pub fn receive(&mut self, t_s: f64, frame: &Frame) {
        if frame.component_id != AUTOPILOT_COMPONENT {
            return;
        }
        match frame.message_id {
            heartbeat::ID => {
                let flew = self.flies();
                self.vehicle = Vehicle::from_heartbeat(frame);
                if self.flies() != flew {
                    self.begin(t_s);
                }
            }
            MISSION_CURRENT => {
                let Ok(MavMessage::MISSION_CURRENT(m)) = frame.decode() else { return };
                self.total = m.total;
                if self.item.replace(m.seq) != Some(m.seq) {
                    self.begin(t_s);
                }
            }
            _ => {}
        }
    }

    fn begin(&mut self, t_s: f64) {
        (self.since_s, self.reported) = (t_s, false);
    }

    /// Whether the autopilot flies its mission.
    pub fn flies(&self) -> bool {
        self.vehicle.is_some_and(|v| v.state.flying_mission)
    }

    /// What screens show at `t_s`.
    pub fn progress(&self, t_s: f64) -> MissionProgress {
        let flying = self.flies();
        let Some(item) = self.item else { return MissionProgress { flying, ..MissionProgress::default() } };
        let at_item_s = if flying { (t_s - self.since_s).max(0.0) } else { 0.0 };
        let stuck = self.stuck(item, at_item_s).unwrap_or_default();
        MissionProgress { flying, item, at_item_s, stuck }
    }

    /// Adds it to a snapshot, with a warning where an item does not end.
    pub fn complete(&self, t_s: f64, snapshot: &mut Snapshot) {
        snapshot.mission = self.progress(t_s);
        if !snapshot.mission.stuck.is_empty() {
            snapshot.warnings.push(snapshot.mission.stuck.clone());
        }
    }

    /// The report of an item that does not end, once.
    pub fn take_report(&mut self, t_s: f64) -> Option<String> {
        let stuck = self.progress(t_s).stuck;
        (!stuck.is_empty() && !std::mem::replace(&mut self.reported, true)).then_some(stuck)
    }

    fn stuck(&self, item: u16, at_item_s: f64) -> Option<String> {
        let known = self.known(item);
        let expected_s = match known {
            Some((items, k)) => expected_s(items, k)?,
            None => UNKNOWN_ITEM_S,
        };
        if at_item_s <= OVERDUE * expected_s {
            return None;
        }
        let kind = known.and_then(|(items, k)| items.get(k)).map(|i| i.command);
        let what = kind.map(|c| format!(" ({})", command::describe(c))).unwrap_or_default();
        let why = match kind {
            Some(command::NAV_LOITER_TO_ALT | command::NAV_CONTINUE_AND_CHANGE_ALT) => {
                "the altitude may be out of reach: skip the item or take over"
            }
            _ => "skip the item or take over",
        };
        // Whole minutes: the text stays the same for a while, and so is reported once.
        let minutes = (at_item_s / 60.0).floor();
        Some(format!(
            "stuck at item {item}{what} for {minutes:.0} min, about {expected_s:.0} s were expected; {why}"
        ))
    }

    /// The planned items and the place of this one among them, where the mission on board is as long as the planned one.
    fn known(&self, item: u16) -> Option<(&[MissionItem], usize)> {
        let items = &self.planned.as_ref()?.items[..];
        let home_first = self.vehicle.is_some_and(|v| v.autopilot == Autopilot::ArduPilot);
        let index = usize::from(item).checked_sub(usize::from(home_first))?;
        // Older firmware says 0 or the largest number: nothing.
        let same = matches!(self.total, 0 | u16::MAX) || usize::from(self.total) == items.len();
        (same && index < items.len()).then_some((items, index))
    }
}

/// How long an item takes a slow vehicle, s; nothing where it ends only by command.
fn expected_s(items: &[MissionItem], k: usize) -> Option<f64> {
    let item = items.get(k)?;
    let [p1, p2, p3, _] = item.params.map(f64::from).map(|p| if p.is_finite() { p } else { 0.0 });
    let before = items.get(..k).unwrap_or_default();
    let way_m = match (before.iter().rev().find_map(MissionItem::place), item.place()) {
        (Some(from), Some(to)) => LocalFrame::new(from).to_local(to).norm(),
        _ => 0.0,
    };
    let last_z = before.iter().rev().find(|i| command::has_altitude(i.command)).map_or(0.0, |i| i.z);
    let climb_m = f64::from(item.z - last_z).abs();
    let (speed, climb) = SLOW_M_PER_S;
    let own_s = match item.command {
        command::NAV_LOITER_UNLIM | command::NAV_DELAY => return None,
        command::NAV_LOITER_TURNS => p1 * std::f64::consts::TAU * p3.abs().max(1.0) / speed,
        command::NAV_LOITER_TIME | command::NAV_WAYPOINT => p1,
        command::NAV_LOITER_TO_ALT => std::f64::consts::TAU * p2.abs() / speed,
        command::NAV_LAND | command::NAV_RETURN_TO_LAUNCH => UNKNOWN_ITEM_S,
        _ => 0.0,
    };
    Some(ALLOWANCE_S + own_s + way_m / speed + if climb_m.is_finite() { climb_m / climb } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use gaware_mission::item::LatLon;
    use mavlink::dialects::ardupilotmega::{
        HEARTBEAT_DATA, MISSION_CURRENT_DATA, MavAutopilot, MavModeFlag, MavType,
    };

    fn frame(message: &MavMessage) -> Frame {
        Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, message)
    }

    fn heartbeat(custom_mode: u32) -> Frame {
        frame(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode,
            mavtype: MavType::MAV_TYPE_FIXED_WING,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
            ..Default::default()
        }))
    }

    fn current(seq: u16) -> Frame {
        frame(&MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq, total: 2, ..Default::default() }))
    }

    fn planned() -> Mission {
        let place = LatLon { lat_deg: 47.0, lon_deg: 8.0 };
        let climb = MissionItem::at(command::NAV_LOITER_TO_ALT, [0.0, 60.0, 0.0, 0.0], place, 100.0);
        let hold = MissionItem::at(command::NAV_LOITER_UNLIM, [0.0; 4], place, 100.0);
        Mission { home: None, items: vec![climb, hold] }
    }

    #[test]
    fn a_circle_that_never_reaches_its_altitude_is_reported_once_with_its_kind() {
        let mut watch = MissionWatch::new(Some(planned()));
        watch.receive(0.0, &heartbeat(10));
        watch.receive(0.0, &current(1));
        let reports: Vec<(u32, String)> =
            (0..900).filter_map(|t| watch.take_report(f64::from(t)).map(|text| (t, text))).collect();
        let [(at, text)] = &reports[..] else { panic!("{reports:?}") };
        // 30 s, one circle of 47 s and 100 m at 1 m/s: 177 s.
        assert_eq!(*at, 355);
        assert!(text.starts_with("stuck at item 1 (loiter to altitude) for 5 min, about 177 s"), "{text}");
        // The next item is for ever by its kind.
        watch.receive(900.0, &current(2));
        assert_eq!(watch.take_report(9000.0), None);
        assert_eq!(watch.progress(960.0).at_item_s, 60.0);
    }

    #[test]
    fn who_is_flown_by_hand_or_whose_mission_goes_on_is_not_stuck() {
        let mut watch = MissionWatch::new(None);
        watch.receive(0.0, &heartbeat(5));
        watch.receive(0.0, &current(1));
        assert!(!watch.flies());
        assert_eq!(watch.take_report(5000.0), None);
        watch.receive(5000.0, &heartbeat(10));
        for k in 0..100 {
            watch.receive(5000.0 + 100.0 * f64::from(k), &current(k as u16));
            assert_eq!(watch.take_report(5099.0 + 100.0 * f64::from(k)), None);
        }
        assert!(watch.take_report(16_000.0).is_some(), "of an unknown item too, after minutes");
    }
}
