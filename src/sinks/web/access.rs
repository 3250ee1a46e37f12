//! Who may ask for what: token, host and origin, decided before any handler runs.
//!
//! Reads on a loopback address are free, if the request really is meant for a loopback host (a page elsewhere may
//! point its own name at 127.0.0.1: DNS rebinding). Anything else, and every change, needs the token.

use super::{Shared, WebError, assets};
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;
use subtle::ConstantTimeEq;

/// Name of the cookie that carries the token after `?token=` was given once.
const COOKIE: &str = "gaware_token";

/// The secret that opens the page. Compared in constant time, never printed.
#[derive(Clone)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

impl Token {
    /// Characters of a token at least.
    pub const MIN_CHARS: usize = 12;

    /// A token chosen by the user.
    ///
    /// # Errors
    /// [`WebError::BadToken`] where it is too short or has characters that need escaping in an address line.
    pub fn new(text: &str) -> Result<Self, WebError> {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
        if text.len() < Self::MIN_CHARS || !text.chars().all(plain) {
            return Err(WebError::BadToken);
        }
        Ok(Self(text.to_owned()))
    }

    /// A fresh token of 128 random bits, in hexadecimal digits.
    ///
    /// # Errors
    /// [`WebError::Randomness`] where the system has none.
    pub fn random() -> Result<Self, WebError> {
        let mut bytes = [0u8; 16];
        getrandom::fill(&mut bytes).map_err(|e| WebError::Randomness(e.to_string()))?;
        Ok(Self(bytes.iter().map(|b| format!("{b:02x}")).collect()))
    }

    /// The secret itself, to show it once to the person who started the server.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    fn matches(&self, other: &str) -> bool {
        self.0.as_bytes().ct_eq(other.as_bytes()).into()
    }
}

/// The rules of one server.
#[derive(Debug)]
pub(super) struct Policy {
    local: bool,
    token: Option<Token>,
}

/// What becomes of a request.
#[derive(Debug, PartialEq, Eq)]
enum Decision {
    Allow,
    /// The token came in the address line: keep it in a cookie and get it out of sight.
    Remember(String),
    /// No token, or a wrong one.
    Unauthorised,
    /// Never, with the reason.
    Refused(&'static str),
}

impl Policy {
    pub(super) fn new(local: bool, token: Option<Token>) -> Self {
        Self { local, token }
    }

    /// Whether this request carries the right token.
    pub(super) fn authorised(&self, headers: &HeaderMap) -> bool {
        let Some(token) = &self.token else { return false };
        let bearer = headers
            .get(header::AUTHORIZATION)
            .and_then(|v| v.to_str().ok())
            .and_then(|v| v.strip_prefix("Bearer "));
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|v| v.to_str().ok());
        let cookie = cookies
            .flat_map(|v| v.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .find_map(|(name, value)| (name == COOKIE).then_some(value));
        bearer.is_some_and(|b| token.matches(b.trim())) || cookie.is_some_and(|c| token.matches(c))
    }

