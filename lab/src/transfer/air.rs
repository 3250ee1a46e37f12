//! Simulated autopilots at the ends of faulty links; waiting makes virtual time pass.

use super::station::Station;
use gaware::link::endpoint::Origin;
use gaware::link::frame::Frame;
use gaware::link::heartbeat::HeartbeatSource;
use gaware::mission_link::pinned::{Pinned, RawEvent, RawWire};
use gaware::mission_link::vehicle::Vehicle;
use gaware_mission::item::{Autopilot as Firmware, Frame as ItemFrame, Mission, MissionItem};
use gaware_mission::transfer::Address;
use gaware_nav::model::Model;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig};
use gaware_sitl::faults::{FaultyLink, LinkFaults};
use gaware_sitl::sensors::SensorConfig;
use gaware_sitl::vehicle::VehicleConfig;
use std::collections::VecDeque;

/// One step of virtual time, s: the autopilot's loop at 100 Hz.
const STEP_S: f64 = 0.01;

/// A simulated autopilot and its link.
pub(super) struct Aircraft {
    autopilot: Autopilot,
    /// Where it is on the link.
    pub(super) origin: Origin,
    up: FaultyLink,
    down: FaultyLink,
    /// Whether it is in range.
    pub(super) on: bool,
}

impl Aircraft {
    pub(super) fn new(config: AutopilotConfig, origin: Origin) -> Self {
        let quad = VehicleConfig::multirotor();
        let config = AutopilotConfig { loop_rate_hz: 1.0 / STEP_S, ..config };
        let perfect = |direction| FaultyLink::new(LinkFaults::default(), config.seed, direction);
        let (up, down) = (perfect(1), perfect(0));
        let autopilot = Autopilot::flying(config, quad, &Model::standard(), SensorConfig::default());
        Self { autopilot, origin, up, down, on: true }
    }

    pub(super) fn spoil(&mut self, faults: LinkFaults, seed: u64) {
        self.up = FaultyLink::new(faults.clone(), seed, 1);
        self.down = FaultyLink::new(faults, seed, 0);
    }

    /// What really is on it.
    pub(super) fn on_board(&self, firmware: Firmware) -> Mission {
        let items = self.autopilot.mission().iter().map(|i| MissionItem {
            command: i.command as u16,
            frame: ItemFrame(i.frame as u8),
            autocontinue: i.autocontinue != 0,
            params: [i.param1, i.param2, i.param3, i.param4],
            x: i.x,
            y: i.y,
            z: i.z,
        });
        Mission::from_wire_items(firmware, &items.collect::<Vec<_>>())
    }

    /// A moment passes; what arrives from it.
    fn step(&mut self, now_s: f64, heard: &mut VecDeque<(Origin, Frame)>) {
        for bytes in self.up.pop(now_s) {
            self.autopilot.receive(&bytes);
        }
        self.autopilot.step(now_s);
        for out in self.autopilot.take_output() {
            self.down.push(now_s, out.bytes);
        }
        let arrived = self.down.pop(now_s).into_iter().filter_map(|bytes| Frame::parse(bytes.into()).ok());
        let origin = self.origin;
        if self.on {
            heard.extend(arrived.map(|frame| (origin, frame)));
        } else {
            arrived.for_each(drop);
        }
    }
}

/// All aircraft that a session can hear.
pub(super) struct Air {
    pub(super) aircraft: Vec<Aircraft>,
    voice: HeartbeatSource,
    heard: VecDeque<(Origin, Frame)>,
    now_s: f64,
    /// An aircraft that comes into range at this time.
    pub(super) comes: Option<(f64, usize)>,
    /// Another station.
    pub(super) station: Option<Station>,
    /// When the program is killed.
    pub(super) killed_s: f64,
}

impl Air {
    pub(super) fn of(aircraft: Vec<Aircraft>) -> Self {
        let now_s = aircraft.iter().map(|a| a.autopilot.now_s()).fold(0.0, f64::max);
        let (voice, heard) = (HeartbeatSource::new(), VecDeque::new());
        Self { aircraft, voice, heard, now_s, comes: None, station: None, killed_s: f64::INFINITY }
    }

    /// Connected to the first vehicle that is heard.
    pub(super) fn connect(mut self) -> Pinned<Self> {
        loop {
            self.step();
            let mut heard = self.heard.drain(..);
            let seen = heard.find_map(|(origin, f)| Some((Vehicle::from_heartbeat(&f)?, origin)));
            drop(heard);
            if let Some((vehicle, origin)) = seen {
                self.voice.belongs_to(vehicle.address.system);
                return Pinned::new(self, vehicle, origin);
            }
        }
    }

    fn step(&mut self) {
        self.now_s += STEP_S;
        if let Some((_, which)) = self.comes.take_if(|(at, _)| *at <= self.now_s)
            && let Some(aircraft) = self.aircraft.get_mut(which)
        {
            aircraft.on = true;
        }
        let before = self.heard.len();
        for aircraft in &mut self.aircraft {
            aircraft.step(self.now_s, &mut self.heard);
        }
        if let (Some(station), Some(aircraft)) = (&mut self.station, self.aircraft.first_mut()) {
            let heard = self.heard.iter().skip(before).map(|(_, frame)| frame);
            for bytes in station.step(self.now_s, heard) {
                aircraft.up.push(self.now_s, bytes);
            }
        }
    }
}

impl RawWire for Air {
    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn me(&self) -> Address {
        let sender = self.voice.sender();
        Address { system: sender.system_id, component: sender.component_id }
    }

    fn send_to(&mut self, to: Origin, id: u32, payload: Vec<u8>) {
        let Ok(frame) = self.voice.say_payload(id, &payload) else { return };
        for aircraft in self.aircraft.iter_mut().filter(|a| a.on && a.origin == to) {
            aircraft.up.push(self.now_s, frame.raw().to_vec());
        }
    }

    async fn next_of_all(&mut self, deadline_s: f64) -> RawEvent {
        loop {
            if self.now_s >= self.killed_s {
                return std::future::pending().await;
            }
            if let Some((origin, frame)) = self.heard.pop_front() {
                return RawEvent::Frame(origin, frame);
            }
            if self.now_s >= deadline_s {
                return RawEvent::Deadline;
            }
            self.step();
        }
    }
}
