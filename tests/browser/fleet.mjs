// Simulated fleets with known truth: the list of logs with results that `gaware fleet` leaves, which `gaware fleet report` reads.

const DAY_S = 86400;
const START_S = 1704067200;

/** Mulberry32, with normal numbers by Box and Muller. */
function random(seed) {
  let a = seed;
  const even = () => {
    a = (a + 0x6d2b79f5) | 0;
    let t = Math.imul(a ^ (a >>> 15), 1 | a);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
  return { even, normal: (sigma) => sigma * Math.sqrt(-2 * Math.log(1 - even())) * Math.cos(2 * Math.PI * even()) };
}

// Effect, names, unit, turn-on spread, spread between units, sigma of a flight, prior sigma.
const KINDS = [
  ["gyro_g_sensitivity", ["g11", "g12", "g13", "g21", "g22", "g23", "g31", "g32", "g33"], "deg/h/g", 8, 40, 12, 360],
  ["gyro_bias", ["bg_x", "bg_y", "bg_z"], "deg/h", 60, 200, 20, 1800],
  ["accel_bias", ["ba_x", "ba_y", "ba_z"], "mg", 0.8, 3, 0.4, 20],
  ["gyro_scale_factor", ["sg_x", "sg_y", "sg_z"], "ppm", 200, 1000, 400, 3000],
  ["accel_scale_factor", ["sa_x", "sa_y", "sa_z"], "ppm", 150, 1500, 300, 3000],
  ["gyro_misalignment", ["mg_xy", "mg_xz", "mg_yx", "mg_yz", "mg_zx", "mg_zy"], "mrad", 0.2, 2, 0.5, 10],
  ["gps_lever_arm", ["lever_x", "lever_y", "lever_z"], "m", 0.005, 0.2, 0.03, 1],
  ["gps_latency", ["latency"], "s", 0.004, 0.008, 0.005, 0.08],
];

/**
 * A fleet of two years. Injected: the sixth unit is out of family in g22 by ten spreads, the ninth drifts in ba_z by 6 mg a year, the third firmware reports
 * fixes 40 ms later, one flight in the middle has another bg_x, and gps_latency is identified in every second flight with that firmware.
 */
export function fleet({ units = 12, flights = 200, seed = 1, dated = true, days: span = 730, name = (unit, flight) => `flights/${unit}/flight_${String(flight).padStart(4, "0")}.bin` } = {}) {
  const { even, normal } = random(seed);
  const names = Array.from({ length: units }, (_, k) => `imu${String(k + 1).padStart(units > 99 ? 3 : 2, "0")}`);
  const kinds = KINDS.flatMap(([effect, list, ...rest]) => list.map((parameter) => [effect, parameter, ...rest]));
  const constants = kinds.map(([, parameter, , , between]) => names.map((_, u) => (parameter === "g22" && u === 5 ? 10 * between : normal(between))));
  const days = Array.from({ length: flights }, () => span * even()).sort((a, b) => a - b);
  const logs = days.map((day, k) => {
    const u = k % units;
    const firmware = Math.min(2, Math.floor(day / 243.4));
    const parameters = kinds.map(([effect, parameter, unit, spread, , sigma, prior_sigma], i) => {
      let truth = constants[i][u] + normal(spread) + (parameter === "latency" ? 0.12 : 0);
      if (parameter === "ba_z" && u === 8) truth += (6 * (day - 365)) / 365.25;
      if (parameter === "latency" && firmware === 2) truth += 0.04;
      if (parameter === "bg_x" && k === Math.floor(flights / 2)) truth += 12 * spread;
      const own = sigma * (0.5 + 1.5 * even());
      const prior_value = parameter === "latency" ? 0.12 : 0;
      const [w, w0] = [own ** -2, prior_sigma ** -2];
      return { effect, name: parameter, unit, value: ((truth + normal(own)) * w + prior_value * w0) / (w + w0), sigma: (w + w0) ** -0.5, prior_value, prior_sigma };
    });
    const effects = [["gyro_g_sensitivity"], ...(firmware === 2 && even() < 0.5 ? [["gps_latency"]] : [])].map((names) => ({ names }));
    const flight = { board: names[u], firmware: `4.${4 + firmware}`, start_unix_s: dated ? START_S + day * DAY_S : null, parameters, summary: {}, explanation: { verdict: "explained", effects } };
    return { log: name(names[u], k), unit: null, firmware: null, result: { schema: "gaware.fleet_flight/1", sha256: "", bytes: 0, failed: null, flight }, failed: null };
  });
  logs.push({ log: name(names[0], flights), unit: null, firmware: null, result: null, failed: "unsupported format" });
  return { schema: "gaware.fleet_logs/1", logs };
}
