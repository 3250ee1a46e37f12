//! PX4's own log (`.ulg`): `sensor_combined`, `vehicle_gps_position` (or `sensor_gps`), `vehicle_attitude`, and what flies.
//!
//! `sensor_combined` and `vehicle_imu` hold means over the integration interval that ends at the stamp, with the calibration applied
//! and without the filter's bias estimates; where a logger left samples out, they are points. The best source is taken.
//!
//! The format (PX4 user guide, "ULog File Format") has no checksums. A message is taken when its header, its length against
//! the format of its topic, and the header that follows it are right; after damage the reader looks byte by byte for the
//! next three messages in a row for which that holds. A message that damage touches is lost with it.

use super::source::{Choice, Source, Survey};
use super::window::Window;
use super::{Damage, HealthNote, LogError, LogNote, LogReader, Progress, Record};
use gaware_nav::observability::words::VehicleKind;
use std::collections::{HashMap, VecDeque};
use std::io::Read;

mod air;
mod basic;
mod fields;
mod health;
mod notes;
mod operating;
mod topics;
use basic::Basic;
use fields::Fields;
use notes::{airframe, board_note, keyed, parameter_note, version_note};
use topics::Topics;

/// First bytes of the format.
pub const MAGIC: &[u8; 4] = b"ULog";
/// Magic, version, time.
const FILE_HEADER: usize = 16;
/// Length and type.
const HEADER: usize = 3;
/// A longest message and the header behind it.
const ONE: usize = HEADER + u16::MAX as usize + HEADER + 2;
/// Messages in a row that must be right after damage.
const CHAIN: usize = 3;
/// Messages other than data are shorter than this, bytes: PX4 writes at most 1500.
const SHORT: usize = 4096;
/// Content of a synchronisation message.
const SYNC: [u8; 8] = [0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12];
/// Formats inside of formats.
const MAX_DEPTH: usize = 8;
/// Longer messages cannot be logged, bytes.
const MAX_DATA: usize = u16::MAX as usize;

/// A field as its format declares it.
#[derive(Debug, Clone, PartialEq)]
struct Declared {
    kind: String,
    count: usize,
    name: String,
}

/// A topic that is logged under a number.
#[derive(Debug, Clone)]
struct Subscription {
    name: String,
    instance: u8,
    /// Bytes of its data, without and with the padding at the end.
    size: (usize, usize),
    /// Place, type and number of values of every field of a basic type.
    fields: HashMap<String, (usize, Basic, usize)>,
}

/// What stands at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Check {
    /// A message of this length.
    Good(usize),
    /// Nothing that is one.
    Bad,
    /// More bytes are needed to decide.
    Short,
}

/// Formats and subscriptions.
#[derive(Debug, Default)]
struct Definitions {
    formats: HashMap<String, Vec<Declared>>,
    subscriptions: HashMap<u16, Subscription>,
}

/// Reads a ULog.
#[derive(Debug)]
pub struct UlogReader<R> {
    window: Window<R>,
    definitions: Definitions,
    damage: Damage,
    topics: Topics,
    queue: VecDeque<Record>,
    begun: bool,
    finished: bool,
}

impl<R: Read> UlogReader<R> {
    /// Starts to read at the first byte of `source`, which has `total_bytes`.
    pub fn new(source: R, total_bytes: u64) -> Self {
        Self {
            window: Window::new(source, total_bytes),
            definitions: Definitions::default(),
            damage: Damage::default(),
            topics: Topics::new(Choice::of(Source::COMBINED)),
            queue: VecDeque::new(),
            begun: false,
            finished: false,
        }
    }

    /// Takes the inertial samples from this source.
    pub fn with_source(mut self, choice: Choice) -> Self {
        self.topics = Topics::new(choice);
        self
    }

    /// Reads all of it for its inertial sources alone.
    ///
    /// # Errors
    /// When reading fails.
    pub fn survey(mut self) -> Result<Survey, LogError> {
        self.topics = Topics::surveying();
        while self.step()? {
            self.queue.clear();
        }
        Ok(self.topics.into_survey())
    }

    /// Reads one message or past one damaged place; false at the end.
    fn step(&mut self) -> Result<bool, LogError> {
        if !self.begun {
            self.begun = true;
            self.window.fill(FILE_HEADER)?;
            self.window.consume(FILE_HEADER);
        }
        self.window.fill(2 * ONE)?;
        if self.window.bytes().is_empty() {
            return Ok(false);
        }
        let bytes = self.window.bytes();
        let at_end = self.window.at_end();
        match self.definitions.check(bytes) {
            Check::Good(len) if self.definitions.ends_well(bytes, len, at_end) => {
                let kind = bytes.get(2).copied().unwrap_or_default();
                let body = bytes.get(HEADER..len).unwrap_or_default();
                let good = match kind {
                    b'D' => self.topics.take(body, &self.definitions, &mut self.queue),
                    _ => self.definitions.take(kind, body, &mut self.topics, &mut self.queue),
                };
                self.damage.bad_records += u64::from(!good);
                self.window.consume(len);
            }
            found => {
                let before = self.damage.skipped_bytes;
                let next = self.resynchronise()?;
                // The last message of a log that was cut, or a damaged length.
                let cut = found == Check::Short && at_end && !next;
                self.damage.truncated |= cut;
                if cut {
                    self.damage.skipped_bytes = before;
                }
                self.damage.bad_records += u64::from(!cut);
            }
        }
        Ok(true)
    }

