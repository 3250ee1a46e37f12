//! Parameter files: ArduPilot's `NAME,VALUE` lines (`.param`, Mission Planner and MAVProxy) and QGroundControl's tab-separated columns
//! vehicle id, component id, name, value, `MAV_PARAM_TYPE` (`.params`). A line that begins with `#` is a comment in both.

use super::{NameError, ParamName, ParamType};
use crate::identity::{Identity, Uid};
use crate::item::Autopilot;
use std::fmt::Write;

/// More lines than any autopilot has parameters, by far.
const MOST_LINES: usize = 20_000;

/// A parameter with the value that a file gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FileEntry {
    /// Parameter.
    pub name: ParamName,
    /// Value, in the unit of the autopilot.
    pub value: f64,
    /// Type, where the file names one.
    pub kind: Option<ParamType>,
}

/// A line of a file that is written.
#[derive(Debug, Clone, PartialEq)]
pub enum FileLine {
    /// Words for people.
    Comment(String),
    /// A parameter.
    Entry(FileEntry),
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParamFile {
    /// Parameters in the order of the file, none twice.
    pub entries: Vec<FileEntry>,
    /// Whom the file is for, where it says so (see [`vehicle_line`]).
    pub autopilot: Option<Autopilot>,
    /// System id of the vehicle that the file was written from (QGroundControl's form).
    pub system_id: Option<u8>,
    /// Whether the file is for a fixed wing, where it says so.
    pub fixed_wing: Option<bool>,
    /// Hardware id of the vehicle that the file was written from, where it names one.
    pub uid: Option<Uid>,
    /// From which logs its values come and what came of them, where it says so (see [`origin_line`]).
    pub origin: Vec<String>,
}

/// Why a file is no parameter file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParamFileError {
    /// Neither form.
    #[error("line {line}: \"{text}\" is neither NAME,VALUE nor QGroundControl's five columns")]
    Form {
        /// Line, from 1.
        line: usize,
        /// What it holds, shortened.
        text: String,
    },
    /// A name.
    #[error("line {line}: {source}")]
    Name {
        /// Line, from 1.
        line: usize,
        /// Why.
        source: NameError,
    },
    /// A value.
    #[error("line {line}: the value of {name} is not a finite number")]
    Value {
        /// Line, from 1.
        line: usize,
        /// Parameter.
        name: ParamName,
    },
    /// A type.
    #[error("line {line}: type {number} of {name} is no MAV_PARAM_TYPE of four bytes")]
    Type {
        /// Line, from 1.
        line: usize,
        /// Parameter.
        name: ParamName,
        /// As written.
        number: String,
    },
    /// Which of the two counts?
    #[error("line {line}: {name} occurs twice")]
    Twice {
        /// Line of the second one, from 1.
        line: usize,
        /// Parameter.
        name: ParamName,
    },
    /// Several vehicles in one file.
    #[error(
        "line {line}: parameters of a second vehicle or component; name one vehicle's autopilot in a file"
    )]
    SeveralVehicles {
        /// Line, from 1.
        line: usize,
    },
    /// Not a file of parameters.
    #[error("more than {MOST_LINES} lines: this is no parameter file")]
    TooLong,
    /// Only comments.
    #[error("the file names no parameter")]
    Empty,
}

