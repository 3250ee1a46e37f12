//! What unit tests of several modules need.

use std::path::{Path, PathBuf};

/// The folder of recorded flights that are too big for the repository; tests that need it are ignored unless they are asked for.
pub fn flights() -> PathBuf {
    std::env::var_os("GAWARE_FLIGHTS")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from)
}
