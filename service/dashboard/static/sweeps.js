// Sweeps by their names and in small pictures, for lists and for the overview.
import { axisText, fill, get, h, lengthOf, sweepText } from "./core.js";
import { planeOf } from "./arrays.js";
import { endsOf, paint, scaleOf, shadesOf, SOLVED } from "./planes.js";

const [WIDTH, HEIGHT] = [192, 120];
/** Points that are read for a small picture at most; of larger sweeps a line through the middle is shown. */
const MOST_POINTS = 40_000;

const documents = new Map(); // by the id of the sweep; they never change
const pictures = new Map(); // of finished sweeps, which never change either

async function documentOf(id) {
  if (!documents.has(id)) documents.set(id, (await get(`v1/sweeps/${id}`)).document);
  return documents.get(id);
}

/** Return a path through points, which leaves out what is not finite; ``joined`` or a dot at each. */
function pathOf(points, isJoined) {
  const seen = points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
  const [left, right] = endsOf(seen.map(([x]) => x));
  const [low, high] = endsOf(seen.map(([, y]) => y));
  const place = ([x, y]) => `${(4 + (92 * (x - left)) / (right - left || 1)).toFixed(1)} ${(56 - (52 * (y - low)) / (high - low || 1)).toFixed(1)}`;
  let isDown = false;
  return points.map((point) => {
    const isThere = point.every(Number.isFinite);
    const step = !isThere ? "" : isJoined && isDown ? `L${place(point)}` : `M${place(point)}h0.01`;
    isDown = isThere;
    return step;
  }).join("");
}

/** Return a small picture of a curve, or of points. */
export const curve = (points, alt, isJoined = true) => h("svg:svg", { viewBox: "0 0 100 60", preserveAspectRatio: "none", class: `thumbnail ${isJoined ? "" : "dots"}`, role: "img", "aria-label": alt },
  h("svg:path", { d: pathOf(points, isJoined), class: "curve" }));

/** Return a small picture of the first kept number: over the two longest axes of a grid, where that is not too much, else over one. */
async function pictureOf(id, { axes, combine, keep: [of] }) {
  const longest = [...axes].sort((one, other) => lengthOf(other) - lengthOf(one));
  const isGrid = combine !== "zip";
  const isPlane = isGrid && longest.length > 1 && lengthOf(longest[0]) * lengthOf(longest[1]) <= MOST_POINTS;
  if (lengthOf(longest[0]) > MOST_POINTS) return h("span", { class: "hint" }, "Too long for a small picture.");
  const [x, y] = [longest[0].pointer, isPlane ? longest[1].pointer : ""];
  const held = isGrid ? longest.slice(isPlane ? 2 : 1) : [];
  const middles = new Map(held.map((axis) => [axis.pointer, lengthOf(axis) >> 1]));
  const plane = await planeOf(`v1/sweeps/${id}`, axes, isGrid, { of, x, y, group: null, held: held.map(({ pointer }) => pointer) }, middles);
  const alt = `${of} over ${[longest[0], ...(isPlane ? [longest[1]] : [])].map(axisText).join(" and ")}`;
  if (!isPlane) {
    const xs = isGrid ? plane.values[x] : plane.columns(x);
    const points = [...xs].map((value, k) => [longest[0].logspace ? Math.log(value) : value, plane.words[plane.codes[k]] === SOLVED ? plane.numbers[k] : NaN]);
    return curve(isGrid ? points.sort(([one], [other]) => one - other) : points, alt, isGrid);
  }
  const [across, up] = [scaleOf(plane.values[x], Boolean(longest[0].logspace)), scaleOf(plane.values[y], Boolean(longest[1].logspace))];
  const area = ({ isLog, whole }) => (isLog ? whole.map(Math.log10) : whole);
  const canvas = h("canvas", { width: WIDTH, height: HEIGHT, class: "thumbnail", role: "img", "aria-label": alt });
  const style = getComputedStyle(document.documentElement);
  const colours = { bad: style.getPropertyValue("--bad").trim(), soft: style.getPropertyValue("--soft").trim() };
  paint(canvas, { plane, scales: { x: across, y: up }, shades: shadesOf(plane, false), area: { x: area(across), y: area(up) }, colours });
  return canvas;
}

/** What comes when it is looked at, one after the other: ``seen(element, work)``. */
const works = new WeakMap();
let last = Promise.resolve();
const looking = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting) continue;
    looking.unobserve(target);
    last = last.then(works.get(target)).catch(() => {}); // what cannot be read is not shown
  }
});

/** Return a link to a sweep: its name, by its potential and its axes, and a small picture when it is finished. */
export function sweepLink(sweep) {
  const known = documents.get(sweep.id);
  const [place, name] = [h("span", { class: "sweep-picture" }), h("span", { class: "formula" }, known ? sweepText(known) : sweep.id.slice(0, 13))];
  const isFinished = ["succeeded", "cancelled"].includes(sweep.state) && sweep.done > 0;
  if (pictures.has(sweep.id)) fill(place, pictures.get(sweep.id));
  const link = h("a", { href: `./sweep?id=${sweep.id}`, class: "sweep-link" }, place, name);
  works.set(link, async () => {
    const found = await documentOf(sweep.id);
    name.textContent = sweepText(found);
    name.title = found.axes.map(axisText).join(" × ");
    if (!isFinished) return;
    // A list that is renewed meanwhile has other elements for the same sweep.
    if (!pictures.has(sweep.id)) pictures.set(sweep.id, await pictureOf(sweep.id, found));
    fill(place, pictures.get(sweep.id));
  });
  if (!known || (isFinished && !pictures.has(sweep.id))) looking.observe(link);
  return link;
}
