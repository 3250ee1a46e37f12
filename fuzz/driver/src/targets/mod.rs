//! The targets by what they are about.

pub mod engine;
pub mod files;
pub mod foxglove;
pub mod link;
pub mod logs;
pub mod transfer;
pub mod uploader;
pub mod web;

/// What is refused is refused with a reason.
fn refused(error: &dyn std::error::Error) -> bool {
    assert!(!error.to_string().is_empty());
    false
}
