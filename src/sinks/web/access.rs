//! Who may ask for what: token, host and origin, decided before any handler runs.
//!
//! Reads on a loopback address are free, if the request really is meant for a loopback host (a page elsewhere may
//! point its own name at 127.0.0.1: DNS rebinding). Anything else, and every change, needs the token.

use super::door::Visitor;
use super::guesses::{Guesses, Way};
use super::{Shared, WebError, assets};
use axum::extract::{ConnectInfo, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{Html, IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;
use subtle::ConstantTimeEq;

/// Name of the cookie that carries the token after `?token=` was given once, before the port: browsers send the cookies of a host to all of its
/// ports, and two servers must not overwrite each other's.
const COOKIE: &str = "gaware_token_";

/// What is said where an address has guessed too often.
pub(in crate::sinks) const TOO_MANY: &str = "too many wrong tokens from this address; wait a minute";

/// The secret that opens the page. Compared in constant time, never printed.
#[derive(Clone)]
pub struct Token {
    text: String,
    /// Whether it is too long for guessing: 128 random bits.
    random: bool,
}

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
        Ok(Self { text: text.to_owned(), random: false })
    }

    /// A fresh token of 128 random bits, in hexadecimal digits.
    ///
    /// # Errors
    /// [`WebError::Randomness`] where the system has none.
    pub fn random() -> Result<Self, WebError> {
        let mut bytes = [0u8; 16];
        getrandom::fill(&mut bytes).map_err(|e| WebError::Randomness(e.to_string()))?;
        Ok(Self { text: crate::outputs::mark::hex(&bytes), random: true })
    }

    /// The secret itself, to show it once to the person who started the server.
    pub fn reveal(&self) -> &str {
        &self.text
    }

    fn matches(&self, other: &str) -> bool {
        self.text.as_bytes().ct_eq(other.as_bytes()).into()
    }
}

/// The rules of one server.
#[derive(Debug)]
pub(in crate::sinks) struct Policy {
    local: bool,
    token: Option<Token>,
}

/// What an address may still try.
#[derive(Debug, Clone, Copy)]
pub(in crate::sinks) struct Limits {
    /// The token in the address line is one too many.
    pub(in crate::sinks) in_address: bool,
    /// Tokens of headers are not looked at.
    pub(in crate::sinks) of_headers: bool,
    /// A token was looked at, and is wrong.
    wrong: bool,
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
    pub(in crate::sinks) fn new(local: bool, token: Option<Token>) -> Self {
        Self { local, token }
    }

    /// Whether this request carries the right token.
    pub(super) fn authorised(&self, headers: &HeaderMap) -> bool {
        let Some(token) = &self.token else { return false };
        header_tokens(headers).any(|given| token.matches(given))
    }

