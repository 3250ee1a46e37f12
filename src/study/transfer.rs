//! Mission uploads over bad links, many times: does every one end verified, or with the previous mission back, or with words
//! that say that no one knows? The session of `gaware mission upload` runs against the simulated autopilot in virtual
//! time, and what it says at the end is compared with what really is on the vehicle.

use crate::link::frame::Frame;
use crate::link::heartbeat::HeartbeatSource;
use crate::mission_link::vehicle::Vehicle;
use crate::mission_link::wire::{self, Event, Wire, at_once};
use crate::parallel::{Progress, map_runs};
use gaware_mission::compare::differences;
use gaware_mission::item::{
    Autopilot as Firmware, Frame as ItemFrame, Home, LatLon, Mission, MissionItem, command,
};
use gaware_mission::transfer::verified::{Options, Outcome};
use gaware_mission::transfer::{Address, Peers};
use gaware_nav::model::Model;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::{FaultyLink, LinkFaults};
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::sensors::SensorConfig;
use gaware_sitl::vehicle::VehicleConfig;
use serde::Serialize;
use std::collections::VecDeque;

/// One step of virtual time, s: the autopilot's loop at 100 Hz.
const STEP_S: f64 = 0.01;
/// What the faulty link does to every frame, each way.
const LOSS: f64 = 0.2;
const DUPLICATE: f64 = 0.05;
const REORDER: f64 = 0.1;
const DELAY_S: f64 = 0.2;
/// A cut begins within this time from the start of the upload, s: longer than most transfers take.
const CUT_WITHIN_S: f64 = 60.0;
/// A link that comes back does so within this time, s.
const CUT_FOR_S: (f64, f64) = (2.0, 240.0);
/// The session waits so long for a link that is gone, s.
const PATIENCE_S: f64 = 600.0;
/// Waits without a deadline end after this, s.
const BREATH_S: f64 = 0.1;
/// Most items of the two missions.
const MOST_ITEMS: f64 = 25.0;

/// What happens to the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Loss, duplicates, reordering and delay.
    Bad,
    /// The same, and cut at a random moment for a random time.
    Cut,
    /// The same, and cut at a random moment for good.
    CutForGood,
}

/// All uploads of one autopilot over one kind of link.
#[derive(Debug, Clone, Serialize)]
pub struct Tally {
    /// Whose habits the vehicle has: `ardupilot` or `px4`.
    pub autopilot: &'static str,
    /// What happens to the link.
    pub link: Link,
    /// Uploads.
    pub runs: usize,
    /// Ended verified, and the new mission is on the vehicle.
    pub verified: usize,
    /// Failed, and the previous mission is on the vehicle as is said.
    pub previous_back: usize,
    /// Ended with the statement that no one knows what is on the vehicle.
    pub unknown_and_said: usize,
    /// Of these the vehicle really holds neither mission.
    pub mixed_and_said: usize,
    /// Ended with a statement that is wrong: must be none.
    pub wrong_statement: usize,
    /// Longest virtual time, s.
    pub longest_s: f64,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct TransferStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// By autopilot and link.
    pub transfers: Vec<Tally>,
}

impl TransferStudy {
    /// Uploads that ended with a wrong statement.
    pub fn wrong(&self) -> usize {
        self.transfers.iter().map(|t| t.wrong_statement).sum()
    }
}

/// One table row per tally.
impl std::fmt::Display for TransferStudy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{:<10}{:<14}{:>6}{:>10}{:>15}{:>14}{:>7}{:>11}",
            "", "link", "runs", "verified", "previous back", "unknown, said", "wrong", "longest s"
        )?;
        for t in &self.transfers {
            let link = match t.link {
                Link::Bad => "bad",
                Link::Cut => "cut",
                Link::CutForGood => "cut for good",
            };
            writeln!(
                f,
                "{:<10}{link:<14}{:>6}{:>10}{:>15}{:>14}{:>7}{:>11.0}",
                t.autopilot,
                t.runs,
                t.verified,
                t.previous_back,
                t.unknown_and_said,
                t.wrong_statement,
                t.longest_s
            )?;
        }
        Ok(())
    }
}

