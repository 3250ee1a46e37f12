//! The journal of a change of a vehicle: what was on it before and what was to replace it, on disk before the first message that changes
//! anything.
//!
//! It is removed when one of the two has been read back whole. If the program dies in between, or the link never comes back,
//! `gaware mission restore` or `gaware params restore` finds it and knows what to put back, and into which vehicle.

use super::files::{self, FileError};
use super::vehicle::identity_words;
use gaware_mission::compare::differences;
use gaware_mission::fence::Fence;
use gaware_mission::files::plan::{self, PlanFile};
use gaware_mission::identity::{Identity, Sameness};
use gaware_mission::item::{Autopilot, Mission};
use gaware_mission::params::apply::Pair;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// End of the name of every journal.
const END: &str = ".journal";

/// Why no journal can be taken up.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// There is nothing to take up.
    #[error("there is no journal of an interrupted {} in {folder}; name the backup that is to be put back", kind.noun(), folder = folder.display())]
    None {
        /// What of.
        kind: Kind,
        /// Where.
        folder: PathBuf,
    },
    /// Too many.
    #[error("several {}s were interrupted here; name one of {names}", kind.noun())]
    Several {
        /// What of.
        kind: Kind,
        /// Which.
        names: String,
    },
    /// A journal of the other kind.
    #[error("{path} is the journal of {}: use \"gaware {} restore\"", kind.whole(), kind.command(), path = path.display())]
    OtherKind {
        /// The journal.
        path: PathBuf,
        /// What it is of.
        kind: Kind,
    },
}

/// What a journal is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A mission, and the fence that goes with it.
    Mission,
    /// Parameters.
    Parameters,
}

impl Kind {
    /// What differs between the two.
    fn either<T>(self, mission: T, parameters: T) -> T {
        match self {
            Self::Mission => mission,
            Self::Parameters => parameters,
        }
    }

    /// Begin of the names of the files; the system id and the hardware id follow.
    fn prefix(self) -> &'static str {
        self.either("mission-transfer-system", "parameter-change-system")
    }

    fn schema(self) -> &'static str {
        self.either("gaware.transfer/1", "gaware.parameter-change/1")
    }

    /// The command that takes it up.
    pub fn command(self) -> &'static str {
        self.either("mission", "params")
    }

    /// Parameters for a mission, and the reverse.
    pub fn other(self) -> Self {
        self.either(Self::Parameters, Self::Mission)
    }

    /// What is interrupted.
    fn noun(self) -> &'static str {
        self.either("upload", "change")
    }

    fn whole(self) -> &'static str {
        self.either("an interrupted upload", "a change of parameters")
    }

    fn words(self) -> &'static str {
        self.either("transfer of a mission", "change of parameters")
    }

    /// Whether a file has the name of such a journal.
    pub fn names(self, path: &Path) -> bool {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        name.starts_with(self.prefix()) && name.ends_with(END)
    }

    /// Those in a folder.
    pub fn list(self, folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut found: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| self.names(p)).collect();
        found.sort();
        found
    }

    /// The only one in a folder.
    ///
    /// # Errors
    /// There is none, or there are several.
    pub fn the_only(self, folder: &Path) -> Result<PathBuf, JournalError> {
        match self.list(folder).as_slice() {
            [one] => Ok(one.clone()),
            [] => {
                let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
                Err(JournalError::None { kind: self, folder })
            }
            many => {
                let names: Vec<String> = many.iter().map(|p| p.display().to_string()).collect();
                Err(JournalError::Several { kind: self, names: names.join(", ") })
            }
        }
    }

    /// Where the journal of a change of this vehicle lies.
    pub fn path(self, folder: &Path, vehicle: &Identity) -> PathBuf {
        let uid = vehicle.uid.map_or_else(String::new, |uid| format!("-{uid}"));
        folder.join(format!("{}{}{uid}{END}", self.prefix(), vehicle.system_id))
    }

    /// Whether a change of this vehicle may begin.
    ///
    /// # Errors
    /// Another one is under way or was interrupted.
    pub fn check(self, folder: &Path, vehicle: &Identity) -> Result<(), FileError> {
        let begun = self.list(folder).into_iter().find_map(|path| {
            let whose = match Journal::read(&path) {
                Ok(journal) => match journal.vehicle.is(vehicle) {
                    Sameness::Other => return None,
                    Sameness::Same => format!("to this vehicle, {}", identity_words(vehicle)),
                    Sameness::Unproven => format!(
                        "to {}, which may be this vehicle (one of them gives no hardware id),",
                        identity_words(&journal.vehicle)
                    ),
                },
                // One that cannot be read may be about any vehicle of its system id.
                Err(_) if path == self.path(folder, &Identity { uid: None, ..*vehicle }) => {
                    format!("to system {}", vehicle.system_id)
                }
                Err(_) if path == self.path(folder, vehicle) => "to this vehicle".to_owned(),
                Err(_) => return None,
            };
            Some((path, whose))
        });
        match begun {
            None => Ok(()),
            Some((path, whose)) => {
                let what = format!("{} {whose}", self.words());
                Err(FileError::Interrupted { path, what, command: self.command() })
            }
        }
    }
}

