// The page of a fleet with known truth in a real browser: what was injected is seen at once, can be chosen, and is what the command reports.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fleet } from "./fleet.mjs";
import { faults, launch, open } from "./harness.mjs";

const EVIL = '</script><script>document.title="taken"</script><img src=x onerror=alert(1)>.bin';
const CASES = {
  usual: {},
  few: { units: 3, flights: 14, dated: false, seed: 3 },
  many: { units: 100, flights: 1000, seed: 2 },
  same: { units: 3, flights: 14, days: 0, seed: 4 },
  evil: { units: 4, flights: 24, seed: 5, name: (unit, k) => `${unit}/${k}${EVIL}` },
};
/** A document with the digest that says that no one edited it: of itself, with zeros where the digest stands. */
function sealed(document) {
  const blank = "0".repeat(64);
  const text = JSON.stringify({ ...document, written_by: `gaware-sha256:${blank}` });
  return text.replace(blank, createHash("sha256").update(text).digest("hex"));
}
const folder = mkdtempSync(join(tmpdir(), "gaware-fleets-"));
const reports = {};
let browser;
before(async () => {
  browser = await launch();
  for (const [name, options] of Object.entries(CASES)) {
    const place = join(folder, name);
    mkdirSync(place);
    writeFileSync(join(place, "fleet.json"), sealed(fleet(options)));
    execFileSync(process.env.GAWARE, ["fleet", "report", place]);
    reports[name] = { url: `file://${join(place, "report.html")}`, json: JSON.parse(execFileSync(process.env.GAWARE, ["fleet", "report", place, "--json"], { maxBuffer: 1 << 28 })) };
  }
});
after(async () => {
  await browser.close();
  rmSync(folder, { recursive: true });
});

const shown = ".parameter:not([hidden])";
/** A page of a fleet at its first screen. */
async function at(name, options = { viewport: { width: 1280, height: 900 } }, hash = "") {
  const opened = await open(browser, options);
  await opened.page.goto(reports[name].url + hash);
  return opened;
}
const complaints = (errors) => errors.filter((e) => !e.startsWith("asked for file:"));

test("few, usual and many flights fit on every screen and on paper, without a complaint", async () => {
  for (const name of Object.keys(CASES)) {
    for (const [width, media] of [[1280, "screen"], [768, "screen"], [390, "screen"], [718, "print"]]) {
      const { page, errors, close } = await at(name, { viewport: { width, height: 844 } });
      await page.emulateMedia({ media });
      const { plots, ...found } = await page.evaluate(faults);
      assert.ok(found.scroll <= 0, `${name} at ${width}: ${found.scroll} px wider`);
      assert.deepEqual({ ...found, scroll: 0 }, { scroll: 0, wide: [], small: [], over: 0, raw: null, cut: [] }, `${name} at ${width}`);
      assert.equal(await page.locator(`${shown} .chart.live .uplot`).count(), 1, "one parameter is shown, as an interactive plot");
      assert.deepEqual(complaints(errors), []);
      await close();
    }
  }
});

