//! Which logs a fleet has, and what their names say.

use super::FleetError;
use super::log::Named;
use crate::logs::dataflash::text;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Endings of logs, in lower case.
const ENDINGS: [&str; 4] = ["tlog", "bin", "ulg", "mcap"];

/// All logs of files, folders (with what is below them) and patterns, each once, in the order of their names.
///
/// # Errors
/// A pattern that is none, a folder that cannot be read, or no log where one was named.
pub fn logs(places: &[String]) -> Result<Vec<PathBuf>, FleetError> {
    let mut found = Vec::new();
    for place in places {
        let path = Path::new(place);
        let before = found.len();
        if path.is_dir() {
            below(path, &mut found)?;
        } else if path.exists() {
            found.push(path.to_owned());
        } else {
            matching(place, &mut found)?;
        }
        if found.len() == before {
            return Err(FleetError::NoLog(place.clone()));
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// A folder with a table is a log itself.
fn below(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), FleetError> {
    if folder.join("imu.csv").is_file() {
        found.push(folder.to_owned());
        return Ok(());
    }
    let wrong = |source| FleetError::Read { path: folder.to_owned(), source };
    for entry in std::fs::read_dir(folder).map_err(wrong)? {
        let entry = entry.map_err(wrong)?;
        let kind = entry.file_type().map_err(wrong)?;
        let path = entry.path();
        // A link to a folder may lead back up.
        if kind.is_dir() {
            below(&path, found)?;
        } else if is_log(&path) && path.is_file() {
            found.push(path);
        }
    }
    Ok(())
}

fn matching(pattern: &str, found: &mut Vec<PathBuf>) -> Result<(), FleetError> {
    let paths = glob::glob(pattern)
        .map_err(|e| FleetError::Pattern { pattern: pattern.to_owned(), reason: e.msg.to_owned() })?;
    for path in paths {
        let path = path.map_err(|e| FleetError::Read { path: e.path().to_owned(), source: e.into() })?;
        if path.is_dir() {
            below(&path, found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

fn is_log(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    // Other programs write their diary under the same ending.
    ending.is_some_and(|e| ENDINGS.contains(&e.as_str()) || e == "log" && is_text_of_dataflash(path))
}

fn is_text_of_dataflash(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(text::HEAD as u64).read_to_end(&mut head));
    read.is_ok() && text::is_one(&head)
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Literal(String),
    Any,
    Unit,
    Firmware,
}

/// A rule such as `{unit}/{firmware}_*.bin` for the end of a path; what stands between literals is the value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameRule(Vec<Part>);

impl NameRule {
    /// Reads a rule.
    ///
    /// # Errors
    /// Without `{unit}`, or with two open parts side by side.
    pub fn new(rule: &str) -> Result<Self, FleetError> {
        let mut parts: Vec<Part> = Vec::new();
        let with_slashes = with_slashes(rule);
        let mut rest = with_slashes.as_str();
        while let Some(c) = rest.chars().next() {
            let open = [("{unit}", Part::Unit), ("{firmware}", Part::Firmware), ("*", Part::Any)];
            if let Some((text, part)) = open.into_iter().find(|(text, _)| rest.starts_with(text)) {
                if parts.last().is_some_and(|p| !matches!(p, Part::Literal(_))) {
                    return Err(FleetError::Rule(rule.to_owned()));
                }
                parts.push(part);
                rest = rest.get(text.len()..).unwrap_or_default();
                continue;
            }
            match parts.last_mut() {
                Some(Part::Literal(text)) => text.push(c),
                _ => parts.push(Part::Literal(c.to_string())),
            }
            rest = rest.get(c.len_utf8()..).unwrap_or_default();
        }
        if parts.iter().filter(|p| **p == Part::Unit).count() != 1 {
            return Err(FleetError::Rule(rule.to_owned()));
        }
        Ok(Self(parts))
    }

    /// What this rule reads from a path; nothing where the path does not follow it. Values hold no `/`.
    pub fn read(&self, path: &Path) -> Named {
        let text = with_slashes(&path.to_string_lossy());
        let levels = self.0.iter().map(|p| match p {
            Part::Literal(text) => text.matches('/').count(),
            _ => 0,
        });
        // As many names from the end as the rule has.
        let wanted = levels.sum::<usize>() + 1;
        let start = text.rmatch_indices('/').nth(wanted - 1).map_or(0, |(at, _)| at + 1);
        let mut named = Named::default();
        if read_parts(&self.0, text.get(start..).unwrap_or_default(), &mut named) {
            named
        } else {
            Named::default()
        }
    }
}

/// The names of a path apart by `/`, whatever the system writes.
fn with_slashes(path: &str) -> String {
    path.replace(std::path::MAIN_SEPARATOR, "/")
}

/// Open parts take as little as lets the rest follow.
fn read_parts(parts: &[Part], text: &str, named: &mut Named) -> bool {
    let Some((part, rest)) = parts.split_first() else { return text.is_empty() };
    if let Part::Literal(literal) = part {
        return text.strip_prefix(literal.as_str()).is_some_and(|text| read_parts(rest, text, named));
    }
    let ends = text.char_indices().map(|(at, _)| at).chain([text.len()]);
    for end in ends {
        let (value, after) = text.split_at(end);
        if value.contains('/') {
            return false;
        }
        if (value.is_empty() && *part != Part::Any) || !read_parts(rest, after, named) {
            continue;
        }
        match part {
            Part::Unit => named.unit = Some(value.to_owned()),
            Part::Firmware => named.firmware = Some(value.to_owned()),
            _ => {}
        }
        return true;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(rule: &str, path: &str) -> (Option<String>, Option<String>) {
        let named = NameRule::new(rule).unwrap().read(Path::new(path));
        (named.unit, named.firmware)
    }

    #[test]
    fn a_rule_reads_unit_and_firmware_from_the_end_of_a_path() {
        let some = |s: &str| Some(s.to_owned());
        assert_eq!(read("{unit}/*", "/logs/imu7/flight 3.bin"), (some("imu7"), None));
        assert_eq!(read("{unit}_{firmware}_*.tlog", "a/u1_4.6_001.tlog"), (some("u1"), some("4.6")));
        assert_eq!(read("{unit}_{firmware}_*.tlog", "a/u1-4.6.tlog"), (None, None));
        assert_eq!(read("{firmware}/{unit}/*.ulg", "x/v1.15/b/c.ulg"), (some("b"), some("v1.15")));
    }

    #[test]
    fn paths_and_rules_are_read_as_the_system_writes_them() {
        let written = |parts: &[&str]| parts.join(std::path::MAIN_SEPARATOR_STR);
        let path = written(&["flights", "imu7", "4.6_1.bin"]);
        for rule in ["{unit}/{firmware}_*.bin".to_owned(), written(&["{unit}", "{firmware}_*.bin"])] {
            assert_eq!(read(&rule, &path), (Some("imu7".to_owned()), Some("4.6".to_owned())), "{rule}");
        }
    }

    #[test]
    fn a_rule_without_a_unit_is_none() {
        for rule in ["*.tlog", "{unit}{firmware}", "", "{unit}*"] {
            assert!(NameRule::new(rule).is_err(), "{rule}");
        }
    }

    #[test]
    fn folders_and_patterns_give_each_log_once_and_no_other_file() {
        let folder = std::env::temp_dir().join(format!("gaware-find-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("a/table")).unwrap();
        for name in ["a/1.tlog", "a/2.BIN", "a/notes.txt", "a/diary.log", "a/table/imu.csv", "b.ulg"] {
            std::fs::write(folder.join(name), "x").unwrap();
        }
        std::fs::write(folder.join("a/3.log"), "ArduCopter V3.1\nFMT, 128, 89, FMT, BBnNZ, Type\n").unwrap();
        let text = |name: &str| folder.join(name).to_str().unwrap().to_owned();
        let found = logs(&[text(""), text("a/*.tlog"), text("b.ulg")]).unwrap();
        let names: Vec<_> =
            found.iter().map(|p| p.strip_prefix(&folder).unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a/1.tlog", "a/2.BIN", "a/3.log", "a/table", "b.ulg"]);
        assert!(logs(&[text("*.none")]).unwrap_err().to_string().contains("no log at"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
