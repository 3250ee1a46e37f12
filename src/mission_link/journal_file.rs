//! What the journals of all transfers share: their names, where they are found, and their end.

use super::files::FileError;
use std::path::{Path, PathBuf};

/// End of the name of every journal.
const END: &str = ".journal";

/// The journals of one kind of transfer, by what their names begin with; the system id follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct JournalFiles(pub(super) &'static str);

impl JournalFiles {
    /// Where the journal of a transfer to this vehicle lies.
    pub(super) fn path(self, folder: &Path, system_id: u8) -> PathBuf {
        folder.join(format!("{}{system_id}{END}", self.0))
    }

    /// Whether a file has the name of such a journal.
    pub(super) fn is_named(self, path: &Path) -> bool {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        name.starts_with(self.0) && name.ends_with(END)
    }

    /// Those in a folder.
    pub(super) fn list(self, folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut found: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| self.is_named(p)).collect();
        found.sort();
        found
    }
}

/// Removes the journal of a transfer that came to a good end.
///
/// # Errors
/// The file cannot be removed.
pub(super) fn end(path: &Path) -> Result<(), FileError> {
    std::fs::remove_file(path).map_err(|source| FileError::Write { path: path.to_owned(), source })
}
