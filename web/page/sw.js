// Keeps the page for when there is no network. With one, a new version of it shows at once.
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
