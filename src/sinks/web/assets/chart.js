// A strip chart on a canvas: time runs to the left, the newest value stands at the right edge.

const WINDOW_S = 120;
const DASHES = [[], [6, 3], [2, 3]];

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Sizes a canvas to its box in device pixels and returns its context in CSS pixels. */
export function prepare(canvas) {
  const box = canvas.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(box.width * ratio));
  const height = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, box.width, box.height);
  return { context, width: box.width, height: box.height };
}

export class StripChart {
  /**
   * options: pick(point) -> values, series [{name, color, dash}], floor [low, high] that is always shown, log, band
   * [low, high] that is right, line: {value(), name}.
   */
  constructor(canvas, caption, title, unit, options) {
    Object.assign(this, { canvas, options, title, unit });
    caption.replaceChildren(this.#captionText(title, unit), this.#legend(options.legend ?? options.series));
  }

  #captionText(title, unit) {
    const text = document.createElement("span");
    text.className = "chart-title";
    text.textContent = title;
    const small = document.createElement("small");
    small.textContent = ` ${unit}`;
    text.append(small);
    return text;
  }

  #legend(series) {
    const list = document.createElement("span");
    list.className = "keys";
    for (const s of series) {
      const key = document.createElement("span");
      key.className = "key";
      const swatch = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      swatch.setAttribute("viewBox", "0 0 20 6");
      swatch.setAttribute("aria-hidden", "true");
      const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
      line.setAttribute("d", "M0 3H20");
      line.setAttribute("stroke-dasharray", DASHES[s.dash ?? 0].join(" "));
      line.style.stroke = s.color ? `var(${s.color})` : "currentColor";
      swatch.append(line);
      key.append(swatch, s.name);
      list.append(key);
    }
    return list;
  }

  draw(points) {
    const { context: c, width, height } = prepare(this.canvas);
    const area = { left: 38, right: width - 6, top: 6, bottom: height - 18 };
    const end = points.length > 0 ? points[points.length - 1].t : 0;
    let first = points.length;
    while (first > 0 && points[first - 1].t >= end - WINDOW_S) first -= 1;
    const shown = points.slice(first).map((p) => ({ t: p.t, v: this.options.pick(p) }));
    const scale = this.#scale(shown);
    const x = (t) => area.right - ((end - t) / WINDOW_S) * (area.right - area.left);
    const y = (v) => area.bottom - scale.at(v) * (area.bottom - area.top);
    this.#grid(c, area, scale, y);
    this.#reference(c, area, y);
    c.save();
    c.beginPath();
    c.rect(area.left, area.top - 2, area.right - area.left, area.bottom - area.top + 4);
    c.clip();
    this.options.series.forEach((series, i) => this.#line(c, shown, i, series, x, y));
    c.restore();
    this.#describe(shown);
  }

  #scale(shown) {
    let [low, high] = this.options.floor;
    for (const p of shown) {
      for (const v of p.v) {
        if (!Number.isFinite(v) || (this.options.log && v <= 0)) continue;
        low = Math.min(low, v);
        high = Math.max(high, v);
      }
    }
    if (this.options.log) {
      const [a, b] = [Math.log(low), Math.log(high)];
      const ticks = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].filter((t) => t >= low && t <= high);
      return { at: (v) => (Math.log(Math.max(v, low)) - a) / (b - a), ticks: ticks.filter((_, i) => ticks.length < 7 || i % 2 === 0) };
    }
    const pad = (high - low) * 0.04;
    [low, high] = [low - pad, high + pad];
    const raw = (high - low) / 4;
    const unit = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * unit).find((s) => s >= raw);
    const ticks = [];
    for (let t = Math.ceil(low / step) * step; t <= high; t += step) ticks.push(t);
    return { at: (v) => (v - low) / (high - low), ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  #grid(c, area, scale, y) {
    c.font = "11px system-ui, sans-serif";
    c.lineWidth = 1;
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const tick of scale.ticks) {
      c.strokeStyle = css("--grid");
      c.beginPath();
      c.moveTo(area.left, Math.round(y(tick)) + 0.5);
      c.lineTo(area.right, Math.round(y(tick)) + 0.5);
      c.stroke();
      c.fillStyle = css("--soft");
      const text = this.options.log ? String(tick) : (Math.abs(tick) < 1e-9 ? 0 : tick).toFixed(scale.digits);
      c.fillText(text.replace("-", "\u2212"), area.left - 6, y(tick));
    }
    c.textBaseline = "alphabetic";
    for (const [age, align] of [[WINDOW_S, "left"], [WINDOW_S / 2, "center"], [0, "right"]]) {
      c.textAlign = align;
      const x = area.right - (age / WINDOW_S) * (area.right - area.left);
      c.fillText(age === 0 ? "now" : `\u2212${age} s`, x, area.bottom + 14);
    }
  }

  #reference(c, area, y) {
    const { band, line } = this.options;
    if (band) {
      c.fillStyle = css("--band");
      c.fillRect(area.left, y(band[1]), area.right - area.left, y(band[0]) - y(band[1]));
    }
    const at = line?.value();
    if (Number.isFinite(at)) {
      c.strokeStyle = css("--ok");
      c.setLineDash([8, 4]);
      c.lineWidth = 1.5;
      c.beginPath();
      c.moveTo(area.left, y(at));
      c.lineTo(area.right, y(at));
      c.stroke();
      c.setLineDash([]);
      c.fillStyle = css("--ok");
      c.textAlign = "left";
      c.fillText(line.name, area.left + 4, y(at) - 4);
    }
  }

  #line(c, shown, i, series, x, y) {
    c.strokeStyle = css(series.color);
    c.lineWidth = series.width ?? 1.6;
    c.setLineDash(DASHES[series.dash ?? 0]);
    c.lineJoin = "round";
    c.beginPath();
    let pen = false;
    let before = -Infinity;
    for (const p of shown) {
      const v = p.v[i];
      if (!Number.isFinite(v)) {
        pen = false;
        continue;
      }
      // A pause in the data is a gap in the line.
      if (pen && p.t - before < 3) c.lineTo(x(p.t), y(v));
      else c.moveTo(x(p.t), y(v));
      pen = true;
      before = p.t;
    }
    c.stroke();
    c.setLineDash([]);
  }

  #describe(shown) {
    const last = shown[shown.length - 1];
    if (!last || Math.abs(last.t - (this.described ?? -Infinity)) < 5) return;
    this.described = last.t;
    const now = this.options.series.map((s, i) => `${s.name} ${Number.isFinite(last.v[i]) ? last.v[i].toFixed(2) : "unknown"}`);
    this.canvas.setAttribute("aria-label", `${this.title}, ${this.unit}, now: ${now.join(", ")}`);
  }
}
