//! What recordings and live viewers get of a run: topics with their schemas, and every item as messages of them.
//!
//! Topics: `/mavlink/N` raw frames of link N in the order in which the converter saw them (no schema; the log time is
//! the time of reception), `/imu`, `/fix`, `/attitude_autopilot`, `/states` (the estimate as flat numbers), `/snapshot` (all of it, without
//! a schema), and `/position`, `/pose`, `/tf`, `/log` in Foxglove's own schemas. Files and sockets are not known here.

mod flat;
mod records;
mod well_known;

use crate::engine::snapshot::{Phase, Snapshot};
use crate::link::endpoint::Received;
pub use crate::logs::mcap::{FRAME_TOPIC, Setup};
use crate::sensors::Severity;
use flat::{States, plain};
use gaware_nav::sample::Sample;
use records::{AttitudeRecord, FixRecord, ImuRecord};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use well_known::{FrameTransform, LocationFix, Log, PoseInFrame};

/// Encoding of the frames of a link.
pub const FRAME_ENCODING: &str = "mavlink";
/// Topic of the estimate as flat numbers.
const STATES_TOPIC: &str = "/states";

/// One thing that happened in a run.
#[derive(Debug, Clone)]
pub enum RecordItem {
    /// A raw frame.
    Frame(Received),
    /// A sample that came of it; the time of reception in µs.
    Sample(u64, Sample),
    /// The state of the estimator.
    Snapshot(u64, Box<Snapshot>),
    /// A message to the user.
    Log(u64, Severity, String),
    /// What a replay must know, where that has changed: of the recording alone.
    Setup(Box<Setup>),
}

/// A JSON schema.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicSchema {
    /// Name.
    pub name: &'static str,
    /// Draft 7, without references, unions with null and arrays of arrays.
    pub text: String,
}

/// A topic with its encoding and its schema.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicChannel {
    /// Topic.
    pub topic: String,
    /// `json` or `mavlink`.
    pub encoding: &'static str,
    /// What its messages are, where a schema can say it.
    pub schema: Option<TopicSchema>,
    /// What else is known of it.
    pub metadata: BTreeMap<String, String>,
}

/// One message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicMessage<'a> {
    /// Index of its channel.
    pub channel: usize,
    /// Time of reception, Unix µs.
    pub t_us: u64,
    /// Content.
    pub data: Cow<'a, [u8]>,
}

/// Makes messages of items. Channels are only ever added; where a topic has two, the later one replaces the earlier.
#[derive(Debug)]
pub struct TopicEncoder {
    channels: Vec<TopicChannel>,
    topics: BTreeMap<&'static str, usize>,
    frames: BTreeMap<u16, usize>,
    /// Columns and channel of the states.
    states: Option<(Vec<String>, usize)>,
}

impl TopicEncoder {
    /// With the topics of these links, and all others but the states, whose columns the estimate decides.
    pub fn new(links: &[String]) -> Self {
        let mut encoder =
            Self { channels: Vec::new(), topics: BTreeMap::new(), frames: BTreeMap::new(), states: None };
        for (link, address) in (0..).zip(links) {
            encoder.frame_channel(link, address);
        }
        encoder.topic::<ImuRecord>("/imu", "gaware.Imu");
        encoder.topic::<FixRecord>("/fix", "gaware.Fix");
        encoder.topic::<AttitudeRecord>("/attitude_autopilot", "gaware.Attitude");
        // G is an array of arrays, which not every reader's schemas can say: docs/snapshot.schema.json says it.
        let snapshots = encoder.add("/snapshot", None);
        encoder.topics.insert("/snapshot", snapshots);
        encoder.topic::<FrameTransform>("/tf", "foxglove.FrameTransform");
        encoder.topic::<LocationFix>("/position", "foxglove.LocationFix");
        encoder.topic::<PoseInFrame>("/pose", "foxglove.PoseInFrame");
        encoder.topic::<Log>("/log", "foxglove.Log");
        encoder
    }

    /// All channels so far, in the order in which they came.
    pub fn channels(&self) -> &[TopicChannel] {
        &self.channels
    }

