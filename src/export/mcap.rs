//! All tables in one MCAP file: a channel for each, a flat JSON object for each row, in the order of time, for Foxglove, PlotJuggler and
//! the `mcap` libraries. It is no recording: raw frames are not in it. Log times are the time on the autopilot's base.

use super::table::{Table, Values};
use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{McapError, WriteOptions};
use serde_json::{Map, Number, Value, json};
use std::collections::BTreeMap;
use std::io::{self, Cursor};

/// The whole file.
pub fn bytes(tables: &[Table]) -> io::Result<Vec<u8>> {
    written(tables).map_err(io::Error::other)
}

fn written(tables: &[Table]) -> Result<Vec<u8>, McapError> {
    let mut out = Cursor::new(Vec::new());
    let library = format!("gaware {}", env!("CARGO_PKG_VERSION"));
    // The digest of the mark comes in at the end. Chunks keep checksums of their own.
    let options = WriteOptions::new().library(library).calculate_data_section_crc(false);
    let mut writer = options.create(&mut out)?;
    // Time, channel, table, row.
    let mut rows: Vec<(u64, u16, usize, usize)> = Vec::new();
    for (k, table) in tables.iter().enumerate() {
        let schema = serde_json::to_vec(&schema(table)).unwrap_or_default();
        let schema = writer.add_schema(&format!("gaware.{}", table.name), "jsonschema", &schema)?;
        let channel = writer.add_channel(schema, &format!("/{}", table.name), "json", &BTreeMap::new())?;
        rows.extend((0..table.rows()).map(|row| (time_ns(table, row), channel, k, row)));
    }
    rows.sort_by_key(|(t_ns, ..)| *t_ns);
    for (sequence, (t_ns, channel_id, table, row)) in rows.into_iter().enumerate() {
        let object = tables.get(table).map(|t| object(t, row)).unwrap_or_default();
        let data = serde_json::to_vec(&object).unwrap_or_default();
        let header =
            MessageHeader { channel_id, sequence: sequence as u32, log_time: t_ns, publish_time: t_ns };
        writer.write_to_known_channel(&header, &data)?;
    }
    let written_by = BTreeMap::from([("written_by".to_owned(), crate::outputs::mark::blank())]);
    writer.write_metadata(&Metadata { name: "gaware".to_owned(), metadata: written_by })?;
    writer.finish()?;
    drop(writer);
    Ok(out.into_inner())
}

/// A JSON schema without references and unions: what every reader of MCAP understands.
pub fn schema(table: &Table) -> Value {
    let kind = |values: &Values| match values {
        Values::Number(_) => "number",
        Values::Text(_) => "string",
        Values::Flag(_) => "boolean",
    };
    let properties: Map<String, Value> = table
        .columns
        .iter()
        .map(|c| (c.name.clone(), json!({"type": kind(&c.values), "description": c.about})))
        .collect();
    json!({"title": format!("gaware.{}", table.name), "description": table.about, "type": "object", "properties": properties})
}

/// Time of a row, ns.
fn time_ns(table: &Table, row: usize) -> u64 {
    let t_s = table.columns.iter().find(|c| c.name == "t_s").and_then(|c| match &c.values {
        Values::Number(v) => v.get(row).copied(),
        _ => None,
    });
    // Saturates below zero and beyond the range.
    (t_s.unwrap_or_default() * 1e9) as u64
}

/// A row; numbers that are absent are left out.
pub fn object(table: &Table, row: usize) -> Map<String, Value> {
    let value = |values: &Values| match values {
        Values::Number(v) => v.get(row).and_then(|x| Number::from_f64(*x)).map(Value::Number),
        Values::Text(v) => v.get(row).map(|x| json!(x)),
        Values::Flag(v) => v.get(row).map(|x| json!(x)),
    };
    table.columns.iter().filter_map(|c| Some((c.name.clone(), value(&c.values)?))).collect()
}
