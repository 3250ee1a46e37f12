// The analysis in Firefox, where there is one (FIREFOX=/path, default /usr/bin/firefox-esr): the same numbers as the program. Driven by Marionette,
// Firefox's own protocol: lengths and JSON over TCP.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { createServer, connect } from "node:net";
import { once } from "node:events";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { test } from "node:test";
import { differences } from "./harness.mjs";

const FIREFOX = process.env.FIREFOX ?? "/usr/bin/firefox-esr";
const SMALL = new URL("../data/small_gsens_typical_dither.tlog", import.meta.url).pathname;

/** A port of this machine that is free now. */
async function free() {
  const server = createServer().listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = server.address();
  server.close();
  return port;
}

/** Starts Firefox with a profile of its own; `ask` is a command and its answer. */
async function firefox(profile) {
  const port = await free();
  writeFileSync(join(profile, "user.js"), `user_pref("marionette.port", ${port});\n`);
  const child = spawn(FIREFOX, ["--headless", "--marionette", "--no-remote", "--profile", profile], { stdio: ["ignore", "pipe", "pipe"] });
  // It says when it listens.
  await Promise.race([child.stdout, child.stderr].map(async (stream) => {
    for await (const line of createInterface({ input: stream })) if (/Listening on port/i.test(line)) return;
  }));
  const socket = connect(port, "127.0.0.1");
  let rest = Buffer.alloc(0);
  const waiting = [];
  socket.on("data", (data) => {
    rest = Buffer.concat([rest, data]);
    for (let colon; (colon = rest.indexOf(58)) > 0; ) {
      const end = colon + 1 + Number(rest.subarray(0, colon));
      if (rest.length < end) return;
      const message = JSON.parse(rest.subarray(colon + 1, end));
      rest = rest.subarray(end);
      if (Array.isArray(message)) waiting.shift()(message);
    }
  });
  let number = 0;
  const ask = async (command, parameters = {}) => {
    const text = JSON.stringify([0, number += 1, command, parameters]);
    socket.write(`${Buffer.byteLength(text)}:${text}`);
    const [, , error, result] = await new Promise((done) => waiting.push(done));
    if (error) throw new Error(`${command}: ${error.message}`);
    return result?.value ?? result;
  };
  await ask("WebDriver:NewSession", { timeouts: { script: 300000 } });
  return { ask, async close() { socket.destroy(); child.kill("SIGKILL"); await once(child, "exit"); } };
}

test("Firefox has the numbers of the program, and says that it has no serial ports", { skip: !existsSync(FIREFOX) && `no ${FIREFOX}` }, async () => {
  const profile = mkdtempSync(join(tmpdir(), "gaware-firefox-"));
  const { ask, close } = await firefox(profile);
  try {
    await ask("WebDriver:Navigate", { url: `file://${process.env.ANALYSIS}` });
    const [input] = Object.values(await ask("WebDriver:FindElement", { using: "css selector", value: "#files" }));
    await ask("WebDriver:ElementSendKeys", { id: input, text: SMALL });
    const text = await ask("WebDriver:ExecuteAsyncScript", { sandbox: null, args: [], script: `
      const done = arguments[arguments.length - 1];
      // The file of the result, as it would be saved, or the sentence where there is none.
      const own = URL.createObjectURL;
      URL.createObjectURL = (blob) => {
        if (blob.type.startsWith("application/json")) blob.text().then(done);
        return own.call(URL, blob);
      };
      const trouble = document.getElementById("trouble");
      new MutationObserver(() => trouble.textContent && done(trouble.textContent)).observe(trouble, { childList: true });
      document.getElementById("report").click();` });
    assert.match(text, /^\{/);
    const ours = JSON.parse(text);
    delete ours.compasses;
    delete ours.air;
    const theirs = JSON.parse(execFileSync(process.env.GAWARE, ["replay", SMALL, "--json"], { stdio: ["ignore", "pipe", "ignore"], maxBuffer: 1 << 30 }));
    assert.deepEqual(differences(ours, theirs), []);
    const said = await ask("WebDriver:ExecuteScript", { sandbox: null, args: [], script: `return [navigator.serial === undefined, document.getElementById("no-serial").textContent];` });
    assert.equal(/Chrome or Edge/.test(said[1]), said[0]);
  } finally {
    await close();
    rmSync(profile, { recursive: true, force: true });
  }
});
