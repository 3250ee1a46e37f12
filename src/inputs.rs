//! Files that are read as a whole: regular ones, and no larger than such a file can be.
//!
//! A pipe without a writer would hang, a device would never end.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Plans, parameters, models, journals, configurations: none of an aircraft comes near it, bytes.
const MOST: u64 = 16 << 20;

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
    String::from_utf8(bytes(path)?).map_err(|_| io::Error::other("it is no text (UTF-8)"))
}

/// Reads the bytes of a file.
///
/// # Errors
/// As [`open`]; it is larger than 16 MiB.
pub fn bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(MOST + 1).read_to_end(&mut bytes)?;
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
