//! A run over a real socket, and the replay of its recording.

use super::*;
use crate::commands::replay::{ReplayRequest, replay};
use crate::engine::snapshot::{Snapshot, Summary};
use crate::link::frame::Frame;
use crate::logs::{self, Item};
use crate::pipeline::Consumer;
use gaware_nav::sample::Sample;
use std::net::Ipv4Addr;
use std::path::Path;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

/// Counts and mixes every bit of every sample into one number: any difference in content or order shows.
#[derive(Debug, Default)]
struct Fingerprint {
    samples: u64,
    fixes: u64,
    mix: u64,
}

impl Consumer for Fingerprint {
    fn feed(&mut self, sample: &Sample) {
        for byte in serde_json::to_vec(sample).unwrap() {
            self.mix = (self.mix ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
        self.samples += u64::from(matches!(sample, Sample::Imu(_)));
        self.fixes += u64::from(matches!(sample, Sample::Fix(_)));
    }
}

impl Estimator for Fingerprint {
    fn snapshot(&self) -> Snapshot {
        Snapshot { elapsed_s: self.mix as f64, ..Snapshot::default() }
    }

    fn summary(&self) -> Summary {
        let mut summary = Summary { duration_s: self.mix as f64, ..Summary::default() };
        summary.imu.samples = self.samples;
        summary.gnss.fixes = self.fixes;
        summary
    }
}

#[derive(Debug, clap::Parser)]
struct Cli {
    #[command(flatten)]
    run: RunArgs,
}

fn run_args(line: &[&str]) -> RunArgs {
    <Cli as clap::Parser>::parse_from([&["run"], line].concat()).run
}

fn replay_args(log: &Path) -> ReplayRequest {
    ReplayRequest { log: log.into(), truth_from_s: 150.0, ..ReplayRequest::default() }
}

fn hooks() -> (Hooks, watch::Receiver<Arc<Live>>, mpsc::Sender<MavMessage>) {
    let (live, seen) = watch::channel(Arc::default());
    let (outbox, from_others) = mpsc::channel(16);
    let raw_outbox = mpsc::channel(1).1;
    let frames = tokio::sync::broadcast::channel(16).0;
    (Hooks { live, outbox: from_others, raw_outbox, mission: None, frames, foxglove: None }, seen, outbox)
}

#[tokio::test]
async fn a_replay_of_the_recording_repeats_the_run() {
    let folder = std::env::temp_dir().join(format!("gaware-run-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let record = folder.join("flight.mcap");
    let flight = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/small_clean_dither.tlog");
    let frames: Vec<_> = logs::open(&flight)
        .unwrap()
        .filter_map(|r| match r.unwrap().item {
            Item::Frame(frame) => Some(frame),
            Item::Measurement(_) | Item::Note(_) => None,
        })
        .collect();
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = format!("tcpout:{}", listener.local_addr().unwrap());
    let args = run_args(&["--connect", &address, "--record", record.to_str().unwrap()]);
    let stop = CancellationToken::new();
    let (hooks, mut seen, _outbox) = hooks();
    let vehicle = {
        let stop = stop.clone();
        let frames = frames.clone();
        tokio::spawn(async move {
            let (mut socket, _) = listener.accept().await.unwrap();
            for frame in &frames {
                socket.write_all(frame.raw()).await.unwrap();
            }
            // Everything has been taken when the last heartbeat-free count stands.
            let all = frames.len() as u64;
            let done = seen.wait_for(|l| l.links.first().is_some_and(|s| s.framer.frames == all));
            tokio::time::timeout(Duration::from_secs(60), done).await.expect("in time").unwrap();
            let mut heard = [0; 64];
            let n = socket.read(&mut heard).await.unwrap();
            stop.cancel();
            heard[..n].to_vec()
        })
    };
    let Served { document: live, .. } = serve(&args, hooks, stop, |_| Fingerprint::default()).await.unwrap();
    let heard = vehicle.await.unwrap();
    assert_eq!((heard[0], heard[6]), (0xFD, 191), "the companion speaks as component 191");
    let (_, again) = replay(&replay_args(&record), |_| Fingerprint::default()).unwrap();
    assert_eq!(serde_json::to_string(&live).unwrap(), serde_json::to_string(&again).unwrap());
    assert!(live["imu"]["samples"].as_u64().unwrap() > 20_000, "{live:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[tokio::test]
async fn a_stray_heartbeat_does_not_capture_the_run() {
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavType};
    let flight = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/small_clean_dither.tlog");
    let frames: Vec<_> = logs::open(&flight)
        .unwrap()
        .filter_map(|r| match r.unwrap().item {
            Item::Frame(frame) => Some(frame),
            Item::Measurement(_) | Item::Note(_) => None,
        })
        .take(3000)
        .collect();
    let stray = HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_FIXED_WING,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        mavlink_version: 3,
        ..Default::default()
    };
    let stray = Frame::encode(Sender { system_id: 42, component_id: 1 }, 0, &MavMessage::HEARTBEAT(stray));
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = format!("tcpout:{}", listener.local_addr().unwrap());
    let args = run_args(&["--connect", &address, "--no-record"]);
    let stop = CancellationToken::new();
    let (hooks, mut seen, _outbox) = hooks();
    let vehicle = {
        let stop = stop.clone();
        tokio::spawn(async move {
            let (mut socket, _) = listener.accept().await.unwrap();
            socket.write_all(stray.raw()).await.unwrap();
            for frame in &frames {
                socket.write_all(frame.raw()).await.unwrap();
            }
            let all = frames.len() as u64 + 1;
            let done = seen.wait_for(|l| l.links.first().is_some_and(|s| s.framer.frames == all));
            let live =
                tokio::time::timeout(Duration::from_secs(60), done).await.expect("in time").unwrap().clone();
            stop.cancel();
            live
        })
    };
    let Served { pipeline, .. } = serve(&args, hooks, stop, |_| Fingerprint::default()).await.unwrap();
    let live = vehicle.await.unwrap();
    assert!(pipeline.summary().imu.samples > 1000, "{}", pipeline.summary().imu.samples);
    let named =
        live.events.iter().any(|e| e.text.contains("system 42") && e.text.contains("system 1 is followed"));
    assert!(named, "{:?}", live.events);
}

#[tokio::test]
async fn a_run_without_a_vehicle_ends_with_its_duration_and_says_why_the_link_is_down() {
    let args =
        run_args(&["--connect", "serial:/dev/gaware-no-such-port", "--no-record", "--duration", "0.5"]);
    let (hooks, seen, _outbox) = hooks();
    let Served { pipeline, document, .. } =
        serve(&args, hooks, CancellationToken::new(), |_| Fingerprint::default()).await.unwrap();
    assert_eq!(pipeline.summary().imu.samples, 0);
    assert!(document.contains_key("warnings"));
    let live = seen.borrow().clone();
    assert!(!live.links[0].up && live.links[0].problem.contains("no-such-port"), "{:?}", live.links);
}

#[test]
fn with_a_key_only_signed_frames_are_believed() {
    use crate::link::heartbeat::heartbeat;
    let path = std::env::temp_dir().join(format!("gaware-guard-{}.key", std::process::id()));
    std::fs::write(&path, "0b".repeat(32)).unwrap();
    let now_us = 1_800_000_000_000_000;
    let mut ours = Guard::load(&path).unwrap();
    let mut theirs = Guard::load(&path).unwrap();
    let frame = HeartbeatSource::new().say(&heartbeat(true));
    let told =
        |g: &mut Guard, f: &Frame| g.refuse(f, 1_800_000_000_000_000).map(|r| r.first_of_its_kind.is_some());
    assert_eq!(told(&mut ours, &theirs.sign(&frame, 0, now_us)), None);
    assert_eq!(told(&mut ours, &frame), Some(true));
    assert_eq!(told(&mut ours, &frame), Some(false), "told once");
    for file in [path.with_extension("time"), path] {
        std::fs::remove_file(file).unwrap();
    }
}

#[test]
fn a_slow_serial_line_lowers_the_rate() {
    assert_eq!(usable_rate(&run_args(&["--connect", "serial:/dev/x:57600"])), 93);
    assert_eq!(usable_rate(&run_args(&["--connect", "serial:/dev/x:921600"])), 200);
    assert_eq!(usable_rate(&run_args(&["--connect", "udpin:0.0.0.0:14550", "--rate", "50"])), 50);
}

#[test]
fn logs_of_every_kind_are_replayed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (pipeline, document) =
        replay(&replay_args(&root.join("tests/data/small_clean_dither.tlog")), |_| Fingerprint::default())
            .unwrap();
    assert_eq!(pipeline.summary().autopilot, "ardupilot");
    assert!(document["converter"]["imu_samples"].as_u64().unwrap() > 29_000);
    assert!(!document.contains_key("log_damage"));
}
