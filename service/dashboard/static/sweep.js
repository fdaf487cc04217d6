// One sweep: its progress, its kept numbers over one or two axes, its points.
import { $, asked, axisText, copier, download, exact, fill, get, h, lengthOf, nameOf, number, potentialText, request, run, save, say, troubleOf } from "./core.js";
import { linesOf, planeOf } from "./arrays.js";
import { draw } from "./chart.js";
import { follow } from "./follow.js";
import { cloud, countsOf, endsOf, frame, legend, lines, paint, parallel, scaleOf, shadesOf, short, shownAt, SOLVED, words } from "./planes.js";
import { askAndStart, narrowed, showPoint, showStretches } from "./starting.js";

const FORMATS = { json: "JSON", csv: "CSV", ndjson: "NDJSON", npz: "NPZ (NumPy)", arrow: "Arrow", parquet: "Parquet" };
const OVER = ["succeeded", "failed", "cancelled"];
const MOST_CELLS = 1e6;
/** Points that are read for parallel coordinates, where each is a line through all axes. */
const MOST_PARALLEL = 2e5;
/** While a sweep runs its picture is drawn anew so often at most, in milliseconds. */
const EVERY = 3000;

let sweep = null;
let shown = null;
const view = { x: null, y: null, bands: new Map() };
const path = `v1/sweeps/${encodeURIComponent(asked().get("id") ?? "none")}`;
const [form, picture, canvas] = [$("choice"), $("picture"), $("cells")];
const axes = () => sweep.document.axes;
const axisOf = (pointer) => axes().find((axis) => axis.pointer === pointer);
const isGrid = () => sweep.document.combine !== "zip";

function showProgress(found) {
  sweep = { ...sweep, ...found };
  const { state, points: all, done, refused, remaining_seconds: left, point_seconds: each } = sweep;
  const tile = (name, value, note) => h("div", {}, h("dt", {}, name), h("dd", {}, value, note ? h("span", { class: "error" }, note) : null));
  fill($("progress"), tile("State", state), tile("Done", `${done.toLocaleString("en")} of ${all.toLocaleString("en")}`, left ? `about ${number(left, 2)} s more` : null),
    tile("Without a motion", refused.toLocaleString("en")), tile("Time for a point", each ? `${number(1000 * each, 2)} ms` : "–"));
  const kinds = sweep.provenances;
  const hosts = new Set(kinds.flatMap((kind) => kind.hosts)).size;
  const unlike = kinds.length > 1 ? `, of ${kinds.length} kinds: last digits may depend on which of them computed a point, within the claimed errors` : "";
  $("computed").textContent = hosts ? `Computed on ${hosts === 1 ? "one host" : `${hosts} hosts`}${unlike}.` : "";
}

async function showRefusals() {
  if (!sweep.refused) return;
  const { facets } = await get(`${path}/points/facets?by=outcome`);
  const reasons = facets[0].values.filter(({ value }) => value !== SOLVED).map(({ value, count }) => `${count.toLocaleString("en")} × ${words(value)}`);
  $("refusals").textContent = `Why there is no motion: ${reasons.join(", ")}.`;
}

/** Offer the numbers and the axes; first the axes with the most values: that is where there is most to see. */
function choices() {
  const option = (name, value) => h("option", { value: name, selected: name === value }, short(name));
  const varied = axes().map((axis) => [lengthOf(axis), axis.pointer]).sort(([left], [right]) => right - left).map(([, pointer]) => pointer);
  fill(form.of, sweep.document.keep.map((name) => option(name, sweep.document.keep[0])));
  fill(form.x, varied.map((name) => option(name, varied[0])));
  fill(form.y, h("option", { value: "" }, "nothing else"), varied.map((name) => option(name, isGrid() ? varied[1] ?? "" : "")));
  form.as.closest("label").hidden = varied.length < 2 || sweep.points > MOST_PARALLEL;
  if (!isGrid() && varied.length > 2 && sweep.points <= MOST_PARALLEL) form.as.value = "parallel";
  form.logx.checked = Boolean(axisOf(varied[0]).logspace);
  form.logy.checked = Boolean(varied[1] && axisOf(varied[1]).logspace);
}

