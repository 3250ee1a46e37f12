// The package for others' pages and programs, as npm packs it, in Node: the same results as the program.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import { differences } from "./harness.mjs";

const ROOT = new URL("../../", import.meta.url).pathname;
const SMALL = join(ROOT, "tests/data/small_gsens_typical_dither.tlog");
const folder = mkdtempSync(join(tmpdir(), "gaware-package-"));
let gaware;
before(async () => {
  const from = join(dirname(process.env.ANALYSIS), "npm");
  const [{ filename }] = JSON.parse(execFileSync("npm", ["pack", "--json", "--pack-destination", folder, from], { cwd: folder }));
  execFileSync("npm", ["install", "--no-audit", "--no-fund", "--offline", join(folder, filename)], { cwd: folder });
  const { load } = await import(join(folder, "node_modules/gaware/index.js"));
  gaware = await load();
});
after(() => rmSync(folder, { recursive: true }));

const log = () => ({ name: "flight.tlog", content: readFileSync(SMALL) });
const native = (...args) => JSON.parse(execFileSync(process.env.GAWARE, args, { stdio: ["ignore", "pipe", "ignore"], maxBuffer: 1 << 30 }));

test("a replay has the estimate of the program's", async () => {
  const steps = [];
  const ours = await gaware.replay(log(), { progress: ({ progress }) => steps.push(progress) });
  const theirs = native("replay", SMALL, "--json");
  assert.deepEqual(differences(ours.estimate, theirs.estimate), []);
  assert.deepEqual(differences(ours.gnss, theirs.gnss), []);
  assert.ok(steps.includes("estimating along the flight"), steps.join());
});

test("an explanation names what the program's names", async () => {
  const { words, files } = await gaware.explain(log());
  const ours = JSON.parse(files.find(({ name }) => name === "report.json").text);
  const theirs = native("explain", SMALL, "--json", "--out", join(folder, "explained"));
  assert.deepEqual(differences(ours.effects, theirs.effects), []);
  assert.equal(ours.verdict, theirs.verdict);
  assert.ok(words.length > 0 && files.some(({ name }) => name === "model.toml"));
});

test("what is no log is refused with a sentence, and the next job works", async () => {
  await assert.rejects(gaware.replay({ name: "rubbish.bin", content: new Uint8Array(5000) }), /rubbish\.bin/);
  assert.equal((await gaware.replay(log())).gnss.used > 0, true);
});
