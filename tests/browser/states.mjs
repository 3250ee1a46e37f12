// Pictures of every state of the page, of the program itself, to be looked at: STATES=FOLDER node states.mjs.
// A simulated vehicle is connected, gets its mission, loses its link; another upload is cut in mid-transfer; a demonstration is in mid-flight.

import { spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { createSocket } from "node:dgram";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { launch, open } from "./harness.mjs";

const OUT = process.env.STATES ?? "states";
const SIZES = { desktop: { width: 1280, height: 900 }, phone: { width: 390, height: 844 } };
const folder = mkdtempSync(join(tmpdir(), "gaware-states-"));
const running = new Set();

/** Starts the program with a home of its own. */
function gaware(...args) {
  const child = spawn(process.env.GAWARE, args, { cwd: folder, stdio: ["ignore", "inherit", "ignore"] });
  running.add(child);
  return child;
}

function ended(child, signal = "SIGINT") {
  running.delete(child);
  if (child.exitCode !== null || child.signalCode !== null) return Promise.resolve();
  return new Promise((done) => { child.once("exit", done); child.kill(signal); });
}

/** A UDP port that is free now. */
function port() {
  return new Promise((done) => {
    const socket = createSocket("udp4").bind(0, "127.0.0.1", () => {
      const { port: number } = socket.address();
      socket.close(() => done(number));
    });
  });
}

const TOKEN = "picture-of-every-state";
const browser = await launch();

/** The page in both colours on desktop and phone. */
async function watch(address, token) {
  const pages = [];
  for (const [size, viewport] of Object.entries(SIZES)) {
    for (const colorScheme of ["light", "dark"]) {
      const { page, close } = await open(browser, { viewport, colorScheme });
      for (let tries = 0; ; tries += 1) {
        try {
          await page.goto(`http://${address}/${token ? `?token=${token}` : ""}`);
          break;
        } catch (error) {
          if (tries > 150) throw error;
          await page.waitForTimeout(200);
        }
      }
      pages.push({ page, close, name: `${size}-${colorScheme}` });
    }
  }
  const all = (what) => Promise.all(pages.map(what));
  return {
    first: pages[0].page,
    until: (test, arg) => all(({ page }) => page.waitForFunction(test, arg, { timeout: 300000 })),
    async picture(state) {
      await pages[0].page.waitForTimeout(700);
      await all(({ page, name }) => page.screenshot({ path: join(OUT, `${state}-${name}.png`) }));
      console.log(`${state}: ${await pages[0].page.evaluate(() => document.querySelector("#instruction").textContent)}`);
    },
    close: () => all(({ close }) => close()),
  };
}

const enabled = () => { const b = document.querySelector("#upload"); return b && !b.disabled && b.offsetParent !== null; };

async function connected() {
  const plan = join(folder, "flight.plan");
  await new Promise((done) => gaware("plan", "--home", "47.3977,8.5456,488", "--budget", "120", "--out", plan).once("exit", done));
  const [link, web] = [await port(), await port()];
  const address = `127.0.0.1:${web}`;
  const run = gaware("run", "--connect", `udpin:127.0.0.1:${link}`, "--web", address, "--web-token", TOKEN, "--mission", plan, "--airframe", "small_fixed_wing", "--headless", "--no-record");
  return { link, run, page: await watch(address, TOKEN) };
}

/** A vehicle that flies missions, waiting on the ground. */
const vehicle = (link, ...more) => gaware("sim", "--scenario", "mission_fixed_wing", "--listen", `udpout:127.0.0.1:${link}`, ...more);

async function uploadAndLoss() {
  const { link, run, page } = await connected();
  await page.picture("1-no-vehicle");
  const sim = vehicle(link);
  await page.until(enabled);
  await page.picture("2-ready");
  await page.first.click("#upload");
  await page.picture("3-confirm");
  await page.first.click("#confirm button[value=yes]");
  await page.first.waitForTimeout(150);
  await page.picture("4-uploading");
  await page.until(() => /read back/.test(document.body.innerText));
  await page.picture("5-on-vehicle");
  await ended(sim, "SIGKILL");
  await page.first.waitForTimeout(7000);
  await page.picture("6-vehicle-lost");
  await ended(run);
  await page.until(() => !document.querySelector("#lost").hidden);
  await page.picture("7-page-lost");
  await page.close();
}

async function unknown() {
  const { link, run, page } = await connected();
  // Every message takes a second and a half: the transfer is under way for a long time.
  const sim = vehicle(link, "--fault", "delay=0.7");
  await page.until(enabled);
  await page.first.waitForTimeout(3000);
  await page.first.click("#upload");
  await page.first.click("#confirm button[value=yes]");
  await page.first.waitForTimeout(Number(process.env.CUT_MS ?? 12000));
  await ended(sim, "SIGKILL");
  await page.until(() => document.querySelector('#upload-result').dataset.state === 'unknown');
  await page.picture("8-mission-unknown");
  await ended(run);
  await page.close();
}

async function demonstration() {
  const address = `127.0.0.1:${await port()}`;
  const demo = gaware("demo", "--headless", "--speed", "40", "--web", address, "--report", "/dev/null");
  const page = await watch(address);
  await page.picture("a-planning");
  const reached = (s) => document.querySelector("#clock").textContent.split(":").reduce((a, x) => 60 * a + Number(x), 0) >= s;
  await page.until(reached, 20);
  await page.picture("b-start");
  await page.until(reached, 300);
  await page.picture("c-mid-flight");
  await ended(demo);
  await page.close();
}

try {
  if (!existsSync(OUT)) mkdirSync(OUT, { recursive: true });
  const only = process.argv[2];
  for (const part of [uploadAndLoss, unknown, demonstration]) if (!only || part.name === only) await part();
} finally {
  await browser.close();
  await Promise.all([...running].map((child) => ended(child, "SIGKILL")));
  rmSync(folder, { recursive: true });
}
