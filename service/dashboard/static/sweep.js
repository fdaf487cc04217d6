// One sweep: its progress, its kept numbers over one or two axes, its points.
import { $, asked, fill, get, h, number, potentialText, request, run, say, troubleOf } from "./core.js";
import { arraysOf } from "./arrays.js";
import { draw } from "./chart.js";
import { follow } from "./follow.js";

const FORMATS = { json: "JSON", csv: "CSV", ndjson: "NDJSON", npz: "NPZ (NumPy)", arrow: "Arrow", parquet: "Parquet" };
const OVER = ["succeeded", "failed", "cancelled"];
const SOLVED = "solved";
const HIDDEN = ["index", "outcome"];
const MOST_LINES = 12;

let sweep = null;
let points = null;
const path = `v1/sweeps/${encodeURIComponent(asked().get("id") ?? "none")}`;
const form = $("choice");
const axes = () => sweep.document.axes.map((axis) => axis.pointer.slice(1));
const short = (name) => name.split("/").at(-1);

function showProgress(found) {
  sweep = { ...sweep, ...found };
  const { state, points: all, done, refused, remaining_seconds: left, point_seconds: each } = sweep;
  const tile = (name, value, note) => h("div", {}, h("dt", {}, name), h("dd", {}, value, note ? h("span", { class: "error" }, note) : null));
  fill($("progress"), tile("State", state), tile("Done", `${done.toLocaleString("en")} of ${all.toLocaleString("en")}`, left ? `about ${number(left, 2)} s more` : null),
    tile("Without a motion", refused.toLocaleString("en")), tile("Time for a point", each ? `${number(1000 * each, 2)} ms` : "–"));
}

async function showRefusals() {
  if (!sweep.refused) return;
  const { facets } = await get(`${path}/points/facets?by=outcome`);
  const reasons = facets[0].values.filter(({ value }) => value !== SOLVED).map(({ value, count }) => `${count.toLocaleString("en")} × ${String(value).replaceAll("_", " ")}`);
  $("refusals").textContent = `Why there is no motion: ${reasons.join(", ")}.`;
}

/** Ask for all points as packed numbers. */
async function load() {
  if (!sweep.done) return;
  const answer = await request(`${path}/points?format=npz`, { headers: { Accept: "application/x-npz" } });
  points = arraysOf(await answer.arrayBuffer());
}

function choices() {
  const kept = Object.keys(points).filter((name) => !HIDDEN.includes(name) && !axes().includes(name) && points[name] instanceof Float64Array);
  const chosen = Object.fromEntries(new FormData(form));
  const options = (names, value) => names.map((name) => h("option", { value: name, selected: name === value }, short(name)));
  // First what has the most values: that is where there is most to see.
  const varied = axes().map((name) => [new Set(points[name]).size, name]).sort(([left], [right]) => right - left).map(([, name]) => name);
  fill(form.of, options(kept, chosen.of ?? kept[0]));
  fill(form.x, options(varied, chosen.x || varied[0]));
  fill(form.y, h("option", { value: "" }, "nothing else"), options(varied, chosen.y ?? varied[1] ?? ""));
}

async function picture() {
  const { of, x, y, log } = Object.fromEntries(new FormData(form));
  const other = y === x ? "" : y;
  await draw($("picture"), (colours) => (other ? heat(of, x, other, log, colours) : lines(of, x, log, colours)));
  if (!$("picture").dataset.opens) {
    $("picture").dataset.opens = "yes";
    $("picture").on("plotly_click", ({ points: [clicked] }) => open(clicked.customdata));
  }
  const drawn = points.outcome.filter((outcome) => outcome === SOLVED).length;
  $("picture-note").textContent = `${drawn.toLocaleString("en")} motions, ${(points.outcome.length - drawn).toLocaleString("en")} points without one.`;
}

/** Lines over one axis, one for each of the first values of the others; points without a motion at the foot. */
function lines(of, x, log, colours) {
  const rest = axes().filter((name) => name !== x);
  const groups = new Map();
  const refused = [];
  const label = (k) => rest.map((name) => `${short(name)} = ${number(points[name][k], 4)}`).join(", ");
  const key = (k) => rest.map((name) => points[name][k]).join(" ");
  points.index.forEach((index, k) => {
    if (points.outcome[k] !== SOLVED) refused.push(k);
    else if (groups.has(key(k))) groups.get(key(k)).push(k);
    else groups.set(key(k), [k]);
  });
  const step = Math.max(1, Math.ceil(groups.size / MOST_LINES));
  const traces = [...groups.values()].filter((_, n) => n % step === 0).map((rows, n) => {
    const sorted = rows.sort((left, right) => points[x][left] - points[x][right]);
    const isLong = sorted.length > 400;
    return { x: sorted.map((k) => points[x][k]), y: sorted.map((k) => points[of][k]), customdata: sorted, name: label(sorted[0]) || short(of), type: "scatter",
      mode: isLong ? "lines" : "lines+markers", marker: { size: 4 }, line: { width: 1.4, color: colours[`c${(n % 6) + 1}`] }, hovertemplate: `%{y:.8g} at %{x:.6g}<extra>${plain(label(sorted[0]))}</extra>` };
  });
  if (refused.length) {
    traces.push({ x: refused.map((k) => points[x][k]), y: refused.map(() => 0), yaxis: "y2", customdata: refused, name: "no motion", mode: "markers", type: "scatter",
      marker: { symbol: "x-thin", size: 6, line: { width: 1, color: colours.bad } }, text: refused.map((k) => plain(points.outcome[k])), hovertemplate: "%{text} at %{x:.6g}<extra></extra>" });
  }
  return { traces, layout: { xaxis: { title: { text: plain(short(x)) }, anchor: "y2" }, yaxis: { title: { text: plain(short(of)) }, type: log ? "log" : "linear", domain: [0.08, 1] },
    yaxis2: { domain: [0, 0.04], visible: false, fixedrange: true }, hovermode: "closest", dragmode: "zoom", showlegend: traces.length > 1 } };
}

