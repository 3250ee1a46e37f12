// Starts the page: stream in, view out, charts at a few frames per second.

import { StripChart } from "./chart.js";
import { Stream } from "./stream.js";
import { Track } from "./track.js";
import { setText, showConnection, showEvents, showMission, showSnapshot, showSystem } from "./view.js";

const $ = (id) => document.getElementById(id);
const KEEP_S = 900;
const DRAW_MS = 200;

let points = [];
let snapshot = null;
let sinks = null;
let drawn = 0;
let waiting = false;

const XYZ = ["--x", "--y", "--z"];

const charts = [
  new StripChart($("chart-f"), $("cap-f"), "Specific force", "g", {
    pick: (p) => p.f,
    series: [["x", 0], ["y", 1], ["z", 2]].map(([name, i]) => ({ name, color: XYZ[i] })),
    floor: [-1.2, 0.4],
  }),
  new StripChart($("chart-i"), $("cap-i"), "Innovations", "sigma", {
    pick: (p) => p.innovation,
    series: ["n", "e", "d"].flatMap((axis, i) => [{ name: `position ${axis}`, color: XYZ[i], width: 1.2 }]).concat(
      ["n", "e", "d"].map((axis, i) => ({ name: `velocity ${axis}`, color: XYZ[i], dash: 2, width: 1.2 })),
    ),
    legend: [...["n", "e", "d"].map((name, i) => ({ name, color: XYZ[i] })), { name: "position" }, { name: "velocity", dash: 2 }],
    floor: [-3, 3],
    band: [-2, 2],
  }),
  new StripChart($("chart-s"), $("cap-s"), "Sigmas of G", "deg/h/g", {
    pick: (p) => p.sigma,
    series: [0, 1, 2].flatMap((r) => [0, 1, 2].map((c) => ({ name: `g${r + 1}${c + 1}`, color: XYZ[c], dash: r }))),
    legend: [
      ...["x", "y", "z"].map((name, i) => ({ name: `column ${name}`, color: XYZ[i] })),
      ...["gyro x", "gyro y", "gyro z"].map((name, dash) => ({ name, dash })),
    ],
    floor: [20, 400],
    log: true,
    line: { name: "target", value: () => snapshot?.observability.states.find((x) => x.name === "g11")?.target },
  }),
];
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
  if (!last || point.t !== last.t) points.push(point);
  if (points.length > KEEP_S * 12) points = points.filter((p) => p.t > point.t - KEEP_S);
}

/** Fills in what the page has not seen: after loading, and after every interruption. */
async function loadHistory() {
  try {
    const response = await fetch("/api/v1/history");
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
  }), wait);
}

/** The words that decide whether the list of events has to be asked for again. */
function wordsOf(s) {
  const known = s.observability.states.map((x) => x.status === "observable");
  const c = s.observability.conditions;
  return JSON.stringify([s.phase, s.guidance.instruction, s.guidance.last_result, s.guidance.done, s.warnings, known, c.a.met, c.b.met, c.c.met]);
}

async function loadEvents() {
  try {
    const response = await fetch("/api/v1/history?points=0");
    if (response.ok) showEvents((await response.json()).events);
  } catch {
    // As above.
  }
}

const stream = new Stream({
  onSnapshot(s) {
    const news = snapshot !== null && wordsOf(s) !== wordsOf(snapshot);
    if (snapshot === null && sinks) showSystem(sinks, s);
    snapshot = s;
    keep(s);
    showSnapshot(s);
    if (news) loadEvents();
    draw();
  },
  onSinks(view) {
    sinks = view;
    showSystem(sinks, snapshot);
    showMission(sinks.mission);
  },
  onState(state, silent, changed) {
    showConnection(state, silent);
    if (!changed) return;
    if (state === "live") {
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
    if ((await fetch("/api/v1/capabilities")).status === 401) location.reload();
  } catch {
    // The server is away; the stream keeps trying.
  }
}

async function capabilities() {
  try {
    const can = await (await fetch("/api/v1/capabilities")).json();
    $("actions").hidden = !can.mission_upload;
    $("upload").disabled = !can.authorised;
    if (!can.authorised) setText($("upload-result"), "Open this page once with ?token=… to upload.");
  } catch {
    // As above.
  }
}

$("upload").addEventListener("click", () => $("confirm").showModal());
$("confirm").addEventListener("close", async () => {
  if ($("confirm").returnValue !== "yes") return;
  $("confirm").returnValue = "";
  $("upload").disabled = true;
  setText($("upload-result"), "Uploading…");
  try {
    const response = await fetch("/api/v1/mission/upload", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ confirm: true }),
    });
    const { message } = await response.json();
    setText($("upload-result"), response.ok ? message : `Not done: ${message}`);
  } catch {
    setText($("upload-result"), "No answer: check the vehicle's mission.");
  }
  $("upload").disabled = false;
  $("upload").focus();
});

for (const event of ["resize", "themechange"]) window.addEventListener(event, draw);
document.addEventListener("visibilitychange", draw);
stream.start();
