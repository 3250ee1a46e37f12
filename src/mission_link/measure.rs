//! Samples and fixes of a vehicle on the ground over some seconds, for what they are worth ([`crate::pipeline::Quality`]). Rates are asked for as a run
//! does, and given back.

use super::wire::{Event, Wire};
use crate::link::frame::{Frame, Sender};
use crate::link::rates::{RateAction, RateKeeper, needs};
use crate::logs::{Item, Record};
use crate::pipeline::samples_of;
use crate::sensors::{Autopilot, ConverterOptions};
use gaware_mission::item;
use gaware_nav::sample::Sample;
use mavlink::dialects::ardupilotmega::MavMessage;

/// Longest wait between two looks at the rates, s.
const LOOK_S: f64 = 0.1;
/// Wait for the answer to a rate that is given back, s.
const GIVE_BACK_S: f64 = 0.7;

fn now_us(wire: &impl Wire) -> u64 {
    (wire.now_s().max(0.0) * 1e6) as u64
}

fn send(wire: &mut impl Wire, message: &MavMessage) {
    // Only the payload counts: the wire says who sends.
    let frame = Frame::encode(Sender { system_id: 1, component_id: 191 }, 0, message);
    wire.send_payload(frame.message_id, frame.payload().to_vec());
}

/// Listens for so long.
///
/// # Errors
/// The user wants to stop, or it is not certain who answers.
pub async fn listen(wire: &mut impl Wire, seconds: f64, imu_hz: u16) -> Result<Vec<Sample>, String> {
    let vehicle = wire.vehicle();
    let autopilot = match vehicle.autopilot {
        item::Autopilot::ArduPilot => Autopilot::Ardupilot,
        item::Autopilot::Px4 => Autopilot::Px4,
    };
    let mut keeper =
        RateKeeper::new(vehicle.address.system, autopilot, needs(autopilot, imu_hz, None), now_us(wire));
    let end_s = wire.now_s() + seconds;
    let mut records = Vec::new();
    while wire.now_s() < end_s {
        let mut actions = Vec::new();
        match wire.next(Some(end_s.min(wire.now_s() + LOOK_S))).await {
            Event::Frame(frame) => {
                keeper.receive(now_us(wire), &frame, &mut actions);
                records.push(Record { t_us: now_us(wire), item: Item::Frame(frame) });
            }
            Event::Deadline => {}
            Event::Stopped(why) | Event::Abandoned(why) => return Err(why),
        }
        keeper.poll(now_us(wire), &mut actions);
        for action in actions {
            if let RateAction::Send(message) = action {
                send(wire, &message);
            }
        }
    }
    for message in keeper.give_back() {
        send(wire, &message);
        let until_s = wire.now_s() + GIVE_BACK_S;
        while wire.now_s() < until_s {
            match wire.next(Some(until_s)).await {
                Event::Frame(frame) if frame.message_id == super::facts::COMMAND_ACK => break,
                Event::Frame(_) | Event::Deadline => {}
                Event::Stopped(why) | Event::Abandoned(why) => return Err(why),
            }
        }
    }
    let options = ConverterOptions { vehicle: Some(vehicle.address.system), source: None };
    Ok(samples_of(&records, options))
}
