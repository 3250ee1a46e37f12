//! What a recording has to hold of the vehicle beside its flight: firmware version and parameters, those with the ids of the sensors among them.
//!
//! Sans I/O, like [`crate::link::rates`]. The version is asked for at once, parameters while the vehicle is disarmed and no transfer goes on, a few at
//! a time by number. After each few it waits three times as long as their answers took, so that it uses a quarter of what the link could carry however
//! narrow it is. They are read once; PX4's hash says after a flight or a restart whether they are still the same.

use super::run_wire::RawMessage;
use super::vehicle::Vehicle;
use super::{facts, param_codec};
use crate::link::endpoint::Origin;
use crate::link::frame::Frame;
use crate::preflight::Facts;
use gaware_mission::item::Autopilot;
use gaware_mission::params::{ParamMessage, list};
use std::collections::{BTreeMap, BTreeSet};

const AUTOPILOT_VERSION: u32 = 148;
/// `RADIO_STATUS`: byte 6 is the free share of the radio's buffer, %.
const RADIO_STATUS: u32 = 109;
const FREE_PERCENT: u8 = 50;
/// What a vehicle sends while a list of its is transferred, to whomever: items, requests, counts, acknowledgements.
const TRANSFER: [u32; 6] = [39, 40, 44, 47, 51, 73];
/// Parameters asked for at a time: autopilots queue a few requests and drop the rest.
const AT_A_TIME: usize = 4;
/// Wait for their answers, s; attempts of each.
const ANSWER_S: f64 = 0.7;
const TRIES: u32 = 5;
/// The pause after some answers, in times of what they took.
const PAUSE: f64 = 3.0;
/// Others come first: so long after the vehicle was found, a transfer or a full radio, s.
const QUIET_S: f64 = 3.0;
/// No autopilot has more.
const MOST: u16 = 10_000;

/// The reader of one vehicle.
#[derive(Debug)]
pub struct Inventory {
    facts: Facts,
    /// Where the vehicle is.
    origin: Origin,
    version_tries: u32,
    version_due_s: f64,
    /// Nothing of parameters is known to be allowed before the first heartbeat.
    disarmed: bool,
    quiet_until_s: f64,
    count: Option<u16>,
    have: BTreeSet<u16>,
    /// Attempts by number.
    tries: BTreeMap<u16, u32>,
    /// Numbers that are asked for at this moment, and since when.
    open: BTreeSet<u16>,
    open_since_s: f64,
    hash: Option<u32>,
    /// Attempts to read PX4's hash that are left.
    hash_tries: u32,
    finished: bool,
    report: Option<String>,
}

impl Inventory {
    /// Of the vehicle that is followed, which is heard from there.
    pub fn new(vehicle: Vehicle, origin: Origin, now_s: f64) -> Self {
        Self {
            facts: Facts::new(vehicle),
            origin,
            version_tries: TRIES,
            version_due_s: now_s,
            disarmed: false,
            quiet_until_s: now_s + QUIET_S,
            count: None,
            have: BTreeSet::new(),
            tries: BTreeMap::new(),
            open: BTreeSet::new(),
            open_since_s: now_s,
            hash: None,
            hash_tries: TRIES,
            finished: false,
            report: None,
        }
    }

    /// For a run that records nothing: which vehicle it is, and nothing else.
    #[must_use]
    pub fn of_version_alone(mut self) -> Self {
        (self.finished, self.hash_tries) = (true, 0);
        self
    }

    /// A transfer of this program is under way.
    pub fn give_way(&mut self, now_s: f64) {
        self.quiet_until_s = now_s + QUIET_S;
        self.open.clear();
    }

    /// What is to be told, once.
    pub fn take_report(&mut self) -> Option<String> {
        self.report.take()
    }

    /// Takes a frame that has arrived.
    pub fn receive(&mut self, now_s: f64, frame: &Frame) {
        if frame.message_id == RADIO_STATUS && frame.payload().get(6).is_some_and(|free| *free < FREE_PERCENT)
        {
            self.give_way(now_s);
        }
        if !self.facts.vehicle.sent(frame) {
            return;
        }
        if TRANSFER.contains(&frame.message_id) {
            self.give_way(now_s);
        }
        if let Some(vehicle) = Vehicle::from_heartbeat(frame) {
            let disarmed = !vehicle.state.armed;
            // PX4 writes offsets of its own at the end of a flight.
            if disarmed && !self.disarmed && self.finished {
                self.look_again();
            }
            (self.facts.vehicle, self.disarmed) = (vehicle, disarmed);
        }
        facts::see(frame, &mut self.facts);
        match param_codec::decode(frame) {
            Some(ParamMessage::Value { name, bits, .. }) if name.as_str() == list::HASH => self.hashed(bits),
            Some(ParamMessage::Value { count, index, .. }) => self.numbered(now_s, count, index),
            _ => {}
        }
    }

    /// The vehicle has restarted, or has flown: what was read may be old. Only PX4 can say so without all of it being read.
    pub fn look_again(&mut self) {
        if self.facts.vehicle.autopilot == Autopilot::Px4 {
            self.hash_tries = TRIES;
        }
    }

