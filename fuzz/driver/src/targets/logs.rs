//! Log readers. What they give goes on into the converter, which has to live with any stamp and any number.

use super::engine::FLIGHT;
use super::refused;
use gaware::logs::dataflash::DataflashReader;
use gaware::logs::mcap::{McapReader, setup_in};
use gaware::logs::table::TableReader;
use gaware::logs::tlog::TlogReader;
use gaware::logs::ulog::UlogReader;
use gaware::logs::{Item, LogReader};
use gaware::sensors::{Converter, ConverterOptions};
use std::io::Cursor;

/// What stands between the two tables of an input.
const BETWEEN_TABLES: &[u8] = b"\n--\n";

/// Reads to the end. Damage never counts more bytes than there are, and samples are finite.
fn read(mut reader: impl LogReader, total: usize) -> bool {
    let mut records = 0;
    let mut converter = Converter::new(ConverterOptions::default());
    let mut samples = Vec::new();
    for record in reader.by_ref() {
        match record {
            Ok(record) => {
                records += 1;
                match &record.item {
                    Item::Frame(frame) => converter.feed(record.t_us, frame, &mut samples),
                    Item::Measurement(measurement) => converter.take(measurement, &mut samples),
                    Item::Note(_) => {}
                }
            }
            Err(error) => _ = refused(&error),
        }
        // An estimator takes them as they come.
        samples.clear();
    }
    let damage = reader.damage();
    assert!(damage.skipped_bytes <= total as u64, "{damage:?} of {total} bytes");
    let _ = (reader.vehicle_kind(), reader.autopilot(), converter.take_notices().len());
    records > 0
}

/// `.tlog`.
pub fn tlog(data: &[u8]) -> bool {
    read(TlogReader::new(data, data.len() as u64), data.len())
}

/// DataFlash `.bin`.
pub fn dataflash(data: &[u8]) -> bool {
    read(DataflashReader::new(data, data.len() as u64), data.len())
}

/// `.ulg`.
pub fn ulog(data: &[u8]) -> bool {
    read(UlogReader::new(data, data.len() as u64), data.len())
}

/// Recordings of gaware, and the set-up in them.
pub fn mcap(data: &[u8]) -> bool {
    let _ = setup_in(McapReader::new(Cursor::new(data), data.len() as u64));
    read(McapReader::new(Cursor::new(data), data.len() as u64), data.len())
}

/// Two tables: inertial samples, and fixes.
pub fn table(data: &[u8]) -> bool {
    let at = data.windows(BETWEEN_TABLES.len()).position(|w| w == BETWEEN_TABLES);
    let (imu, fixes) = data.split_at(at.unwrap_or(data.len()));
    let fixes = fixes.strip_prefix(BETWEEN_TABLES).unwrap_or(fixes);
    match TableReader::of_tables(imu, fixes) {
        Ok(reader) => read(reader, data.len()),
        Err(error) => refused(&error),
    }
}

/// Pieces of a flight as a `.tlog`.
pub fn tlog_seeds() -> Vec<Vec<u8>> {
    let entry =
        |(t_us, frame): &(u64, gaware::link::frame::Frame)| [&t_us.to_be_bytes()[..], frame.raw()].concat();
    let entries: Vec<Vec<u8>> = FLIGHT.frames.iter().map(entry).collect();
    entries.chunks(60).step_by(40).map(<[Vec<u8>]>::concat).collect()
}

/// Two small tables.
pub fn table_seeds() -> Vec<Vec<u8>> {
    let mut text = "t_s,wx,wy,wz,fx,fy,fz\n".to_owned();
    for k in 0..20 {
        text.push_str(&format!("{:.2},0.01,0.02,0.03,0.0,0.1,-9.8\n", 0.02 * f64::from(k)));
    }
    text.push_str("--\nt_s,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd\n");
    for k in 0..5 {
        text.push_str(&format!(
            "{:.1},47.1,8.5,450.0,1.0,2.0,0.0,1.5,1.5,2.5,0.1,0.1,0.2\n",
            0.1 * f64::from(k)
        ));
    }
    vec![text.into_bytes()]
}
