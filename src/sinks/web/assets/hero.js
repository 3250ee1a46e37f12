// The largest words on the page: what to do now, and who flies. One function decides, so no two places disagree.

import { PHASE, clock, count, num } from "./format.js";
import { $, capital, facts, joined, make, setAttr, setText } from "./dom.js";

/** Without new data for so long what is shown counts as old, s. */
export const STALE_S = 1.5;

const WHO = { unknown: "Not reported", ground: "On the ground", pilot: "Pilot", autopilot: "Autopilot" };

/** What stands in the hero: kicker, text, reason, level, progress 0 to 1 (or null), progress in words. */
export function decide(s, sinks, silentS, ended = false) {
  const vehicle = sinks?.vehicle ?? {};
  const mission = sinks?.mission ?? {};
  if (ended && mission.state !== "unknown") {
    const inTheAir = ["pilot", "autopilot"].includes(vehicle.control) ? "Fly by your own instruments. " : "";
    const file = sinks?.recorder?.file;
    const after = file ? `${evaluate(file)} ` : "";
    const reason = `${inTheAir}${after}What is below is its last state. The page goes on by itself when gaware is started again.`;
    return { kicker: "Ended", level: "idle", text: "gaware has ended", reason, progress: null, words: "" };
  }
  if (silentS > STALE_S) {
    const unknown = mission.state === "unknown";
    return {
      kicker: "No data", level: "lost", progress: null, words: "",
      text: unknown ? capital(`${whatIsUnknown(mission)} unknown`) : "No new data",
      // The seconds are not read aloud every time: only the words above are announced.
      reason: unknown ? mission.text : `Nothing for ${clock(silentS)}: everything below is old. Fly by your own instruments; the page goes on by itself when data return.`,
    };
  }
  if (mission.state === "unknown" && !["pilot", "autopilot"].includes(vehicle.control)) {
    return { kicker: "Mission", level: "lost", text: capital(`${whatIsUnknown(mission)} on the vehicle unknown`), reason: mission.text, progress: null, words: "" };
  }
  if (s.phase !== "running") {
    return { kicker: PHASE[s.phase] ?? "Waiting", level: "wait", text: s.waiting_for || PHASE[s.phase] || "", reason: "", progress: null, words: "" };
  }
  if (s.guidance.done) return done(s, sinks);
  if (vehicle.control === "ground") return onGround(mission);
  if (vehicle.control === "autopilot") return autopilot(s, vehicle);
  const g = s.guidance;
  if (!g.instruction) {
    return { kicker: "Monitoring", level: "idle", text: "No maneuver proposed now", reason: monitoring(s), progress: null, words: "" };
  }
  const progress = Math.min(1, Math.max(0, g.progress || 0));
  return { kicker: "Fly now", level: "fly", text: g.instruction, reason: g.reason, progress, words: `${Math.round(progress * 100)} %` };
}

const whatIsUnknown = (mission) => (/geofence/i.test(mission.text.split(":")[0]) ? "geofence" : "mission");

/** Maneuvers are for a vehicle that flies. */
function onGround(mission) {
  const next = mission.state === "on_vehicle" ? "Arm and start the mission with your ground station or transmitter." : "Maneuvers are proposed after take-off.";
  const came = ["on_vehicle", "not_on_vehicle"].includes(mission.state) ? `${capital(mission.text)}. ` : "";
  const reason = came + next;
  return { kicker: "On the ground", level: "idle", text: "Ready for take-off", reason, progress: null, words: "" };
}

function monitoring(s) {
  const converged = s.observability.states.filter((x) => x.status === "observable").length;
  return `${converged} of ${s.observability.states.length} parameters have converged. Fly on as planned; the next maneuver is being ranked.`;
}

function autopilot(s, vehicle) {
  const number = vehicle.maneuvers > 0 ? `${vehicle.maneuver} of ${vehicle.maneuvers}: ` : "";
  const left = Number.isFinite(vehicle.left_s) ? `${Math.ceil(vehicle.left_s)} s left` : "";
  const next = vehicle.next ? `next: ${vehicle.next}` : "";
  const spent = vehicle.duration_s > 0 && Number.isFinite(vehicle.left_s) ? 1 - vehicle.left_s / vehicle.duration_s : null;
  return {
    kicker: "Autopilot flies", level: "auto",
    text: capital(`${number}${vehicle.now || "its mission"}`),
    reason: capital([left, next].filter(Boolean).join("; ")),
    progress: spent === null ? null : Math.min(1, Math.max(0, spent)),
    words: left ? `${Math.ceil(vehicle.left_s)} s` : "",
  };
}

const evaluate = (what) => `Run gaware report and gaware explain on ${what}.`;

/** The end: what to do next, and what the flight did and did not show. */
function done(s, sinks) {
  const open = s.observability.states.filter((x) => x.status !== "observable").map((x) => x.name);
  const all = s.observability.states.length;
  const file = sinks?.recorder?.file;
  const shown = open.length === 0 ? `All ${all} parameters have converged.`
    : `${all - open.length} of ${all} parameters have converged; ${open.join(", ")} cannot with this airframe.`;
  const onGround = sinks?.vehicle?.control === "ground";
  const after = evaluate(file || "the recording");
  return { kicker: "Done", level: "done", text: onGround ? "Evaluate the flight" : "Land", reason: `${shown} ${after}`, progress: null, words: "" };
}

/* What is to be flown first stands large, what follows below it. */
function steps(element, text) {
  if (element.dataset.said === text) return;
  element.dataset.said = text;
  const [first, ...then] = text.split(/(?= Then: )/);
  element.replaceChildren(first, ...then.map((step) => make("span", "then", step)));
  setAttr(element, "data-length", text.length <= 34 ? "short" : text.length <= 80 ? "medium" : "long");
}

/** `ended`: the program has said that it ends. */
export function showHero(s, sinks, silentS, ended) {
  const now = decide(s, sinks, silentS, ended);
  setText($("hero-title"), now.kicker);
  steps($("instruction"), joined(ended ? now.text : capital(now.text)));
  setAttr($("hero"), "data-level", now.level);
  setText($("reason"), joined(capital(now.reason ?? "")));
  $("flown").style.visibility = now.progress === null ? "hidden" : "visible";
  if (now.progress !== null) $("progress").value = now.progress;
  setText($("progress-text"), now.words);
  flying(s, sinks, silentS);
}

const LINK = { up: "up", connecting: "connecting", silent: "silent", down: "down" };

/** Who flies, by the vehicle's own heartbeat, and the link, always in the same place. */
function flying(s, sinks, silentS) {
  const vehicle = sinks?.vehicle ?? {};
  const link = sinks?.link ?? {};
  const stale = silentS > STALE_S;
  setText($("who"), stale ? "Unknown: no data" : WHO[vehicle.control] ?? WHO.unknown);
  setAttr($("fly"), "data-control", stale ? "unknown" : vehicle.control ?? "unknown");
  const byHand = vehicle.control === "autopilot" && s.phase === "running" && !s.guidance.done ? s.guidance.instruction : "";
  facts($("flying"), [
    ["Link", stale ? `no data for ${clock(silentS)}` : `${LINK[link.state] ?? "–"}, ${num(link.rate_hz, 0)}/s, ${count(link.lost)} lost`],
    ["Mode", vehicle.mode ? `${stale ? "last: " : ""}${vehicle.mode}` : "–"],
    ["By hand", joined(byHand) || "–"],
    ["Last", s.guidance.last_result ? capital(s.guidance.last_result) : "–"],
  ]);
}
