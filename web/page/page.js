// The page: takes files, has a worker for each job, shows and saves what comes of it. Texts of files reach the document as text only;
// reports are shown in a frame without any rights over this page.
"use strict";
/** Together; the module has 1 GiB for contents and analysis. */
const MOST_BYTES = 600e6;
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
  for (const file of files) chosen.push({ file, name: file.name, role: role(file.name) });
  show();
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
      row.append(make("span", entry.role === "model" ? "model of the sensors, or effects" : "parameters of the vehicle", { class: "quiet" }));
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
  at("work").hidden = !running;
}

/** One worker for one job; its answer. */
function work(command, files) {
  return new Promise((resolve) => {
    const url = URL.createObjectURL(new Blob([at("worker").textContent], { type: "text/javascript" }));
    const worker = new Worker(url);
    const began = performance.now();
    let latest = { progress: "starting", done: 0, total: 0 };
    const status = () => {
      const seconds = (performance.now() - began) / 1000;
      const left = latest.done > 0 && latest.done < latest.total ? `, about ${Math.ceil(seconds * (latest.total / latest.done - 1))} s left` : "";
      at("doing").textContent = `${files.map((f) => f.name).join(", ")}: ${latest.progress} (${Math.round(seconds)} s so far${left})`;
      if (latest.total > 0) at("bar").value = latest.done / latest.total;
      else at("bar").removeAttribute("value");
    };
    const clock = setInterval(status, 500);
    const end = (answer) => {
      clearInterval(clock);
      worker.terminate();
      URL.revokeObjectURL(url);
      resolve({ ...answer, seconds: (performance.now() - began) / 1000 });
    };
    running = { stop: () => end({ stopped: true }) };
    worker.onerror = (event) => { event.preventDefault(); end({ failed: `The analysis could not be started: ${event.message ?? "the browser gave no reason"}` }); };
    worker.onmessage = ({ data }) => {
      if (data.progress === undefined) return end(data);
      latest = data;
      return status();
    };
    status();
    worker.postMessage({ packed: at("module").textContent.replace(/\s/g, ""), command, files });
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
    const type = name.endsWith(".html") ? "text/html" : name.endsWith(".json") ? "application/json" : "text/plain";
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

async function start(command, title, files) {
  trouble("");
  const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
  if (bytes > MOST_BYTES) {
    trouble(`${title}: ${size(bytes)} are more than a page can analyse (${size(MOST_BYTES)}): take fewer logs, or the program itself.`);
    return false;
  }
  const job = work(command, files.map(({ name, role, file }) => ({ name, role, file })));
  enable();
  const answer = await job;
  running = null;
  enable();
  if (answer.stopped) return false;
  if (answer.failed) trouble(`${title}: ${answer.failed}`);
  else result(title, answer);
  return !answer.failed;
}

const others = () => chosen.filter(({ role }) => role !== "log" && role !== "validate");
const names = () => logs().map(({ name }) => name).join(", ");
at("report").onclick = async () => {
  for (const log of logs()) if (!(await start("report", `Report of ${log.name}`, [log, ...others()]))) return;
};
at("explain").onclick = () => start("explain", `Explanation of ${names()}`, chosen.slice());
at("compare").onclick = () => start("compare", `Comparison of ${names()}`, [...logs(), ...others()]);
at("stop").onclick = () => running?.stop();
at("files").onchange = (event) => { take([...event.target.files]); event.target.value = ""; };
document.addEventListener("dragover", (event) => { event.preventDefault(); at("drop").classList.add("over"); });
document.addEventListener("dragleave", () => at("drop").classList.remove("over"));
document.addEventListener("drop", (event) => { event.preventDefault(); at("drop").classList.remove("over"); take([...event.dataTransfer.files]); });

// From a server: later also without it.
at("along").hidden = !location.protocol.startsWith("http");
const kept = location.protocol.startsWith("http") && navigator.serviceWorker ? navigator.serviceWorker.register("sw.js").then(() => navigator.serviceWorker.ready).catch(() => {}) : Promise.resolve();
kept.then(() => { document.body.dataset.ready = "true"; });
