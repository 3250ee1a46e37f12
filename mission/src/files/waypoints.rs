//! `QGC WPL 110`: one line per item, twelve columns, line 0 is home (the MAVLink "plain text file format").
//!
//! Written with tabs; read with any white space, because Mission Planner, MAVProxy and people differ in that.

use crate::item::{Frame, Home, LatLon, Mission, MissionItem};
use std::fmt::Write as _;

const HEADER: &str = "QGC WPL 110";
const COLUMNS: usize = 12;
/// No altitude is higher or lower, m.
const HIGHEST_M: f32 = 1e6;

/// Why a `.waypoints` file cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WaypointsError {
    /// Another format.
    #[error("line 1: \"QGC WPL 110\" expected, found \"{0}\"; save the mission again as .waypoints or .plan")]
    Header(String),
    /// Too few or too many columns.
    #[error("line {line}: {COLUMNS} columns expected, found {found}")]
    Columns {
        /// Line in the file, from 1.
        line: usize,
        /// Columns there.
        found: usize,
    },
    /// Not a number where one must stand.
    #[error("line {line}, column {column}: \"{text}\" is not {wanted}")]
    Value {
        /// Line in the file, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// As written.
        text: String,
        /// What belongs there.
        wanted: &'static str,
    },
    /// A line is missing or twice there.
    #[error("line {line}: item {wanted} expected, found item {found}")]
    Sequence {
        /// Line in the file, from 1.
        line: usize,
        /// The number that follows.
        wanted: usize,
        /// The number that stands there.
        found: usize,
    },
    /// Nothing but a header.
    #[error("the file has no home: line 0 of the mission is missing")]
    NoHome,
}

/// Reads a `.waypoints` file.
///
/// # Errors
/// Another header, a wrong number of columns, something that is no number, a gap in the sequence; each with its line.
pub fn read(text: &str) -> Result<Mission, WaypointsError> {
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    let header = lines.next().map_or("", |(_, l)| l.trim());
    if header.split_whitespace().collect::<Vec<_>>().join(" ") != HEADER {
        return Err(WaypointsError::Header(header.chars().take(40).collect()));
    }
    let mut items = Vec::new();
    for (index, line) in lines {
        let line_number = index + 1;
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        items.push(read_line(line, line_number, items.len())?);
    }
    let Some(home) = items.first() else { return Err(WaypointsError::NoHome) };
    let known = (home.x, home.y) != (0, 0);
    let home = known.then_some(Home { lat_e7: home.x, lon_e7: home.y, alt_m: home.z });
    Ok(Mission { home, items: items.split_off(1) })
}

struct Columns<'a> {
    line: usize,
    cells: [&'a str; COLUMNS],
}

impl Columns<'_> {
    fn get<T: std::str::FromStr>(&self, column: usize, wanted: &'static str) -> Result<T, WaypointsError> {
        let text = self.cells[column];
        text.parse().map_err(|_| WaypointsError::Value {
            line: self.line,
            column: column + 1,
            text: text.to_owned(),
            wanted,
        })
    }

    fn bad<T>(&self, column: usize, wanted: &'static str) -> Result<T, WaypointsError> {
        let text = self.cells[column].to_owned();
        Err(WaypointsError::Value { line: self.line, column: column + 1, text, wanted })
    }
}

fn read_line(text: &str, line: usize, wanted: usize) -> Result<MissionItem, WaypointsError> {
    let cells: Vec<&str> = text.split_whitespace().collect();
    let cells = <[&str; COLUMNS]>::try_from(cells)
        .map_err(|cells| WaypointsError::Columns { line, found: cells.len() })?;
    let columns = Columns { line, cells };
    let found: usize = columns.get(0, "an item number")?;
    if found != wanted {
        return Err(WaypointsError::Sequence { line, wanted, found });
    }
    let _current: u8 = columns.get(1, "0 or 1")?;
    let frame = Frame(columns.get(2, "a frame number")?);
    let command: u16 = columns.get(3, "a command number")?;
    let mut params = [0.0_f32; 4];
    for (k, p) in params.iter_mut().enumerate() {
        *p = columns.get(4 + k, "a number")?;
        // Numbers beyond single precision come out infinite.
        if p.is_infinite() {
            return columns.bad(4 + k, "a number that an item can hold");
        }
    }
    let (x, y): (f64, f64) = (columns.get(8, "a latitude")?, columns.get(9, "a longitude")?);
    let (x, y) = if frame.is_global() && crate::item::command::has_position(command) {
        let place = LatLon { lat_deg: x, lon_deg: y };
        if !place.is_valid() {
            return columns.bad(if x.abs() <= 90.0 { 9 } else { 8 }, "a latitude or longitude in degrees");
        }
        place.to_e7()
    } else if x.abs().max(y.abs()) * if frame.is_global() { 1e7 } else { 1.0 } > f64::from(i32::MAX) {
        return columns.bad(if x.abs() > y.abs() { 8 } else { 9 }, "a number that an item can hold");
    } else if frame.is_global() {
        ((x * 1e7).round() as i32, (y * 1e7).round() as i32)
    } else {
        (x.round() as i32, y.round() as i32)
    };
    let z: f32 = columns.get(10, "an altitude")?;
    if z.abs() > HIGHEST_M {
        return columns.bad(10, "an altitude in m");
    }
    let autocontinue: u8 = columns.get(11, "0 or 1")?;
    // Mission Planner writes frame 3 everywhere; PX4 takes a command without a place in the frame of commands alone.
    let placeless =
        !crate::item::command::has_position(command) && !crate::item::command::has_altitude(command);
    let frame = if placeless && frame.is_global() && (x, y) == (0, 0) { Frame::MISSION } else { frame };
    Ok(MissionItem { command, frame, autocontinue: autocontinue != 0, params, x, y, z })
}

