//! Recordings of gaware (`.mcap`): the frames in the order in which they were recorded.
//!
//! The file is taken apart record by record, and each chunk is checked as a whole before anything in it is accepted. A
//! damaged chunk is skipped and the next one searched; a file without its end (a power cut) gives all its finished
//! chunks.

use super::{Damage, Item, LogError, LogReader, Progress, Record};
use crate::inputs::Input;
use crate::link::frame::Frame;
use crate::sensors::ConverterOptions;
use bytes::Bytes;
use gaware_nav::earth::Geodetic;
use gaware_nav::observability::words::VehicleKind;
use mcap::records::{Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufReader, Read, Seek};

/// First bytes of every MCAP file.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Topic of the frames of a link is this and the link's number.
pub const FRAME_TOPIC: &str = "/mavlink/";
/// Name of the metadata record with the set-up.
pub const SETUP_METADATA: &str = "gaware.setup";
const HEADER_LEN: u64 = 9;
/// Longer records are damage: a second of flight is some 100 kB.
const RECORD_LIMIT: usize = 16 * 1024 * 1024;
/// Chunks that claim to become longer than this many times their own length are damage: frames compress to a third.
const EXPANSION_LIMIT: u64 = 100;
/// Where the length after decompression stands in a chunk: behind two times.
const UNCOMPRESSED_SIZE: usize = 8 + 8;
/// Bytes that are searched for a chunk at a time.
const SEARCH_STEP: usize = 4 * 1024;
/// Chunks are looked for inside of damaged ones until so many times the file's length was read; from then on behind them.
const REREAD_LIMIT: u64 = 8;
/// Where the name of the compression stands behind the start of a chunk record: opcode, length, two times, size, CRC.
const NAME_IN_CHUNK: usize = 1 + 8 + 8 + 8 + 8 + 4;
const CHUNK_NAME: &[u8] = b"\x04\0\0\0zstd";

/// What a replay must know beside the frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the program that recorded.
    pub version: String,
    /// Links, in the order of their numbers.
    pub links: Vec<String>,
    /// How frames were converted.
    pub converter: ConverterOptions,
    /// The model as a file.
    pub model_toml: String,
    /// What flies, where the user named an airframe.
    #[serde(default)]
    pub vehicle: Option<VehicleKind>,
    /// Where the vehicle was for as long as no fix said so, where the user named it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<Geodetic>,
}

/// Reads the frames of a recording.
pub struct McapReader<F> {
    file: BufReader<F>,
    position: u64,
    progress: Progress,
    damage: Damage,
    topics: BTreeMap<u16, String>,
    queue: VecDeque<Record>,
    records: u64,
    /// Bytes of damaged chunks that were read.
    damaged_bytes: u64,
    finished: bool,
}

/// A top-level record.
enum Top {
    Record(u8, Vec<u8>),
    /// No record can start here.
    Damaged,
    End,
}

/// What stands next, for one who wants metadata alone.
enum Next {
    Metadata(Vec<u8>),
    Other,
    End,
}

impl<F: Read + Seek> McapReader<F> {
    /// Starts behind the magic of `file`, which has `total_bytes`.
    pub fn new(file: F, total_bytes: u64) -> Self {
        Self {
            file: BufReader::with_capacity(256 * 1024, file),
            position: 0,
            progress: Progress { read_bytes: 0, total_bytes },
            damage: Damage::default(),
            topics: BTreeMap::new(),
            queue: VecDeque::new(),
            records: 0,
            damaged_bytes: 0,
            finished: false,
        }
    }

    fn failed(&self, source: std::io::Error) -> LogError {
        LogError::Read { read_bytes: self.progress.read_bytes, source }
    }

    /// Goes to a place; what is in the buffer stays there, since places to try often lie side by side.
    fn go_to(&mut self, place: u64) -> Result<(), LogError> {
        let here = self.file.stream_position().map_err(|e| self.failed(e))?;
        self.file.seek_relative(place.wrapping_sub(here).cast_signed()).map_err(|e| self.failed(e))
    }

