//! The state machines of missions and parameters against arbitrary messages at arbitrary times.

use crate::script::{self, Kind, Step};
use crate::vehicle::{HonestVehicle, ME, VEHICLE, envelope, honest_frames};
use gaware::mission_link::vehicle::Vehicle;
use gaware::mission_link::{codec, param_codec};
use gaware_mission::change::{Exchange, VerifiedChange};
use gaware_mission::compare::differences;
use gaware_mission::item::{Autopilot, LatLon, Mission, MissionItem, MissionKind, command};
use gaware_mission::params::{Encoding, ParamMessage, ParamName, ParamRead, ParamTiming, ParamType};
use gaware_mission::transfer::verified::{Options, Outcome, VehicleState, VerifiedUpload};
use gaware_mission::transfer::{Action, Peers};

/// A transfer ends within this time once its vehicle answers every message, s.
const PATIENCE_S: f64 = 3600.0;
/// Messages of the program in one transfer at most.
const MOST_SENT: usize = 100_000;
const FIRMWARE: Autopilot = Autopilot::Px4;
pub(super) const ON_THE_GROUND: VehicleState =
    VehicleState { armed: false, mission_mode: false, flying_mission: false, in_flight: false };

/// A mission of so many items; `shift_m` makes two of them different.
pub(super) fn mission(items: u8, shift_m: f32) -> Mission {
    let item = |k: u8| {
        let place = LatLon { lat_deg: 47.3 + 0.001 * f64::from(k), lon_deg: 8.5 };
        match k % 3 {
            1 => MissionItem::action(command::DO_CHANGE_SPEED, [0.0, 14.0 + f32::from(k % 8), -1.0, 0.0]),
            _ => MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place, 60.0 + shift_m),
        }
    };
    Mission { home: None, items: (0..items).map(item).collect() }
}

/// A transfer, its vehicle and the time.
struct Run {
    upload: VerifiedUpload,
    vehicle: HonestVehicle,
    now_s: f64,
    sent: usize,
}

impl Run {
    fn act(&mut self, actions: Vec<Action>) {
        for action in actions {
            if let Action::Send(message) = action {
                self.sent += 1;
                self.vehicle.receive(self.now_s, &message);
            }
        }
        assert!(self.sent <= MOST_SENT, "more than {MOST_SENT} messages");
    }

    /// Time passes, with every deadline on the way.
    fn wait_until(&mut self, t_s: f64) {
        while let Some(deadline) = self.upload.deadline().filter(|d| *d <= t_s) {
            self.now_s = self.now_s.max(deadline);
            let actions = self.upload.tick(self.now_s);
            self.act(actions);
        }
        self.now_s = t_s;
    }

    /// A message of the vehicle arrives.
    fn deliver(&mut self) {
        if let Some(message) = self.vehicle.next_message(self.now_s) {
            let actions = self.upload.receive(self.now_s, &envelope(message));
            self.act(actions);
        }
    }

    /// Takes a step; true where it brings something that no honest vehicle has said.
    fn step(&mut self, number: usize, step: &Step) -> bool {
        self.wait_until(self.now_s + f64::from(step.wait_ms) * 1e-3);
        match step.kind() {
            Kind::Frame => {
                let Some(frame) = step.frame(number as u8) else { return false };
                if let Some(vehicle) = Vehicle::from_heartbeat(&frame) {
                    let actions = self.upload.vehicle_state(self.now_s, vehicle.state);
                    self.act(actions);
                }
                if let Some(envelope) = codec::decode(&frame) {
                    let actions = self.upload.receive(self.now_s, &envelope);
                    self.act(actions);
                    return true;
                }
            }
            Kind::Deliver => self.deliver(),
            Kind::Lose => _ = self.vehicle.next_message(self.now_s),
            Kind::Repeat => self.vehicle.delay(true),
            Kind::Delay => self.vehicle.delay(false),
            Kind::Cancel => {
                let actions = self.upload.cancel(self.now_s, "it was cancelled");
                self.act(actions);
            }
            Kind::Again => {
                let actions = self.upload.link_restored(self.now_s);
                self.act(actions);
            }
        }
        false
    }

    /// Everything is answered from now on.
    fn finish(&mut self) {
        let until = self.now_s + PATIENCE_S;
        while self.upload.outcome().is_none() {
            assert!(self.now_s < until, "no end, {:?}", self.upload.phase());
            self.deliver();
            if self.vehicle.is_silent() {
                self.wait_until(self.upload.deadline().map_or(until, |d| d.max(self.now_s)));
            }
        }
    }
}

