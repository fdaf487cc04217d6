// Pictures of many points: heat maps are painted pixel by pixel, lines are thinned to what a screen can show.
import { h, nameOf, number } from "./core.js";

export const SOLVED = "solved";
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const SHADES = 256;
const NO_CELL = -1;
const MOST_LINES = 12;
const MOST_MARKS = 1500;
/** Points of a line that are drawn as they are; of longer ones the extremes of so many stretches. */
const MOST_OF_A_LINE = 4000;

export const short = nameOf;
export const words = (code) => String(code).replaceAll("_", " ");
/** plotly reads a little markup in texts: what people have named must not become it. */
const plain = (text) => String(text).replaceAll("<", "‹").replaceAll(">", "›");

/** Return the axes of a picture after plotly's fashion; ``view`` has the stretches that are shown, null for all. */
const axisOf = (name, isLog, view) => ({ title: { text: plain(short(name)) }, type: isLog ? "log" : "linear",
  ...(view ? { range: isLog ? view.map(Math.log10) : view, autorange: false } : {}) });

/** Return the sides of cells around sorted places: halfway between neighbours. */
function sides(places) {
  const gap = (k) => places[k + 1] - places[k];
  if (places.length === 1) return [places[0] - Math.max(0.5 * Math.abs(places[0]), 0.5), places[0] + Math.max(0.5 * Math.abs(places[0]), 0.5)];
  return [places[0] - gap(0) / 2, ...Array.from({ length: places.length - 1 }, (_, k) => places[k] + gap(k) / 2), places.at(-1) + gap(places.length - 2) / 2];
}

/** One axis of a heat map: values in any order, drawn linearly or by their logarithms. */
export function scaleOf(values, isLog) {
  const order = [...values.keys()].sort((left, right) => values[left] - values[right]);
  const at = isLog ? Math.log10 : (value) => value;
  const edges = sides(order.map((k) => at(values[k])));
  const cellAt = (drawn) => {
    if (!(drawn >= edges[0] && drawn <= edges.at(-1))) return NO_CELL;
    let [low, high] = [0, order.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (edges[middle] <= drawn) low = middle;
      else high = middle - 1;
    }
    return order[low];
  };
  const back = isLog ? (value) => 10 ** value : (value) => value;
  return { isLog, cellAt, whole: [back(edges[0]), back(edges.at(-1))] };
}

/** Return what the colours of a heat map stand for: the shown numbers and their smallest and largest. */
export function shadesOf({ numbers, codes, words: known }, isLog) {
  const solved = known.indexOf(SOLVED);
  const shown = new Float32Array(numbers.length);
  let [low, high] = [Infinity, -Infinity];
  for (let k = 0; k < numbers.length; k += 1) {
    const value = codes[k] === solved ? (isLog ? Math.log10(Math.abs(numbers[k])) : numbers[k]) : NaN;
    shown[k] = value;
    if (value < low && value > -Infinity) low = value;
    if (value > high && value < Infinity) high = value;
  }
  if (low > high) [low, high] = [0, 1]; // no point has a number, or none yet
  return { shown, low, high: high > low ? high : low + 1, isLog };
}

