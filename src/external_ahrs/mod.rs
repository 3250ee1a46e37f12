//! The corrected attitude in a form that autopilots read from a serial port: an instrument that speaks VectorNav's protocol.
//!
//! Sans I/O: bytes of the autopilot and states of the engine in, bytes out. ArduPilot's `AP_ExternalAHRS_VectorNav` and PX4's `vectornav`
//! driver ask at their start who is there (register 1), and write into registers 75 to 77 which fields they want, in which groups, and how
//! often (a divisor of 800 Hz). The device sends exactly these, at most once for each inertial sample; whoever asks for a field that it
//! does not have is refused. Registers live as long as the device: an autopilot asks once, at its start.
//!
//! Nothing is sent while the estimate is not good enough ([`health`]): silence is what both drivers take for a failure
//! (`AP_ExternalAHRS_VectorNav.cpp`, `healthy`: 40 ms, 500 ms, 1 s for the three messages; PX4: 1 s). The message about the receiver is
//! sent only with a fix.

mod ascii;
mod binary;
pub mod health;

use crate::engine::navigation::Navigation;
use ascii::{Lines, Refusal, framed, refused};
use binary::Fields;
use health::{HealthCheck, InsMode, Unhealthy};
use std::collections::BTreeMap;

/// Dividers count from this, Hz.
const BASE_HZ: f64 = 800.0;
/// The first register of binary messages, and how many there are.
const FIRST_OUTPUT: u8 = 75;
const OUTPUTS: usize = 3;
/// Registers that say who is there: model, hardware, serial number, firmware.
const IDENTITY: [(u8, &str); 4] = [(1, "VN-200-GAWARE"), (2, "1"), (3, "0"), (4, env!("CARGO_PKG_VERSION"))];
/// Registers that an autopilot sets at its start, as they are before: baud rate, type and rate of text messages (none), use of the
/// magnetometer.
const SETTINGS: [(u8, &str); 4] = [(BAUD, "115200"), (6, "0"), (7, "40"), (35, "1,1,1,1")];
const BAUD: u8 = 5;
/// Rates of a serial port that an autopilot may ask for, bit/s.
const BAUD_RATES: [u32; 9] = [9600, 19_200, 38_400, 57_600, 115_200, 128_000, 230_400, 460_800, 921_600];
/// A fix that is older is none, s.
const FIX_AGE_S: f64 = 1.0;

/// What is to be done for the autopilot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// These bytes are to be sent.
    Send(Vec<u8>),
    /// From the answer on the port runs at this rate, bit/s.
    Baud(u32),
}

/// One binary message.
#[derive(Debug, Clone, PartialEq)]
struct Output {
    words: String,
    fields: Fields,
    period_s: f64,
    due_s: f64,
}

/// The instrument.
#[derive(Debug, Default)]
pub struct Device {
    lines: Lines,
    paused: bool,
    settings: BTreeMap<u8, String>,
    outputs: [Option<Output>; OUTPUTS],
    health: HealthCheck,
    last_s: f64,
}

impl Device {
    /// Takes what the autopilot sends.
    pub fn receive(&mut self, bytes: &[u8]) -> Vec<Action> {
        let mut actions = Vec::new();
        for byte in bytes {
            let mut baud = None;
            let answer = match self.lines.push(*byte) {
                None => continue,
                Some(Ok(command)) => self.command(&command, &mut baud),
                Some(Err(why)) => Err(why),
            };
            actions.push(Action::Send(answer.map_or_else(refused, |content| framed(&content))));
            actions.extend(baud.map(Action::Baud));
        }
        actions
    }

    /// Carries out a command; the content of its answer. `baud`: the rate of the port from the answer on.
    fn command(&mut self, command: &str, baud: &mut Option<u32>) -> Result<String, Refusal> {
        let (name, rest) = command.split_once(',').unwrap_or((command, ""));
        match name {
            "VNASY" => {
                self.paused = match rest {
                    "0" => true,
                    "1" => false,
                    _ => return Err(Refusal::Parameter),
                };
                Ok(command.to_owned())
            }
            "VNRRG" => {
                let register: u8 = rest.parse().map_err(|_| Refusal::Register)?;
                Ok(format!("{command},{}", self.read(register)?))
            }
            "VNWRG" => {
                let (register, value) = rest.split_once(',').ok_or(Refusal::TooFew)?;
                self.write(register.parse().map_err(|_| Refusal::Register)?, value, baud)?;
                Ok(command.to_owned())
            }
            _ => Err(Refusal::Command),
        }
    }

