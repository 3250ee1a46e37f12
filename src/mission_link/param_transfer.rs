//! The parameter machines over any link: reading all parameters, and the verified change.

use super::param_codec;
use super::vehicle::Vehicle;
use super::wire::{Event, News, VerifiedChange, Wire, drive};
use crate::link::frame::Frame;
use gaware_mission::params::apply::{ApplyOutcome, ApplyPhase, ApplyTiming, Pair, ParamApply, Wanted};
use gaware_mission::params::list::{AllParameters, ListError, ParamList};
use gaware_mission::params::{Encoding, ParamMessage, ParamTiming};
use gaware_mission::transfer::Address;
use gaware_mission::transfer::verified::VehicleState;

/// Attempts of each request while a list is read.
const LIST_TRIES: u32 = 10;

/// Reads all parameters.
///
/// # Errors
/// The vehicle does not answer, or not for all of them; or it is not to go on.
pub async fn list(
    wire: &mut impl Wire,
    mut tell: impl FnMut(usize, usize),
) -> Result<AllParameters, ListError> {
    let encoding = Encoding::of(wire.vehicle().autopilot);
    let timing = ParamTiming { tries: LIST_TRIES, ..ParamTiming::default() };
    let (mut list, mut messages) = ParamList::start(encoding, timing, wire.now_s());
    loop {
        send(wire, &messages);
        if let Some(result) = list.result() {
            return result.clone();
        }
        messages = match wire.next(list.deadline()).await {
            Event::Frame(frame) => value_of(wire.vehicle().address, &frame)
                .map_or_else(Vec::new, |m| list.receive(wire.now_s(), &m)),
            Event::Deadline => list.tick(wire.now_s()),
            Event::Stopped(why) | Event::Abandoned(why) => return Err(ListError::Stopped(why)),
        };
        // With its result the list has given away what it counts.
        if list.result().is_none() {
            let (done, count) = list.progress();
            tell(done, count);
        }
    }
}

/// Changes parameters: backs up, sets, reads back, restores on failure. `keep` gets old and new values before anything is changed; if it
/// cannot keep them, nothing is. Uncertain values are settled when the vehicle sends again within `patience_s`.
pub async fn apply(
    wire: &mut impl Wire,
    wanted: Vec<Wanted>,
    patience_s: f64,
    keep: impl FnMut(&[Pair]) -> Result<(), String>,
    tell: impl FnMut(News<ApplyPhase>),
) -> ApplyOutcome {
    let vehicle = wire.vehicle();
    let begun = ParamApply::start(
        Encoding::of(vehicle.autopilot),
        ApplyTiming::default(),
        wanted,
        Some(vehicle.state.armed),
        wire.now_s(),
    );
    drive(wire, begun, patience_s, keep, tell).await
}

/// Takes up a change that was interrupted: puts the old values back.
pub async fn resume(
    wire: &mut impl Wire,
    pairs: Vec<Pair>,
    patience_s: f64,
    tell: impl FnMut(News<ApplyPhase>),
) -> ApplyOutcome {
    let vehicle = wire.vehicle();
    let begun = ParamApply::resume(
        Encoding::of(vehicle.autopilot),
        ApplyTiming::default(),
        pairs,
        Some(vehicle.state.armed),
        wire.now_s(),
    );
    drive(wire, begun, patience_s, |_| Ok(()), tell).await
}

impl VerifiedChange for ParamApply {
    type Phase = ApplyPhase;
    type Outcome = ApplyOutcome;
    type Backup = [Pair];
    type Action = ParamMessage;

    fn phase(&self) -> ApplyPhase {
        self.phase()
    }

    fn outcome(&self) -> Option<&ApplyOutcome> {
        self.outcome()
    }

    fn is_open(outcome: &ApplyOutcome) -> bool {
        matches!(outcome, ApplyOutcome::Mixed { .. })
    }

    fn untouched(why: String) -> ApplyOutcome {
        ApplyOutcome::Previous { why }
    }

    fn backup(&self) -> Option<&[Pair]> {
        self.backup()
    }

    fn deadline(&self) -> Option<f64> {
        self.deadline()
    }

    fn heartbeat(&mut self, now_s: f64, state: VehicleState) -> Vec<ParamMessage> {
        self.set_armed(state.armed);
        self.link_restored(now_s)
    }

    fn frame(&mut self, now_s: f64, vehicle: &Vehicle, frame: &Frame) -> Vec<ParamMessage> {
        value_of(vehicle.address, frame).map_or_else(Vec::new, |message| self.receive(now_s, &message))
    }

    fn tick(&mut self, now_s: f64) -> Vec<ParamMessage> {
        self.tick(now_s)
    }

    fn cancel(&mut self, now_s: f64, why: &str) -> Vec<ParamMessage> {
        self.cancel(now_s, why)
    }

    fn abandon(&mut self, why: &str) {
        self.abandon(why);
    }

    fn message(action: &ParamMessage, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)> {
        Ok(param_codec::encode(to, action))
    }
}

/// A value that this vehicle sent.
fn value_of(address: Address, frame: &Frame) -> Option<ParamMessage> {
    let own = (frame.system_id, frame.component_id) == (address.system, address.component);
    if own { param_codec::decode(frame) } else { None }
}

fn send(wire: &mut impl Wire, messages: &[ParamMessage]) {
    for message in messages {
        let (id, payload) = param_codec::encode(wire.vehicle().address, message);
        wire.send_payload(id, payload);
    }
}
