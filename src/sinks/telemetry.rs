//! Telemetry to the ground station: values to plot and words to read, on the autopilot's own link.
//!
//! Sans I/O: [`Telemetry::feed`] takes the time and a snapshot and returns messages; who sends them, with which
//! system id, and the heartbeat are the link's business. `NAMED_VALUE_FLOAT` is spread over its period so that a
//! slow radio never sees a burst; `STATUSTEXT` is rationed, because pilots read it.

use super::events::{EventDetector, Severity, Topic};
use super::status::{MissionState, MissionView};
use super::words::{ascii, fit};
use crate::engine::situation::SituationKind;
use crate::engine::snapshot::Snapshot;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, NAMED_VALUE_FLOAT_DATA, STATUSTEXT_DATA};
use std::collections::VecDeque;

/// Bytes of one `STATUSTEXT`.
const TEXT_BYTES: usize = 50;
/// Chunks of one text at most; what is longer is cut and ends in "...".
const MAX_CHUNKS: usize = 3;
/// Texts that wait at most; the oldest of the least urgent is dropped, and counted.
const MAX_WAITING: usize = 8;
/// Seconds after which a waiting text other than an instruction is stale.
const STALE_S: f64 = 30.0;

/// How much is sent to the ground station.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum TelemetryLevel {
    /// Nothing.
    Off,
    /// Texts, and every value once in ten seconds: at most 5 messages a second.
    #[default]
    Low,
    /// Texts, and every value once a second: about 22 messages a second.
    Full,
}

impl TelemetryLevel {
    /// The rates; nothing where nothing is sent.
    pub fn config(self) -> Option<TelemetryConfig> {
        match self {
            Self::Off => None,
            Self::Low => Some(TelemetryConfig::default()),
            Self::Full => Some(TelemetryConfig {
                value_period_s: 1.0,
                messages_per_s: None,
                ..TelemetryConfig::default()
            }),
        }
    }
}

/// Texts are counted over so long, s.
const TEXT_WINDOW_S: f64 = 10.0;

/// Rates of the telemetry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetryConfig {
    /// Seconds in which every value is sent once.
    pub value_period_s: f64,
    /// Texts at most in any 10 s.
    pub texts_per_window: usize,
    /// Messages of both kinds at most in any second, not fewer than one text may have. All chunks of a text go
    /// together: ground stations show what they have when the next one does not come within a second.
    pub messages_per_s: Option<usize>,
}

impl Default for TelemetryConfig {
    fn default() -> Self {
        Self { value_period_s: 10.0, texts_per_window: 4, messages_per_s: Some(5) }
    }
}

struct Waiting {
    since_s: f64,
    severity: Severity,
    topic: Topic,
    text: String,
}

/// The state machine.
pub struct Telemetry {
    config: TelemetryConfig,
    events: EventDetector,
    waiting: VecDeque<Waiting>,
    sent_at_s: VecDeque<f64>,
    /// When the messages of the last second were sent.
    messages_at_s: VecDeque<f64>,
    next_value: usize,
    next_value_at_s: Option<f64>,
    next_text_id: u16,
    dropped: u64,
}

impl Telemetry {
    /// A telemetry that has sent nothing yet.
    pub fn new(config: TelemetryConfig) -> Self {
        Self {
            config,
            events: EventDetector::default(),
            waiting: VecDeque::new(),
            sent_at_s: VecDeque::new(),
            messages_at_s: VecDeque::new(),
            next_value: 0,
            next_value_at_s: None,
            next_text_id: 1,
            dropped: 0,
        }
    }

    /// Messages that are due at `now_s` (any monotonic clock, s). Call it with every snapshot; more often does no
    /// harm, and less often only makes the spread coarser.
    pub fn feed(&mut self, now_s: f64, snapshot: &Snapshot) -> Vec<MavMessage> {
        if snapshot.situation.kind != SituationKind::Maneuver {
            // An order that waits is none any more.
            self.waiting.retain(|w| w.topic != Topic::Instruction || !w.text.starts_with("Fly: "));
        }
        for event in self.events.feed(snapshot) {
            self.enqueue(Waiting {
                since_s: now_s,
                severity: event.severity,
                topic: event.topic,
                text: event.text,
            });
        }
        let room = self.room(now_s);
        let mut out = Vec::new();
        if self.due_texts(now_s, room, &mut out) {
            self.due_values(now_s, snapshot, room, &mut out);
        }
        if self.config.messages_per_s.is_some() {
            self.messages_at_s.extend(out.iter().map(|_| now_s));
        }
        out
    }

    /// Messages that may still be sent in this second.
    fn room(&mut self, now_s: f64) -> usize {
        // A clock that went back is another clock.
        self.messages_at_s.retain(|t| (0.0..1.0).contains(&(now_s - t)));
        self.config.messages_per_s.map_or(usize::MAX, |most| most.saturating_sub(self.messages_at_s.len()))
    }

    /// Reports to the pilot what has become of the planned mission.
    pub fn announce(&mut self, now_s: f64, mission: &MissionView) {
        let severity = match mission.state {
            MissionState::None | MissionState::Uploading => return,
            MissionState::Unknown => Severity::Warning,
            MissionState::Ready | MissionState::OnVehicle | MissionState::NotOnVehicle => Severity::Notice,
        };
        let text = format!("Mission: {}", mission.text);
        self.enqueue(Waiting { since_s: now_s, severity, topic: Topic::Result, text });
    }

