//! ArduPilot's own log (`.bin`): inertial samples at the loop rate in floating point, fixes with vertical velocity and
//! their accuracies, the autopilot's attitude.
//!
//! `IMU` holds the same filtered point samples as the messages on the link, unrounded. `GPS` is followed by a `GPA` of the
//! same time with the accuracies; a fix waits for it. Only the first inertial unit and the first receiver are used.

use super::{Damage, Item, LogError, LogReader, Progress, Record};
use ardupilot_binlog::{Entry, Reader};
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{AttitudeHint, FixVelocity, GnssFix, ImuSample, ImuStream, RestartReason, Sample};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// First bytes of a message of this format.
pub const MAGIC: [u8; 2] = [0xA3, 0x95];
/// After so long without a sample the motion state is worthless, µs.
const GAP_US: u64 = 10_000_000;
/// Stamps that go back further than this mean a reboot, µs.
const REORDER_US: u64 = 1_000_000;

/// Counts what passes.
#[derive(Debug)]
struct Counted {
    file: File,
    bytes: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.bytes.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }
}

/// Reads a DataFlash log.
pub struct DataflashReader {
    reader: Reader<Counted>,
    bytes: Arc<AtomicU64>,
    total_bytes: u64,
    damage: Damage,
    queue: VecDeque<Record>,
    waiting: Option<(u64, GnssFix)>,
    last_imu_us: Option<u64>,
    last_fix_us: Option<u64>,
    records: u64,
    finished: bool,
}

impl DataflashReader {
    /// Starts at the first byte.
    pub fn new(file: File, total_bytes: u64) -> Self {
        let bytes = Arc::new(AtomicU64::new(0));
        let reader = Reader::new(Counted { file, bytes: Arc::clone(&bytes) });
        Self {
            reader,
            bytes,
            total_bytes,
            damage: Damage::default(),
            queue: VecDeque::new(),
            waiting: None,
            last_imu_us: None,
            last_fix_us: None,
            records: 0,
            finished: false,
        }
    }

    fn put(&mut self, t_us: u64, sample: Sample) {
        self.queue.push_back(Record { t_us, item: Item::Sample(sample) });
    }

    fn release_fix(&mut self) {
        if let Some((t_us, fix)) = self.waiting.take() {
            self.put(t_us, Sample::Fix(fix));
        }
    }

    fn take(&mut self, entry: &Entry) {
        // Firmware before 4.1 has no instance field and names further instances IMU2, GPS2.
        if entry.get_f64("I").is_some_and(|i| i != 0.0) {
            return;
        }
        let Some(t_us) = entry.timestamp_usec else { return };
        match entry.name.as_str() {
            "IMU" => self.imu(t_us, entry),
            "GPS" => {
                self.release_fix();
                if self.last_fix_us != Some(t_us)
                    && let Some(fix) = fix(t_us, entry)
                {
                    self.last_fix_us = Some(t_us);
                    self.waiting = Some((t_us, fix));
                }
            }
            "GPA" => {
                if let Some((_, fix)) = self.waiting.as_mut().filter(|(t, _)| *t == t_us) {
                    accuracies(fix, entry);
                }
                self.release_fix();
            }
            "ATT" => {
                if let Some(roll_pitch_yaw) = vector(entry, ["Roll", "Pitch", "Yaw"]) {
                    let roll_pitch_yaw = roll_pitch_yaw.map(f64::to_radians).into();
                    self.put(t_us, Sample::Attitude(AttitudeHint { t_s: seconds(t_us), roll_pitch_yaw }));
                }
            }
            _ => {}
        }
    }