    fn hashed(&mut self, hash: u32) {
        self.hash_tries = 0;
        if self.hash.replace(hash).is_some_and(|before| before != hash) && self.finished {
            (self.finished, self.count) = (false, None);
            self.have.clear();
            self.tries.clear();
        }
    }

    fn numbered(&mut self, now_s: f64, count: u16, index: u16) {
        if index >= count || count > MOST {
            return;
        }
        if self.count.replace(count).is_some_and(|before| before != count) {
            // A parameter appeared or vanished: the numbers have moved.
            self.have.clear();
            self.tries.clear();
        }
        self.have.insert(index);
        if self.open.remove(&index) && self.open.is_empty() {
            self.quiet_until_s = self.quiet_until_s.max(now_s + PAUSE * (now_s - self.open_since_s));
        }
    }

    /// What is due now.
    pub fn poll(&mut self, now_s: f64) -> Vec<RawMessage> {
        let mut messages = Vec::new();
        if self.facts.firmware.is_none() && self.version_tries > 0 && now_s >= self.version_due_s {
            self.version_tries -= 1;
            self.version_due_s = now_s + ANSWER_S;
            let (id, payload) = facts::message_request(self.facts.vehicle, AUTOPILOT_VERSION);
            messages.push(RawMessage { to: self.origin, id, payload });
        }
        let waiting = !self.open.is_empty() && now_s < self.open_since_s + ANSWER_S;
        if self.disarmed && now_s >= self.quiet_until_s && !waiting {
            messages.extend(self.ask(now_s));
        }
        messages
    }

    fn ask(&mut self, now_s: f64) -> Vec<RawMessage> {
        let px4 = self.facts.vehicle.autopilot == Autopilot::Px4;
        if px4
            && self.hash_tries > 0
            && let Ok(name) = list::HASH.parse()
        {
            self.hash_tries -= 1;
            self.quiet_until_s = now_s + ANSWER_S;
            return vec![self.message(&ParamMessage::RequestRead { name })];
        }
        if self.finished {
            return Vec::new();
        }
        let untried = |index: &u16| self.tries.get(index).is_none_or(|tries| *tries < TRIES);
        // Any answer says how many there are.
        let all = 0..self.count.unwrap_or(1);
        let next: BTreeSet<u16> =
            all.filter(|k| !self.have.contains(k)).filter(untried).take(AT_A_TIME).collect();
        if next.is_empty() {
            self.finish();
            return Vec::new();
        }
        next.iter().for_each(|index| *self.tries.entry(*index).or_default() += 1);
        let messages = next.iter().map(|index| self.message(&ParamMessage::RequestIndex { index: *index }));
        let messages = messages.collect();
        (self.open, self.open_since_s) = (next, now_s);
        messages
    }

    fn message(&self, message: &ParamMessage) -> RawMessage {
        let (id, payload) = param_codec::encode(self.facts.vehicle.address, message);
        RawMessage { to: self.origin, id, payload }
    }

