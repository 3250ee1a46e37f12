//! The page's files, embedded in the binary: plain HTML, CSS and JavaScript modules, no build step.

use crate::outputs::mark::hex;
use axum::extract::Path;
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::response::{Html, IntoResponse, Response};
use rust_embed::RustEmbed;

#[derive(RustEmbed)]
#[folder = "src/sinks/web/assets/"]
struct Assets;

/// The page.
pub(super) async fn index(headers: HeaderMap) -> Response {
    file("index.html", &headers)
}

/// A file of the page.
pub(super) async fn asset(Path(path): Path<String>, headers: HeaderMap) -> Response {
    file(&path, &headers)
}

/// The icon, for browsers that ask for it by its old name.
pub(super) async fn icon(headers: HeaderMap) -> Response {
    file("icon.svg", &headers)
}

/// The page that asks for the token.
pub(super) fn sign_in() -> Html<Vec<u8>> {
    Html(Assets::get("sign-in.html").map(|f| f.data.into_owned()).unwrap_or_default())
}

fn file(path: &str, request: &HeaderMap) -> Response {
    let Some(file) = Assets::get(path) else {
        return (StatusCode::NOT_FOUND, "no such file\n").into_response();
    };
    // A new version of gaware must show at once, an old one must not be sent again and again over a slow radio.
    let tag = format!("\"{}\"", hex(&file.metadata.sha256_hash()[..16]));
    let caching = [(header::ETAG, tag.clone()), (header::CACHE_CONTROL, "no-cache".to_owned())];
    if request.get(header::IF_NONE_MATCH).is_some_and(|v| v.as_bytes() == tag.as_bytes()) {
        return (StatusCode::NOT_MODIFIED, caching).into_response();
    }
    (caching, [(header::CONTENT_TYPE, content_type(path))], file.data.into_owned()).into_response()
}

fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("txt") => "text/plain; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}
