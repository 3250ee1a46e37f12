//! What the tasks around the engine say about themselves: link, recorder, and what each sink has lost.
//!
//! Writers are the tasks that own a resource, readers are screens and metrics. Counters are atomics and the
//! few words beside them sit behind a lock held only for a copy, so no one ever waits here.

pub use crate::engine::situation::Control;
use crate::engine::situation::{Situation, SituationKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// State of the link to the autopilot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// No frame yet.
    #[default]
    Connecting,
    /// Frames arrive.
    Up,
    /// Open, but silent for longer than it should be.
    Silent,
    /// The device or the peer is gone; being retried.
    Down,
}

impl LinkState {
    /// Every state, in the order of metrics.
    pub const ALL: [Self; 4] = [Self::Connecting, Self::Up, Self::Silent, Self::Down];

    /// The word on screens and in metrics.
    pub fn word(self) -> &'static str {
        match self {
            Self::Connecting => "connecting",
            Self::Up => "up",
            Self::Silent => "silent",
            Self::Down => "down",
        }
    }
}

/// State of the recorder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecorderState {
    /// Not asked for.
    #[default]
    Off,
    /// Writing.
    Recording,
    /// Gave up, for example on a full disk.
    Failed,
}

impl RecorderState {
    /// Every state, in the order of metrics.
    pub const ALL: [Self; 3] = [Self::Off, Self::Recording, Self::Failed];

    /// The word on screens and in metrics.
    pub fn word(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Recording => "recording",
            Self::Failed => "failed",
        }
    }
}

/// The link as screens show it. Counters count since the start.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LinkView {
    /// State.
    pub state: LinkState,
    /// Endpoint and what is wrong with it, in words.
    pub detail: String,
    /// Good frames.
    pub frames: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Frames lost by their sequence numbers.
    pub lost: u64,
    /// Frames with a bad checksum.
    pub bad_crc: u64,
    /// Good frames per second, over the last seconds.
    pub rate_hz: f64,
}

/// The recorder as screens show it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RecorderView {
    /// State.
    pub state: RecorderState,
    /// File, or why it failed, in words.
    pub detail: String,
    /// Bytes written.
    pub bytes: u64,
    /// The recording; empty where there is none.
    #[serde(default)]
    pub file: String,
}

/// The vehicle and its mission as screens show them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VehicleView {
    /// Who flies.
    pub control: Control,
    /// Mode in words.
    pub mode: String,
    /// What the autopilot flies now, in a few words; empty where that is not known.
    pub now: String,
    /// Which maneuver (or item) of the mission that is, from 1 …
    pub maneuver: u64,
    /// … of so many; 0 where that is not known.
    pub maneuvers: u64,
    /// How long the maneuver itself takes, s; 0 where that is not known.
    pub duration_s: f64,
    /// Time left of the maneuver once it has begun, s; nothing where it takes longer than planned.
    pub left_s: Option<f64>,
    /// Time left until it begins, on the way there, s.
    #[serde(default)]
    pub transit_left_s: Option<f64>,
    /// What follows.
    pub next: String,
}

impl VehicleView {
    /// As the vehicle itself reports; `items`: of the planned mission on board, 0 where that is not known.
    pub fn reported(situation: &Situation, item: u16, items: u64) -> Self {
        let flies = situation.kind == SituationKind::Mission;
        let item = u64::from(item);
        Self {
            control: situation.control,
            mode: situation.mode.clone(),
            // An item that the vehicle does not report is not item 0.
            now: if flies { situation.text.to_lowercase() } else { String::new() },
            maneuver: if flies && items > 0 { item.min(items) } else { 0 },
            maneuvers: if flies { items } else { 0 },
            ..Self::default()
        }
    }

    /// The two counts of a maneuver in words: the way there, and the maneuver itself.
    pub fn counts(&self) -> String {
        match (self.transit_left_s, self.left_s) {
            (Some(s), _) if self.duration_s > 0.0 => {
                format!("begins in {:.0} s, then takes {:.0} s", s.ceil(), self.duration_s.ceil())
            }
            (Some(s), _) => format!("begins in {:.0} s", s.ceil()),
            (None, Some(s)) => format!("{:.0} s left", s.ceil()),
            (None, None) => String::new(),
        }
    }

    /// Share of the maneuver itself that is flown.
    pub fn progress(&self) -> Option<f64> {
        let left_s = self.left_s.filter(|_| self.duration_s > 0.0)?;
        Some((1.0 - left_s / self.duration_s).clamp(0.0, 1.0))
    }
}

/// What a map shows beside the track: latitude and longitude in deg.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RouteView {
    /// Home.
    pub home: Option<[f64; 2]>,
    /// Planned path.
    pub path: Vec<[f64; 2]>,
    /// Rings of the fence.
    pub fence: Vec<Vec<[f64; 2]>>,
}

/// How far the planned mission is, or the file of parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MissionState {
    /// There is none.
    #[default]
    None,
    /// It can be uploaded.
    Ready,
    /// It is being transferred.
    Uploading,
    /// It is on the vehicle, read back and compared.
    OnVehicle,
    /// The upload failed; the mission before is on the vehicle.
    NotOnVehicle,
    /// The upload failed; what is on the vehicle is unknown.
    Unknown,
}

/// The planned mission as screens show it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct MissionView {
    /// State.
    pub state: MissionState,
    /// Name of its file.
    pub name: String,
    /// Items without home.
    pub items: u64,
    /// The state in words for the pilot.
    pub text: String,
}

impl MissionState {
    /// Whether the change may be asked for now.
    pub fn can_be_asked_for(self) -> bool {
        !matches!(self, Self::None | Self::Uploading)
    }
}