impl ParamFile {
    /// Reads a file in either form.
    ///
    /// # Errors
    /// A line that is neither a comment nor a parameter, a parameter twice, parameters of several vehicles, or none at all.
    pub fn read(text: &str) -> Result<Self, ParamFileError> {
        let mut file = Self::default();
        for (k, raw) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            if k >= MOST_LINES {
                return Err(ParamFileError::TooLong);
            }
            let words = raw.trim();
            if let Some(vehicle) = words.strip_prefix(VEHICLE) {
                file.vehicle(vehicle);
            }
            if let Some(origin) = words.strip_prefix(ORIGIN).filter(|_| file.origin.len() < MOST_ORIGINS) {
                file.origin.push(origin.trim().chars().take(MOST_CHARS).collect());
            }
            if words.is_empty() || words.starts_with('#') {
                continue;
            }
            let entry = file.entry(k + 1, words)?;
            if file.entries.iter().any(|e| e.name == entry.name) {
                return Err(ParamFileError::Twice { line: k + 1, name: entry.name });
            }
            file.entries.push(entry);
        }
        if file.entries.is_empty() { Err(ParamFileError::Empty) } else { Ok(file) }
    }

    fn vehicle(&mut self, words: &str) {
        for word in words.split_whitespace() {
            match word {
                "ArduPilot" => self.autopilot = Some(Autopilot::ArduPilot),
                "PX4" => self.autopilot = Some(Autopilot::Px4),
                "fixed_wing" => self.fixed_wing = Some(true),
                "multirotor" => self.fixed_wing = Some(false),
                word => self.uid = word.strip_prefix(UID).and_then(|u| u.parse().ok()).or(self.uid),
            }
        }
    }

    fn entry(&mut self, line: usize, words: &str) -> Result<FileEntry, ParamFileError> {
        let form = || ParamFileError::Form { line, text: words.chars().take(40).collect() };
        let columns: Vec<&str> = words.split(['\t', ',', ' ']).filter(|w| !w.is_empty()).collect();
        let (name, value, kind) = match columns.as_slice() {
            [name, value] => (*name, *value, None),
            [system, component, name, value, kind] => {
                let id = |text: &str| text.parse::<u8>().map_err(|_| form());
                let (system, component) = (id(system)?, id(component)?);
                if *self.system_id.get_or_insert(system) != system || component != AUTOPILOT {
                    return Err(ParamFileError::SeveralVehicles { line });
                }
                (*name, *value, Some(*kind))
            }
            _ => return Err(form()),
        };
        let name: ParamName = name.parse().map_err(|source| ParamFileError::Name { line, source })?;
        let value = value.parse::<f64>().ok().filter(|v| v.is_finite() && (*v as f32).is_finite());
        let value = value.ok_or(ParamFileError::Value { line, name })?;
        let typed = |number: &str| {
            let kind = number.parse().ok().and_then(ParamType::from_number);
            kind.ok_or_else(|| ParamFileError::Type { line, name, number: number.chars().take(8).collect() })
        };
        Ok(FileEntry { name, value, kind: kind.map(typed).transpose()? })
    }

    /// The value of a parameter.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.entries.iter().find(|e| e.name.as_str() == name).map(|e| e.value)
    }
}

/// Begin of the comment that says which vehicle a file is for.
const VEHICLE: &str = "# for vehicle:";

/// The comment that says which vehicle a file is for: autopilot, kind and hardware id.
pub fn vehicle_line(autopilot: Autopilot, fixed_wing: Option<bool>, uid: Option<Uid>) -> FileLine {
    let kind = fixed_wing.map_or("", |fixed| if fixed { " fixed_wing" } else { " multirotor" });
    let uid = uid.map_or_else(String::new, |uid| format!(" {UID}{uid}"));
    FileLine::Comment(format!("{} {autopilot}{kind}{uid}", VEHICLE.trim_start_matches("# ")))
}

/// Begin of the comments that say where the values come from, how many of them are kept, and how much of each, characters.
const ORIGIN: &str = "# from:";
const MOST_ORIGINS: usize = 8;
const MOST_CHARS: usize = 400;

/// A comment that says where the values come from.
pub fn origin_line(words: &str) -> FileLine {
    FileLine::Comment(format!("{} {words}", ORIGIN.trim_start_matches("# ")))
}

/// The hardware id in the line that says whom a file is for.
const UID: &str = "uid=";

/// The same of a vehicle on the link.
pub fn backup_line(vehicle: &Identity, fixed_wing: Option<bool>) -> FileLine {
    vehicle_line(vehicle.autopilot, fixed_wing, vehicle.uid)
}

/// `MAV_COMP_ID_AUTOPILOT1`: whose parameters are written.
const AUTOPILOT: u8 = 1;

/// The extension of the form that an autopilot's ground stations read.
pub fn extension(autopilot: Autopilot) -> &'static str {
    match autopilot {
        Autopilot::ArduPilot => "param",
        Autopilot::Px4 => "params",
    }
}

/// Writes the form of an autopilot's ground stations. Comments stay comments whatever they hold.
pub fn write(autopilot: Autopilot, system_id: u8, lines: &[FileLine]) -> String {
    let mut text = String::new();
    if autopilot == Autopilot::Px4 {
        text.push_str(
            "# Onboard parameters for QGroundControl\n#\n# Vehicle-Id Component-Id Name Value Type\n",
        );
    }
    for line in lines {
        let _ = match line {
            FileLine::Comment(words) => {
                let words: String = words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
                writeln!(text, "# {words}")
            }
            FileLine::Entry(FileEntry { name, value, kind }) => match autopilot {
                Autopilot::ArduPilot => writeln!(text, "{name},{}", digits(*value)),
                Autopilot::Px4 => {
                    let kind = kind.unwrap_or(ParamType::Real32).number();
                    writeln!(text, "{system_id}\t{AUTOPILOT}\t{name}\t{}\t{kind}", digits(*value))
                }
            },
        };
    }
    text
}

