// Snapshot and sinks into the page: everything but the instruction.

import { PHASE, STATUS, brief, bytes, clock, count, num, signed } from "./format.js";
import { $, capital, chip, facts, list, make, setAttr, setText } from "./dom.js";
import { STALE_S } from "./hero.js";

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

/* The ground session */

function holdRing() {
  const face = svg("svg", { viewBox: "0 0 72 72", role: "img" });
  const around = { cx: 36, cy: 36, r: RADIUS, pathLength: 100 };
  face.append(
    svg("circle", { ...around, class: "ring-back" }),
    svg("circle", { ...around, class: "ring-front", transform: "rotate(-90 36 36)", "stroke-dasharray": "0 100" }),
    svg("text", { x: 36, y: 35, class: "ring-letter" }),
  );
  return face;
}

/** What a side has brought: the largest sigma of G before and after. */
function brought(side) {
  if (side.skipped) return "left out";
  const [before, after] = side.g_sigma_deg_per_h_per_g ?? [];
  const sigma = Number.isFinite(after) && before > after * 1.05 ? `, ± ${brief(before)} → ${brief(after)}` : "";
  return side.held_s > 0 ? `${num(side.held_s, 0)} s${sigma}` : "";
}

/** Ring with the seconds left by the noise of the mean rate, the side that is next, and what each side has brought. */
function byHand(ground) {
  const shown = Boolean(ground?.active);
  $("byhand").hidden = !shown;
  document.body.classList.toggle("by-hand", shown);
  if (!shown) return;
  if ($("hold").children.length === 0) $("hold").append(holdRing(), make("p", "hold-words"));
  const sides = ground.sides.filter((side) => !side.skipped);
  const done = sides.filter((side) => side.done).length;
  const left = ground.seconds_left;
  const wanted = Math.max(...ground.sides.map((side) => side.wanted_s), 1);
  const holding = Number.isFinite(left);
  const share = holding ? 1 - left / wanted : done / Math.max(1, sides.length);
  const face = $("hold").firstChild;
  setAttr(face.querySelector(".ring-front"), "stroke-dasharray", `${Math.round(100 * Math.min(1, Math.max(0, share)))} 100`);
  setText(face.querySelector("text"), holding ? `${Math.ceil(left)}` : `${done}/${sides.length}`);
  setAttr(face, "aria-label", holding ? `${Math.ceil(left)} seconds left on this side` : `${done} of ${sides.length} sides done`);
  setText($("hold").lastChild, holding ? "s left" : ground.done ? "done" : "sides done");
  const list = $("sides");
  while (list.children.length > ground.sides.length) list.lastChild.remove();
  ground.sides.forEach((side, k) => {
    const item = list.children[k] ?? list.appendChild(sideItem());
    const next = !side.done && !side.skipped && ground.instruction.endsWith(side.side);
    setAttr(item, "data-state", side.done ? "done" : next ? "next" : "open");
    setText(item.children[0], side.done ? "✓" : side.skipped ? "–" : next ? "→" : "○");
    setText(item.children[1], capital(side.side));
    setText(item.children[2], brought(side));
  });
}

function sideItem() {
  const item = make("li");
  item.append(make("span", "mark"), make("span", "side"), make("span", "brought"));
  item.firstChild.setAttribute("aria-hidden", "true");
  return item;
}

/** The states that a condition would show: where they have converged all the same, it is not needed any more. */
const ABOUT = { a: /^(bg_|ba_)/, b: /^g(11|22|33)$/, c: /^g[1-3][1-3]$/ };