test("the first screen has everything that was injected, and each leads to its plot", async () => {
  const { page, errors, close } = await at("usual");
  const text = await page.locator("body").innerText();
  assert.match(text, /200 flights of 12 inertial units with 3 firmwares: 1 value out of family, 1 shift with a firmware, 1 drift/);
  for (const item of ["imu06, gyro_g_sensitivity g22", "gps_latency latency", "imu09, accel_bias ba_z", "flights/imu05/flight_0100.bin"]) {
    const box = await page.locator(".answers a", { hasText: item }).first().boundingBox();
    assert.ok(box.y + box.height < 900, `${item} is not on the first screen`);
  }
  assert.match(text, /gps_latency in \d+ flights of \d+ units \(.*with firmware 4\.6 alone/);
  await page.locator(".answers a", { hasText: "imu09" }).click();
  assert.equal(await page.locator(`${shown} h3`).innerText().then((t) => t.split(" mg")[0]), "accel_bias ba_z");
  const [parameter, unit] = await page.evaluate(() => [...document.querySelectorAll("#controls select")].map((s) => s.selectedOptions[0].textContent));
  assert.deepEqual([parameter, unit], ["accel_bias ba_z", "imu09"]);
  assert.equal(await page.locator(`${shown} tr.chosen td`).first().innerText(), "imu09");
  // A flight of a finding is the one whose figures are shown.
  await page.locator(".answers a", { hasText: "flight_0100.bin" }).click();
  assert.match(await page.locator(".readout").innerText(), /^imu05: [\d.]+ ± [\d.]+ deg\/h, unlike the other flights of its unit · 2\d{3}-\d\d-\d\d, firmware 4\.5 · flights\/imu05\/flight_0100\.bin$/);
  assert.deepEqual(complaints(errors), []);
  await close();
});

test("figures of the table are those of the command, and its headings sort it", async () => {
  const { page, close } = await at("usual", undefined, `#p${reports.usual.json.parameters.findIndex((p) => p.name === "g22")}`);
  const { units } = reports.usual.json.parameters.find((p) => p.name === "g22");
  const column = (k) => page.locator(`${shown} .units tbody tr`).evaluateAll((rows, i) => rows.map((row) => row.cells[i].innerText), k);
  assert.deepEqual(await column(0), units.map((u) => u.unit));
  const constants = (await column(2)).map((t) => parseFloat(t));
  units.forEach((u, k) => assert.ok(Math.abs(constants[k] - u.constant.value) <= 0.5 * u.constant.sigma, `${u.unit}: ${constants[k]}`));
  const sort = page.locator(`${shown} th button`, { hasText: "Constant part" });
  await sort.focus();
  await page.keyboard.press("Enter");
  const names = (order) => [...units].sort((a, b) => order * (a.constant.value - b.constant.value)).map((u) => u.unit);
  assert.deepEqual(await column(0), names(-1));
  await page.keyboard.press("Enter");
  assert.deepEqual(await column(0), names(1));
  await close();
});

test("a flight is found with the cursor and with the keys, and a part of the time by dragging", async () => {
  const { page, close } = await at("usual");
  await page.locator(`${shown} .units a`, { hasText: "imu03" }).click();
  const over = page.locator(`${shown} .u-over`);
  const box = await over.boundingBox();
  // Somewhere along the line there is a flight within reach.
  for (let x = 0.05; x < 0.95 && !(await page.locator(".readout b").count()); x += 0.02) await page.mouse.move(box.x + box.width * x, box.y + box.height / 2);
  assert.match(await page.locator(".readout").innerText(), /^imu03: .* · flights\/imu03\/flight_\d{4}\.bin$/);
  await page.locator(`${shown} .flights`).focus();
  const read = async (key) => {
    await page.keyboard.press(key);
    return page.locator(".readout").innerText();
  };
  for (let k = 0; k < 20; k += 1) await page.keyboard.press("ArrowLeft");
  const [first, second] = [await read("ArrowLeft"), await read("ArrowRight")];
  assert.match(first, /flight_0002\.bin/);
  assert.match(second, /flight_0014\.bin/);
  const picture = () => page.evaluate((s) => document.querySelector(`${s} canvas`).toDataURL(), shown);
  const whole = await picture();
  await page.mouse.move(box.x + box.width * 0.3, box.y + 40);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.6, box.y + 40, { steps: 4 });
  await page.mouse.up();
  await page.waitForFunction(([s, was]) => document.querySelector(`${s} canvas`).toDataURL() !== was, [shown, whole]);
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator(`${shown} a.csv`).click()]);
  let csv = "";
  for await (const part of await download.createReadStream()) csv += part;
  assert.match(csv, /^log,unit,firmware,start,value,sigma,expected,unlike_the_others\n"flights\/imu\d\d\/flight_\d{4}\.bin","imu\d\d","4\.\d",2\d{3}-/);
  assert.equal(csv.split("\n").length, 201);
  await close();
});

test("flights without a date are counted, and names of files stay text", async () => {
  const few = await at("few");
  await few.page.locator(`${shown} .flights`).focus();
  await few.page.keyboard.press("ArrowRight");
  assert.match(await few.page.locator(".readout").innerText(), / · flight 1, firmware/);
  await few.close();
  // So are those of a simulator that always begins on the same day.
  const same = await at("same");
  await same.page.locator(`${shown} .flights`).focus();
  await same.page.keyboard.press("ArrowRight");
  assert.match(await same.page.locator(".readout").innerText(), / · flight 1, firmware/);
  await same.close();
  const evil = await at("evil");
  await evil.page.locator(`${shown} .flights`).focus();
  await evil.page.keyboard.press("ArrowRight");
  assert.ok((await evil.page.locator(".readout").innerText()).endsWith(EVIL));
  assert.notEqual(await evil.page.title(), "taken");
  assert.equal(await evil.page.locator("img").count(), 0);
  assert.deepEqual(complaints(evil.errors), []);
  await evil.close();
});

test("without scripts every parameter has its drawing and its table", async () => {
  const { page, close } = await at("usual", { javaScriptEnabled: false });
  const count = reports.usual.json.parameters.length;
  assert.equal(await page.locator(".parameter .area > svg").count(), count);
  assert.equal(await page.locator(".parameter .units").count(), count);
  assert.equal(await page.locator("a.csv:visible").count(), 0);
  await close();
});
