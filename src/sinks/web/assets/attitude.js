// The attitude indicator: horizon, pitch ladder, bank pointer, heading. Built once, then only transforms and texts change.

const NS = "http://www.w3.org/2000/svg";
const PX_PER_DEG = 2.2;

function svg(tag, attributes, text) {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

export class AttitudeIndicator {
  constructor(box) {
    this.box = box;
    const face = svg("svg", { viewBox: "-110 -110 220 240", role: "img", class: "ai" });
    const clip = svg("clipPath", { id: "ai-clip" });
    clip.append(svg("circle", { r: 100 }));
    const world = svg("g", { "clip-path": "url(#ai-clip)" });
    this.turned = svg("g", {});
    this.moved = svg("g", {});
    this.moved.append(
      svg("rect", { x: -300, y: -600, width: 600, height: 600, class: "ai-sky" }),
      svg("rect", { x: -300, y: 0, width: 600, height: 600, class: "ai-ground" }),
      svg("line", { x1: -300, x2: 300, y1: 0, y2: 0, class: "ai-line" }),
    );
    for (let deg = -80; deg <= 80; deg += 10) {
      if (deg === 0) continue;
      const y = -deg * PX_PER_DEG;
      const half = deg % 20 === 0 ? 30 : 16;
      this.moved.append(svg("line", { x1: -half, x2: half, y1: y, y2: y, class: "ai-line thin" }));
      if (deg % 20 === 0) this.moved.append(svg("text", { x: half + 12, y, class: "ai-small" }, Math.abs(deg)));
    }
    this.turned.append(this.moved);
    world.append(this.turned);
    const marks = svg("g", {});
    for (const bank of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
      marks.append(svg("line", { x1: 0, x2: 0, y1: -100, y2: bank % 30 === 0 ? -88 : -93, class: "ai-line", transform: `rotate(${bank})` }));
    }
    this.pointer = svg("path", { d: "M0 -86 L-7 -72 L7 -72 Z", class: "ai-pointer" });
    this.heading = svg("text", { x: 0, y: 124, class: "ai-heading" });
    face.append(clip, world, marks, this.pointer, svg("path", { d: "M-60 0 H-22 L-12 10 M60 0 H22 L12 10 M-3 0 H3", class: "ai-plane" }), this.heading);
    this.face = face;
    box.append(face);
  }

  /** Roll, pitch and yaw in degrees; nothing is drawn as known while there is no estimate. */
  draw(attitude, known) {
    this.box.classList.toggle("unknown", !known);
    const [roll, pitch, yaw] = known ? attitude.value : [0, 0, 0];
    this.turned.setAttribute("transform", `rotate(${-roll})`);
    this.moved.setAttribute("transform", `translate(0 ${Math.max(-89, Math.min(89, pitch)) * PX_PER_DEG})`);
    this.pointer.setAttribute("transform", `rotate(${-roll})`);
    const heading = known ? `${String(Math.round(((yaw % 360) + 360) % 360) % 360).padStart(3, "0")}°` : "no estimate";
    if (this.heading.textContent !== heading) this.heading.textContent = heading;
    const words = known ? `Roll ${Math.round(roll)}, pitch ${Math.round(pitch)}, heading ${heading}` : "No attitude estimate";
    if (this.face.getAttribute("aria-label") !== words) this.face.setAttribute("aria-label", words);
  }
}