/// Uploads with the seeds `seed … seed + runs − 1`, for both autopilots and each kind of link.
pub fn run(runs: usize, seed: u64, progress: &dyn Progress) -> TransferStudy {
    let kinds = [Flavour::ArduPilot, Flavour::Px4]
        .into_iter()
        .flat_map(|f| [Link::Bad, Link::Cut, Link::CutForGood].map(|l| (f, l)));
    let transfers = kinds.map(|(flavour, link)| {
        let ends = map_runs(runs, progress, |k| upload(flavour, link, seed + k as u64));
        let count = |end| ends.iter().filter(|(e, _)| *e == end).count();
        Tally {
            autopilot: match flavour {
                Flavour::ArduPilot => "ardupilot",
                Flavour::Px4 => "px4",
            },
            link,
            runs,
            verified: count(End::Verified),
            previous_back: count(End::PreviousBack),
            unknown_and_said: count(End::UnknownSaid) + count(End::MixedSaid),
            mixed_and_said: count(End::MixedSaid),
            wrong_statement: count(End::Wrong),
            longest_s: ends.iter().map(|(_, t)| *t).fold(0.0, f64::max),
        }
    });
    TransferStudy { schema: "gaware.study/1", transfers: transfers.collect() }
}

/// What an upload came to, checked against the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Verified,
    PreviousBack,
    UnknownSaid,
    MixedSaid,
    Wrong,
}

fn upload(flavour: Flavour, link: Link, seed: u64) -> (End, f64) {
    let mut dice = Noise::new(seed, Purpose::Link);
    let mut draw = |low: f64, high: f64| low + (high - low) * dice.uniform();
    let [previous, new] = [0.01, 0.02].map(|away| mission(draw(1.0, MOST_ITEMS) as usize, away));
    let (cut_at, cut_for) = (draw(0.0, CUT_WITHIN_S), draw(CUT_FOR_S.0, CUT_FOR_S.1));
    let mut wire = VirtualWire::new(flavour, seed);
    let put = |wire: &mut VirtualWire, mission: &Mission| {
        let options = Options::default();
        at_once(wire::upload(wire, mission.clone(), options, PATIENCE_S, |_| Ok(()), |_| ()))
    };
    // Over a perfect link.
    put(&mut wire, &previous);
    let start_s = wire.now_s();
    let dropouts = match link {
        Link::Bad => Vec::new(),
        Link::Cut => vec![(start_s + cut_at, start_s + cut_at + cut_for)],
        Link::CutForGood => vec![(start_s + cut_at, f64::INFINITY)],
    };
    let faults = LinkFaults {
        loss: LOSS,
        duplicate: DUPLICATE,
        reorder: REORDER,
        delay_s: DELAY_S,
        dropouts,
        ..LinkFaults::default()
    };
    wire.spoil(faults, seed);
    let outcome = put(&mut wire, &new);
    let took_s = wire.now_s() - start_s;
    let on_board = wire.on_board();
    let holds = |mission| differences(wire.firmware(), mission, &on_board).is_empty();
    let end = match outcome {
        Outcome::Verified { .. } if holds(&new) => End::Verified,
        Outcome::RestoredPrevious { .. } if holds(&previous) => End::PreviousBack,
        Outcome::Unknown { .. } if holds(&new) || holds(&previous) => End::UnknownSaid,
        Outcome::Unknown { .. } => End::MixedSaid,
        _ => End::Wrong,
    };
    (end, took_s)
}

/// A mission whose places are no one else's.
fn mission(legs: usize, away_deg: f64) -> Mission {
    let place = |k: usize| LatLon { lat_deg: 47.397 + away_deg, lon_deg: 8.545 + 1e-4 * k as f64 };
    let legs = (0..legs).map(|k| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place(k), 50.0));
    Mission {
        home: Some(Home { lat_e7: 473_970_000, lon_e7: 85_450_000, alt_m: 441.0 }),
        items: legs.collect(),
    }
}