/// Before and after.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// A mission.
    Mission {
        /// On the vehicle before.
        previous: Mission,
        /// To be on it afterwards.
        new: Mission,
        /// The geofence before and the one that goes along with the new mission, where one does.
        fences: Option<(Fence, Fence)>,
    },
    /// Old and new values.
    Parameters(Vec<Pair>),
}

impl Content {
    fn kind(&self) -> Kind {
        match self {
            Self::Mission { .. } => Kind::Mission,
            Self::Parameters(_) => Kind::Parameters,
        }
    }

    /// Whether a vehicle stores both alike.
    fn same(&self, other: &Self, autopilot: Autopilot) -> bool {
        let same = |a: &Mission, b: &Mission| differences(autopilot, a, b).is_empty();
        let alike = |a: &Fence, b: &Fence| same(&list(a), &list(b));
        match (self, other) {
            (
                Self::Mission { previous: a, new: b, fences: f },
                Self::Mission { previous: c, new: d, fences: g },
            ) => {
                let fences = match (f, g) {
                    (None, None) => true,
                    (Some((a, b)), Some((c, d))) => alike(a, c) && alike(b, d),
                    _ => false,
                };
                same(a, c) && same(b, d) && fences
            }
            (Self::Parameters(a), Self::Parameters(b)) => a == b,
            _ => false,
        }
    }
}

/// A fence as a list of the vehicle.
pub fn list(fence: &Fence) -> Mission {
    Mission { home: None, items: fence.items() }
}

/// A change that has begun.
#[derive(Debug, Clone, PartialEq)]
pub struct Journal {
    /// The file.
    pub path: PathBuf,
    /// The vehicle; journals of earlier versions have no hardware id.
    pub vehicle: Identity,
    /// When it began, s since 1970; 0 where the clock was not set or the journal does not say.
    pub begun_unix_s: u64,
    /// Before and after.
    pub content: Content,
}

/// As written. Missions are whole `.plan` documents, so that a ground station can open them in need.
#[derive(Debug, Serialize, Deserialize)]
struct Document {
    schema: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    vehicle: Option<Identity>,
    system_id: u8,
    autopilot: Autopilot,
    #[serde(default)]
    begun_unix_s: u64,
    /// Whether the geofences in the two documents count.
    #[serde(default)]
    with_fence: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    previous: Option<Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    new: Option<Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    parameters: Option<Vec<Pair>>,
}

impl Journal {
    /// Writes the journal of a change that is about to begin, down to the disk.
    ///
    /// # Errors
    /// There is one already: another change of this vehicle is under way or was interrupted. Or the disk refuses.
    pub fn begin(folder: &Path, vehicle: Identity, content: Content) -> Result<Self, FileError> {
        let kind = content.kind();
        kind.check(folder, &vehicle)?;
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let journal =
            Self { path: kind.path(folder, &vehicle), vehicle, begun_unix_s: since.as_secs(), content };
        let wrong = |reason: String| FileError::Content { path: journal.path.clone(), reason };
        let text = serde_json::to_string_pretty(&journal.document()).map_err(|e| wrong(e.to_string()))?;
        files::write_new(&journal.path, &text)?;
        // What cannot be read again could not be put back.
        let reason = match Self::read(&journal.path) {
            Ok(read) if read.content.same(&journal.content, vehicle.autopilot) => return Ok(journal),
            Ok(_) => "it reads otherwise than written".to_owned(),
            Err(error) => error.to_string(),
        };
        let path = journal.path.clone();
        journal.end()?;
        Err(FileError::Content { path, reason })
    }

    fn document(&self) -> Document {
        let Identity { system_id, autopilot, mav_type, .. } = self.vehicle;
        let mut document = Document {
            schema: self.content.kind().schema().to_owned(),
            vehicle: Some(self.vehicle),
            system_id,
            autopilot,
            begun_unix_s: self.begun_unix_s,
            with_fence: false,
            previous: None,
            new: None,
            parameters: None,
        };
        match &self.content {
            Content::Mission { previous, new, fences } => {
                let (before, after) = fences.clone().unwrap_or_default();
                let plan = |mission: &Mission, fence: Fence| {
                    Some(plan::document(&PlanFile::new(mission.clone(), fence, autopilot, mav_type)))
                };
                document.with_fence = fences.is_some();
                (document.previous, document.new) = (plan(previous, before), plan(new, after));
            }
            Content::Parameters(pairs) => document.parameters = Some(pairs.clone()),
        }
        document
    }

