//! The page that analyses logs in the browser, from this machine: the file that web/build makes, and the script that keeps it for later.
//! Nothing is received but the two requests; logs stay in the browser.

use super::{WebError, serve_until};
use axum::Router;
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use bytes::Bytes;
use sha2::{Digest, Sha256};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

const KEEPER: &str = include_str!("../../../web/page/sw.js");

/// Serves until `shutdown`.
///
/// # Errors
/// When the socket fails.
pub async fn serve(
    listener: TcpListener,
    page: Vec<u8>,
    shutdown: CancellationToken,
) -> Result<(), WebError> {
    serve_until(listener, router(page), &shutdown).await
}

/// The server without its socket.
pub fn router(page: Vec<u8>) -> Router {
    let tag = format!("\"{}\"", crate::outputs::mark::hex(&Sha256::digest(&page)));
    let page = Bytes::from(page);
    let shown = move |headers: HeaderMap| {
        let (page, tag) = (page.clone(), tag.clone());
        async move {
            let known = headers.get(header::IF_NONE_MATCH).is_some_and(|v| v.as_bytes() == tag.as_bytes());
            let tag = [(header::ETAG, tag)];
            if known {
                return (StatusCode::NOT_MODIFIED, tag).into_response();
            }
            (tag, [(header::CONTENT_TYPE, "text/html; charset=utf-8")], page).into_response()
        }
    };
    Router::new()
        .route("/", get(shown))
        .route(
            "/sw.js",
            get(|| async { ([(header::CONTENT_TYPE, "text/javascript; charset=utf-8")], KEEPER) }),
        )
        .layer(middleware::map_response(headers))
}

/// The page's own policy stands in the page; a server adds what only a header can say.
async fn headers(mut response: Response) -> Response {
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, "frame-ancestors 'none'; connect-src 'self'"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-cache"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}
