//! A recording that is being written stays: how its recorder holds it, and how whoever makes space for others sees that.

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

pub(super) use system::{create, is_gone, open_unless_held};

#[cfg(unix)]
mod system {
    use super::{File, Metadata, Path, io};
    use std::os::unix::fs::MetadataExt;

    /// A new file for a recorder.
    pub(in super::super) fn create(path: &Path) -> io::Result<File> {
        let file = File::options().append(true).create_new(true).open(path)?;
        // A file system without locks has one recorder.
        let _ = file.try_lock_shared();
        Ok(file)
    }

    /// Opens a recording that no one writes; nothing where someone does.
    pub(in super::super) fn open_unless_held(path: &Path) -> Option<File> {
        let file = File::open(path).ok()?;
        let held = matches!(file.try_lock(), Err(std::fs::TryLockError::WouldBlock));
        (!held).then_some(file)
    }

    /// Whether the open file has no name any more.
    pub(in super::super) fn is_gone(file: &Metadata) -> bool {
        file.nlink() == 0
    }
}

/// Locks would keep the recorder itself from writing (`LockFileEx`); here a file says when it is opened what others may do meanwhile.
#[cfg(windows)]
mod system {
    use super::{File, Metadata, Path, io};
    use std::os::windows::fs::OpenOptionsExt;

    /// `FILE_SHARE_READ`: others read, but neither write nor delete.
    const READ: u32 = 1;
    /// `FILE_SHARE_DELETE`.
    const DELETE: u32 = 4;

    /// A new file for a recorder.
    pub(in super::super) fn create(path: &Path) -> io::Result<File> {
        File::options().append(true).create_new(true).share_mode(READ).open(path)
    }

    /// Opens a recording that no one writes; nothing where someone does: who has it open for writing contradicts.
    pub(in super::super) fn open_unless_held(path: &Path) -> Option<File> {
        File::options().read(true).share_mode(READ | DELETE).open(path).ok()
    }

    /// No one else can take the name of an open recording away.
    pub(in super::super) fn is_gone(_: &Metadata) -> bool {
        false
    }
}
