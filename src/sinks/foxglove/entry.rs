//! Which connections become viewers: token, host and origin as for the web page, a protocol that both know, and a free place.

use super::protocol::SUBPROTOCOLS;
use crate::sinks::web::access::{Policy, TOO_MANY, Token};
use crate::sinks::web::door::{Place, Places};
use crate::sinks::web::guesses::Guesses;
use axum::http::header::{HeaderMap, HeaderValue, SEC_WEBSOCKET_PROTOCOL};
use axum::http::{StatusCode, Uri};
use std::net::IpAddr;
use std::sync::Arc;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};

/// Viewers at the same time, in all and from one address.
const VIEWERS: (usize, usize) = (8, 8);

/// The rules of one server.
#[derive(Debug)]
pub(super) struct Entry {
    policy: Policy,
    guesses: Guesses,
    places: Arc<Places>,
}

/// Why a connection does not become a viewer's.
type Refusal = (StatusCode, &'static str);

impl Entry {
    pub(super) fn new(local: bool, token: Option<Token>) -> Self {
        Self {
            policy: Policy::new(local, token),
            guesses: Guesses::default(),
            places: Places::new(VIEWERS.0, VIEWERS.1),
        }
    }

    /// A place and the answer for who may come in, otherwise the reason.
    #[expect(clippy::result_large_err, reason = "the library's own type of an answer")]
    pub(super) fn answer(
        &self,
        from: IpAddr,
        request: &Request,
        mut response: Response,
    ) -> Result<(Response, Place), ErrorResponse> {
        match self.admit(from, request.uri(), request.headers()) {
            Ok((protocol, place)) => {
                response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(protocol));
                Ok((response, place))
            }
            Err((status, reason)) => {
                let mut refusal = ErrorResponse::new(Some(format!("{reason}\n")));
                *refusal.status_mut() = status;
                Err(refusal)
            }
        }
    }

    fn admit(&self, from: IpAddr, uri: &Uri, headers: &HeaderMap) -> Result<(&'static str, Place), Refusal> {
        let mut headers = headers.clone();
        let limits = self.policy.limit(&self.guesses, from, uri, &mut headers);
        match self.policy.admits_viewer(uri, &headers) {
            _ if limits.in_address => return Err((StatusCode::TOO_MANY_REQUESTS, TOO_MANY)),
            Err((StatusCode::UNAUTHORIZED, _)) if limits.of_headers => {
                return Err((StatusCode::TOO_MANY_REQUESTS, TOO_MANY));
            }
            admitted => admitted?,
        }
        let protocol = protocol_of(&headers).ok_or((
            StatusCode::BAD_REQUEST,
            "this server speaks foxglove.sdk.v1 and foxglove.websocket.v1",
        ))?;
        let place = self.places.take(from).ok_or((StatusCode::SERVICE_UNAVAILABLE, "too many viewers"))?;
        Ok((protocol, place))
    }
}

/// The best of the protocols that a viewer names.
fn protocol_of(headers: &HeaderMap) -> Option<&'static str> {
    let named = headers.get_all(SEC_WEBSOCKET_PROTOCOL).iter().filter_map(|v| v.to_str().ok());
    let named: Vec<&str> = named.flat_map(|v| v.split(',')).map(str::trim).collect();
    SUBPROTOCOLS.into_iter().find(|own| named.contains(own))
}
