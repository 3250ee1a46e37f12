//! Mission files by their kind: QGroundControl's `.plan` and `QGC WPL 110`.

use crate::outputs::{self, mark};
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::{Fence, FenceItemError};
use gaware_mission::files::plan::{self, PlanFile};
use gaware_mission::files::waypoints;
use gaware_mission::identity::Identity;
use gaware_mission::item::{
    AltitudeReference, Autopilot, LatLon, Mission, MissionItem, MissionKind, command,
};
use std::path::{Path, PathBuf};

/// Why a mission file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// Cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// File.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Cannot be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// File.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Wrong content.
    #[error("{path}: {reason}")]
    Content {
        /// File.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A transfer to this vehicle did not come to its end.
    #[error(
        "an earlier {what} was interrupted, or is under way in another process; its journal is {path}. Run \"gaware {command} restore \
         --connect … {path}\" first, or remove that file if you know what is on the vehicle", path = path.display()
    )]
    Interrupted {
        /// The journal.
        path: PathBuf,
        /// What was interrupted, and of which vehicle.
        what: String,
        /// `mission` or `params`.
        command: &'static str,
    },
    /// A list that no plan file can hold.
    #[error("{path}: {source}", path = path.display())]
    List {
        /// File.
        path: PathBuf,
        /// What it cannot hold.
        source: ListError,
    },
    /// A `.waypoints` file for a geofence or rally points.
    #[error("{path}: only a .plan file holds a {kind}", path = path.display())]
    NotAPlan {
        /// File.
        path: PathBuf,
        /// What it was to hold.
        kind: MissionKind,
    },
    /// Neither kind.
    #[error("{0}: name it .plan or .waypoints, the two kinds of mission files")]
    Kind(PathBuf),
}

/// Why a vehicle's list does not go into a plan file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ListError {
    /// A fence.
    #[error(transparent)]
    Fence(#[from] FenceItemError),
    /// A plan file has heights above home only: read from it, the point would be elsewhere.
    #[error("rally point {0} does not count its height from home, as plan files do")]
    Rally(usize),
}

/// What a mission file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Contents {
    /// Items and home.
    pub mission: Mission,
    /// Geofence.
    pub fence: Fence,
    /// Rally points: latitude, longitude (deg), altitude above home (m).
    pub rally_points: Vec<[f64; 3]>,
    /// Whom it was made for, where it says so.
    pub planned_for: Option<Autopilot>,
    /// `MAV_TYPE` of what it was made for, where it says so.
    pub mav_type: Option<u8>,
    /// The vehicle that it is a backup of, where it is one.
    pub backup_of: Option<Identity>,
    /// The airframe that it was planned for, where it says so.
    pub airframe: Option<Airframe>,
}

impl Contents {
    /// One of the three lists.
    pub fn list(&self, kind: MissionKind) -> Mission {
        let items = match kind {
            MissionKind::Mission => return self.mission.clone(),
            MissionKind::Fence => self.fence.items(),
            MissionKind::Rally => self.rally_points.iter().map(|p| rally_item(*p)).collect(),
        };
        Mission { home: None, items }
    }

    /// Puts one of the three lists in.
    ///
    /// # Errors
    /// A fence or rally points that a plan file cannot hold.
    pub fn put(&mut self, kind: MissionKind, list: Mission) -> Result<(), ListError> {
        match kind {
            MissionKind::Mission => self.mission = list,
            MissionKind::Fence => self.fence = Fence::from_items(&list.items)?,
            MissionKind::Rally => {
                let other = |i: &MissionItem| i.frame.altitude_reference() != AltitudeReference::Home;
                if let Some(k) = list.items.iter().position(other) {
                    return Err(ListError::Rally(k + 1));
                }
                self.rally_points = list.items.iter().map(rally_point).collect();
            }
        }
        Ok(())
    }
}

fn rally_item([lat_deg, lon_deg, alt_m]: [f64; 3]) -> MissionItem {
    MissionItem::at(command::NAV_RALLY_POINT, [0.0; 4], LatLon { lat_deg, lon_deg }, alt_m as f32)
}

fn rally_point(item: &MissionItem) -> [f64; 3] {
    let place = LatLon::from_e7(item.x, item.y);
    [place.lat_deg, place.lon_deg, f64::from(item.z)]
}

/// Reads a mission and the fence that came with it; the kind shows in the content.
///
/// # Errors
/// The file cannot be read or holds no mission.
pub fn read(path: &Path) -> Result<(Mission, Fence), FileError> {
    read_contents(path).map(|c| (c.mission, c.fence))
}