/** Return what shall be drawn: the number, the axes, and of the others the one that makes several lines. */
function wish() {
  const { of, x, y, log, logx, logy, as } = Object.fromEntries(new FormData(form));
  const isParallel = as === "parallel";
  for (const name of ["x", "y", "logx", "logy"]) form[name].closest("label").hidden = isParallel;
  if (isParallel) return { of, x, y: "", group: null, held: [], log: Boolean(log), isParallel };
  const second = y === x ? "" : y;
  const rest = axes().map(({ pointer }) => pointer).filter((name) => ![x, second].includes(name));
  const fits = rest.length > 0 && lengthOf(axisOf(x)) * lengthOf(axisOf(rest[0])) <= MOST_CELLS;
  const group = isGrid() && !second && fits ? rest.shift() : null;
  return { of, x, y: second, group, held: isGrid() ? rest : [], log: Boolean(log), logx: Boolean(logx), logy: Boolean(logy) };
}

/** Return the number at a place of an axis, as text; drawn ones are known by their places only. */
function valueAt(axis, place) {
  const [low, high, count] = axis.linspace ?? axis.logspace ?? [0, 0, 2];
  if (axis.values) return String(axis.values[place]);
  if (axis.uniform) return `drawn value ${place + 1}`;
  const share = count > 1 ? place / (count - 1) : 0;
  return number(axis.linspace ? exact(low) + share * (exact(high) - exact(low)) : exact(low) * (exact(high) / exact(low)) ** share, 5);
}

/** Offer a place on each axis that is neither drawn nor makes lines. */
function showHeld(held) {
  const inputs = [...$("held").querySelectorAll("input")];
  if (inputs.length === held.length && inputs.map(({ name }) => name).join() === held.join()) return; // somebody may be in one
  const known = Object.fromEntries(new FormData($("held")));
  fill($("held"), held.map((pointer) => {
    const axis = axisOf(pointer);
    const shown = h("output", { class: "value" });
    const slider = h("input", { type: "range", name: pointer, min: 0, max: lengthOf(axis) - 1, step: 1, value: known[pointer] ?? lengthOf(axis) >> 1 });
    const tell = () => {
      shown.textContent = valueAt(axis, Number(slider.value));
      slider.ariaValueText = shown.textContent;
    };
    slider.addEventListener("input", tell);
    tell();
    return h("span", { class: "row" }, h("label", {}, `at ${nameOf(pointer)} = `, slider), shown);
  }));
  $("held").hidden = held.length === 0;
}

/** Draw each point as a line through all axes; those beside the marked bands become faint. */
async function redrawParallel(plane, asks) {
  shown = { ...asks, plane, scales: null, shades: shadesOf(plane, asks.log) };
  canvas.hidden = true;
  const pointers = axes().map(({ pointer }) => pointer);
  const made = await draw(picture, (colours) => {
    const { found, ...drawing } = parallel({ ...shown, pointers, isLog: (pointer) => Boolean(axisOf(pointer)?.logspace), bands: view.bands, colours });
    shown.found = found;
    return drawing;
  });
  const { drawn, inside, of: all } = shown.found;
  tellCounts(plane);
  $("under").textContent = view.bands.size ? `${inside.toLocaleString("en")} of ${all.toLocaleString("en")} points are in the marked bands.` : "";
  if (drawn < all) $("picture-note").textContent += ` Of these every ${Math.ceil(all / drawn).toLocaleString("en")}th is drawn.`;
  $("whole").hidden = !view.bands.size;
  $("finer").hidden = true;
  fill($("marks"));
  return made;
}

