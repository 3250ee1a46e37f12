//! PX4's own log (`.ulg`): `sensor_combined`, `vehicle_gps_position` (or `sensor_gps`), `vehicle_attitude`.
//!
//! `sensor_combined` holds means over the integration interval that ends at the stamp, with the calibration applied
//! and without the filter's bias estimates. The parser pushes, an iterator pulls: it runs in a thread of its own behind a
//! bounded channel.

use super::{Damage, Item, LogError, LogReader, Progress, Record};
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{
    AttitudeHint, FixVelocity, GnssFix, ImuSample, ImuStream, Quantisation, RestartReason, Sample, SampleKind,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use px4_ulog::stream_parser::LogParser;
use px4_ulog::stream_parser::model::{DataMessage, FlattenedFieldType, FlattenedFormat};
use std::fs::File;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// First bytes of the format.
pub const MAGIC: &[u8; 4] = b"ULog";
const RECORDS_AHEAD: usize = 8192;
/// After so long without a sample the motion state is worthless, µs.
const GAP_US: u64 = 10_000_000;

#[derive(Debug, Default)]
struct Shared {
    read_bytes: AtomicU64,
    bad_records: AtomicU64,
    truncated: AtomicBool,
}

/// Reads a ULog.
#[derive(Debug)]
pub struct UlogReader {
    records: Receiver<Result<Record, LogError>>,
    shared: Arc<Shared>,
    total_bytes: u64,
}

impl UlogReader {
    /// Starts to read at the first byte.
    pub fn new(file: File, total_bytes: u64) -> Self {
        let (sender, records) = sync_channel(RECORDS_AHEAD);
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        // Detached: it ends with the file, or when nobody takes its records any more.
        std::thread::spawn(move || read(file, total_bytes, &sender, &theirs));
        Self { records, shared, total_bytes }
    }
}

impl Iterator for UlogReader {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.records.recv().ok()
    }
}

impl LogReader for UlogReader {
    fn progress(&self) -> Progress {
        Progress { read_bytes: self.shared.read_bytes.load(Ordering::Relaxed), total_bytes: self.total_bytes }
    }

    fn damage(&self) -> Damage {
        Damage {
            bad_records: self.shared.bad_records.load(Ordering::Relaxed),
            truncated: self.shared.truncated.load(Ordering::Relaxed),
            ..Damage::default()
        }
    }

    fn autopilot(&self) -> Option<&'static str> {
        Some("px4")
    }
}

fn read(mut file: File, total_bytes: u64, sender: &SyncSender<Result<Record, LogError>>, shared: &Shared) {
    let mut converter = Topics::default();
    let mut closed = false;
    let mut on_data = |message: &DataMessage| {
        for record in converter.take(message, shared) {
            closed |= sender.send(Ok(record)).is_err();
        }
    };
    let mut parser = LogParser::default();
    parser.set_data_message_callback(&mut on_data);
    let mut buffer = vec![0; 64 * 1024];
    let mut read_bytes = 0_u64;
    let failure = loop {
        match file.read(&mut buffer) {
            Ok(0) => break None,
            Ok(n) => {
                read_bytes += n as u64;
                shared.read_bytes.store(read_bytes, Ordering::Relaxed);
                if parser.consume_bytes(buffer.get(..n).unwrap_or_default()).is_err() {
                    // The format has no way to find the next message after damage.
                    shared.bad_records.fetch_add(1, Ordering::Relaxed);
                    shared.truncated.store(true, Ordering::Relaxed);
                    break None;
                }
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(source) => break Some(LogError::Read { read_bytes, source }),
        }
    };
    if parser.has_leftover() {
        shared.truncated.store(true, Ordering::Relaxed);
    }
    drop(parser);
    let nothing = (converter.given == 0 && !closed)
        .then_some(LogError::NothingReadable { format: "ULog", bytes: total_bytes });
    if let Some(error) = failure.or(nothing) {
        // Nobody may be listening any more.
        let _ = sender.send(Err(error));
    }
}

/// Turns the topics into samples.
#[derive(Debug, Default)]
struct Topics {
    last_imu_us: Option<u64>,
    last_fix_us: Option<u64>,
    /// The GNSS topic that came first: the other one holds the same fixes.
    gnss_topic: Option<String>,
    given: u64,
}

impl Topics {
    fn take(&mut self, message: &DataMessage, shared: &Shared) -> Vec<Record> {
        let fields = Fields { format: message.flattened_format, data: message.data };
        let name = fields.format.message_name();
        if message.multi_id.value() != 0 {
            return Vec::new();
        }
        let Some(t_us) = fields.stamp() else { return Vec::new() };
        let samples = match name {
            "sensor_combined" => self.imu(t_us, &fields),
            "vehicle_gps_position" | "sensor_gps"
                if self.gnss_topic.get_or_insert_with(|| name.to_owned()) == name =>
            {
                Some(self.fix(t_us, &fields))
            }
            "vehicle_attitude" => attitude(t_us, &fields).map(|s| vec![s]),
            _ => return Vec::new(),
        };
        let Some(samples) = samples else {
            shared.bad_records.fetch_add(1, Ordering::Relaxed);
            return Vec::new();
        };
        self.given += samples.len() as u64;
        samples.into_iter().map(|s| Record { t_us, item: Item::Sample(s) }).collect()
    }

    fn imu(&mut self, t_us: u64, fields: &Fields) -> Option<Vec<Sample>> {
        let gyro = fields.vector("gyro_rad")?;
        let accel = fields.vector("accelerometer_m_s2")?;
        let mut out = Vec::new();
        match self.last_imu_us {
            None => out.push(Sample::Stream(ImuStream {
                message: "sensor_combined".to_owned(),
                kind: SampleKind::IntervalMean,
                quantisation: Quantisation::None,
            })),
            Some(last) if t_us <= last => return None,
            Some(last) if t_us > last + GAP_US => out.push(Sample::Restart(RestartReason::ClockJump)),
            Some(_) => {}
        }
        self.last_imu_us = Some(t_us);
        out.push(Sample::Imu(ImuSample { t_s: seconds(t_us), gyro, accel, temperature_degc: None }));
        Some(out)
    }

    /// A fix, or nothing where the receiver has none.
    fn fix(&mut self, t_us: u64, fields: &Fields) -> Vec<Sample> {
        let fix = fields.position().filter(|_| fields.number("fix_type").is_some_and(|t| t >= 3.0));
        let Some(position) = fix.filter(|_| self.last_fix_us != Some(t_us)) else { return Vec::new() };
        self.last_fix_us = Some(t_us);
        let told = |name| fields.number(name).filter(|v| *v > 0.0);
        let velocity = match ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s"].map(|n| fields.number(n)) {
            [Some(n), Some(e), Some(d)] => FixVelocity::Full([n, e, d]),
            _ => FixVelocity::None,
        };
        vec![Sample::Fix(GnssFix {
            t_s: seconds(t_us),
            position,
            velocity,
            // In this format eph and epv are metres.
            position_sigma_m: told("eph").zip(told("epv")).map(|(h, v)| [h, h, v]),
            velocity_sigma_m_per_s: told("s_variance_m_s").map(|s| [s; 3]),
            yaw_rad: None,
        })]
    }
}

