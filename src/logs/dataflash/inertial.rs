//! Inertial messages: `IMU`, `IMU2`, `IMU3` (filtered samples), `IMT…` (increments with their intervals), `ACC`/`GYR` (samples at the
//! sensor's own rate).
//!
//! `ISBH`/`ISBD` hold bursts with pauses between them: spectra, but no path.

use super::Entry;
use crate::logs::source::{Kind, Source};
use gaware_nav::sample::ImuSample;
use nalgebra::Vector3;

/// Raw samples are averaged over this, µs: nothing above 100 Hz moves a vehicle, and a filter step costs time.
const RAW_INTERVAL_US: u64 = 4_000;
/// Axes end at 16 g on almost all units, m/s².
const RANGE: f64 = 156.0;

/// Raw samples this far apart have others missing between them, µs: sensors that log them take 250 to 8000 a second, in bursts of up to 8 ms.
const HOLE_US: u64 = 10_000;

/// A sample.
pub(super) struct Inertial {
    /// Time of the instant, or of the end of the interval.
    pub(super) t_us: u64,
    pub(super) sample: ImuSample,
    /// Time that it is the mean of, s; 0 for an instant.
    pub(super) interval_s: f64,
}

impl Inertial {
    pub(super) fn is_clipped(&self) -> bool {
        self.sample.accel.amax() >= RANGE
    }
}

/// Sums of one unit's raw samples.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    start_us: u64,
    last_us: u64,
    gyro: (Vector3<f64>, u32),
    accel: (Vector3<f64>, u32),
}

/// Raw samples of up to three units on their way to means.
#[derive(Debug, Default)]
pub(super) struct Raw([Sums; 3]);

/// The kind of an inertial message and its unit; nothing of another message.
pub(super) fn source(entry: &Entry) -> Option<(&'static str, Source)> {
    let name = entry.format.name.as_str();
    let (family, rest, kind) =
        [("IMU", Kind::Imu), ("IMT", Kind::Increments), ("ACC", Kind::Raw), ("GYR", Kind::Raw)]
            .into_iter()
            .find_map(|(family, kind)| Some((family, name.strip_prefix(family)?, kind)))?;
    // Firmware before 4.1 has no instance field and counts units in the name: IMU, IMU2, and ACC1 for the first.
    let unit = match rest {
        "" => entry.number("I").unwrap_or(0.0) as u8,
        number => number.parse::<u8>().ok()?.checked_sub(1)?,
    };
    Some((family, Source { kind, unit }))
}

/// The sample of a message; an inner nothing where more messages make one, nothing at all where its content is wrong.
pub(super) fn sample(family: &str, unit: u8, entry: &Entry, raw: &mut Raw) -> Option<Option<Inertial>> {
    let t_us = entry.stamp_us()?;
    let temperature_degc = entry.number("T").or(entry.number("Temp")).filter(|t| *t != 0.0);
    let point = |gyro, accel| ImuSample { t_s: 0.0, gyro, accel, temperature_degc };
    match family {
        "IMU" => {
            let gyro = entry.vector(["GyrX", "GyrY", "GyrZ"])?;
            let accel = entry.vector(["AccX", "AccY", "AccZ"])?;
            Some(Some(Inertial { t_us, sample: point(gyro, accel), interval_s: 0.0 }))
        }
        "IMT" => {
            let of = |name: &str| entry.number(name).filter(|dt| *dt > 0.0);
            let (Some(angle_s), Some(velocity_s)) = (of("DelaT"), of("DelvT").or(of("DelT"))) else {
                return Some(None);
            };
            let gyro = entry.vector(["DelAX", "DelAY", "DelAZ"])? / angle_s;
            let accel = entry.vector(["DelVX", "DelVY", "DelVZ"])? / velocity_s;
            Some(Some(Inertial { t_us, sample: point(gyro, accel), interval_s: angle_s }))
        }
        family => {
            let at_us = entry.number("SampleUS").filter(|t| *t > 0.0).map_or(t_us, |t| t as u64);
            let Some(sums) = raw.0.get_mut(usize::from(unit)) else { return Some(None) };
            if family == "ACC" {
                let accel = entry.vector(["AccX", "AccY", "AccZ"])?;
                let before = sums.before_hole(at_us);
                sums.accel = (sums.accel.0 + accel, sums.accel.1 + 1);
                return Some(before);
            }
            let gyro = entry.vector(["GyrX", "GyrY", "GyrZ"])?;
            let before = sums.before_hole(at_us);
            sums.gyro = (sums.gyro.0 + gyro, sums.gyro.1 + 1);
            let full = before.is_none() && sums.last_us - sums.start_us >= RAW_INTERVAL_US;
            Some(if full { sums.mean() } else { before })
        }
    }
}

impl Sums {
    /// Comes to the time of a sample; where others are missing before it, the mean of those up to the hole.
    fn before_hole(&mut self, at_us: u64) -> Option<Inertial> {
        let hole = at_us < self.start_us || at_us.saturating_sub(self.last_us) > HOLE_US;
        let mean = if hole { self.mean() } else { None };
        if hole {
            *self = Self { start_us: at_us, last_us: at_us, ..Self::default() };
        }
        self.last_us = self.last_us.max(at_us);
        mean
    }

    /// The mean since the last one.
    fn mean(&mut self) -> Option<Inertial> {
        let length_us = self.last_us - self.start_us;
        if length_us == 0 || self.gyro.1 == 0 || self.accel.1 == 0 {
            return None;
        }
        let end_us = self.last_us;
        let sums = std::mem::replace(self, Self { start_us: end_us, last_us: end_us, ..Self::default() });
        let gyro = sums.gyro.0 / f64::from(sums.gyro.1);
        let accel = sums.accel.0 / f64::from(sums.accel.1);
        let sample = ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None };
        Some(Inertial { t_us: end_us, sample, interval_s: length_us as f64 * 1e-6 })
    }
}
