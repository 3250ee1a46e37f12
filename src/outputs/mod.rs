//! Files that commands write. One rule for all of them: an output is never an input, whatever link leads there; a file that this program did
//! not write, or that was edited since (see [`mark`]), is overwritten only with `--force`; what is written is there whole or not at all.

pub mod mark;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The same file is read.
    #[error("{path} is read by this command and would be overwritten: name another file for the result", path = .0.display())]
    Input(PathBuf),
    /// Somebody else's file.
    #[error(
        "{path} exists, and gaware did not write it or it was edited since: name another file, or overwrite it with --force",
        path = .0.display()
    )]
    Foreign(PathBuf),
    /// The file or folder cannot be written.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// File or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl OutputError {
    /// Whether the arguments are wrong, rather than the work has failed.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Input(_))
    }

    fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }
}

/// A file by what it is, not by its name.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Identity {
    /// Device and number on it, which all names of a file have in common.
    #[cfg(unix)]
    Number(u64, u64),
    /// The name without links.
    #[cfg(not(unix))]
    Name(PathBuf),
}

impl Identity {
    #[cfg(unix)]
    fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        fs::metadata(path).ok().map(|about| Self::Number(about.dev(), about.ino()))
    }

    #[cfg(not(unix))]
    fn of(path: &Path) -> Option<Self> {
        fs::canonicalize(path).ok().map(Self::Name)
    }
}

/// The file, or the files of a folder with tables.
fn files_of(path: &Path) -> Vec<Identity> {
    match fs::read_dir(path) {
        Ok(entries) => entries.flatten().filter_map(|e| Identity::of(&e.path())).collect(),
        Err(_) => Identity::of(path).into_iter().collect(),
    }
}

/// Where a command may write.
#[derive(Debug, Clone, Default)]
pub struct Outputs {
    read: Vec<Identity>,
    force: bool,
}

impl Outputs {
    /// The outputs of a command that reads these files. `force`: existing files are overwritten also where gaware did not write them.
    pub fn of<P: AsRef<Path>>(inputs: impl IntoIterator<Item = P>, force: bool) -> Self {
        let read = inputs.into_iter().flat_map(|path| files_of(path.as_ref())).collect();
        Self { read, force }
    }

    /// Whether a file may be written, before the work that makes its content.
    ///
    /// # Errors
    /// It is an input, or somebody else's.
    pub fn check(&self, path: &Path) -> Result<(), OutputError> {
        if Identity::of(path).is_some_and(|file| self.read.contains(&file)) {
            return Err(OutputError::Input(path.to_owned()));
        }
        // What is no file (a pipe, /dev/null) loses nothing.
        if self.force || !path.is_file() || mark::is_own(path) {
            return Ok(());
        }
        Err(OutputError::Foreign(path.to_owned()))
    }

    /// Writes a file: whole, or not at all. The digest is put in where the content has a [`mark`].
    ///
    /// # Errors
    /// As [`Self::check`], and what the system says.
    pub fn write(&self, path: &Path, content: impl Into<Vec<u8>>) -> Result<(), OutputError> {
        self.check(path)?;
        replace(path, &mark::sealed(content.into(), b"")).map_err(|e| OutputError::write(path, e))
    }

    /// Makes a folder with all above it.
    ///
    /// # Errors
    /// What the system says.
    pub fn folder(&self, path: &Path) -> Result<(), OutputError> {
        fs::create_dir_all(path).map_err(|e| OutputError::write(path, e))
    }

    /// Removes a file that an earlier run wrote and that this one has no content for.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn remove(&self, path: &Path) -> Result<(), OutputError> {
        if !path.is_file() {
            return Ok(());
        }
        self.check(path)?;
        fs::remove_file(path).map_err(|e| OutputError::write(path, e))
    }
}

/// Puts a file in the place of another, or where none was: written beside it, then renamed.
///
/// # Errors
/// What the system says; what was there before is there still.
pub fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let place = match fs::metadata(path) {
        Ok(about) if !about.is_file() && !about.is_dir() => {
            return File::options().write(true).open(path)?.write_all(content);
        }
        // A link stays one.
        Ok(_) => fs::canonicalize(path)?,
        Err(_) => path.to_owned(),
    };
    let beside = Beside::write(&place, content)?;
    if let Ok(before) = fs::metadata(&place) {
        fs::set_permissions(&beside.0, before.permissions())?;
    }
    fs::rename(&beside.0, &place)
}

/// Writes a file where none is.
///
/// # Errors
/// There is one, or what the system says; then no part of a file is left.
pub fn create(path: &Path, content: &[u8]) -> io::Result<()> {
    let there = || io::Error::from(io::ErrorKind::AlreadyExists);
    if path.symlink_metadata().is_ok() {
        return Err(there());
    }
    let beside = Beside::write(path, content)?;
    // A second name fails where the first exists, a rename would replace it.
    match fs::hard_link(&beside.0, path) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(error),
        // File systems without second names.
        Err(_) if path.symlink_metadata().is_ok() => Err(there()),
        Err(_) => fs::rename(&beside.0, path),
    }
}

/// A new file beside its place, gone at the end unless it was renamed.
struct Beside(PathBuf);

impl Beside {
    fn write(place: &Path, content: &[u8]) -> io::Result<Self> {
        let mut name = std::ffi::OsString::from(".");
        name.push(place.file_name().ok_or(io::ErrorKind::InvalidInput)?);
        name.push(format!(".{}.part", std::process::id()));
        let beside = Self(place.with_file_name(name));
        let mut file = File::create(&beside.0)?;
        file.write_all(content)?;
        file.sync_all()?;
        Ok(beside)
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

#[cfg(test)]
mod tests;