    fn skip(&mut self, n: usize) {
        self.damage.skipped_bytes += n as u64;
        self.window.consume(n);
    }

    /// Goes to the next place where messages follow each other; false where there is none.
    fn resynchronise(&mut self) -> Result<bool, LogError> {
        self.skip(1);
        loop {
            self.window.fill(4 * ONE)?;
            let (bytes, at_end) = (self.window.bytes(), self.window.at_end());
            // A whole chain must fit behind every place that is looked at.
            let last = if at_end { bytes.len() } else { bytes.len().saturating_sub(3 * ONE) };
            let found =
                (0..last).find(|at| self.definitions.is_chain(bytes.get(*at..).unwrap_or_default(), at_end));
            self.skip(found.unwrap_or(last));
            if found.is_some() || at_end {
                return Ok(found.is_some());
            }
        }
    }
}

impl Definitions {
    /// What stands at the first byte, by header and length.
    fn check(&self, bytes: &[u8]) -> Check {
        let Some(&[a, b, kind]) = bytes.first_chunk::<HEADER>() else { return Check::Short };
        let size = usize::from(u16::from_le_bytes([a, b]));
        let body = bytes.get(HEADER..).unwrap_or_default();
        let text = |at: usize| body.get(at).is_none_or(|c| c.is_ascii_graphic());
        if kind != b'D' && size >= SHORT {
            return Check::Bad;
        }
        let right = match kind {
            b'B' => (40..64).contains(&size),
            b'F' => size >= 3 && text(0),
            b'I' => size >= 3 && text(1),
            b'M' => size >= 4 && text(2),
            b'P' => size >= 6 && text(1),
            b'Q' => size >= 7 && text(2),
            b'A' => size >= 4 && text(3),
            b'R' | b'O' => size == 2,
            // The level is a digit.
            b'L' => size >= 9 && body.first().is_none_or(|level| (b'0'..=b'7').contains(level)),
            b'C' => size >= 11 && body.first().is_none_or(|level| (b'0'..=b'7').contains(level)),
            b'S' => size == SYNC.len() && SYNC.iter().zip(body).all(|(a, b)| a == b),
            b'D' => match body.first_chunk() {
                Some(id) => self
                    .subscriptions
                    .get(&u16::from_le_bytes(*id))
                    .is_some_and(|s| (s.size.0 + 2..=s.size.1 + 2).contains(&size)),
                None => size >= 2,
            },
            _ => false,
        };
        match right {
            false => Check::Bad,
            true if body.len() < size => Check::Short,
            true => Check::Good(HEADER + size),
        }
    }

    /// Whether a message of this length is followed by another one. The first data of a topic come right behind its subscription.
    fn ends_well(&self, bytes: &[u8], len: usize, at_end: bool) -> bool {
        let rest = bytes.get(len..).unwrap_or_default();
        let id = bytes.get(HEADER + 1..HEADER + 3);
        let first_data =
            bytes.get(2) == Some(&b'A') && rest.get(2) == Some(&b'D') && rest.get(HEADER..HEADER + 2) == id;
        first_data || self.is_followed(rest, at_end)
    }

    /// Whether a message may end here: at the end of the file, or before another one.
    fn is_followed(&self, rest: &[u8], at_end: bool) -> bool {
        match self.check(rest) {
            Check::Good(_) => true,
            Check::Short => at_end,
            Check::Bad => false,
        }
    }

    /// Whether messages follow each other from here on; those at the very end of the file need no followers.
    fn is_chain(&self, bytes: &[u8], at_end: bool) -> bool {
        let mut rest = bytes;
        for k in 0..CHAIN {
            match self.check(rest) {
                Check::Good(len) if reads_well(rest.get(..len).unwrap_or_default()) => {
                    rest = rest.get(len..).unwrap_or_default();
                    if rest.is_empty() && at_end {
                        return true;
                    }
                }
                Check::Short => return at_end && k > 0,
                _ => return false,
            }
        }
        true
    }

