// Snapshot and sinks into the page. Touches an element only when its text changes: screen readers, and batteries.

import { PHASE, STATUS, brief, bytes, clock, count, num, signed } from "./format.js";

const $ = (id) => document.getElementById(id);

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function setAttr(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

function make(tag, className, text) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

function chip(id, level, value) {
  const element = $(id);
  setAttr(element, "data-level", level);
  setText(element.querySelector(".value"), value);
}

/* The instruction */

/* What is to be flown first stands large, what follows below it. */
function steps(element, text) {
  if (element.textContent === text) return;
  const [first, ...then] = text.split(/(?= Then: )/);
  element.replaceChildren(first, ...then.map((step) => make("span", "then", step)));
}

function hero(s) {
  const g = s.guidance;
  const running = s.phase === "running";
  let [kicker, text, level] = ["Fly now", g.instruction, "fly"];
  if (!running) [kicker, text, level] = [PHASE[s.phase] ?? "Waiting", s.waiting_for || PHASE[s.phase], "wait"];
  else if (g.done) [kicker, text, level] = ["Done", "Everything this airframe can show is known", "done"];
  else if (!g.instruction) [kicker, text, level] = ["Stand by", "No instruction yet", "wait"];
  setText($("hero-title"), kicker);
  steps($("instruction"), text.charAt(0).toUpperCase() + text.slice(1));
  setAttr($("hero"), "data-level", level);
  setText($("reason"), level === "fly" ? g.reason : "");
  $("flown").hidden = level !== "fly";
  const progress = Math.min(1, Math.max(0, g.progress || 0));
  $("progress").value = progress;
  setText($("progress-text"), `${Math.round(progress * 100)} %`);
  $("result").hidden = !g.last_result;
  setText($("result"), (g.last_result || "").charAt(0).toUpperCase() + (g.last_result || "").slice(1));
}

/* Rings */

const RADIUS = 30;
const CONDITIONS = { a: "Attitude and biases", b: "Diagonal of G", c: "All nine elements of G" };

function svg(tag, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

function ring(letter) {
  const item = make("li", "ring");
  const face = svg("svg", { viewBox: "0 0 72 72", role: "img" });
  const around = { cx: 36, cy: 36, r: RADIUS, pathLength: 100 };
  face.append(
    svg("circle", { ...around, class: "ring-back" }),
    svg("circle", { ...around, class: "ring-front", transform: "rotate(-90 36 36)", "stroke-dasharray": "0 100" }),
    svg("text", { x: 36, y: 35, class: "ring-letter" }),
  );
  face.querySelector("text").textContent = letter;
  const words = make("div", "ring-words");
  const head = make("h3", "", "");
  head.append(make("span", "", CONDITIONS[letter]), make("span", "percent", "0 %"));
  words.append(head, make("p", "missing", ""));
  item.append(face, words);
  return item;
}

function rings(conditions) {
  const list = $("rings");
  if (list.children.length === 0) list.append(...Object.keys(CONDITIONS).map(ring));
  Object.keys(CONDITIONS).forEach((letter, i) => {
    const c = conditions[letter];
    const item = list.children[i];
    const percent = c.met ? 100 : Math.min(99, Math.floor((c.progress || 0) * 100));
    setAttr(item, "data-met", String(c.met));
    setAttr(item.querySelector(".ring-front"), "stroke-dasharray", `${percent} 100`);
    setText(item.querySelector(".percent"), c.met ? "met ✓" : `${percent} %`);
    setText(item.querySelector(".missing"), c.met ? "" : c.missing || "");
    setAttr(item.querySelector("svg"), "aria-label", `Condition ${letter}: ${c.met ? "met" : `${percent} percent`}`);
  });
}

/* G */

const ROWS = [["x", "roll"], ["y", "pitch"], ["z", "yaw"]];

function buildG(body) {
  for (const [axis, about] of ROWS) {
    const row = make("tr");
    const head = make("th");
    head.scope = "row";
    head.append(`gyro ${axis} `, make("small", "", about));
    row.append(head);
    for (let column = 0; column < 3; column += 1) {
      const cell = make("td", "cell");
      const bar = make("span", "bar");
      bar.append(make("span", "fill"));
      const mark = make("span", "mark");
      mark.setAttribute("aria-hidden", "true");
      cell.append(mark, make("span", "g-value"), make("span", "g-sigma"), bar, make("span", "sr"));
      row.append(cell);
    }
    body.append(row);
  }
  for (const [key, { mark, word }] of Object.entries(STATUS)) {
    const item = make("li", "", "");
    item.dataset.status = key;
    item.append(make("span", "mark", mark), word);
    $("g-legend").append(item);
  }
}

/** How much of the way from the first sigma to the target is done, on a logarithmic scale, 0 to 1. */
function wayToTarget(state) {
  const prior = state.sigma / state.sigma_ratio;
  if (!(state.sigma > 0 && state.target > 0 && prior > state.target)) return state.status === "observable" ? 1 : 0;
  return Math.min(1, Math.max(0, Math.log(prior / state.sigma) / Math.log(prior / state.target)));
}

function gMatrix(s) {
  const body = $("g").tBodies[0];
  if (body.rows.length === 0) buildG(body);
  const states = new Map(s.observability.states.map((x) => [x.name, x]));
  const g = s.estimate.g_sensitivity_deg_per_h_per_g;
  for (let r = 0; r < 3; r += 1) {
    for (let c = 0; c < 3; c += 1) {
      const cell = body.rows[r].cells[c + 1];
      const state = states.get(`g${r + 1}${c + 1}`);
      const status = state?.status ?? "unobservable";
      setAttr(cell, "data-status", status);
      setText(cell.children[0], STATUS[status].mark);
      // No filter gives a sigma of zero: nothing is estimated yet.
      const estimated = g.sigma[r][c] > 0;
      setText(cell.children[1], estimated ? signed(g.value[r][c], 1) : "–");
      setText(cell.children[2], estimated ? `± ${brief(g.sigma[r][c])}` : "no estimate");
      cell.children[3].firstChild.style.width = `${(state ? wayToTarget(state) : 0) * 100}%`;
      setText(cell.children[4], `, ${STATUS[status].word}`);
    }
  }
  weak(s.observability);
}

function weak(o) {
  const directions = o.unobservable_directions.map((d) => d.text);
  $("weak").hidden = directions.length === 0 && !o.disagreement;
  list($("directions"), directions);
  setText($("disagreement"), o.disagreement ?? "");
}

function list(element, texts) {
  const key = texts.join("\n");
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(...texts.map((text) => make("li", "", text)));
}

/* States, facts, warnings */

function states(s) {
  const body = $("states").tBodies[0];
  const all = s.observability.states;
  while (body.rows.length > all.length) body.deleteRow(-1);
  all.forEach((state, i) => {
    const row = body.rows[i] ?? newState(body);
    const { mark, word } = STATUS[state.status] ?? STATUS.unobservable;
    setAttr(row, "data-status", state.status);
    setText(row.cells[0].firstChild, state.name);
    const [sign, name, bar] = row.cells[1].firstChild.children;
    setText(sign, mark);
    setText(name, word);
    bar.firstChild.style.width = `${wayToTarget(state) * 100}%`;
    setText(row.cells[2].children[0], brief(state.sigma));
    setText(row.cells[2].children[1], ` ${state.unit}`);
    setText(row.cells[3], brief(state.target));
  });
}

function newState(body) {
  const row = body.insertRow();
  const head = make("th");
  head.scope = "row";
  head.append(make("span"));
  const known = make("td");
  const bar = make("span", "bar");
  bar.append(make("span", "fill"));
  const line = make("div", "known");
  line.append(make("span", "mark"), make("span", "word"), bar);
  known.append(line);
  const sigma = make("td", "n");
  sigma.append(make("span"), make("small"));
  row.append(head, known, sigma, make("td", "n"));
  return row;
}

function facts(element, pairs) {
  if (element.children.length !== pairs.length * 2) {
    element.replaceChildren(...pairs.flatMap(() => [make("dt"), make("dd")]));
  }
  pairs.forEach(([name, value], i) => {
    setText(element.children[2 * i], name);
    setText(element.children[2 * i + 1], value);
  });
}

function motion(s) {
  const [n, e] = s.motion.velocity_ned_m_per_s;
  const attitude = s.estimate.attitude_deg;
  facts($("motion"), [
    ["Height", `${num(s.motion.height_m, 0)} m`],
    ["Speed", `${num(Math.hypot(n, e), 1)} m/s`],
    ["Roll", `${num(attitude.value[0], 1)}° ± ${num(attitude.sigma[0], 1)}`],
    ["Pitch", `${num(attitude.value[1], 1)}° ± ${num(attitude.sigma[1], 1)}`],
    ["Yaw", `${num(attitude.value[2], 1)}° ± ${num(attitude.sigma[2], 1)}`],
  ]);
}

export function showSnapshot(s) {
  hero(s);
  rings(s.observability.conditions);
  gMatrix(s);
  states(s);
  motion(s);
  list($("warnings"), s.warnings.slice().reverse());
  setText($("clock"), clock(s.elapsed_s));
  chip("chip-phase", s.phase === "running" ? "good" : "wait", PHASE[s.phase] ?? s.phase);
  const nis = s.consistency.nis_mean_per_dof;
  chip("chip-nis", s.phase !== "running" || nis === null ? "idle" : nis > 2 || nis < 0.4 ? "bad" : nis > 1.5 ? "wait" : "good", s.phase === "running" ? num(nis, 2) : "–");
}

const LINK_LEVEL = { up: "good", connecting: "wait", silent: "bad", down: "bad" };
const RECORDER_LEVEL = { recording: "good", off: "idle", failed: "bad" };

export function showSystem(sinks, s) {
  const { link, recorder } = sinks;
  chip("chip-link", LINK_LEVEL[link.state] ?? "idle", link.state);
  chip("chip-recorder", RECORDER_LEVEL[recorder.state] ?? "idle", recorder.state === "recording" ? bytes(recorder.bytes) : recorder.state);
  const pairs = [
    ["Link", `${link.state}${link.detail ? `, ${link.detail}` : ""}`],
    ["Frames", `${count(link.frames)} at ${num(link.rate_hz, 0)}/s, ${count(link.lost)} lost, ${count(link.bad_crc)} damaged`],
    ["Recording", `${recorder.state}${recorder.detail ? `, ${recorder.detail}` : ""}${recorder.bytes ? `, ${bytes(recorder.bytes)}` : ""}`],
  ];
  if (s) {
    pairs.push(
      ["Autopilot", s.autopilot || "unknown"],
      ["Inertial", `${s.imu.message || "none"} at ${num(s.imu.rate_hz, 1)} Hz, ${count(s.imu.dropped)} lost`],
      ["Fixes", `${num(s.gnss.rate_hz, 1)} Hz, ${count(s.gnss.used)} used, ${count(s.gnss.rejected)} rejected`],
    );
  }
  const dropped = Object.entries(sinks.sinks).filter(([, c]) => c.dropped > 0).map(([name, c]) => `${name} ${count(c.dropped)}`);
  pairs.push(["Skipped by slow sinks", dropped.join(", ") || "none"]);
  facts($("system"), pairs);
}

/** The planned mission, in the words of the status; a state that nobody knows is called out. */
export function showMission(mission) {
  if (!mission || mission.state === "none") return;
  const result = $("upload-result");
  const news = `${mission.state} ${mission.text}`;
  if (result.dataset.news === news) return;
  result.dataset.news = news;
  result.dataset.state = mission.state;
  result.setAttribute("role", mission.state === "unknown" ? "alert" : "status");
  setText(result, mission.text);
  setText($("confirm-what"), `${mission.name}, ${mission.items} items, replaces the mission in the vehicle.`);
}

export function showEvents(events) {
  const newest = events.slice(-40).reverse();
  const key = newest.map((e) => `${e.elapsed_s}${e.text}`).join();
  const element = $("events");
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(
    ...newest.map((e) => {
      const item = make("li", "", "");
      item.dataset.severity = e.severity;
      item.append(make("time", "", clock(e.elapsed_s)), make("span", "", e.text));
      return item;
    }),
  );
}

export function showConnection(state, silent) {
  const lost = $("lost");
  document.body.classList.toggle("stale", state === "lost");
  lost.hidden = state !== "lost";
  if (state === "lost") {
    const words = "Connection lost. What you see is old. Trying again…";
    if (lost.children.length === 0) lost.append(make("strong", "", words), make("span", "age"));
    // Not announced again every half second: only the words are read out.
    lost.lastChild.setAttribute("aria-hidden", "true");
    setText(lost.lastChild, ` ${Math.round(silent)} s`);
    chip("chip-phase", "bad", "Connection lost");
  }
}
