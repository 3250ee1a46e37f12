// The track over ground: north up, the vehicle as an arrow, a scale bar. No map: nothing is loaded from elsewhere.

import { css, prepare } from "./chart.js";

const M_PER_DEG = 111320;

export class Track {
  constructor(canvas) {
    this.canvas = canvas;
  }

  draw(points, velocity) {
    const { context: c, width, height } = prepare(this.canvas);
    const fixes = points.filter((p) => Number.isFinite(p.lat) && Number.isFinite(p.lon) && (p.lat !== 0 || p.lon !== 0));
    if (fixes.length === 0) {
      c.fillStyle = css("--soft");
      c.font = "14px system-ui, sans-serif";
      c.textAlign = "center";
      c.fillText("no position yet", width / 2, height / 2);
      return;
    }
    const last = fixes[fixes.length - 1];
    const east = M_PER_DEG * Math.cos((last.lat * Math.PI) / 180);
    const local = fixes.map((p) => ({ e: (p.lon - last.lon) * east, n: (p.lat - last.lat) * M_PER_DEG, t: p.t }));
    const place = this.#fit(local, width, height);
    this.#grid(c, place, width, height);
    this.#path(c, local, place);
    this.#vehicle(c, place({ e: 0, n: 0 }), velocity);
    this.canvas.setAttribute("aria-label", `Track over ground, now at ${last.lat.toFixed(5)}, ${last.lon.toFixed(5)}`);
  }

  #fit(local, width, height) {
    const range = (key) => local.reduce(([a, b], p) => [Math.min(a, p[key]), Math.max(b, p[key])], [Infinity, -Infinity]);
    const [e, n] = [range("e"), range("n")];
    const room = 28;
    const span = Math.max((e[1] - e[0]) / (width - 2 * room), (n[1] - n[0]) / (height - 2 * room), 60 / Math.min(width, height));
    const [me, mn] = [(e[0] + e[1]) / 2, (n[0] + n[1]) / 2];
    const place = (p) => ({ x: width / 2 + (p.e - me) / span, y: height / 2 - (p.n - mn) / span });
    place.metresPerPixel = span;
    return place;
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