    /// A wrong token that this request carries, in its address or its headers.
    fn wrong_token<'a>(&self, uri: &'a Uri, headers: &'a HeaderMap) -> Option<(Way, &'a str)> {
        let token = self.token.as_ref()?;
        let in_address = query_token(uri).map(|given| (Way::of_address(headers), given));
        let given = in_address.into_iter().chain(header_tokens(headers).map(|given| (Way::Header, given)));
        let mut wrong = None;
        for (way, given) in given {
            if token.matches(given) {
                return None;
            }
            wrong = Some((way, given));
        }
        wrong
    }

    /// Counts the wrong token of a request. One that comes in a way by which this address has guessed too often is not looked at: those of
    /// headers are taken away, so that what needs no token goes on.
    pub(in crate::sinks) fn limit(
        &self,
        guesses: &Guesses,
        from: IpAddr,
        uri: &Uri,
        headers: &mut HeaderMap,
    ) -> Limits {
        let of_address = guesses.locked(from, Way::of_address(headers));
        let of_headers = guesses.locked(from, Way::Header);
        if of_headers {
            for name in [header::AUTHORIZATION, header::COOKIE] {
                headers.remove(name);
            }
        }
        let wrong = self.wrong_token(uri, headers);
        // 128 bits cannot be guessed.
        let can_be_guessed = self.token.as_ref().is_some_and(|token| !token.random);
        if let Some((way, token)) = wrong.filter(|_| can_be_guessed) {
            guesses.wrong(from, way, token);
        }
        let in_address = of_address && query_token(uri).is_some();
        Limits { in_address, of_headers, wrong: wrong.is_some() }
    }

    /// Whether a viewer may open a WebSocket, with the reason where not. What holds for reading the page holds here too; beyond that a
    /// page of another site needs the token, since browsers let every page open a WebSocket to every host.
    pub(in crate::sinks) fn admits_viewer(
        &self,
        uri: &Uri,
        headers: &HeaderMap,
    ) -> Result<(), (StatusCode, &'static str)> {
        const TOKEN: &str = "a token is needed: ws://HOST:PORT/?token=TOKEN";
        if uri.path() != "/" {
            return Err((StatusCode::NOT_FOUND, "there is nothing but /"));
        }
        match self.decide(&Method::GET, uri, headers) {
            Decision::Remember(_) => Ok(()),
            Decision::Allow if self.authorised(headers) || !is_of_another_site(headers) => Ok(()),
            Decision::Allow => Err((StatusCode::FORBIDDEN, "a page of another site needs the token")),
            Decision::Unauthorised => Err((StatusCode::UNAUTHORIZED, TOKEN)),
            Decision::Refused(reason) => Err((StatusCode::FORBIDDEN, reason)),
        }
    }

    fn decide(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Decision {
        let host = host_of(headers);
        if self.local && !is_loopback_host(host) {
            return Decision::Refused("this server answers to localhost only");
        }
        // A page elsewhere may point its own name here (DNS rebinding); names of a local network it cannot have.
        if !is_local_name(host) {
            return Decision::Refused("open this page by its IP address or its name in the local network");
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

/// The tokens that a request carries in its headers.
fn header_tokens(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    let bearer = headers
        .get(header::AUTHORIZATION)
        .and_then(|v| v.to_str().ok())
        .and_then(|v| v.strip_prefix("Bearer "))
        .map(str::trim);
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|v| v.to_str().ok());
    let name = cookie_name(host_of(headers));
    let cookie = cookies
        .flat_map(|v| v.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .find_map(|(given, value)| (given == name).then_some(value));
    bearer.into_iter().chain(cookie)
}

fn host_of(headers: &HeaderMap) -> &str {
    headers.get(header::HOST).and_then(|v| v.to_str().ok()).unwrap_or_default()
}

/// The cookie of the server at this port.
fn cookie_name(host: &str) -> String {
    let port = host.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
    format!("{COOKIE}{}", port.unwrap_or(80))
}

/// What the sign-in page itself needs, and the health check: nothing of the vehicle.
fn is_public(path: &str) -> bool {
    matches!(path, "/healthz" | "/favicon.ico" | "/assets/style.css" | "/assets/icon.svg")
}

/// The name in a `Host` header, without the port.
fn name_of(host: &str) -> &str {
    match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    }
}

/// An IP address, a name without a dot, or one under a suffix that no public name has (RFC 6762, RFC 8375, ICANN's `internal`).
fn is_local_name(host: &str) -> bool {
    const LOCAL: [&str; 5] = ["local", "lan", "internal", "home.arpa", "localhost"];
    let name = name_of(host).trim_end_matches('.').to_ascii_lowercase();
    let under = |suffix: &str| name.strip_suffix(suffix).is_some_and(|rest| rest.ends_with('.'));
    let in_local_network = !name.contains('.') || LOCAL.into_iter().any(under);
    !name.is_empty() && (name.parse::<IpAddr>().is_ok() || in_local_network)
}

fn is_loopback_host(host: &str) -> bool {
    let name = name_of(host);
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Whether a page asks that is neither Foxglove's own nor of this server. Programs other than browsers name no origin, or a file. Pages on other ports of
/// this machine are anybody's.
fn is_of_another_site(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return false };
    match origin.to_str().ok().and_then(|text| text.split_once("://")) {
        Some(("http", host)) if host == host_of(headers) => false,
        Some(("https", host)) => host != "foxglove.dev" && !host.ends_with(".foxglove.dev"),
        Some(("file", _)) => false,
        _ => true,
    }
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
pub(super) async fn guard(
    State(shared): State<Arc<Shared>>,
    ConnectInfo(Visitor(address)): ConnectInfo<Visitor>,
    mut request: Request,
    next: Next,
) -> Response {
    let uri = request.uri().clone();
    let limits = shared.policy.limit(&shared.guesses, address, &uri, request.headers_mut());
    if limits.in_address {
        return too_many_guesses();
    }
    let host = host_of(request.headers()).to_owned();
    match shared.policy.decide(request.method(), request.uri(), request.headers()) {
        Decision::Allow => next.run(request).await,
        Decision::Remember(target) => remember(&shared.policy, &host, &target),
        Decision::Refused(reason) => (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response(),
        Decision::Unauthorised if limits.of_headers => too_many_guesses(),
        Decision::Unauthorised => unauthorised(request.uri().path(), limits.wrong),
    }
}

fn too_many_guesses() -> Response {
    let wait = [(header::RETRY_AFTER, "60")];
    (StatusCode::TOO_MANY_REQUESTS, wait, format!("{TOO_MANY}\n")).into_response()
}

fn remember(policy: &Policy, host: &str, target: &str) -> Response {
    let secret = policy.token.as_ref().map(Token::reveal).unwrap_or_default();
    let cookie = format!("{}={secret}; Path=/; HttpOnly; SameSite=Strict", cookie_name(host));
    (StatusCode::SEE_OTHER, [(header::LOCATION, target.to_owned()), (header::SET_COOKIE, cookie)])
        .into_response()
}

fn unauthorised(path: &str, wrong: bool) -> Response {
    const WRONG: &str = "This token is not the one that was shown where gaware was started; a new start may have made a new one.";
    let challenge = [(header::WWW_AUTHENTICATE, "Bearer")];
    if path == "/" {
        let Html(page) = assets::sign_in();
        let page = String::from_utf8_lossy(&page).into_owned();
        let page = if wrong {
            page.replacen("</form>", &format!("</form>\n    <p role=\"alert\">{WRONG}</p>"), 1)
        } else {
            page
        };
        return (StatusCode::UNAUTHORIZED, challenge, Html(page)).into_response();
    }
    if wrong {
        return (StatusCode::UNAUTHORIZED, challenge, format!("{WRONG}\n")).into_response();
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
        if !local && headers.iter().all(|(name, _)| *name != "host") {
            map.append(header::HOST, HeaderValue::from_static("192.168.1.4:8080"));
        }
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
        assert_eq!(get("/", &[("cookie", "a=b; gaware_token_8080=correct-horse-battery")]), Decision::Allow);
        assert_eq!(
            get("/", &[("cookie", "gaware_token_8080=correct-horse-batterx")]),
            Decision::Unauthorised
        );
        // The cookie of a server on another port of this host is not ours.
        assert_eq!(
            get("/", &[("cookie", "gaware_token_8081=correct-horse-battery")]),
            Decision::Unauthorised
        );
        assert_eq!(get("/healthz", &[]), Decision::Allow);
    }

    #[test]
    fn elsewhere_too_a_foreign_name_is_refused_although_it_brings_the_token() {
        let cookie =
            ("cookie", "gaware_token_80=correct-horse-battery; gaware_token_8080=correct-horse-battery");
        for (host, allowed) in [
            ("192.168.1.4:8080", true),
            ("[fe80::1]:8080", true),
            ("companion:8080", true),
            ("companion.local", true),
            ("evil.example:8080", false),
            ("evil.local.example", false),
            ("", false),
        ] {
            let origin = format!("http://{host}");
            let headers = [("host", host), ("origin", origin.as_str()), cookie];
            for method in [Method::GET, Method::POST] {
                let decision = decide(false, true, &method, "/api/v1/status", &headers);
                assert_eq!(decision == Decision::Allow, allowed, "{method} {host}");
            }
        }
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
