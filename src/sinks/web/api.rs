//! The HTTP interface besides the event stream.

use super::Shared;
use crate::engine::snapshot::Snapshot;
use crate::sinks::Request;
use crate::sinks::metrics;
use crate::sinks::status::StatusView;
use axum::Json;
use axum::extract::rejection::JsonRejection;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;

/// How long an upload may take before the page is informed that no one knows; the transfer itself gives up earlier.
const UPLOAD_LIMIT: Duration = Duration::from_secs(120);

pub(super) async fn health() -> &'static str {
    "ok\n"
}

pub(super) async fn status(State(shared): State<Arc<Shared>>) -> Response {
    let snapshot = Arc::clone(&shared.state.snapshots.borrow());
    Json(snapshot.as_ref()).into_response()
}

pub(super) async fn sinks(State(shared): State<Arc<Shared>>) -> Json<StatusView> {
    Json(shared.state.status.view())
}

pub(super) async fn route(State(shared): State<Arc<Shared>>) -> Response {
    Json(shared.state.status.route().as_ref()).into_response()
}

/// What of the history is wanted.
#[derive(Debug, Deserialize)]
pub(super) struct Wanted {
    /// Newest points at most; all without it.
    points: Option<usize>,
}

pub(super) async fn history(State(shared): State<Arc<Shared>>, Query(wanted): Query<Wanted>) -> Response {
    let history = shared.history.lock().unwrap_or_else(PoisonError::into_inner).newest(wanted.points);
    Json(history).into_response()
}

pub(super) async fn schema() -> Json<schemars::Schema> {
    Json(schemars::schema_for!(Snapshot))
}

pub(super) async fn metrics(State(shared): State<Arc<Shared>>) -> Response {
    let snapshot = Arc::clone(&shared.state.snapshots.borrow());
    let text = metrics::render(&snapshot, &shared.state.status.view());
    ([(header::CONTENT_TYPE, metrics::CONTENT_TYPE)], text).into_response()
}

/// What this page may do.
#[derive(Debug, Serialize)]
pub(super) struct Capabilities {
    version: &'static str,
    authorised: bool,
    mission_upload: bool,
}

pub(super) async fn capabilities(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
) -> Json<Capabilities> {
    Json(Capabilities {
        version: env!("CARGO_PKG_VERSION"),
        authorised: shared.policy.authorised(&headers),
        mission_upload: shared.state.commands.as_ref().is_some_and(|c| !c.is_closed()),
    })
}

/// The explicit confirmation without which nothing is uploaded.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Confirmation {
    confirm: bool,
}

pub(super) async fn upload_mission(
    State(shared): State<Arc<Shared>>,
    body: Result<Json<Confirmation>, JsonRejection>,
) -> Response {
    let confirmed = body.is_ok_and(|Json(c)| c.confirm);
    if !confirmed {
        return say(StatusCode::BAD_REQUEST, "an upload needs the body {\"confirm\": true}");
    }
    let (reply, answer) = oneshot::channel();
    let sent = shared.state.commands.as_ref().map(|c| c.try_send(Request::UploadMission { reply }));
    if !matches!(sent, Some(Ok(()))) {
        return say(StatusCode::SERVICE_UNAVAILABLE, "nothing here can upload a mission now");
    }
    match tokio::time::timeout(UPLOAD_LIMIT, answer).await {
        Ok(Ok(Ok(text))) => say(StatusCode::OK, &text),
        Ok(Ok(Err(text))) => say(StatusCode::CONFLICT, &text),
        Ok(Err(_)) => {
            say(StatusCode::SERVICE_UNAVAILABLE, "the upload was abandoned; check the vehicle's mission")
        }
        Err(_) => say(StatusCode::GATEWAY_TIMEOUT, "no result yet; check the vehicle's mission"),
    }
}

fn say(status: StatusCode, message: &str) -> Response {
    (status, Json(serde_json::json!({ "message": message }))).into_response()
}