/// Reads everything that a mission file holds.
///
/// # Errors
/// As [`read`].
pub fn read_contents(path: &Path) -> Result<Contents, FileError> {
    let text =
        crate::inputs::text(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
    let wrong = |reason: String| FileError::Content { path: path.to_owned(), reason };
    if !text.trim_start().starts_with('{') {
        let mission = waypoints::read(&text).map_err(|e| wrong(e.to_string()))?;
        return Ok(Contents { mission, ..Contents::default() });
    }
    let file = plan::read(&text).map_err(|e| wrong(e.to_string()))?;
    Ok(Contents {
        mission: file.mission,
        fence: file.fence,
        rally_points: file.rally_points,
        planned_for: match file.firmware_type {
            3 => Some(Autopilot::ArduPilot),
            12 => Some(Autopilot::Px4),
            _ => None,
        },
        mav_type: (file.vehicle_type != 0).then_some(file.vehicle_type),
        backup_of: file.backup_of,
        airframe: file.airframe,
    })
}

/// The text of a file with all of this; a `.waypoints` file holds the mission alone.
///
/// # Errors
/// The name shows no kind.
pub fn text_of(
    path: &Path,
    contents: &Contents,
    autopilot: Autopilot,
    mav_type: u8,
) -> Result<String, FileError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("plan") => Ok(plan::write(&plan_of(contents, autopilot, mav_type))),
        Some("waypoints" | "txt") => Ok(waypoints::write(&contents.mission)),
        _ => Err(FileError::Kind(path.to_owned())),
    }
}

/// The text with the mark of this program, where the kind of file has room for one.
pub fn marked(path: &Path, text: String) -> String {
    if path.extension().is_some_and(|e| e == "plan") { mark::json(&text) } else { text }
}

/// The contents as a plan file.
pub fn plan_of(contents: &Contents, autopilot: Autopilot, mav_type: u8) -> PlanFile {
    PlanFile {
        rally_points: contents.rally_points.clone(),
        backup_of: contents.backup_of,
        airframe: contents.airframe.clone(),
        ..PlanFile::new(contents.mission.clone(), contents.fence.clone(), autopilot, mav_type)
    }
}

/// Whether the name shows the kind of mission file, before there is anything to write.
///
/// # Errors
/// It shows none.
pub fn check_kind(path: &Path) -> Result<(), FileError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("plan" | "waypoints" | "txt") => Ok(()),
        _ => Err(FileError::Kind(path.to_owned())),
    }
}

/// Whether a file of this name can hold this list.
///
/// # Errors
/// It is no mission file, or one that holds missions alone.
pub fn check_holds(path: &Path, kind: MissionKind) -> Result<(), FileError> {
    check_kind(path)?;
    if kind == MissionKind::Mission || path.extension().is_some_and(|e| e == "plan") {
        return Ok(());
    }
    Err(FileError::NotAPlan { path: path.to_owned(), kind })
}

/// Writes a file that did not exist before, down to the disk.
///
/// # Errors
/// It exists, or the disk refuses.
pub fn write_new(path: &Path, text: &str) -> Result<(), FileError> {
    let write = || {
        outputs::create(path, text.as_bytes())?;
        sync_folder(path);
        Ok(())
    };
    write().map_err(|source| FileError::Write { path: path.to_owned(), source })
}

/// For what is written only later: refuses a file that exists now.
///
/// # Errors
/// It exists.
pub fn refuse_existing(path: &Path) -> Result<(), FileError> {
    if path.exists() {
        let source = std::io::Error::from(std::io::ErrorKind::AlreadyExists);
        return Err(FileError::Write { path: path.to_owned(), source });
    }
    Ok(())
}

/// The folder in which a file lies.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The name of a new file lives in its folder, which some systems can sync as well; the others need not.
fn sync_folder(path: &Path) {
    if let Ok(folder) = std::fs::File::open(folder_of(path)) {
        let _ = folder.sync_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware_mission::item::Frame;

    /// PX4 reads a rally point above sea level back as frame 5: in a plan file 529 m of altitude would be 529 m above home.
    #[test]
    fn a_rally_point_above_sea_level_is_not_written_as_one_above_home() {
        let point = |frame| MissionItem { frame, ..rally_item([47.4, 8.5, 529.0]) };
        let list = |frame| Mission { home: None, items: vec![point(Frame(6)), point(frame)] };
        let mut contents = Contents::default();
        assert_eq!(contents.put(MissionKind::Rally, list(Frame(3))), Ok(()));
        assert_eq!(contents.rally_points, [[47.4, 8.5, 529.0]; 2]);
        for frame in [0, 5, 10] {
            let why = contents.put(MissionKind::Rally, list(Frame(frame)));
            assert_eq!(why, Err(ListError::Rally(2)), "{frame}");
        }
    }
}
