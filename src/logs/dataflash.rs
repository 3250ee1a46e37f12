//! ArduPilot's own log (`.bin`): inertial samples at the loop rate in floating point, fixes with vertical velocity and
//! their accuracies, the autopilot's attitude, and what flies.
//!
//! `IMU` holds the same filtered point samples as the messages on the link, unrounded. `GPS` is followed by a `GPA` of the
//! same time with the accuracies and the time of arrival; a fix waits for it. The best inertial source and the first receiver are used.
//!
//! The format (ArduPilot, `AP_Logger/LogStructure.h`) describes itself by `FMT` messages and has no checksums. A message is
//! taken when its header is right and another header follows it; after damage the reader looks byte by byte for the next two
//! messages in a row. A message that damage touches is lost with it.

use super::source::{Choice, Source, Survey};
use super::window::Window;
use super::{Damage, Item, LogError, LogReader, Progress, Record};
use crate::timeline::Measurement;
use gaware_nav::observability::words::VehicleKind;
use nalgebra::Vector3;
use std::io::Read;

mod air;
mod fixes;
mod health;
mod inertial;
mod magnetic;
mod messages;
mod notes;
mod operating;
pub mod text;
use messages::Messages;

/// First bytes of a message of this format.
pub const MAGIC: [u8; 2] = [0xA3, 0x95];
const HEADER: usize = 3;
/// Type and length of the message that describes the others.
const FMT: u8 = 128;
const FMT_LEN: usize = 89;
/// A longest message.
const LONGEST: usize = 255;
/// Messages in a row that must be right after damage.
const CHAIN: usize = 2;

/// A type of message, as its `FMT` describes it.
#[derive(Debug, Clone, PartialEq)]
struct Format {
    name: String,
    /// With header.
    len: usize,
    /// Label, type and place behind the header of every field.
    fields: Vec<(String, u8, usize)>,
}

impl Format {
    /// From the content of a `FMT`: type described, length, name, types, labels. Nothing where they do not fit each other.
    fn parse(body: &[u8]) -> Option<(u8, Self)> {
        let (&[described, len], rest) = body.split_first_chunk()?;
        let (name, rest) = rest.split_at_checked(4)?;
        let (types, labels) = rest.split_at_checked(16)?;
        let (name, types, labels) = (text(name)?, text(types)?, text(labels)?);
        let mut labels = labels.split(',');
        let (mut at, mut fields) = (0, Vec::new());
        for kind in types.bytes() {
            fields.push((labels.next()?.to_owned(), kind, at));
            at += size(kind)?;
        }
        let fits = at + HEADER == usize::from(len) && !name.is_empty();
        fits.then(|| (described, Self { name: name.to_owned(), len: usize::from(len), fields }))
    }
}

/// Text up to its first NUL.
fn text(bytes: &[u8]) -> Option<&str> {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    std::str::from_utf8(bytes.get(..end)?)
        .ok()
        .filter(|t| t.bytes().all(|b| b.is_ascii_graphic() || b == b' '))
}

/// Bytes of a field of this type.
fn size(kind: u8) -> Option<usize> {
    Some(match kind {
        b'b' | b'B' | b'M' => 1,
        b'h' | b'H' | b'c' | b'C' | b'g' => 2,
        b'i' | b'I' | b'f' | b'e' | b'E' | b'L' | b'n' => 4,
        b'd' | b'q' | b'Q' => 8,
        b'N' => 16,
        b'Z' | b'a' => 64,
        _ => return None,
    })
}

/// A message with its format.
struct Entry<'a> {
    format: &'a Format,
    body: &'a [u8],
}