function tellCounts(plane) {
  const drawn = plane.counts[plane.words.indexOf(SOLVED)] ?? 0;
  const without = plane.counts.reduce((sum, count) => sum + count, 0) - drawn;
  const waiting = plane.codes.length - drawn - without;
  $("picture-note").textContent = `${drawn.toLocaleString("en")} motions, ${without.toLocaleString("en")} points without one${waiting ? `, ${waiting.toLocaleString("en")} to come` : ""}.`;
}

async function redraw(plane = shown.plane, asks = shown) {
  const { x, y, of } = asks;
  plane.counts ??= countsOf(plane);
  if (asks.isParallel) {
    await redrawParallel(plane, asks);
    listen();
    return;
  }
  const positive = (pointer) => endsOf(plane.columns ? plane.columns(pointer) : plane.values[pointer])[0] > 0;
  const [isLogX, isLogY] = [asks.logx && positive(x), asks.logy && Boolean(y) && positive(y)];
  const scales = plane.values && y ? { x: scaleOf(plane.values[x], isLogX), y: scaleOf(plane.values[y], isLogY) } : null;
  const shades = y ? shadesOf(plane, asks.log) : null;
  shown = { ...asks, plane, scales, shades, isLogX, isLogY };
  const where = plane.columns ? plane.columns(x) : plane.values[x];
  const xs = plane.columns ? (cell) => where[cell] : (cell) => where[Math.floor(cell / plane.step(x)) % where.length];
  form.logx.disabled = !positive(x);
  form.logy.disabled = !y || !positive(y);
  canvas.hidden = !scales;
  $("under").textContent = "";
  if (!y) plane.lines ??= linesOf(plane, asks);
  const groups = y ? [] : plane.lines.map(({ value, rows }) => ({ rows, name: value === null ? "" : `${short(asks.group)} = ${number(value, 4)}` }));
  const drawing = { x, y, of, plane, scales, shades, groups, xs, isLog: asks.log, isLogX, isLogY, view };
  await draw(picture, (colours) => (scales ? frame : y ? cloud : lines)({ ...drawing, colours }));
  fill($("marks"), scales ? legend(plane, palette()) : []);
  repaint();
  listen();
  // What is painted is seen after the next frame.
  requestAnimationFrame(() => setTimeout(() => performance.mark("points-drawn")));
  tellCounts(plane);
  $("whole").hidden = !(view.x || view.y);
  stretches();
}

function palette() {
  const style = getComputedStyle(document.documentElement);
  return { bad: style.getPropertyValue("--bad").trim(), soft: style.getPropertyValue("--soft").trim() };
}

/** Paint the cells beneath the axes: exactly the pixels of the stretch that is shown. */
function repaint() {
  if (!shown?.scales) return;
  const { xaxis, yaxis } = picture._fullLayout;
  const ratio = Math.min(devicePixelRatio, 2);
  Object.assign(canvas, { width: Math.max(1, Math.round(xaxis._length * ratio)), height: Math.max(1, Math.round(yaxis._length * ratio)) });
  Object.assign(canvas.style, { left: `${xaxis._offset}px`, top: `${yaxis._offset}px`, width: `${xaxis._length}px`, height: `${yaxis._length}px` });
  paint(canvas, { ...shown, area: { x: xaxis.range, y: yaxis.range }, colours: palette() });
}

/** Return the cell under the mouse. */
function under(event) {
  const { xaxis, yaxis } = picture._fullLayout;
  const box = picture.getBoundingClientRect();
  const [left, top] = [event.clientX - box.left - xaxis._offset, event.clientY - box.top - yaxis._offset];
  if (left < 0 || top < 0 || left > xaxis._length || top > yaxis._length) return null;
  const [column, row] = [shown.scales.x.cellAt(xaxis.p2l(left)), shown.scales.y.cellAt(yaxis.p2l(top))];
  if (column < 0 || row < 0) return null;
  return { cell: column * shown.plane.steps[0] + row * shown.plane.steps[1], where: [[shown.x, shown.plane.values[shown.x][column]], [shown.y, shown.plane.values[shown.y][row]]] };
}

