import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open, serve } from "./harness.mjs";

const TOKEN = "fly-the-steep-turn";
let browser;
before(async () => { browser = await launch(); });
after(() => browser.close());

const instruction = (page) => page.locator("#instruction");
const shows = (page, words) => page.waitForFunction(
  (text) => document.querySelector("#instruction")?.textContent.includes(text), words,
);

test("the instruction changes with the flight, and the conditions turn true", async () => {
  // It stands still after 20, 60 and 100 s until the page has shown that.
  const server = await serve("--bind", "127.0.0.1:0", "--speed", "8", "--stops", "40");
  const { page, errors, close } = await open(browser);
  await page.goto(server.url);
  await shows(page, "throttle full to idle");
  assert.equal(await instruction(page).getAttribute("aria-live"), "assertive");
  server.go();
  await shows(page, "Steep turn right");
  server.go();
  await shows(page, "full rudder");
  server.go();
  await page.waitForFunction(() => document.querySelectorAll('.ring[data-met="true"]').length === 3);
  await page.waitForFunction(() => document.querySelectorAll('.cell[data-status="observable"]').length === 9);
  await page.waitForFunction(() => document.querySelector("#hero-title").textContent === "Done");
  await page.waitForFunction(() => document.querySelector("#events").textContent.includes("Condition (c) met"));
  assert.deepEqual(errors, []);
  await close();
  await server.stop();
});

test("a lost connection is said loudly, and the page returns by itself after a restart", async () => {
  const first = await serve("--bind", "127.0.0.1:0", "--from", "20", "--speed", "0.1");
  const { page, close } = await open(browser);
  await page.goto(first.url);
  await shows(page, "throttle full to idle");
  await first.kill();
  await page.locator("#lost").waitFor({ state: "visible", timeout: 10000 });
  assert.match(await page.locator("#lost").textContent(), /Connection to gaware lost/);
  const second = await serve("--bind", `127.0.0.1:${first.port}`, "--from", "50", "--speed", "0.1");
  await shows(page, "Steep turn right");
  await page.locator("#lost").waitFor({ state: "hidden", timeout: 10000 });
  // An orderly end is none.
  await second.stop();
  await shows(page, "gaware has ended");
  // What is next, with the file of the recording.
  assert.match(await page.locator("#reason").textContent(), /gaware report and gaware explain on \S+\.mcap/);
  assert.ok(await page.locator("#lost").isHidden());
  const third = await serve("--bind", `127.0.0.1:${first.port}`, "--from", "50", "--speed", "0.1");
  await shows(page, "Steep turn right");
  await close();
  await third.stop();
});

test("beyond localhost the page opens with the token only, and keeps it out of the address", async () => {
  const server = await serve("--bind", "0.0.0.0:0", "--token", TOKEN, "--from", "20", "--speed", "0.1", "--commands");
  const base = `http://127.0.0.1:${server.port}/`;
  assert.equal((await fetch(`${base}api/v1/status`)).status, 401);
  const { page, close } = await open(browser);
  assert.equal((await page.goto(base)).status(), 401);
  await page.fill("#token", "not-the-token-at-all");
  await page.click("button");
  await page.waitForURL(/not-the-token/);
  assert.equal(await page.locator("#instruction").count(), 0);
  await page.fill("#token", TOKEN);
  await page.click("button");
  await shows(page, "throttle full to idle");
  assert.equal(page.url(), base);
  assert.equal(await page.evaluate(() => document.cookie), "");

  await page.click("#upload");
  await page.click("#confirm button[value=no]");
  assert.equal(await page.locator("#upload-result").textContent(), "");
  await page.click("#upload");
  await page.click("#confirm button[value=yes]");
  await page.waitForFunction(() => document.querySelector("#upload-result").textContent.includes("read back"));
  await close();
  await server.stop();
});

