//! A script of valid frames as bytes, so that any bytes are a script: what a vehicle (or someone who claims to be it) sends, when,
//! and what becomes of the honest vehicle's own messages.
//!
//! A step is 1 byte of [`Kind`], 2 bytes of time since the step before (ms, little-endian), system, component, 3 bytes of message id, 1 byte of
//! length, and the payload. Frames get their checksum here, so that mutated payloads reach what is behind the framer.

use gaware::link::frame::{Frame, Sender};

/// Bytes of a step before its payload.
const HEADER: usize = 9;
/// Steps of a script at most.
pub const STEPS: usize = 600;

/// What happens in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The frame arrives.
    Frame,
    /// The next message of the honest vehicle arrives.
    Deliver,
    /// It is lost.
    Lose,
    /// It arrives, and once more later.
    Repeat,
    /// It is overtaken by the others.
    Delay,
    /// The user gives up.
    Cancel,
    /// The user asks again, or the link is said to be back.
    Again,
}

impl Kind {
    /// Every byte is a kind; frames and deliveries are the most frequent.
    fn of(byte: u8) -> Self {
        match byte {
            0..=99 => Self::Frame,
            100..=199 => Self::Deliver,
            200..=219 => Self::Lose,
            220..=234 => Self::Repeat,
            235..=249 => Self::Delay,
            250..=252 => Self::Cancel,
            _ => Self::Again,
        }
    }

    /// A byte of this kind.
    pub fn byte(self) -> u8 {
        match self {
            Self::Frame => 0,
            Self::Deliver => 100,
            Self::Lose => 200,
            Self::Repeat => 220,
            Self::Delay => 235,
            Self::Cancel => 250,
            Self::Again => 253,
        }
    }
}

/// A step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// What happens.
    pub kind: u8,
    /// Time since the step before, ms.
    pub wait_ms: u16,
    /// Sender of the frame.
    pub from: (u8, u8),
    /// Its message id.
    pub message_id: u32,
    /// Its payload.
    pub payload: Vec<u8>,
}

impl Step {
    /// A step that needs no frame.
    pub fn of(kind: Kind, wait_ms: u16) -> Self {
        Self { kind: kind.byte(), wait_ms, from: (1, 1), message_id: 0, payload: Vec::new() }
    }

    /// The arrival of a frame.
    pub fn of_frame(frame: &Frame, wait_ms: u16) -> Self {
        Self {
            kind: Kind::Frame.byte(),
            wait_ms,
            from: (frame.system_id, frame.component_id),
            message_id: frame.message_id,
            payload: frame.payload().to_vec(),
        }
    }

    /// What happens.
    pub fn kind(&self) -> Kind {
        Kind::of(self.kind)
    }

    /// The frame, where the dialect has such a message.
    pub fn frame(&self, sequence: u8) -> Option<Frame> {
        let from = Sender { system_id: self.from.0, component_id: self.from.1 };
        Frame::of_payload(from, sequence, self.message_id, &self.payload).ok()
    }
}

/// The steps that bytes stand for; a last one may lack a part of its payload.
pub fn read(mut bytes: &[u8]) -> Vec<Step> {
    let mut steps = Vec::new();
    while let Some((&[kind, low, high, system, component, a, b, c, len], rest)) =
        bytes.split_first_chunk::<HEADER>()
    {
        let (payload, rest) = rest.split_at(usize::from(len).min(rest.len()));
        steps.push(Step {
            kind,
            wait_ms: u16::from_le_bytes([low, high]),
            from: (system, component),
            message_id: u32::from_le_bytes([a, b, c, 0]),
            payload: payload.to_vec(),
        });
        bytes = rest;
        if steps.len() >= STEPS {
            break;
        }
    }
    steps
}

/// The bytes of steps.
pub fn write(steps: &[Step]) -> Vec<u8> {
    let mut out = Vec::new();
    for step in steps {
        let len = step.payload.len().min(255);
        let [low, high] = step.wait_ms.to_le_bytes();
        let [a, b, c, _] = step.message_id.to_le_bytes();
        out.extend([step.kind, low, high, step.from.0, step.from.1, a, b, c, len as u8]);
        out.extend(step.payload.iter().take(len));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_survive_their_bytes_and_a_header_alone_is_a_step_without_payload() {
        let steps = vec![
            Step { kind: 3, wait_ms: 1000, from: (1, 2), message_id: 0x01_02_03, payload: vec![9; 255] },
            Step::of(Kind::Delay, 7),
        ];
        assert_eq!(read(&write(&steps)), steps);
        assert_eq!(read(&[0, 0, 0, 1, 1, 0, 0, 0, 9]).len(), 1);
        assert_eq!(read(&[0; 8]), vec![]);
    }

    #[test]
    fn a_frame_comes_back_from_its_step() {
        let from = Sender { system_id: 7, component_id: 1 };
        let frame = Frame::of_payload(from, 3, 30, &[1, 2, 3, 4]).unwrap();
        assert_eq!(Step::of_frame(&frame, 20).frame(3), Some(frame));
    }
}