impl Entry<'_> {
    fn bytes(&self, label: &str) -> Option<(u8, &[u8])> {
        let (_, kind, at) = self.format.fields.iter().find(|(l, ..)| l == label)?;
        Some((*kind, self.body.get(*at..)?.get(..size(*kind)?)?))
    }

    fn text(&self, label: &str) -> Option<&str> {
        text(self.bytes(label).filter(|(kind, _)| matches!(kind, b'n' | b'N' | b'Z'))?.1)
    }

    /// A finite number; hundredths are distinguished by their type, degrees of 1e-7 are not.
    fn number(&self, label: &str) -> Option<f64> {
        let (kind, b) = self.bytes(label)?;
        let value = match kind {
            b'b' => f64::from(i8::from_le_bytes(*b.first_chunk()?)),
            b'B' | b'M' => f64::from(u8::from_le_bytes(*b.first_chunk()?)),
            b'h' => f64::from(i16::from_le_bytes(*b.first_chunk()?)),
            b'H' => f64::from(u16::from_le_bytes(*b.first_chunk()?)),
            b'c' => f64::from(i16::from_le_bytes(*b.first_chunk()?)) / 100.0,
            b'C' => f64::from(u16::from_le_bytes(*b.first_chunk()?)) / 100.0,
            b'i' | b'L' => f64::from(i32::from_le_bytes(*b.first_chunk()?)),
            b'I' => f64::from(u32::from_le_bytes(*b.first_chunk()?)),
            b'e' => f64::from(i32::from_le_bytes(*b.first_chunk()?)) / 100.0,
            b'E' => f64::from(u32::from_le_bytes(*b.first_chunk()?)) / 100.0,
            b'f' => f64::from(f32::from_le_bytes(*b.first_chunk()?)),
            b'd' => f64::from_le_bytes(*b.first_chunk()?),
            b'q' => i64::from_le_bytes(*b.first_chunk()?) as f64,
            b'Q' => u64::from_le_bytes(*b.first_chunk()?) as f64,
            _ => return None,
        };
        value.is_finite().then_some(value)
    }

    fn vector(&self, labels: [&str; 3]) -> Option<Vector3<f64>> {
        let [x, y, z] = labels.map(|l| self.number(l));
        Some(Vector3::new(x?, y?, z?))
    }

    /// µs since boot; firmware before 2015 counts ms. What has a week has the receiver's time of week under that label, and the time since
    /// boot under `T` (ArduPilot 3.2, `DataFlash/DataFlash.h`: `GPS`).
    fn stamp_us(&self) -> Option<u64> {
        match self.bytes("TimeUS") {
            Some((b'Q', b)) => Some(u64::from_le_bytes(*b.first_chunk()?)),
            Some(_) => self.number("TimeUS").map(|t| t as u64),
            None => {
                let boot = self.number("T").filter(|_| self.bytes("Week").is_some());
                boot.or_else(|| self.number("TimeMS")).map(|t| t as u64 * 1000)
            }
        }
    }
}

/// Reads a DataFlash log.
#[derive(Debug)]
pub struct DataflashReader<R> {
    window: Window<R>,
    formats: Vec<Option<Format>>,
    damage: Damage,
    messages: Messages,
    given: u64,
    finished: bool,
}

impl<R: Read> DataflashReader<R> {
    /// Starts at the first byte of `source`, which has `total_bytes`.
    pub fn new(source: R, total_bytes: u64) -> Self {
        Self {
            window: Window::new(source, total_bytes),
            formats: vec![None; 256],
            damage: Damage::default(),
            messages: Messages::new(Choice::of(Source::IMU)),
            given: 0,
            finished: false,
        }
    }

    /// Takes the inertial samples from this source.
    pub fn with_source(mut self, choice: Choice) -> Self {
        self.messages = Messages::new(choice);
        self
    }

    /// Reads all of it for its inertial sources alone.
    ///
    /// # Errors
    /// When reading fails.
    pub fn survey(mut self) -> Result<Survey, LogError> {
        self.messages = Messages::surveying();
        while self.step()? {
            self.messages.queue.clear();
        }
        Ok(self.messages.into_survey())
    }

