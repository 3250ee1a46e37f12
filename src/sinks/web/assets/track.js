// The map: planned path, fence, home and the track over ground, north up, the vehicle as an arrow, a scale bar. Nothing is
// loaded from elsewhere.

import { css, prepare } from "./chart.js";

const M_PER_DEG = 111320;

export class Track {
  constructor(canvas) {
    this.canvas = canvas;
    /** {home: [lat, lon] | null, path: [[lat, lon]…], fence: [[[lat, lon]…]…]} */
    this.route = null;
    this.view = null;
  }

  draw(points, velocity) {
    const { context: c, width, height } = prepare(this.canvas);
    const fixes = points.filter((p) => Number.isFinite(p.lat) && Number.isFinite(p.lon) && (p.lat !== 0 || p.lon !== 0));
    const last = fixes[fixes.length - 1];
    const origin = this.route?.home ?? this.route?.path?.[0] ?? (last ? [last.lat, last.lon] : null);
    if (origin === null) {
      c.fillStyle = css("--soft");
      c.font = "14px system-ui, sans-serif";
      c.textAlign = "center";
      c.fillText("no position yet", width / 2, height / 2);
      return;
    }
    // The place of reference stays for the whole flight: the picture must not slide.
    this.origin = this.route?.home ?? this.origin ?? origin;
    const east = M_PER_DEG * Math.cos((this.origin[0] * Math.PI) / 180);
    const local = ([lat, lon]) => ({ e: (((lon - this.origin[1] + 540) % 360) - 180) * east, n: (lat - this.origin[0]) * M_PER_DEG });
    const flown = fixes.map((p) => ({ ...local([p.lat, p.lon]), t: p.t }));
    const path = (this.route?.path ?? []).map(local);
    const fence = (this.route?.fence ?? []).map((ring) => ring.map(local));
    const home = this.route?.home ? local(this.route.home) : null;
    const place = this.#fit([...flown, ...path, ...fence.flat(), ...(home ? [home] : [])], width, height);
    this.#grid(c, place, width, height);
    for (const ring of fence) this.#line(c, [...ring, ring[0]], place, { color: "--bad", dash: [8, 5], width: 2 });
    this.#line(c, path, place, { color: "--none", dash: [], width: 1.5 });
    this.#path(c, flown, place);
    if (home) this.#home(c, place(home));
    if (flown.length > 0) this.#vehicle(c, place(flown[flown.length - 1]), velocity);
    const words = last ? `now at ${last.lat.toFixed(5)}, ${last.lon.toFixed(5)}` : "no position yet";
    this.canvas.setAttribute("aria-label", `Map: ${path.length > 0 ? "planned path, " : ""}${fence.length > 0 ? "fence, " : ""}track over ground, ${words}`);
  }