    fn imu(&mut self, t_us: u64, entry: &Entry) {
        let (Some(gyro), Some(accel)) =
            (vector(entry, ["GyrX", "GyrY", "GyrZ"]), vector(entry, ["AccX", "AccY", "AccZ"]))
        else {
            self.damage.bad_records += 1;
            return;
        };
        match self.last_imu_us {
            None => {
                self.put(t_us, Sample::Stream(ImuStream { message: "IMU".to_owned(), ..Default::default() }))
            }
            Some(last) if t_us + REORDER_US < last => {
                self.last_fix_us = None;
                self.put(t_us, Sample::Restart(RestartReason::Reboot));
            }
            Some(last) if t_us <= last => {
                self.damage.bad_records += 1;
                return;
            }
            Some(last) if t_us > last + GAP_US => self.put(t_us, Sample::Restart(RestartReason::ClockJump)),
            Some(_) => {}
        }
        self.last_imu_us = Some(t_us);
        let temperature_degc = entry.get_f64("T").filter(|t| *t != 0.0 && t.is_finite());
        self.put(t_us, Sample::Imu(ImuSample { t_s: seconds(t_us), gyro, accel, temperature_degc }));
    }
}

fn seconds(t_us: u64) -> f64 {
    t_us as f64 * 1e-6
}

fn vector(entry: &Entry, names: [&str; 3]) -> Option<Vector3<f64>> {
    let [x, y, z] = names.map(|n| entry.get_f64(n).filter(|v| v.is_finite()));
    Some(Vector3::new(x?, y?, z?))
}

fn fix(t_us: u64, entry: &Entry) -> Option<GnssFix> {
    let get = |name| entry.get_f64(name).filter(|v| v.is_finite());
    let (lat, lon) = (get("Lat")? * 1e-7, get("Lng")? * 1e-7);
    if get("Status")? < 3.0 || (lat, lon) == (0.0, 0.0) || lat.abs() > 90.0 || lon.abs() > 180.0 {
        return None;
    }
    let position = Geodetic::from_degrees(lat, lon, get("Alt")?);
    let velocity = match (get("Spd"), get("GCrs"), get("VZ")) {
        (Some(speed), Some(course), down) => {
            let (sin, cos) = course.to_radians().sin_cos();
            let (n, e) = (speed * cos, speed * sin);
            down.map_or(FixVelocity::Horizontal([n, e]), |d| FixVelocity::Full([n, e, d]))
        }
        _ => FixVelocity::None,
    };
    Some(GnssFix {
        t_s: seconds(t_us),
        position,
        velocity,
        position_sigma_m: None,
        velocity_sigma_m_per_s: None,
        yaw_rad: None,
    })
}

/// Adds the accuracies; 0 is "unknown".
fn accuracies(fix: &mut GnssFix, entry: &Entry) {
    let told = |name| entry.get_f64(name).filter(|v| v.is_finite() && *v > 0.0);
    if let (Some(h), Some(v)) = (told("HAcc"), told("VAcc")) {
        fix.position_sigma_m = Some([h, h, v]);
    }
    fix.velocity_sigma_m_per_s = told("SAcc").map(|s| [s; 3]);
}

impl Iterator for DataflashReader {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.queue.is_empty() && !self.finished {
            match self.reader.next() {
                Some(Ok(entry)) => self.take(&entry),
                Some(Err(_)) => self.damage.bad_records += 1,
                None => {
                    self.finished = true;
                    self.release_fix();
                    let read = self.bytes.load(Ordering::Relaxed);
                    // The parser gives up after much damage in a row.
                    self.damage.skipped_bytes += self.total_bytes.saturating_sub(read);
                    if self.records == 0 && self.queue.is_empty() {
                        let bytes = self.total_bytes;
                        return Some(Err(LogError::NothingReadable { format: "DataFlash", bytes }));
                    }
                }
            }
        }
        let record = self.queue.pop_front()?;
        self.records += 1;
        Some(Ok(record))
    }
}

impl LogReader for DataflashReader {
    fn progress(&self) -> Progress {
        Progress { read_bytes: self.bytes.load(Ordering::Relaxed), total_bytes: self.total_bytes }
    }

    fn damage(&self) -> Damage {
        self.damage
    }

    fn autopilot(&self) -> Option<&'static str> {
        Some("ardupilot")
    }
}
