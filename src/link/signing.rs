//! MAVLink 2 signing: 13 bytes that prove who sent a frame and that it is no repetition.
//!
//! Times are 10 µs ticks since 2015-01-01. A sender's times only ever rise, also across restarts and on a computer whose
//! clock is wrong: the last one used is kept in a file beside the key. The key itself never appears in a log or an
//! error.

use super::frame::{FLAG_SIGNED, Frame, SIGNATURE_LEN};
use bytes::Bytes;
use mavlink::{MAVLinkV2MessageRaw, calculate_crc};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// 2015-01-01 in Unix µs.
const EPOCH_US: u64 = 1_420_070_400_000_000;
const TICK_US: u64 = 10;
/// A stream that is new to us may lag behind by this much: one minute.
const NEW_STREAM_TICKS: u64 = 60 * 100_000;
/// A stamp this far ahead of our clock is one of a wrong clock, there or here, and counts for itself: one day. Receivers whose clocks are set by GNSS
/// and computers whose clock was ever set agree far better.
const AHEAD_TICKS: u64 = 86_400 * 100_000;
/// Streams that are remembered; no link carries so many.
const MAX_STREAMS: usize = 1024;
/// The newest times of others are kept at least so often, ticks: one second.
const KEEP_TICKS: u64 = 100_000;
/// Ticks that are reserved in the file ahead of use, so that it is written once in ten seconds and not per frame.
const RESERVE_TICKS: u64 = 10 * 100_000;

/// The shared secret.
#[derive(Clone)]
pub struct Key([u8; 32]);

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(…)")
    }
}

/// Why signing cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum SigningError {
    /// The key file cannot be read.
    #[error("cannot read the signing key {path}: {source}")]
    Read {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Neither 32 bytes nor 64 hexadecimal digits.
    #[error("{0} is no signing key: it must hold 32 bytes or 64 hexadecimal digits")]
    Malformed(PathBuf),
}

impl Key {
    /// From its bytes.
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Whether others than its owner may read this key file.
    #[cfg(unix)]
    pub fn is_exposed(path: &Path) -> bool {
        use std::os::unix::fs::PermissionsExt;
        std::fs::metadata(path).is_ok_and(|m| m.permissions().mode() & 0o077 != 0)
    }

    /// Whether others than its owner may read this key file: not known here.
    #[cfg(not(unix))]
    pub fn is_exposed(_: &Path) -> bool {
        false
    }

    /// From a file of 32 bytes or 64 hexadecimal digits.
    ///
    /// # Errors
    /// When the file cannot be read or holds no key.
    pub fn load(path: &Path) -> Result<Self, SigningError> {
        let bytes = crate::inputs::bytes(path)
            .map_err(|source| SigningError::Read { path: path.to_owned(), source })?;
        if let Ok(key) = <[u8; 32]>::try_from(bytes.as_slice()) {
            return Ok(Self(key));
        }
        std::str::from_utf8(&bytes)
            .ok()
            .and_then(|text| from_hex(text.trim()))
            .map(Self)
            .ok_or_else(|| SigningError::Malformed(path.to_owned()))
    }
}

fn from_hex(text: &str) -> Option<[u8; 32]> {
    let mut key = [0; 32];
    // A sign is no digit, although numbers may begin with one.
    if text.len() != 64 || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    for (k, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * k..2 * k + 2)?, 16).ok()?;
    }
    Some(key)
}

/// Unix µs in ticks.
fn ticks(unix_us: u64) -> u64 {
    unix_us.saturating_sub(EPOCH_US) / TICK_US
}

/// Signs our frames.
#[derive(Debug)]
pub struct Signer {
    key: Key,
    last: u64,
}

impl Signer {
    /// A signer; `last_ticks` is the last time used before (0 where there is none).
    pub fn new(key: Key, last_ticks: u64) -> Self {
        Self { key, last: last_ticks }
    }

    /// The last time used, to be kept across restarts.
    pub fn last_ticks(&self) -> u64 {
        self.last
    }

    /// The same MAVLink 2 frame with a signature for the link that it is sent over; MAVLink 1 has none and is returned as it is.
    pub fn sign(&mut self, frame: &Frame, link_id: u8, unix_us: u64) -> Frame {
        self.last = ticks(unix_us).max(self.last + 1);
        signed(frame, &self.key, link_id, self.last).unwrap_or_else(|| frame.clone())
    }
}

