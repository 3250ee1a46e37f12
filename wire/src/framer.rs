//! Finds frames in a stream of bytes: no sockets, no clock, no rescanning inside good frames.
//!
//! The unit that follows directly on a good frame is trusted: a message the dialect does not know is skipped as a
//! whole there, so that payload bytes that look like a start byte cannot hold up the good frame behind it. After lost
//! synchronisation an unknown message only counts as one when another start byte follows it. A length that would swallow a frame with the
//! right checksum is none, whoever claims it, and bytes that wait for their rest are given up where whole frames arrive instead.

use super::frame::{Frame, MAGIC_V1, MAGIC_V2, MAX_FRAME_LEN, Scan, scan};
use bytes::Bytes;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a stream of bytes contained so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FramerStats {
    /// Good frames.
    pub frames: u64,
    /// Messages outside the dialect, skipped as a whole.
    pub unknown: u64,
    /// Frames with a wrong checksum.
    pub bad_checksum: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Frames that a sender numbered and that never arrived.
    pub lost: u64,
}

/// The framer.
#[derive(Debug, Clone, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    start: usize,
    /// Whether the byte at `start` directly follows a whole frame.
    synchronised: bool,
    stats: FramerStats,
    sequences: BTreeMap<(u8, u8), u8>,
}

impl Framer {
    /// An empty framer.
    pub fn new() -> Self {
        Self { synchronised: true, ..Self::default() }
    }

    /// Takes bytes in the order they arrived.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.start > 0 {
            self.buffer.drain(..self.start);
            self.start = 0;
        }
        // What waits for its rest did not get it.
        let waits = !self.buffer.is_empty() && matches!(scan(&self.buffer), Scan::Incomplete);
        if waits && matches!(scan(bytes), Scan::Valid(_)) {
            self.stats.skipped_bytes += self.buffer.len() as u64;
            self.buffer.clear();
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// The next good frame, or nothing until more bytes arrive.
    pub fn next_frame(&mut self) -> Option<Frame> {
        loop {
            self.skip_to_magic();
            let rest = self.buffer.get(self.start..).filter(|r| !r.is_empty())?;
            match scan(rest) {
                Scan::Valid(len) => {
                    let frame = Frame::from_valid(Bytes::copy_from_slice(rest.get(..len)?))?;
                    self.advance(len);
                    self.stats.frames += 1;
                    self.count_losses(&frame);
                    return Some(frame);
                }
                Scan::Unknown(len) | Scan::BadChecksum(len) if holds_a_frame(rest, len) => self.skip_byte(),
                Scan::Unknown(len) => match (self.synchronised, rest.get(len)) {
                    (true, _) | (false, Some(&(MAGIC_V1 | MAGIC_V2))) => {
                        self.stats.unknown += 1;
                        self.advance(len);
                    }
                    (false, Some(_)) => self.skip_byte(),
                    (false, None) => return None,
                },
                Scan::BadChecksum(len) => {
                    self.stats.bad_checksum += 1;
                    match rest.get(len) {
                        Some(&(MAGIC_V1 | MAGIC_V2)) => {
                            self.stats.skipped_bytes += len as u64;
                            self.advance(len);
                        }
                        // The length byte itself may be what was damaged.
                        _ => self.skip_byte(),
                    }
                }
                Scan::Incomplete => return None,
                Scan::Nothing => self.skip_byte(),
            }
        }
    }

    /// The next message that can be read, with its sender.
    pub fn next_message(&mut self) -> Option<(MavHeader, MavMessage)> {
        std::iter::from_fn(|| self.next_frame())
            .find_map(|frame| Some((frame.header(), frame.decode().ok()?)))
    }

    /// What was found so far.
    pub fn stats(&self) -> FramerStats {
        self.stats
    }

    /// Forgets half frames and running numbers, as after a reconnection.
    pub fn reset(&mut self) {
        self.stats.skipped_bytes += (self.buffer.len() - self.start) as u64;
        self.buffer.clear();
        self.start = 0;
        self.synchronised = true;
        self.sequences.clear();
    }

    fn skip_to_magic(&mut self) {
        let rest = self.buffer.get(self.start..).unwrap_or_default();
        let skip = rest.iter().position(|b| matches!(*b, MAGIC_V1 | MAGIC_V2)).unwrap_or(rest.len());
        if skip > 0 {
            self.start += skip;
            self.stats.skipped_bytes += skip as u64;
            self.synchronised = false;
        }
    }

    fn skip_byte(&mut self) {
        self.start += 1;
        self.stats.skipped_bytes += 1;
        self.synchronised = false;
    }

    fn advance(&mut self, len: usize) {
        self.start += len;
        self.synchronised = true;
        // Keeps the buffer at a few frames even when a caller pushes much more than it takes.
        if self.start > 16 * MAX_FRAME_LEN {
            self.buffer.drain(..self.start);
            self.start = 0;
        }
    }

    fn count_losses(&mut self, frame: &Frame) {
        let sender = (frame.system_id, frame.component_id);
        if let Some(last) = self.sequences.insert(sender, frame.sequence) {
            let missing = frame.sequence.wrapping_sub(last).wrapping_sub(1);
            // More than half the circle is a late or repeated frame, or a sender that started anew.
            if missing < 128 {
                self.stats.lost += u64::from(missing);
            }
        }
    }
}