const channels = (colour) => [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
const packed = ([red, green, blue]) => ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;

function ramp() {
  const stops = VIRIDIS.map(channels);
  return Uint32Array.from({ length: SHADES }, (_, k) => {
    const place = (k / (SHADES - 1)) * (stops.length - 1);
    const first = Math.min(Math.floor(place), stops.length - 2);
    return packed(stops[first].map((from, n) => Math.round(from + (place - first) * (stops[first + 1][n] - from))));
  });
}

/** The marks of points without a number, one for each reason: stripes, which differ in direction and width as well. */
const STRIPES = [(x, y) => (x + y) % 8 < 2, (x, y) => (x - y + 80000) % 8 < 2, (x, y) => y % 6 < 2, (x, y) => x % 6 < 2, (x, y) => x % 5 < 2 && y % 5 < 2];
const stripe = (n) => STRIPES[n % STRIPES.length];

/** Paint the cells that an area shows, one pixel after the other. ``area``: {x, y} with what their ends are as drawn. */
export function paint(canvas, { plane, scales, shades, area, colours }) {
  const { width, height } = canvas;
  const image = new ImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const ladder = ramp();
  const step = (SHADES - 1) / (shades.high - shades.low);
  const solved = plane.words.indexOf(SOLVED);
  const [bad, soft] = [packed(channels(colours.bad)), packed(channels(colours.soft))];
  const columns = Int32Array.from({ length: width }, (_, k) => scales.x.cellAt(area.x[0] + ((k + 0.5) / width) * (area.x[1] - area.x[0])));
  for (let row = 0; row < height; row += 1) {
    const line = scales.y.cellAt(area.y[1] + ((row + 0.5) / height) * (area.y[0] - area.y[1]));
    if (line === NO_CELL) continue;
    for (let column = 0; column < width; column += 1) {
      if (columns[column] === NO_CELL) continue;
      const cell = columns[column] * plane.steps[0] + line * plane.steps[1];
      const code = plane.codes[cell];
      if (code < 0) continue;
      if (code !== solved) {
        if (stripe(code)(column, row)) pixels[row * width + column] = bad;
      } else if (Number.isFinite(shades.shown[cell])) {
        pixels[row * width + column] = ladder[Math.round((shades.shown[cell] - shades.low) * step)];
      } else if ((column * row) % 7 === 1) pixels[row * width + column] = soft;
    }
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

/** Return a legend of the marks: how many points of the picture have which reason, in words. */
export function legend({ words: known, counts }, colours) {
  return known.map((word, code) => [word, code]).filter(([word]) => word !== SOLVED).map(([word, code]) => {
    const swatch = h("canvas", { width: 24, height: 14, "aria-hidden": "true" });
    const image = new ImageData(24, 14);
    const pixels = new Uint32Array(image.data.buffer);
    for (let k = 0; k < pixels.length; k += 1) if (stripe(code)(k % 24, Math.floor(k / 24))) pixels[k] = packed(channels(colours.bad));
    swatch.getContext("2d").putImageData(image, 0, 0);
    return h("li", {}, swatch, ` ${words(word)}: ${counts[code].toLocaleString("en")}`);
  });
}

/** Return axes and a bar of colours for a heat map that is painted beneath them. */
export function frame({ x, y, of, shades, scales, view, colours }) {
  const title = shades.isLog ? `log₁₀ |${short(of)}|` : short(of);
  const bar = { title: { text: plain(title), side: "right" }, thickness: 12, outlinewidth: 0, tickfont: { color: colours.soft } };
  return { traces: [{ type: "scatter", mode: "markers", x: [null], y: [null], hoverinfo: "skip", showlegend: false,
    marker: { color: [shades.low], cmin: shades.low, cmax: shades.high, colorscale: VIRIDIS.map((colour, k) => [k / (VIRIDIS.length - 1), colour]), showscale: true, colorbar: bar } }],
  layout: { xaxis: { ...axisOf(x, scales.x.isLog, view.x ?? scales.x.whole), showgrid: false, zeroline: false }, yaxis: { ...axisOf(y, scales.y.isLog, view.y ?? scales.y.whole), showgrid: false, zeroline: false },
    hovermode: false, dragmode: "zoom", showlegend: false } };
}

/** Return the smallest and the largest of some numbers, of which there may be a million. */
export function endsOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (let k = 0; k < values.length; k += 1) {
    if (values[k] < low) low = values[k];
    if (values[k] > high) high = values[k];
  }
  return [low, high];
}

/** Return how many points have each outcome, in the order of the words. */
export function countsOf({ codes, words: known }) {
  const counts = new Array(known.length).fill(0);
  for (let k = 0; k < codes.length; k += 1) if (codes[k] >= 0) counts[codes[k]] += 1;
  return counts;
}

/** Return the cells, which are sorted along x, that are in a stretch. */
function within(rows, xs, [from, to]) {
  const first = (isPast) => {
    let [low, high] = [0, rows.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (isPast(xs(rows[middle]))) high = middle;
      else low = middle + 1;
    }
    return low;
  };
  return rows.subarray(first((x) => x >= from), first((x) => x > to));
}

/** Return cells of a line, of which stretches keep only their extremes and their gaps, where there are many. */
function thinned(inside, numbers) {
  if (inside.length <= MOST_OF_A_LINE) return [...inside];
  const size = Math.ceil(inside.length / (MOST_OF_A_LINE / 4));
  const kept = [];
  for (let first = 0; first < inside.length; first += size) {
    let [low, high, gap] = [-1, -1, -1];
    const end = Math.min(first + size, inside.length);
    for (let n = first; n < end; n += 1) {
      const value = numbers[inside[n]];
      if (Number.isNaN(value)) gap = n;
      else {
        if (low < 0 || value < numbers[inside[low]]) low = n;
        if (high < 0 || value > numbers[inside[high]]) high = n;
      }
    }
    kept.push(...[...new Set([low, high, gap])].filter((n) => n >= 0).sort((left, right) => left - right).map((n) => inside[n]));
  }
  return kept;
}

/** Return cells of one outcome, of very many some. */
function some(stretches, codes, code) {
  const total = stretches.reduce((sum, { length }) => sum + length, 0);
  const found = [];
  const step = Math.max(1, Math.floor(total / (20 * MOST_MARKS)));
  for (const cells of stretches) for (let n = 0; n < cells.length; n += step) if (codes[cells[n]] === code) found.push(cells[n]);
  return found.filter((_, n) => n % Math.ceil(found.length / MOST_MARKS) === 0);
}

/**
 * Return lines over one axis. ``groups``: [{name, rows}] with the cells of each line in their order along x;
 * ``xs(cell)`` is where a cell is. Points without a motion stand below, with a symbol for each reason.
 */
export function lines({ groups, xs, plane, x, of, isLog, isLogX, view, colours }) {
  const solved = plane.words.indexOf(SOLVED);
  const step = Math.max(1, Math.ceil(groups.length / MOST_LINES));
  const shown = groups.filter((_, n) => n % step === 0);
  const span = view.x ?? [-Infinity, Infinity];
  const numbers = isLog ? plane.numbers.map(Math.abs) : plane.numbers;
  const stretches = shown.map(({ rows }) => within(rows, xs, span));
  const traces = shown.map(({ name }, n) => {
    const kept = thinned(stretches[n], numbers);
    return { x: kept.map(xs), y: kept.map((k) => (plane.codes[k] === solved ? numbers[k] : null)), customdata: kept, name: plain(name || short(of)), type: "scatter",
      mode: kept.length > 400 ? "lines" : "lines+markers", marker: { size: 4 }, line: { width: 1.4, color: colours[`c${(n % 6) + 1}`] }, hovertemplate: `${plain(name)}<br>%{y:.8g} at %{x:.6g}<extra></extra>` };
  });
  plane.words.forEach((word, code) => {
    const kept = word === SOLVED ? [] : some(stretches, plane.codes, code);
    if (kept.length) {
      traces.push({ x: kept.map(xs), y: kept.map(() => code), yaxis: "y2", customdata: kept, name: plain(words(word)), mode: "markers", type: "scatter",
        marker: { symbol: ["x-thin", "cross-thin", "asterisk", "hash"][code % 4], size: 6, line: { width: 1, color: colours.bad } }, hovertemplate: `${plain(words(word))} at %{x:.6g}<extra></extra>` });
    }
  });
  return { traces, layout: { xaxis: { ...axisOf(x, isLogX, view.x), anchor: "y2" }, yaxis: { title: { text: plain(short(of)) }, type: isLog ? "log" : "linear", domain: [0.1, 1], ...(view.y ? { range: isLog ? view.y.map(Math.log10) : view.y } : {}) },
    yaxis2: { domain: [0, 0.06], visible: false, fixedrange: true, range: [-1, plane.words.length] }, hovermode: "closest", dragmode: "zoom", showlegend: traces.length > 1 } };
}

/** Return points that make no matrix, over two axes: marks with colours, of very many some. */
export function cloud({ plane, x, y, of, shades, isLogX, isLogY, view, colours }) {
  const solved = plane.words.indexOf(SOLVED);
  const step = Math.ceil(plane.codes.length / MOST_OF_A_LINE);
  const cells = [...plane.codes.keys()].filter((k) => k % step === 0);
  const [xs, ys] = [plane.columns(x), plane.columns(y)];
  const common = { type: "scatter", mode: "markers" };
  const marks = (some) => ({ ...common, x: some.map((k) => xs[k]), y: some.map((k) => ys[k]), customdata: some });
  const known = cells.filter((k) => plane.codes[k] === solved);
  const { traces: [bar], layout } = frame({ x, y, of, shades, scales: { x: { isLog: isLogX }, y: { isLog: isLogY } }, view, colours });
  const refused = cells.filter((k) => plane.codes[k] !== solved);
  return { layout: { ...layout, hovermode: "closest" }, traces: [
    { ...bar, ...marks(known), hoverinfo: "all", marker: { ...bar.marker, size: 7, color: known.map((k) => shades.shown[k]) }, text: known.map((k) => number(plane.numbers[k], 8)), hovertemplate: "%{text}<extra></extra>" },
    { ...marks(refused), marker: { symbol: "x-thin", size: 6, line: { width: 1, color: colours.bad } }, text: refused.map((k) => plain(words(plane.words[plane.codes[k]]))), hovertemplate: "%{text}<extra></extra>", showlegend: false },
  ] };
}

/** Return what is known of a cell, in a line. */
export function shownAt({ plane, cell, of, where }) {
  const code = plane.codes[cell];
  const what = code < 0 ? "not computed yet" : plane.words[code] === SOLVED ? `${short(of)} = ${number(plane.numbers[cell], 10)}` : words(plane.words[code]);
  return `${where.map(([name, value]) => `${short(name)} = ${number(value, 6)}`).join(", ")}: ${what}`;
}

/**
 * Return points as lines through upright axes, one for each pointer and one for the kept number, in its colours.
 *
 * ``bands`` has by the place of an axis the stretch, from 0 to 1, that somebody has marked: lines beside it become faint.
 * (plotly's own kind of this picture compiles programs while it runs, which the policy of the page forbids.)
 */
export function parallel({ plane, pointers, of, shades, isLog, bands, colours }) {
  const names = [...pointers, of];
  const sides = names.map((name, place) => {
    const isRaised = place < pointers.length && isLog(name);
    const values = place < pointers.length ? plane.columns(name) : shades.shown;
    return { values, at: isRaised ? Math.log : (value) => value };
  });
  const cells = [...plane.codes.keys()].filter((cell) => sides.every(({ values, at }) => Number.isFinite(at(values[cell]))) && plane.words[plane.codes[cell]] === SOLVED);
  const scaled = sides.map(({ values, at }) => {
    const [low, high] = endsOf(cells.map((cell) => values[cell]));
    const width = at(high) - at(low);
    return { low, high, at: (cell) => (width ? (at(values[cell]) - at(low)) / width : 0.5) };
  });
  const isInside = (cell) => [...bands].every(([place, [low, high]]) => scaled[place].at(cell) >= low && scaled[place].at(cell) <= high);
  const inside = cells.filter(isInside);
  const step = Math.max(1, Math.ceil(cells.length / MOST_MARKS));
  const drawn = cells.filter((_, n) => n % step === 0);
  const chosen = new Set(inside);
  const shadeOf = (cell) => Math.min(VIRIDIS.length - 1, Math.floor(VIRIDIS.length * scaled.at(-1).at(cell)));
  const trace = (some, line) => ({ type: "scatter", mode: "lines", hoverinfo: "none", showlegend: false, line: { width: 1, ...line },
    x: some.flatMap(() => [...names.keys(), null]), y: some.flatMap((cell) => [...scaled.map(({ at }) => at(cell)), null]), customdata: some.flatMap((cell) => [...names.map(() => cell), null]) });
  const traces = [trace(drawn.filter((cell) => !chosen.has(cell)), { color: colours.line }),
    ...VIRIDIS.map((color, shade) => trace(drawn.filter((cell) => chosen.has(cell) && shadeOf(cell) === shade), { color }))];
  const end = (place, y, value) => ({ x: place, y, text: number(value, 4), showarrow: false, yanchor: y ? "bottom" : "top", font: { size: 11, color: colours.soft } });
  return { traces, found: { drawn: drawn.length, inside: inside.length, of: cells.length }, layout: {
    xaxis: { tickvals: [...names.keys()], ticktext: names.map((name, place) => plain(place === pointers.length && shades.isLog ? `log₁₀ |${short(name)}|` : short(name))), range: [-0.25, names.length - 0.75], fixedrange: true, showgrid: false, zeroline: false, showline: false, side: "top" },
    yaxis: { visible: false, range: [-0.08, 1.08], fixedrange: true }, annotations: scaled.flatMap(({ low, high }, place) => [end(place, 0, low), end(place, 1, high)]),
    shapes: [...names.keys()].map((place) => ({ type: "line", x0: place, x1: place, y0: 0, y1: 1, line: { color: colours.ink, width: 1 } }))
      .concat([...bands].map(([place, [low, high]]) => ({ type: "rect", x0: place - 0.03, x1: place + 0.03, y0: Math.max(0, low), y1: Math.min(1, high), line: { width: 0 }, fillcolor: colours.c2, opacity: 0.5 }))),
    selections: [], hovermode: "closest", dragmode: "select", showlegend: false, margin: { l: 30, r: 30, t: 44, b: 20 } } };
}