test("parameters are set after a question that names their values, and only they where there is no mission", async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--token", TOKEN, "--from", "30", "--speed", "0.1", "--commands", "--parameters");
  for (const viewport of [{ width: 1280, height: 900 }, { width: 390, height: 844 }]) {
    const { page, errors, close } = await open(browser, { viewport });
    await page.goto(`${server.url}?token=${TOKEN}`);
    await page.waitForSelector("#set-parameters:visible");
    assert.equal(await page.locator("#upload").isVisible(), false);
    await page.click("#set-parameters");
    assert.deepEqual(await page.locator("#parameters-values li").allTextContents(), ["GPS1_DELAY_MS 213", "GPS1_POS_X 0.42"]);
    await page.click("#confirm-parameters button[value=no]");
    assert.match(await page.locator("#parameters-result").textContent(), /2 parameters of autopilot.param can be set/);
    await page.click("#set-parameters");
    await page.click("#confirm-parameters button[value=yes]");
    await page.waitForFunction(() => document.querySelector("#parameters-result").textContent.startsWith("Not done: no parameter"));
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true);
    assert.deepEqual(errors.filter((text) => !text.includes("409")), []);
    await close();
  }
  await server.stop();
});

test("without the token the upload button asks for it, and before there is an estimate there is no figure", async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--token", TOKEN, "--from", "0", "--speed", "0.1", "--commands");
  const { page, close } = await open(browser);
  await page.goto(server.url);
  await page.waitForFunction(() => document.querySelectorAll(".cell").length === 9);
  assert.equal(await page.evaluate(() => document.body.innerText.match(/[+−]?\d+\.\d\n±/)), null);
  assert.equal(await page.locator("#weak").isVisible(), false);
  // The button is shown once the page knows what it may do.
  await page.waitForSelector("#upload:visible");
  assert.match(await page.locator("#upload").textContent(), /Sign in/);
  await page.click("#upload");
  await page.fill("#sign-in input", TOKEN);
  await page.click("#sign-in button[type=submit]");
  await page.waitForFunction(() => {
    const button = document.querySelector("#upload");
    return button?.offsetParent && button.textContent.startsWith("Upload") && location.search === "";
  });
  await close();
  await server.stop();
});

test("a server beyond localhost without a token does not start", async () => {
  await assert.rejects(serve("--bind", "0.0.0.0:0"), /ended with 1/);
});

test("from 360 to 1920 pixels nothing scrolls sideways, nothing is cut, and the buttons can be hit", async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--from", "60", "--speed", "0.1");
  for (const width of [360, 390, 768, 1280, 1920]) {
    const { page, errors, close } = await open(browser, { viewport: { width, height: 900 } });
    await page.goto(server.url);
    await shows(page, "Steep turn right");
    await page.waitForFunction(() => document.querySelectorAll(".u-legend").length === 3);
    const sizes = await page.evaluate(() => ({
      scroll: document.documentElement.scrollWidth,
      inner: window.innerWidth,
      wide: [...document.querySelectorAll("main *")]
        .filter((e) => !e.closest(".sr, svg") && e.getBoundingClientRect().right > window.innerWidth + 0.5)
        .map((e) => e.className || e.tagName),
      cut: [...document.querySelectorAll(".g-value, .g-sigma, .list td, .list th, .g th")]
        .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline")
        .map((e) => e.textContent),
      legends: [...document.querySelectorAll(".u-legend")].filter((e) => e.scrollHeight > e.clientHeight).map((e) => e.textContent),
      // The longest figures of a flight, a latency known to a tenth of a millisecond among them, beside the card's edge.
      aside: (() => {
        const table = document.querySelector("#states");
        const [first, last] = [[...table.rows].at(-2).cells, [...table.rows].at(-1).cells];
        first[2].innerHTML = "360 <small>deg/h/g</small>";
        [last[0].textContent, last[2].innerHTML, last[3].textContent] = ["latency", "0.0015 <small>s</small>", "0.040"];
        return table.scrollWidth - table.parentElement.clientWidth;
      })(),
      // Each element of G with its border, within what the card shows.
      hidden: [...document.querySelectorAll(".cell")].filter((e) => {
        const [cell, shown] = [e.getBoundingClientRect(), e.closest(".rest").getBoundingClientRect()];
        return cell.bottom > shown.bottom + 0.5 || cell.right > shown.right + 0.5;
      }).map((e) => e.textContent),
      broken: [...document.querySelectorAll(".list thead th")].filter((e) => {
        const words = document.createRange();
        words.selectNodeContents(e);
        return words.getClientRects().length > 1;
      }).map((e) => e.textContent),
      theme: document.querySelector("#theme").getBoundingClientRect().height,
    }));
    assert.ok(sizes.scroll <= sizes.inner, `${width}: scrolls to ${sizes.scroll}`);
    assert.deepEqual(sizes.wide, [], `at ${width}`);
    assert.deepEqual(sizes.cut, [], `at ${width}`);
    // Widths are fractions of a pixel.
    assert.ok(sizes.aside <= 1, `at ${width}: ${sizes.aside} px beyond the card`);
    assert.deepEqual(sizes.legends, [], `at ${width}`);
    assert.deepEqual(sizes.hidden, [], `at ${width}`);
    assert.deepEqual(sizes.broken, [], `at ${width}`);
    assert.ok(sizes.theme >= 44);
    assert.deepEqual(errors, []);
    await close();
  }
  await server.stop();
});

