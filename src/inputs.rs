//! What is read: files of the disk (regular ones, and no larger than such a file can be where they are read as a whole), or bytes that are in
//! memory already, as on a page in a browser, which has no files.
//!
//! A pipe without a writer would hang, a device would never end.

use bytes::Bytes;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Plans, parameters, models, journals, configurations: none of an aircraft comes near it, bytes.
const MOST: u64 = 16 << 20;

/// A file, or bytes with the name of one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Input {
    path: PathBuf,
    bytes: Option<Bytes>,
}

impl Input {
    /// Bytes that are there already.
    pub fn in_memory(name: &str, bytes: impl Into<Bytes>) -> Self {
        Self { path: name.into(), bytes: Some(bytes.into()) }
    }

    /// Where it is, or the name of what is in memory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its name without the folder.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or(self.path.as_os_str()).to_string_lossy().into_owned()
    }

    /// Whether it is on the disk, where other files may lie beside it.
    pub fn is_file(&self) -> bool {
        self.bytes.is_none()
    }

    /// Opens it.
    ///
    /// # Errors
    /// As [`open`].
    pub fn open(&self) -> io::Result<Content> {
        match &self.bytes {
            Some(bytes) => Ok(Content::Memory(Cursor::new(bytes.clone()))),
            None => open(&self.path).map(Content::File),
        }
    }

    /// Reads its text.
    ///
    /// # Errors
    /// As [`text()`].
    pub fn text(&self) -> io::Result<String> {
        String::from_utf8(whole(self.open()?)?).map_err(|_| io::Error::other("it is no text (UTF-8)"))
    }
}

impl From<PathBuf> for Input {
    fn from(path: PathBuf) -> Self {
        Self { path, bytes: None }
    }
}

impl From<&PathBuf> for Input {
    fn from(path: &PathBuf) -> Self {
        path.clone().into()
    }
}

impl From<&Path> for Input {
    fn from(path: &Path) -> Self {
        path.to_owned().into()
    }
}

impl From<&Self> for Input {
    fn from(input: &Self) -> Self {
        input.clone()
    }
}

/// What is being read.
#[derive(Debug)]
pub enum Content {
    /// From the disk.
    File(File),
    /// From memory.
    Memory(Cursor<Bytes>),
}

impl Content {
    /// Bytes in all.
    ///
    /// # Errors
    /// What the system says.
    pub fn total_bytes(&self) -> io::Result<u64> {
        match self {
            Self::File(file) => Ok(file.metadata()?.len()),
            Self::Memory(bytes) => Ok(bytes.get_ref().len() as u64),
        }
    }
}

impl Read for Content {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(buffer),
            Self::Memory(bytes) => bytes.read(buffer),
        }
    }
}

impl Seek for Content {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Memory(bytes) => bytes.seek(to),
        }
    }
}

/// Opens a regular file.
///
/// # Errors
/// It cannot be opened, or is a pipe, a device or a folder.
pub fn open(path: &Path) -> io::Result<File> {
    // Before it is opened: opening a pipe waits for its other end.
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_dir() || kind.is_file() {
        return File::open(path);
    }
    Err(io::Error::other("it is no regular file but a pipe or a device; save what it gives in a file first"))
}

/// Reads a text.
///
/// # Errors
/// As [`open`]; it is larger than 16 MiB, or no UTF-8.
pub fn text(path: &Path) -> io::Result<String> {
    Input::from(path).text()
}

/// Reads the bytes of a file.
///
/// # Errors
/// As [`open`]; it is larger than 16 MiB.
pub fn bytes(path: &Path) -> io::Result<Vec<u8>> {
    whole(open(path)?)
}

fn whole(content: impl Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    content.take(MOST + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST {
        return Err(io::Error::other("it is larger than 16 MiB, which no file of this kind is"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_never_ends_is_not_read() {
        #[cfg(unix)]
        for endless in ["/dev/zero", "/dev/tty"] {
            let error = text(Path::new(endless)).unwrap_err().to_string();
            assert!(error.contains("no regular file") || !Path::new(endless).exists(), "{endless}: {error}");
        }
        let path = std::env::temp_dir().join(format!("gaware-large-{}", std::process::id()));
        File::create(&path).unwrap().set_len(MOST + 1).unwrap();
        let error = text(&path).unwrap_err().to_string();
        std::fs::write(&path, "text").unwrap();
        assert_eq!(text(&path).unwrap(), "text");
        std::fs::remove_file(&path).unwrap();
        assert!(error.contains("16 MiB"), "{error}");
    }
}
