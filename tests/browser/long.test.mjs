// The page through a flight of a quarter of an hour, at 20 times its speed: nothing moves, nothing grows, nothing complains.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open, serve } from "./harness.mjs";

const SPEED = 20;
const FLIGHT_S = 900;
/** Stops of the flight, s: the first after half of that. */
const STOPS_S = 20;
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

/** What the page shows at each stop of the flight; it goes on only after every page has shown it, so none can miss a phase. */
const PHASES = { 50: "Fly now", 210: "Autopilot flies", 510: "No data", 610: "Waiting for GNSS", 710: "Monitoring", 850: "Done" };
/** The fixture sends nothing between these, s. */
const LOST_S = [500, 560];

/** Opens a page; gives what looks at it at one stop, and what closes it. */
async function watch(url, viewport) {
  const { page, errors, close } = await open(browser, { viewport });
  await page.addInitScript(`window.places = ${places}`);
  await page.goto(url);
  let first = null;
  let early = null;

  async function begin() {
    first = await page.evaluate(places);
    // Whatever else the title says on the way is looked at too.
    await page.evaluate(() => {
      window.phases = {};
      const title = document.querySelector("#hero-title");
      new MutationObserver(() => { window.phases[title.textContent] = window.places(); }).observe(title, { childList: true, characterData: true, subtree: true });
    });
  }

  async function look(t) {
    // Who flies comes by itself once a second: the clock may be ahead of it. While nothing is sent the clock stands still.
    const lost = t >= LOST_S[0] && t < LOST_S[1];
    await page.waitForFunction(([s, title]) => {
      const clock = document.querySelector("#clock").textContent.split(":").reduce((a, x) => 60 * a + Number(x), 0);
      return clock >= s && (title === null || document.querySelector("#hero-title").textContent === title);
    }, [lost ? 0 : t, lost ? "No data" : PHASES[t] ?? null], { polling: 50 });
    if (first === null) await begin();
    assert.deepEqual(await page.evaluate(places), first, `at ${viewport.width}, after ${t} s`);
    if (t === 310) early = await memory(page);
  }

  async function end() {
    const late = await memory(page);
    const said = `${viewport.width}: ${JSON.stringify(early)} at 310 s, ${JSON.stringify(late)} at the end`;
    assert.ok(late.heap - early.heap < 2e6, said);
    assert.ok(late.nodes - early.nodes < 600, said);
    assert.deepEqual(errors, []);
    const phases = await page.evaluate(() => window.phases);
    for (const [name, seen] of Object.entries(phases)) assert.deepEqual(seen, first, `at ${viewport.width}, ${name}`);
    await close();
  }
  return { look, end };
}

test("through 15 minutes of flight every card keeps its place and its height, and the memory stays flat", { timeout: 600000 }, async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--speed", String(SPEED), "--long", "--commands", "--stops", String(STOPS_S));
  try {
    const pages = await Promise.all(SIZES.map((viewport) => watch(server.url, viewport)));
    for (let t = STOPS_S / 2; t < FLIGHT_S; t += STOPS_S) {
      if (t >= 30) await Promise.all(pages.map((page) => page.look(t)));
      server.go();
    }
    await Promise.all(pages.map((page) => page.end()));
  } finally {
    await server.stop();
  }
});
