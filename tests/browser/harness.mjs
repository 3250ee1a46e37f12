// Starts the fixture server and Chromium for the tests.

import { spawn } from "node:child_process";
import { once } from "node:events";
import { createInterface } from "node:readline";
import { after } from "node:test";
import { chromium } from "playwright-core";

const SERVER = process.env.WEB_FIXTURE;
const FLAGS = [
  "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync",
];

// A test that fails before it stops its server must not keep the run from ending.
const running = new Set();
after(() => running.forEach((child) => child.kill("SIGKILL")));

/** Starts a server; resolves when it listens. */
export async function serve(...args) {
  const child = spawn(SERVER, args, { stdio: ["pipe", "pipe", "inherit"] });
  running.add(child);
  child.once("exit", () => running.delete(child));
  const ended = once(child, "exit").then(([code]) => Promise.reject(new Error(`the server ended with ${code}`)));
  ended.catch(() => {}); // Its end is news only while it starts.
  const [line] = await Promise.race([once(createInterface({ input: child.stdout }), "line"), ended]);
  const url = new URL(line.split(" ").at(-1));
  await fetch(new URL("/healthz", url)).catch(() => ended);
  return {
    url: url.href,
    port: url.port,
    /** Lets a flight with stops go on to the next one. */
    go() {
      child.stdin.write("\n");
    },
    /** As when its machine loses power. */
    async kill() {
      child.kill("SIGKILL");
      await once(child, "exit");
    },
    async stop() {
      if (child.exitCode !== null) return;
      child.kill("SIGINT");
      await once(child, "exit");
    },
  };
}

export function launch() {
  return chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", headless: true, args: FLAGS });
}

/** A page that remembers what it complained about, and what it asked of other hosts. */
export async function open(browser, options = {}) {
  const context = await browser.newContext(options);
  // A machine with much to do takes its time: what a page shows is checked, not how soon.
  context.setDefaultTimeout(120000);
  const page = await context.newPage();
  const errors = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) errors.push(message.text());
  });
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (url.hostname !== "127.0.0.1" && url.protocol !== "data:") errors.push(`asked for ${url}`);
  });
  return { page, errors, close: () => context.close() };
}