    /// Texts that were dropped because there were too many, or became stale while they waited.
    pub fn dropped_texts(&self) -> u64 {
        self.dropped
    }

    fn enqueue(&mut self, text: Waiting) {
        // Only the newest instruction counts; a phase that has passed is no event either.
        if matches!(text.topic, Topic::Instruction | Topic::Phase) {
            let before = self.waiting.len();
            self.waiting.retain(|w| w.topic != text.topic);
            self.dropped += (before - self.waiting.len()) as u64;
        }
        self.waiting.push_back(text);
        if self.waiting.len() > MAX_WAITING {
            let least = self.waiting.iter().map(|w| w.severity).max();
            if let Some(at) = self.waiting.iter().position(|w| Some(w.severity) == least) {
                self.waiting.remove(at);
                self.dropped += 1;
            }
        }
    }

    /// Texts whose turn has come; whether there is room for other messages, since no text waits for it.
    fn due_texts(&mut self, now_s: f64, room: usize, out: &mut Vec<MavMessage>) -> bool {
        let before = self.waiting.len();
        self.waiting.retain(|w| w.topic == Topic::Instruction || now_s - w.since_s <= STALE_S);
        self.dropped += (before - self.waiting.len()) as u64;
        self.sent_at_s.retain(|t| now_s - t < TEXT_WINDOW_S);
        while self.sent_at_s.len() < self.config.texts_per_window {
            let most = self.waiting.iter().map(|w| w.severity).min();
            let Some(at) = self.waiting.iter().position(|w| Some(w.severity) == most) else { break };
            let chunks = self.waiting.get(at).map(|w| statustext(w.severity, &w.text, self.next_text_id));
            let Some(chunks) = chunks.filter(|chunks| out.len() + chunks.len() <= room) else { return false };
            self.waiting.remove(at);
            self.sent_at_s.push_back(now_s);
            if chunks.len() > 1 {
                self.next_text_id = self.next_text_id.checked_add(1).unwrap_or(1);
            }
            out.extend(chunks);
        }
        true
    }

    fn due_values(&mut self, now_s: f64, snapshot: &Snapshot, room: usize, out: &mut Vec<MavMessage>) {
        let values = values(snapshot);
        let step_s = self.config.value_period_s / values.len() as f64;
        let mut due_s = self.next_value_at_s.unwrap_or(now_s);
        // After a pause (or a clock that jumped) start afresh instead of catching up in a burst.
        if !(-step_s..=self.config.value_period_s).contains(&(now_s - due_s)) {
            due_s = now_s;
        }
        // Truncation to 32 bits is what `time_boot_ms` does to a Unix time base as well.
        let time_boot_ms = (snapshot.t_s.max(0.0) * 1e3) as u64 as u32;
        while due_s <= now_s && out.len() < room {
            if let Some((name, value)) = values.get(self.next_value % values.len())
                && value.is_finite()
            {
                let data =
                    NAMED_VALUE_FLOAT_DATA { time_boot_ms, value: *value as f32, name: name.as_str().into() };
                out.push(MavMessage::NAMED_VALUE_FLOAT(data));
            }
            self.next_value = (self.next_value + 1) % values.len();
            due_s += step_s;
        }
        self.next_value_at_s = Some(due_s);
    }
}

/// One text, in chunks with the number `id` if it is longer than a message.
fn statustext(severity: Severity, text: &str, id: u16) -> Vec<MavMessage> {
    let text = fit(&ascii(text), TEXT_BYTES * MAX_CHUNKS);
    let severity = match severity {
        Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
        Severity::Notice => MavSeverity::MAV_SEVERITY_NOTICE,
        Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
    };
    let chunks: Vec<&[u8]> = text.as_bytes().chunks(TEXT_BYTES).collect();
    let id = if chunks.len() > 1 { id } else { 0 };
    let ends_full = chunks.len() > 1 && text.len().is_multiple_of(TEXT_BYTES);
    // A receiver knows the last chunk by a NUL in it; a text that fills its last chunk needs an empty one more.
    let empty: &[u8] = &[];
    (0u8..)
        .zip(chunks.into_iter().chain(ends_full.then_some(empty)))
        .map(|(chunk_seq, bytes)| {
            let mut data = [0; TEXT_BYTES];
            for (to, from) in data.iter_mut().zip(bytes) {
                *to = *from;
            }
            MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity, text: data.into(), id, chunk_seq })
        })
        .collect()
}

/// One set of values with names of at most 10 characters: G and its sigmas (deg/h/g), NIS per degree of freedom,
/// progress of the conditions (0 to 1).
fn values(s: &Snapshot) -> Vec<(String, f64)> {
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    let mut out = Vec::with_capacity(22);
    for (row, (values, sigmas)) in g.value.iter().zip(&g.sigma).enumerate() {
        for (column, (value, sigma)) in values.iter().zip(sigmas).enumerate() {
            let name = format!("G{}{}", row + 1, column + 1);
            out.push((format!("{name}_sigma"), *sigma));
            out.push((name, *value));
        }
    }
    let c = &s.observability.conditions;
    out.push(("NIS".to_owned(), s.consistency.nis_mean_per_dof));
    out.extend(
        [("cond_a", &c.a), ("cond_b", &c.b), ("cond_c", &c.c)].map(|(n, c)| (n.to_owned(), c.progress)),
    );
    out
}

#[cfg(test)]
mod tests;
