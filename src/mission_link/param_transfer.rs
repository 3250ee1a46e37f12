//! The parameter machines over any link: reading all parameters, and the verified change.

use super::param_codec;
use super::wire::{Incoming, News, Outgoing, Wire, drive, read_out};
use crate::link::frame::Frame;
use gaware_mission::params::apply::{ApplyOutcome, ApplyTiming, Pair, ParamApply, Wanted};
use gaware_mission::params::list::{AllParameters, ListError, ParamList};
use gaware_mission::params::{Encoding, ParamMessage, ParamName, ParamRead, ParamTiming, Parameters};
use gaware_mission::transfer::Address;

/// Reads all parameters.
///
/// # Errors
/// The vehicle does not answer, or not for all of them; or it is not to go on.
pub async fn list(
    wire: &mut impl Wire,
    mut tell: impl FnMut(usize, usize),
) -> Result<AllParameters, ListError> {
    let encoding = Encoding::of(wire.vehicle().autopilot);
    let begun = ParamList::start(encoding, ParamTiming::default(), wire.now_s());
    let over = |list: &ParamList| {
        // With its result the list has given away what it counts.
        if list.result().is_none() {
            let (done, count) = list.progress();
            tell(done, count);
        }
        list.result().cloned()
    };
    read_out(wire, begun, over).await.unwrap_or_else(|(_, why)| Err(ListError::Stopped(why)))
}

/// Reads these parameters.
///
/// # Errors
/// Why it is not to go on: the user wants to stop, or it is not certain who answers.
pub async fn read(wire: &mut impl Wire, names: Vec<ParamName>) -> Result<Parameters, String> {
    let encoding = Encoding::of(wire.vehicle().autopilot);
    let begun = ParamRead::start(encoding, ParamTiming::default(), names, wire.now_s());
    read_out(wire, begun, |read| read.result().cloned()).await.map_err(|(_, why)| why)
}

/// Changes parameters: backs up, sets, reads back, restores on failure. `keep` gets old and new values before anything is changed; if it
/// cannot keep them, nothing is. Uncertain values are settled when the vehicle sends again within `patience_s`.
pub async fn apply(
    wire: &mut impl Wire,
    wanted: Vec<Wanted>,
    patience_s: f64,
    keep: impl FnMut(&[Pair]) -> Result<(), String>,
    tell: impl FnMut(News),
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
    tell: impl FnMut(News),
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

impl Incoming for ParamMessage {
    fn read(vehicle: Address, frame: &Frame) -> Option<Self> {
        let from = Address { system: frame.system_id, component: frame.component_id };
        param_codec::decode(frame).filter(|_| from == vehicle)
    }
}

impl Outgoing for ParamMessage {
    fn message(&self, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)> {
        Ok(param_codec::encode(to, self))
    }
}