fn signed(frame: &Frame, key: &Key, link_id: u8, ticks: u64) -> Option<Frame> {
    let mut raw = frame.raw().to_vec();
    if frame.signature().is_some() {
        raw.truncate(raw.len() - SIGNATURE_LEN);
    }
    // The flag is part of what the checksum covers, so the frame is closed anew.
    let magic = *raw.first()?;
    if magic != super::frame::MAGIC_V2 {
        return None;
    }
    *raw.get_mut(2)? |= FLAG_SIGNED;
    let end = raw.len().checked_sub(2)?;
    let extra =
        <mavlink::dialects::ardupilotmega::MavMessage as mavlink::Message>::extra_crc(frame.message_id);
    let crc = calculate_crc(raw.get(1..end)?, extra);
    raw.truncate(end);
    raw.extend(crc.to_le_bytes());
    raw.push(link_id);
    raw.extend(ticks.to_le_bytes().iter().take(6));
    let hash = hash(&raw, key)?;
    raw.extend(hash);
    Frame::parse(Bytes::from(raw)).ok()
}

/// The 48-bit hash over key, frame, link id and time; `raw` ends with the time, or goes on with a hash.
fn hash(raw: &[u8], key: &Key) -> Option<[u8; 6]> {
    let mut whole = MAVLinkV2MessageRaw::new();
    let len = raw.len();
    whole.as_mut_slice().get_mut(..len)?.copy_from_slice(raw);
    let mut hash = [0; 6];
    whole.calculate_signature(&key.0, &mut hash);
    Some(hash)
}

/// What a signature says of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trust {
    /// Signed with our key, and newer than anything of its sender.
    Genuine,
    /// The same, with a stamp so many days ahead of our clock.
    Ahead(u64),
    /// Not signed.
    Unsigned,
    /// Signed with another key, or damaged.
    WrongKey,
    /// Signed with our key and received before, or too old for a new sender.
    Old,
}

/// A stream of signed frames: link id, system, component.
pub type Stream = (u8, u8, u8);

/// The newest stamps of a stream, ticks. Those far ahead of our clock are kept apart: a clock that once was wrong must not lock its sender
/// out once it is right.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Newest {
    /// Near our clock or behind it; 0 where there was none.
    pub near: u64,
    /// Far ahead of it.
    pub ahead: u64,
}

/// Checks the signatures of others.
#[derive(Debug)]
pub struct Verifier {
    key: Key,
    newest: BTreeMap<Stream, Newest>,
}

impl Verifier {
    /// Knows the newest time of every stream that was received before.
    pub fn new(key: Key, newest: BTreeMap<Stream, Newest>) -> Self {
        Self { key, newest }
    }

    /// The newest time of every stream, to be kept across restarts.
    pub fn newest(&self) -> &BTreeMap<Stream, Newest> {
        &self.newest
    }

    /// Judges a frame. New streams are compared with our own time and with no one else's: a sender whose clock is ahead must not
    /// lock the others out.
    pub fn judge(&mut self, frame: &Frame, unix_us: u64) -> Trust {
        let Some([link_id, a, b, c, d, e, f, theirs @ ..]) = frame.signature() else {
            return Trust::Unsigned;
        };
        let covered = frame.raw().len().saturating_sub(theirs.len());
        match frame.raw().get(..covered).and_then(|raw| hash(raw, &self.key)) {
            Some(ours) if ours == *theirs => {}
            _ => return Trust::WrongKey,
        }
        let time = u64::from_le_bytes([*a, *b, *c, *d, *e, *f, 0, 0]);
        let sender = (*link_id, frame.system_id, frame.component_id);
        let (now, known) = (ticks(unix_us), self.newest.get(&sender).copied());
        let mut newest = known.unwrap_or_default();
        let ahead = time > now + AHEAD_TICKS;
        // What was received before stays old, whichever of the clocks is set back.
        let old = match (ahead, newest.near) {
            (true, near) => time <= near.max(newest.ahead),
            (false, 0) => time + NEW_STREAM_TICKS < now,
            (false, near) => time <= near,
        };
        if old || known.is_none() && self.newest.len() >= MAX_STREAMS {
            return Trust::Old;
        }
        *(if ahead { &mut newest.ahead } else { &mut newest.near }) = time;
        self.newest.insert(sender, newest);
        if ahead { Trust::Ahead((time - now) / AHEAD_TICKS) } else { Trust::Genuine }
    }
}

