// Curves in space as SVG, seen from far away: small pictures, and spheres that can be turned.
import { exportable, h } from "./core.js";

const STEP = 0.12; // radians for a press of an arrow key
const CIRCLE = Array.from({ length: 73 }, (_, k) => [Math.cos((k * Math.PI) / 36), Math.sin((k * Math.PI) / 36)]);
const GRATICULE = [CIRCLE.map(([c, s]) => [0, c, s]), CIRCLE.map(([c, s]) => [c, 0, s]), CIRCLE.map(([c, s]) => [c, s, 0])];

/** Return the projection of a point: right, down, towards us. */
export function view({ yaw, pitch }) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return ([x, y, z]) => {
    const ahead = x * cy + y * sy;
    return [y * cy - x * sy, ahead * sp - z * cp, ahead * cp + z * sp];
  };
}

/** Return SVG paths of a curve, the parts in front and those behind. */
function sides(points, project, ball = true) {
  const paths = { front: "", back: "" };
  let side = null;
  let before = null;
  for (const point of points) {
    if (!point.every(Number.isFinite)) { side = null; before = null; continue; }
    const [x, y, depth] = project(point);
    const place = `${x.toFixed(3)} ${y.toFixed(3)}`;
    const here = depth >= 0 || !ball ? "front" : "back";
    if (here !== side) paths[here] += `M${before ?? place}L${place}`;
    else paths[here] += `L${place}`;
    side = here;
    before = place;
  }
  return paths;
}

function drawn(curves, marks, angles, { labels, ball }) {
  const project = view(angles);
  const parts = [];
  if (ball) parts.push(h("svg:circle", { r: 1, class: "ball" }));
  const back = [];
  const front = [];
  if (ball) {
    for (const circle of GRATICULE) {
      const { front: near, back: far } = sides(circle, project);
      back.push(h("svg:path", { d: far, class: "net far" }));
      front.push(h("svg:path", { d: near, class: "net" }));
    }
  }
  for (const { points, kind = "curve" } of curves) {
    const { front: near, back: far } = sides(points, project, ball);
    back.push(h("svg:path", { d: far, class: `${kind} far` }));
    front.push(h("svg:path", { d: near, class: kind }));
  }
  if (labels) {
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
      const [x, y, depth] = project(axis);
      const far = depth < 0 ? " far" : "";
      front.push(h("svg:path", { d: ball ? `M${x} ${y}L${1.14 * x} ${1.14 * y}` : `M0 0L${1.05 * x} ${1.05 * y}`, class: `axis${far}` }),
        h("svg:text", { x: 1.22 * x, y: 1.22 * y + 0.04, class: `name${far}` }, labels[k]));
    });
  }
  for (const { point, kind = "mark", title } of marks) {
    const [x, y, depth] = project(point);
    front.push(h("svg:circle", { cx: x, cy: y, r: 0.035, class: `${kind}${ball && depth < 0 ? " far" : ""}` }, title ? h("svg:title", {}, title) : null));
  }
  return [...parts, ...back, ...front];
}

const FROM = { yaw: 0.65, pitch: 0.45 };

/** Return a still picture of curves on the unit sphere. */
export function picture(curves, { alt = "", marks = [], size = 1.08 } = {}) {
  return h("svg:svg", { viewBox: `${-size} ${-size} ${2 * size} ${2 * size}`, class: "globe", role: "img", "aria-label": alt },
    drawn(curves, marks, FROM, { labels: null, ball: true }));
}

/** Fill an element with curves that can be turned by dragging and by the arrow keys; return how to change them. */
export function turnable(place, { curves, marks = [], labels, ball = true, alt }) {
  const angles = { ...FROM };
  const shown = { curves, marks };
  const svg = h("svg:svg", { viewBox: "-1.35 -1.35 2.7 2.7", role: "img", tabindex: "0", "aria-label": `${alt}. The arrow keys turn it.` });
  const draw = () => svg.replaceChildren(...drawn(shown.curves, shown.marks, angles, { labels, ball }));
  const turn = (right, up) => {
    angles.yaw -= right;
    angles.pitch = Math.max(-1.55, Math.min(1.55, angles.pitch + up));
    draw();
  };
  svg.addEventListener("keydown", (event) => {
    const [right, up] = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] }[event.key] ?? [];
    if (right === undefined) return;
    event.preventDefault();
    turn(right, up);
  });
  let from = null;
  svg.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (!from) return;
    const scale = 2.7 / svg.clientWidth;
    turn((event.clientX - from[0]) * scale, (event.clientY - from[1]) * scale);
    from = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { from = null; });
  draw();
  place.replaceChildren(svg);
  exportable(place);
  return (changed) => { Object.assign(shown, changed); draw(); };
}

/** Return the points (x, y, z) of three columns, no more than ``most`` of them. */
export function pointsOf(columns, names, most = 1500, scale = 1) {
  const [xs, ys, zs] = names.map((name) => columns[name]);
  const step = Math.max(1, Math.ceil(xs.length / most));
  const found = [];
  for (let k = 0; k < xs.length; k += step) found.push([xs[k] * scale, ys[k] * scale, zs[k] * scale]);
  return found;
}