    fn read(&self, register: u8) -> Result<String, Refusal> {
        if let Some(set) = self.settings.get(&register) {
            return Ok(set.clone());
        }
        let known = IDENTITY.iter().chain(&SETTINGS).find(|(number, _)| *number == register);
        if let Some((_, value)) = known {
            return Ok((*value).to_owned());
        }
        let output = output_index(register).and_then(|k| self.outputs.get(k)).ok_or(Refusal::Register)?;
        Ok(output.as_ref().map_or_else(|| "0,0,0".to_owned(), |o| o.words.clone()))
    }

    fn write(&mut self, register: u8, value: &str, baud: &mut Option<u32>) -> Result<(), Refusal> {
        if IDENTITY.iter().any(|(number, _)| *number == register) {
            return Err(Refusal::ReadOnly);
        }
        if let Some(place) = output_index(register).and_then(|k| self.outputs.get_mut(k)) {
            *place = Output::parse(value)?;
            return Ok(());
        }
        if !SETTINGS.iter().any(|(number, _)| *number == register) {
            return Err(Refusal::Register);
        }
        if register == BAUD {
            let rate = value.split(',').next().and_then(|v| v.parse().ok()).ok_or(Refusal::Parameter)?;
            if !BAUD_RATES.contains(&rate) {
                return Err(Refusal::Parameter);
            }
            *baud = Some(rate);
        }
        self.settings.insert(register, value.to_owned());
        Ok(())
    }

    /// The rates that the autopilot has asked for, Hz; empty before it has.
    pub fn rates_hz(&self) -> Vec<f64> {
        self.outputs.iter().flatten().map(|o| 1.0 / o.period_s).collect()
    }

    /// The messages that are due with a new state, and how good that is.
    pub fn feed(&mut self, now: &Navigation) -> (Vec<u8>, Result<InsMode, Unhealthy>) {
        let mode = self.health.check(now);
        if now.t_s < self.last_s {
            // The autopilot has started anew.
            self.outputs.iter_mut().flatten().for_each(|o| o.due_s = f64::NEG_INFINITY);
        }
        self.last_s = now.t_s;
        let mut out = Vec::new();
        if let (Ok(mode), false) = (mode, self.paused) {
            let fix = now.fix.as_ref().filter(|fix| fix.age_s < FIX_AGE_S && mode == InsMode::Tracking);
            for output in self.outputs.iter_mut().flatten() {
                if output.is_due(now.t_s) && (fix.is_some() || !output.fields.needs_fix()) {
                    out.extend(output.fields.message(now, fix, mode));
                }
            }
        }
        (out, mode)
    }
}

/// Which message a register is of.
fn output_index(register: u8) -> Option<usize> {
    register.checked_sub(FIRST_OUTPUT).map(usize::from).filter(|k| *k < OUTPUTS)
}

impl Output {
    /// `ports,divisor,groups,masks…`; nothing where no port or no group is named, which switches the message off.
    fn parse(words: &str) -> Result<Option<Self>, Refusal> {
        let mut each = words.split(',');
        let mut number = || each.next().and_then(|w| w.parse::<u16>().ok()).ok_or(Refusal::TooFew);
        let (ports, divisor) = (number()?, number()?);
        if ports == 0 || divisor == 0 {
            return Ok(None);
        }
        let fields = Fields::parse(each).ok_or(Refusal::Parameter)?;
        let period_s = f64::from(divisor) / BASE_HZ;
        Ok(Some(Self { words: words.to_owned(), fields, period_s, due_s: f64::NEG_INFINITY }))
    }

    /// Whether it is time, to a quarter of the period: samples do not come when messages are due.
    fn is_due(&mut self, t_s: f64) -> bool {
        if t_s < self.due_s - 0.25 * self.period_s {
            return false;
        }
        // After a gap the clock starts anew; otherwise the rate holds in the mean.
        let late = t_s - self.due_s > self.period_s;
        self.due_s = if late { t_s } else { self.due_s } + self.period_s;
        true
    }
}

#[cfg(test)]
mod tests;