function rings(o, running) {
  const list = $("rings");
  if (list.children.length === 0) list.append(...Object.keys(CONDITIONS).map(ring));
  Object.keys(CONDITIONS).forEach((letter, i) => {
    const c = o.conditions[letter];
    const item = list.children[i];
    const about = o.states.filter((x) => ABOUT[letter].test(x.name));
    const without = !c.met && about.length > 0 && about.every((x) => x.status === "observable");
    const percent = c.met ? 100 : Math.min(99, Math.floor((c.progress || 0) * 100));
    setAttr(item, "data-met", String(c.met));
    setAttr(item, "data-without", String(without));
    setAttr(item.querySelector(".ring-front"), "stroke-dasharray", `${percent} 100`);
    setText(item.querySelector(".percent"), c.met ? "met ✓" : without ? "not needed ✓" : `${percent} %`);
    setText(item.querySelector(".missing"), c.met || !running ? "" : without ? "Converged without it, by turns and fixes." : c.missing || "");
    setAttr(item.querySelector("svg"), "aria-label", `Condition ${letter}: ${c.met ? "met" : without ? "not needed" : `${percent} percent`}`);
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
      // Before the filter runs there is only the prior.
      const estimated = s.phase === "running" && g.sigma[r][c] > 0;
      setText(cell.children[1], estimated ? signed(g.value[r][c], 1) : "–");
      setText(cell.children[2], estimated ? `± ${brief(g.sigma[r][c])}` : "\u00a0");
      cell.children[3].firstChild.style.width = `${(state ? wayToTarget(state) : 0) * 100}%`;
      setText(cell.children[4], estimated ? `, ${STATUS[status].word}` : ", no estimate");
    }
  }
  weak(s);
}