fn attitude(t_us: u64, fields: &Fields) -> Option<Sample> {
    let [w, x, y, z] = ["q[0]", "q[1]", "q[2]", "q[3]"].map(|n| fields.number(n));
    let q = UnitQuaternion::try_new(Quaternion::new(w?, x?, y?, z?), 0.5)?;
    let (roll, pitch, yaw) = q.euler_angles();
    Some(Sample::Attitude(AttitudeHint { t_s: seconds(t_us), roll_pitch_yaw: [roll, pitch, yaw] }))
}

fn seconds(t_us: u64) -> f64 {
    t_us as f64 * 1e-6
}

/// Fields of a message by name, whatever their type.
struct Fields<'a> {
    format: &'a FlattenedFormat,
    data: &'a [u8],
}

impl Fields<'_> {
    fn stamp(&self) -> Option<u64> {
        let offset = self.format.get_field_offset("timestamp", FlattenedFieldType::UInt64).ok()?;
        Some(u64::from_le_bytes(*self.bytes(offset)?))
    }

    fn bytes<const N: usize>(&self, offset: u16) -> Option<&[u8; N]> {
        self.data.get(usize::from(offset)..)?.first_chunk()
    }

    /// A finite number.
    fn number(&self, name: &str) -> Option<f64> {
        use FlattenedFieldType::{Double, Float, Int32, UInt8};
        let at = |kind| self.format.get_field_offset(name, kind).ok();
        let value = if let Some(offset) = at(Float) {
            f64::from(f32::from_le_bytes(*self.bytes(offset)?))
        } else if let Some(offset) = at(Double) {
            f64::from_le_bytes(*self.bytes(offset)?)
        } else if let Some(offset) = at(Int32) {
            f64::from(i32::from_le_bytes(*self.bytes(offset)?))
        } else {
            let [value] = *self.bytes(at(UInt8)?)?;
            f64::from(value)
        };
        value.is_finite().then_some(value)
    }

    fn vector(&self, name: &str) -> Option<Vector3<f64>> {
        let [x, y, z] = [0, 1, 2].map(|k| self.number(&format!("{name}[{k}]")));
        Some(Vector3::new(x?, y?, z?))
    }

    /// Degrees and metres since 1.14, 1e-7 degrees and millimetres before.
    fn position(&self) -> Option<Geodetic> {
        let fine = ["latitude_deg", "longitude_deg", "altitude_msl_m"].map(|n| self.number(n));
        let coarse = ["lat", "lon", "alt"].map(|n| self.number(n));
        match (fine, coarse) {
            ([Some(lat), Some(lon), Some(alt)], _) => Some((lat, lon, alt)),
            (_, [Some(lat), Some(lon), Some(alt)]) => Some((lat * 1e-7, lon * 1e-7, alt * 1e-3)),
            _ => None,
        }
        .filter(|(lat, lon, _)| lat.abs() <= 90.0 && lon.abs() <= 180.0 && (*lat, *lon) != (0.0, 0.0))
        .map(|(lat, lon, alt)| Geodetic::from_degrees(lat, lon, alt))
    }
}
