// The reports in a real browser: on a desktop, on a phone, on paper and without scripts.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readdirSync, rmSync, statSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { after, before, test } from "node:test";
import { faults, launch, open } from "./harness.mjs";

const ROOT = new URL("../../", import.meta.url).pathname;
const FLIGHTS = process.env.GAWARE_FLIGHTS ?? join(ROOT, "../shared/data");
const SMALL = join(ROOT, "tests/data/small_gsens_typical_dither.tlog");
/** Recordings of vehicles with rotors, and of one under water: no maneuver of a fixed wing may be named. */
const NO_WING = /copter|px4_sample|qdr|sub_bench/;
// The small recordings of this repository; with EVERY_FLIGHT=REGEX all with such a name (`.` for every one), by explain those of
// less than EXPLAIN_MB (5). REPORTS=FOLDER keeps the pages there, and takes those that are there already.
const every = process.env.EVERY_FLIGHT ? readdirSync(FLIGHTS).filter((name) => !/\.(md|json|toml)$/.test(name) && new RegExp(process.env.EVERY_FLIGHT).test(name)) : [];
const some = ["real_copter_sample.BIN", "real_px4_sample.ulg", "qdr_p4rtk_xsensdot", "independent_stand_20min.tlog", "independent_stand_20min_then_flight.tlog"];
const logs = [SMALL, ...(every.length > 0 ? every : some).map((name) => join(FLIGHTS, name))].filter(existsSync);
/** Two flights with the innovations of the autopilot's own filter. */
const COMPARED = ["sitl_clean_dither.tlog", "sitl_gsens_typical_dither.tlog"].map((name) => join(FLIGHTS, name)).filter(existsSync);
/** A flight with several unmodelled effects. */
const SEVERAL = join(FLIGHTS, "real_px4plane_swiss.tlog");
const JOBS = [
  ...logs.map((log) => ["report", log]),
  ...(every.length > 0 ? logs.filter((log) => statSync(log).size < 1e6 * Number(process.env.EXPLAIN_MB ?? 5)) : [SMALL, SEVERAL].filter(existsSync)).map((log) => ["explain", log]),
];
const kept = process.env.REPORTS;
const folder = kept ?? mkdtempSync(join(tmpdir(), "gaware-reports-"));
const program = (...words) => execFileSync(process.env.GAWARE, words, { stdio: ["ignore", "ignore", "inherit"] });
let browser;
/** Of recordings. */
let reports;
/** And every other page that the program writes without a server. */
let pages;
before(async () => {
  browser = await launch();
  mkdirSync(folder, { recursive: true });
  reports = JOBS.map(([command, log]) => {
    const out = join(folder, `${command}-${basename(log)}${command === "report" ? ".html" : ""}`);
    const page = command === "report" ? out : join(out, "report.html");
    if (!existsSync(page)) program(command, log, "--out", out);
    return { name: `${command} ${log}`, rotor: NO_WING.test(log), url: `file://${page}` };
  });
  const others = { demo: ["demo", "--headless", "--speed", "max"], ...(COMPARED.length === 2 ? { compare: ["compare", ...COMPARED] } : {}) };
  pages = [...reports, ...Object.entries(others).map(([name, words]) => {
    const out = join(folder, `${name}.html`);
    program(...words, "--force", "--report", out);
    return { name, url: `file://${out}` };
  })];
});
after(async () => {
  await browser.close();
  if (!kept) rmSync(folder, { recursive: true });
});

test("at 1280 and at 390 pixels and on paper nothing overflows, nothing overlaps, every label can be read", async () => {
  // A4 with Chromium's margins is 718 px wide.
  for (const { name, url } of pages) {
    for (const [width, media] of [[1280, "screen"], [390, "screen"], [718, "print"]]) {
      const { page, errors, close } = await open(browser, { viewport: { width: media === "print" ? 1280 : width, height: 844 } });
      await page.goto(url);
      await page.emulateMedia({ media });
      if (media === "print") await page.setViewportSize({ width, height: 844 });
      const found = await page.evaluate(faults);
      assert.ok(found.scroll <= 0, `${name} at ${width}: ${found.scroll} px wider`);
      assert.deepEqual({ ...found, scroll: 0 }, { scroll: 0, wide: [], small: [], over: 0, raw: null, plots: 0, cut: [] }, `${name} at ${width}`);
      assert.deepEqual(errors.filter((e) => !e.startsWith("asked for file:")), []);
      await close();
    }
  }
});

test("a report of a vehicle without wings names no maneuver of an aircraft, and one with wings does", async () => {
  const words = /throttle|rudder|aileron|sideslip|wings level|stall/i;
  let wings = 0;
  for (const { name, rotor, url } of reports) {
    const { page, close } = await open(browser, {});
    await page.goto(url);
    const text = await page.evaluate(() => document.body.innerText);
    if (rotor) assert.doesNotMatch(text, words, name);
    else wings += words.test(text) ? 1 : 0;
    await close();
  }
  assert.ok(wings > 0, "the words are looked for in vain everywhere");
});

test("several effects are on the first screen with size, consequence and remedy", async () => {
  let several = 0;
  for (const { name, url } of reports.filter((r) => r.name.startsWith("explain"))) {
    const { page, close } = await open(browser, { viewport: { width: 1280, height: 900 } });
    await page.goto(url);
    const found = await page.evaluate(() => [...document.querySelectorAll(".effects tr")].slice(1).map((row) => ({
      bottom: row.getBoundingClientRect().bottom,
      empty: [0, 1, 3].filter((k) => row.cells[k].innerText.trim() === ""),
    })));
    several += found.length >= 3 ? 1 : 0;
    for (const row of found) assert.ok(row.bottom <= 900, `${name}: a row ends at ${row.bottom}`);
    assert.deepEqual(found.flatMap((row) => row.empty), [], name);
    await close();
  }
  if (existsSync(SEVERAL)) assert.ok(several > 0, "no flight has three effects");
});

test("the plots of a report share time axis and zoom, and their data can be taken away", async () => {
  const { page, close } = await open(browser, { viewport: { width: 1280, height: 900 } });
  await page.goto(reports[0].url);
  const over = page.locator(".uplot .u-over").first();
  const axis = (k) => page.evaluate((i) => document.querySelectorAll(".uplot canvas")[i].toDataURL(), k);
  const before = await axis(3);
  await over.scrollIntoViewIfNeeded();
  const box = await over.boundingBox();
  await page.mouse.move(box.x + box.width * 0.3, box.y + 40);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.6, box.y + 40, { steps: 4 });
  await page.mouse.up();
  await page.waitForFunction(([i, was]) => document.querySelectorAll(".uplot canvas")[i].toDataURL() !== was, [3, before]);
  const csv = await page.evaluate(() => decodeURIComponent(document.querySelector("a.csv").href.split(",").slice(1).join(",")));
  assert.match(csv, /^time_s,[a-z_]+\n[0-9.]+,[-0-9.]+\n/);
  await close();
});

test("without scripts and on paper there is a drawing of every plot", async () => {
  const { page, close } = await open(browser, { javaScriptEnabled: false });
  await page.goto(reports[0].url);
  assert.ok(await page.locator("figure.chart").count() >= 8);
  assert.equal(await page.locator("figure.chart .area > svg polyline").count() > 0, true);
  assert.equal(await page.locator("figure.chart .area:not(:has(> svg))").count(), 0);
  await close();
  const printed = await open(browser, {});
  await printed.page.goto(reports[0].url);
  assert.ok((await printed.page.pdf({ format: "A4" })).length > 50000);
  await printed.close();
});
