//! Tables: a folder with `imu.csv` (time s, rates rad/s, specific forces m/s², forward-right-down, perhaps a temperature in °C)
//! and a table of fixes beside it (time s, latitude and longitude deg, height m, velocity north, east, down m/s, the 1-sigma
//! figures of both).
//!
//! Samples are means over the interval that ends at their time, as instruments that deliver increments give them. A truth
//! that may lie beside them is not looked at.

use super::{Damage, Item, LogError, LogReader, Progress, Record};
use crate::timeline::{Measurement, Stamp};
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{FixVelocity, GnssFix, ImuSample, ImuStream, Quantisation, SampleKind};
use nalgebra::Vector3;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Inertial samples in a folder.
const IMU: &str = "imu.csv";
/// Fixes in a folder, where no other table is named.
const FIXES: &str = "gps.csv";
/// Columns of both at least.
const IMU_COLUMNS: usize = 7;
const FIX_COLUMNS: usize = 13;

/// Whether a path means tables: a folder that holds inertial samples, or a table.
pub fn is_table(path: &Path) -> bool {
    path.join(IMU).is_file() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"))
}

/// Reads tables, all at once: they are small.
#[derive(Debug)]
pub struct TableReader {
    items: std::vec::IntoIter<Record>,
    read: u64,
    total: u64,
}

/// The rows of a table with a header: numbers, at least so many in a row, the first of them a time.
///
/// # Errors
/// A table that is missing, empty, too narrow or not numeric.
pub fn rows(path: &Path, columns: usize) -> Result<Vec<Vec<f64>>, LogError> {
    let file =
        crate::inputs::open(path).map_err(|source| LogError::Open { path: path.to_owned(), source })?;
    rows_of(file, path, columns)
}

/// The rows of a table; `path` is its name in errors.
fn rows_of(table: impl Read, path: &Path, columns: usize) -> Result<Vec<Vec<f64>>, LogError> {
    let wrong = |row: usize, reason: String| LogError::Table { path: path.to_owned(), row, reason };
    let mut reader = csv::Reader::from_reader(table);
    let mut out: Vec<Vec<f64>> = Vec::new();
    for (i, record) in reader.deserialize::<Vec<f64>>().enumerate() {
        let row = record.map_err(|e| wrong(i + 1, e.to_string()))?;
        if row.len() < columns {
            return Err(wrong(i + 1, format!("{} columns, at least {columns} are needed", row.len())));
        }
        if row.iter().any(|v| !v.is_finite()) || row[0] < 0.0 {
            return Err(wrong(i + 1, "a value is not finite, or the time is negative".into()));
        }
        out.push(row);
    }
    if out.is_empty() { Err(LogError::Empty(path.to_owned())) } else { Ok(out) }
}

/// An inertial sample from the columns of `imu.csv`.
pub fn imu(row: &[f64]) -> ImuSample {
    ImuSample {
        t_s: row[0],
        gyro: Vector3::new(row[1], row[2], row[3]),
        accel: Vector3::new(row[4], row[5], row[6]),
        temperature_degc: row.get(7).copied(),
    }
}

/// A fix from the columns of a table of fixes.
pub fn fix(row: &[f64]) -> GnssFix {
    GnssFix {
        t_s: row[0],
        position: Geodetic::from_degrees(row[1], row[2], row[3]),
        velocity: FixVelocity::Full([row[4], row[5], row[6]]),
        position_sigma_m: Some([row[7], row[8], row[9]]),
        velocity_sigma_m_per_s: Some([row[10], row[11], row[12]]),
        yaw_rad: None,
    }
}

impl TableReader {
    /// Reads the tables that a path means: a folder, or the table of fixes beside `imu.csv`.
    ///
    /// # Errors
    /// A table that is missing, empty, too narrow or not numeric.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let named = path.file_name().is_some_and(|n| n != IMU) && !path.is_dir();
        let folder: PathBuf = if path.is_dir() {
            path.to_owned()
        } else {
            path.parent().map(Path::to_owned).unwrap_or_default()
        };
        if !folder.join(IMU).is_file() {
            return Err(if path.exists() {
                LogError::NoImu(path.to_owned())
            } else {
                LogError::Open { path: path.to_owned(), source: std::io::ErrorKind::NotFound.into() }
            });
        }
        let fixes = if named { path.to_owned() } else { folder.join(FIXES) };
        Ok(Self::of(rows(&folder.join(IMU), IMU_COLUMNS)?, rows(&fixes, FIX_COLUMNS)?))
    }

    /// Reads the content of two tables, inertial samples and fixes.
    ///
    /// # Errors
    /// A table that is empty, too narrow or not numeric.
    pub fn of_tables(imu: impl Read, fixes: impl Read) -> Result<Self, LogError> {
        let imu = rows_of(imu, Path::new(IMU), IMU_COLUMNS)?;
        Ok(Self::of(imu, rows_of(fixes, Path::new(FIXES), FIX_COLUMNS)?))
    }

    fn of(imu_rows: Vec<Vec<f64>>, fix_rows: Vec<Vec<f64>>) -> Self {
        let stream = ImuStream {
            message: IMU.into(),
            kind: SampleKind::IntervalMean,
            quantisation: Quantisation::None,
        };
        let stamped = |t_s: f64| Stamp::from_seconds(t_s).unwrap_or(Stamp::Usec(0));
        let mut rows_of_both: Vec<(Stamp, Measurement)> = Vec::new();
        for row in imu_rows {
            let stamp = stamped(row[0]);
            rows_of_both.push((stamp, Measurement::Imu(stamp, imu(&row))));
        }
        for row in fix_rows {
            let stamp = stamped(row[0]);
            rows_of_both.push((stamp, Measurement::Fix(Some(stamp), fix(&row))));
        }
        // Two tables are no stream: the rows of both are laid beside each other. Stable: a sample goes before the fix of the
        // same time.
        rows_of_both.sort_by_key(|(stamp, _)| stamp.raw_us());
        let first = rows_of_both.first().map_or(Stamp::Usec(0), |(stamp, _)| *stamp);
        let items: Vec<Record> = std::iter::once((first, Measurement::Stream(stream)))
            .chain(rows_of_both)
            .map(|(stamp, measurement)| Record { t_us: stamp.raw_us(), item: Item::Measurement(measurement) })
            .collect();
        Self { total: items.len() as u64, items: items.into_iter(), read: 0 }
    }
}

impl Iterator for TableReader {
    type Item = Result<Record, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let record = self.items.next()?;
        self.read += 1;
        Some(Ok(record))
    }
}

impl LogReader for TableReader {
    /// In rows.
    fn progress(&self) -> Progress {
        Progress { read_bytes: self.read, total_bytes: self.total }
    }

    fn damage(&self) -> Damage {
        Damage::default()
    }
}
