//! Wrong tokens are limited in number, by address and by the way they came: any web page can make a browser ask with a token in the address
//! line, and must not lock the one that the pilot's own page sends in its headers.

use axum::http::{HeaderMap, HeaderValue};
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

/// How a token came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::sinks) enum Way {
    /// In the address line.
    Address,
    /// In the address line, where the browser says that a page of another site asks. Who says so without a browser locks no more than this.
    AddressElsewhere,
    /// In a header or a cookie, which no page of another site can send.
    Header,
}

impl Way {
    /// The way of a token in the address line, by what browsers say of who asks (Fetch Metadata, `Sec-Fetch-Site`).
    pub(in crate::sinks) fn of_address(headers: &HeaderMap) -> Self {
        match headers.get("sec-fetch-site").map(HeaderValue::as_bytes) {
            Some(b"cross-site" | b"same-site") => Self::AddressElsewhere,
            _ => Self::Address,
        }
    }
}

#[derive(Debug)]
struct Wrong {
    since: Instant,
    count: u32,
    /// A browser sends the cookie of an earlier run with every request: that is one guess.
    last: String,
}

/// The wrong tokens of the last minute.
#[derive(Debug, Default)]
pub(in crate::sinks) struct Guesses(Mutex<BTreeMap<(IpAddr, Way), Wrong>>);

impl Guesses {
    /// Whether this address has guessed too often in this way.
    pub(in crate::sinks) fn locked(&self, address: IpAddr, way: Way) -> bool {
        let key = (address, way);
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.get(&key).is_some_and(|w| w.since.elapsed() >= WINDOW) {
            all.remove(&key);
        }
        all.get(&key).is_some_and(|w| w.count >= ALLOWED)
    }

    /// Counts a wrong token.
    pub(in crate::sinks) fn wrong(&self, address: IpAddr, way: Way, token: &str) {
        let key = (address, way);
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() >= ADDRESSES
            && !all.contains_key(&key)
            && let Some(oldest) = all.iter().min_by_key(|(_, w)| w.since).map(|(a, _)| *a)
        {
            all.remove(&oldest);
        }
        let token: String = token.chars().take(REMEMBERED).collect();
        let entry = all.entry(key);
        let wrong = entry.or_insert_with(|| Wrong { since: Instant::now(), count: 0, last: String::new() });
        if wrong.last != token {
            wrong.count += 1;
            wrong.last = token;
        }
    }
}
