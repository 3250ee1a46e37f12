//! Converter and engine against arbitrary valid frames, from the first one on or in the middle of a flight. Afterwards the covariance
//! is sound and the result has numbers where numbers belong.

use crate::script::{self, Step};
use gaware::engine::{Engine, EngineOptions};
use gaware::link::frame::Frame;
use gaware::logs::Item;
use gaware::logs::tlog::TlogReader;
use gaware::pipeline::Pipeline;
use gaware::sensors::ConverterOptions;
use gaware_mission::airframe::Airframe;
use gaware_nav::model::Model;
use serde_json::Value;
use std::sync::LazyLock;

/// A recorded flight of the simulated autopilot, 1.7 MB.
const RECORDED: &[u8] = include_bytes!("../../../../tests/data/small_clean_dither.tlog");
/// How much of it is read.
const BYTES: usize = 900_000;
/// The estimator has run for so long when a script begins in flight, s.
const WARM_S: u64 = 60;
/// Frames of a seed.
const FRAMES: usize = 120;

/// A flight, frame by frame.
#[derive(Debug)]
pub struct RecordedFlight {
    /// Receive time, Unix µs, and frame.
    pub frames: Vec<(u64, Frame)>,
}

/// The recorded flight.
pub static FLIGHT: LazyLock<RecordedFlight> = LazyLock::new(|| {
    let bytes = RECORDED.get(..BYTES).unwrap_or(RECORDED);
    let records = TlogReader::new(bytes, bytes.len() as u64).flatten();
    let frame = |item| if let Item::Frame(frame) = item { Some(frame) } else { None };
    RecordedFlight { frames: records.filter_map(|r| Some((r.t_us, frame(r.item)?))).collect() }
});

/// The estimation in flight, and the time it is for: without guidance, and with that for a small fixed wing.
static IN_FLIGHT: LazyLock<[(u64, Pipeline<Engine>); 2]> = LazyLock::new(|| [false, true].map(in_flight));

fn new_pipeline(guided: bool) -> Pipeline<Engine> {
    let airframe = Airframe::example("small_fixed_wing").filter(|_| guided);
    let options = airframe.map_or_else(EngineOptions::default, |a| EngineOptions::for_airframe(a, true));
    Pipeline::new(ConverterOptions::default(), Engine::new(Model::standard(), options), f64::INFINITY)
}

fn in_flight(guided: bool) -> (u64, Pipeline<Engine>) {
    let mut pipeline = new_pipeline(guided);
    let mut now_us = 0;
    for (t_us, frame) in warm_frames() {
        pipeline.frame(*t_us, frame);
        now_us = *t_us;
    }
    assert!(pipeline.engine().filter().is_some(), "the estimation does not run");
    (now_us, pipeline)
}

fn warm_frames() -> impl Iterator<Item = &'static (u64, Frame)> {
    let first_us = FLIGHT.frames.first().map_or(0, |(t_us, _)| *t_us);
    FLIGHT.frames.iter().take_while(move |(t_us, _)| *t_us < first_us + WARM_S * 1_000_000)
}

/// The first byte decides where it begins, the rest is a script.
pub fn engine(data: &[u8]) -> bool {
    let Some((&how, rest)) = data.split_first() else { return false };
    let (mut t_us, mut pipeline) = match how % 8 {
        0 => (1_700_000_000_000_000, new_pipeline(false)),
        1 => (1_700_000_000_000_000, new_pipeline(true)),
        2 => IN_FLIGHT[1].clone(),
        _ => IN_FLIGHT[0].clone(),
    };
    for (k, step) in script::read(rest).iter().enumerate() {
        t_us += u64::from(step.wait_ms) * 1000;
        if let Some(frame) = step.frame(k as u8) {
            pipeline.frame(t_us, &frame);
        }
    }
    check(&pipeline);
    pipeline.engine().filter().is_some()
}

/// The covariance is sound, and the result has numbers where numbers belong.
pub(super) fn check(pipeline: &Pipeline<Engine>) {
    if let Some(filter) = pipeline.engine().filter() {
        assert!(filter.covariance().is_sound(), "the covariance is not sound");
        let nav = filter.nav();
        assert!(nav.r_e.iter().chain(nav.v_e.iter()).all(|v| v.is_finite()), "{nav:?}");
    }
    let document = pipeline.document();
    for key in ["estimate", "consistency", "observability", "imu", "gnss"] {
        let value = document.get(key).unwrap_or(&Value::Null);
        finite(value, key);
    }
}

/// What is not finite is null in JSON.
fn finite(value: &Value, at: &str) {
    match value {
        Value::Null => panic!("{at} is no number"),
        Value::Array(list) => list.iter().for_each(|v| finite(v, at)),
        Value::Object(map) => map.iter().for_each(|(key, v)| finite(v, &format!("{at}/{key}"))),
        _ => {}
    }
}

/// Pieces of the flight: those from the start for a new estimation, those after the warm part for one in flight.
pub fn seeds() -> Vec<Vec<u8>> {
    let warm = warm_frames().count();
    let mut seeds = Vec::new();
    for (how, start) in [(0, 0), (1, 0)] {
        seeds.push(seed(how, start, script::STEPS));
    }
    for start in (warm..FLIGHT.frames.len().saturating_sub(FRAMES)).step_by(FRAMES * 4) {
        seeds.push(seed(3, start, FRAMES));
    }
    for k in 0..4 {
        seeds.push(seed(2, warm + k * FRAMES, FRAMES));
    }
    seeds
}

fn seed(how: u8, start: usize, count: usize) -> Vec<u8> {
    let mut before_us = None;
    let mut out = vec![how];
    let steps: Vec<Step> = FLIGHT
        .frames
        .iter()
        .skip(start)
        .take(count)
        .map(|(t_us, frame)| {
            let wait_ms = before_us.map_or(0, |before| t_us.saturating_sub(before) / 1000);
            before_us = Some(*t_us);
            Step::of_frame(frame, wait_ms.min(u64::from(u16::MAX)) as u16)
        })
        .collect();
    out.extend(script::write(&steps));
    out
}
