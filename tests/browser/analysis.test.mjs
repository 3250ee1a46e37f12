// The page that analyses logs in the browser: the same results as the program, no request, no network, and nothing that a file can do to it.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { createServer } from "node:http";
import { mkdtempSync, readFileSync, rmSync, truncateSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";
import { differences, faults, launch, open } from "./harness.mjs";

const ROOT = new URL("../../", import.meta.url).pathname;
const FLIGHTS = process.env.GAWARE_FLIGHTS ?? join(ROOT, "../shared/data");
const PAGE = process.env.ANALYSIS;
const SMALL = join(ROOT, "tests/data/small_gsens_typical_dither.tlog");
/** Each format and both autopilots; LOGS=a,b takes others. */
const LOGS = [SMALL, ...(process.env.LOGS?.split(",") ?? ["independent_gsens_consumer.tlog", "real_copter_sample.BIN", "real_ardusub_bench.tlog", "real_px4_ekf_failure.ulg", "real_px4_sample.ulg", "px4_plane_strong_noise.mcap"]).map((name) => join(FLIGHTS, name))];

const folder = mkdtempSync(join(tmpdir(), "gaware-analysis-"));
let browser;
before(async () => { browser = await launch(); });
after(async () => {
  await browser.close();
  rmSync(folder, { recursive: true });
});

/** The page from the disk, with what it complains of; other tests open it elsewhere. */
async function fromDisk(options) {
  const opened = await open(browser, options);
  await opened.page.goto(`file://${PAGE}`);
  opened.complaints = () => opened.errors.filter((e) => e !== `asked for file://${PAGE}` && !e.startsWith("asked for blob:"));
  return opened;
}

/** Chooses files for a command, those of before taken away; waits for its end. The sentence where it failed. */
async function run(page, command, files) {
  await page.evaluate(() => document.querySelectorAll("#chosen button, .result header button").forEach((button) => button.click()));
  await page.setInputFiles("#files", files);
  await page.click(`#${command}`);
  await page.waitForFunction(() => document.querySelector(".result") || !document.getElementById("trouble").hidden, null, { timeout: 600000 });
  return page.textContent("#trouble");
}

/** A file of the result, as the user saves it. */
async function saved(page, ending) {
  const [download] = await Promise.all([page.waitForEvent("download"), page.click(`.result a[download$="${ending}"]`)]);
  return readFileSync(await download.path(), "utf8");
}

function native(...args) {
  return execFileSync(process.env.GAWARE, args, { stdio: ["ignore", "pipe", "ignore"], maxBuffer: 1 << 30 }).toString();
}

test("the results of recordings of every format are those of the program", async () => {
  const { page, complaints, close } = await fromDisk();
  for (const log of LOGS) {
    assert.equal(await run(page, "report", log), "", log);
    const ours = JSON.parse(await saved(page, ".json"));
    // What a report adds to the summary of a replay: compasses, barometers, airspeed.
    delete ours.compasses;
    delete ours.air;
    assert.deepEqual(differences(ours, JSON.parse(native("replay", log, "--json"))), [], log);
  }
  assert.deepEqual(complaints(), []);
  await close();
});

test("an explanation names the same effects with the same values, and its files are marked as this program's own", async () => {
  const { page, complaints, close } = await fromDisk();
  assert.equal(await run(page, "explain", SMALL), "");
  const ours = JSON.parse(await saved(page, "report.json"));
  const out = join(folder, "explained");
  const theirs = JSON.parse(native("explain", SMALL, "--json", "--out", out));
  assert.deepEqual(differences(ours, theirs), []);
  for (const file of ["model.toml", "autopilot.param"]) writeFileSync(join(out, file), await saved(page, file));
  // Both are as gaware writes them: it overwrites them unasked.
  native("explain", SMALL, "--json", "--out", out);
  assert.deepEqual(complaints(), []);
  await close();
});

test("a report shows its plots and has no rights over the page, at 1280 and at 390 pixels, and opens alone", async () => {
  for (const width of [1280, 390]) {
    const { page, complaints, close } = await fromDisk({ viewport: { width, height: 844 } });
    assert.equal(await run(page, "report", SMALL), "");
    const frame = page.frameLocator(".result iframe");
    await frame.locator(".chart.live canvas").first().waitFor();
    assert.equal(await page.getAttribute(".result iframe", "sandbox"), "allow-scripts allow-downloads");
    const found = await page.evaluate(faults);
    assert.ok(found.scroll <= 0, `${found.scroll} px wider than ${width}`);
    assert.deepEqual(found.small, []);
    const [alone] = await Promise.all([page.context().waitForEvent("page"), page.click("text=Open the report alone")]);
    await alone.locator(".chart.live canvas").first().waitFor();
    assert.deepEqual(complaints(), []);
    await close();
  }
});

test("two flights are compared, a job can be stopped, and another one starts", async () => {
  const { page, complaints, close } = await fromDisk();
  // A log of the autopilot's own filter; the small recordings have none. Beside itself every ratio is one.
  const flights = Array(2).fill(join(FLIGHTS, "real_px4_ekf_failure.ulg"));
  assert.equal(await run(page, "compare", flights), "");
  const theirs = JSON.parse(native("compare", ...flights, "--json"));
  assert.ok(theirs.rows.length > 10);
  assert.deepEqual(differences(JSON.parse(await saved(page, ".json")), theirs), []);
  await page.evaluate(() => document.querySelectorAll("#chosen button").forEach((button) => button.click()));
  await page.setInputFiles("#files", SMALL);
  await page.click("#explain");
  await page.waitForFunction(() => /step 2/.test(document.getElementById("doing").textContent));
  await page.click("#stop");
  await page.locator("#work").waitFor({ state: "hidden" });
  assert.equal(await run(page, "report", SMALL), "");
  assert.deepEqual(complaints(), []);
  await close();
});

test("logs of a fleet are what the program makes of them, and one that cannot be read is named", async () => {
  const { page, complaints, close } = await fromDisk({ viewport: { width: 390, height: 844 } });
  const half = join(folder, "half.tlog");
  writeFileSync(half, readFileSync(SMALL).subarray(0, 300000));
  const bad = join(folder, "bad.bin");
  writeFileSync(bad, "no log");
  const logs = [SMALL, half, bad];
  assert.equal(await run(page, "fleet", logs), "");
  const out = join(folder, "fleet");
  native("fleet", ...logs, "--out", out);
  const theirs = JSON.parse(native("fleet", "report", out, "--json"));
  assert.deepEqual(differences(JSON.parse(await saved(page, ".json")), theirs), []);
  const shown = await page.frameLocator(".result iframe").locator("body").textContent();
  assert.match(shown, /bad\.bin/);
  assert.ok((await page.evaluate(faults)).scroll <= 0);
  assert.deepEqual(complaints(), []);
  await close();
});

test("a folder's logs are taken by their paths, and nothing else of it", async () => {
  const { page, close } = await fromDisk();
  const taken = await page.evaluate(async () => {
    const file = (fullPath) => ({ isFile: true, name: fullPath.split("/").at(-1), fullPath, file: (done) => done(new File(["x"], fullPath)) });
    const directory = (fullPath, inner) => ({ fullPath, createReader: () => ({ readEntries: (done) => done(inner.splice(0, 1)) }) });
    const tree = directory("/day", [file("/day/a.BIN"), file("/day/notes.txt"), directory("/day/unit 2", [file("/day/unit 2/b.ulg")])]);
    return (await below(tree)).map(({ name }) => name);
  });
  assert.deepEqual(taken, ["day/a.BIN", "day/unit 2/b.ulg"]);
  await close();
});

test("what is known of a unit goes into a report as into a replay of the program, and a file of another version is refused", async () => {
  const { page, complaints, close } = await fromDisk();
  const log = join(FLIGHTS, "independent_hand_six.tlog");
  const unit = join(folder, "unit.toml");
  native("unit", "add", unit, log);
  assert.equal(await run(page, "report", [SMALL, unit]), "");
  const ours = JSON.parse(await saved(page, ".json"));
  delete ours.compasses;
  delete ours.air;
  assert.deepEqual(differences(ours, JSON.parse(native("replay", SMALL, "--unit", unit, "--json"))), []);
  assert.notDeepEqual(differences(ours, JSON.parse(native("replay", SMALL, "--json"))), []);
  writeFileSync(unit, readFileSync(unit, "utf8").replace(/^schema.*$/m, 'schema = "gaware.unit/9"'));
  assert.match(await run(page, "report", [SMALL, unit]), /unit\.toml is no unit file/);
  assert.deepEqual(complaints(), []);
  await close();
});

test("rubbish, half files and hostile names give a sentence, and the page lives on", async () => {
  const { page, complaints, close } = await fromDisk();
  page.on("dialog", () => assert.fail("a name became code"));
  const put = (name, content) => { writeFileSync(join(folder, name), content); return join(folder, name); };
  const flight = readFileSync(SMALL);
  const noise = Buffer.from(Array.from({ length: 5000 }, (_, k) => (k * k * 37 + 11) & 255));
  const heads = { "rubbish.bin": [0xa3, 0x95, 0x80], "rubbish.ulg": [0x55, 0x4c, 0x6f, 0x67, 0x01, 0x12, 0x35], "rubbish.mcap": [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 13, 10], "rubbish.tlog": [] };
  const bad = [put("empty.tlog", ""), ...Object.entries(heads).map(([name, head]) => put(name, Buffer.concat([Buffer.from(head), noise]))), put("picture.jpg", noise)];
  for (const file of bad) {
    const sentence = await run(page, "report", file);
    assert.match(sentence, /(is empty|could be read|unsupported format|damaged)/, file);
    assert.doesNotMatch(sentence, /fault of its own/, file);
  }
  assert.match(await run(page, "report", [SMALL, put("wrong.toml", "schema = \"gaware.model/1\"\n[imu]\ngyro_noize = 1\n")]), /wrong.toml, line 3.*gyro_noize/);
  const huge = put("huge.bin", "");
  truncateSync(huge, 700e6);
  assert.match(await run(page, "report", huge), /more than a page can analyse/);
  // Half a flight is one, under any name.
  const name = "<img src=x onerror=alert(1)>\"'&..%2f.tlog";
  assert.equal(await run(page, "report", put(name, flight.subarray(0, flight.length / 2 + 7))), "");
  assert.equal(await page.textContent(".result h2"), `Report of ${name}`);
  assert.equal(await page.locator("img").count() + await page.frameLocator(".result iframe").locator("img").count(), 0);
  assert.ok((await page.frameLocator(".result iframe").locator("h1").textContent()).includes("onerror"));
  assert.deepEqual(complaints(), []);
  await close();
});

test("from a server it asks for nothing once it is loaded, and starts without a network", async () => {
  const server = spawn(process.env.GAWARE, ["serve", "--web", "--listen", "127.0.0.1:0", "--page", PAGE], { stdio: ["ignore", "ignore", "pipe"] });
  try {
    const [line] = await once(createInterface({ input: server.stderr }), "line");
    const url = line.split(" ").at(-1);
    const { page, errors, close } = await open(browser);
    const asked = [];
    page.context().on("request", (request) => asked.push(request.url()));
    await page.goto(url);
    await page.locator("body[data-ready]").waitFor();
    assert.deepEqual(asked, [url, `${url}sw.js`, url], "the page, its keeper, and the page for later");
    asked.length = 0;
    assert.equal(await run(page, "report", SMALL), "");
    await page.frameLocator(".result iframe").locator(".chart.live canvas").first().waitFor();
    assert.deepEqual(asked.filter((address) => !/^(blob|data|about):/.test(address)), []);
    server.kill("SIGINT");
    await once(server, "exit");
    await page.reload();
    assert.equal(await run(page, "report", SMALL), "");
    assert.deepEqual(errors.filter((e) => !e.startsWith("asked for blob:") && !e.includes("ERR_CONNECTION_REFUSED")), []);
    await close();
  } finally {
    server.kill("SIGKILL");
  }
});

test("the page's address names a log of its own server, and of no other", async () => {
  const type = { html: "text/html", js: "text/javascript", tlog: "application/octet-stream" };
  const files = { "/": PAGE, "/sw.js": join(ROOT, "web/page/sw.js"), "/logs/flight%201.tlog": SMALL };
  const asked = [];
  const server = createServer((request, response) => {
    asked.push(request.url);
    const file = files[request.url];
    if (!file) return response.writeHead(request.url === "/away" ? 302 : 404, { location: "http://localhost:9/flight.bin" }).end();
    return response.writeHead(200, { "content-type": type[basename(file).split(".").at(-1)] }).end(readFileSync(file));
  }).listen(0, "127.0.0.1");
  await once(server, "listening");
  const own = `http://127.0.0.1:${server.address().port}/`;
  const { page, errors, close } = await open(browser);
  try {
    await page.goto(`${own}#url=logs/flight%25201.tlog`);
    await page.locator("#chosen", { hasText: "flight%201.tlog" }).waitFor();
    await page.click("#report");
    await page.locator(".result iframe").waitFor();
    for (const [url, why] of [["https://example.org/flight.bin", /not on the server of this page/], ["javascript:alert(1)", /not on the server/], ["none.bin", /answers 404/], ["away", /from elsewhere/]]) {
      await page.evaluate((hash) => { location.hash = hash; }, `url=${encodeURIComponent(url)}`);
      await page.locator("#trouble", { hasText: why }).waitFor();
    }
    assert.deepEqual([...new Set(asked)].sort(), ["/", "/away", "/logs/flight%201.tlog", "/none.bin", "/sw.js"]);
    assert.deepEqual(errors.filter((e) => !e.startsWith("asked for blob:") && !/404|ERR_FAILED|about:/.test(e)), []);
  } finally {
    await close();
    server.close();
    server.closeAllConnections();
  }
});
