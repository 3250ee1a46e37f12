//! What is asked of a vehicle before something is sent to it: version, position, parameters, messages that it can send. Requests only; nothing of the
//! vehicle is changed.

use super::param_transfer;
use super::vehicle::Vehicle;
use super::wire::{Event, Wire};
use crate::link::frame::Frame;
use crate::preflight::{Facts, StreamFact};
use gaware_mission::item::{Autopilot, LatLon};
use gaware_mission::params::ParamName;

pub(super) const COMMAND_LONG: u32 = 76;
pub(super) const COMMAND_ACK: u32 = 77;
const AUTOPILOT_VERSION: u32 = 148;
const GLOBAL_POSITION_INT: u32 = 33;
const GPS_RAW_INT: u32 = 24;
const MISSION_CURRENT: u32 = 42;
/// `MAV_CMD_REQUEST_MESSAGE`.
const REQUEST_MESSAGE: u16 = 512;
/// `MAV_RESULT_ACCEPTED`.
const ACCEPTED: u8 = 0;
/// Wait for the answer to a command, s; and for all attempts, with an acknowledgement and without: a link that loses a fifth each way loses six answers
/// running once in 500 times.
const ANSWER_S: f64 = 0.7;
const ACKNOWLEDGED_S: f64 = 2.0 * ANSWER_S;
const SILENT_S: f64 = 6.0 * ANSWER_S;
/// PX4 denies a message of which nothing was published since it last looked: it is asked again after this, s, its slowest stream here (GNSS, 5 Hz)
/// having had its turn.
const AGAIN_S: f64 = 0.25;
/// PX4 sends `MISSION_CURRENT` once a second, and not on request.
const EVERY_SECOND_S: f64 = 1.5;
/// A position fix in `GPS_RAW_INT`: two dimensions at least.
const FIX_2D: u8 = 2;

/// What is wanted.
#[derive(Debug, Clone, Default)]
pub struct Wish {
    /// Parameters.
    pub parameters: Vec<ParamName>,
    /// Messages that are to be requested once, by id and name.
    pub streams: Vec<(u32, &'static str)>,
}

/// Asks for all of it.
///
/// # Errors
/// Why it is not to go on: the user wants to stop, or it is not certain who answers.
pub async fn gather(wire: &mut impl Wire, wish: Wish) -> Result<Facts, String> {
    let mut facts = Facts::new(wire.vehicle());
    // Every answer to a request shows that requests are answered at all.
    let answered = request(wire, AUTOPILOT_VERSION, &mut facts).await?;
    if answered != Answer::Silence {
        request(wire, GLOBAL_POSITION_INT, &mut facts).await?;
        if facts.position.is_none() {
            request(wire, GPS_RAW_INT, &mut facts).await?;
        }
        for (id, name) in wish.streams {
            let works = request(wire, id, &mut facts).await? == Answer::Arrived;
            facts.streams.push(StreamFact { name, works });
        }
        if facts.current_item.is_none() {
            request(wire, MISSION_CURRENT, &mut facts).await?;
        }
    }
    if facts.current_item.is_none() {
        let until = wire.now_s() + EVERY_SECOND_S;
        listen(wire, until, &mut facts, |frame| frame.message_id == MISSION_CURRENT).await?;
    }
    facts.parameters = param_transfer::read(wire, wish.parameters).await?;
    Ok(facts)
}

/// What came of a request for a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// The message: the only proof that the vehicle sends it.
    Arrived,
    /// An acknowledgement alone.
    Acknowledged,
    /// Nothing.
    Silence,
}