/// A verified upload. The first two bytes are the numbers of items of the new mission and the one before, the rest is a script. It ends;
/// and where nobody lied, what it states is what the vehicle has.
pub fn transfer(data: &[u8]) -> bool {
    let Some((&[new, old], rest)) = data.split_first_chunk() else { return false };
    let (new, old) = (mission(new % 40, 0.0), mission(old % 40, 20.0));
    let vehicle = HonestVehicle::new(old.wire_items(FIRMWARE));
    let (upload, actions) = VerifiedUpload::start(
        Peers::new(ME, VEHICLE),
        FIRMWARE,
        Options::default(),
        new.clone(),
        Some(ON_THE_GROUND),
        0.0,
    );
    let mut run = Run { upload, vehicle, now_s: 0.0, sent: 0 };
    run.act(actions);
    let mut lies = false;
    for (number, step) in script::read(rest).iter().enumerate() {
        lies |= run.step(number, step);
    }
    run.finish();
    let has = |mission: &Mission| {
        let stored = run.vehicle.stored.get(&0).map(Vec::as_slice).unwrap_or_default();
        let on_board = Mission::from_wire_list(MissionKind::Mission, FIRMWARE, stored);
        differences(FIRMWARE, mission, &on_board).is_empty()
    };
    match run.upload.outcome() {
        _ if lies => {}
        Some(Outcome::Verified { .. }) => assert!(has(&new), "stated verified"),
        Some(Outcome::RestoredPrevious { why }) => assert!(has(&old), "stated restored: {why}"),
        Some(Outcome::Foreign { on_vehicle, .. }) => panic!("nobody else was there: {on_vehicle}"),
        Some(Outcome::Unknown { on_vehicle, .. }) => assert!(on_vehicle.contains("UNKNOWN"), "{on_vehicle}"),
        None => unreachable!("finished above"),
    }
    matches!(run.upload.outcome(), Some(Outcome::Verified { .. }))
}

/// The reading of parameters. It ends, whatever comes.
pub fn parameters(data: &[u8]) -> bool {
    let names = ["FENCE_ENABLE", "FENCE_ACTION", "GF_ACTION"];
    let names: Vec<ParamName> = names.iter().filter_map(|n| n.parse().ok()).collect();
    let (mut read, first) = ParamRead::start(Encoding::of(FIRMWARE), ParamTiming::default(), names, 0.0);
    let (mut now_s, mut sent) = (0.0, first.len());
    for (number, step) in script::read(data).iter().enumerate() {
        now_s += f64::from(step.wait_ms) * 1e-3;
        while read.result().is_none() && read.deadline().is_some_and(|d| d <= now_s) {
            sent += read.tick(now_s).len();
        }
        if let Some(message) = step.frame(number as u8).as_ref().and_then(param_codec::decode) {
            sent += read.receive(now_s, &message).len();
        }
        assert!(sent <= MOST_SENT);
    }
    while let Some(deadline) = read.deadline().filter(|_| read.result().is_none()) {
        assert!(deadline < now_s + PATIENCE_S, "no end");
        sent += read.tick(deadline).len();
        assert!(sent <= MOST_SENT);
    }
    read.result().is_some_and(|r| !r.is_silent())
}

/// Parameters as a vehicle sends them, and more of what it sends.
pub fn parameter_seeds() -> Vec<Vec<u8>> {
    let value = |(k, name): (u16, &str)| {
        let kind = if k == 0 { ParamType::U8 } else { ParamType::I32 };
        let name = name.parse().ok()?;
        let value = ParamMessage::Value { name, bits: 1, kind: Some(kind), count: 900, index: k };
        let (id, payload) = param_codec::encode(ME, &value);
        let from = (VEHICLE.system, VEHICLE.component);
        Some(Step { kind: Kind::Frame.byte(), wait_ms: 200, from, message_id: id, payload })
    };
    let names = ["FENCE_ENABLE", "FENCE_ACTION", "GF_ACTION", "OTHER"];
    let steps: Vec<Step> = (0..).zip(names).filter_map(value).collect();
    let late: Vec<Step> = steps.iter().map(|s| Step { wait_ms: 3000, ..s.clone() }).collect();
    let others: Vec<Step> = honest_frames().iter().map(|f| Step::of_frame(f, 50)).collect();
    [steps.clone(), late, [steps, others].concat()].map(|steps| script::write(&steps)).to_vec()
}

/// A whole transfer, the same with faults, and messages that nobody asked for.
pub fn seeds() -> Vec<Vec<u8>> {
    let deliver = |n: usize| vec![Step::of(Kind::Deliver, 20); n];
    let lies: Vec<Step> = honest_frames().iter().map(|f| Step::of_frame(f, 50)).collect();
    let mut faults = deliver(60);
    for (k, kind) in [Kind::Lose, Kind::Repeat, Kind::Delay].iter().cycle().take(12).enumerate() {
        if let Some(step) = faults.get_mut(5 * k) {
            step.kind = kind.byte();
        }
    }
    let cancelled = [deliver(30), vec![Step::of(Kind::Cancel, 20)], deliver(60)].concat();
    let lost =
        [deliver(25), vec![Step::of(Kind::Lose, 60_000); 20], vec![Step::of(Kind::Again, 20)], deliver(60)];
    let mixed = [deliver(20), lies.clone(), deliver(20), lies.clone(), deliver(80)].concat();
    [deliver(120), faults, cancelled, lost.concat(), mixed, lies]
        .map(|steps| [vec![12, 7], script::write(&steps)].concat())
        .to_vec()
}
