//! What every verified change of a vehicle has in common, whether of a mission, a fence, rally points or parameters: back up what is on board,
//! send, read back and compare, restore on failure, and end with a statement of what is on the vehicle. Events in, actions out.

use std::fmt::Display;

/// What a change is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading what is on the vehicle.
    BackingUp,
    /// Sending what is new.
    Sending,
    /// Reading back and comparing, after all was sent or after a failure.
    ReadingBack,
    /// Putting back what was there before.
    Restoring,
    /// Over, or waiting for the link or for a vehicle that may be changed.
    Finished,
}

/// What the caller knows about the vehicle from its heartbeat and `MISSION_CURRENT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VehicleState {
    /// Whether the motors are armed.
    pub armed: bool,
    /// Whether its mode flies missions (AUTO, AUTO.MISSION).
    pub mission_mode: bool,
    /// Whether it says that a mission is being flown.
    pub flying_mission: bool,
    /// Whether it runs PX4 and is in the air in whatever mode: in AUTO.LOITER or AUTO.RTL a new mission changes what comes next.
    pub in_flight: bool,
}

impl VehicleState {
    /// Why the mission of a vehicle in this state must not be replaced.
    pub fn objection(self) -> Option<&'static str> {
        if self.flying_mission && self.armed {
            Some("the vehicle is flying a mission; replacing it in flight can send it anywhere")
        } else if self.armed && self.mission_mode {
            Some("the vehicle is armed in the mission mode and would start to fly whatever arrives")
        } else if self.in_flight && self.armed {
            Some("the vehicle is armed and in the air; its way home may lead through the mission")
        } else {
            None
        }
    }
}

/// One side of a protocol: feed it with messages and times, and send what it returns.
pub trait Exchange {
    /// What it asks its caller to do.
    type Action;
    /// What it takes from the vehicle.
    type Message;

    /// When [`Self::tick`] wants to be called, s.
    fn deadline(&self) -> Option<f64>;
    /// A message from anyone.
    fn receive(&mut self, now: f64, message: &Self::Message) -> Vec<Self::Action>;
    /// Time passed.
    fn tick(&mut self, now: f64) -> Vec<Self::Action>;
}

/// A verified change under way; it wants to know the state of the vehicle as well.
pub trait VerifiedChange: Exchange {
    /// What is on the vehicle at the end.
    type Outcome: Clone + Display;
    /// What was on board before.
    type Backup: ?Sized;

    /// What it is doing.
    fn phase(&self) -> Phase;
    /// What is on the vehicle, once that can be said.
    fn outcome(&self) -> Option<&Self::Outcome>;
    /// Whether this outcome may be settled when the link or the state of the vehicle changes.
    fn is_open(outcome: &Self::Outcome) -> bool;
    /// Nothing was changed.
    fn untouched(why: String) -> Self::Outcome;
    /// What was on board before, once it has been read; keep it before anything that is returned with it is sent.
    fn backup(&self) -> Option<&Self::Backup>;
    /// The vehicle's state as its heartbeat says. Where it is not to be changed any more the change stops.
    fn vehicle_state(&mut self, now: f64, state: VehicleState) -> Vec<Self::Action>;
    /// The change is not wanted any more, for this reason: what was there before is put back if anything was changed.
    fn cancel(&mut self, now: f64, why: &str) -> Vec<Self::Action>;
    /// It is not certain any more who answers: nothing is sent from now on.
    fn abandon(&mut self, why: &str);
    /// The link is back, or the vehicle may be changed again: an outcome that is open is settled.
    fn link_restored(&mut self, now: f64) -> Vec<Self::Action>;
}
