// The pictures of the documentation, taken of the program itself: `gaware demo` in mid-flight.

import { spawn } from "node:child_process";
import { launch, open } from "./harness.mjs";

const DOCS = new URL("../../docs/", import.meta.url).pathname;
const ADDRESS = "127.0.0.1:18081";
/** Seconds of flight before the picture. */
const MOMENT_S = 300;

const demo = spawn(process.env.GAWARE, ["demo", "--headless", "--speed", "8", "--web", ADDRESS, "--report", "/dev/null"], { stdio: "ignore" });
const browser = await launch();
try {
  const pages = [];
  for (const colorScheme of ["light", "dark"]) {
    for (const [name, viewport] of [["", { width: 1440, height: 1000 }], ["-phone", { width: 390, height: 844 }]]) {
      const opened = await open(browser, { viewport, colorScheme, deviceScaleFactor: 1 });
      pages.push({ ...opened, path: `${DOCS}web-${colorScheme}${name}.png` });
    }
  }
  for (const { page } of pages) {
    for (let tries = 0; ; tries += 1) {
      try {
        await page.goto(`http://${ADDRESS}/`);
        break;
      } catch (error) {
        if (tries > 50) throw error;
        await page.waitForTimeout(200);
      }
    }
  }
  await pages[0].page.waitForFunction((s) => document.querySelector("#clock").textContent.split(":").reduce((a, x) => 60 * a + Number(x), 0) >= s, MOMENT_S, { timeout: 300000 });
  for (const { page, path } of pages) await page.screenshot({ path });
} finally {
  await browser.close();
  demo.kill("SIGINT");
}
