//! The protocol's words, without sockets: what the server says, and what a viewer's text asks for.
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>

use super::LiveMessage;
use crate::sinks::messages::TopicChannel;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;

/// Names of the protocol that the server answers to, the preferred one first.
pub(super) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// First byte of a message of a channel.
const MESSAGE_DATA: u8 = 1;

/// What a viewer asks for.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(super) enum Ask {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    /// Part of the protocol or of a later one, and not offered.
    #[serde(other)]
    Unsupported,
}

/// A channel under the number that the viewer has chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Subscription {
    id: u32,
    channel_id: u32,
}

/// A channel as it is advertised.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Advertised<'a> {
    id: u32,
    topic: &'a str,
    encoding: &'a str,
    schema_name: &'a str,
    schema: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    schema_encoding: Option<&'a str>,
}

/// Who serves: nothing can be changed through it.
pub(super) fn server_info(session: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": concat!("gaware ", env!("CARGO_PKG_VERSION")),
        "capabilities": [],
        "supportedEncodings": [],
        "metadata": {},
        "sessionId": session,
    })
    .to_string()
}

/// Channels that are new to a viewer.
pub(super) fn advertise<'a>(channels: impl Iterator<Item = (&'a u32, &'a TopicChannel)>) -> String {
    let channels: Vec<_> = channels
        .map(|(id, channel)| Advertised {
            id: *id,
            topic: &channel.topic,
            encoding: channel.encoding,
            schema_name: channel.schema.as_ref().map_or("", |s| s.name),
            schema: channel.schema.as_ref().map_or("", |s| &s.text),
            schema_encoding: channel.schema.as_ref().map(|_| "jsonschema"),
        })
        .collect();
    json!({"op": "advertise", "channels": channels}).to_string()
}

/// Channels that are no more.
pub(super) fn unadvertise(ids: &[u32]) -> String {
    json!({"op": "unadvertise", "channelIds": ids}).to_string()
}

/// What was wrong with a request that could be read.
pub(super) fn warning(text: &str) -> String {
    json!({"op": "status", "level": 1, "message": text}).to_string()
}

/// A message of a channel under the viewer's number.
pub(super) fn message_data(subscription: u32, message: &LiveMessage) -> Vec<u8> {
    let mut out = Vec::with_capacity(13 + message.data.len());
    out.push(MESSAGE_DATA);
    out.extend(subscription.to_le_bytes());
    out.extend(message.t_ns.to_le_bytes());
    out.extend_from_slice(&message.data);
    out
}

/// What one viewer has subscribed to: its number by channel.
#[derive(Debug, Default)]
pub(super) struct Subscriptions(BTreeMap<u32, u32>);

impl Subscriptions {
    /// The viewer's number of a channel, where it wants it.
    pub(super) fn of(&self, channel: u32) -> Option<u32> {
        self.0.get(&channel).copied()
    }

    /// Forgets a channel that is no more.
    pub(super) fn forget(&mut self, channel: u32) {
        self.0.remove(&channel);
    }

    /// Does what is asked; gives a warning for each part that cannot be done. `is_offered` says which channels there are, so a viewer
    /// never has more subscriptions than there are channels.
    pub(super) fn ask(&mut self, ask: Ask, is_offered: impl Fn(u32) -> bool) -> Vec<String> {
        let mut warnings = Vec::new();
        match ask {
            Ask::Subscribe { subscriptions } => {
                for Subscription { id, channel_id } in subscriptions {
                    if !is_offered(channel_id) {
                        warnings.push(format!("there is no channel {channel_id}"));
                    } else if self.0.contains_key(&channel_id) {
                        warnings.push(format!("channel {channel_id} is subscribed to already"));
                    } else if self.0.values().any(|taken| *taken == id) {
                        warnings.push(format!("subscription {id} exists already"));
                    } else {
                        self.0.insert(channel_id, id);
                    }
                }
            }
            Ask::Unsubscribe { subscription_ids } => {
                for id in subscription_ids {
                    let before = self.0.len();
                    self.0.retain(|_, own| *own != id);
                    if self.0.len() == before {
                        warnings.push(format!("there is no subscription {id}"));
                    }
                }
            }
            Ask::Unsupported => {
                warnings.push("gaware only sends: nothing can be published, set or called".to_owned());
            }
        }
        warnings
    }
}
