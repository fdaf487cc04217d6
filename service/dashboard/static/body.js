// The body as it turns in space: a box whose sides tell its moments, played, stopped and scrubbed.
import { $, exact, fill, h, number } from "./core.js";
import { view } from "./sphere.js";

const SECONDS = 8; // that what is on the screen takes at speed 1
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1]);
const FACES = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
const AXES = [0, 0, 1, 1, 2, 2];
const project = view({ yaw: 0.65, pitch: 0.3 });

/** Rotate a vector by a unit quaternion, from the body into space. */
function turned([w, x, y, z], [a, b, c]) {
  const [s, t, u] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * s + y * u - z * t, b + w * t + z * s - x * u, c + w * u + x * t - y * s];
}

/** Return half the sides of a box with these moments of inertia, the longest 0.62; without B a plate. */
function sides({ A, B, C }) {
  const [a, c] = [exact(A), exact(C)];
  const b = B == null ? a + c : exact(B);
  const squares = [b + c - a, a + c - b, a + b - c].map((square) => Math.max(square, 0.02 * (a + b + c)));
  const longest = Math.sqrt(Math.max(...squares));
  return squares.map((square) => (0.62 * Math.sqrt(square)) / longest);
}

function scene(half, quaternion, vertical) {
  const corners = CORNERS.map((corner) => project(turned(quaternion, corner.map((side, k) => side * half[k]))));
  const faces = FACES.map((face, k) => ({ k, depth: face.reduce((sum, n) => sum + corners[n][2], 0), d: `M${face.map((n) => `${corners[n][0].toFixed(4)} ${corners[n][1].toFixed(4)}`).join("L")}Z` }))
    .sort((left, right) => left.depth - right.depth).slice(3);
  const line = (to, kind) => { const [x, y] = project(to); return h("svg:path", { d: `M0 0L${x} ${y}`, class: kind }); };
  const names = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis, k) => {
    const [x, y] = project(turned(quaternion, axis.map((side) => 0.95 * side)));
    return [h("svg:path", { d: `M0 0L${x} ${y}`, class: "axis" }), h("svg:text", { x: 1.1 * x, y: 1.1 * y + 0.03, class: "name" }, String(k + 1))];
  }).flat();
  return [line(vertical, "curve second"), ...names, ...faces.map(({ k, d }) => h("svg:path", { d, class: `face f${AXES[k]}` }))];
}

/** Show the body of a solution whose samples have its orientation; return whether they have. */
export function turningBody(place, moments, { columns }) {
  place.stop?.();
  if (!columns.q0) return false;
  const { t } = columns;
  const half = sides(moments);
  const svg = h("svg:svg", { viewBox: "-1.2 -1.2 2.4 2.4", role: "img", "aria-label": "The body in space, with its principal axes and the vertical" });
  const scrub = h("input", { type: "range", min: 0, max: t.length - 1, step: "any", value: 0, "aria-label": "Time", class: "scrub" });
  const speed = h("select", { "aria-label": "Speed" }, [0.25, 0.5, 1, 2, 4].map((value) => h("option", { value, selected: value === 1 }, `× ${value}`)));
  const button = h("button", { type: "button", class: "main small" }, "Play");
  const clock = h("span", { class: "hint value" });
  let frame = null;

  function draw() {
    const at = Number(scrub.value);
    const k = Math.min(Math.floor(at), t.length - 1);
    const next = Math.min(k + 1, t.length - 1);
    const share = at - k;
    const [here, there] = [k, next].map((n) => ["q0", "q1", "q2", "q3"].map((name) => columns[name][n]));
    const sign = here.reduce((sum, value, n) => sum + value * there[n], 0) < 0 ? -1 : 1; // q and -q are one orientation
    const mixed = here.map((value, n) => (1 - share) * value + share * sign * there[n]);
    const length = Math.hypot(...mixed);
    svg.replaceChildren(...scene(half, mixed.map((value) => value / length), [0, 0, 1.1]));
    clock.textContent = `t = ${number((1 - share) * t[k] + share * t[next], 5)}`;
  }
  function stop() {
    cancelAnimationFrame(frame);
    frame = null;
    button.textContent = "Play";
  }
  function play() {
    let before = null;
    button.textContent = "Pause";
    const step = (now) => {
      const passed = before === null ? 0 : (now - before) / 1000;
      before = now;
      const at = Number(scrub.value) + (passed * Number(speed.value) * (t.length - 1)) / SECONDS;
      scrub.value = at >= t.length - 1 ? 0 : at;
      draw();
      frame = requestAnimationFrame(step);
    };
    frame = requestAnimationFrame(step);
  }
  button.addEventListener("click", () => (frame === null ? play() : stop()));
  scrub.addEventListener("input", draw);
  fill(place, svg, h("div", { class: "row" }, button, speed, scrub, clock));
  place.stop = stop;
  draw();
  return true;
}

/** Draw the multipliers beside the unit circle; those far away at the rim, with an arrow in words. */
export function multipliers(place, { multipliers: found }) {
  const shown = found.map(([re, im]) => {
    const size = Math.hypot(re, im);
    const scale = size > 2 ? 2 / size : 1;
    return { x: re * scale, y: -im * scale, text: `${number(re, 6)}${im ? ` ${im < 0 ? "−" : "+"} ${number(Math.abs(im), 6)} i` : ""}` };
  });
  fill(place, h("svg:svg", { viewBox: "-2.3 -2.3 4.6 4.6", role: "img", "aria-label": `Multipliers ${shown.map(({ text }) => text).join(" and ")}` },
    h("svg:path", { d: "M-2.2 0H2.2M0 -2.2V2.2", class: "net" }), h("svg:circle", { r: 1, class: "unit" }),
    shown.map(({ x, y, text }) => h("svg:circle", { cx: x, cy: y, r: 0.08, class: "mark" }, h("svg:title", {}, text)))),
  h("p", { class: "hint" }, shown.map(({ text }) => text).join(",  ")));
}