/// The file of parameters as screens show it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ParametersView {
    /// State.
    pub state: MissionState,
    /// Name of the file.
    pub name: String,
    /// Names and new values.
    pub values: Vec<String>,
    /// The state in words for the pilot.
    pub text: String,
}

/// What one sink delivered and lost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SinkView {
    /// Messages delivered.
    pub delivered: u64,
    /// Messages lost because the sink was slower than the engine.
    pub dropped: u64,
}

/// Everything of [`SinkStatus`] at one instant (`gaware.sinks/1`).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StatusView {
    /// `gaware.sinks/1`.
    pub schema: String,
    /// Link.
    pub link: LinkView,
    /// Recorder.
    pub recorder: RecorderView,
    /// Planned mission.
    #[serde(default)]
    pub mission: MissionView,
    /// Parameters that may be set.
    #[serde(default)]
    pub parameters: ParametersView,
    /// Who flies, and what.
    #[serde(default)]
    pub vehicle: VehicleView,
    /// Counts the changes of the route; it is asked for by itself.
    #[serde(default)]
    pub route: u64,
    /// Per sink, by name.
    pub sinks: BTreeMap<String, SinkView>,
}

impl StatusView {
    /// Messages lost by all sinks together.
    pub fn dropped(&self) -> u64 {
        self.sinks.values().map(|s| s.dropped).sum()
    }
}

/// Counters of one sink, shared between the sink and those who show them.
#[derive(Debug, Default)]
pub struct SinkCounters {
    delivered: AtomicU64,
    dropped: AtomicU64,
}

impl SinkCounters {
    /// Counts `n` delivered messages.
    pub fn delivered(&self, n: u64) {
        self.delivered.fetch_add(n, Ordering::Relaxed);
    }

    /// Counts `n` lost messages.
    pub fn dropped(&self, n: u64) {
        self.dropped.fetch_add(n, Ordering::Relaxed);
    }

    /// Both figures.
    pub fn view(&self) -> SinkView {
        SinkView {
            delivered: self.delivered.load(Ordering::Relaxed),
            dropped: self.dropped.load(Ordering::Relaxed),
        }
    }
}

/// The registry: one per process, in an [`Arc`].
#[derive(Debug, Default)]
pub struct SinkStatus {
    /// Without the sinks.
    known: RwLock<StatusView>,
    route: RwLock<Arc<RouteView>>,
    sinks: RwLock<BTreeMap<&'static str, Arc<SinkCounters>>>,
}

impl SinkStatus {
    /// An empty registry: link connecting, recorder off.
    pub fn new() -> Arc<Self> {
        Arc::new(Self::default())
    }

    /// The counters of the sink `name`, made on first use.
    pub fn sink(&self, name: &'static str) -> Arc<SinkCounters> {
        let mut sinks = self.sinks.write().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(sinks.entry(name).or_default())
    }

    fn known(&self) -> RwLockReadGuard<'_, StatusView> {
        self.known.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn known_mut(&self) -> RwLockWriteGuard<'_, StatusView> {
        self.known.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces what is known of the link; the link's supervisor calls it about once a second and on changes.
    pub fn set_link(&self, link: LinkView) {
        self.known_mut().link = link;
    }

    /// Replaces what is known of the recorder.
    pub fn set_recorder(&self, recorder: RecorderView) {
        self.known_mut().recorder = recorder;
    }

    /// Replaces what is known of the planned mission.
    pub fn set_mission(&self, mission: MissionView) {
        self.known_mut().mission = mission;
    }

    /// What is known of the planned mission.
    pub fn mission(&self) -> MissionView {
        self.known().mission.clone()
    }

    /// Replaces what is known of the file of parameters.
    pub fn set_parameters(&self, parameters: ParametersView) {
        self.known_mut().parameters = parameters;
    }

    /// What is known of the file of parameters.
    pub fn parameters(&self) -> ParametersView {
        self.known().parameters.clone()
    }

    /// Replaces what is known of who flies.
    pub fn set_vehicle(&self, vehicle: VehicleView) {
        self.known_mut().vehicle = vehicle;
    }

    /// Replaces planned path, fence and home.
    pub fn set_route(&self, route: RouteView) {
        *self.route.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(route);
        self.known_mut().route += 1;
    }

    /// Planned path, fence and home.
    pub fn route(&self) -> Arc<RouteView> {
        Arc::clone(&self.route.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// A copy for screens, metrics and the page.
    pub fn view(&self) -> StatusView {
        let sinks = self.sinks.read().unwrap_or_else(PoisonError::into_inner);
        StatusView {
            schema: "gaware.sinks/1".to_owned(),
            sinks: sinks.iter().map(|(name, c)| ((*name).to_owned(), c.view())).collect(),
            ..self.known().clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_of_one_name_are_shared_and_summed_over_sinks() {
        let status = SinkStatus::new();
        status.sink("web").dropped(2);
        status.sink("web").dropped(3);
        status.sink("telemetry").dropped(1);
        status.sink("telemetry").delivered(7);
        let view = status.view();
        assert_eq!(view.sinks["web"].dropped, 5);
        assert_eq!(view.sinks["telemetry"], SinkView { delivered: 7, dropped: 1 });
        assert_eq!(view.dropped(), 6);
    }

    #[test]
    fn the_last_word_of_the_link_wins() {
        let status = SinkStatus::new();
        assert_eq!(status.view().link.state, LinkState::Connecting);
        status.set_link(LinkView { state: LinkState::Up, frames: 9, ..LinkView::default() });
        status.set_link(LinkView {
            state: LinkState::Down,
            detail: "unplugged".into(),
            ..LinkView::default()
        });
        assert_eq!(status.view().link.state, LinkState::Down);
        assert_eq!(status.view().link.detail, "unplugged");
    }
}
