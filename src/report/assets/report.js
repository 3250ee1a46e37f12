// Makes interactive plots of the figures of a report: one time axis, one cursor, zoom by dragging, double click for all.
(() => {
  const figures = [...document.querySelectorAll("figure.chart")];
  const plots = [];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const read = (figure) => {
    const text = decodeURIComponent(figure.querySelector("a.csv").getAttribute("href").split(",").slice(1).join(","));
    const rows = text.split("\n").slice(1).map((row) => row.split(","));
    const columns = rows[0].map((_, k) => rows.map((row) => (row[k] === "" ? null : Number(row[k]))));
    return { ...JSON.parse(figure.dataset.plot), columns };
  };
  const all = figures.map(read);
  const range = all.filter((d) => d.x === "s").reduce(([a, b], d) => [Math.min(a, d.since ?? Infinity, d.columns[0][0]), Math.max(b, d.columns[0].at(-1))], [Infinity, -Infinity]);

  let zooming = false;
  const zoom = (from, { min, max }) => {
    if (zooming) return;
    zooming = true;
    for (const plot of plots) if (plot !== from && plots.includes(from)) plot.setScale("x", { min, max });
    zooming = false;
  };
  const behind = (u, d) => {
    const { left, top, width, height } = u.bbox;
    const c = u.ctx;
    c.save();
    c.beginPath();
    c.rect(left, top, width, height);
    c.clip();
    if (d.limits) {
      c.fillStyle = "rgba(60, 160, 110, 0.15)";
      c.fillRect(left, u.valToPos(d.limits, "y", true), width, u.valToPos(-d.limits, "y", true) - u.valToPos(d.limits, "y", true));
    }
    c.strokeStyle = c.fillStyle = css("--ink");
    c.globalAlpha = 0.6;
    c.font = `${12 * devicePixelRatio}px sans-serif`;
    [c.textAlign, c.textBaseline] = ["left", "alphabetic"];
    let right = -Infinity;
    for (const [t, name] of d.marks) {
      const x = u.valToPos(t, "x", true);
      c.fillRect(Math.round(x), top, devicePixelRatio, height);
      // A name that would lie on the one before is left out: zooming in shows it.
      if (x > right && x > left) {
        c.fillText(name, x + 4 * devicePixelRatio, top + 13 * devicePixelRatio);
        right = x + c.measureText(name).width + 12 * devicePixelRatio;
      }
    }
    c.restore();
  };
  // By itself uPlot stops at three decimals, and neighbours get the same label.
  const decimals = (_, ticks, axis, space, step) => {
    const format = new Intl.NumberFormat("en", { maximumFractionDigits: Math.min(12, Math.max(0, 1 + Math.ceil(-Math.log10(step)))) });
    return ticks.map((t) => format.format(t));
  };
  const build = (figure, d) => {
    const area = figure.querySelector(".area");
    const axis = { stroke: () => css("--ink"), grid: { stroke: () => css("--line"), width: 1 }, ticks: { show: false }, font: "13px sans-serif" };
    const show = (_, v) => (v === null || v === undefined ? "–" : Math.abs(v) >= 100 ? v.toFixed(1) : Number(v.toPrecision(4)).toString());
    const hidden = d.columns.slice(1 + d.lines.length).map(() => ({ show: true, stroke: "transparent", width: 0, points: { show: false }, class: "bound" }));
    const time = d.x === "s";
    const size = () => ({ width: Math.max(200, Math.floor(area.clientWidth)), height: 230 });
    const plot = new uPlot({
      ...size(),
      cursor: { sync: { key: time ? "time" : "frequency", scales: ["x", null] }, drag: { x: true, y: false, setScale: true }, focus: { prox: 16 } },
      scales: { x: { time: false, range: (_, a, b) => (!time ? [a ?? 0, b ?? 1] : a === null || (a === d.columns[0][0] && b === d.columns[0].at(-1)) ? range : [a, b]) }, y: { range: () => d.y } },
      axes: [{ ...axis, size: 34, values: (_, ticks) => ticks.map((t) => `${t} ${d.x}`) }, { ...axis, size: 62, values: decimals }],
      series: [
        { label: time ? "time" : "frequency", value: (_, t) => (t === null || t === undefined ? "–" : `${t.toFixed(time ? 1 : 2)} ${d.x}`) },
        ...d.lines.map(([label, stroke]) => ({ label, stroke, width: 1.5, spanGaps: true, points: { show: false }, value: show })),
        ...hidden,
      ],
      bands: d.bands.map(([low, color]) => ({ series: [low + 2, low + 1], fill: `${color}33` })),
      hooks: { drawClear: [(u) => behind(u, d)], setScale: [(u, key) => { if (key === "x") zoom(u, u.scales.x); }] },
    }, d.columns, area);
    if (time) plots.push(plot);
    window.addEventListener("resize", () => plot.setSize(size()));
    figure.classList.add("live");
  };
  figures.forEach((figure, k) => {
    try {
      build(figure, all[k]);
    } catch (error) {
      console.error(error);
    }
  });
})();
