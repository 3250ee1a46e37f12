// Figures and words for people. Anything that is not a number becomes a dash.

export const STATUS = {
  observable: { mark: "●", word: "observable" },
  converging: { mark: "◕", word: "converging" },
  weak: { mark: "◔", word: "weak" },
  unobservable: { mark: "○", word: "not observable" },
};

export const PHASE = {
  waiting_for_imu: "Waiting for inertial data",
  waiting_for_gnss: "Waiting for GNSS",
  aligning: "Aligning",
  searching_heading: "Searching heading",
  running: "Running",
};

const MINUS = "\u2212";

export function num(x, digits = 1) {
  if (typeof x !== "number" || !Number.isFinite(x)) return "–";
  const text = Math.abs(x).toFixed(digits);
  return x < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Three figures or so: enough to read, few enough to read quickly. */
export function brief(x) {
  const size = Math.abs(x);
  return num(x, size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 || size === 0 ? 2 : size >= 0.01 ? 3 : 4);
}

export function signed(x, digits = 1) {
  const text = num(x, digits);
  return /^[0-9]/.test(text) && Number(text) !== 0 ? `+${text}` : text;
}

export function clock(seconds) {
  if (!Number.isFinite(seconds)) return "–:––";
  const s = Math.max(0, Math.floor(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const h = Math.floor(s / 3600);
  const m = Math.floor(s / 60) % 60;
  return h > 0 ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
}

export function bytes(n) {
  const units = ["B", "kB", "MB", "GB"];
  let i = 0;
  while (n >= 1000 && i < units.length - 1) {
    n /= 1000;
    i += 1;
  }
  return `${num(n, i > 0 && n < 100 ? 1 : 0)} ${units[i]}`;
}

export function count(n) {
  return Number.isFinite(n) ? n.toLocaleString("en").replaceAll(",", "\u202f") : "–";
}
