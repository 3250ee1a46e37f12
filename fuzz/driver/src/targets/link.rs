//! Bytes from a link: the framer, messages with valid checksums, addresses.

use super::engine::FLIGHT;
use super::refused;
use crate::script::{self, Step};
use crate::vehicle::honest_frames;
use gaware::link::address::Address;
use gaware::link::frame::Frame;
use gaware::link::framer::Framer;
use gaware::link::signing::{Key, Verifier};
use gaware::link::systems::Systems;
use gaware::mission_link::vehicle::Vehicle;
use gaware::mission_link::{codec, param_codec};
use gaware::sensors::truth::SimTruth;
use gaware::sensors::{Converter, ConverterOptions};
use std::collections::BTreeMap;

/// Bytes in pieces, as a port delivers them. Every frame that comes out is one that reads back from its own bytes, and no byte counts
/// twice.
pub fn framer(data: &[u8]) -> bool {
    let mut framer = Framer::new();
    let piece = 1 + usize::from(data.first().copied().unwrap_or(0));
    let mut in_frames = 0;
    for piece in data.chunks(piece) {
        framer.push(piece);
        while let Some(frame) = framer.next_frame() {
            assert_eq!(Frame::parse(frame.raw().clone()).as_ref(), Ok(&frame));
            in_frames += frame.raw().len() as u64;
        }
    }
    framer.reset();
    let stats = framer.stats();
    assert!(in_frames + stats.skipped_bytes <= data.len() as u64, "{stats:?}");
    in_frames > 0
}

/// Every reader of a message, over frames with valid checksums and any payload.
pub fn decode(data: &[u8]) -> bool {
    let mut converter = Converter::new(ConverterOptions::default());
    let mut systems = Systems::default();
    let mut verifier = Verifier::new(Key::new([7; 32]), BTreeMap::new());
    let (mut samples, mut readable) = (Vec::new(), 0);
    let mut t_us = 1_700_000_000_000_000_u64;
    for (k, step) in script::read(data).iter().enumerate() {
        t_us += u64::from(step.wait_ms) * 1000;
        let Some(frame) = step.frame(k as u8) else { continue };
        // Whatever the dialect makes of it, it must not panic.
        readable += usize::from(frame.decode().is_ok());
        let _ = (codec::decode(&frame), param_codec::decode(&frame));
        let _ = (Vehicle::from_heartbeat(&frame), verifier.judge(&frame, t_us));
        systems.record(&frame);
        converter.feed(t_us, &frame, &mut samples);
        let _ = SimTruth::from_frame(&frame, &converter);
    }
    let _ = (systems.words(), systems.followed(None), converter.take_notices().len());
    readable > 0
}

/// A text that is an address reads back as the same one.
pub fn address(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    match text.parse::<Address>() {
        Ok(address) => assert_eq!(address.to_string().parse().as_ref(), Ok(&address)),
        Err(error) => return refused(&error),
    }
    true
}

/// Pieces of a flight as they came over the link.
pub fn raw_seeds() -> Vec<Vec<u8>> {
    let frames: Vec<Vec<u8>> = FLIGHT.frames.iter().map(|(_, f)| f.raw().to_vec()).collect();
    frames.chunks(20).step_by(40).map(<[Vec<u8>]>::concat).collect()
}

/// One message of every kind, and pieces of a flight.
pub fn script_seeds() -> Vec<Vec<u8>> {
    let honest: Vec<Step> = honest_frames().iter().map(|f| Step::of_frame(f, 20)).collect();
    let mut seeds = vec![script::write(&honest)];
    // Every message of the first 512 ids with a payload that fills it.
    for ids in (0..512_u32).collect::<Vec<_>>().chunks(64) {
        let step =
            |id: &u32| Step { kind: 0, wait_ms: 20, from: (1, 1), message_id: *id, payload: vec![1; 64] };
        seeds.push(script::write(&ids.iter().map(step).collect::<Vec<_>>()));
    }
    seeds
}

/// Addresses as users write them.
pub fn address_seeds() -> Vec<Vec<u8>> {
    [
        "serial:/dev/ttyAMA0:921600",
        "/dev/ttyUSB0,57600",
        "udpin:[::1]:14550",
        "udp://:14540",
        "udpout:gcs.local:14550",
        "tcpout:127.0.0.1:5760",
        "tcpin:0.0.0.0:5760",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}