    fn finish(&mut self) {
        self.finished = true;
        let name = self.facts.vehicle.autopilot;
        let version = match self.facts.firmware {
            Some([major, minor, patch]) => format!("{name} {major}.{minor}.{patch}"),
            None => format!("{name} of unknown version"),
        };
        let missing = usize::from(self.count.unwrap_or(0)).saturating_sub(self.have.len());
        self.report = Some(match (self.count, missing) {
            (None, _) => format!("the recording holds no parameters: {version} does not answer for them"),
            (Some(count), 0) => format!("the recording holds all {count} parameters of {version}"),
            (Some(count), _) => {
                format!(
                    "the recording lacks {missing} of {count} parameters of {version}: they did not arrive"
                )
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use gaware_mission::params::ParamType;
    use gaware_mission::transfer::{Address, MissionMessage, MissionResult};
    use mavlink::dialects::ardupilotmega::{
        AUTOPILOT_VERSION_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType,
        RADIO_STATUS_DATA,
    };

    const AUTOPILOT: Sender = Sender { system_id: 1, component_id: 1 };

    /// A vehicle with so many parameters that answers after so long, and what it was asked for when.
    struct Fake {
        inventory: Inventory,
        count: u16,
        answer_s: f64,
        now_s: f64,
        armed: bool,
        hash: u32,
        asked: Vec<(f64, Option<i16>)>,
        answers: Vec<(f64, Frame)>,
    }

    fn heartbeat(armed: bool) -> Frame {
        let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let (mavtype, autopilot) = (MavType::MAV_TYPE_FIXED_WING, MavAutopilot::MAV_AUTOPILOT_PX4);
        let heartbeat = HEARTBEAT_DATA { mavtype, autopilot, base_mode, ..Default::default() };
        Frame::encode(AUTOPILOT, 0, &MavMessage::HEARTBEAT(heartbeat))
    }

    impl Fake {
        fn new(count: u16, answer_s: f64) -> Self {
            let vehicle = Vehicle::from_heartbeat(&heartbeat(false)).unwrap();
            let (inventory, asked, answers) =
                (Inventory::new(vehicle, Origin::default(), 0.0), Vec::new(), Vec::new());
            Self { inventory, count, answer_s, now_s: 0.0, armed: false, hash: 7, asked, answers }
        }

        /// The value of a parameter by number, or of the hash.
        fn value(&self, index: i16) -> Frame {
            let (name, index) = match u16::try_from(index) {
                Ok(index) => (format!("P{index}"), index),
                Err(_) => (list::HASH.to_owned(), u16::MAX),
            };
            let name = name.parse().unwrap();
            let value = ParamMessage::Value {
                name,
                bits: self.hash,
                kind: Some(ParamType::U32),
                count: self.count,
                index,
            };
            self.frame(param_codec::encode(Address { system: 255, component: 190 }, &value))
        }

        fn frame(&self, (id, payload): (u32, Vec<u8>)) -> Frame {
            Frame::of_payload(AUTOPILOT, 0, id, &payload).unwrap()
        }

        fn run(&mut self, seconds: f64) {
            let end = self.now_s + seconds;
            while self.now_s < end {
                self.now_s += 0.05;
                if ((self.now_s * 20.0).round() as u64).is_multiple_of(20) {
                    self.inventory.receive(self.now_s, &heartbeat(self.armed));
                }
                let now_s = self.now_s;
                let (due, later) =
                    std::mem::take(&mut self.answers).into_iter().partition(|(t, _)| *t <= now_s);
                self.answers = later;
                let due: Vec<(f64, Frame)> = due;
                due.iter().for_each(|(_, frame)| self.inventory.receive(now_s, frame));
                for message in self.inventory.poll(now_s) {
                    let index = (message.id == 20)
                        .then(|| i16::from_le_bytes([message.payload[0], message.payload[1]]));
                    self.asked.push((now_s, index));
                    if let Some(index) = index {
                        self.answers.push((now_s + self.answer_s, self.value(index)));
                    }
                }
            }
        }

        fn parameters_asked(&self) -> usize {
            self.asked.iter().filter(|(_, index)| index.is_some_and(|k| k >= 0)).count()
        }
    }

    #[test]
    fn all_parameters_are_read_once_and_again_when_the_hash_differs() {
        let mut fake = Fake::new(100, 0.0);
        let version = AUTOPILOT_VERSION_DATA { flight_sw_version: 0x0110_0000, ..Default::default() };
        fake.inventory.receive(0.0, &Frame::encode(AUTOPILOT, 0, &MavMessage::AUTOPILOT_VERSION(version)));
        fake.run(60.0);
        assert_eq!(fake.parameters_asked(), 100);
        assert_eq!(
            fake.inventory.take_report().as_deref(),
            Some("the recording holds all 100 parameters of PX4 1.16.0")
        );
        // After a flight the same hash: nothing is read again.
        for (hash, read) in [(7, 100), (8, 200)] {
            (fake.armed, fake.hash) = (true, hash);
            fake.run(60.0);
            fake.armed = false;
            fake.run(60.0);
            assert_eq!(fake.parameters_asked(), read, "hash {hash}");
        }
    }

    #[test]
    fn nothing_is_read_while_armed_or_during_a_transfer_or_over_a_full_radio() {
        let busy = |disturb: &dyn Fn(&mut Fake)| {
            let mut fake = Fake::new(100, 0.0);
            for _ in 0..600 {
                fake.run(0.1);
                disturb(&mut fake);
            }
            fake.parameters_asked()
        };
        assert_eq!(busy(&|f| f.armed = true), 0);
        assert_eq!(busy(&|f| f.inventory.give_way(f.now_s)), 0);
        assert_eq!(
            busy(&|f| {
                let ack =
                    MissionMessage::Ack { result: MissionResult::ACCEPTED, mission_type: 0, opaque_id: 0 };
                let station = Address { system: 255, component: 190 };
                let frame = f.frame(super::super::codec::encode(station, &ack));
                f.inventory.receive(f.now_s, &frame);
            }),
            0
        );
        assert_eq!(
            busy(&|f| {
                let radio = RADIO_STATUS_DATA { txbuf: 20, ..Default::default() };
                let sender = Sender { system_id: 51, component_id: 68 };
                f.inventory.receive(f.now_s, &Frame::encode(sender, 0, &MavMessage::RADIO_STATUS(radio)));
            }),
            0
        );
        assert_eq!(busy(&|_| {}), 100);
    }

    /// Three quarters of the time the link is left to others, however long its answers take.
    #[test]
    fn a_narrow_link_is_left_to_others() {
        let mut fake = Fake::new(1000, 0.5);
        fake.run(103.0);
        // Rounds of 4, each 0.5 s of answers and 1.5 s of pause.
        let asked = fake.parameters_asked();
        assert!((160..=220).contains(&asked), "{asked}");
    }

    #[test]
    fn what_does_not_arrive_is_said() {
        let mut fake = Fake::new(10, 1000.0);
        fake.run(60.0);
        let said = fake.inventory.take_report().unwrap_or_default();
        assert!(said.contains("holds no parameters: PX4 of unknown version does not answer"), "{said}");
        assert_eq!(fake.asked.iter().filter(|(_, index)| index.is_none()).count(), 5, "versions");
    }
}