/** Contrast of every text against the nearest opaque background, by WCAG's formula. */
function contrasts() {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (css) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = css;
    canvas.fillRect(0, 0, 1, 1);
    return canvas.getImageData(0, 0, 1, 1).data;
  };
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const poor = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own || !element.offsetParent || element.closest(".sr, noscript, svg, dialog, .skip")) continue;
    let behind = element;
    while (behind && rgba(getComputedStyle(behind).backgroundColor)[3] < 255) behind = behind.parentElement;
    const [a, b] = [light(rgba(getComputedStyle(element).color)), light(rgba(getComputedStyle(behind ?? document.body).backgroundColor))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.push(`${element.textContent.trim().slice(0, 30)}: ${ratio.toFixed(1)}`);
  }
  return [...new Set(poor)];
}

for (const colorScheme of ["light", "dark"]) {
  test(`every text has contrast in ${colorScheme} colours`, async () => {
    for (const viewport of [{ width: 1440, height: 1000 }, { width: 390, height: 844 }]) {
      const server = await serve("--bind", "127.0.0.1:0", "--from", "66", "--speed", "0.1", "--freeze");
      const { page, errors, close } = await open(browser, { viewport, colorScheme, deviceScaleFactor: 1 });
      await page.goto(server.url);
      await shows(page, "Steep turn right");
      await page.waitForFunction(() => document.querySelector("#events").children.length > 3);
      assert.deepEqual(await page.evaluate(contrasts), []);
      assert.ok(await page.evaluate(() => document.querySelectorAll("h1").length === 1 && document.querySelectorAll("main h2").length >= 8));
      assert.deepEqual(errors, []);
      await close();
      await server.stop();
    }
  });
}

test("the button overrules the system's colours and is remembered", async () => {
  const server = await serve("--bind", "127.0.0.1:0", "--from", "20", "--speed", "0.1");
  const { page, close } = await open(browser, { colorScheme: "light" });
  const background = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  await page.goto(server.url);
  const light = await background();
  await page.focus("#theme");
  await page.keyboard.press("Enter");
  assert.equal(await page.getAttribute("html", "data-theme"), "light");
  await page.keyboard.press("Enter");
  assert.equal(await page.getAttribute("html", "data-theme"), "dark");
  assert.notEqual(await background(), light);
  await page.reload();
  assert.equal(await page.getAttribute("html", "data-theme"), "dark");
  await close();
  await server.stop();
});
