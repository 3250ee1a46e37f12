//! The inputs that a campaign begins with: files below `fuzz/corpus`, findings of earlier campaigns among them, and seeds that
//! targets make themselves.

use crate::Target;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Begin of the names of findings.
pub const FINDING: &str = "finding-";

/// The folder with a folder per target.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus")
}

/// The files of a target, by name.
///
/// # Errors
/// When the folder or a file in it cannot be read.
pub fn files(target: &Target) -> io::Result<Vec<(PathBuf, Vec<u8>)>> {
    let folder = folder().join(target.name);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<io::Result<_>>()?;
    paths.sort();
    paths.into_iter().map(|p| fs::read(&p).map(|bytes| (p, bytes))).collect()
}

/// All inputs to begin with, never none.
///
/// # Errors
/// As [`files`].
pub fn all(target: &Target) -> io::Result<Vec<Vec<u8>>> {
    let mut inputs: Vec<Vec<u8>> = files(target)?.into_iter().map(|(_, bytes)| bytes).collect();
    inputs.extend((target.seeds)());
    if inputs.is_empty() {
        inputs.push(Vec::new());
    }
    Ok(inputs)
}

/// Keeps a finding, under a name made of its content; returns the file.
///
/// # Errors
/// When it cannot be written.
pub fn keep(target: &Target, input: &[u8]) -> io::Result<PathBuf> {
    let hash = input
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    let folder = folder().join(target.name);
    fs::create_dir_all(&folder)?;
    let path = folder.join(format!("{FINDING}{hash:016x}"));
    fs::write(&path, input)?;
    Ok(path)
}
