// Foxglove's own client (@foxglove/ws-protocol): subscribes to every channel and prints what comes, one JSON document a line.

import * as official from "@foxglove/schemas/jsonschema.js";
import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";

const { FoxgloveClient } = protocol;
const client = new FoxgloveClient({ ws: new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
const channels = new Map();
const say = (value) => process.stdout.write(`${JSON.stringify(value)}\n`);

// The schemas that Foxglove publishes, for its own types.
say({ official: Object.fromEntries(["FrameTransform", "LocationFix", "Log", "PoseInFrame"].map((name) => [`foxglove.${name}`, official[name]])) });

client.on("serverInfo", (info) => say({ info }));
client.on("status", (status) => say({ status }));
client.on("error", (error) => say({ error: String(error.message ?? error) }));
client.on("close", () => {
  say({ closed: true });
  process.exit(0);
});
client.on("advertise", (all) => {
  for (const channel of all) channels.set(client.subscribe(channel.id), channel);
  say({ advertise: all });
});
client.on("unadvertise", (ids) => say({ unadvertise: ids }));
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic } = channels.get(subscriptionId);
  say({ topic, t_ns: String(timestamp), text: new TextDecoder().decode(data) });
});