/// Whole numbers in full; otherwise the shortest text that reads as the same single-precision value where the value is one, and as the same
/// value where it is none.
fn digits(value: f64) -> String {
    let single = value as f32;
    if value.fract() != 0.0 && f64::from(single) == value { format!("{single}") } else { format!("{value}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn entry(name: &str, value: f64, kind: ParamType) -> FileLine {
        FileLine::Entry(FileEntry { name: name.parse().expect("a name"), value, kind: Some(kind) })
    }

    #[test]
    fn both_forms_are_read() {
        let ardupilot =
            ParamFile::read("\u{feff}# advice\nGPS1_DELAY_MS,333\r\nGPS1_POS_X 1.18\n\n").unwrap();
        assert_eq!((ardupilot.get("GPS1_DELAY_MS"), ardupilot.get("GPS1_POS_X")), (Some(333.0), Some(1.18)));
        let px4 = ParamFile::read("# Vehicle-Id\n1\t1\tEKF2_GPS_DELAY\t96.5\t9\n").unwrap();
        assert_eq!((px4.system_id, px4.entries[0].kind), (Some(1), Some(ParamType::Real32)));
    }

    #[test]
    fn what_is_no_parameter_file_is_refused_with_the_line() {
        for (text, said) in [
            ("A,1\nhello\n", "line 2: \"hello\" is neither"),
            ("A,nan\n", "line 1: the value of A"),
            ("A,1e999\n", "line 1: the value of A"),
            ("A,1\nA,2\n", "line 2: A occurs twice"),
            ("MUCH_TOO_LONG_A_NAME,1\n", "is no name of a parameter"),
            ("1\t1\tA\t1\t77\n", "type 77 of A"),
            ("1\t1\tA\t1\t9\n2\t1\tB\t1\t9\n", "line 2: parameters of a second vehicle"),
            ("# nothing\n", "names no parameter"),
        ] {
            let error = ParamFile::read(text).expect_err(text).to_string();
            assert!(error.contains(said), "{text:?}: {error}");
        }
        assert_eq!(ParamFile::read(&"#\n".repeat(30_000)), Err(ParamFileError::TooLong));
    }

    #[test]
    fn a_file_says_which_vehicle_it_is_for() {
        for (autopilot, fixed_wing) in
            [(Autopilot::ArduPilot, Some(true)), (Autopilot::Px4, Some(false)), (Autopilot::Px4, None)]
        {
            let lines = [vehicle_line(autopilot, fixed_wing, None), entry("A", 1.0, ParamType::Real32)];
            let file = ParamFile::read(&write(autopilot, 1, &lines)).unwrap();
            assert_eq!((file.autopilot, file.fixed_wing), (Some(autopilot), fixed_wing));
        }
    }

    #[test]
    fn a_comment_cannot_become_a_parameter() {
        let lines = [FileLine::Comment("from a\nA,1".to_owned()), entry("B", 2.0, ParamType::I32)];
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            let file = ParamFile::read(&write(autopilot, 1, &lines)).unwrap();
            assert_eq!(file.entries.len(), 1, "{file:?}");
        }
    }

    proptest! {
        #[test]
        fn every_value_survives_a_file(value in -1e9_f32..1e9, whole: i32) {
            let lines = [
                entry("EKF2_GPS_POS_X", f64::from(value), ParamType::Real32),
                entry("SYS_AUTOSTART", f64::from(whole), ParamType::I32),
            ];
            for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
                let file = ParamFile::read(&write(autopilot, 7, &lines)).unwrap();
                prop_assert_eq!(file.get("EKF2_GPS_POS_X").map(|v| v as f32), Some(value));
                prop_assert_eq!(file.get("SYS_AUTOSTART"), Some(f64::from(whole)));
            }
        }

        #[test]
        fn no_text_makes_it_panic(text in "\\PC{0,200}") {
            let _ = ParamFile::read(&text);
        }
    }
}
