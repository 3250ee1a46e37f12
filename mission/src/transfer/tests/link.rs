//! A link with faults by seed, in virtual time, and the loop that joins an upload with a vehicle.

use super::vehicle::Vehicle;
use super::*;

/// SplitMix64 (Steele 2014): enough for faults.
pub struct Random(pub u64);

impl Random {
    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[derive(Clone, Copy)]
pub struct Faults {
    pub loss: f64,
    pub duplication: f64,
    pub reordering: f64,
    pub delay_s: f64,
}

impl Faults {
    pub const NONE: Self = Self { loss: 0.0, duplication: 0.0, reordering: 0.0, delay_s: 0.05 };
    pub const BAD: Self = Self { loss: 0.2, duplication: 0.05, reordering: 0.1, delay_s: 0.2 };
}

#[derive(Clone, Copy, PartialEq)]
enum To {
    Vehicle,
    Upload,
}

/// One upload over one link to one vehicle.
pub struct Run {
    pub now: f64,
    pub cut: bool,
    pub upload: VerifiedUpload,
    pub vehicle: Vehicle,
    pub progress: usize,
    pub items_sent: usize,
    random: Random,
    faults: Faults,
    in_flight: Vec<(f64, To, MissionMessage)>,
}

impl Run {
    pub fn start(
        seed: u64,
        faults: Faults,
        autopilot: Autopilot,
        vehicle: Vehicle,
        mission: Mission,
        state: Option<VehicleState>,
    ) -> Self {
        let (upload, actions) = VerifiedUpload::start(
            Peers::new(ME, VEHICLE),
            autopilot,
            Options::default(),
            mission,
            state,
            0.0,
        );
        Self::with(seed, faults, vehicle, upload, actions)
    }

    pub fn with(
        seed: u64,
        faults: Faults,
        vehicle: Vehicle,
        upload: VerifiedUpload,
        actions: Vec<Action>,
    ) -> Self {
        let random = Random(seed);
        let mut run = Self {
            now: 0.0,
            cut: false,
            upload,
            vehicle,
            progress: 0,
            items_sent: 0,
            random,
            faults,
            in_flight: Vec::new(),
        };
        run.perform(actions);
        run
    }

    fn perform(&mut self, actions: Vec<Action>) {
        for action in actions {
            match action {
                Action::Send(message) => {
                    self.items_sent += usize::from(matches!(message, MissionMessage::ItemInt { .. }));
                    self.transmit(To::Vehicle, message);
                }
                Action::Progress { done, .. } => self.progress = done,
            }
        }
    }

    fn transmit(&mut self, to: To, message: MissionMessage) {
        let copies = 1 + usize::from(self.random.unit() < self.faults.duplication);
        for _ in 0..copies {
            let late =
                if self.random.unit() < self.faults.reordering { self.random.unit() * 0.5 } else { 0.0 };
            let lost = self.random.unit() < self.faults.loss;
            if !lost && !self.cut {
                self.in_flight.push((self.now + self.faults.delay_s + late, to, message.clone()));
            }
        }
    }

    /// To the next event.
    pub fn step(&mut self) {
        let arrival = self.in_flight.iter().map(|m| m.0).fold(f64::INFINITY, f64::min);
        let upload = self.upload.deadline().unwrap_or(f64::INFINITY);
        let next = arrival.min(upload).min(self.vehicle.deadline()).min(self.now + 1.0);
        self.now = self.now.max(next);
        if let Some(k) = self.in_flight.iter().position(|m| m.0 <= self.now) {
            let (_, to, message) = self.in_flight.swap_remove(k);
            if self.cut {
                return;
            }
            if to == To::Vehicle {
                let replies = self.vehicle.receive(self.now, &message);
                replies.into_iter().for_each(|m| self.transmit(To::Upload, m));
            } else {
                let envelope = Envelope { from: VEHICLE, to: ME, message };
                let actions = self.upload.receive(self.now, &envelope);
                self.perform(actions);
            }
        }
        let actions = self.upload.tick(self.now);
        self.perform(actions);
        let replies = self.vehicle.tick(self.now);
        replies.into_iter().for_each(|m| self.transmit(To::Upload, m));
    }

    pub fn until(&mut self, time: f64) {
        while self.now < time {
            self.step();
        }
    }

    pub fn until_outcome(&mut self, patience_s: f64) {
        let limit = self.now + patience_s;
        while self.upload.outcome().is_none() && self.now < limit {
            self.step();
        }
    }

    /// Lets every late message arrive and the vehicle run into its own time limits.
    pub fn settle(&mut self) {
        self.until(self.now + 20.0);
    }

    pub fn link_restored(&mut self) {
        let actions = self.upload.link_restored(self.now);
        self.perform(actions);
    }

    pub fn vehicle_state(&mut self, state: VehicleState) {
        let actions = self.upload.vehicle_state(self.now, state);
        self.perform(actions);
    }

    pub fn cancel(&mut self) {
        let actions = self.upload.cancel(self.now, "it was cancelled");
        self.perform(actions);
    }
}
