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

/** What is wider than the window or lies over its neighbour, and what is smaller than 12 px. */
export function faults() {
  const inside = (e) => e.closest(".wide, .drawing, .area, pre, svg");
  const shown = [...document.querySelectorAll("body *")].filter((e) => e.getClientRects().length > 0);
  const small = shown.filter((e) => !e.closest(".drawing, script") && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()) && parseFloat(getComputedStyle(e).fontSize) < 12);
  // Letters of a drawing are as large as its scale makes them.
  const letters = [...document.querySelectorAll("svg text")].filter((e) => e.getClientRects().length > 0);
  const tiny = letters.filter((e) => parseFloat(getComputedStyle(e).fontSize) * e.getScreenCTM().a < 12);
  const labels = [...document.querySelectorAll(".drawing text")].map((e) => e.getBoundingClientRect());
  const over = labels.filter((a, i) => labels.some((b, k) => k > i && a.left < b.right - 3 && b.left < a.right - 3 && a.top < b.bottom - 6 && b.top < a.bottom - 6));
  // On paper nothing can be scrolled into view.
  const paper = matchMedia("print").matches ? shown.filter((e) => !e.closest("svg") && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline") : [];
  return {
    cut: paper.map((e) => `${e.tagName}.${e.className}`),
    scroll: document.documentElement.scrollWidth - window.innerWidth,
    wide: shown.filter((e) => !inside(e) && e.getBoundingClientRect().right > window.innerWidth + 1).map((e) => `${e.tagName}.${e.className}`),
    small: [...small, ...tiny].map((e) => e.textContent.trim().slice(0, 30)),
    over: over.length,
    raw: [...document.querySelectorAll("body > :not(pre, script)")].map((e) => e.innerText).join("\n").match(/\[[-0-9.]+,|NaN|undefined/g),
    plots: document.querySelectorAll("figure.chart").length - document.querySelectorAll("figure.chart.live .uplot").length,
  };
}

/** Where two documents differ but for who wrote them: nowhere, to the last digit, where module and program do the same. */
export function differences(ours, theirs, path = "") {
  if (typeof ours !== "object" || typeof theirs !== "object" || ours === null || theirs === null) return ours === theirs ? [] : [`${path}: ${JSON.stringify(ours)}, not ${JSON.stringify(theirs)}`];
  const names = new Set([...Object.keys(ours), ...Object.keys(theirs)]);
  names.delete("written_by");
  return [...names].flatMap((name) => differences(ours[name], theirs[name], `${path}.${name}`));
}
