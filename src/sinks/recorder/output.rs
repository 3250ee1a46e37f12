//! The open file of a recording: its channels, and messages on their way into it.

use super::held;
use super::{CHUNK_BYTES, MODEL_ATTACHMENT, RecordItem, SETUP_METADATA, Setup};
use crate::sinks::messages::{TopicEncoder, TopicMessage};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

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
    encoder: TopicEncoder,
    /// Number in the file of each of the encoder's channels.
    channels: Vec<u16>,
    sequence: u32,
}

/// What a replay must know: the last one in a file counts.
fn set_up(writer: &mut Writer<NoSeek<BufWriter<Appending>>>, setup: &Setup) -> Result<(), McapError> {
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
    })
}

impl Output {
    pub(super) fn create(path: &Path, setup: &Setup) -> Result<Self, McapError> {
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let file = held::create(path)?;
        let appended = Arc::default();
        let sink = Appending { file: file.try_clone()?, taken: Arc::clone(&appended) };
        let options = WriteOptions::new()
            .library(format!("gaware {}", setup.version))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut writer = options.create(NoSeek::new(BufWriter::new(sink)))?;
        set_up(&mut writer, setup)?;
        let mut output = Self {
            file,
            appended,
            writer,
            encoder: TopicEncoder::new(&setup.links),
            channels: Vec::new(),
            sequence: 0,
        };
        // All channels at once, in a chunk of their own: damage to later chunks cannot take them away.
        output.add_new_channels()?;
        output.sync()?;
        Ok(output)
    }

    fn add_new_channels(&mut self) -> Result<(), McapError> {
        for channel in self.encoder.channels().iter().skip(self.channels.len()) {
            let schema = match &channel.schema {
                Some(schema) => self.writer.add_schema(schema.name, "jsonschema", schema.text.as_bytes())?,
                None => 0,
            };
            let number =
                self.writer.add_channel(schema, &channel.topic, channel.encoding, &channel.metadata)?;
            self.channels.push(number);
        }
        Ok(())
    }

    pub(super) fn write(&mut self, item: &RecordItem) -> Result<(), McapError> {
        if let RecordItem::Setup(setup) = item {
            return set_up(&mut self.writer, setup);
        }
        let messages = self.encoder.encode(item);
        self.add_new_channels()?;
        messages.iter().try_for_each(|message| self.put(message))
    }

    fn put(&mut self, message: &TopicMessage<'_>) -> Result<(), McapError> {
        let channel_id = self.channels.get(message.channel).copied().unwrap_or_default();
        let t_ns = message.t_us.saturating_mul(1000);
        self.sequence = self.sequence.wrapping_add(1);
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: t_ns, publish_time: t_ns };
        self.writer.write_to_known_channel(&header, &message.data)
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