/// Whether a frame with the right checksum begins inside the first `len` bytes, behind the first.
fn holds_a_frame(rest: &[u8], len: usize) -> bool {
    let inside = rest.get(..len).unwrap_or(rest).iter().enumerate().skip(1);
    let mut starts = inside.filter(|(_, b)| matches!(**b, MAGIC_V1 | MAGIC_V2));
    starts.any(|(k, _)| rest.get(k..).is_some_and(|r| matches!(scan(r), Scan::Valid(_))))
}

#[cfg(test)]
mod tests {
    use super::super::frame::Sender;
    use super::*;
    use mavlink::dialects::ardupilotmega::RAW_IMU_DATA;
    use proptest::prelude::*;

    fn imu(sequence: u8) -> Frame {
        let message =
            RAW_IMU_DATA { time_usec: 1000 + u64::from(sequence), zacc: -1000, id: 1, ..Default::default() };
        Frame::encode(Sender { system_id: 1, component_id: 1 }, sequence, &MavMessage::RAW_IMU(message))
    }

    fn all(framer: &mut Framer) -> Vec<Frame> {
        std::iter::from_fn(|| framer.next_frame()).collect()
    }

    /// A well-formed MAVLink 2 message with an id that no dialect has and a start byte in its payload.
    fn unknown() -> Vec<u8> {
        let mut raw = vec![MAGIC_V2, 4, 0, 0, 0, 1, 1, 0xFE, 0xFF, 0xFF, MAGIC_V2, 200, 0, 0];
        raw.extend([0x12, 0x34]);
        raw
    }

    #[test]
    fn an_unknown_message_does_not_hold_up_the_next() {
        let mut framer = Framer::new();
        framer.push(imu(0).raw());
        framer.push(&unknown());
        framer.push(imu(1).raw());
        assert_eq!(all(&mut framer), vec![imu(0), imu(1)]);
        assert_eq!(framer.stats(), FramerStats { frames: 2, unknown: 1, ..Default::default() });
    }

    #[test]
    fn a_damaged_frame_costs_only_itself() {
        let mut framer = Framer::new();
        let mut bad = imu(1).raw().to_vec();
        bad[15] ^= 0x40;
        framer.push(imu(0).raw());
        framer.push(&bad);
        framer.push(imu(2).raw());
        assert_eq!(all(&mut framer), vec![imu(0), imu(2)]);
        let stats = framer.stats();
        assert_eq!((stats.bad_checksum, stats.lost), (1, 1));
        assert_eq!(stats.skipped_bytes, bad.len() as u64);
    }

    /// Two bytes before every datagram claim 263 more: nothing of the frames is lost, and none waits.
    #[test]
    fn a_claimed_length_swallows_no_frame() {
        for (header, whole) in [
            (&[MAGIC_V1, 255][..], true),
            (&[MAGIC_V2, 255, 0, 0, 0, 1, 1, 9, 9, 9], true),
            (&[MAGIC_V1, 255], false),
        ] {
            let mut framer = Framer::new();
            for sequence in 0..200 {
                framer.push(header);
                if whole {
                    framer.push(imu(sequence).raw());
                } else {
                    imu(sequence).raw().chunks(7).for_each(|piece| framer.push(piece));
                }
                if whole {
                    assert_eq!(all(&mut framer), vec![imu(sequence)], "{header:?}");
                }
            }
            if !whole {
                // The last ones wait for the rest of what was claimed.
                let found = all(&mut framer);
                assert!(found.len() >= 190 && found[0] == imu(0), "{}", found.len());
            }
            assert_eq!(framer.stats().lost, 0);
        }
    }

    #[test]
    fn running_numbers_wrap_without_a_loss() {
        let mut framer = Framer::new();
        for sequence in [254, 255, 0, 3] {
            framer.push(imu(sequence).raw());
        }
        assert_eq!(all(&mut framer).len(), 4);
        assert_eq!(framer.stats().lost, 2);
    }

    proptest! {
        /// Whatever stands between them and however the stream is cut, frames behind the rubbish are found.
        #[test]
        fn rubbish_never_panics_and_frames_are_found_again(
            rubbish in proptest::collection::vec(any::<u8>(), 0..400),
            cut in 1_usize..64,
        ) {
            let mut stream = imu(0).raw().to_vec();
            stream.extend(&rubbish);
            // A false header may swallow up to one longest frame.
            for sequence in 1..=30 {
                stream.extend_from_slice(imu(sequence).raw());
            }
            let mut framer = Framer::new();
            let mut found = Vec::new();
            for piece in stream.chunks(cut) {
                framer.push(piece);
                found.extend(all(&mut framer));
            }
            prop_assert_eq!(&found[0], &imu(0));
            prop_assert_eq!(found.last(), Some(&imu(30)));
            prop_assert!(found.len() >= 31 - 9, "only {} frames", found.len());
            let stats = framer.stats();
            prop_assert_eq!(stats.frames as usize, found.len());
        }
    }
}
