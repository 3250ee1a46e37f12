// Starts the page: stream in, view out, charts at a few frames per second.

import { AttitudeIndicator } from "./attitude.js";
import { StripChart, WINDOW_S } from "./chart.js";
import { $, capital, setText } from "./dom.js";
import { STALE_S, showHero } from "./hero.js";
import { Stream, ask } from "./stream.js";
import { Track } from "./track.js";
import { showConnection, showEvents, showFreshness, showMission, showParameters, showSnapshot, showSystem } from "./view.js";

/* The newest minutes are kept as they come, what is older once a second, and that is bounded too. */
const KEEP_POINTS = 3600;
const DRAW_MS = 200;
const LOOK_MS = 250;

let points = [];
let advanced = performance.now();
let connection = "connecting";
const isGone = () => ["lost", "ended"].includes(connection);
let snapshot = null;
let sinks = null;
let drawn = 0;
let waiting = false;
/** Since when the link of a vehicle that has sent no samples is silent. */
let quiet = null;
/** Whether this page may change anything: it came with the token. */
let authorised = false;
let changing = false;

const XYZ = ["--x", "--y", "--z"];

const charts = [
  new StripChart($("chart-f"), $("cap-f"), "Specific force", "g", {
    pick: (p) => p.f,
    series: [["x", 0], ["y", 1], ["z", 2]].map(([name, i]) => ({ name, color: XYZ[i] })),
    floor: [-1.2, 0.4],
  }),
  new StripChart($("chart-i"), $("cap-i"), "Innovations", "sigma", {
    pick: (p) => p.innovation,
    series: ["N", "E", "D"].flatMap((axis, i) => [{ name: `p${axis}`, color: XYZ[i], width: 1.2 }]).concat(
      ["N", "E", "D"].map((axis, i) => ({ name: `v${axis}`, color: XYZ[i], dash: 2, width: 1.2 })),
    ),
    floor: [-3, 3],
    band: [-2, 2],
    digits: 1,
  }),
  new StripChart($("chart-s"), $("cap-s"), "Sigma of G by column", "deg/h/g", {
    pick: (p) => [0, 1, 2].map((c) => Math.max(p.sigma[c], p.sigma[c + 3], p.sigma[c + 6])),
    series: ["x", "y", "z"].map((name, i) => ({ name, color: XYZ[i] })),
    floor: [20, 400],
    log: true,
    digits: 0,
    line: { name: "target", value: () => snapshot?.observability.states.find((x) => x.name === "g11")?.target },
  }),
];
const indicator = new AttitudeIndicator($("indicator"));
const track = new Track($("track"));

function pointOf(s) {
  return {
    t: s.elapsed_s,
    f: s.motion.specific_force_g,
    innovation: s.consistency.last_normalised_innovation,
    sigma: s.estimate.g_sensitivity_deg_per_h_per_g.sigma.flat(),
    lat: s.motion.lat_deg,
    lon: s.motion.lon_deg,
  };
}

function keep(s) {
  const point = pointOf(s);
  const last = points[points.length - 1];
  if (last && point.t < last.t) {
    points = []; // Another flight.
    loadHistory();
  }
  if (last && point.t === last.t) return;
  advanced = performance.now();
  points.push(point);
  if (points.length > KEEP_POINTS) points = thinned(points, point.t);
}

/** One point a second of what no chart shows any more, and half of that where it is still too much. */
function thinned(all, now) {
  const recent = all.filter((p) => p.t > now - WINDOW_S - 5);
  let before = -Infinity;
  const old = all.filter((p) => {
    if (p.t > now - WINDOW_S - 5 || p.t < before + 1) return false;
    before = p.t;
    return true;
  });
  return [...(old.length > KEEP_POINTS / 2 ? old.filter((_, i) => i % 2 === 0) : old), ...recent];
}

/** Fills in what the page has not seen: after loading, and after every interruption. */
async function loadHistory() {
  try {
    const response = await ask("/api/v1/history");
    if (!response.ok) return;
    const history = await response.json();
    const past = history.points.map(([t, f, innovation, sigma, [lat, lon]]) => ({ t, f, innovation, sigma: sigma.flat(), lat, lon }));
    const seen = new Set(points.map((p) => Math.floor(p.t)));
    const newest = past.length > 0 ? past[past.length - 1].t : -Infinity;
    const mine = points.filter((p) => p.t <= newest + 60);
    points = [...past.filter((p) => !seen.has(Math.floor(p.t))), ...mine].sort((a, b) => a.t - b.t);
    showEvents(history.events);
    draw();
  } catch {
    // The stream notices a lost connection and asks again.
  }
}

function draw() {
  if (waiting || document.hidden) return;
  waiting = true;
  const wait = Math.max(0, DRAW_MS - (performance.now() - drawn));
  setTimeout(() => requestAnimationFrame(() => {
    waiting = false;
    drawn = performance.now();
    for (const chart of charts) chart.draw(points);
    track.draw(points, snapshot?.motion.velocity_ned_m_per_s);
    if (snapshot) indicator.draw(snapshot.estimate.attitude_deg, snapshot.phase === "running");
  }), wait);
}

