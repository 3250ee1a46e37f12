//! The table as a page of the documentation, `docs/firmware-rules.md`; a test keeps the two equal.

use super::Firmware;
use super::table::{ROWS, Row};
use crate::item::command;
use std::fmt::Write as _;

/// Commands that `gaware plan` can write.
pub const PLANNED: [u16; 9] = [
    command::NAV_WAYPOINT,
    command::NAV_LOITER_UNLIM,
    command::NAV_LOITER_TURNS,
    command::NAV_LOITER_TIME,
    command::NAV_LAND,
    command::NAV_TAKEOFF,
    command::NAV_LOITER_TO_ALT,
    command::CONDITION_YAW,
    command::DO_CHANGE_SPEED,
];

const HEAD: &str = "# What autopilots take in missions

Generated from `mission/src/rules/table.rs`; `UPDATE_DOCS=1 cargo test -p gaware-mission --lib rules` writes it again.

Before an upload, `gaware` judges every item by this table. *NaN* names the parameters in which `null` (NaN) is taken; infinity is
never accepted. ArduPilot cuts altitudes to centimetres, has home as item 0 and reads every frame of a command without a place back as 0. PX4 reads
frames 0 and 3 back as 5 and 6. Commands marked with * are those that `gaware plan` can write.

| command | firmware | verdict | parameter 1 | 2 | 3 | 4 | NaN | frames | source |
|---|---|---|---|---|---|---|---|---|---|
";

const TAIL: &str = "
## PX4's second check

PX4 acknowledges a mission first and judges it afterwards (`FeasibilityChecker.cpp`); what it rejects cannot be started, and only EVENT (410) says
why.

| rule | parameter | event, low 24 bits |
|---|---|---|
| a fixed wing's mission has a landing | `MIS_TKO_LAND_REQ` 2 | 0x811691; in the air 0x2b5ff0 |
| the glide slope is at most 5.0 deg (0.1 deg of slack) | `FW_LND_ANG` | 0x48d925 |
| a required take-off is there | `MIS_TKO_LAND_REQ` 1, 3 | 0x53d6e2 |
| the take-off climbs 1 m above the acceptance radius | `NAV_ACC_RAD` | 0xba4a6d |
";

/// The page.
pub fn page() -> String {
    let mut page = HEAD.to_owned();
    let mut rows: Vec<&Row> = ROWS.iter().collect();
    rows.sort_by_key(|r| r.command);
    for row in rows {
        let names: Vec<&str> = row.firmware.iter().map(|f| Firmware::name(*f)).collect();
        let mark = if PLANNED.contains(&row.command) { "\\*" } else { "" };
        let _ = write!(
            page,
            "| {} {}{mark} | {} | {} |",
            row.command,
            command::describe(row.command),
            names.join(", "),
            verdict(row)
        );
        for kept in row.kept {
            let _ = write!(page, " {} |", if row.taken { kept.describe() } else { String::new() });
        }
        let nan: Vec<String> =
            (1..=4).zip(row.nan).filter(|(_, may)| *may).map(|(n, _)| n.to_string()).collect();
        let frames: Vec<String> =
            (0..12).filter(|f| row.frames.take(crate::item::Frame(*f))).map(|f| f.to_string()).collect();
        let frames = if frames.len() == 12 { "any → 0".to_owned() } else { frames.join(" ") };
        let note = if row.note.is_empty() { String::new() } else { format!("; {}", row.note) };
        let _ = writeln!(page, " {} | {frames} | {}{note} |", nan.join(" "), row.source);
    }
    page + TAIL
}

fn verdict(row: &Row) -> &'static str {
    use super::table::Kept::Exact;
    match row.taken {
        false => "refused",
        true if row.kept == [Exact; 4] => "accepted",
        true => "rewritten",
    }
}
