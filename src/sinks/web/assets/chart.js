// Strip charts by uPlot: time runs to the left, the newest value stands at the right edge, hovering shows values in all
// charts at once. The box has its size from the layout alone, so a chart can never make its card grow.

/* global uPlot */

export const WINDOW_S = 120;
const DECADES = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
const DASHES = [[], [6, 3], [2, 3]];

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Sizes a canvas to its box in device pixels and returns its context in CSS pixels. */
export function prepare(canvas) {
  const { width: w, height: h } = canvas.parentElement.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(w * ratio));
  const height = Math.max(1, Math.round(h * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, w, h);
  return { context, width: w, height: h };
}

export class StripChart {
  #plot = null;
  #end = 0;
  #described = -Infinity;

  /**
   * options: pick(point) -> values, series [{name, color, dash}], floor [low, high] that is always shown, log,
   * digits of hover values, band [low, high] that is right, line: {value(), name}.
   */
  constructor(box, caption, title, unit, options) {
    Object.assign(this, { box, options, title, unit });
    const name = document.createElement("span");
    name.className = "chart-title";
    name.textContent = title;
    const small = document.createElement("small");
    small.textContent = unit;
    caption.replaceChildren(name, small);
    new ResizeObserver(() => this.#resize()).observe(box);
  }

  #size() {
    const { width, height } = this.box.getBoundingClientRect();
    const legend = parseFloat(css("--legend"));
    return { width: Math.max(60, Math.floor(width)), height: Math.max(60, Math.floor(height) - legend) };
  }

  #resize() {
    this.#plot?.setSize(this.#size());
  }

  #make(data) {
    const { series, log, digits = 2 } = this.options;
    const axis = { stroke: () => css("--soft"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { show: false }, font: "12px system-ui, sans-serif" };
    const value = (_, v) => (v === null || v === undefined ? "–" : v.toFixed(digits));
    this.#plot = new uPlot({
      ...this.#size(),
      padding: [8, 18, 0, 0],
      cursor: { sync: { key: "live" }, drag: { x: false, y: false }, points: { size: 6 } },
      scales: {
        x: { time: false, range: () => [this.#end - WINDOW_S, this.#end] },
        y: { distr: log ? 3 : 1, range: (_, low, high) => this.#range(low, high) },
      },
      axes: [
        { ...axis, size: 24, space: 60, values: (_, ticks) => ticks.map((t) => (this.#end - t < 1 ? "now" : `\u2212${Math.round(this.#end - t)} s`)), splits: () => [0, 30, 60, 90, 120].map((s) => this.#end - WINDOW_S + s) },
        { ...axis, size: 44, space: 26, ...(log ? { splits: (_u, _i, low, high) => DECADES.filter((t) => t >= low && t <= high), filter: (_, ticks) => ticks } : {}) },
      ],
      series: [
        { label: "t", value: (_, t) => (t === null || t === undefined ? "now" : `${(t - this.#end).toFixed(0)} s`) },
        ...series.map((s) => ({ label: s.name, stroke: () => css(s.color), dash: DASHES[s.dash ?? 0], width: s.width ?? 1.6, spanGaps: false, points: { show: false }, value })),
      ],
      hooks: { drawClear: [(u) => this.#reference(u)] },
    }, data, this.box);
  }

  #range(low, high) {
    let [a, b] = this.options.floor;
    if (Number.isFinite(low)) a = Math.min(a, low);
    if (Number.isFinite(high)) b = Math.max(b, high);
    if (this.options.log) return [a / 1.1, b * 1.1];
    const pad = (b - a) * 0.04;
    return [a - pad, b + pad];
  }

  /** The band that is right and the target, behind the lines. */
  #reference(u) {
    const { band, line } = this.options;
    const { left, top, width, height } = u.bbox;
    if (band) {
      const [a, b] = [u.valToPos(band[1], "y", true), u.valToPos(band[0], "y", true)];
      u.ctx.fillStyle = css("--band");
      u.ctx.fillRect(left, Math.max(top, a), width, Math.min(top + height, b) - Math.max(top, a));
    }
    const at = line?.value();
    if (Number.isFinite(at)) {
      const y = u.valToPos(at, "y", true);
      u.ctx.strokeStyle = css("--ok");
      u.ctx.lineWidth = 1.5;
      u.ctx.setLineDash([8, 4]);
      u.ctx.beginPath();
      u.ctx.moveTo(left, y);
      u.ctx.lineTo(left + width, y);
      u.ctx.stroke();
      u.ctx.setLineDash([]);
    }
  }

  draw(points) {
    const end = points.length > 0 ? points[points.length - 1].t : 0;
    this.#end = end;
    let first = points.length;
    while (first > 0 && points[first - 1].t >= end - WINDOW_S) first -= 1;
    const shown = points.slice(first);
    const fit = (v) => (Number.isFinite(v) && !(this.options.log && v <= 0) ? v : null);
    const data = [shown.map((p) => p.t), ...this.options.series.map((_, i) => shown.map((p) => fit(this.options.pick(p)[i])))];
    if (this.#plot === null) this.#make(data);
    else this.#plot.setData(data);
    this.#describe(data);
  }

  #describe(data) {
    if (Math.abs(this.#end - this.#described) < 5) return;
    this.#described = this.#end;
    const now = this.options.series.map((s, i) => `${s.name} ${data[i + 1].at(-1)?.toFixed(2) ?? "unknown"}`);
    this.box.setAttribute("aria-label", `${this.title}, ${this.unit}, now: ${now.join(", ")}`);
  }
}