  /** Shows everything; the view only ever widens, and in steps. */
  #fit(all, width, height) {
    const range = (key) => all.reduce(([a, b], p) => [Math.min(a, p[key]), Math.max(b, p[key])], [Infinity, -Infinity]);
    const [e, n] = [range("e"), range("n")];
    const v = this.view;
    const inside = v && e[0] >= v.e[0] && e[1] <= v.e[1] && n[0] >= v.n[0] && n[1] <= v.n[1];
    if (!inside) {
      const wider = ([a, b]) => [a - Math.max(15, 0.1 * (b - a)), b + Math.max(15, 0.1 * (b - a))];
      this.view = { e: wider(e), n: wider(n) };
    }
    const { e: ve, n: vn } = this.view;
    const span = Math.max((ve[1] - ve[0]) / (width - 24), (vn[1] - vn[0]) / (height - 24), 0.01);
    const [me, mn] = [(ve[0] + ve[1]) / 2, (vn[0] + vn[1]) / 2];
    const place = (p) => ({ x: width / 2 + (p.e - me) / span, y: height / 2 - (p.n - mn) / span });
    place.metresPerPixel = span;
    return place;
  }

  #line(c, points, place, { color, dash, width }) {
    if (points.length < 2) return;
    c.strokeStyle = css(color);
    c.lineWidth = width;
    c.setLineDash(dash);
    c.beginPath();
    points.forEach((p, i) => {
      const { x, y } = place(p);
      if (i === 0) c.moveTo(x, y);
      else c.lineTo(x, y);
    });
    c.stroke();
    c.setLineDash([]);
  }

  #home(c, { x, y }) {
    c.fillStyle = css("--card");
    c.strokeStyle = css("--ink");
    c.lineWidth = 2;
    c.beginPath();
    c.arc(x, y, 9, 0, 2 * Math.PI);
    c.fill();
    c.stroke();
    c.fillStyle = css("--ink");
    c.font = "700 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillText("H", x, y + 0.5);
    c.textBaseline = "alphabetic";
  }

  #grid(c, place, width, height) {
    const raw = place.metresPerPixel * Math.min(width, 320) * 0.3;
    const unit = 10 ** Math.floor(Math.log10(raw));
    const step = [5, 2, 1].map((m) => m * unit).find((s) => s <= raw);
    const pixels = step / place.metresPerPixel;
    const origin = place({ e: 0, n: 0 });
    c.strokeStyle = css("--grid");
    c.lineWidth = 1;
    c.beginPath();
    for (let x = origin.x % pixels; x < width; x += pixels) {
      c.moveTo(Math.round(x) + 0.5, 0);
      c.lineTo(Math.round(x) + 0.5, height);
    }
    for (let y = origin.y % pixels; y < height; y += pixels) {
      c.moveTo(0, Math.round(y) + 0.5);
      c.lineTo(width, Math.round(y) + 0.5);
    }
    c.stroke();
    c.strokeStyle = c.fillStyle = css("--ink");
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(12, height - 16);
    c.lineTo(12, height - 11);
    c.lineTo(12 + pixels, height - 11);
    c.lineTo(12 + pixels, height - 16);
    c.stroke();
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "left";
    c.fillText(step >= 1000 ? `${step / 1000} km` : `${step} m`, 18, height - 17);
    c.textAlign = "center";
    c.fillText("N", width - 18, 32);
    c.beginPath();
    c.moveTo(width - 18, 6);
    c.lineTo(width - 13, 18);
    c.lineTo(width - 23, 18);
    c.fill();
  }

  #path(c, local, place) {
    c.lineWidth = 3;
    c.lineJoin = c.lineCap = "round";
    if (local.length === 0) return;
    const end = local[local.length - 1].t;
    // Older parts are paler, in a few strokes instead of one per point.
    for (const [age, alpha] of [[Infinity, 0.3], [120, 0.6], [40, 1]]) {
      c.globalAlpha = alpha;
      c.strokeStyle = css("--accent");
      c.beginPath();
      let pen = false;
      for (const p of local) {
        if (end - p.t > age) continue;
        const { x, y } = place(p);
        if (pen) c.lineTo(x, y);
        else c.moveTo(x, y);
        pen = true;
      }
      c.stroke();
    }
    c.globalAlpha = 1;
  }

  #vehicle(c, at, velocity) {
    const [vn, ve] = velocity ?? [0, 0];
    c.save();
    c.translate(at.x, at.y);
    c.fillStyle = css("--ink");
    c.strokeStyle = css("--card");
    c.lineWidth = 2;
    c.beginPath();
    if (Math.hypot(vn, ve) > 1) {
      c.rotate(Math.atan2(ve, vn));
      c.moveTo(0, -13);
      c.lineTo(8, 9);
      c.lineTo(0, 4);
      c.lineTo(-8, 9);
      c.closePath();
    } else {
      c.arc(0, 0, 6, 0, 2 * Math.PI);
    }
    c.fill();
    c.stroke();
    c.restore();
  }
}
