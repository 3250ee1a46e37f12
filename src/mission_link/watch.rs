//! Who flies, as the vehicle's own heartbeat and `MISSION_CURRENT` report it, for the screens of a run; and the planned route
//! for their map.

use super::vehicle::Vehicle;
use crate::link::endpoint::Received;
use crate::link::frame::Frame;
use crate::sinks::status::{Control, RouteView, SinkStatus, VehicleView};
use gaware_mission::fence::Fence;
use gaware_mission::item::{Mission, command};
use mavlink::dialects::ardupilotmega::MavMessage;
use std::sync::Arc;
use tokio::sync::broadcast::{self, error::RecvError};
use tokio_util::sync::CancellationToken;

/// `MISSION_CURRENT`.
const MISSION_CURRENT: u32 = 42;
/// Corners of a fence's circle on the map.
const CIRCLE_CORNERS: u32 = 48;
/// Metres per degree of latitude, near enough for a map.
const M_PER_DEG: f64 = 111_320.0;

/// What is known of who flies.
#[derive(Debug, Clone, Default)]
pub struct Watch {
    wanted: Option<u8>,
    vehicle: Option<Vehicle>,
    item: u64,
}

impl Watch {
    /// For the vehicle with this system id, or the first autopilot received.
    pub fn new(wanted: Option<u8>) -> Self {
        Self { wanted, ..Self::default() }
    }

    /// Takes a frame; whether it changed what is known.
    pub fn take(&mut self, frame: &Frame) -> bool {
        let wanted = self.vehicle.map(|v| v.address.system).or(self.wanted);
        if wanted.is_some_and(|id| id != frame.system_id) {
            return false;
        }
        if let Some(vehicle) = Vehicle::from_heartbeat(frame) {
            return self.vehicle.replace(vehicle) != Some(vehicle);
        }
        if frame.message_id != MISSION_CURRENT || self.vehicle.is_none() {
            return false;
        }
        let Ok(MavMessage::MISSION_CURRENT(m)) = frame.decode() else { return false };
        std::mem::replace(&mut self.item, u64::from(m.seq)) != u64::from(m.seq)
    }

    /// As screens show it; `items`: of the planned mission on board, 0 where that is not known.
    pub fn view(&self, items: u64) -> VehicleView {
        let Some(vehicle) = self.vehicle else { return VehicleView::default() };
        let state = vehicle.state;
        let control = match (state.armed, state.mission_mode) {
            (false, _) => Control::Ground,
            (true, true) => Control::Autopilot,
            (true, false) => Control::Pilot,
        };
        let armed = if state.armed { "armed" } else { "disarmed" };
        let mode = if state.mission_mode { "mission mode" } else { "not in mission mode" };
        let flies = control == Control::Autopilot;
        VehicleView {
            control,
            mode: format!("{mode}, {armed}"),
            now: if flies { format!("mission item {}", self.item) } else { String::new() },
            maneuver: if flies && items > 0 { self.item.min(items) } else { 0 },
            maneuvers: if flies { items } else { 0 },
            ..VehicleView::default()
        }
    }
}

/// Keeps the status up to date until `stop`.
pub async fn run(
    mut watch: Watch,
    mut frames: broadcast::Receiver<Received>,
    status: Arc<SinkStatus>,
    stop: CancellationToken,
) {
    loop {
        let received = tokio::select! {
            () = stop.cancelled() => return,
            received = frames.recv() => received,
        };
        match received {
            Ok(received) => {
                if watch.take(&received.frame) {
                    status.set_vehicle(watch.view(status.mission().items));
                }
            }
            Err(RecvError::Lagged(_)) => {}
            Err(RecvError::Closed) => return,
        }
    }
}

/// Home, the way from item to item, and the fence of a mission file.
pub fn route(mission: &Mission, fence: &Fence) -> RouteView {
    let degrees = |lat_e7: i32, lon_e7: i32| [f64::from(lat_e7) * 1e-7, f64::from(lon_e7) * 1e-7];
    let placed = mission.items.iter().filter(|i| command::has_position(i.command) && (i.x, i.y) != (0, 0));
    let circles = fence.circles.iter().map(|c| {
        let east = M_PER_DEG * c.center.lat_deg.to_radians().cos().max(1e-3);
        (0..CIRCLE_CORNERS)
            .map(|k| {
                let (sin, cos) = (f64::from(k) / f64::from(CIRCLE_CORNERS) * std::f64::consts::TAU).sin_cos();
                [c.center.lat_deg + c.radius_m * cos / M_PER_DEG, c.center.lon_deg + c.radius_m * sin / east]
            })
            .collect()
    });
    let polygons = fence.polygons.iter().map(|p| p.corners.iter().map(|c| [c.lat_deg, c.lon_deg]).collect());
    RouteView {
        home: mission.home.map(|h| degrees(h.lat_e7, h.lon_e7)),
        path: placed.filter(|i| i.x != i32::MAX && i.y != i32::MAX).map(|i| degrees(i.x, i.y)).collect(),
        fence: polygons.chain(circles).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::{
        HEARTBEAT_DATA, MISSION_CURRENT_DATA, MavAutopilot, MavModeFlag, MavType,
    };

    fn heartbeat(system_id: u8, custom_mode: u32, armed: bool) -> Frame {
        let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let data = HEARTBEAT_DATA {
            custom_mode,
            mavtype: MavType::MAV_TYPE_FIXED_WING,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            ..Default::default()
        };
        Frame::encode(Sender { system_id, component_id: 1 }, 0, &MavMessage::HEARTBEAT(data))
    }

    #[test]
    fn who_flies_follows_the_heartbeat_of_the_vehicle_alone() {
        let mut watch = Watch::new(None);
        assert_eq!(watch.view(67).control, Control::Unknown);
        assert!(watch.take(&heartbeat(1, 10, false)));
        assert_eq!(watch.view(67).control, Control::Ground);
        assert!(watch.take(&heartbeat(1, 5, true)));
        assert_eq!(watch.view(67).control, Control::Pilot);
        assert!(watch.take(&heartbeat(1, 10, true)));
        assert!(!watch.take(&heartbeat(2, 5, true)), "another vehicle");
        let current = MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq: 12, ..Default::default() });
        assert!(watch.take(&Frame::encode(Sender { system_id: 1, component_id: 1 }, 0, &current)));
        let view = watch.view(67);
        assert_eq!((view.control, view.maneuver, view.maneuvers), (Control::Autopilot, 12, 67));
        assert_eq!(view.now, "mission item 12");
    }
}
