// The body as it turns in space, and the one clock that it, the spheres and the charts of a motion follow.
import { exact, exportable, fill, h, number } from "./core.js";
import { view } from "./sphere.js";

const SECONDS = 8; // that what is on the screen takes at speed 1
const FEW_FRAMES = 400;
const MOST_FRAMES = 6400;
const FRAMES_OF_A_PERIOD = 100;
const MOST_POINTS = 1200; // of a curve beside the body
const PIXEL = 0.004; // of the length of an axis in a picture 26rem wide: how far a turn by that angle moves its tip
const BOX = "-1.2 -1.2 2.4 2.4";
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1]);
const FACES = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
const AXES = [0, 0, 1, 1, 2, 2];
const UNITS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const QUATERNION = ["q0", "q1", "q2", "q3"];
const OMEGA = ["p", "q", "r"];
const project = view({ yaw: 0.65, pitch: 0.3 });

const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const scaled = (vector, scale) => vector.map((part) => scale * part);
const unit = (vector) => scaled(vector, 1 / Math.hypot(...vector));

/** Rotate a vector by a unit quaternion, from the body into space. */
function turned([w, x, y, z], [a, b, c]) {
  const [s, t, u] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * s + y * u - z * t, b + w * t + z * s - x * u, c + w * u + x * t - y * s];
}

function product([a, b, c, d], [e, f, g, k]) {
  return [a * e - b * f - c * g - d * k, a * f + b * e + c * k - d * g, a * g - b * k + c * e + d * f, a * k + b * g - c * f + d * e];
}

/** Return an attitude in which the vertical has the components γ in the body; the azimuth of one axis is 0. */
function upright(gamma) {
  const third = unit(gamma);
  const k = third.findIndex((part) => part * part < 0.9);
  const first = unit(UNITS[k].map((part, n) => part - third[k] * third[n]));
  const rows = [first, cross(third, first), third];
  // The largest of the four parts first, so that nothing cancels.
  const trace = rows[0][0] + rows[1][1] + rows[2][2];
  const sizes = [trace, rows[0][0], rows[1][1], rows[2][2]];
  const at = sizes.indexOf(Math.max(...sizes));
  const skew = [rows[2][1] - rows[1][2], rows[0][2] - rows[2][0], rows[1][0] - rows[0][1]];
  if (at === 0) return unit([1 + trace, ...skew]);
  const [i, j, n] = [at - 1, at % 3, (at + 1) % 3];
  const found = [skew[i], 0, 0, 0];
  found[i + 1] = 1 + 2 * rows[i][i] - trace;
  found[j + 1] = rows[i][j] + rows[j][i];
  found[n + 1] = rows[i][n] + rows[n][i];
  return unit(found);
}

/**
 * Return the attitudes at every ``2 * skip``-th time, by the equation q' = qω/2.
 *
 * Magnus's method of fourth order: over a step the angular velocity is the parabola through three of its values.
 */
function integrated(columns, skip) {
  const { t } = columns;
  const omega = (k) => OMEGA.map((name) => columns[name][k]);
  let here = upright(["g1", "g2", "g3"].map((name) => columns[name][0]));
  const found = [here];
  for (let k = 0; k + 2 * skip < t.length; k += 2 * skip) {
    const step = t[k + 2 * skip] - t[k];
    const [first, middle, last] = [omega(k), omega(k + skip), omega(k + 2 * skip)];
    const twist = cross(first, last);
    const turn = first.map((part, n) => (step / 6) * (part + 4 * middle[n] + last[n]) + ((step * step) / 12) * twist[n]);
    const angle = Math.hypot(...turn);
    const share = angle > 0 ? Math.sin(angle / 2) / angle : 0.5;
    here = unit(product(here, [Math.cos(angle / 2), ...scaled(turn, share)]));
    found.push(here);
  }
  return found;
}

/** Return the attitudes from ω at equally spaced times, and how far those of steps twice as long are from them, as an angle. */
export function attitudesFrom(columns) {
  const frames = integrated(columns, 1);
  const apart = integrated(columns, 2).map((other, k) => 2 * Math.acos(Math.min(1, Math.abs(other.reduce((sum, part, n) => sum + part * frames[2 * k][n], 0)))));
  return { frames, apart: Math.max(...apart) };
}

/**
 * Return {t, frames, apart, columns} of a body between two times; ``ask(count, names)`` gives samples of equally spaced times.
 *
 * Attitudes that are stored have a proven error. Others follow from ω here, with as many steps as it takes to be less
 * than a pixel off; null where the motion is too fast for that.
 */