/// Asks for one message.
async fn request(wire: &mut impl Wire, id: u32, facts: &mut Facts) -> Result<Answer, String> {
    // PX4 denies also what it only has nothing new of.
    let denial_ends = wire.vehicle().autopilot != Autopilot::Px4;
    let (mut answer, begun_s) = (Answer::Silence, wire.now_s());
    while wire.now_s() < begun_s + if answer == Answer::Silence { SILENT_S } else { ACKNOWLEDGED_S } {
        let (command, payload) = message_request(wire.vehicle(), id);
        wire.send_payload(command, payload);
        let (mut result, mut arrived) = (None, false);
        let until = wire.now_s() + ANSWER_S;
        // The message comes before or after the acknowledgement.
        let over = |frame: &Frame| {
            arrived |= frame.message_id == id;
            result = result.or_else(|| acknowledged(frame, REQUEST_MESSAGE));
            arrived && result.is_some() || result.is_some_and(|r| r != ACCEPTED)
        };
        listen(wire, until, facts, over).await?;
        let refused = result.is_some_and(|r| r != ACCEPTED);
        if refused && !arrived && !denial_ends {
            let until = wire.now_s() + AGAIN_S;
            let over = |frame: &Frame| {
                arrived |= frame.message_id == id;
                arrived
            };
            listen(wire, until, facts, over).await?;
        }
        if arrived {
            return Ok(Answer::Arrived);
        }
        if result.is_some() {
            answer = Answer::Acknowledged;
        }
        if refused && denial_ends {
            break;
        }
    }
    Ok(answer)
}

/// Takes what the vehicle sends until then, or until it is over.
async fn listen(
    wire: &mut impl Wire,
    until_s: f64,
    facts: &mut Facts,
    mut over: impl FnMut(&Frame) -> bool,
) -> Result<(), String> {
    while wire.now_s() < until_s {
        match wire.next(Some(until_s)).await {
            Event::Frame(frame) if wire.vehicle().sent(&frame) => {
                see(&frame, facts);
                if over(&frame) {
                    break;
                }
            }
            Event::Frame(_) | Event::Deadline => {}
            Event::Stopped(why) | Event::Abandoned(why) => return Err(why),
        }
    }
    Ok(())
}

/// The wish for one message, by id and payload.
pub(super) fn message_request(vehicle: Vehicle, id: u32) -> (u32, Vec<u8>) {
    (COMMAND_LONG, command_long(vehicle, REQUEST_MESSAGE, id as f32))
}

/// `COMMAND_LONG` with one parameter.
pub(super) fn command_long(vehicle: Vehicle, command: u16, param1: f32) -> Vec<u8> {
    let mut b = param1.to_le_bytes().to_vec();
    b.resize(28, 0);
    b.extend(command.to_le_bytes());
    b.extend([vehicle.address.system, vehicle.address.component, 0]);
    b
}

fn acknowledged(frame: &Frame, command: u16) -> Option<u8> {
    let at = |k: usize| frame.payload().get(k).copied().unwrap_or(0);
    let about = u16::from_le_bytes([at(0), at(1)]) == command;
    (frame.message_id == COMMAND_ACK && about).then(|| at(2))
}

/// Takes what a frame says of version, position and mission.
pub fn see(frame: &Frame, facts: &mut Facts) {
    let payload = frame.payload();
    // MAVLink 2 leaves zeros at the end out.
    let at = |k: usize| payload.get(k).copied().unwrap_or(0);
    let integer = |k: usize| i32::from_le_bytes([at(k), at(k + 1), at(k + 2), at(k + 3)]);
    let place = |k: usize| {
        let place = LatLon::from_e7(integer(k), integer(k + 4));
        let known = (integer(k), integer(k + 4)) != (0, 0) && place.is_valid();
        known.then_some(place)
    };
    match frame.message_id {
        // capabilities (8), uid (8), flight_sw_version: type, patch, minor, major.
        AUTOPILOT_VERSION => facts.firmware = Some([at(19), at(18), at(17)]),
        // time_boot_ms (4), lat, lon.
        GLOBAL_POSITION_INT => facts.position = place(4).or(facts.position),
        MISSION_CURRENT => facts.current_item = Some(u16::from_le_bytes([at(0), at(1)])),
        // time_usec (8), lat, lon, alt, …, fix_type at 28.
        GPS_RAW_INT if at(28) >= FIX_2D => facts.position = facts.position.or(place(8)),
        _ => {}
    }
}
