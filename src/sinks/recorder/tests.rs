//! Recording, damage and reading back.

use super::*;
use crate::link::endpoint::Received;
use crate::link::frame::{Frame, Sender};
use crate::logs::{self, Item};
use crate::sensors::Severity;
use mavlink::dialects::ardupilotmega::{MavMessage, RAW_IMU_DATA};
use std::fs::File;

pub(super) fn received(k: u64) -> Received {
    let m = RAW_IMU_DATA { time_usec: k * 5000, zacc: -1000, ..Default::default() };
    let frame = Frame::encode(Sender { system_id: 1, component_id: 1 }, k as u8, &MavMessage::RAW_IMU(m));
    Received { link: 0, peer: None, t_us: 1_700_000_000_000_000 + k * 5000, frame }
}

pub(super) fn setup() -> Setup {
    Setup {
        version: "0".to_owned(),
        links: vec!["udpin:0.0.0.0:14550".to_owned()],
        model_toml: "schema = \"gaware.model/1\"\n".to_owned(),
        ..Setup::default()
    }
}

/// A file in a folder that vanishes with the test.
pub(super) struct Scratch(PathBuf);

impl std::ops::Deref for Scratch {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.0.parent().unwrap());
    }
}

pub(super) fn scratch(name: &str) -> Scratch {
    let folder = std::env::temp_dir().join(format!("gaware-recorder-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    Scratch(folder.join("flight.mcap"))
}

fn read(path: &Path) -> (Vec<(u64, Frame)>, logs::Damage) {
    let mut reader = logs::open(path).unwrap();
    let frames = reader
        .by_ref()
        .filter_map(Result::ok)
        .map(|r| match r.item {
            Item::Frame(f) => (r.t_us, f),
            other => panic!("{other:?}"),
        })
        .collect();
    (frames, reader.damage())
}

/// Records in chunks, `per_chunk` frames each.
fn write_chunks(path: &Path, chunks: u64, per_chunk: u64) -> Output {
    let mut output = Output::create(path, &setup()).unwrap();
    for k in 0..chunks * per_chunk {
        output.write(&RecordItem::Frame(received(k))).unwrap();
        if k % per_chunk == per_chunk - 1 {
            output.sync().unwrap();
        }
    }
    output
}

#[test]
fn a_recording_gives_back_the_frames_in_order_and_the_set_up() {
    let path = scratch("order");
    let recorder = Recorder::start(&path, &setup()).unwrap();
    for k in 0..1000 {
        recorder.record(RecordItem::Frame(received(k)));
        recorder.record(RecordItem::Snapshot(received(k).t_us, Box::default()));
    }
    recorder.record(RecordItem::Log(0, Severity::Warning, "told".to_owned()));
    let stats = recorder.finish();
    let bytes = std::fs::metadata(&*path).unwrap().len();
    assert_eq!(stats, RecorderStats { written: 2001, bytes, files: 1, ..RecorderStats::default() });
    let (frames, damage) = read(&path);
    assert!(!damage.any(), "{damage:?}");
    assert_eq!(frames.len(), 1000);
    assert!((0..1000).all(|k| frames[k as usize] == (received(k).t_us, received(k).frame)));
    assert_eq!(logs::mcap::recorded_setup(&*path), Some(setup()));
}

/// As many as a simulated flight of ten times the speed has in the 11 s that a busy disk takes for one flush.
#[test]
fn nothing_is_left_out_while_a_slow_disk_is_waited_for() {
    let path = scratch("slow");
    let recorder = Recorder::start(&path, &setup()).unwrap();
    for k in 0..25_000 {
        recorder.record(RecordItem::Frame(received(k)));
        recorder.record(RecordItem::Log(received(k).t_us, Severity::Info, "derived".to_owned()));
    }
    let stats = recorder.finish();
    assert_eq!((stats.written, stats.skipped, stats.dropped), (50_000, 0, 0));
}

#[test]
fn a_power_cut_costs_the_unfinished_second_only() {
    let path = scratch("cut");
    let mut output = write_chunks(&path, 5, 100);
    for k in 500..550 {
        output.write(&RecordItem::Frame(received(k))).unwrap();
    }
    // As `kill -9` leaves it: nothing is flushed, no end is written.
    let copy = path.with_extension("copy.mcap");
    std::fs::copy(&*path, &copy).unwrap();
    let (frames, damage) = read(&copy);
    assert_eq!(frames.len(), 500);
    assert!(damage.truncated);
    let bytes = std::fs::read(&*path).unwrap();
    std::fs::write(&copy, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let (frames, _) = read(&copy);
    assert!(frames.len() >= 200 && frames.len() % 100 == 0, "{}", frames.len());
}

#[test]
fn a_damaged_chunk_is_skipped_and_the_rest_is_read() {
    let path = scratch("damage");
    write_chunks(&path, 6, 100).finish().unwrap();
    let clean = std::fs::read(&*path).unwrap();
    let starts: Vec<_> =
        clean.windows(8).enumerate().filter(|(_, w)| *w == b"\x04\0\0\0zstd").map(|(k, _)| k).collect();
    // Once in the data of the third chunk of frames, once in its length.
    for at in [starts[3] + 40, starts[3] - 30] {
        let mut bytes = clean.clone();
        bytes[at..at + 8].iter_mut().for_each(|b| *b ^= 0x5A);
        std::fs::write(&*path, &bytes).unwrap();
        let (frames, damage) = read(&path);
        assert_eq!(frames.len(), 500, "damage at {at}");
        assert!(damage.any());
    }
}

#[test]
fn any_flipped_byte_is_survived() {
    let path = scratch("flip");
    write_chunks(&path, 3, 20).finish().unwrap();
    let clean = std::fs::read(&*path).unwrap();
    for at in (8..clean.len()).step_by(23) {
        let mut bytes = clean.clone();
        bytes[at] ^= 0xFF;
        std::fs::write(&*path, &bytes).unwrap();
        let frames: Vec<_> = logs::open(&*path).unwrap().filter_map(Result::ok).collect();
        assert!(frames.len() <= 60);
    }
}

#[test]
fn a_file_that_exists_is_not_overwritten() {
    let path = scratch("exists");
    Recorder::start(&path, &setup()).unwrap().finish();
    let error = Recorder::start(&path, &setup()).unwrap_err().to_string();
    assert!(error.contains("flight.mcap"), "{error}");
}

#[test]
fn folders_get_a_name_with_the_date() {
    assert_eq!(
        recording_path(Path::new("logs"), 1_767_323_045_000_000),
        Path::new("logs/gaware-20260102-030405.mcap")
    );
    assert_eq!(recording_path(Path::new("a/b.mcap"), 0), Path::new("a/b.mcap"));
}

#[test]
fn a_second_start_in_the_same_second_takes_another_name() {
    let path = scratch("twice");
    let folder = path.parent().unwrap();
    let start = || Recorder::start_in(folder, 1_700_000_000_000_000, &setup(), None).unwrap();
    let (first, second, third) = (start(), start(), start());
    let name = |r: &Recorder| r.path().file_name().unwrap().to_str().unwrap().to_owned();
    assert_eq!(name(&first), "gaware-20231114-221320.mcap");
    assert_eq!(name(&second), "gaware-20231114-221320-2.mcap");
    assert_eq!(name(&third), "gaware-20231114-221320-3.mcap");
    // A file that was named is never overwritten, nor is another one made instead.
    assert!(Recorder::start_in(first.path(), 0, &setup(), None).is_err());
}

#[test]
fn a_file_that_is_deleted_or_truncated_is_counted_as_lost_and_another_begins() {
    for (name, spoil) in [
        ("deleted", (|p: &Path| std::fs::remove_file(p).unwrap()) as fn(&Path)),
        (
            "truncated",
            (|p: &Path| File::options().write(true).open(p).unwrap().set_len(100).unwrap()) as fn(&Path),
        ),
    ] {
        let path = scratch(name);
        let recorder = Recorder::start(&path, &setup()).unwrap();
        let mut k = 0;
        let mut record_until = |done: &dyn Fn(RecorderStats) -> bool| {
            loop {
                let stats = recorder.stats();
                if done(stats) {
                    return;
                }
                // No more than the recorder takes: the queue is not what is tested.
                if k < stats.written + stats.failed + stats.dropped + 500 {
                    recorder.record(RecordItem::Frame(received(k)));
                    k += 1;
                }
                std::thread::yield_now();
            }
        };
        record_until(&|s| s.written > 100);
        spoil(&path);
        record_until(&|s| s.failed > 100);
        let failed = recorder.stats().failed;
        record_until(&|s| s.written > 100);
        let stats = recorder.finish();
        assert!(stats.failed >= failed, "{stats:?}");
        let second = part_path(&path, 2);
        assert!(read(&second).0.len() > 100, "{name}");
    }
}

#[test]
fn what_a_writer_that_died_did_not_write_counts_as_lost() {
    let (items, inbox) = channel();
    let (counters, path) = (Arc::new(Counters::default()), PathBuf::new());
    let thread = Some(std::thread::spawn(|| {}));
    let recorder = Recorder { items: Some(items), counters, thread, path };
    (0..5).for_each(|k| recorder.record(RecordItem::Frame(received(k))));
    // The writer's thread ends with all that it has.
    drop(inbox);
    (5..12).for_each(|k| recorder.record(RecordItem::Frame(received(k))));
    assert_eq!(recorder.stats().dropped, 7, "shown while the run goes on");
    let stats = recorder.finish();
    assert_eq!((stats.written, stats.dropped, stats.failed), (0, 7, 5));
}

#[test]
fn a_truncation_is_seen_however_much_was_written_since() {
    let path = scratch("hole");
    let mut output = write_chunks(&path, 2, 50);
    File::options().write(true).open(&*path).unwrap().set_len(100).unwrap();
    for k in 100..2000 {
        output.write(&RecordItem::Frame(received(k))).unwrap();
    }
    output.sync().unwrap();
    let length = std::fs::metadata(&*path).unwrap().len();
    assert!(length > 1000 && length < output.appended.load(Ordering::Relaxed));
}

/// Records frames until so many files of this run were begun; never more than the writer takes.
fn record_files(recorder: &Recorder, files: u64) {
    let mut k = 0;
    while recorder.stats().files < files {
        if recorder.waiting() < 500 {
            recorder.record(RecordItem::Frame(incompressible(k)));
            k += 1;
        } else {
            std::thread::yield_now();
        }
    }
}

/// A frame whose bytes no compression makes fewer.
fn incompressible(k: u64) -> Received {
    let mix = |n: u64| (k.wrapping_mul(31) + n).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let payload: Vec<u8> = (0..24).flat_map(|n| (mix(n) ^ (mix(n) >> 29)).to_le_bytes()).collect();
    let sender = Sender { system_id: 1, component_id: 1 };
    // DATA96 takes any bytes.
    Received {
        link: 0,
        peer: None,
        t_us: k * 1000,
        frame: Frame::of_payload(sender, k as u8, 172, &payload[..98]).unwrap(),
    }
}

/// Sizes of the recordings in a folder by name.
fn sizes(folder: &Path) -> std::collections::BTreeMap<String, u64> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    entries.map(|e| (e.file_name().into_string().unwrap(), e.metadata().unwrap().len())).collect()
}

#[test]
fn with_a_limit_the_oldest_recordings_go_and_nothing_else() {
    let path = scratch("limit");
    let folder = path.parent().unwrap();
    std::fs::create_dir_all(folder).unwrap();
    let limit: RecordLimit = "1MB".parse().unwrap();
    // Foreign files: by name, by content, and one that is no file; then an old recording of ours, and one that is written.
    std::fs::write(folder.join("notes.txt"), vec![b'x'; 300_000]).unwrap();
    std::fs::write(folder.join("survey.mcap"), vec![b'x'; 300_000]).unwrap();
    std::fs::write(folder.join("gaware-20200101-000000.mcap"), vec![b'x'; 300_000]).unwrap();
    std::fs::create_dir(folder.join("gaware-20200101-000001.mcap")).unwrap();
    drop(write_chunks(&folder.join("gaware-20200101-000002.mcap"), 1, 100));
    let other = write_chunks(&folder.join("gaware-20200101-000003.mcap"), 1, 100);
    let recorder = Recorder::start_in(folder, 1_700_000_000_000_000, &setup(), Some(limit)).unwrap();
    record_files(&recorder, 14);
    let current = recorder.path().with_file_name("gaware-20231114-221320_14.mcap");
    let stats = recorder.finish();
    assert_eq!((stats.files, stats.failed, stats.dropped), (14, 0, 0), "{stats:?}");
    assert!(stats.removed_files >= 7 && stats.removed_bytes > 500_000, "{stats:?}");
    let left = sizes(folder);
    for kept in ["notes.txt", "survey.mcap", "gaware-20200101-000000.mcap", "gaware-20200101-000003.mcap"] {
        assert!(left.contains_key(kept), "{kept} is gone: {left:?}");
    }
    assert!(!left.contains_key("gaware-20200101-000002.mcap"), "the oldest of ours stays: {left:?}");
    assert!(current.exists(), "{left:?}");
    let ours = |(name, _): &(&String, &u64)| name.starts_with("gaware-20231114");
    let total: u64 = left.iter().filter(ours).map(|(_, bytes)| bytes).sum();
    assert!(total <= limit.bytes(), "{total}: {left:?}");
    // Every file is whole.
    for (name, _) in left.iter().filter(ours) {
        let (frames, damage) = read(&folder.join(name));
        assert!(!damage.any(), "{name}: {damage:?}");
        assert!(name.ends_with("_14.mcap") || frames.len() > 100, "{name}: {}", frames.len());
        assert_eq!(logs::mcap::recorded_setup(folder.join(name)), Some(setup()));
    }
    drop(other);
}

#[test]
fn with_a_limit_a_named_recording_removes_files_of_its_own_run_only() {
    let path = scratch("named");
    let folder = path.parent().unwrap();
    let earlier = folder.join("flight_3.mcap");
    drop(write_chunks(&earlier, 1, 100));
    let limit: RecordLimit = "1MB".parse().unwrap();
    let recorder = Recorder::start_in(&path, 0, &setup(), Some(limit)).unwrap();
    record_files(&recorder, 12);
    let stats = recorder.finish();
    assert!(stats.removed_files >= 4, "{stats:?}");
    assert!(earlier.exists() && read(&earlier).0.len() == 100, "{:?}", sizes(folder));
    assert!(!path.exists(), "the first of this run is the oldest");
}