const failed = (error) => { fill($("failure"), troubleOf(error)); };
const open = (cell) => showPoint(path, sweep.document, shown.plane.index(cell)).catch(failed);

function listen() {
  if (picture.dataset.heard) return;
  picture.dataset.heard = "yes";
  picture.on("plotly_click", ({ points: [clicked] }) => { if (Number.isInteger(clicked.customdata)) open(clicked.customdata); });
  picture.on("plotly_afterplot", repaint);
  picture.on("plotly_selected", (event) => {
    if (!event?.range || !shown.isParallel) return;
    const [[left, right], [low, high]] = [event.range.x, event.range.y].map((ends) => [...ends].sort((one, other) => one - other));
    for (let place = Math.max(0, Math.ceil(left)); place <= Math.min(axes().length, right); place += 1) view.bands.set(place, [low, high]);
    redraw().catch(failed);
  });
  picture.on("plotly_relayout", (event) => {
    if (!Object.keys(event).some((name) => /^[xy]axis\.range/.test(name))) return;
    const ends = ({ range, type }) => [...range].sort((left, right) => left - right).map((value) => (type === "log" ? 10 ** value : value));
    for (const side of ["x", "y"]) if (Object.keys(event).some((name) => name.startsWith(`${side}axis.range`))) view[side] = ends(picture._fullLayout[`${side}axis`]);
    redraw().catch(failed);
  });
  $("frame").addEventListener("click", (event) => { const found = shown?.scales && under(event); if (found) open(found.cell); });
  $("frame").addEventListener("dblclick", () => $("whole").click());
  $("frame").addEventListener("mousemove", (event) => {
    const found = shown?.scales && under(event);
    $("under").textContent = found ? shownAt({ ...shown, ...found }) : "";
  });
}

/** Offer a finer sweep over the stretches that are shown. */
function stretches() {
  $("finer").hidden = !isGrid();
  if (!isGrid()) return;
  const ends = (pointer, side) => {
    const [low, high] = endsOf(shown.plane.values[pointer]);
    const rounded = (value) => Number(value.toPrecision(6));
    return view[side] ? [Math.max(low, rounded(view[side][0])), Math.min(high, rounded(view[side][1]))] : [low, high];
  };
  const drawn = [["x", shown.x, shown.isLogX], ...(shown.y ? [["y", shown.y, shown.isLogY]] : [])];
  showStretches(drawn.map(([side, pointer]) => ({ axis: axisOf(pointer), from: ends(pointer, side)[0], to: ends(pointer, side)[1] })), short);
}

/** Return the doubles of the axes that are held, from a point of the picture. */
async function heldNumbers() {
  if (!shown.held.length) return [];
  const { items: [row] } = await get(`${path}/points?where=${encodeURIComponent(`index=${shown.plane.index(0)}`)}&limit=1`);
  return shown.held.map((pointer) => [pointer, row[pointer]]);
}

async function start() {
  const typed = Object.fromEntries([...new FormData($("finer-form"))].map(([name, value]) => [name, Number(value)]));
  const drawn = [[shown.x, shown.isLogX], ...(shown.y ? [[shown.y, shown.isLogY]] : [])];
  const narrow = drawn.map(([pointer, isLog], n) => ({ axis: axisOf(pointer), from: typed[`from${n}`], to: typed[`to${n}`], count: typed[`count${n}`], isLog }));
  askAndStart(narrowed(sweep.document, narrow, await heldNumbers()), `a part of the sweep ${sweep.id}`);
}

