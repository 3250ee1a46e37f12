//! The link to the simulated autopilot after its landing: waiting makes virtual time pass, and all frames are recorded.

use crate::link::frame::Frame;
use crate::link::heartbeat::HeartbeatSource;
use crate::logs::{Item, Record};
use crate::mission_link::vehicle::Vehicle;
use crate::mission_link::wire::{Event, Wire, heartbeat_of};
use gaware_mission::transfer::{Address, Peers};
use gaware_sitl::autopilot::Autopilot;
use std::collections::VecDeque;

/// One step of virtual time, s.
const STEP_S: f64 = 0.01;
/// Waits without a deadline end after this, s.
const WAIT_S: f64 = 0.1;
/// A heartbeat comes once a second, s.
const HEARTBEAT_WITHIN_S: f64 = 3.0;

pub(super) struct StandingWire<'a> {
    autopilot: &'a mut Autopilot,
    records: &'a mut Vec<Record>,
    sender: HeartbeatSource,
    vehicle: Vehicle,
    arrived: VecDeque<Frame>,
    now_s: f64,
}

impl<'a> StandingWire<'a> {
    /// Connected at this virtual time, after the first heartbeat.
    pub(super) fn new(autopilot: &'a mut Autopilot, now_s: f64, records: &'a mut Vec<Record>) -> Self {
        let now_s = now_s.max(autopilot.now_s());
        let sender = HeartbeatSource::new();
        let arrived = VecDeque::new();
        let mut wire = Self { autopilot, records, sender, vehicle: Vehicle::UNKNOWN, arrived, now_s };
        let end_s = now_s + HEARTBEAT_WITHIN_S;
        while wire.now_s < end_s {
            wire.step();
            if let Some(vehicle) = wire.arrived.drain(..).find_map(|f| Vehicle::from_heartbeat(&f)) {
                wire.sender.belongs_to(vehicle.address.system);
                wire.vehicle = vehicle;
                break;
            }
        }
        wire
    }

    /// Virtual time, s.
    pub(super) fn end_s(&self) -> f64 {
        self.now_s
    }

    fn step(&mut self) {
        self.now_s += STEP_S;
        self.autopilot.step(self.now_s);
        for out in self.autopilot.take_output() {
            if let Ok(frame) = Frame::parse(out.bytes.into()) {
                self.records.push(Record { t_us: out.t_us, item: Item::Frame(frame.clone()) });
                self.arrived.push_back(frame);
            }
        }
    }
}

impl Wire for StandingWire<'_> {
    fn vehicle(&self) -> Vehicle {
        self.vehicle
    }

    fn peers(&self) -> Peers {
        let sender = self.sender.sender();
        Peers::new(Address { system: sender.system_id, component: sender.component_id }, self.vehicle.address)
    }

    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn send_payload(&mut self, id: u32, payload: Vec<u8>) {
        if let Ok(frame) = self.sender.say_payload(id, &payload) {
            self.autopilot.receive(frame.raw());
        }
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        let deadline_s = deadline_s.unwrap_or(self.now_s + WAIT_S);
        loop {
            if let Some(frame) = self.arrived.pop_front() {
                if let Some(vehicle) = heartbeat_of(self.vehicle, &frame) {
                    self.vehicle = vehicle;
                }
                return Event::Frame(frame);
            }
            if self.now_s >= deadline_s {
                return Event::Deadline;
            }
            self.step();
        }
    }
}
