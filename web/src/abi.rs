//! The border of the module: plain functions and the module's own memory, which the page writes and reads. No tool makes glue for it.
//!
//! The page asks for space ([`reserve`]), writes there, and says what it was ([`file`], or [`run`] for the job's description); then it reads
//! the answer at [`answer`]. One job at a time: a page has a worker for each.

#![allow(
    unsafe_code,
    reason = "names of exported functions are unsafe attributes, imports unsafe declarations; there is no unsafe block"
)]

use crate::job;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

#[cfg_attr(target_family = "wasm", link(wasm_import_module = "page"))]
#[cfg(target_family = "wasm")]
unsafe extern "C" {
    /// Shows a step in words (UTF-8) and how much of it is done.
    safe fn progress(words: *const u8, length: usize, done: f64, total: f64);
    /// Takes the words of a panic, which ends the module.
    safe fn panicked(words: *const u8, length: usize);
    /// Milliseconds of the page's clock.
    safe fn now_ms() -> f64;
}

/// The page's side, where there is none: the crate also builds for the machine that builds it.
#[cfg(not(target_family = "wasm"))]
mod nobody {
    pub fn progress(_: *const u8, _: usize, _: f64, _: f64) {}
    pub fn panicked(_: *const u8, _: usize) {}
    pub fn now_ms() -> f64 {
        0.0
    }
}
#[cfg(not(target_family = "wasm"))]
use nobody::{now_ms, panicked, progress};

/// What the page writes next, the files that it has written, and the answer.
static SPACE: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static FILES: Mutex<Vec<Vec<u8>>> = Mutex::new(Vec::new());
static ANSWER: Mutex<Vec<u8>> = Mutex::new(Vec::new());

fn open<T>(place: &Mutex<T>) -> MutexGuard<'_, T> {
    place.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Space for so many bytes.
#[unsafe(no_mangle)]
pub extern "C" fn reserve(length: usize) -> *mut u8 {
    let mut space = open(&SPACE);
    *space = vec![0; length];
    space.as_mut_ptr()
}

/// What was written is the content of the job's next file.
#[unsafe(no_mangle)]
pub extern "C" fn file() {
    let content = std::mem::take(&mut *open(&SPACE));
    open(&FILES).push(content);
}

/// What was written describes the job (JSON): does it and gives the length of the answer (JSON).
#[unsafe(no_mangle)]
pub extern "C" fn run() -> usize {
    std::panic::set_hook(Box::new(|info| {
        let words = info.to_string();
        panicked(words.as_ptr(), words.len());
    }));
    let job = std::mem::take(&mut *open(&SPACE));
    let files = std::mem::take(&mut *open(&FILES));
    let done = job::run(&job, files);
    let mut answer = open(&ANSWER);
    *answer = done;
    answer.len()
}

/// Where the answer is.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    open(&ANSWER).as_ptr()
}

/// Shows a step on the page; `total` 0: how much is left is not known.
pub fn show(words: &str, done: u64, total: u64) {
    progress(words.as_ptr(), words.len(), done as f64, total as f64);
}

/// Time since some instant.
pub fn now() -> Duration {
    Duration::try_from_secs_f64(now_ms() * 1e-3).unwrap_or_default()
}