    /// The next top-level record if it is metadata; others are passed over unread, however long.
    fn metadata(&mut self) -> Result<Next, LogError> {
        match self.head()? {
            None | Some((_, _, false)) => Ok(Next::End),
            Some((op::METADATA, length, _)) if length <= RECORD_LIMIT as u64 => {
                let mut body = vec![0; length as usize];
                self.file.read_exact(&mut body).map_err(|e| self.failed(e))?;
                self.position += HEADER_LEN + length;
                Ok(Next::Metadata(body))
            }
            Some((op::HEADER..op::DATA_END, length, _)) => {
                self.position += HEADER_LEN + length;
                self.go_to(self.position)?;
                Ok(Next::Other)
            }
            Some(_) => Ok(Next::End),
        }
    }

    /// Opcode and length of the record at the present position, and whether it ends within the file; nothing at the end of the file.
    fn head(&mut self) -> Result<Option<(u8, u64, bool)>, LogError> {
        if self.position == 0 {
            self.position = MAGIC.len() as u64;
            self.go_to(self.position)?;
        }
        let rest = self.progress.total_bytes.saturating_sub(self.position);
        if rest < HEADER_LEN {
            return Ok(None);
        }
        let mut head = [0; HEADER_LEN as usize];
        self.file.read_exact(&mut head).map_err(|e| self.failed(e))?;
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        Ok(Some((opcode, length, length <= rest - HEADER_LEN)))
    }

    fn top(&mut self) -> Result<Top, LogError> {
        let Some((opcode, length, is_whole)) = self.head()? else {
            self.damage.truncated = true;
            return Ok(Top::End);
        };
        if !(op::HEADER..=op::DATA_END).contains(&opcode) || !is_whole || length > RECORD_LIMIT as u64 {
            return Ok(Top::Damaged);
        }
        let mut body = vec![0; length as usize];
        self.file.read_exact(&mut body).map_err(|e| self.failed(e))?;
        self.position += HEADER_LEN + length;
        self.progress.read_bytes = self.position;
        Ok(Top::Record(opcode, body))
    }

    /// Goes to the next place behind the present one that looks like the start of a chunk.
    fn find_chunk(&mut self) -> Result<bool, LogError> {
        let from = self.position + 1;
        self.go_to(from)?;
        let (mut window, mut base) = (Vec::new(), from);
        loop {
            let old = window.len();
            window.resize(old + SEARCH_STEP, 0);
            let n = self.file.read(window.get_mut(old..).unwrap_or_default()).map_err(|e| self.failed(e))?;
            window.truncate(old + n);
            let hits = window.windows(CHUNK_NAME.len()).enumerate().filter(|(_, w)| *w == CHUNK_NAME);
            let starts = hits.filter_map(|(k, _)| k.checked_sub(NAME_IN_CHUNK));
            let found = starts.into_iter().find(|k| window.get(*k) == Some(&op::CHUNK));
            if let Some(k) = found {
                self.damage.skipped_bytes += base + k as u64 - self.position;
                self.position = base + k as u64;
                self.go_to(self.position)?;
                return Ok(true);
            }
            if n == 0 {
                self.damage.skipped_bytes += self.progress.total_bytes.saturating_sub(self.position);
                self.damage.truncated = true;
                return Ok(false);
            }
            let keep = (NAME_IN_CHUNK + CHUNK_NAME.len()).min(window.len());
            base += (window.len() - keep) as u64;
            window.drain(..window.len() - keep);
        }
    }

