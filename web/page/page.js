// The page: takes files, has a worker for each job, shows and saves what comes of it. Texts of files reach the document as text only;
// reports are shown in a frame without any rights over this page.
"use strict";
/** Together; the module has 1 GiB for contents and analysis. */
const MOST_BYTES = 600e6;
const LOG = /\.(bin|ulg|tlog|mcap)$/i;
const ROLES = { log: "analyse", validate: "hold out: only judges" };
const at = (id) => document.getElementById(id);
const chosen = [];
let running = null;

/** An element with its text and attributes. */
function make(tag, text, attributes = {}) {
  const element = document.createElement(tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

function trouble(text) {
  at("trouble").textContent = text;
  at("trouble").hidden = !text;
}

function role(name) {
  if (/\.toml$/i.test(name)) return "model";
  return /\.(param|params|parm)$/i.test(name) ? "parameters" : "log";
}

function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

function take(files) {
  trouble("");
  for (const { file, name } of files) chosen.push({ file, name, role: role(name) });
  show();
}

/** The logs below a dropped entry, by their paths in it; what was dropped itself is taken whatever its name. */
async function below(entry, top = true) {
  if (entry.isFile) {
    if (!top && !LOG.test(entry.name)) return [];
    const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
    return [{ file, name: entry.fullPath.slice(1) }];
  }
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return found;
    for (const inner of some) found.push(...(await below(inner, false)));
  }
}

async function dropped(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (entries.length === 0) return take([...transfer.files].map((file) => ({ file, name: file.name })));
  try {
    const found = (await Promise.all(entries.map((entry) => below(entry)))).flat();
    take(found.sort((a, b) => (a.name < b.name ? -1 : 1)));
    if (found.length === 0) trouble("There is no .bin, .ulg, .tlog or .mcap in the folder.");
  } catch (error) {
    trouble(`What was dropped cannot be read: ${error.message}`);
  }
}

function show() {
  at("chosen").replaceChildren(...chosen.map((entry) => {
    const row = make("li", "");
    row.append(make("span", entry.name, { class: "name" }), make("span", size(entry.file.size), { class: "quiet" }));
    if (entry.role in ROLES) {
      const select = make("select", "", { "aria-label": `What to do with ${entry.name}` });
      select.append(...Object.entries(ROLES).map(([value, words]) => make("option", words, { value })));
      select.value = entry.role;
      select.onchange = () => { entry.role = select.value; enable(); };
      row.append(select);
    } else {
      row.append(make("span", entry.role === "model" ? "model of the sensors, effects, or a unit" : "parameters of the vehicle", { class: "quiet" }));
    }
    const remove = make("button", "Remove", { type: "button", "aria-label": `Remove ${entry.name}` });
    remove.onclick = () => { chosen.splice(chosen.indexOf(entry), 1); show(); };
    row.append(remove);
    return row;
  }));
  enable();
}

const logs = () => chosen.filter((entry) => entry.role === "log");

function enable() {
  at("report").disabled = running || logs().length === 0;
  at("explain").disabled = running || logs().length === 0;
  at("compare").disabled = running || logs().length !== 2;
  at("fleet").disabled = running || logs().length < 2;
  at("work").hidden = !running;
}

/** A worker for one order; `end` frees all that it has. */
function employ(order, answer) {
  const url = URL.createObjectURL(new Blob([at("worker").textContent], { type: "text/javascript" }));
  const worker = new Worker(url);
  worker.onerror = (event) => { event.preventDefault(); answer({ ended: true, failed: `The analysis could not be started: ${event.message ?? "the browser gave no reason"}` }); };
  worker.onmessage = ({ data }) => answer(data);
  worker.postMessage({ packed: at("module").textContent.replace(/\s/g, ""), ...order });
  const end = () => { worker.terminate(); URL.revokeObjectURL(url); };
  return { post: (message, transfer) => worker.postMessage(message, transfer), end };
}

const today = () => new Date().toISOString().slice(0, 10);

/** One worker for one job; its answer. `which`: of several jobs. */
function work(command, files, which) {
  return new Promise((resolve) => {
    const began = performance.now();
    let latest = { progress: "starting", done: 0, total: 0 };
    const status = () => {
      const seconds = (performance.now() - began) / 1000;
      const left = latest.done > 0 && latest.done < latest.total ? `, about ${Math.ceil(seconds * (latest.total / latest.done - 1))} s left` : "";
      at("doing").textContent = `${which}${command === "fleet" ? "all logs" : files.map((f) => f.name).join(", ")}: ${latest.progress} (${Math.round(seconds)} s so far${left})`;
      if (latest.total > 0) at("bar").value = latest.done / latest.total;
      else at("bar").removeAttribute("value");
    };
    const clock = setInterval(status, 500);
    const end = (answer) => {
      clearInterval(clock);
      worker.end();
      resolve({ ...answer, seconds: (performance.now() - began) / 1000 });
    };
    running = { stop: () => end({ stopped: true }) };
    const worker = employ({ command, today: today(), files }, (data) => {
      if (data.progress === undefined) return end(data);
      latest = data;
      return status();
    });
    status();
  });
}

function result(title, { done, seconds, memory }) {
  const box = make("section", "", { class: "result", "data-seconds": seconds.toFixed(2), "data-memory": memory });
  const header = make("header", "");
  const remove = make("button", "Remove", { type: "button", "aria-label": `Remove ${title}` });
  header.append(make("h2", title), remove);
  const urls = [];
  const saves = make("ul", "", { class: "saves" });
  const link = (words, { name, text }, attributes) => {
    const type = name.endsWith(".html") ? "text/html" : name.endsWith(".json") ? "application/json" : name.endsWith(".tlog") ? "application/octet-stream" : "text/plain";
    urls.push(URL.createObjectURL(new Blob([text], { type: `${type};charset=utf-8` })));
    const item = make("li", "");
    item.append(make("a", words, { href: urls.at(-1), ...attributes }));
    saves.append(item);
  };
  const page = done.files.find(({ name }) => name.endsWith(".html"));
  if (page) link("Open the report alone, to print it", page, { target: "_blank", rel: "noopener" });
  for (const file of done.files) link(`Save ${file.name}`, file, { download: file.name });
  remove.onclick = () => { box.remove(); urls.forEach((url) => URL.revokeObjectURL(url)); };
  box.append(header, ...done.words.map((sentence) => make("p", sentence)), saves);
  if (page) {
    const frame = make("iframe", "", { sandbox: "allow-scripts allow-downloads", title });
    frame.srcdoc = page.text;
    box.append(frame);
  }
  at("results").prepend(box);
}

/** The answer of one worker; too much for it is a failure like others. */
async function answered(command, files, which = "") {
  const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
  if (bytes > MOST_BYTES) return { failed: `${size(bytes)} are more than a page can analyse (${size(MOST_BYTES)}): take fewer logs, or the program itself.` };
  const job = work(command, files.map(({ name, role, file }) => ({ name, role, file })), which);
  enable();
  const answer = await job;
  running = null;
  enable();
  return answer;
}

async function start(command, title, files) {
  trouble("");
  const answer = await answered(command, files);
  if (answer.failed) trouble(`${title}: ${answer.failed}`);
  else if (answer.done) result(title, answer);
  return !answer.failed && !answer.stopped;
}

/** Each log by a worker of its own, whose memory ends with it; then what they have in common. A log that fails is an entry with the reason. */
async function fleet(files) {
  const entries = [];
  for (const [k, log] of files.entries()) {
    const answer = await answered("fleet_log", [log, ...others()], `log ${k + 1} of ${files.length}, `);
    if (answer.stopped) return;
    const failed = answer.failed && JSON.stringify({ schema: "gaware.fleet_flight/1", sha256: "", bytes: log.file.size, failed: answer.failed, flight: null });
    entries.push({ name: log.name, role: "entry", file: new Blob([failed ?? answer.done.files[0].text]) });
  }
  await start("fleet", `Fleet of ${files.length} logs`, entries);
}

const others = () => chosen.filter(({ role }) => role !== "log" && role !== "validate");
const names = () => logs().map(({ name }) => name).join(", ");
at("report").onclick = async () => {
  for (const log of logs()) if (!(await start("report", `Report of ${log.name}`, [log, ...others()]))) return;
};
at("explain").onclick = () => start("explain", `Explanation of ${names()}`, chosen.slice());
at("compare").onclick = () => start("compare", `Comparison of ${names()}`, [...logs(), ...others()]);
at("fleet").onclick = () => { trouble(""); fleet(logs()); };
at("stop").onclick = () => running?.stop();
at("files").onchange = (event) => { take([...event.target.files].map((file) => ({ file, name: file.name }))); event.target.value = ""; };
document.addEventListener("dragover", (event) => { event.preventDefault(); at("drop").classList.add("over"); });
document.addEventListener("dragleave", () => at("drop").classList.remove("over"));
document.addEventListener("drop", (event) => { event.preventDefault(); at("drop").classList.remove("over"); dropped(event.dataTransfer); });

// From a server: later also without it.
at("along").hidden = !location.protocol.startsWith("http");
const kept = location.protocol.startsWith("http") && navigator.serviceWorker ? navigator.serviceWorker.register("sw.js").then(() => navigator.serviceWorker.ready).catch(() => {}) : Promise.resolve();
kept.then(() => { document.body.dataset.ready = "true"; return named(); });
addEventListener("hashchange", named);

/** The log that the page's address names (#url=…), of its own server only. The page may ask for nothing (its policy): its keeper does (sw.js). */
async function named() {
  const text = new URLSearchParams(location.hash.slice(1)).get("url");
  if (!text) return;
  const refuse = (why) => trouble(`The log that the address of this page names cannot be taken: ${why}. Download it and drop it here.`);
  const url = URL.canParse(text, location.href) ? new URL(text, location.href) : null;
  if (!url?.protocol.startsWith("http") || url.origin !== location.origin) return refuse("it is not on the server of this page");
  if (!navigator.serviceWorker) return refuse("that needs https, or a server on this computer");
  const name = url.pathname.split("/").at(-1) || "log";
  at("doing").textContent = `Taking ${name} from the server of this page`;
  at("work").hidden = false;
  const { port1, port2 } = new MessageChannel();
  const answer = new Promise((resolve) => { port1.onmessage = ({ data }) => resolve(data); });
  (await navigator.serviceWorker.ready).active.postMessage({ url: url.href }, [port2]);
  const { content, failed } = await answer;
  enable();
  if (failed) return refuse(failed);
  return take([{ file: new File([content], name), name }]);
}
