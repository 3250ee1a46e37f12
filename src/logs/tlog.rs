//! `.tlog`: 8 bytes of big-endian Unix microseconds before every MAVLink frame, nothing else.
//!
//! After damage the reader looks byte by byte for the next place where a frame with a valid checksum stands behind
//! eight bytes of time.

use super::window::Window;
use super::{Damage, Item, LogError, LogReader, Progress, Record};
use crate::link::frame::{Frame, MAGIC_V1, MAGIC_V2, MAX_FRAME_LEN, Scan, scan};
use bytes::Bytes;
use std::io::Read;

const STAMP_LEN: usize = 8;

/// Reads a `.tlog` from anything that reads.
#[derive(Debug)]
pub struct TlogReader<R> {
    window: Window<R>,
    finished: bool,
    records: u64,
    damage: Damage,
}

impl<R: Read> TlogReader<R> {
    /// Starts at the first byte of `source`, which has `total_bytes`.
    pub fn new(source: R, total_bytes: u64) -> Self {
        Self {
            window: Window::new(source, total_bytes),
            finished: false,
            records: 0,
            damage: Damage::default(),
        }
    }

    fn consume(&mut self, n: usize) {
        self.window.consume(n);
    }

    fn skip(&mut self, n: usize) {
        self.damage.skipped_bytes += n as u64;
        self.consume(n);
    }

    fn next_record(&mut self) -> Result<Option<Record>, LogError> {
        loop {
            // One longest record and the start of the next.
            self.window.fill(2 * STAMP_LEN + MAX_FRAME_LEN + 1)?;
            let rest = self.window.bytes();
            let Some((stamp, frame)) = rest.split_first_chunk::<STAMP_LEN>().filter(|(_, f)| !f.is_empty())
            else {
                self.damage.truncated |= !rest.is_empty();
                let n = rest.len();
                self.consume(n);
                return Ok(None);
            };
            // What follows a whole record is the end of the file or the stamp of another frame.
            let followed = |len: usize| {
                frame.len() == len || matches!(frame.get(len + STAMP_LEN), Some(&(MAGIC_V1 | MAGIC_V2)))
            };
            match scan(frame) {
                Scan::Valid(len) => {
                    let t_us = u64::from_be_bytes(*stamp);
                    let frame = frame.get(..len).map(Bytes::copy_from_slice).and_then(Frame::from_valid);
                    self.consume(STAMP_LEN + len);
                    if let Some(frame) = frame {
                        return Ok(Some(Record { t_us, item: Item::Frame(frame) }));
                    }
                }
                Scan::Unknown(len) if followed(len) => {
                    self.damage.unknown_messages += 1;
                    self.consume(STAMP_LEN + len);
                }
                // A damaged length may reach over good records to the next stamp.
                Scan::BadChecksum(len) if followed(len) && !hides_a_frame(frame, len) => {
                    self.damage.bad_records += 1;
                    self.skip(STAMP_LEN + len);
                }
                Scan::Incomplete if self.window.at_end() => {
                    self.damage.truncated = true;
                    self.skip(1);
                }
                Scan::Incomplete | Scan::Nothing | Scan::Unknown(_) | Scan::BadChecksum(_) => self.skip(1),
            }
        }
    }
}

/// Whether a good frame lies within the first `len` bytes.
fn hides_a_frame(bytes: &[u8], len: usize) -> bool {
    (1..len).any(|at| bytes.get(at..).is_some_and(|inner| matches!(scan(inner), Scan::Valid(_))))
}

impl<R: Read> Iterator for TlogReader<R> {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.finished {
            return None;
        }
        match self.next_record() {
            Ok(Some(record)) => {
                self.records += 1;
                Some(Ok(record))
            }
            Ok(None) => {
                self.finished = true;
                (self.records == 0).then(|| {
                    Err(LogError::NothingReadable {
                        format: "tlog",
                        bytes: self.window.progress().read_bytes,
                    })
                })
            }
            Err(e) => {
                self.finished = true;
                Some(Err(e))
            }
        }
    }
}

impl<R: Read + Send> LogReader for TlogReader<R> {
    fn progress(&self) -> Progress {
        self.window.progress()
    }

    fn damage(&self) -> Damage {
        self.damage
    }
}

/// The bytes of one record, for writers of `.tlog`.
pub fn record_bytes(t_us: u64, frame: &Frame) -> Vec<u8> {
    let mut out = Vec::with_capacity(STAMP_LEN + frame.raw().len());
    out.extend(t_us.to_be_bytes());
    out.extend_from_slice(frame.raw());
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::{MavMessage, RAW_IMU_DATA};
    use proptest::prelude::*;

    fn record(k: u64) -> Vec<u8> {
        let message = MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec: k, id: 1, ..Default::default() });
        record_bytes(k, &Frame::encode(Sender { system_id: 1, component_id: 1 }, k as u8, &message))
    }

    fn stamps(bytes: &[u8]) -> (Vec<u64>, Damage) {
        let mut reader = TlogReader::new(bytes, bytes.len() as u64);
        let stamps = reader.by_ref().filter_map(Result::ok).map(|r| r.t_us).collect();
        assert_eq!(reader.progress().read_bytes, bytes.len() as u64);
        (stamps, reader.damage())
    }

    #[test]
    fn rewriting_gives_the_same_bytes() {
        let bytes: Vec<u8> = (0..50).flat_map(record).collect();
        let again: Vec<u8> = TlogReader::new(&bytes[..], 0)
            .flat_map(|r| match r.unwrap() {
                Record { t_us, item: Item::Frame(frame) } => record_bytes(t_us, &frame),
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(bytes, again);
    }

    #[test]
    fn forty_bad_bytes_cost_no_good_record() {
        let mut bytes: Vec<u8> = (0..5).flat_map(record).collect();
        bytes.extend([0x55; 40]);
        bytes.extend((5..10).flat_map(record));
        let (stamps, damage) = stamps(&bytes);
        assert_eq!(stamps, (0..10).collect::<Vec<_>>());
        assert_eq!(damage, Damage { skipped_bytes: 40, ..Damage::default() });
    }

    #[test]
    fn a_cut_file_gives_its_whole_records() {
        let bytes: Vec<u8> = (0..5).flat_map(record).collect();
        let (stamps, damage) = stamps(&bytes[..bytes.len() - 3]);
        assert_eq!(stamps, vec![0, 1, 2, 3]);
        assert!(damage.truncated);
    }

    #[test]
    fn a_file_without_a_frame_is_refused_once() {
        let results: Vec<_> = TlogReader::new(&[7_u8; 1000][..], 1000).collect();
        assert!(matches!(results[..], [Err(LogError::NothingReadable { format: "tlog", bytes: 1000 })]));
    }

    proptest! {
        #[test]
        fn rubbish_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let _ = TlogReader::new(&bytes[..], bytes.len() as u64).count();
        }

        #[test]
        fn flipped_bytes_cost_at_most_their_neighbourhood(at in 0_usize..2000, value in any::<u8>()) {
            let mut bytes: Vec<u8> = (0..60).flat_map(record).collect();
            let at = at % bytes.len();
            bytes[at] = value;
            let (stamps, _) = stamps(&bytes);
            prop_assert!(stamps.len() >= 59, "{}", stamps.len());
        }
    }
}
