// The page through a flight of a quarter of an hour, at 20 times its speed: nothing moves, nothing grows, nothing complains.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open, serve } from "./harness.mjs";

const SPEED = 20;
const FLIGHT_S = 900;
const SIZES = [{ width: 1280, height: 900 }, { width: 1920, height: 1080 }, { width: 390, height: 844 }];
let browser;
before(async () => { browser = await launch(); });
after(() => browser.close());

/** Place and size of everything that must stay where it is, to the pixel, and the height of the page. */
function places() {
  const out = { page: [document.documentElement.scrollWidth, document.documentElement.scrollHeight] };
  for (const element of document.querySelectorAll("header, .card, .card > h2, .chip, .box, canvas, .cell, .foot, .who, #track")) {
    if (element.closest(".u-legend") || element.closest("dialog")) continue;
    const { left, top, width, height } = element.getBoundingClientRect();
    const key = `${element.tagName}.${element.className}#${element.id}`;
    (out[key] ??= []).push([left, top + window.scrollY, width, height].map((v) => Math.round(v * 100) / 100).join(" "));
  }
  return out;
}

async function memory(page) {
  const cdp = await page.context().newCDPSession(page);
  await cdp.send("HeapProfiler.collectGarbage");
  await cdp.send("Performance.enable");
  const { metrics } = await cdp.send("Performance.getMetrics");
  await cdp.detach();
  const of = (name) => metrics.find((m) => m.name === name).value;
  return { heap: of("JSHeapUsedSize"), nodes: of("Nodes") };
}

/** Watches one page to the end of the flight. */
async function watch(url, viewport) {
  const { page, errors, close } = await open(browser, { viewport });
  await page.addInitScript(`window.places = ${places}`);
  await page.goto(url);
  const clock = () => page.evaluate(() => document.querySelector("#clock").textContent.split(":").reduce((s, x) => 60 * s + Number(x), 0));
  const reached = (t) => page.waitForFunction((s) => document.querySelector("#clock").textContent.split(":").reduce((a, x) => 60 * a + Number(x), 0) >= s, t, { timeout: 120000, polling: 100 });
  await reached(30);
  const first = await page.evaluate(places);
  // Each phase of the page is looked at as it comes: some are short.
  await page.evaluate(() => {
    window.phases = {};
    const title = document.querySelector("#hero-title");
    new MutationObserver(() => { window.phases[title.textContent] = window.places(); }).observe(title, { childList: true, characterData: true, subtree: true });
  });
  let early = null;
  for (let t = 40; t < FLIGHT_S; t += 20) {
    await reached(t);
    assert.deepEqual(await page.evaluate(places), first, `at ${viewport.width}, after ${await clock()} s`);
    if (early === null && t >= 300) early = await memory(page);
  }
  const late = await memory(page);
  const said = `${viewport.width}: ${JSON.stringify(early)} at 300 s, ${JSON.stringify(late)} at the end`;
  assert.ok(late.heap - early.heap < 2e6, said);
  assert.ok(late.nodes - early.nodes < 600, said);
  assert.deepEqual(errors, []);
  const phases = await page.evaluate(() => window.phases);
  for (const name of ["Fly now", "Autopilot flies", "No data", "Waiting for GNSS", "Monitoring", "Done"]) {
    assert.deepEqual(phases[name], first, `at ${viewport.width}, ${name}`);
  }
  await close();
}

test("through 15 minutes of flight every card keeps its place and its height, and the memory stays flat", { timeout: 120000 }, async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--speed", String(SPEED), "--long", "--commands");
  try {
    await Promise.all(SIZES.map((viewport) => watch(server.url, viewport)));
  } finally {
    await server.stop();
  }
});
