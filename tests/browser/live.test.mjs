// The pilot's page over a serial port of the browser: a stand-in for the port gives the bytes of a recorded flight, with the clock of the recording.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { differences, faults, launch, open } from "./harness.mjs";

const ROOT = new URL("../../", import.meta.url).pathname;
const FLIGHTS = process.env.GAWARE_FLIGHTS ?? join(ROOT, "../shared/data");
const SMALL = join(ROOT, "tests/data/small_gsens_typical_dither.tlog");
const HAND = join(FLIGHTS, "independent_hand_six_no_gnss.tlog");
const PAGE = process.env.ANALYSIS;

let browser;
before(async () => { browser = await launch(); });
after(() => browser.close());

/**
 * In the page: a port for which the test has keys. `give` puts bytes with their stamps (Unix µs) in the way of the page; the page's clock is that of the
 * bytes that it has read. Whoever touches `writable` is remembered.
 */
function standIn() {
  if (top !== window) return;
  let clock_us = 0;
  let waiting = null;
  const queue = [];
  const port = { baud: [], written: 0, plugged: true, readable: null };
  performance.now = () => clock_us / 1000 - performance.timeOrigin;
  const next = () => {
    if (!waiting || queue.length === 0) return;
    const { t_us, bytes } = queue.shift();
    clock_us = t_us;
    const { controller, resolve } = waiting;
    waiting = null;
    controller.enqueue(bytes);
    resolve();
  };
  const stream = () => new ReadableStream({
    pull(controller) { return new Promise((resolve) => { waiting = { controller, resolve }; port.controller = controller; next(); }); },
    cancel() { waiting?.resolve(); waiting = null; port.stream = null; },
  }, { highWaterMark: 0 });
  const serialPort = {
    getInfo: () => ({ usbVendorId: 0x1209, usbProductId: 0x5741 }),
    async open({ baudRate }) {
      if (!port.plugged) throw new DOMException("Failed to open serial port.", "NetworkError");
      port.baud.push(baudRate);
      port.open = true;
    },
    async close() { port.open = false; port.stream = null; },
    get readable() { return port.open && port.plugged ? (port.stream ??= stream()) : null; },
    get writable() { port.written += 1; return new WritableStream(); },
  };
  const serial = Object.assign(new EventTarget(), { requestPort: async () => serialPort });
  Object.defineProperty(navigator, "serial", { value: serial });
  window.standIn = {
    port,
    wait(seconds) { clock_us += seconds * 1e6; },
    give(chunks) {
      for (const [t_us, base64] of chunks) queue.push({ t_us, bytes: Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)) });
      clock_us ||= chunks[0][0];
      next();
    },
    left: () => queue.length,
    unplug() {
      port.plugged = false;
      port.controller.error(new DOMException("The device has been lost.", "NetworkError"));
    },
    plug() {
      port.plugged = true;
      waiting = null;
      const event = new Event("connect");
      Object.defineProperty(event, "target", { value: serialPort });
      serial.dispatchEvent(event);
    },
  };
}

/** Stamps and frames of a .tlog: eight bytes of time before each frame. */
function* records(path) {
  const bytes = readFileSync(path);
  for (let at = 0; at < bytes.length;) {
    const magic = bytes[at + 8];
    const length = magic === 0xfd ? 12 + bytes[at + 9] + 13 * (bytes[at + 10] & 1) : 8 + bytes[at + 9];
    yield [Number(bytes.readBigUInt64BE(at)), bytes.subarray(at + 8, at + 8 + length)];
    at += 8 + length;
  }
}

/** A heartbeat (MAVLink 2) of a vehicle that is disarmed and stands by, with its checksum (CRC-16/MCRF4XX, CRC_EXTRA 50); any other frame as it is. */
function disarmed(frame) {
  if (frame[0] !== 0xfd || frame.readUIntLE(7, 3) !== 0) return frame;
  const out = Buffer.from(frame);
  out[16] &= 0x7f;
  out[17] = 3;
  const crc = [...out.subarray(1, 10 + out[1]), 50].reduce((crc, byte) => {
    for (let bit = 0, x = (crc ^ byte) & 0xff; ; bit += 1, x = x & 1 ? (x >> 1) ^ 0x8408 : x >> 1) if (bit === 8) return (crc >> 8) ^ x;
  }, 0xffff);
  out.writeUInt16LE(crc, 10 + out[1]);
  return out;
}

