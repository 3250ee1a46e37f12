// The largest words on the page: what to do now, and who flies. One function decides, so no two places disagree.

import { clock, count, num } from "./format.js";
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
  // The engine decides what may be said, for every screen.
  const now = s.situation;
  const say = { kicker: now.headline, level: now.level, text: now.text, reason: now.detail, progress: null, words: "" };
  if (now.kind === "maneuver") {
    const progress = Math.min(1, Math.max(0, s.guidance.progress || 0));
    return { ...say, progress, words: `${Math.round(progress * 100)} %` };
  }
  if (now.kind === "monitoring") return { ...say, reason: `${converged(s)} ${now.detail}` };
  if (now.kind === "ground" && mission.state === "on_vehicle") return { ...say, reason: `${capital(mission.text)}. ${now.detail}` };
  return now.level === "auto" && vehicle.now ? autopilot(say, vehicle) : say;
}

const whatIsUnknown = (mission) => (/geofence/i.test(mission.text.split(":")[0]) ? "geofence" : "mission");

function converged(s) {
  const known = s.observability.states.filter((x) => x.status === "observable").length;
  return `${known} of ${s.observability.states.length} parameters have converged.`;
}

/** The two counts of a maneuver, the way there and the maneuver itself, as the terminal has them. */
function counts(vehicle) {
  const seconds = (x) => `${Math.ceil(x)} s`;
  if (Number.isFinite(vehicle.transit_left_s)) {
    return `begins in ${seconds(vehicle.transit_left_s)}${vehicle.duration_s > 0 ? `, then takes ${seconds(vehicle.duration_s)}` : ""}`;
  }
  return Number.isFinite(vehicle.left_s) ? `${seconds(vehicle.left_s)} left` : "";
}

/** What the autopilot flies, by the plan. */
function autopilot(say, vehicle) {
  const number = vehicle.maneuvers > 0 ? `${vehicle.maneuver} of ${vehicle.maneuvers}: ` : "";
  const next = vehicle.next ? `next: ${vehicle.next}` : "";
  const counted = vehicle.duration_s > 0 && Number.isFinite(vehicle.left_s);
  return {
    ...say,
    text: capital(`${number}${vehicle.now}`),
    reason: capital([counts(vehicle), next].filter(Boolean).join("; ")),
    progress: counted ? Math.min(1, Math.max(0, 1 - vehicle.left_s / vehicle.duration_s)) : null,
    words: counted ? `${Math.ceil(vehicle.left_s)} s` : "",
  };
}

const evaluate = (what) => `Run gaware report and gaware explain on ${what}.`;

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
  facts($("flying"), [
    ["Link", stale ? `no data for ${clock(silentS)}` : `${LINK[link.state] ?? "–"}, ${num(link.rate_hz, 0)}/s, ${count(link.lost)} lost${s.imu.loss >= 0.01 ? ` (${num(s.imu.loss * 100, 0)} % now)` : ""}`],
    ["Mode", vehicle.mode ? `${stale ? "last: " : ""}${vehicle.mode}` : "–"],
    ["Last", s.guidance.last_result ? capital(s.guidance.last_result) : "–"],
  ]);
}
