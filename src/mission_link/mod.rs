//! The thin shell that carries the mission transfer of `gaware-mission` over our links.

pub mod codec;
pub mod files;
pub mod journal;
pub mod session;
pub mod uploader;
pub mod vehicle;
pub mod wire;
