//! The parameter machines over any link: reading all parameters, and the verified change.

use super::param_codec;
use super::wire::{Event, Wire, heartbeat_of};
use crate::link::frame::Frame;
use gaware_mission::params::apply::{ApplyOutcome, ApplyPhase, ApplyTiming, Pair, ParamApply, Wanted};
use gaware_mission::params::list::{AllParameters, ListError, ParamList};
use gaware_mission::params::{Encoding, ParamMessage, ParamTiming};

/// Attempts of each request while a list is read.
const LIST_TRIES: u32 = 10;

/// What a change reports on its way.
#[derive(Debug, Clone, PartialEq)]
pub enum ParamEvent {
    /// A new phase began.
    Phase(ApplyPhase),
    /// Old and new values are not all on board, or not known; waiting for the link or for the vehicle to disarm.
    Waiting(String),
}

/// Reads all parameters; `Ok(None)` when the user wants to stop.
///
/// # Errors
/// The vehicle does not answer, or not for all of them.
pub async fn list(
    wire: &mut impl Wire,
    mut tell: impl FnMut(usize, usize),
) -> Result<Option<AllParameters>, ListError> {
    let encoding = Encoding::of(wire.vehicle().autopilot);
    let timing = ParamTiming { tries: LIST_TRIES, ..ParamTiming::default() };
    let (mut list, mut messages) = ParamList::start(encoding, timing, wire.now_s());
    loop {
        send(wire, &messages);
        if let Some(result) = list.result() {
            return result.clone().map(Some);
        }
        messages = match wire.next(list.deadline()).await {
            Event::Frame(frame) => {
                value_of(wire, &frame).map_or_else(Vec::new, |m| list.receive(wire.now_s(), &m))
            }
            Event::Deadline => list.tick(wire.now_s()),
            Event::Stopped => return Ok(None),
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
    tell: impl FnMut(ParamEvent),
) -> ApplyOutcome {
    let vehicle = wire.vehicle();
    let (apply, messages) = ParamApply::start(
        Encoding::of(vehicle.autopilot),
        ApplyTiming::default(),
        wanted,
        Some(vehicle.state.armed),
        wire.now_s(),
    );
    drive(wire, (apply, messages), patience_s, keep, tell).await
}

/// Takes up a change that was interrupted: puts the old values back.
pub async fn resume(
    wire: &mut impl Wire,
    pairs: Vec<Pair>,
    patience_s: f64,
    tell: impl FnMut(ParamEvent),
) -> ApplyOutcome {
    let vehicle = wire.vehicle();
    let (apply, messages) = ParamApply::resume(
        Encoding::of(vehicle.autopilot),
        ApplyTiming::default(),
        pairs,
        Some(vehicle.state.armed),
        wire.now_s(),
    );
    drive(wire, (apply, messages), patience_s, |_| Ok(()), tell).await
}

async fn drive(
    wire: &mut impl Wire,
    (mut apply, mut messages): (ParamApply, Vec<ParamMessage>),
    patience_s: f64,
    mut keep: impl FnMut(&[Pair]) -> Result<(), String>,
    mut tell: impl FnMut(ParamEvent),
) -> ApplyOutcome {
    let (mut kept, mut phase, mut since, mut stopping) = (false, None, None, false);
    loop {
        if let Some(pairs) = apply.backup().filter(|_| !kept) {
            if let Err(why) = keep(pairs) {
                return ApplyOutcome::Previous { why: format!("the old values could not be kept: {why}") };
            }
            kept = true;
        }
        send(wire, &messages);
        if phase != Some(apply.phase()) {
            phase = Some(apply.phase());
            tell(ParamEvent::Phase(apply.phase()));
        }
        match apply.outcome() {
            Some(outcome @ ApplyOutcome::Mixed { .. }) => {
                if since.is_none() {
                    tell(ParamEvent::Waiting(outcome.to_string()));
                }
                let since: f64 = *since.get_or_insert(wire.now_s());
                if stopping || wire.now_s() - since > patience_s {
                    return outcome.clone();
                }
            }
            Some(outcome) => return outcome.clone(),
            None => {}
        }
        messages = match wire.next(apply.deadline()).await {
            Event::Frame(frame) => take(wire, &mut apply, &frame),
            Event::Deadline => apply.tick(wire.now_s()),
            Event::Stopped => {
                stopping = true;
                apply.cancel(wire.now_s())
            }
        };
    }
}

fn take(wire: &impl Wire, apply: &mut ParamApply, frame: &Frame) -> Vec<ParamMessage> {
    let now = wire.now_s();
    if let Some(vehicle) = heartbeat_of(wire.vehicle(), frame) {
        apply.set_armed(vehicle.state.armed);
        return apply.link_restored(now);
    }
    value_of(wire, frame).map_or_else(Vec::new, |message| apply.receive(now, &message))
}

/// A value that this vehicle sent.
fn value_of(wire: &impl Wire, frame: &Frame) -> Option<ParamMessage> {
    let address = wire.vehicle().address;
    let own = (frame.system_id, frame.component_id) == (address.system, address.component);
    if own { param_codec::decode(frame) } else { None }
}

fn send(wire: &mut impl Wire, messages: &[ParamMessage]) {
    for message in messages {
        let (id, payload) = param_codec::encode(wire.vehicle().address, message);
        wire.send_payload(id, payload);
    }
}