export async function framesOf(ask, periods, isStored) {
  const wanted = Math.max(FEW_FRAMES, FRAMES_OF_A_PERIOD * (periods || 1));
  const names = [...OMEGA, "g1", "g2", "g3"];
  const few = Math.min(MOST_FRAMES, 4 * Math.ceil(wanted / 4));
  if (isStored) {
    const { columns } = await ask(few + 1, [...names, ...QUATERNION]);
    return { t: columns.t, frames: Array.from(columns.t, (_, k) => QUATERNION.map((name) => columns[name][k])), apart: null, columns };
  }
  for (let count = few; count <= 2 * MOST_FRAMES; count *= 4) {
    const { columns } = await ask(2 * count + 1, names);
    const { frames, apart } = attitudesFrom(columns);
    if (apart < PIXEL) return { t: columns.t.filter((_, k) => k % 2 === 0), frames, apart, columns };
  }
  return null;
}

/** Return the moments of a body: of a classical case some may follow from the case, which the evidence has. */
export const momentsOf = ({ problem: { body }, evidence }) => Object.fromEntries(["A", "B", "C"].map((name) => [name, body[name] ?? (typeof evidence?.[name] === "number" ? evidence[name] : null)]));

/** Return the moments of the box that is drawn, and what is said of them: without B its place is in the middle. */
export function drawnBody({ A, B, C }) {
  if (A === null || C === null) return { moments: [1, 1, 1], note: "The moments that follow from the case are not in this solution: the box is a cube." };
  const [a, c] = [A, C].map(exact);
  if (B !== null) return { moments: [a, exact(B), c], note: `A box with the moments of inertia of the body, B = ${number(exact(B), 6)}.` };
  const [least, most] = [Math.abs(a - c), a + c];
  const b = (least + most) / 2;
  return { moments: [a, b, c], note: `The problem gives no B: the box has B = ${number(b, 4)}, in the middle of what the other two allow, ${number(least, 4)} to ${number(most, 4)}.` };
}

/** Return half the sides of a box with these moments of inertia, the longest 0.62. */
function sides([a, b, c]) {
  const squares = [b + c - a, a + c - b, a + b - c].map((square) => Math.max(square, 0.02 * (a + b + c)));
  const longest = Math.sqrt(Math.max(...squares));
  return squares.map((square) => (0.62 * Math.sqrt(square)) / longest);
}

/** Return a path through points in space; what is not a number ends a part of it. */
function pathOf(points, kind) {
  let before = false;
  const d = points.map((point) => {
    const [x, y] = project(point);
    const text = Number.isFinite(x + y) ? `${before ? "L" : "M"}${x.toFixed(4)} ${y.toFixed(4)}` : "";
    before = text !== "";
    return text;
  }).join("");
  return h("svg:path", { d: d || "M0 0", class: kind });
}

const named = (point, text, kind = "name") => {
  const [x, y] = project(point);
  return h("svg:text", { x: 1.1 * x, y: 1.1 * y + 0.03, class: kind }, text);
};

/** Return the parts of the picture: what is behind the box, the box, what is in front of it. */
function scene({ half, centre }, quaternion, curves) {
  const corners = CORNERS.map((corner) => project(turned(quaternion, corner.map((side, k) => side * half[k]))));
  const faces = FACES.map((face, k) => ({ k, depth: face.reduce((sum, n) => sum + corners[n][2], 0), d: `M${face.map((n) => `${corners[n][0].toFixed(4)} ${corners[n][1].toFixed(4)}`).join("L")}Z` }))
    .sort((left, right) => left.depth - right.depth).slice(3);
  const ray = (to, kind) => pathOf([[0, 0, 0], to], kind);
  const lines = UNITS.map((axis) => turned(quaternion, scaled(axis, 0.95))).flatMap((tip, k) => [ray(tip, "axis"), named(tip, String(k + 1))]);
  const box = faces.map(({ k, d }) => h("svg:path", { d, class: `face f${AXES[k]}` }));
  const behind = [ray([0, 0, 1.1], "curve second"), ...curves, ...lines];
  if (!centre) return [...behind, ...box];
  const at = turned(quaternion, scaled(centre, 0.8));
  const [cx, cy, depth] = project(at);
  const mark = [ray(at, "axis"), h("svg:circle", { cx, cy, r: 0.04, class: "mark" }, h("svg:title", {}, "the direction of the centre of mass"))];
  return depth < 0 ? [...behind, ...mark, ...box] : [...behind, ...box, ...mark];
}