    /// Takes a message that is no data; false where its content is wrong.
    fn take(&mut self, kind: u8, body: &[u8], topics: &mut Topics, out: &mut VecDeque<Record>) -> bool {
        match kind {
            b'F' => self.format(body).is_some(),
            b'A' => self.subscribe(body).is_some(),
            b'R' => body
                .first_chunk()
                .is_some_and(|id| self.subscriptions.remove(&u16::from_le_bytes(*id)).is_some()),
            b'P' => {
                let class = airframe(body);
                out.extend(topics.learn_class(|own| own.1 = class.or(own.1)));
                out.extend(parameter_note(body).map(|note| topics.record(note)));
                true
            }
            b'I' => {
                out.extend(version_note(body).or_else(|| board_note(body)).map(|note| topics.record(note)));
                true
            }
            // A dropout, ms.
            b'O' => {
                let pause = body.first_chunk().map(|ms| 1e-3 * f64::from(u16::from_le_bytes(*ms)));
                out.extend(pause.map(|s| topics.record(LogNote::Health(HealthNote::Pause(s)))));
                true
            }
            b'L' => {
                out.extend(
                    health::text(body).map(|(t_us, note)| topics.record_at(t_us, LogNote::Health(note))),
                );
                true
            }
            _ => true,
        }
    }

    fn has_topic(&self, name: &str) -> bool {
        self.subscriptions.values().any(|s| s.name == name)
    }

    fn format(&mut self, body: &[u8]) -> Option<()> {
        let (name, fields) = std::str::from_utf8(body).ok()?.split_once(':')?;
        let declared = |field: &str| {
            let (kind, name) = field.trim().split_once(' ')?;
            let (kind, count) = match kind.split_once('[') {
                Some((kind, count)) => (kind, count.strip_suffix(']')?.parse().ok()?),
                None => (kind, 1),
            };
            Some(Declared { kind: kind.to_owned(), count, name: name.to_owned() })
        };
        let fields =
            fields.split(';').filter(|f| !f.trim().is_empty()).map(declared).collect::<Option<_>>()?;
        self.formats.insert(name.to_owned(), fields);
        Some(())
    }

    fn subscribe(&mut self, body: &[u8]) -> Option<()> {
        let (&[instance, a, b], name) = body.split_first_chunk()?;
        let name = std::str::from_utf8(name).ok()?;
        let declared = self.formats.get(name)?;
        let (mut at, mut padding, mut fields) = (0_usize, 0, HashMap::new());
        for field in declared {
            let size = self.size_of(&field.kind, 0)?.checked_mul(field.count).filter(|s| *s <= MAX_DATA)?;
            if let Some(basic) = Basic::of(&field.kind) {
                fields.insert(field.name.clone(), (at, basic, field.count));
            }
            padding = if field.name.starts_with("_padding") { padding + size } else { 0 };
            at = at.checked_add(size).filter(|at| *at <= MAX_DATA)?;
        }
        let subscription = Subscription { name: name.to_owned(), instance, size: (at - padding, at), fields };
        self.subscriptions.insert(u16::from_le_bytes([a, b]), subscription);
        Some(())
    }

    fn size_of(&self, kind: &str, depth: usize) -> Option<usize> {
        if let Some(basic) = Basic::of(kind) {
            return Some(basic.size());
        }
        let inner = self.formats.get(kind).filter(|_| depth < MAX_DEPTH)?;
        inner.iter().try_fold(0_usize, |sum, f| {
            let size = self.size_of(&f.kind, depth + 1)?.checked_mul(f.count)?;
            sum.checked_add(size).filter(|s| *s <= MAX_DATA)
        })
    }
}

/// Whether the content of a message is what its type says. Among damaged bytes three that look like a header are no rarity, and a
/// length by chance swallows what follows.
fn reads_well(message: &[u8]) -> bool {
    let body = message.get(HEADER..).unwrap_or_default();
    let key = |at: usize| {
        let key = body.get(at..).and_then(keyed).map_or("", |(key, _)| key);
        key.contains(' ') && key.bytes().all(|c| c == b' ' || c.is_ascii_graphic())
    };
    let text = |at: usize| {
        body.get(at..).is_some_and(|t| std::str::from_utf8(t).is_ok_and(|text| !text.contains('\0')))
    };
    match message.get(2) {
        Some(b'I' | b'P') => key(0),
        Some(b'M' | b'Q') => key(1),
        Some(b'F') => text(0),
        Some(b'A') => text(3),
        Some(b'L') => text(9),
        Some(b'C') => text(11),
        _ => true,
    }
}

impl<R: Read> Iterator for UlogReader<R> {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.queue.is_empty() && !self.finished {
            match self.step() {
                Ok(true) => {}
                Ok(false) => {
                    self.finished = true;
                    if self.topics.given == 0 {
                        let bytes = self.window.progress().total_bytes;
                        return Some(Err(LogError::NothingReadable { format: "ULog", bytes }));
                    }
                }
                Err(error) => {
                    self.finished = true;
                    return Some(Err(error));
                }
            }
        }
        self.queue.pop_front().map(Ok)
    }
}

impl<R: Read + Send> LogReader for UlogReader<R> {
    fn progress(&self) -> Progress {
        self.window.progress()
    }

    fn damage(&self) -> Damage {
        self.damage
    }

    fn autopilot(&self) -> Option<&'static str> {
        Some("px4")
    }

    fn vehicle_kind(&self) -> Option<VehicleKind> {
        self.topics.kind()
    }
}

#[cfg(test)]
mod tests;