/// The simulated autopilot at the end of two faulty directions; waiting makes virtual time pass.
struct VirtualWire {
    autopilot: Autopilot,
    voice: HeartbeatSource,
    vehicle: Vehicle,
    up: FaultyLink,
    down: FaultyLink,
    heard: VecDeque<Frame>,
    now_s: f64,
}

impl VirtualWire {
    /// Connected, after the first heartbeat.
    fn new(flavour: Flavour, seed: u64) -> Self {
        let quad = VehicleConfig::multirotor();
        let config =
            AutopilotConfig { flavour, seed, loop_rate_hz: 1.0 / STEP_S, ..AutopilotConfig::default() };
        let perfect = |direction| FaultyLink::new(LinkFaults::default(), seed, direction);
        let mut wire = Self {
            autopilot: Autopilot::flying(config, quad, &Model::standard(), SensorConfig::default()),
            voice: HeartbeatSource::new(),
            vehicle: Vehicle::UNKNOWN,
            up: perfect(1),
            down: perfect(0),
            heard: VecDeque::new(),
            now_s: 0.0,
        };
        loop {
            wire.step();
            let seen = wire.heard.drain(..).find_map(|f| Vehicle::from_heartbeat(&f));
            if let Some(vehicle) = seen {
                wire.voice.belongs_to(vehicle.address.system);
                wire.vehicle = vehicle;
                return wire;
            }
        }
    }

    fn spoil(&mut self, faults: LinkFaults, seed: u64) {
        self.up = FaultyLink::new(faults.clone(), seed, 1);
        self.down = FaultyLink::new(faults, seed, 0);
    }

    fn firmware(&self) -> Firmware {
        self.vehicle.autopilot
    }

    fn step(&mut self) {
        self.now_s += STEP_S;
        for bytes in self.up.pop(self.now_s) {
            self.autopilot.receive(&bytes);
        }
        self.autopilot.step(self.now_s);
        for out in self.autopilot.take_output() {
            self.down.push(self.now_s, out.bytes);
        }
        let arrived = self.down.pop(self.now_s);
        self.heard.extend(arrived.into_iter().filter_map(|bytes| Frame::parse(bytes.into()).ok()));
    }

    /// What really is on the vehicle.
    fn on_board(&self) -> Mission {
        let items = self.autopilot.mission().iter().map(|i| MissionItem {
            command: i.command as u16,
            frame: ItemFrame(i.frame as u8),
            autocontinue: i.autocontinue != 0,
            params: [i.param1, i.param2, i.param3, i.param4],
            x: i.x,
            y: i.y,
            z: i.z,
        });
        Mission::from_wire_items(self.firmware(), &items.collect::<Vec<_>>())
    }
}

impl Wire for VirtualWire {
    fn vehicle(&self) -> Vehicle {
        self.vehicle
    }

    fn peers(&self) -> Peers {
        let sender = self.voice.sender();
        let me = Address { system: sender.system_id, component: sender.component_id };
        Peers::new(me, self.vehicle.address)
    }

    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn send_payload(&mut self, id: u32, payload: Vec<u8>) {
        if let Ok(frame) = self.voice.say_payload(id, &payload) {
            self.up.push(self.now_s, frame.raw().to_vec());
        }
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        let deadline_s = deadline_s.unwrap_or(self.now_s + BREATH_S);
        loop {
            if let Some(frame) = self.heard.pop_front() {
                if let Some(vehicle) = wire::heartbeat_of(self.vehicle, &frame) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::Silent;

    #[test]
    fn no_upload_over_a_bad_or_cut_link_leaves_a_mixed_mission_unsaid() {
        let study = run(12, 1, &Silent);
        assert_eq!(study.wrong(), 0, "{study}");
        for t in &study.transfers {
            assert_eq!(t.verified + t.previous_back + t.unknown_and_said, t.runs, "{study}");
            assert!(t.verified > 0, "{study}");
            // A link that is or comes back settles everything.
            assert!(t.link == Link::CutForGood || t.unknown_and_said == 0, "{study}");
        }
        let cut = |l| study.transfers.iter().filter(|t| t.link == l).map(|t| t.previous_back).sum::<usize>();
        assert!(cut(Link::Cut) > 0, "some were cut in the middle: {study}");
    }
}