/** What a port would give of it: frames together, or pieces of that many bytes whatever the frames. */
function chunks(path, size = 0, change = (frame) => frame) {
  if (size === 0) return [...records(path)].map(([t_us, frame]) => [t_us, change(frame).toString("base64")]);
  const out = [];
  let rest = Buffer.alloc(0);
  for (const [t_us, frame] of records(path)) {
    rest = Buffer.concat([rest, frame]);
    for (; rest.length >= size; rest = rest.subarray(size)) out.push([t_us, rest.subarray(0, size).toString("base64")]);
  }
  return out;
}

async function fromDisk(options) {
  const opened = await open(browser, options);
  await opened.page.addInitScript(standIn);
  await opened.page.goto(`file://${PAGE}`);
  return { ...opened, pilot: opened.page.frameLocator("#pilot"), complaints: () => opened.errors.filter((e) => e !== `asked for file://${PAGE}` && !/^asked for (blob:|about:)/.test(e)) };
}

const give = (page, pieces) => page.evaluate((given) => window.standIn.give(given), pieces);
const hero = (pilot, words) => pilot.locator("#instruction", { hasText: words }).waitFor();
const allRead = (page) => page.waitForFunction(() => window.standIn.left() === 0);

/** Stops, and gives the recording and the result as the user saves them. */
async function stopped(page) {
  await page.click("#live-stop");
  await page.locator(".result").waitFor();
  const saved = {};
  for (const ending of [".tlog", ".json"]) {
    const [download] = await Promise.all([page.waitForEvent("download"), page.click(`.result a[download$="${ending}"]`)]);
    saved[ending] = readFileSync(await download.path());
  }
  return saved;
}

const native = (log) => JSON.parse(execFileSync(process.env.GAWARE, ["replay", log, "--json"], { stdio: ["ignore", "pipe", "ignore"], maxBuffer: 1 << 30 }));

test("a flight over the port gives the estimate of a replay, its recording is the flight, and nothing is written to the port", async () => {
  const { page, pilot, complaints, close } = await fromDisk({ viewport: { width: 1280, height: 900 } });
  await page.click("#connect");
  const all = chunks(SMALL);
  await give(page, all.slice(0, 2000));
  await allRead(page);
  await pilot.locator('#chip-link[data-level="good"]').waitFor();
  await give(page, all.slice(2000));
  await allRead(page);
  await pilot.locator("#chip-phase", { hasText: "Running" }).waitFor();
  await pilot.locator("#system", { hasText: "RAW_IMU at" }).waitFor();
  assert.equal(await pilot.locator("#actions").isVisible(), false);
  const saved = await stopped(page);
  assert.ok(saved[".tlog"].equals(readFileSync(SMALL)));
  assert.deepEqual(differences(JSON.parse(saved[".json"]), native(SMALL)), []);
  assert.deepEqual(await page.evaluate(() => [window.standIn.port.written, window.standIn.port.open, window.standIn.port.baud]), [0, false, [57600]]);
  // The recording is a log like others.
  assert.match(await page.textContent("#chosen"), /^live-.*\.tlog/);
  assert.equal(await page.isEnabled("#explain"), true);
  assert.deepEqual(complaints(), []);
  await close();
});