async function show() {
  showProgress(await get(path));
  const { document: stated } = sweep;
  $("title").textContent = potentialText(stated.base.potential, stated.axes.map(({ pointer }) => pointer));
  $("subtitle").textContent = `${sweep.points.toLocaleString("en")} points: ${stated.axes.map(axisText).join(isGrid() ? " × " : ", together with ")}`;
  fill($("labels"), Object.entries(sweep.labels).map(([name, value]) => h("li", {}, h("a", { class: "chip", href: `./sweeps?where=${encodeURIComponent(`label.${name}="${value.replaceAll('"', '""')}"`)}` }, `${name}: ${value}`))));
  $("note").textContent = sweep.note ?? "";
  document.title = `Sweep · ${$("title").textContent} · polhode`;
  $("problem").textContent = JSON.stringify(stated, null, 2);
  const url = new URL(".", document.baseURI).href;
  fill($("copies"), copier("Copy as curl", () => `curl -s '${url}${path}/points?format=csv' -H 'Accept: text/csv'`),
    copier("Copy as Python", () => `import polhode as ph\n\nsweep = ph.connect(${JSON.stringify(url)}).stored_sweep(${JSON.stringify(sweep.id)})\nprint(sweep.values(${JSON.stringify(form.of.value)}))\n`));
  fill($("downloads"), h("ul", { class: "buttons" }, Object.entries(FORMATS).map(([format, name]) => h("li", {}, h("button", { type: "button", onclick: () => savePoints(format).catch(failed) }, name)))));
  $("body").hidden = false;
  if (!form.x.options.length) choices(); // once: when the service is back, somebody has chosen
  // The library of charts comes while the points are on their way.
  await Promise.all([draw(picture, () => ({ traces: [], layout: {} })), renew()]);
}

/** Save all points. As JSON the service answers with pages: the lines of NDJSON make the whole list. */
async function savePoints(format) {
  const name = `sweep-${sweep.id}.${format}`;
  if (format !== "json") return download(`${path}/points?format=${format}`, name);
  const lines = await (await request(`${path}/points?format=ndjson`, { headers: { Accept: "*/*" } })).text();
  return save(new Blob(["[\n", lines.trimEnd().replaceAll("\n", ",\n"), "\n]\n"], { type: "application/json" }), name);
}

let latest = 0;

/** Ask for the points and draw them; an answer that another question has overtaken is dropped. */
async function renew() {
  if (!sweep.done) return;
  latest += 1;
  const mine = latest;
  const asks = wish();
  showHeld(asks.held);
  const [plane] = await Promise.all([planeOf(path, axes(), isGrid() && !asks.isParallel, asks, new FormData($("held"))), showRefusals()]);
  if (mine === latest) await redraw(plane, asks);
}

/** While points come in the picture follows, but never takes more than a tenth of the time. */
let next = 0;
async function keepUp() {
  // Whoever drags over the picture would lose what they have marked.
  if (document.hidden || performance.now() < next || picture.matches(":active")) return;
  next = Infinity;
  const began = performance.now();
  await renew().catch(failed);
  next = performance.now() + Math.max(EVERY, 10 * (performance.now() - began));
}

form.addEventListener("change", ({ target }) => {
  if (target.name !== "log") Object.assign(view, { x: null, y: null, bands: new Map() });
  else if (!form.y.value) view.y = null;
  if (target.name === "x" || target.name === "y") for (const side of ["x", "y"]) form[`log${side}`].checked = Boolean(form[side].value && axisOf(form[side].value).logspace);
  renew().catch(failed);
});
$("held").addEventListener("change", () => renew().catch(failed));
$("whole").addEventListener("click", () => {
  Object.assign(view, { x: null, y: null, bands: new Map() });
  redraw().catch(failed);
});
$("pick").addEventListener("submit", (event) => {
  event.preventDefault();
  showPoint(path, sweep.document, Number(event.currentTarget.elements.index.value)).catch(failed);
});
$("finer-form").addEventListener("submit", (event) => {
  event.preventDefault();
  start().catch(failed);
});
await run(show, $("failure"));
if (sweep && !OVER.includes(sweep.state)) {
  await follow({
    events: `${path}/events`, path, name: "sweep", isOver: ({ state }) => OVER.includes(state),
    seen: (name, found) => { if (name === "sweep") { showProgress(found); keepUp(); } },
    lost: (isLost) => { $("pulse").textContent = isLost ? "the service does not answer; trying again" : ""; },
  });
  say(`the sweep ${sweep.state}`);
  await renew();
}
