//! Placeholder that the first room replaces.
