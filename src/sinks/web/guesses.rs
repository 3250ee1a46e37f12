//! Wrong tokens are limited in number, by address.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tokio::time::Instant;

/// So many wrong tokens of one address …
const ALLOWED: u32 = 10;
/// … within this time.
const WINDOW: Duration = Duration::from_secs(60);
/// Addresses that are remembered.
const ADDRESSES: usize = 1024;
/// Bytes of a wrong token that are remembered, to know it again.
const REMEMBERED: usize = 64;

#[derive(Debug)]
struct Wrong {
    since: Instant,
    count: u32,
    /// A browser sends the cookie of an earlier run with every request: that is one guess.
    last: String,
}

/// The wrong tokens of the last minute.
#[derive(Debug, Default)]
pub(in crate::sinks) struct Guesses(Mutex<BTreeMap<IpAddr, Wrong>>);

impl Guesses {
    /// Whether this address has guessed too often.
    pub(in crate::sinks) fn locked(&self, address: IpAddr) -> bool {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.get(&address).is_some_and(|w| w.since.elapsed() >= WINDOW) {
            all.remove(&address);
        }
        all.get(&address).is_some_and(|w| w.count >= ALLOWED)
    }

    /// Counts a wrong token.
    pub(in crate::sinks) fn wrong(&self, address: IpAddr, token: &str) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() >= ADDRESSES
            && !all.contains_key(&address)
            && let Some(oldest) = all.iter().min_by_key(|(_, w)| w.since).map(|(a, _)| *a)
        {
            all.remove(&oldest);
        }
        let token: String = token.chars().take(REMEMBERED).collect();
        let entry = all.entry(address);
        let wrong = entry.or_insert_with(|| Wrong { since: Instant::now(), count: 0, last: String::new() });
        if wrong.last != token {
            wrong.count += 1;
            wrong.last = token;
        }
    }
}
