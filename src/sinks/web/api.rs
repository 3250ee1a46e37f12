//! The HTTP interface besides the event stream.

use super::Shared;
use crate::engine::snapshot::Snapshot;
use crate::sinks::metrics;
use crate::sinks::status::{MissionState, StatusView};
use crate::sinks::{Change, Request};
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

/// How long a change may take before the page is informed that no one knows; the transfer itself gives up earlier.
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
    parameters_apply: bool,
}

pub(super) async fn capabilities(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
) -> Json<Capabilities> {
    let open = shared.state.commands.as_ref().is_some_and(|c| !c.is_closed());
    let parameters = shared.state.status.parameters().state != MissionState::None;
    let mission = !parameters || shared.state.status.mission().state != MissionState::None;
    Json(Capabilities {
        version: env!("CARGO_PKG_VERSION"),
        authorised: shared.policy.authorised(&headers),
        mission_upload: open && mission,
        parameters_apply: open && parameters,
    })
}

/// The explicit confirmation without which nothing is changed.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Confirmation {
    confirm: bool,
}

type Body = Result<Json<Confirmation>, JsonRejection>;

pub(super) async fn upload_mission(State(shared): State<Arc<Shared>>, body: Body) -> Response {
    carry_out(&shared, Change::Mission, body).await
}

pub(super) async fn apply_parameters(State(shared): State<Arc<Shared>>, body: Body) -> Response {
    carry_out(&shared, Change::Parameters, body).await
}

async fn carry_out(shared: &Shared, change: Change, body: Body) -> Response {
    let of_vehicle = match change {
        Change::Mission => "mission",
        Change::Parameters => "parameters",
    };
    let confirmed = body.is_ok_and(|Json(c)| c.confirm);
    if !confirmed {
        return say(StatusCode::BAD_REQUEST, "nothing is changed without the body {\"confirm\": true}");
    }
    let (reply, answer) = oneshot::channel();
    let sent = shared.state.commands.as_ref().map(|c| c.try_send(Request { change, reply }));
    if !matches!(sent, Some(Ok(()))) {
        let text = format!("nothing here can change the vehicle's {of_vehicle} now");
        return say(StatusCode::SERVICE_UNAVAILABLE, &text);
    }
    match tokio::time::timeout(UPLOAD_LIMIT, answer).await {
        Ok(Ok(Ok(text))) => say(StatusCode::OK, &text),
        Ok(Ok(Err(text))) => say(StatusCode::CONFLICT, &text),
        Ok(Err(_)) => {
            let text = format!("the change was abandoned; check the vehicle's {of_vehicle}");
            say(StatusCode::SERVICE_UNAVAILABLE, &text)
        }
        Err(_) => {
            let text = format!("no result yet; check the vehicle's {of_vehicle}");
            say(StatusCode::GATEWAY_TIMEOUT, &text)
        }
    }
}

fn say(status: StatusCode, message: &str) -> Response {
    (status, Json(serde_json::json!({ "message": message }))).into_response()
}