/** The words that decide whether the list of events has to be asked for again. */
function wordsOf(s) {
  const known = s.observability.states.map((x) => x.status === "observable");
  const c = s.observability.conditions;
  return JSON.stringify([s.phase, s.situation.kind, s.guidance.instruction, s.guidance.last_result, s.guidance.done, s.warnings, known, c.a.met, c.b.met, c.c.met]);
}

async function loadEvents() {
  try {
    const response = await ask("/api/v1/history?points=0");
    if (response.ok) showEvents((await response.json()).events);
  } catch {
    // As above.
  }
}

/** How long the link has brought nothing of a vehicle that was there, s. */
function linkSilent() {
  const gone = sinks?.vehicle?.mode && ["silent", "down"].includes(sinks.link.state);
  gone ? (quiet ??= performance.now()) : (quiet = null);
  return gone ? (performance.now() - quiet) / 1000 : 0;
}

/** What depends on how old the data are is looked at all the time, not only when data come. */
function look() {
  if (!snapshot) return;
  // Before the first sample nothing can be old.
  const waiting = snapshot.imu.samples === 0;
  const silent = waiting ? linkSilent() : (performance.now() - advanced) / 1000;
  showHero(snapshot, sinks, isGone() ? Math.max(silent, 2) : silent, connection === "ended");
  showFreshness(snapshot, sinks, silent, connection);
  // Nothing can be uploaded to a vehicle that is not there; signing in is possible at any time.
  for (const id of ["upload", "set-parameters"]) {
    $(id).disabled = changing || (authorised && (isGone() || silent > STALE_S));
  }
}

/** Planned path, fence and home, where there is a plan. */
async function loadRoute() {
  try {
    const response = await ask("/api/v1/route");
    if (response.ok) track.route = await response.json();
    draw();
  } catch {
    // As above.
  }
}

const stream = new Stream({
  onSnapshot(s) {
    const changed = snapshot !== null && wordsOf(s) !== wordsOf(snapshot);
    if (snapshot === null && sinks) showSystem(sinks, s);
    snapshot = s;
    keep(s);
    showSnapshot(s);
    look();
    if (changed) loadEvents();
    draw();
  },
  onSinks(view) {
    if (sinks?.route !== view.route) loadRoute();
    sinks = view;
    showSystem(sinks, snapshot);
    showMission(sinks.mission);
    showParameters(sinks.parameters);
  },
  onState(state, silent, changed) {
    connection = state;
    showConnection(state, silent);
    look();
    if (!changed) return;
    if (state === "live") {
      loadRoute();
      points = []; // It may be another flight now; the history knows this one.
      loadHistory();
      capabilities();
    }
    if (state === "lost") signedOut();
  },
});

/** After a restart with another token every request is refused: then show the sign-in page, not an old picture. */
async function signedOut() {
  try {
    if ((await ask("/api/v1/capabilities")).status === 401) location.reload();
  } catch {
    // The server is away; the stream keeps trying.
  }
}

async function capabilities() {
  try {
    const can = await (await ask("/api/v1/capabilities")).json();
    $("actions").hidden = !can.mission_upload && !can.parameters_apply;
    for (const id of ["upload", "upload-result"]) $(id).hidden = !can.mission_upload;
    for (const id of ["set-parameters", "parameters-result"]) $(id).hidden = !can.parameters_apply;
    authorised = can.authorised;
    setText($("upload"), authorised ? "Upload mission…" : "Sign in to upload…");
    setText($("set-parameters"), authorised ? "Set parameters…" : "Sign in to set parameters…");
  } catch {
    // As above.
  }
}

$("sign-in").querySelector("button[type=button]").addEventListener("click", () => $("sign-in").close());

/** A change of the vehicle: button, question, the request after a yes, and what came of it. */
function offer({ button, question, result, path, doing, check }) {
  $(button).addEventListener("click", () => $(authorised ? question : "sign-in").showModal());
  $(question).addEventListener("close", async () => {
    if ($(question).returnValue !== "yes") return;
    $(question).returnValue = "";
    changing = true;
    look();
    setText($(result), doing);
    try {
      const response = await ask(path, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ confirm: true }),
      });
      const { message } = await response.json();
      setText($(result), response.ok ? capital(message) : `Not done: ${message}`);
    } catch {
      setText($(result), `No answer: check the vehicle's ${check}.`);
    }
    changing = false;
    look();
    $(button).focus();
  });
}

offer({ button: "upload", question: "confirm", result: "upload-result", path: "/api/v1/mission/upload", doing: "Uploading…", check: "mission" });
offer({ button: "set-parameters", question: "confirm-parameters", result: "parameters-result", path: "/api/v1/parameters/apply", doing: "Setting…", check: "parameters" });

for (const event of ["resize", "themechange"]) window.addEventListener(event, draw);
document.addEventListener("visibilitychange", draw);
setInterval(look, LOOK_MS);
stream.start();