/// What a [`TimeFile`] holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Times {
    /// The last time that we may have used.
    pub ours: u64,
    /// The newest time of every stream that was received.
    pub others: BTreeMap<Stream, Newest>,
}

/// The file that keeps the times of signatures across restarts: ours in the first line, then link id, system, component and newest times of
/// each stream that was received, near our clock and far ahead of it.
#[derive(Debug)]
pub struct TimeFile {
    path: PathBuf,
    reserved: u64,
    /// Our time when the file was last written.
    written: u64,
}

impl TimeFile {
    /// Reads the times; nothing where there is no file yet.
    pub fn open(path: &Path) -> (Self, Times) {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let mut lines = text.lines();
        let ours = lines.next().and_then(|t| t.trim().parse().ok()).unwrap_or(0);
        let others = lines.filter_map(|line| {
            let mut words = line.split_whitespace();
            let mut id = || words.next()?.parse::<u8>().ok();
            let stream = (id()?, id()?, id()?);
            let mut newest = || words.next()?.parse().ok();
            Some((stream, Newest { near: newest()?, ahead: newest().unwrap_or(0) }))
        });
        let times = Times { ours, others: others.collect() };
        (Self { path: path.to_owned(), reserved: ours, written: 0 }, times)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes sure that the file holds a time beyond our last one, and those of others of a second ago at least.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep(&mut self, last_ticks: u64, others: &BTreeMap<Stream, Newest>) -> std::io::Result<()> {
        if last_ticks < self.reserved && last_ticks < self.written + KEEP_TICKS {
            return Ok(());
        }
        self.write(last_ticks, others)
    }

    /// Writes the file now, as at the end of the program.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&mut self, last_ticks: u64, others: &BTreeMap<Stream, Newest>) -> std::io::Result<()> {
        let reserved = if last_ticks < self.reserved { self.reserved } else { last_ticks + RESERVE_TICKS };
        let mut text = format!("{reserved}\n");
        for ((link, system, component), newest) in others {
            text.push_str(&format!("{link} {system} {component} {} {}\n", newest.near, newest.ahead));
        }
        let fresh = self.path.with_extension("new");
        std::fs::write(&fresh, text)?;
        std::fs::rename(&fresh, &self.path)?;
        (self.reserved, self.written) = (reserved, last_ticks);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::Sender;
    use super::super::heartbeat::heartbeat;
    use super::*;

    const NOW: u64 = 1_800_000_000_000_000;

    fn frame() -> Frame {
        Frame::encode(Sender { system_id: 1, component_id: 191 }, 4, &heartbeat(true))
    }

    fn key() -> Key {
        Key::new([7; 32])
    }

    fn verifier() -> Verifier {
        Verifier::new(key(), BTreeMap::new())
    }

    #[test]
    fn a_signed_frame_is_genuine_once() {
        let signed = Signer::new(key(), 0).sign(&frame(), 3, NOW);
        assert_eq!(signed.signature().map(|s| s[0]), Some(3), "the id of the link");
        assert_eq!(signed.raw().len(), frame().raw().len() + SIGNATURE_LEN);
        assert_eq!(signed.decode().unwrap(), frame().decode().unwrap());
        let mut verifier = verifier();
        assert_eq!(verifier.judge(&signed, NOW), Trust::Genuine);
        assert_eq!(verifier.judge(&signed, NOW), Trust::Old);
        assert_eq!(verifier.judge(&frame(), NOW), Trust::Unsigned);
        let mut other = Verifier::new(Key::new([8; 32]), BTreeMap::new());
        assert_eq!(other.judge(&signed, NOW), Trust::WrongKey);
    }

    #[test]
    fn the_crate_accepts_what_we_sign() {
        let signed = Signer::new(key(), 0).sign(&frame(), 3, NOW);
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice()[..signed.raw().len()].copy_from_slice(signed.raw());
        let theirs = mavlink::SigningData::from_config(mavlink::SigningConfig::new([7; 32], 0, false, false));
        assert!(theirs.verify_signature(&raw));
    }

    #[test]
    fn times_rise_although_the_clock_goes_back() {
        let mut signer = Signer::new(key(), 0);
        let mut verifier = verifier();
        for now in [NOW, NOW, NOW - 3_600_000_000, 0] {
            assert_eq!(verifier.judge(&signer.sign(&frame(), 0, now), NOW), Trust::Genuine);
        }
    }

    #[test]
    fn a_new_sender_far_behind_is_not_believed() {
        let late = Signer::new(key(), 0).sign(&frame(), 0, NOW - 61_000_000);
        assert_eq!(verifier().judge(&late, NOW), Trust::Old);
    }

    #[test]
    fn a_sender_whose_clock_is_a_year_ahead_locks_nobody_out() {
        let mut verifier = verifier();
        let ahead = Signer::new(key(), 0).sign(&frame(), 9, NOW + 365 * 86_400_000_000);
        assert_eq!(verifier.judge(&ahead, NOW), Trust::Ahead(365));
        let honest = Signer::new(key(), 0).sign(&frame(), 1, NOW);
        assert_eq!(verifier.judge(&honest, NOW), Trust::Genuine);
        // Nor itself, once its clock is right, across a restart and in the same stream; neither frame is taken twice.
        let right = Signer::new(key(), 0).sign(&frame(), 9, NOW + 1_000_000);
        let mut verifier = Verifier::new(key(), verifier.newest().clone());
        let later = NOW + 2_000_000;
        assert_eq!(verifier.judge(&right, later), Trust::Genuine);
        for again in [&ahead, &right] {
            assert_eq!(verifier.judge(again, later), Trust::Old);
        }
        // Set back by a year our own clock makes nothing new that was received before.
        assert_eq!(verifier.judge(&right, NOW - 365 * 86_400_000_000), Trust::Old);
    }

    #[test]
    fn times_are_kept_across_restarts_and_old_frames_stay_old() {
        let path = std::env::temp_dir().join(format!("gaware-signing-{}", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let (mut file, times) = TimeFile::open(&path);
        assert_eq!(times, Times::default());
        let mut signer = Signer::new(key(), times.ours);
        let mut heard = Verifier::new(key(), times.others);
        let mut theirs = Signer::new(key(), 0);
        let mut frames = Vec::new();
        for k in 0..700 {
            let signed = theirs.sign(&frame(), 2, NOW + k * 10_000);
            assert_eq!(heard.judge(&signed, NOW + k * 10_000), Trust::Genuine);
            frames.push(signed);
            signer.sign(&frame(), 0, NOW + k * 10_000);
            file.keep(signer.last_ticks(), heard.newest()).unwrap();
        }
        // Ended without a word: the last second may be received again, the end of a run writes it down as well.
        let (_, killed) = TimeFile::open(&path);
        assert!(killed.ours > signer.last_ticks());
        let replayed = |others: BTreeMap<Stream, Newest>| {
            let mut again = Verifier::new(key(), others);
            frames.iter().filter(|f| again.judge(f, NOW + 7_000_000) == Trust::Genuine).count()
        };
        assert!(replayed(killed.others) <= 100);
        file.write(signer.last_ticks(), heard.newest()).unwrap();
        assert_eq!(replayed(TimeFile::open(&path).1.others), 0);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn keys_are_bytes_or_hexadecimal_and_never_shown() {
        let path = std::env::temp_dir().join(format!("gaware-key-{}", std::process::id()));
        let load = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            Key::load(&path)
        };
        assert_eq!(load(&[9; 32]).unwrap().0, [9; 32]);
        assert_eq!(load(format!("{}\n", "0a".repeat(32)).as_bytes()).unwrap().0, [10; 32]);
        assert!(load("+1".repeat(32).as_bytes()).is_err(), "a sign is no digit");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let exposed = |mode| {
                std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
                Key::is_exposed(&path)
            };
            assert_eq!([exposed(0o644), exposed(0o600)], [true, false]);
        }
        let error = load(b"secret").unwrap_err().to_string();
        assert!(!error.contains("secret") && error.contains("64 hexadecimal"), "{error}");
        assert_eq!(format!("{:?}", key()), "Key(…)");
        std::fs::remove_file(&path).unwrap();
    }
}