    /// The messages that say this item, in order.
    pub fn encode<'a>(&mut self, item: &'a RecordItem) -> Vec<TopicMessage<'a>> {
        match item {
            RecordItem::Frame(received) => {
                let channel = match self.frames.get(&received.link) {
                    Some(channel) => *channel,
                    None => self.frame_channel(received.link, ""),
                };
                vec![TopicMessage { channel, t_us: received.t_us, data: Cow::Borrowed(received.frame.raw()) }]
            }
            RecordItem::Sample(t_us, Sample::Imu(s)) => {
                vec![self.json("/imu", *t_us, &ImuRecord::from(s))]
            }
            RecordItem::Sample(t_us, Sample::Fix(s)) => {
                vec![self.json("/fix", *t_us, &FixRecord::from(s))]
            }
            RecordItem::Sample(t_us, Sample::Attitude(s)) => {
                vec![self.json("/attitude_autopilot", *t_us, &AttitudeRecord::from(s))]
            }
            // All of them are in the frames again, or stand in the log.
            RecordItem::Sample(
                _,
                Sample::Stream(_)
                | Sample::Restart(_)
                | Sample::Recalibrated
                | Sample::Place(_)
                | Sample::Field(_)
                | Sample::Air(_)
                | Sample::Operating(_),
            ) => Vec::new(),
            RecordItem::Setup(_) => Vec::new(),
            RecordItem::Snapshot(t_us, s) => self.snapshot(*t_us, s),
            RecordItem::Log(t_us, severity, text) => {
                vec![self.json("/log", *t_us, &Log::new(*t_us, *severity, text))]
            }
        }
    }

    fn snapshot(&mut self, t_us: u64, s: &Snapshot) -> Vec<TopicMessage<'static>> {
        let mut messages = vec![self.json("/snapshot", t_us, s), self.states(t_us, s)];
        // Before there is an estimate the vehicle is at no place.
        if s.phase == Phase::Running {
            messages.push(self.json("/tf", t_us, &FrameTransform::new(t_us, s)));
            messages.push(self.json("/position", t_us, &LocationFix::new(t_us, s)));
            messages.push(self.json("/pose", t_us, &PoseInFrame::new(t_us, s)));
        }
        messages
    }

    /// The estimate as flat numbers. A column that is new makes a new channel of the topic.
    fn states(&mut self, t_us: u64, s: &Snapshot) -> TopicMessage<'static> {
        let states = States::new(s);
        let names = states.names();
        let known = self.states.as_ref().filter(|(before, _)| *before == names).map(|(_, channel)| *channel);
        let channel = known.unwrap_or_else(|| {
            let channel = self.add(STATES_TOPIC, Some(("gaware.States", states.schema())));
            self.states = Some((names, channel));
            channel
        });
        let data = serde_json::to_vec(&states.object()).unwrap_or_default();
        TopicMessage { channel, t_us, data: Cow::Owned(data) }
    }

    fn frame_channel(&mut self, link: u16, address: &str) -> usize {
        let channel = self.channels.len();
        self.channels.push(TopicChannel {
            topic: format!("{FRAME_TOPIC}{link}"),
            encoding: FRAME_ENCODING,
            schema: None,
            metadata: BTreeMap::from([("address".to_owned(), address.to_owned())]),
        });
        self.frames.insert(link, channel);
        channel
    }

    fn topic<T: JsonSchema>(&mut self, topic: &'static str, name: &'static str) {
        let channel = self.add(topic, Some((name, plain::<T>())));
        self.topics.insert(topic, channel);
    }

    fn add(&mut self, topic: &'static str, schema: Option<(&'static str, Value)>) -> usize {
        let schema = schema.map(|(name, schema)| TopicSchema { name, text: schema.to_string() });
        let channel = self.channels.len();
        self.channels.push(TopicChannel {
            topic: topic.to_owned(),
            encoding: "json",
            schema,
            metadata: BTreeMap::new(),
        });
        channel
    }

    fn json<T: Serialize>(&self, topic: &'static str, t_us: u64, value: &T) -> TopicMessage<'static> {
        let channel = self.topics.get(topic).copied().unwrap_or_default();
        let data = serde_json::to_vec(value).unwrap_or_default();
        TopicMessage { channel, t_us, data: Cow::Owned(data) }
    }
}