/** Return the direction from the fixed point to the centre of mass, where the field is that of gravity alone. */
export function centreOf(potential) {
  if (potential.type !== "gravity") return null;
  const found = ["a", "b", "c"].map((name) => exact(potential[name] ?? 0));
  return Math.hypot(...found) > 0 ? unit(found) : null;
}

/** Return at most so many of some things, the last one too. */
const thinned = (all, most = MOST_POINTS) => {
  const step = Math.max(1, Math.ceil(all.length / most));
  return all.filter((_, k) => k % step === 0 || k === all.length - 1);
};

/** Show the body of a motion: {t, frames, columns} as framesOf returns it. It follows the clock. */
export function turningBody(place, { moments, centre }, { t, frames, columns }, clock) {
  place.leave?.();
  const shown = place.shown ??= { trail: "3", polhode: false, herpolhode: false };
  const body = { half: sides(moments), centre };
  const largest = columns.t.reduce((most, _, k) => Math.max(most, Math.hypot(...OMEGA.map((name) => columns[name][k]))), 1e-300);
  const every = columns.t.length > t.length ? 2 : 1;
  const spin = frames.map((_, k) => OMEGA.map((name) => columns[name][every * k] / largest));
  const inSpace = thinned(frames.map((frame, k) => turned(frame, spin[k])));
  const inBody = thinned(spin);
  const tips = UNITS.map((axis) => frames.map((frame) => turned(frame, scaled(axis, 0.95))));

  /** Return the attitude at a place between the frames; q and -q are one attitude. */
  function attitude(at) {
    const k = Math.min(Math.floor(at), frames.length - 1);
    const [here, there] = [frames[k], frames[Math.min(k + 1, frames.length - 1)]];
    const share = at - k;
    const sign = here.reduce((sum, value, n) => sum + value * there[n], 0) < 0 ? -1 : 1;
    return unit(here.map((value, n) => (1 - share) * value + share * sign * there[n]));
  }
  function partsAt(share) {
    const at = share * (frames.length - 1);
    const quaternion = attitude(at);
    const trail = shown.trail === "" ? [] : tips[Number(shown.trail) - 1];
    const curves = [
      pathOf(thinned(trail), "faint"), pathOf(thinned(trail.slice(0, Math.floor(at) + 1)), "curve third"),
      shown.herpolhode ? pathOf(inSpace, "curve second") : null,
      shown.polhode ? pathOf(inBody.map((point) => turned(quaternion, point)), "curve fourth") : null,
      shown.herpolhode || shown.polhode ? pathOf([[0, 0, 0], turned(quaternion, spin[Math.round(at)])], "axis") : null,
    ].filter(Boolean);
    return scene(body, quaternion, curves);
  }

  const svg = h("svg:svg", { viewBox: BOX, role: "img", "aria-label": `The body in space, with its principal axes, the vertical${centre ? ", the centre of mass" : ""} and what is chosen below` });
  const draw = () => svg.replaceChildren(...partsAt(clock.share));
  const trails = h("select", { onchange: ({ currentTarget }) => { shown.trail = currentTarget.value; draw(); } },
    [["", "no axis"], ["1", "axis 1"], ["2", "axis 2"], ["3", "axis 3"]].map(([value, text]) => h("option", { value, selected: value === shown.trail }, text)));
  const choice = (name, text) => h("label", {}, h("input", { type: "checkbox", checked: shown[name], onchange: ({ currentTarget }) => { shown[name] = currentTarget.checked; draw(); } }), ` ${text}`);
  fill(place, svg, h("div", { class: "row" }, h("label", {}, "trail of ", trails), choice("polhode", "polhode"), choice("herpolhode", "herpolhode")));
  place.film = () => ({ seconds: SECONDS / clock.speed, box: BOX, scene: partsAt });
  place.leave = clock.follow(draw);
  exportable(place, { moves: true });
}

/**
 * The clock of a page: a time between the ends of the samples that it has, played, stopped and scrubbed.
 *
 * ``follow(see)`` calls ``see(clock)`` at each change until what it returns is called; ``textOf(k)`` gives the text of a sample.
 */