    /// Reads on until frames are queued; false at the end.
    fn more(&mut self) -> Result<bool, LogError> {
        while self.queue.is_empty() {
            let start = self.position.max(MAGIC.len() as u64);
            match self.top()? {
                Top::End => return Ok(false),
                Top::Record(op::DATA_END | op::FOOTER, _) => return Ok(false),
                Top::Record(op::CHUNK, body) => {
                    if self.chunk(&body).is_none() {
                        self.damage.bad_records += 1;
                        self.damaged_bytes += body.len() as u64;
                        // Nested chunks that are all damaged must not cost the square of the file's length.
                        if self.damaged_bytes > REREAD_LIMIT * self.progress.total_bytes {
                            self.damage.skipped_bytes += self.position - start;
                            continue;
                        }
                        self.position = start;
                        if !self.find_chunk()? {
                            return Ok(false);
                        }
                    }
                }
                Top::Record(opcode, body) => self.entry(opcode, &body),
                Top::Damaged => {
                    self.position = start;
                    if !self.find_chunk()? {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(true)
    }

    /// Takes a chunk in; nothing when its checksum or its content is wrong.
    fn chunk(&mut self, body: &[u8]) -> Option<()> {
        let expanded = u64::from_le_bytes(*body.get(UNCOMPRESSED_SIZE..)?.first_chunk()?);
        if expanded > EXPANSION_LIMIT.saturating_mul(body.len() as u64) {
            return None;
        }
        #[cfg(target_family = "wasm")]
        let body = &expanded_chunk(body, expanded)?;
        let mut record = Vec::with_capacity(body.len() + HEADER_LEN as usize);
        record.push(op::CHUNK);
        record.extend((body.len() as u64).to_le_bytes());
        record.extend_from_slice(body);
        let mut reader = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_skip_start_magic(true)
                .with_skip_end_magic(true)
                .with_prevalidate_chunk_crcs(true)
                .with_record_length_limit(RECORD_LIMIT),
        );
        let mut rest = record.as_slice();
        let mut entries = Vec::new();
        while let Some(event) = reader.next_event() {
            match event.ok()? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let (now, later) = rest.split_at(wanted.min(rest.len()));
                    reader.insert(now.len()).copy_from_slice(now);
                    reader.notify_read(now.len());
                    rest = later;
                }
                LinearReadEvent::Record { data, opcode } => entries.push((opcode, data.to_vec())),
            }
        }
        for (opcode, data) in entries {
            self.entry(opcode, &data);
        }
        Some(())
    }

    fn entry(&mut self, opcode: u8, body: &[u8]) {
        if !matches!(opcode, op::CHANNEL | op::MESSAGE) {
            return;
        }
        match mcap::parse_record(opcode, body) {
            Ok(McapRecord::Channel(channel)) => {
                self.topics.insert(channel.id, channel.topic);
            }
            Ok(McapRecord::Message { header, data }) => {
                let frames = self.topics.get(&header.channel_id).is_some_and(|t| t.starts_with(FRAME_TOPIC));
                if !frames {
                    return;
                }
                match Frame::parse(Bytes::copy_from_slice(&data)) {
                    Ok(frame) => {
                        self.queue
                            .push_back(Record { t_us: header.log_time / 1000, item: Item::Frame(frame) });
                    }
                    Err(_) => self.damage.bad_records += 1,
                }
            }
            Ok(_) => {}
            Err(_) => self.damage.bad_records += 1,
        }
    }
}

impl<F: Read + Seek> Iterator for McapReader<F> {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.finished {
            return None;
        }
        match self.more() {
            Ok(true) => {
                self.records += 1;
                self.queue.pop_front().map(Ok)
            }
            Ok(false) => {
                self.finished = true;
                let bytes = self.progress.total_bytes;
                self.progress.read_bytes = bytes;
                let nothing = match self.topics.is_empty() {
                    true => LogError::NothingReadable { format: "mcap", bytes },
                    false => LogError::NoFrames,
                };
                (self.records == 0).then_some(Err(nothing))
            }
            Err(e) => {
                self.finished = true;
                Some(Err(e))
            }
        }
    }
}

impl<F: Read + Seek + Send> LogReader for McapReader<F> {
    fn progress(&self) -> Progress {
        self.progress
    }

    fn damage(&self) -> Damage {
        self.damage
    }
}

/// The same chunk without compression, for a reader without the library in C.
#[cfg(target_family = "wasm")]
fn expanded_chunk(body: &[u8], expanded: u64) -> Option<Vec<u8>> {
    const NAME: usize = NAME_IN_CHUNK - HEADER_LEN as usize;
    let (head, rest) = body.split_at_checked(NAME)?;
    let Some(rest) = rest.strip_prefix(CHUNK_NAME) else { return Some(body.to_owned()) };
    let (length, packed) = rest.split_first_chunk()?;
    let packed = packed.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let mut out = [head, &0_u32.to_le_bytes(), &expanded.to_le_bytes()].concat();
    ruzstd::decoding::StreamingDecoder::new(packed).ok()?.take(expanded).read_to_end(&mut out).ok()?;
    Some(out)
}

