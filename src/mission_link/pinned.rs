//! A link of any kind, pinned to one vehicle: what is sent goes to it alone, what comes from elsewhere is kept away.

use super::facts::{COMMAND_LONG, command_long};
use super::pin::{Conflict, Pin};
use super::vehicle::Vehicle;
use super::wire::{Event, Wire};
use crate::link::endpoint::Origin;
use crate::link::frame::Frame;
use gaware_mission::identity::Identity;
use gaware_mission::transfer::{Address, Peers};
use std::future::Future;

/// A wait without a deadline ends after this, s.
const BREATH_S: f64 = 0.1;
/// Requests for the hardware id, and the time for the answers to each, s: of both, where two vehicles answer.
const ASKS: usize = 5;
const ANSWERS_S: f64 = 0.7;
/// `MAV_CMD_REQUEST_MESSAGE` with `AUTOPILOT_VERSION`, and what firmware before ArduPilot 4.0 and PX4 1.12 knows instead,
/// `MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES`.
const WAYS_TO_ASK: [(u16, f32); 2] = [(512, 148.0), (520, 1.0)];
/// `MAV_CMD_REQUEST_MESSAGE` with `HOME_POSITION`.
const ASK_HOME: (u16, f32) = (512, 242.0);
const HOME_POSITION: u32 = 242;

/// What a wait on a link ended with.
#[derive(Debug)]
pub enum RawEvent {
    /// A frame came from there.
    Frame(Origin, Frame),
    /// Its time is over.
    Deadline,
    /// The user wants to stop; reported once.
    Stopped,
}

/// A link with anyone on it.
pub trait RawWire {
    /// Any monotonic time, s.
    fn now_s(&self) -> f64;
    /// Under which ids this program speaks.
    fn me(&self) -> Address;
    /// Sends a message by its id and payload to one place alone, where the link can do that.
    fn send_to(&mut self, to: Origin, id: u32, payload: Vec<u8>);
    /// The next frame, or the end of the wait.
    fn next_of_all(&mut self, deadline_s: f64) -> impl Future<Output = RawEvent> + Send;
}

/// The link to one vehicle.
#[derive(Debug)]
pub struct Pinned<R> {
    /// The link.
    pub raw: R,
    pin: Pin,
    home: Option<[f64; 2]>,
    asked: usize,
}

impl<R: RawWire + Send> Pinned<R> {
    /// To the vehicle of a heartbeat that came from there.
    pub fn new(raw: R, vehicle: Vehicle, origin: Origin) -> Self {
        let pin = Pin::new(vehicle, origin, raw.now_s());
        Self { raw, pin, home: None, asked: 0 }
    }

    /// From now on to this vehicle.
    pub fn pin_to(&mut self, vehicle: Vehicle, origin: Origin) {
        self.pin = Pin::new(vehicle, origin, self.raw.now_s());
        self.home = None;
    }

    /// Where the vehicle is.
    pub fn origin(&self) -> Origin {
        self.pin.origin()
    }

    /// Asks for its hardware id, and waits for the answer of a second vehicle with the same ids.
    ///
    /// # Errors
    /// Two vehicles have the same ids, or the user wants to stop.
    pub async fn identify(&mut self) -> Result<(), String> {
        for attempt in 0..ASKS {
            self.command(self.pin.origin(), WAYS_TO_ASK[attempt % WAYS_TO_ASK.len()]);
            self.command(self.pin.origin(), ASK_HOME);
            let until = self.now_s() + ANSWERS_S;
            loop {
                match self.next(Some(until)).await {
                    Event::Frame(_) => {}
                    Event::Deadline => break,
                    Event::Stopped(why) | Event::Abandoned(why) => return Err(why),
                }
            }
            if self.vehicle().uid.is_some() {
                break;
            }
        }
        Ok(())
    }

    fn command(&mut self, to: Origin, (command, param1): (u16, f32)) {
        let payload = command_long(self.vehicle(), command, param1);
        self.raw.send_to(to, COMMAND_LONG, payload);
    }

    fn see_home(&mut self, frame: &Frame) {
        if frame.message_id != HOME_POSITION || !self.vehicle().sent(frame) {
            return;
        }
        let at = |k: usize| frame.payload().get(k).copied().unwrap_or(0);
        let degrees =
            |k: usize| f64::from(i32::from_le_bytes([at(k), at(k + 1), at(k + 2), at(k + 3)])) * 1e-7;
        self.home = Some([degrees(0), degrees(4)]);
    }
}

impl<R: RawWire + Send> Wire for Pinned<R> {
    fn vehicle(&self) -> Vehicle {
        self.pin.vehicle()
    }

    fn identity(&self) -> Identity {
        Identity { home: self.home, ..self.vehicle().identity() }
    }

    fn peers(&self) -> Peers {
        Peers::new(self.raw.me(), self.vehicle().address)
    }

    fn now_s(&self) -> f64 {
        self.raw.now_s()
    }

    fn send_payload(&mut self, id: u32, payload: Vec<u8>) {
        // What is held back here is asked for again by the protocols.
        if self.pin.may_send() {
            self.raw.send_to(self.pin.origin(), id, payload);
        }
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        let deadline_s = deadline_s.unwrap_or(self.now_s() + BREATH_S);
        loop {
            match self.pin.take_conflict() {
                Some(Conflict { words, separable: true }) => return Event::Stopped(words),
                Some(Conflict { words, separable: false }) => return Event::Abandoned(words),
                None => {}
            }
            let now_s = self.now_s();
            if let Some(origin) = self.pin.ask(now_s) {
                self.asked += 1;
                self.command(origin, WAYS_TO_ASK[self.asked % WAYS_TO_ASK.len()]);
            }
            // Often enough to ask.
            match self.raw.next_of_all(deadline_s.min(now_s + BREATH_S)).await {
                RawEvent::Stopped => return Event::Stopped("it was cancelled".to_owned()),
                RawEvent::Frame(origin, frame) => {
                    self.see_home(&frame);
                    if self.pin.take(self.raw.now_s(), origin, &frame) {
                        return Event::Frame(frame);
                    }
                }
                RawEvent::Deadline => {}
            }
            if self.now_s() >= deadline_s {
                return Event::Deadline;
            }
        }
    }
}