export class Clock {
  constructor(place, textOf) {
    Object.assign(this, { t: [0, 1], share: 0, k: 0, textOf, seen: new Set(), frame: null });
    this.scrub = h("input", { type: "range", min: 0, max: 1, step: "any", value: 0, "aria-label": "Time", class: "scrub", oninput: () => { this.stop(); this.move(Number(this.scrub.value)); } });
    this.pace = h("select", { "aria-label": "Speed" }, [0.25, 0.5, 1, 2, 4].map((value) => h("option", { value, selected: value === 1 }, `× ${value}`)));
    this.button = h("button", { type: "button", class: "main small", onclick: () => (this.frame === null ? this.play() : this.stop()) }, "Play");
    // No live region: while the clock runs nothing else could be heard.
    this.values = h("p", { class: "hint value", tabindex: "0", role: "group", "aria-label": "Values at this time" });
    fill(place, h("div", { class: "row" }, this.button, this.pace, this.scrub), this.values);
  }

  get speed() { return Number(this.pace.value); }
  get time() { return this.t[0] + this.share * (this.t.at(-1) - this.t[0]); }

  /** Go on with other samples, from their beginning. */
  span(t) {
    this.t = t;
    this.move(0);
  }

  follow(see) {
    this.seen.add(see);
    see(this);
    return () => this.seen.delete(see);
  }

  /** Go to the sample nearest to a time. */
  seek(time) {
    this.stop();
    const [start, stop] = [this.t[0], this.t.at(-1)];
    this.move(Math.max(0, Math.min(1, (time - start) / (stop - start))) || 0); // of a single sample 0/0
  }

  move(share) {
    this.share = share;
    this.scrub.value = share;
    const { time, t } = this;
    let [low, high] = [0, t.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle;
      else high = middle;
    }
    this.k = time - t[low] < t[high] - time ? low : high;
    this.values.textContent = this.textOf(this.k);
    for (const see of this.seen) see(this);
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.frame = null;
    this.button.textContent = "Play";
  }

  /** Play to the end; from the beginning if it is there already. */
  play() {
    let before = null;
    if (this.share >= 1) this.move(0);
    this.button.textContent = "Pause";
    const step = (now) => {
      const passed = before === null ? 0 : (now - before) / 1000;
      before = now;
      this.move(Math.min(1, this.share + (passed * this.speed) / SECONDS));
      if (this.share < 1) this.frame = requestAnimationFrame(step);
      else this.stop();
    };
    this.frame = requestAnimationFrame(step);
  }
}

/** Draw the multipliers beside the unit circle; those far away at the rim, with their values in words. */
export function multipliers(place, { multipliers: found, multipliers_error: error }) {
  const shown = found.map(([re, im]) => {
    const size = Math.hypot(re, im);
    const scale = size > 2 ? 2 / size : 1;
    return { x: re * scale, y: -im * scale, isFar: size > 2, text: `${number(re, 6)}${im ? ` ${im < 0 ? "−" : "+"} ${number(Math.abs(im), 6)} i` : ""}` };
  });
  const tick = (x, y, text, [dx, dy]) => [h("svg:path", { d: x ? `M${x} -0.06V0.06` : `M-0.06 ${y}H0.06`, class: "axis" }), h("svg:text", { x: x + dx, y: y + dy, class: "name large" }, text)];
  fill(place, h("svg:svg", { viewBox: "-2.3 -2.3 4.6 4.6", role: "img", "aria-label": `Multipliers ${shown.map(({ text }) => text).join(" and ")}` },
    h("svg:path", { d: "M-2.2 0H2.2M0 -2.2V2.2", class: "net" }), h("svg:circle", { r: 1, class: "unit" }),
    tick(1, 0, "1", [0.14, 0.25]), tick(-1, 0, "−1", [-0.18, 0.25]), tick(0, -1, "i", [0.14, -0.08]), tick(0, 1, "−i", [0.18, 0.22]),
    h("svg:text", { x: 2.1, y: -0.1, class: "name large" }, "Re"), h("svg:text", { x: 0.22, y: -2.05, class: "name large" }, "Im"),
    shown.map(({ x, y, text }) => h("svg:circle", { cx: x, cy: y, r: 0.08, class: "mark" }, h("svg:title", {}, text)))),
  h("p", { class: "hint" }, `${shown.map(({ text }) => text).join(",  ")}, each ± ${number(error, 2)}. ${shown.some(({ isFar }) => isFar) ? "Those beyond 2 are drawn at the distance 2. " : ""}On the unit circle small disturbances out of the plane stay small.`));
  exportable(place);
}