    /// Reads one message or past one damaged place; false at the end.
    fn step(&mut self) -> Result<bool, LogError> {
        self.window.fill((CHAIN + 2) * LONGEST)?;
        let (bytes, at_end) = (self.window.bytes(), self.window.at_end());
        if bytes.is_empty() {
            return Ok(false);
        }
        let len = self.len(bytes);
        if let Some(len) = len.filter(|len| is_followed(bytes.get(*len..).unwrap_or_default(), at_end))
            && let Some(body) = bytes.get(HEADER..len)
        {
            let kind = bytes.get(2).copied().unwrap_or_default();
            let good = if kind == FMT {
                Format::parse(body).map(|(described, format)| {
                    if let Some(place) = self.formats.get_mut(usize::from(described)) {
                        *place = Some(format);
                    }
                })
            } else {
                let format = self.formats.get(usize::from(kind)).and_then(Option::as_ref);
                format.and_then(|format| self.messages.take(&Entry { format, body }))
            };
            self.damage.bad_records += u64::from(good.is_none());
            self.window.consume(len);
        } else if at_end && len.is_some_and(|len| len > bytes.len()) {
            // Logging ends with the power, or the file at the size that it was copied with.
            self.damage.truncated = true;
            let n = bytes.len();
            self.window.consume(n);
        } else {
            self.damage.bad_records += 1;
            self.resynchronise()?;
        }
        Ok(true)
    }

    fn skip(&mut self, n: usize) {
        self.damage.skipped_bytes += n as u64;
        self.window.consume(n);
    }

    /// Length of the message that starts here, where that is a known one.
    fn len(&self, bytes: &[u8]) -> Option<usize> {
        let (magic, rest) = bytes.split_first_chunk::<2>()?;
        let kind = *rest.first().filter(|_| *magic == MAGIC)?;
        if kind == FMT {
            return Some(FMT_LEN);
        }
        self.formats.get(usize::from(kind))?.as_ref().map(|f| f.len)
    }

    /// Goes to the next place where messages follow each other.
    fn resynchronise(&mut self) -> Result<(), LogError> {
        self.skip(1);
        loop {
            self.window.fill(16 * 1024)?;
            let (bytes, at_end) = (self.window.bytes(), self.window.at_end());
            // A whole chain must fit behind every place that is looked at.
            let last = if at_end { bytes.len() } else { bytes.len().saturating_sub((CHAIN + 1) * LONGEST) };
            let found = (0..last).find(|at| self.is_chain(bytes.get(*at..).unwrap_or_default(), at_end));
            self.skip(found.unwrap_or(last));
            if found.is_some() || at_end {
                return Ok(());
            }
        }
    }

    fn is_chain(&self, bytes: &[u8], at_end: bool) -> bool {
        let mut rest = bytes;
        for _ in 0..CHAIN {
            let Some(next) = self.len(rest).and_then(|len| rest.get(len..)) else { return false };
            if next.is_empty() {
                return at_end;
            }
            rest = next;
        }
        is_followed(rest, at_end)
    }
}

/// Whether a message may end here: at the end of the file, or before the header of another one.
fn is_followed(rest: &[u8], at_end: bool) -> bool {
    match rest {
        [] => at_end,
        [a] => at_end && *a == MAGIC[0],
        [a, b, ..] => [*a, *b] == MAGIC,
    }
}

impl<R: Read> Iterator for DataflashReader<R> {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.messages.queue.is_empty() && !self.finished {
            match self.step() {
                Ok(true) => {}
                Ok(false) => {
                    self.finished = true;
                    self.messages.release_fix();
                    if self.given == 0 && self.messages.queue.is_empty() {
                        let bytes = self.window.progress().total_bytes;
                        let nothing = LogError::NothingReadable { format: "DataFlash", bytes };
                        return Some(Err(if self.messages.taken() > 0 {
                            LogError::NoTimes
                        } else {
                            nothing
                        }));
                    }
                }
                Err(error) => {
                    self.finished = true;
                    return Some(Err(error));
                }
            }
        }
        let record = self.messages.queue.pop_front()?;
        let measured =
            matches!(&record.item, Item::Measurement(m) if !matches!(m, Measurement::Operating(..)));
        self.given += u64::from(measured);
        Some(Ok(record))
    }
}

impl<R: Read + Send> LogReader for DataflashReader<R> {
    fn progress(&self) -> Progress {
        self.window.progress()
    }

    fn damage(&self) -> Damage {
        self.damage
    }

    fn autopilot(&self) -> Option<&'static str> {
        Some("ardupilot")
    }

    fn vehicle_kind(&self) -> Option<VehicleKind> {
        self.messages.kind()
    }
}

#[cfg(test)]
mod tests;
