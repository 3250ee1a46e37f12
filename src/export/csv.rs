//! A table as comma-separated values (RFC 4180): one header line, then a line per row; a number that is absent is an empty field.

use super::table::{Table, Values};
use std::io;

/// The whole file.
pub fn bytes(table: &Table) -> io::Result<Vec<u8>> {
    let mut out = ::csv::Writer::from_writer(Vec::new());
    out.write_record(table.columns.iter().map(|c| c.name.as_str()))?;
    for row in 0..table.rows() {
        out.write_record(table.columns.iter().map(|c| field(&c.values, row)))?;
    }
    out.into_inner().map_err(|e| e.into_error())
}

/// The shortest text that reads back as the same number.
fn field(values: &Values, row: usize) -> String {
    match values {
        Values::Number(v) => v.get(row).filter(|x| x.is_finite()).map(f64::to_string).unwrap_or_default(),
        Values::Text(v) => v.get(row).cloned().unwrap_or_default(),
        Values::Flag(v) => v.get(row).copied().unwrap_or_default().to_string(),
    }
}
