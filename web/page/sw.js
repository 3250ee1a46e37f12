// Keeps the page for when there is no network. With one, a new version of it shows at once. Brings a log that the page's address names, of this server.
"use strict";
const NAME = "gaware";
const PAGE = new URL("./", location.href).href;

async function fresh() {
  const response = await fetch(PAGE, { cache: "no-cache" });
  if (response.ok) await (await caches.open(NAME)).put(PAGE, response.clone());
  return response;
}

addEventListener("install", (event) => event.waitUntil(fresh().then(() => skipWaiting())));
addEventListener("activate", (event) => event.waitUntil(clients.claim()));
addEventListener("fetch", (event) => {
  if (event.request.mode !== "navigate") return;
  event.respondWith(fresh().catch(async () => (await caches.match(PAGE)) ?? Response.error()));
});

addEventListener("message", (event) => event.waitUntil(bring(event.data.url, event.ports[0])));

async function bring(url, port) {
  try {
    const response = await fetch(url, { mode: "same-origin" });
    port.postMessage(response.ok ? { content: await response.blob() } : { failed: `the server answers ${response.status}` });
  } catch {
    port.postMessage({ failed: "the server gives it from elsewhere or not at all" });
  }
}
