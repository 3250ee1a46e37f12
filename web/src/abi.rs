//! The border of the module: plain functions and the module's own memory, which the page writes and reads. No tool makes glue for it.
//!
//! The page asks for space ([`reserve`]), writes there, and says what it was ([`file`], or [`run`] for the job's description); then it reads
//! the answer at [`answer`]. One job at a time: a page has a worker for each.

#![allow(
    unsafe_code,
    reason = "names of exported functions are unsafe attributes, imports unsafe declarations; there is no unsafe block"
)]

use crate::{job, live};
use gaware::view::listener::Listener;
use serde::Serialize;
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
/// The vehicle that is listened to.
static LIVE: Mutex<Option<Listener>> = Mutex::new(None);

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
    watch_panics();
    let job = std::mem::take(&mut *open(&SPACE));
    let files = std::mem::take(&mut *open(&FILES));
    answered(job::run(&job, files))
}

fn watch_panics() {
    std::panic::set_hook(Box::new(|info| {
        let words = info.to_string();
        panicked(words.as_ptr(), words.len());
    }));
}

fn answered(bytes: Vec<u8>) -> usize {
    let mut answer = open(&ANSWER);
    *answer = bytes;
    answer.len()
}

/// What was written describes a vehicle to listen to (JSON): the length of the reason where that cannot be.
#[unsafe(no_mangle)]
pub extern "C" fn listen() -> usize {
    watch_panics();
    let session = std::mem::take(&mut *open(&SPACE));
    let files = std::mem::take(&mut *open(&FILES));
    match live::begin(&session, files) {
        Ok(listener) => {
            *open(&LIVE) = Some(listener);
            0
        }
        Err(error) => answered(error.to_string().into_bytes()),
    }
}

/// What the listener says; nothing where there is none.
fn live<T: Default>(what: impl FnOnce(&mut Listener) -> T) -> T {
    open(&LIVE).as_mut().map(what).unwrap_or_default()
}

fn json(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).unwrap_or_default()
}

/// The port was opened at this baud rate.
#[unsafe(no_mangle)]
pub extern "C" fn opened(baud: u32) {
    live(|l| l.opened(baud));
}

/// The port is gone; what was written is the reason.
#[unsafe(no_mangle)]
pub extern "C" fn closed() {
    let problem = std::mem::take(&mut *open(&SPACE));
    live(|l| l.closed(&String::from_utf8_lossy(&problem)));
}

/// What was written came at this time, Unix µs: the length of what is to be recorded.
#[unsafe(no_mangle)]
pub extern "C" fn take(t_us: f64) -> usize {
    let bytes = std::mem::take(&mut *open(&SPACE));
    answered(live(|l| l.take(t_us as u64, &bytes)))
}

/// What the screen shows now: the length of its JSON.
#[unsafe(no_mangle)]
pub extern "C" fn view(now_us: f64) -> usize {
    answered(live(|l| json(&l.view(now_us as u64))))
}

/// The result so far: the length of its JSON.
#[unsafe(no_mangle)]
pub extern "C" fn document() -> usize {
    answered(live(|l| json(&l.document())))
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