function weak(s) {
  const o = s.observability;
  const converged = o.states.filter((x) => x.status === "observable").length;
  setText($("count"), o.states.length > 0 ? `${converged} of ${o.states.length} parameters have converged.` : "");
  // What a flight has not shown is nothing to act upon before there is an estimate.
  const directions = s.phase === "running" ? o.unobservable_directions.map((d) => d.text) : [];
  $("weak").hidden = directions.length === 0;
  setText($("weak-title"), s.guidance.done ? "Not observable in this flight" : "Not observable yet");
  list($("directions"), directions);
  setText($("disagreement"), o.disagreement ?? "");
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

/** Roll, pitch, yaw with sigma, height and speed. */
function motion(s) {
  const [n, e] = s.motion.velocity_ned_m_per_s;
  const attitude = s.estimate.attitude_deg;
  const running = s.phase === "running";
  const angle = (k) => (running ? `${num(attitude.value[k], 1)}° ± ${brief(attitude.sigma[k])}` : "–");
  facts($("motion"), [
    ["Roll", angle(0)],
    ["Pitch", angle(1)],
    ["Yaw", angle(2)],
    ["Height (GNSS)", running ? `${num(s.motion.height_m, 0)} m` : "–"],
    ["Speed", running ? `${num(Math.hypot(n, e), 1)} m/s` : "–"],
  ]);
}

export function showSnapshot(s) {
  byHand(s.ground);
  rings(s.observability, s.phase === "running");
  gMatrix(s);
  states(s);
  motion(s);
  list($("warnings"), s.warnings.slice().reverse());
  setText($("clock"), clock(s.elapsed_s));
  // The place is no receiver: what it says agrees by construction.
  const nis = s.ground?.without_fixes ? null : s.consistency.nis_mean_per_dof;
  chip("chip-nis", s.phase !== "running" || nis === null ? "idle" : nis > 2 || nis < 0.4 ? "bad" : nis > 1.5 ? "wait" : "good", s.phase === "running" && nis !== null ? num(nis, 2) : "–");
}

/** Old data are grey at once, and nothing stays green. */
export function showFreshness(s, sinks, silentS, state) {
  const ended = state === "ended";
  const stale = state === "lost" || ended || silentS > STALE_S;
  document.body.classList.toggle("stale", stale);
  const link = sinks?.link.state ?? "connecting";
  const losing = s.situation.kind === "packet_loss" && link === "up";
  chip("chip-link", state === "lost" || losing ? "bad" : ended ? "idle" : LINK_LEVEL[link] ?? "idle", state === "lost" ? "page" : ended ? "ended" : losing ? `${num(s.imu.loss * 100, 0)} % lost` : link);
  if (ended) chip("chip-phase", "idle", "Ended");
  else if (state === "lost") chip("chip-phase", "bad", "Connection lost");
  else if (stale) chip("chip-phase", "bad", `No data ${clock(silentS)}`);
  else if (s.situation.level === "lost") chip("chip-phase", "bad", s.situation.headline);
  else chip("chip-phase", s.phase === "running" ? "good" : "wait", PHASE[s.phase] ?? s.phase);
}

const LINK_LEVEL = { up: "good", connecting: "wait", silent: "bad", down: "bad" };
const RECORDER_LEVEL = { recording: "good", off: "idle", failed: "bad" };

export function showSystem(sinks, s) {
  const { link, recorder } = sinks;
  chip("chip-recorder", RECORDER_LEVEL[recorder.state] ?? "idle", recorder.state === "recording" ? bytes(recorder.bytes) : recorder.state);
  const pairs = [
    ["Link", `${link.state}${link.detail ? `, ${link.detail}` : ""}`],
    ["Frames", `${count(link.frames)} at ${num(link.rate_hz, 0)}/s, ${count(link.lost)} lost, ${count(link.bad_crc)} damaged`],
    ["Recording", `${recorder.state}${recorder.detail ? `, ${recorder.detail}` : ""}${recorder.bytes ? `, ${bytes(recorder.bytes)}` : ""}`],
  ];
  if (s) {
    pairs.push(
      ["Autopilot", s.autopilot || "unknown"],
      ["Inertial", `${s.imu.message || "none"} at ${num(s.imu.rate_hz, 1)}${s.imu.asked_hz > 0 ? ` of ${num(s.imu.asked_hz, 0)}` : ""} Hz, ${count(s.imu.dropped)} lost`],
      ["NIS", `${num(s.consistency.nis_mean_per_dof, 2)} per degree of freedom; 1 is right`],
      ["Fixes", `${num(s.gnss.rate_hz, 1)} Hz, ${count(s.gnss.used)} used, ${count(s.gnss.rejected)} rejected`],
    );
  }
  const dropped = Object.entries(sinks.sinks).filter(([, c]) => c.dropped > 0).map(([name, c]) => `${name} ${count(c.dropped)}`);
  pairs.push(["Skipped by slow sinks", dropped.join(", ") || "none"]);
  facts($("system"), pairs);
}

/** What became of a change, in the words of the status, shortened by `short`; an unknown state is called out. True where it has changed. */
function showChange(result, { state, text }, short) {
  const shown = `${state} ${text}`;
  if (result.dataset.shown === shown) return false;
  result.dataset.shown = shown;
  result.dataset.state = state;
  result.setAttribute("role", state === "unknown" ? "alert" : "status");
  setText(result, capital(short(text)));
  return true;
}

/** The planned mission. */
export function showMission(mission) {
  if (!mission || mission.state === "none") return;
  // What came of an upload stands in full in the largest place of the page.
  if (showChange($("upload-result"), mission, (text) => text.split(mission.state === "unknown" ? ":" : ";")[0])) {
    setText($("confirm-what"), `${mission.name}, ${mission.items} items, replaces the mission in the vehicle.`);
  }
}

/** The parameters that may be set; what came of it stands only here, so in full. */
export function showParameters(parameters) {
  if (!parameters || parameters.state === "none") return;
  if (showChange($("parameters-result"), parameters, (text) => text)) {
    setText($("confirm-parameters-what"), `${parameters.name} sets`);
    $("parameters-values").replaceChildren(...parameters.values.map((value) => {
      const item = document.createElement("li");
      item.textContent = value;
      return item;
    }));
  }
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
  lost.hidden = state !== "lost";
  if (state === "lost") {
    const words = "Connection to gaware lost. What you see is old. Trying again…";
    if (lost.children.length === 0) lost.append(make("strong", "", words), make("span", "age"));
    // Not announced again every half second: only the words are read out.
    lost.lastChild.setAttribute("aria-hidden", "true");
    setText(lost.lastChild, ` ${Math.round(silent)} s`);
  }
}
