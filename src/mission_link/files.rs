//! Mission files by their kind: QGroundControl's `.plan` and `QGC WPL 110`.

use gaware_mission::fence::Fence;
use gaware_mission::files::plan::{self, PlanFile};
use gaware_mission::files::waypoints;
use gaware_mission::item::{Autopilot, Mission};
use std::io::Write;
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
        "an earlier transfer to this vehicle was interrupted, or is under way in another process; its journal is {path}. Run \"gaware mission \
         restore --connect … {path}\" first, or remove that file if you know what is on the vehicle", path = path.display()
    )]
    Interrupted {
        /// The journal.
        path: PathBuf,
    },
    /// Neither kind.
    #[error("{0}: name it .plan or .waypoints, the two kinds of mission files")]
    Kind(PathBuf),
}

/// Reads a mission and the fence that came with it; the kind shows in the content.
///
/// # Errors
/// The file cannot be read or holds no mission.
pub fn read(path: &Path) -> Result<(Mission, Fence), FileError> {
    let text =
        std::fs::read_to_string(path).map_err(|source| FileError::Read { path: path.to_owned(), source })?;
    let wrong = |reason: String| FileError::Content { path: path.to_owned(), reason };
    if text.trim_start().starts_with('{') {
        let file = plan::read(&text).map_err(|e| wrong(e.to_string()))?;
        return Ok((file.mission, file.fence));
    }
    let mission = waypoints::read(&text).map_err(|e| wrong(e.to_string()))?;
    Ok((mission, Fence::default()))
}

/// The text of a mission file of the kind that its name tells.
///
/// # Errors
/// The name tells no kind.
pub fn text_of(
    path: &Path,
    mission: &Mission,
    fence: &Fence,
    autopilot: Autopilot,
    mav_type: u8,
) -> Result<String, FileError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("plan") => Ok(plan::write(&PlanFile::new(mission.clone(), fence.clone(), autopilot, mav_type))),
        Some("waypoints" | "txt") => Ok(waypoints::write(mission)),
        _ => Err(FileError::Kind(path.to_owned())),
    }
}

/// Whether the name tells the kind of mission file, before there is anything to write.
///
/// # Errors
/// It tells none.
pub fn check_kind(path: &Path) -> Result<(), FileError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("plan" | "waypoints" | "txt") => Ok(()),
        _ => Err(FileError::Kind(path.to_owned())),
    }
}

/// Writes a file that did not exist before, down to the disk.
///
/// # Errors
/// It exists, or the disk refuses.
pub fn write_new(path: &Path, text: &str) -> Result<(), FileError> {
    let write = || {
        let mut file = std::fs::File::create_new(path)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        sync_folder(path);
        Ok(())
    };
    write().map_err(|source| FileError::Write { path: path.to_owned(), source })
}

/// The name of a new file lives in its folder, which some systems can sync as well; the others need not.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if let Ok(folder) = std::fs::File::open(folder) {
        let _ = folder.sync_all();
    }
}
