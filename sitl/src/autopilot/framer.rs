//! Bytes to messages, for the simulated autopilot's own receiving side: MAVLink 1 and 2, checksum checked, anything
//! else skipped.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavHeader, MavlinkVersion, Message, calculate_crc};

const STX_V1: u8 = 0xFE;
const STX_V2: u8 = 0xFD;
/// Bit of the incompatibility flags that announces a signature.
const SIGNED: u8 = 0x01;
const SIGNATURE_LEN: usize = 13;

/// Collects bytes and gives messages back.
#[derive(Debug, Clone, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    /// Frames whose checksum was wrong or whose content could not be read.
    pub rejected: u64,
}

impl Framer {
    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next message, if a whole one is there.
    pub fn next_message(&mut self) -> Option<(MavHeader, MavMessage)> {
        self.next_frame().map(|(_, header, message)| (header, message))
    }

    /// The next message, if a whole one is there, and the bytes that it was.
    pub fn next_frame(&mut self) -> Option<(Vec<u8>, MavHeader, MavMessage)> {
        loop {
            let start = self.buffer.iter().position(|b| *b == STX_V1 || *b == STX_V2);
            self.buffer.drain(..start.unwrap_or(self.buffer.len()));
            let len = frame_len(&self.buffer)?;
            let frame = self.buffer.get(..len)?;
            match parse(frame) {
                Some((header, message)) => {
                    return Some((self.buffer.drain(..len).collect(), header, message));
                }
                None => {
                    // Not a frame after all, or a damaged one: look for the next start inside it.
                    self.rejected += 1;
                    self.buffer.drain(..1);
                }
            }
        }
    }
}

/// Length of the frame that starts here, once its header is complete.
fn frame_len(b: &[u8]) -> Option<usize> {
    let payload = usize::from(*b.get(1)?);
    if b[0] == STX_V1 {
        return Some(payload + 8);
    }
    let signature = if b.get(2)? & SIGNED != 0 { SIGNATURE_LEN } else { 0 };
    Some(payload + 12 + signature)
}

fn parse(frame: &[u8]) -> Option<(MavHeader, MavMessage)> {
    let payload_len = usize::from(frame[1]);
    let (version, header_len, id) = if frame[0] == STX_V1 {
        (MavlinkVersion::V1, 6, u32::from(frame[5]))
    } else {
        (MavlinkVersion::V2, 10, u32::from_le_bytes([frame[7], frame[8], frame[9], 0]))
    };
    let end = header_len + payload_len;
    let crc = calculate_crc(frame.get(1..end)?, MavMessage::extra_crc(id));
    if frame.get(end..end + 2)? != crc.to_le_bytes() {
        return None;
    }
    let message = MavMessage::parse(version, id, &frame[header_len..end]).ok()?;
    let (sequence, system_id, component_id) =
        if frame[0] == STX_V1 { (frame[2], frame[3], frame[4]) } else { (frame[4], frame[5], frame[6]) };
    Some((MavHeader { sequence, system_id: system_id.into(), component_id }, message))
}

/// A message as a MAVLink 2 frame.
pub fn encode(header: MavHeader, message: &MavMessage) -> Vec<u8> {
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    raw.raw_bytes().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MISSION_COUNT_DATA};
    use proptest::prelude::*;

    fn frames() -> Vec<u8> {
        let header = MavHeader { system_id: 255, component_id: 190, sequence: 7 };
        let mut bytes = encode(header, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        let count = MISSION_COUNT_DATA { count: 12, ..Default::default() };
        bytes.extend(encode(header, &MavMessage::MISSION_COUNT(count)));
        bytes
    }

    fn ids(framer: &mut Framer) -> Vec<u32> {
        std::iter::from_fn(|| framer.next_message()).map(|(_, m)| m.message_id()).collect()
    }

    proptest! {
        #[test]
        fn any_chopping_and_any_noise_before_leaves_the_messages(
            cut in 1usize..20,
            noise in proptest::collection::vec(0u8..0xFD, 0..40),
        ) {
            let mut framer = Framer::default();
            let bytes: Vec<u8> = noise.into_iter().chain(frames()).collect();
            let mut seen = Vec::new();
            for chunk in bytes.chunks(cut) {
                framer.push(chunk);
                seen.extend(ids(&mut framer));
            }
            prop_assert_eq!(seen, vec![0, 44]);
        }

        #[test]
        fn any_bytes_at_all_are_survived(noise in proptest::collection::vec(any::<u8>(), 0..600)) {
            let mut framer = Framer::default();
            framer.push(&noise);
            ids(&mut framer);
        }
    }

    #[test]
    fn a_damaged_frame_costs_only_itself() {
        let mut framer = Framer::default();
        let mut bytes = frames();
        bytes[12] ^= 0x40;
        framer.push(&bytes);
        assert_eq!(ids(&mut framer), vec![44]);
        assert!(framer.rejected > 0);
    }
}