    fn decide(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Decision {
        let host = headers.get(header::HOST).and_then(|v| v.to_str().ok()).unwrap_or_default();
        if self.local && !is_loopback_host(host) {
            return Decision::Refused("this server answers to localhost only");
        }
        if !matches!(*method, Method::GET | Method::HEAD) {
            return self.decide_change(host, headers);
        }
        if let (Some(token), Some(given)) = (&self.token, query_token(uri)) {
            return if token.matches(given) {
                Decision::Remember(without_token(uri))
            } else {
                Decision::Unauthorised
            };
        }
        if self.local || is_public(uri.path()) || self.authorised(headers) {
            Decision::Allow
        } else {
            Decision::Unauthorised
        }
    }

    fn decide_change(&self, host: &str, headers: &HeaderMap) -> Decision {
        if self.token.is_none() {
            return Decision::Refused("changes need a token: start gaware with --web-token");
        }
        // The cookie is SameSite=Strict already; this also stops another port of the same host.
        let origin = headers.get(header::ORIGIN).and_then(|v| v.to_str().ok());
        if origin.is_some_and(|o| o.split_once("://").is_none_or(|(_, from)| from != host)) {
            return Decision::Refused("this request came from another page");
        }
        if self.authorised(headers) { Decision::Allow } else { Decision::Unauthorised }
    }
}

/// What the sign-in page itself needs, and the health check: nothing of the vehicle.
fn is_public(path: &str) -> bool {
    matches!(path, "/healthz" | "/favicon.ico" | "/assets/style.css" | "/assets/icon.svg")
}

fn is_loopback_host(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

fn query_token(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

fn without_token(uri: &Uri) -> String {
    let rest: Vec<&str> =
        uri.query().unwrap_or_default().split('&').filter(|pair| !pair.starts_with("token=")).collect();
    // A path of several slashes would be read as another host.
    let path = format!("/{}", uri.path().trim_start_matches('/'));
    if rest.is_empty() { path } else { format!("{path}?{}", rest.join("&")) }
}

/// The middleware in front of every handler.
pub(super) async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    match shared.policy.decide(request.method(), request.uri(), request.headers()) {
        Decision::Allow => next.run(request).await,
        Decision::Remember(target) => remember(&shared.policy, &target),
        Decision::Refused(reason) => (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response(),
        Decision::Unauthorised => unauthorised(request.uri().path()),
    }
}

fn remember(policy: &Policy, target: &str) -> Response {
    let secret = policy.token.as_ref().map(Token::reveal).unwrap_or_default();
    let cookie = format!("{COOKIE}={secret}; Path=/; HttpOnly; SameSite=Strict");
    (StatusCode::SEE_OTHER, [(header::LOCATION, target.to_owned()), (header::SET_COOKIE, cookie)])
        .into_response()
}

fn unauthorised(path: &str) -> Response {
    let challenge = [(header::WWW_AUTHENTICATE, "Bearer")];
    if path == "/" {
        return (StatusCode::UNAUTHORIZED, challenge, assets::sign_in()).into_response();
    }
    (StatusCode::UNAUTHORIZED, challenge, "a token is needed: Authorization: Bearer TOKEN\n").into_response()
}

/// Nothing from elsewhere, nothing to elsewhere.
pub(super) async fn security_headers(mut response: Response) -> Response {
    const CSP: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                       base-uri 'none'; form-action 'self'; frame-ancestors 'none'";
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, CSP),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECRET: &str = "correct-horse-battery";

    fn decide(local: bool, token: bool, method: &Method, uri: &str, headers: &[(&str, &str)]) -> Decision {
        let policy = Policy::new(local, token.then(|| Token::new(SECRET).unwrap()));
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(HeaderName::from_bytes(name.as_bytes()).unwrap(), value.parse().unwrap());
        }
        policy.decide(method, &uri.parse().unwrap(), &map)
    }

    #[test]
    fn localhost_reads_are_free_but_only_under_a_loopback_name() {
        for host in ["localhost:8080", "LOCALHOST", "127.0.0.1:1", "[::1]:8080", "127.8.8.8"] {
            assert_eq!(decide(true, false, &Method::GET, "/", &[("host", host)]), Decision::Allow, "{host}");
        }
        for host in ["evil.example:8080", "localhost.evil.example", "192.168.1.4", "", "[::2]", "[::1"] {
            let decision = decide(true, true, &Method::GET, "/", &[("host", host)]);
            let free = host == "[::1"; // An unclosed bracket still names the loopback address.
            assert_eq!(decision == Decision::Allow, free, "{host}");
        }
    }

    #[test]
    fn no_change_without_the_token_even_on_localhost() {
        let local = ("host", "localhost:8080");
        let bearer = ("authorization", "Bearer correct-horse-battery");
        let post = |token, headers: &[(&str, &str)]| {
            decide(true, token, &Method::POST, "/api/v1/mission/upload", headers)
        };
        assert!(matches!(post(false, &[local]), Decision::Refused(_)));
        assert!(matches!(post(false, &[local, bearer]), Decision::Refused(_)));
        assert_eq!(post(true, &[local]), Decision::Unauthorised);
        assert_eq!(post(true, &[local, bearer]), Decision::Allow);
        assert_eq!(post(true, &[local, bearer, ("origin", "http://localhost:8080")]), Decision::Allow);
        for origin in ["http://evil.example", "http://localhost:9090", "null"] {
            assert!(
                matches!(post(true, &[local, bearer, ("origin", origin)]), Decision::Refused(_)),
                "{origin}"
            );
        }
    }

    #[test]
    fn elsewhere_every_read_needs_the_token_in_header_or_cookie() {
        let get = |uri, headers: &[(&str, &str)]| decide(false, true, &Method::GET, uri, headers);
        assert_eq!(get("/api/v1/status", &[]), Decision::Unauthorised);
        assert_eq!(get("/metrics", &[("authorization", "Bearer wrong")]), Decision::Unauthorised);
        assert_eq!(get("/metrics", &[("authorization", "Bearer correct-horse-battery")]), Decision::Allow);
        assert_eq!(get("/", &[("cookie", "a=b; gaware_token=correct-horse-battery")]), Decision::Allow);
        assert_eq!(get("/", &[("cookie", "gaware_token=correct-horse-batterx")]), Decision::Unauthorised);
        assert_eq!(get("/healthz", &[]), Decision::Allow);
    }

    #[test]
    fn the_token_in_the_address_leaves_it_and_cannot_redirect_elsewhere() {
        let get = |uri: &str| decide(false, true, &Method::GET, uri, &[]);
        assert_eq!(get("/?token=correct-horse-battery"), Decision::Remember("/".into()));
        assert_eq!(get("/x?a=1&token=correct-horse-battery&b=2"), Decision::Remember("/x?a=1&b=2".into()));
        assert_eq!(
            get("//evil.example/?token=correct-horse-battery"),
            Decision::Remember("/evil.example/".into())
        );
        assert_eq!(get("/?token=nope"), Decision::Unauthorised);
    }

    #[test]
    fn tokens_are_long_plain_random_and_never_printed() {
        assert!(Token::new("short").is_err());
        assert!(Token::new("with space and more").is_err());
        let (a, b) = (Token::random().unwrap(), Token::random().unwrap());
        assert_ne!(a.reveal(), b.reveal());
        assert!(Token::new(a.reveal()).is_ok());
        assert!(!format!("{a:?}").contains(a.reveal()));
    }
}
