//! The open file of a recording: its channels and how items become messages.

use super::flat::{States, plain};
use super::foxglove::{FrameTransform, LocationFix, Log, PoseInFrame};
use super::records::{AttitudeRecord, FixRecord, ImuRecord};
use super::{CHUNK_BYTES, FRAME_TOPIC, MODEL_ATTACHMENT, RecordItem, SETUP_METADATA, Setup};
use crate::engine::snapshot::{Phase, Snapshot};
use gaware_nav::sample::Sample;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, WriteOptions, Writer};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Topic of the estimate as flat numbers.
const STATES_TOPIC: &str = "/states";

/// Writes at the end of the file, wherever that is, and counts: after a truncation the file stays too short for good, where
/// writing at an offset would leave a hole that looks like data.
struct Appending {
    file: File,
    taken: Arc<AtomicU64>,
}

impl Write for Appending {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let taken = self.file.write(bytes)?;
        self.taken.fetch_add(taken as u64, Ordering::Relaxed);
        Ok(taken)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// The open file and its channels.
pub(super) struct Output {
    pub(super) file: File,
    /// Bytes that the file took. It only grows, so a shorter file was truncated by another process.
    pub(super) appended: Arc<AtomicU64>,
    writer: Writer<NoSeek<BufWriter<Appending>>>,
    frames: BTreeMap<u16, u16>,
    channels: BTreeMap<&'static str, u16>,
    /// Columns and channel of the states.
    states: Option<(Vec<String>, u16)>,
    sequence: u32,
}

impl Output {
    pub(super) fn create(path: &Path, setup: &Setup) -> Result<Self, McapError> {
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let file = File::options().append(true).create_new(true).open(path)?;
        // Whoever makes space for other recordings leaves this one alone. A file system without locks has one recorder.
        let _ = file.try_lock_shared();
        let appended = Arc::default();
        let sink = Appending { file: file.try_clone()?, taken: Arc::clone(&appended) };
        let options = WriteOptions::new()
            .library(format!("gaware {}", setup.version))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut writer = options.create(NoSeek::new(BufWriter::new(sink)))?;
        let json = serde_json::to_string(setup).unwrap_or_default();
        writer.write_metadata(&Metadata {
            name: SETUP_METADATA.to_owned(),
            metadata: BTreeMap::from([("json".to_owned(), json)]),
        })?;
        writer.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: MODEL_ATTACHMENT.to_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(setup.model_toml.as_bytes()),
        })?;
        let mut output = Self {
            file,
            appended,
            writer,
            frames: BTreeMap::new(),
            channels: BTreeMap::new(),
            states: None,
            sequence: 0,
        };
        // All channels at once, in a chunk of their own: damage to later chunks cannot take them away.
        for (link, address) in setup.links.iter().enumerate() {
            output.frame_channel(link as u16, address)?;
        }
        output.channel::<ImuRecord>("/imu", "gaware.Imu")?;
        output.channel::<FixRecord>("/fix", "gaware.Fix")?;
        output.channel::<AttitudeRecord>("/attitude_autopilot", "gaware.Attitude")?;
        // G is an array of arrays, which not every reader's schemas can say: docs/snapshot.schema.json says it.
        output.add("/snapshot", None)?;
        output.channel::<FrameTransform>("/tf", "foxglove.FrameTransform")?;
        output.channel::<LocationFix>("/position", "foxglove.LocationFix")?;
        output.channel::<PoseInFrame>("/pose", "foxglove.PoseInFrame")?;
        output.channel::<Log>("/log", "foxglove.Log")?;
        output.sync()?;
        Ok(output)
    }

    fn frame_channel(&mut self, link: u16, address: &str) -> Result<u16, McapError> {
        let metadata = BTreeMap::from([("address".to_owned(), address.to_owned())]);
        let id = self.writer.add_channel(0, &format!("{FRAME_TOPIC}{link}"), "mavlink", &metadata)?;
        self.frames.insert(link, id);
        Ok(id)
    }

    fn channel<T: JsonSchema>(&mut self, topic: &'static str, name: &str) -> Result<(), McapError> {
        self.add(topic, Some((name, plain::<T>())))?;
        Ok(())
    }

    fn add(&mut self, topic: &'static str, schema: Option<(&str, Value)>) -> Result<u16, McapError> {
        let schema = match schema {
            Some((name, schema)) => {
                let text = serde_json::to_vec(&schema).unwrap_or_default();
                self.writer.add_schema(name, "jsonschema", &text)?
            }
            None => 0,
        };
        let id = self.writer.add_channel(schema, topic, "json", &BTreeMap::new())?;
        self.channels.insert(topic, id);
        Ok(id)
    }

    /// The estimate as flat numbers. A column that is new makes a new channel of the topic.
    fn states(&mut self, t_us: u64, s: &Snapshot) -> Result<(), McapError> {
        let states = States::new(s);
        let names = states.names();
        let known = self.states.as_ref().filter(|(before, _)| *before == names).map(|(_, id)| *id);
        let id = match known {
            Some(id) => id,
            None => {
                let id = self.add(STATES_TOPIC, Some(("gaware.States", states.schema())))?;
                self.states = Some((names, id));
                id
            }
        };
        let bytes = serde_json::to_vec(&states.object()).unwrap_or_default();
        self.put(id, t_us, &bytes)
    }

    pub(super) fn write(&mut self, item: &RecordItem) -> Result<(), McapError> {
        match item {
            RecordItem::Frame(received) => {
                let id = match self.frames.get(&received.link) {
                    Some(id) => *id,
                    None => self.frame_channel(received.link, "")?,
                };
                self.put(id, received.t_us, received.frame.raw())
            }
            RecordItem::Sample(t_us, Sample::Imu(s)) => self.json("/imu", *t_us, &ImuRecord::from(s)),
            RecordItem::Sample(t_us, Sample::Fix(s)) => self.json("/fix", *t_us, &FixRecord::from(s)),
            RecordItem::Sample(t_us, Sample::Attitude(s)) => {
                self.json("/attitude_autopilot", *t_us, &AttitudeRecord::from(s))
            }
            // Both are told again by the frames and stand in the log.
            RecordItem::Sample(_, Sample::Stream(_) | Sample::Restart(_)) => Ok(()),
            RecordItem::Snapshot(t_us, s) => {
                self.json("/snapshot", *t_us, s)?;
                self.states(*t_us, s)?;
                // Before there is an estimate the vehicle is at no place.
                if s.phase != Phase::Running {
                    return Ok(());
                }
                self.json("/tf", *t_us, &FrameTransform::new(*t_us, s))?;
                self.json("/position", *t_us, &LocationFix::new(*t_us, s))?;
                self.json("/pose", *t_us, &PoseInFrame::new(*t_us, s))
            }
            RecordItem::Log(t_us, severity, text) => {
                self.json("/log", *t_us, &Log::new(*t_us, *severity, text))
            }
        }
    }

    fn json<T: Serialize>(&mut self, topic: &'static str, t_us: u64, value: &T) -> Result<(), McapError> {
        let id = self.channels.get(topic).copied().unwrap_or_default();
        let bytes = serde_json::to_vec(value).unwrap_or_default();
        self.put(id, t_us, &bytes)
    }

    fn put(&mut self, channel_id: u16, t_us: u64, data: &[u8]) -> Result<(), McapError> {
        let t_ns = t_us.saturating_mul(1000);
        self.sequence = self.sequence.wrapping_add(1);
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: t_ns, publish_time: t_ns };
        self.writer.write_to_known_channel(&header, data)
    }

    pub(super) fn sync(&mut self) -> Result<(), McapError> {
        self.writer.flush()?;
        Ok(self.file.sync_data()?)
    }

    pub(super) fn finish(&mut self) -> Result<(), McapError> {
        self.writer.finish()?;
        Ok(self.file.sync_all()?)
    }
}