test("noise, a wrong baud rate, an unplugged port and a silent one give a sentence, and the session goes on", async () => {
  const { page, pilot, complaints, close } = await fromDisk({ viewport: { width: 390, height: 844 } });
  const all = chunks(SMALL, 61);
  const half = all.length / 2 | 0;
  await page.selectOption("#baud", "115200");
  await page.selectOption("#airframe", "small_fixed_wing");
  await page.click("#connect");
  await hero(pilot, /Nothing was received/);
  const noise = Buffer.from(Array.from({ length: 6100 }, (_, k) => (k * k * 37 + 11) & 255));
  await give(page, Array.from({ length: 100 }, (_, k) => [all[0][0] + k, noise.subarray(61 * k, 61 * k + 61).toString("base64")]));
  await hero(pilot, /is the baud rate right/);
  await page.selectOption("#live-baud", "57600");
  await page.waitForFunction(() => window.standIn.port.baud.length === 2);
  await give(page, all.slice(0, half));
  await allRead(page);
  await pilot.locator("#motion", { hasText: "m/s" }).waitFor();
  await page.evaluate(() => window.standIn.unplug());
  await page.locator("#live-say", { hasText: /port is gone|cannot be opened/ }).waitFor();
  await page.evaluate(() => window.standIn.wait(5));
  await hero(pilot, /No new data|No data/);
  const found = await page.evaluate(faults);
  assert.ok(found.scroll <= 0, `${found.scroll} px too wide`);
  assert.deepEqual(found.small, []);
  await page.evaluate(() => window.standIn.plug());
  await page.locator("#live-say", { hasText: "Nothing is sent" }).waitFor();
  await give(page, all.slice(half));
  await allRead(page);
  const { imu, gnss, phase } = JSON.parse((await stopped(page))[".json"]);
  const sent = [...records(SMALL)].filter(([, frame]) => frame.readUIntLE(7, 3) === 27).length;
  // The noise and the gap cut a frame each; before the first heartbeat none counts.
  assert.ok(imu.dropped <= 2 && imu.gaps.count === 0 && imu.samples > 0.99 * sent && phase === "running" && gnss.rejected === 0, JSON.stringify({ imu, gnss, phase, sent }));
  assert.deepEqual(await page.evaluate(() => [window.standIn.port.written, window.standIn.port.baud]), [0, [115200, 57600, 57600]]);
  assert.deepEqual(complaints(), []);
  await close();
});

test("a unit turned by hand without GNSS is led through its sides, and a vehicle that sends nothing of use is told what to set", async () => {
  const { page, pilot, complaints, close } = await fromDisk({ viewport: { width: 1280, height: 900 } });
  await page.fill("#place", "47.4,8.5");
  await page.click("#connect");
  const heartbeats = [...records(HAND)].filter(([, frame]) => frame.readUIntLE(7, 3) === 0).slice(0, 8);
  await give(page, heartbeats.map(([t_us, frame]) => [t_us, frame.toString("base64")]));
  await pilot.locator("#reason", { hasText: /asks the vehicle for nothing/ }).waitFor();
  await page.click("#live-stop");
  await page.locator(".result").waitFor();
  await page.click("#connect");
  await give(page, chunks(HAND, 0, disarmed));
  await allRead(page);
  await pilot.locator('#sides li[data-state="done"]').nth(3).waitFor();
  assert.equal(await pilot.locator("#byhand").isVisible(), true);
  assert.deepEqual(complaints(), []);
  await close();
});

test("what cannot be is refused with a sentence: a place that is none, a port that another program has, a browser without ports", async () => {
  const { page, close } = await fromDisk();
  await page.fill("#place", "here");
  await page.click("#connect");
  await page.locator("#trouble", { hasText: "write latitude and longitude" }).waitFor();
  await page.fill("#place", "");
  await page.evaluate(() => { window.standIn.port.plugged = false; });
  await page.click("#connect");
  await page.locator("#live-say", { hasText: "cannot be opened" }).waitFor();
  await page.click("#live-stop");
  await page.locator("#trouble", { hasText: "Nothing was recorded" }).waitFor();
  await close();
  const without = await open(browser);
  await without.page.addInitScript(() => Object.defineProperty(navigator, "serial", { value: undefined }));
  await without.page.goto(`file://${PAGE}`);
  assert.match(await without.page.textContent("#no-serial"), /Chrome or Edge/);
  assert.equal(await without.page.locator("#connect").isVisible(), false);
  await without.close();
});