/// Writes a `.waypoints` file; a mission without home gets zeros there.
pub fn write(mission: &Mission) -> String {
    let mut out = format!("{HEADER}\n");
    let home = mission.home_first();
    for (seq, item) in home.iter().enumerate() {
        let current = u8::from(seq == 0);
        let [p1, p2, p3, p4] = item.params;
        // Writing to a string cannot fail.
        let frame = item.frame.in_files().0;
        let _ = write!(out, "{seq}\t{current}\t{frame}\t{}\t{p1}\t{p2}\t{p3}\t{p4}\t", item.command);
        let _ = if item.frame.is_global() {
            write!(out, "{:.7}\t{:.7}", f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7)
        } else {
            write!(out, "{}\t{}", item.x, item.y)
        };
        let _ = writeln!(out, "\t{}\t{}", item.z, u8::from(item.autocontinue));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::item::command;

    /// As Mission Planner writes it: tabs, eight decimals, CR LF.
    const MISSION_PLANNER: &str = "QGC WPL 110\r\n\
        0\t1\t0\t16\t0\t0\t0\t0\t-35.3632610\t149.1652300\t584.090000\t1\r\n\
        1\t0\t3\t22\t15.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t50.000000\t1\r\n\
        2\t0\t0\t178\t0.00000000\t22.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.000000\t1\r\n\
        3\t0\t3\t18\t2.00000000\t0.00000000\t-120.00000000\t1.00000000\t-35.35922750\t149.16119670\t100.000000\t1\r\n\
        4\t0\t3\t20\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.000000\t1\r\n";

    #[test]
    fn reads_what_mission_planner_writes() {
        let mission = read(MISSION_PLANNER).expect("published format");
        assert_eq!(mission.home.map(|h| (h.lat_e7, h.alt_m)), Some((-353_632_610, 584.09)));
        let commands: Vec<u16> = mission.items.iter().map(|i| i.command).collect();
        assert_eq!(commands, [22, 178, 18, 20]);
        assert_eq!((mission.items[2].params[2], mission.items[2].y), (-120.0, 1_491_611_967));
        assert_eq!(mission.items[0].place(), None, "zero is where the vehicle is");
    }

    #[test]
    fn writes_twelve_tab_separated_columns() {
        let text = write(&read(MISSION_PLANNER).expect("published format"));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "QGC WPL 110");
        assert!(lines[1..].iter().all(|l| l.split('\t').count() == 12));
        assert_eq!(lines[4], "3\t0\t3\t18\t2\t0\t-120\t1\t-35.3592275\t149.1611967\t100\t1");
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        let cases = [
            ("QGC WPL 120\n", "line 1"),
            ("", "line 1"),
            ("QGC WPL 110\n", "no home"),
            ("QGC WPL 110\n0\t1\t0\t16\n", "line 2: 12 columns expected, found 4"),
            ("QGC WPL 110\n\n1 1 0 16 0 0 0 0 47 8 500 1\n", "line 3: item 0 expected, found item 1"),
            ("QGC WPL 110\n0 1 0 16 0 0 0 0 47,3 8 500 1\n", "line 2, column 9: \"47,3\" is not a latitude"),
            ("QGC WPL 110\n0 1 0 16 0 0 0 0 97 8 500 1\n", "line 2, column 9"),
        ];
        for (text, message) in cases {
            let error = read(text).expect_err(message).to_string();
            assert!(error.contains(message), "{error}");
        }
        assert_eq!(command::describe(18), "loiter turns");
    }
}
