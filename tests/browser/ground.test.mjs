import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createSocket } from "node:dgram";
import { after, test } from "node:test";
import { launch, open } from "./harness.mjs";

const running = new Set();
const browser = await launch();
after(async () => {
  running.forEach((child) => child.kill("SIGKILL"));
  await browser.close();
});

function gaware(...args) {
  const child = spawn(process.env.GAWARE, args, { stdio: "ignore" });
  running.add(child);
  return child;
}

/** A UDP port that is free now. */
const port = () => new Promise((done) => {
  const socket = createSocket("udp4").bind(0, "127.0.0.1", () => {
    const { port: number } = socket.address();
    socket.close(() => done(number));
  });
});

test("hands are led through six sides on phone and desktop: ring, next side, what each side brought", async () => {
  const [link, web] = [await port(), await port()];
  gaware("run", "--connect", `udpin:127.0.0.1:${link}`, "--web", `127.0.0.1:${web}`, "--headless", "--no-record", "--home", "47.4,8.5");
  gaware("sim", "--scenario", "hand", "--listen", `udpout:127.0.0.1:${link}`, "--speed", "12", "--fault", "gnss-loss@0-9000");
  const pages = [];
  for (const [name, viewport] of [["phone", { width: 390, height: 844 }], ["desktop", { width: 1280, height: 900 }]]) {
    const own = await open(browser, { viewport });
    for (let tries = 0; ; tries += 1) {
      try {
        await own.page.goto(`http://127.0.0.1:${web}/`);
        break;
      } catch (error) {
        if (tries > 150) throw error;
        await own.page.waitForTimeout(200);
      }
    }
    pages.push({ name, ...own });
  }
  const shown = (words) => Promise.all(pages.map(({ page }) => page.waitForFunction(words)));
  await shown(() => !document.querySelector("#byhand").hidden && /^\d+$/.test(document.querySelector("#hold text").textContent));
  for (const { name, page } of pages) {
    assert.equal(await page.locator("#sides li").count(), 6);
    const box = await page.locator("#byhand").boundingBox();
    const { width, height } = page.viewportSize();
    assert.ok(box.x >= 0 && box.x + box.width <= width, `${name}: ${JSON.stringify(box)}`);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), name);
    // The ring can be seen without scrolling: hands are at the vehicle.
    const ring = await page.locator("#hold svg").boundingBox();
    assert.ok(ring.y + ring.height <= height, `${name}: ring at ${JSON.stringify(ring)}`);
    assert.equal(await page.locator(".fly").isVisible(), name === "desktop");
  }
  await shown(() => document.querySelectorAll('#sides li[data-state="done"]').length >= 3);
  await shown(() => document.querySelector('#sides li[data-state="next"]') !== null);
  for (const { name, page } of pages) {
    assert.match(await page.locator('#sides li[data-state="done"] .brought').last().textContent(), /^\d+ s/);
    if (process.env.PICTURES) await page.screenshot({ path: `${process.env.PICTURES}/ground-${name}.png` });
  }
  for (const { errors, close } of pages) {
    assert.deepEqual(errors, []);
    await close();
  }
});