/** A heat map over two axes; where there are further ones, at the first values of these. */
function heat(of, x, y, log, colours) {
  const rest = axes().filter((name) => ![x, y].includes(name));
  const first = rest.map((name) => points[name][0]);
  const rows = [...points.index.keys()].filter((k) => rest.every((name, n) => points[name][k] === first[n]));
  const values = (name) => [...new Set(rows.map((k) => points[name][k]))].sort((left, right) => left - right);
  const [xs, ys] = [values(x), values(y)];
  const place = { x: new Map(xs.map((value, n) => [value, n])), y: new Map(ys.map((value, n) => [value, n])) };
  const [z, data] = [0, 1].map(() => ys.map(() => new Array(xs.length).fill(null)));
  const refused = [];
  for (const k of rows) {
    const [column, line] = [place.x.get(points[x][k]), place.y.get(points[y][k])];
    data[line][column] = k;
    if (points.outcome[k] !== SOLVED) refused.push(k);
    else z[line][column] = log ? Math.log10(Math.abs(points[of][k])) : points[of][k];
  }
  const title = log ? `log₁₀ ${short(of)}` : short(of);
  const traces = [{ type: "heatmap", x: xs, y: ys, z, customdata: data, colorscale: "Viridis", colorbar: { title: { text: plain(title), side: "right" }, thickness: 12, outlinewidth: 0, tickfont: { color: colours.soft } },
    hovertemplate: `${plain(short(x))} %{x:.6g}, ${plain(short(y))} %{y:.6g}: %{z:.8g}<extra></extra>` }];
  if (refused.length) {
    traces.push({ type: "scatter", mode: "markers", x: refused.map((k) => points[x][k]), y: refused.map((k) => points[y][k]), customdata: refused, showlegend: false,
      marker: { symbol: "x", size: 4, color: colours.bad }, text: refused.map((k) => plain(points.outcome[k])), hovertemplate: "%{text}<extra></extra>" });
  }
  const spread = (name) => (sweep.document.axes.find(({ pointer }) => pointer === `/${name}`).logspace ? "log" : "linear");
  return { traces, layout: { xaxis: { title: { text: plain(short(x)) }, type: spread(x) }, yaxis: { title: { text: plain(short(y)) }, type: spread(y) }, hovermode: "closest", dragmode: "zoom",
    ...(rest.length ? { annotations: [{ text: plain(rest.map((name, n) => `${short(name)} = ${number(first[n], 4)}`).join(", ")), xref: "paper", yref: "paper", x: 0, y: 1.06, showarrow: false, font: { color: colours.soft } }] } : {}) } };
}

/** plotly reads a little markup in texts: what people have named must not become it. */
const plain = (text) => String(text).replaceAll("<", "‹").replaceAll(">", "›");

/** Open a point as a problem: the base with the values of its axes. */
function open(k) {
  if (k === null || k === undefined) return;
  const problem = structuredClone(sweep.document.base);
  for (const name of axes()) {
    const parts = name.split("/");
    const last = parts.pop();
    let place = problem;
    for (const part of parts) place = place[part];
    place[last] = points[name][k];
  }
  location.href = `./workbench#${encodeURIComponent(JSON.stringify(problem))}`;
}

async function show() {
  showProgress(await get(path));
  const { document: stated } = sweep;
  $("title").textContent = potentialText(stated.base.potential);
  $("subtitle").textContent = `${sweep.points.toLocaleString("en")} points over ${stated.axes.map(({ pointer }) => pointer).join(" and ")}, ${stated.combine ?? "grid"}`;
  document.title = `Sweep · ${$("title").textContent} · polhode`;
  $("problem").textContent = JSON.stringify(stated, null, 2);
  fill($("downloads"), h("ul", { class: "buttons" }, Object.entries(FORMATS).map(([format, name]) => h("li", {}, h("button", { type: "button", onclick: () => download(format) }, name)))));
  $("body").hidden = false;
  await renew();
}

async function download(format) {
  const content = await (await request(`${path}/points?format=${format}`, { headers: { Accept: "*/*" } })).blob();
  const link = h("a", { href: URL.createObjectURL(content), download: `sweep-${sweep.id}.${format}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function renew() {
  await Promise.all([load(), showRefusals()]);
  if (!points) return;
  choices();
  await picture();
}

form.addEventListener("change", () => picture().catch((error) => fill($("failure"), troubleOf(error))));
await run(show, $("failure"));
if (sweep && !OVER.includes(sweep.state)) {
  await follow({
    events: `${path}/events`, path, name: "sweep", isOver: ({ state }) => OVER.includes(state),
    seen: (name, found) => { if (name === "sweep") showProgress(found); },
    lost: (isLost) => { $("pulse").textContent = isLost ? "the service does not answer; asking again" : ""; },
  });
  say(`the sweep ${sweep.state}`);
  await renew();
}