/// The set-up of a recording: model, converter options, links. Nothing where the file is none of gaware's, or its
/// beginning is damaged.
pub fn recorded_setup(log: impl Into<Input>) -> Option<Setup> {
    let file = log.into().open().ok()?;
    let total = file.total_bytes().ok()?;
    setup_in(McapReader::new(file, total))
}

/// The set-up in a recording that has just been opened: the last, since a run begins anew with what is known of its unit once the vehicle has named
/// itself.
pub fn setup_in(mut reader: McapReader<impl Read + Seek>) -> Option<Setup> {
    let mut setup = None;
    let mut records = 0;
    // The first stands among the first records; a log of others has none.
    while setup.is_some() || records < 8 {
        records += 1;
        match reader.metadata().ok()? {
            Next::End => break,
            Next::Other => {}
            Next::Metadata(body) => {
                let Ok(McapRecord::Metadata(m)) = mcap::parse_record(op::METADATA, &body) else { continue };
                if m.name == SETUP_METADATA {
                    setup = m.metadata.get("json").and_then(|json| serde_json::from_str(json).ok()).or(setup);
                }
            }
        }
    }
    setup
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use std::io::{Cursor, SeekFrom};
    use std::rc::Rc;

    /// Counts what is read.
    struct Counted(Cursor<Vec<u8>>, Rc<Cell<u64>>);

    impl Read for Counted {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let n = self.0.read(buffer)?;
            self.1.set(self.1.get() + n as u64);
            Ok(n)
        }
    }

    impl Seek for Counted {
        fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
            self.0.seek(to)
        }
    }

    /// The start of a chunk that claims to reach to the end of the file and to expand to `expanded` bytes.
    fn false_chunk(rest: usize, expanded: u64) -> Vec<u8> {
        let records = (rest - 1 - 8 - 28 - CHUNK_NAME.len() - 8) as u64;
        let mut out = vec![op::CHUNK];
        out.extend((rest as u64 - HEADER_LEN).to_le_bytes());
        out.extend([0; 16]);
        out.extend(expanded.to_le_bytes());
        out.extend([0; 4]);
        out.extend(CHUNK_NAME);
        out.extend(records.to_le_bytes());
        out
    }

    #[test]
    fn chunks_inside_of_chunks_that_are_all_damaged_are_not_read_without_end() {
        const LEN: usize = 400_000;
        // Within the file, and beyond its end.
        for beyond in [0, 1000] {
            let mut file = MAGIC.to_vec();
            while file.len() + 200 < LEN {
                let rest = LEN - file.len();
                file.extend(false_chunk(rest + beyond, rest as u64));
            }
            file.resize(LEN, 0);
            let read = Rc::new(Cell::new(0));
            let mut reader = McapReader::new(Counted(Cursor::new(file), Rc::clone(&read)), LEN as u64);
            assert!(matches!(reader.next(), Some(Err(LogError::NothingReadable { .. }))));
            assert!(reader.damage.skipped_bytes <= LEN as u64, "{:?}", reader.damage);
            // Each damaged chunk that is read empties the buffer of the file.
            let limit = 2 * (REREAD_LIMIT + 2) * LEN as u64;
            assert!(read.get() < limit, "{} bytes of a file of {LEN} were read", read.get());
        }
    }

    #[test]
    fn a_recording_without_a_vehicle_is_not_called_damaged() {
        let mut file = Cursor::new(Vec::new());
        let mut writer = mcap::WriteOptions::new().create(&mut file).unwrap();
        let channel_id = writer.add_channel(0, "/log", "json", &BTreeMap::new()).unwrap();
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, b"{}").unwrap();
        writer.finish().unwrap();
        drop(writer);
        let length = file.get_ref().len() as u64;
        let results: Vec<_> = McapReader::new(file, length).collect();
        assert!(matches!(results[..], [Err(LogError::NoFrames)]), "{results:?}");
    }

    #[test]
    fn a_chunk_that_claims_to_expand_without_measure_is_damage() {
        let body = false_chunk(300, 1 << 62);
        let mut reader = McapReader::new(Cursor::new(Vec::new()), 0);
        assert!(reader.chunk(&body[HEADER_LEN as usize..]).is_none());
    }
}
