//! The thin shell that carries the mission transfer of `gaware-mission` over our links.

pub mod delivery;
pub mod facts;
pub mod files;
pub mod inventory;
pub mod journal;
pub mod measure;
pub mod param_delivery;
pub mod param_transfer;
pub mod pin;
pub mod pinned;
pub mod restore;
pub mod route;
mod run_wire;
pub mod session;
pub mod uploader;
pub mod wire;

pub use crate::link::{codec, param_codec, vehicle};
