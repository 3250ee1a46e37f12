//! Fuzz targets: every place where bytes of others come in, as a function of bytes that must neither panic, hang nor use much memory.
//!
//! The same functions serve `cargo fuzz` (`fuzz/fuzz_targets`), the campaign of this crate's binary and its tests. A target asserts more
//! than survival where there is something to assert: what is read can be written and read again, what a transfer states is what the
//! vehicle holds, the covariance stays sound, no change passes the web server without its token.

#![forbid(unsafe_code)]
#![allow(clippy::panic, reason = "a target panics where something is wrong")]

pub mod campaign;
pub mod corpus;
pub mod mutate;
pub mod random;
pub mod script;
pub mod targets;
pub mod vehicle;

use mutate::Shape;

/// One place where bytes come in.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name on the command line, of the file in `fuzz_targets` and of the folder in `corpus`.
    pub name: &'static str,
    /// How its inputs are mutated.
    pub shape: Shape,
    /// Runs one input; panics where something is wrong. True where the input was not refused at the first look, so that it says something
    /// about what is behind.
    pub run: fn(&[u8]) -> bool,
    /// Inputs to begin with besides those of the corpus.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: [Target; 19] = [
    target("framer", Shape::Bytes, targets::link::framer, targets::link::raw_seeds),
    target("decode", Shape::Script, targets::link::decode, targets::link::script_seeds),
    target("address", Shape::Text, targets::link::address, targets::link::address_seeds),
    target("tlog", Shape::Bytes, targets::logs::tlog, targets::logs::tlog_seeds),
    target("dataflash", Shape::Bytes, targets::logs::dataflash, no_seeds),
    target("ulog", Shape::Bytes, targets::logs::ulog, no_seeds),
    target("mcap", Shape::Bytes, targets::logs::mcap, no_seeds),
    target("table", Shape::Text, targets::logs::table, targets::logs::table_seeds),
    target("plan", Shape::Text, targets::files::plan, no_seeds),
    target("waypoints", Shape::Text, targets::files::waypoints, no_seeds),
    target("model", Shape::Text, targets::files::model, targets::files::model_seeds),
    target("effects", Shape::Text, targets::files::effects, targets::files::effects_seeds),
    target("airframe", Shape::Text, targets::files::airframe, targets::files::airframe_seeds),
    target("parameters", Shape::Script, targets::transfer::parameters, targets::transfer::parameter_seeds),
    target("transfer", Shape::Script, targets::transfer::transfer, targets::transfer::seeds),
    target("uploader", Shape::Script, targets::uploader::uploader, targets::transfer::seeds),
    target("engine", Shape::Script, targets::engine::engine, targets::engine::seeds),
    target("web", Shape::Text, targets::web::web, targets::web::seeds),
    target("foxglove", Shape::Text, targets::foxglove::foxglove, targets::foxglove::seeds),
];

const fn target(
    name: &'static str,
    shape: Shape,
    run: fn(&[u8]) -> bool,
    seeds: fn() -> Vec<Vec<u8>>,
) -> Target {
    Target { name, shape, run, seeds }
}

fn no_seeds() -> Vec<Vec<u8>> {
    Vec::new()
}

/// A target by its name.
pub fn by_name(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|t| t.name == name)
}