    /// Reads a journal of either kind.
    ///
    /// # Errors
    /// The file cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text =
            crate::inputs::text(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
        let wrong = |reason: String| FileError::Content { path: path.to_owned(), reason };
        let found: Document = serde_json::from_str(&text)
            .map_err(|e| wrong(format!("no journal of a change of a vehicle: {e}")))?;
        let known = [Kind::Mission, Kind::Parameters].map(Kind::schema);
        if !known.contains(&found.schema.as_str()) {
            return Err(wrong(format!(
                "schema is \"{}\", this program reads \"{}\"",
                found.schema,
                known.join("\" and \"")
            )));
        }
        let mut mav_type = 0;
        let content = match (found.previous, found.new, found.parameters) {
            (Some(previous), Some(new), None) => {
                let plan = |v: Value| plan::from_document(v).map_err(|e| wrong(e.to_string()));
                let (previous, new) = (plan(previous)?, plan(new)?);
                mav_type = previous.vehicle_type;
                let fences = found.with_fence.then_some((previous.fence, new.fence));
                Content::Mission { previous: previous.mission, new: new.mission, fences }
            }
            (None, None, Some(pairs)) => Content::Parameters(pairs),
            _ => return Err(wrong("it holds neither a mission before and after nor parameters".to_owned())),
        };
        let Document { system_id, autopilot, .. } = found;
        // Journals of earlier versions name no hardware.
        let vehicle = found.vehicle.unwrap_or(Identity {
            uid: None,
            autopilot,
            mav_type,
            system_id,
            component_id: 1,
            home: None,
        });
        Ok(Self { path: path.to_owned(), vehicle, begun_unix_s: found.begun_unix_s, content })
    }

    /// Whether it may be taken up with this vehicle: a warning where that is not proven.
    ///
    /// # Errors
    /// The sentence that says which vehicle is meant and which one is connected.
    pub fn check_vehicle(&self, connected: &Identity) -> Result<Option<String>, String> {
        let (meant, here) = (identity_words(&self.vehicle), identity_words(connected));
        let home =
            |v: &Identity| v.home.map_or_else(String::new, |[lat, lon]| format!(", home {lat:.5}, {lon:.5}"));
        match self.vehicle.is(connected) {
            Sameness::Same => Ok(None),
            Sameness::Other => Err(format!(
                "nothing was changed: {} is about {meant}{}; connected is another vehicle, {here}{}",
                self.path.display(),
                home(&self.vehicle),
                home(connected)
            )),
            Sameness::Unproven => Ok(Some(format!(
                "{} is about {meant}{}; connected is {here}{}: without a hardware id of both it is not certain that this is the same vehicle",
                self.path.display(),
                home(&self.vehicle),
                home(connected)
            ))),
        }
    }

    /// That it cannot be taken up as one of the other kind.
    pub fn is_of_other_kind(self) -> JournalError {
        JournalError::OtherKind { kind: self.content.kind(), path: self.path }
    }

    /// When it began, in words: " 5 minutes ago"; empty where that is not known.
    pub fn begun_words(&self) -> String {
        let since = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0, |now| now.as_secs().saturating_sub(self.begun_unix_s));
        match since / 60 {
            _ if self.begun_unix_s == 0 => String::new(),
            0..=1 => " just now".to_owned(),
            minutes @ 2..=120 => format!(" {minutes} minutes ago"),
            minutes => format!(" {} hours ago", minutes / 60),
        }
    }

    /// The rest of a sentence about a vehicle of which no one knows what is on it.
    pub fn left_words(&self) -> String {
        let (path, kind) = (self.path.display(), self.content.kind());
        let (both, previous) =
            kind.either(("Both missions", "the previous one"), ("Both sets", "the old one"));
        format!(
            ". {both} are in {path}: \"gaware {} restore\" puts {previous} back when the link is there again",
            kind.command()
        )
    }

    /// Ends the journal where it is known what is on the vehicle; the rest of the sentence about the outcome where it is not.
    pub fn settle(self, known: bool) -> String {
        if !known {
            return self.left_words();
        }
        self.end().err().map(|e| format!("; {e}: remove it by hand")).unwrap_or_default()
    }

    /// The change came to a good end.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn end(self) -> Result<(), FileError> {
        std::fs::remove_file(&self.path)
            .map_err(|source| FileError::Write { path: self.path.clone(), source })
    }
}

#[cfg(test)]
mod tests;
