// Shows one parameter of the fleet at a time, and makes an interactive plot of its flights: all units or one, values under the cursor, zoom by
// dragging, double click for all.
(() => {
  const data = JSON.parse(document.getElementById("fleet").textContent);
  const sections = [...document.querySelectorAll("section.parameter")];
  if (sections.length === 0) return;
  const COLORS = ["#d6604d", "#9669be", "#d07818", "#3ca06e", "#c2548b", "#8a7f2f"];
  const ALL = -1;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const number = (section) => Number(section.id.slice(1));
  const make = (tag, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
  };

  /** What is shown: parameter, unit or ALL, units in colours of their own, whether as difference from the constant part, the chosen log. */
  let view = { parameter: number(sections[0]), unit: ALL, marked: [], relative: false, log: null };
  let plot = null;
  let shown = [];
  let here = null;

  // Values with two figures of their sigma.
  const places = (sigma) => Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(Math.max(sigma, 1e-12)))));
  const pair = (value, sigma) => `${value.toFixed(places(sigma))} ± ${sigma.toFixed(places(sigma))}`;
  const day = (t) => new Date(1e3 * t).toISOString().slice(0, 10);

  /** The points of the view, in the order of the axis. */
  const points = (p) => {
    const constants = new Map(p.constants.map(([unit, value]) => [unit, value]));
    const base = (unit) => (view.relative && view.unit === ALL ? constants.get(unit) ?? 0 : 0);
    return p.values
      .filter(([, unit]) => view.unit === ALL || unit === view.unit)
      .map(([log, unit, value, sigma, expected, unlike]) => ({
        log, unit, sigma, full: value, unlike: unlike === 1,
        x: data.flights[log][2], y: value - base(unit), expected: expected - base(unit),
      }))
      .sort((a, b) => a.x - b.x);
  };

  /** Range of the values; bars count as far as they are as short as most. */
  const range = (p) => {
    const sigmas = shown.map((f) => f.sigma).sort((a, b) => a - b);
    const usual = 2 * (sigmas[Math.floor(sigmas.length / 2)] ?? 0);
    let low = Infinity;
    let high = -Infinity;
    for (const f of shown) {
      const half = Math.min(f.sigma, usual);
      low = Math.min(low, f.y - half, view.unit === ALL ? Infinity : f.expected - p.spread);
      high = Math.max(high, f.y + half, view.unit === ALL ? -Infinity : f.expected + p.spread);
    }
    const pad = 0.06 * (high - low) || 0.5;
    return [low - pad, high + pad];
  };

  const color = (f) => {
    const k = view.marked.indexOf(f.unit);
    return view.unit === ALL && k >= 0 ? COLORS[k % COLORS.length] : "#2a82be";
  };

  const clipped = (u, draw) => {
    const { left, top, width, height } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, height);
    u.ctx.clip();
    draw(u.ctx, (t) => u.valToPos(t, "x", true), (v) => u.valToPos(v, "y", true));
    u.ctx.restore();
  };

  /** Family or spread as bands, the unit's line, and the first flight with each firmware. */
  const behind = (u, p) => clipped(u, (c, px, py) => {
    const { left, top, width, height } = u.bbox;
    const level = (about, half, alpha) => {
      c.globalAlpha = alpha;
      c.fillRect(left, py(about + half), width, py(about - half) - py(about + half));
    };
    c.fillStyle = css("--quiet");
    if (view.unit === ALL && view.relative) level(0, p.spread, 0.2);
    else if (p.family) level(...p.family, 0.14);
    if (view.unit !== ALL && shown.length > 0) {
      const sigma = p.constants.find(([unit]) => unit === view.unit)?.[2] ?? 0;
      const end = 0.012 * (u.scales.x.max - u.scales.x.min);
      const line = [{ ...shown[0], x: shown[0].x - end }, ...shown, { ...shown.at(-1), x: shown.at(-1).x + end }];
      const band = (half, alpha) => {
        c.globalAlpha = alpha;
        c.beginPath();
        line.forEach((f) => c.lineTo(px(f.x), py(f.expected + half)));
        [...line].reverse().forEach((f) => c.lineTo(px(f.x), py(f.expected - half)));
        c.fill();
      };
      c.fillStyle = c.strokeStyle = css("--accent");
      band(p.spread, 0.15);
      band(sigma, 0.35);
      c.globalAlpha = 1;
      c.lineWidth = 1.5 * devicePixelRatio;
      c.beginPath();
      line.forEach((f) => c.lineTo(px(f.x), py(f.expected)));
      c.stroke();
    }
    c.fillStyle = css("--ink");
    c.font = `${12 * devicePixelRatio}px sans-serif`;
    [c.textAlign, c.textBaseline] = ["left", "alphabetic"];
    c.globalAlpha = 0.7;
    let right = -Infinity;
    for (const [t, name] of firmwares()) {
      const x = px(t);
      c.fillRect(Math.round(x), top, devicePixelRatio, height);
      // A name that would lie on the one before is left out: zooming in shows it.
      if (x > right && x >= left) {
        c.fillText(name, x + 4 * devicePixelRatio, top + 13 * devicePixelRatio);
        right = x + c.measureText(name).width + 12 * devicePixelRatio;
      }
    }
  });

  /** When each firmware was first flown, by the flights of the view. */
  const firmwares = () => {
    const first = new Map();
    if (data.dated || view.unit !== ALL) {
      for (const f of shown) {
        const k = data.flights[f.log][1];
        if (k !== null && !first.has(k)) first.set(k, f.x);
      }
    }
    return first.size > 1 ? [...first].map(([k, t]) => [t, data.firmwares[k]]) : [];
  };

  const flights = (u) => clipped(u, (c, px, py) => {
    const many = shown.length > 400;
    const paint = (f) => {
      const [x, y] = [px(f.x), py(f.y)];
      c.strokeStyle = c.fillStyle = color(f);
      const faint = view.unit === ALL && view.marked.length > 0 && !view.marked.includes(f.unit);
      c.globalAlpha = faint ? 0.3 : many ? 0.6 : 0.9;
      c.lineWidth = devicePixelRatio;
      c.beginPath();
      c.moveTo(x, py(f.y - f.sigma));
      c.lineTo(x, py(f.y + f.sigma));
      c.stroke();
      c.beginPath();
      c.arc(x, y, (many ? 2.2 : 3.2) * devicePixelRatio, 0, 2 * Math.PI);
      c.fill();
    };
    const ring = (f, radius, style) => {
      c.globalAlpha = 1;
      c.lineWidth = 2 * devicePixelRatio;
      c.strokeStyle = style;
      c.beginPath();
      c.arc(px(f.x), py(f.y), radius * devicePixelRatio, 0, 2 * Math.PI);
      c.stroke();
    };
    // Marked units lie on top, each along a line.
    shown.filter((f) => !view.marked.includes(f.unit)).forEach(paint);
    if (view.unit === ALL) {
      for (const unit of view.marked) {
        const own = shown.filter((f) => f.unit === unit);
        c.globalAlpha = 0.6;
        c.lineWidth = devicePixelRatio;
        c.strokeStyle = own.length > 0 ? color(own[0]) : "";
        c.beginPath();
        own.forEach((f) => c.lineTo(px(f.x), py(f.y)));
        c.stroke();
      }
    }
    shown.filter((f) => view.marked.includes(f.unit)).forEach(paint);
    shown.filter((f) => f.unlike).forEach((f) => ring(f, 7, "#d6604d"));
    if (here) ring(here, 10, css("--ink"));
  });

  const readout = make("p", { className: "readout", role: "status" });
  const HINT = "Point at a flight, or choose the plot and press the arrow keys. Drag to zoom, double click for all.";
  /** Shows the figures of one flight, or what there is to do. */
  const choose = (f) => {
    here = f;
    view.log = f?.log ?? null;
    if (!f) readout.textContent = HINT;
    else {
      const p = data.parameters[view.parameter];
      const [path, firmware, x] = data.flights[f.log];
      const when = data.dated ? day(x) : `flight ${x}`;
      const unlike = f.unlike ? ", unlike the other flights of its unit" : "";
      const version = firmware === null ? "" : `, firmware ${data.firmwares[firmware]}`;
      readout.replaceChildren(make("b", { textContent: `${data.units[f.unit]}: ${pair(f.full, f.sigma)} ${p.unit}` }), `${unlike} · ${when}${version} · ${path}`);
    }
    plot?.redraw(false);
  };

  /** The flight nearest to the cursor, within reach. */
  const nearest = (u) => {
    const { left, top } = u.cursor;
    if (left === null || left < 0) return null;
    let best = null;
    let least = 40 ** 2;
    for (const f of shown) {
      const distance = (u.valToPos(f.x, "x") - left) ** 2 + (u.valToPos(f.y, "y") - top) ** 2;
      if (distance < least) [best, least] = [f, distance];
    }
    return best;
  };

  const labels = (_, ticks, __, ___, step) => {
    if (!data.dated) return ticks.map((t) => (Number.isInteger(t) ? `${t}` : ""));
    const text = (t) => new Date(1e3 * t).toISOString();
    return ticks.map((t) => (step >= 28 * 86400 ? text(t).slice(0, 7) : step >= 86400 ? text(t).slice(0, 10) : text(t).slice(5, 16).replace("T", " ")));
  };

  // By itself uPlot stops at three decimals, and neighbours get the same label.
  const decimals = (_, ticks, axis, space, step) => {
    const format = new Intl.NumberFormat("en", { maximumFractionDigits: Math.min(12, Math.max(0, 1 + Math.ceil(-Math.log10(step)))) });
    return ticks.map((t) => format.format(t));
  };
  const build = (section, p) => {
    const area = section.querySelector(".area");
    plot?.destroy();
    shown = points(p);
    const xs = data.flights.filter((f) => f !== null).map((f) => f[2]);
    const [first, last] = xs.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
    const pad = 0.02 * (last - first) || (data.dated ? 43200 : 0.5);
    const y = range(p);
    const axis = { stroke: () => css("--ink"), grid: { stroke: () => css("--line"), width: 1 }, ticks: { show: false }, font: "13px sans-serif" };
    const size = () => ({ width: Math.max(200, Math.floor(area.clientWidth)), height: 320 });
    const whole = [first - pad, last + pad];
    plot = new uPlot({
      ...size(),
      legend: { show: false },
      tzDate: (t) => uPlot.tzDate(new Date(1e3 * t), "UTC"),
      cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: true } },
      scales: { x: { time: data.dated, range: (_, a, b) => (a === null || shown[0].x === shown.at(-1).x || (a === shown[0].x && b === shown.at(-1).x) ? whole : [a, b]) }, y: { range: () => y } },
      axes: [{ ...axis, size: 34, space: 90, values: labels }, { ...axis, size: 68, values: decimals }],
      series: [{}, { paths: () => null, points: { show: false } }],
      hooks: {
        drawClear: [(u) => behind(u, p)],
        draw: [(u) => flights(u)],
        setCursor: [(u) => {
          const f = nearest(u);
          if (f && f !== here) choose(f);
        }],
      },
    }, [shown.map((f) => f.x), shown.map((f) => f.y)], area);
    section.querySelector(".chart").classList.add("live", "flights");
    section.querySelector(".chart").after(readout);
    choose(shown.find((f) => f.log === view.log) ?? null);
    return () => plot.setSize(size());
  };

  const keys = (section) => {
    const key = (className, background, text) => {
      const mark = make("i", { className });
      if (background) mark.style.background = background;
      return make("span", { className: "key" }, mark, text);
    };
    const out = view.unit === ALL ? view.marked.map((unit, k) => key("", COLORS[k % COLORS.length], data.units[unit])) : [key("", "#2a82be", data.units[view.unit])];
    if (shown.some((f) => f.unlike)) out.push(key("ring", "", "unlike the others of its unit"));
    section.querySelector(".keys").replaceChildren(...out);
  };

  const parameters = make("select");
  const groups = [["1", "With findings"], ["0", "Without findings"]].map(([found, label]) => {
    const own = sections.filter((s) => s.dataset.found === found);
    return own.length === 0 ? "" : make("optgroup", { label }, ...own.map((s) => make("option", { value: number(s), textContent: s.dataset.title })));
  });
  parameters.append(...groups.filter((g) => g !== ""));
  const units = make("select");
  const relative = make("input", { type: "checkbox" });
  document.getElementById("controls").append(
    make("label", {}, "Parameter", parameters),
    make("label", {}, "Unit", units),
    make("label", {}, relative, "less the constant part of each unit"),
  );

  let resize = () => {};
  const show = (change, asked = true) => {
    view = { ...view, log: null, ...change };
    const p = data.parameters[view.parameter];
    const there = new Set(p.constants.map(([unit]) => unit));
    if (view.unit !== ALL && !there.has(view.unit)) view.unit = ALL;
    if (!("marked" in change)) view.marked = p.stands;
    for (const section of sections) section.hidden = number(section) !== view.parameter;
    const section = sections.find((s) => !s.hidden);
    parameters.value = view.parameter;
    units.replaceChildren(make("option", { value: ALL, textContent: `all ${there.size}` }), ...[...there].map((k) => make("option", { value: k, textContent: data.units[k] })));
    units.value = view.unit;
    relative.checked = view.relative;
    relative.disabled = view.unit !== ALL;
    resize = build(section, p);
    keys(section);
    for (const row of section.querySelectorAll(".units tbody tr")) row.classList.toggle("chosen", Number(row.cells[0].dataset.v) === view.unit);
    // The address leads back to what a reader chose.
    if (asked) history.replaceState(null, "", view.unit === ALL ? `#p${view.parameter}` : `#p${view.parameter}:${view.unit}`);
  };

  parameters.addEventListener("change", () => show({ parameter: Number(parameters.value) }));
  units.addEventListener("change", () => show({ unit: Number(units.value) }));
  relative.addEventListener("change", () => show({ relative: relative.checked }));
  window.addEventListener("resize", () => resize());
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => plot.redraw(false));

  // Links to findings and units choose what they name.
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.("a[href^='#p']");
    if (!link || link.classList.contains("csv")) return;
    event.preventDefault();
    const { unit, mark, log } = link.dataset;
    const [, parameter] = /^#p(\d+)$/.exec(link.getAttribute("href")) ?? [];
    show({
      parameter: Number(parameter ?? view.parameter),
      unit: Number(unit ?? ALL),
      relative: link.dataset.relative === "1",
      ...(mark === undefined ? {} : { marked: [Number(mark)] }),
      log: log === undefined ? null : Number(log),
    });
    document.getElementById("parameters").scrollIntoView({ block: "start" });
    if (parameter !== undefined) sections.find((s) => !s.hidden).querySelector(".flights").focus({ preventScroll: true });
  });

  for (const section of sections) {
    const figure = section.querySelector(".chart");
    Object.assign(figure, { tabIndex: 0 });
    figure.setAttribute("aria-label", `${section.dataset.title}: flights over ${data.dated ? "time" : "their number"}; arrow keys go from flight to flight`);
    figure.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!step || shown.length === 0) return;
      event.preventDefault();
      const at = shown.indexOf(here);
      choose(shown[at < 0 ? (step > 0 ? 0 : shown.length - 1) : Math.min(shown.length - 1, Math.max(0, at + step))]);
    });
    section.querySelector("a.csv").addEventListener("click", (event) => {
      const p = data.parameters[number(section)];
      const quoted = (text) => `"${text.replaceAll('"', '""')}"`;
      const rows = p.values.map(([log, unit, value, sigma, expected, unlike]) => {
        const [path, firmware, x] = data.flights[log];
        return [quoted(path), quoted(data.units[unit]), quoted(data.firmwares[firmware] ?? ""), data.dated ? new Date(1e3 * x).toISOString() : x, value, sigma, expected, unlike].join(",");
      });
      const head = `log,unit,firmware,${data.dated ? "start" : "flight"},value,sigma,expected,unlike_the_others`;
      event.currentTarget.href = `data:text/csv;charset=utf-8,${encodeURIComponent([head, ...rows].join("\n"))}`;
    });
    // Headings sort their table: numbers by value, those that are not there last.
    for (const head of section.querySelectorAll(".units th:not(.forest)")) {
      const button = make("button", { type: "button", textContent: head.textContent });
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const direction = { ascending: "descending", descending: "ascending" }[head.getAttribute("aria-sort")] ?? (head.cellIndex === 0 ? "ascending" : "descending");
        section.querySelectorAll(".units th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", direction);
        const sign = direction === "ascending" ? 1 : -1;
        const value = (row) => row.cells[head.cellIndex].dataset.v;
        const body = section.querySelector(".units tbody");
        body.append(...[...body.rows].sort((a, b) => {
          const [x, y] = [value(a), value(b)];
          if (x === undefined || y === undefined) return (x === undefined) - (y === undefined);
          return sign * (Number(x) - Number(y));
        }));
      });
    }
  }

  const [, parameter, unit] = /^#p(\d+)(?::(\d+))?$/.exec(location.hash) ?? [];
  const named = sections.some((s) => number(s) === Number(parameter));
  if (named) {
    show({ parameter: Number(parameter), unit: Number(unit ?? ALL) });
    document.getElementById("parameters").scrollIntoView({ block: "start" });
  } else {
    // The first finding, as its link shows it.
    const link = document.querySelector(".answers a[href^='#p']");
    const { mark, unit: own, relative: less } = link?.dataset ?? {};
    const at = link ? Number(link.getAttribute("href").slice(2)) : view.parameter;
    show({ parameter: at, unit: Number(own ?? ALL), relative: less === "1", ...(mark === undefined ? {} : { marked: [Number(mark)] }) }, false);
  }
})();
