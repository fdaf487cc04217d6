// The six variables over time: any stretch of it, computed by the service when one zooms.
import { $, exact, number, remember, request, say, troubleOf } from "./core.js";
import { arraysOf } from "./arrays.js";
import { draw, pointed } from "./chart.js";

export const NAMES = ["p", "q", "r", "g1", "g2", "g3"];
export const SHOWN = { p: "p", q: "q", r: "r", g1: "γ₁", g2: "γ₂", g3: "γ₃" };
const FEW_POINTS = 400;
const MOST_POINTS = 6000;
const POINTS_OF_A_PERIOD = 150;
const MOST_PERIODS = 150; // 8 pixels each on a wide screen: more would be a filled area
const MOST_OFF = 0.01; // of a variable's range, two pixels: lines that may be further off are not drawn
const LEAST = 1e-17; // where what is exactly zero is drawn, since it has no logarithm
const PANEL = 0.46;
const MARGIN = { l: 58, r: 14, t: 34, b: 44 };

/** Return the names of those of the six variables that a solution has. */
export const namesOf = ({ problem: { outputs } }) =>
  NAMES.filter((name, k) => !outputs || outputs.includes(k < 3 ? "omega" : "gamma"));

/** Ask for packed samples: {columns, error, off}; lines between those of a preview are off by that share of a range. */
export async function samplesOf(id, query, names, signal) {
  const asked = [...query, `columns=${["t", ...names].join(",")}`].join("&");
  const answer = await request(`v1/solutions/${encodeURIComponent(id)}/trajectory?${asked}`, { headers: { Accept: "application/x-npz" }, signal });
  return { columns: arraysOf(await answer.arrayBuffer()), error: Number(answer.headers.get("Polhode-Error")),
    off: Number(answer.headers.get("Polhode-Deviation") ?? 0) };
}

export const between = (start, stop, ...rest) => [`start=${encodeURIComponent(start)}`, `stop=${encodeURIComponent(stop)}`, ...rest];

/**
 * Return a stretch as it can be drawn without a lie: {kind, columns, error, off, turn, ranges, periods}.
 *
 * ``lines`` are proved to be near the curve; ``dots`` are values that lines must not join; of a ``band`` are too many
 * periods, so ``turn`` has one of them and ``ranges`` what each variable goes through. ``place`` is null for the stored times.
 */
async function stretchOf(solution, place, signal) {
  const names = namesOf(solution);
  const period = solution.period?.value;
  const ask = (...query) => samplesOf(solution.id, query.flat(), names, signal);
  let found = place === null ? await ask(`preview=${FEW_POINTS}`) : null;
  const [start, stop] = place ?? [found.columns.t[0], found.columns.t.at(-1)];
  const periods = period ? (exact(stop) - exact(start)) / period : null;
  if (!(periods > MOST_PERIODS)) { // also where a time cannot be read, which the service explains
    const wanted = Math.min(MOST_POINTS, Math.ceil(Math.max(FEW_POINTS, POINTS_OF_A_PERIOD * (periods || 1))));
    if (!found || found.off > MOST_OFF) found = await ask(between(start, stop, `preview=${wanted}`));
    if (found.off > MOST_OFF && wanted < MOST_POINTS) found = await ask(between(start, stop, `preview=${MOST_POINTS}`));
    if (found.off <= MOST_OFF) return { ...found, kind: "lines", turn: periods > 1 ? firstOf(found, period) : found, periods };
    if (!period) return { ...found, kind: "dots", turn: found, periods };
  }
  const [turn, spread] = await Promise.all([
    ask(between(start, exact(start) + period, `preview=${FEW_POINTS}`)), ask(between(start, stop, `samples=${2 * FEW_POINTS}`))]);
  const ranges = Object.fromEntries(names.map((name) => {
    const [low, high] = [Math.min(...turn.columns[name]), Math.max(...turn.columns[name])];
    return [name, [low - turn.off * (high - low), high + turn.off * (high - low)]];
  }));
  return { ...spread, kind: "band", turn, ranges, periods };
}

/** Return the part of a stretch until it repeats itself. */
function firstOf({ columns, ...rest }, period) {
  const count = columns.t.findIndex((t) => t >= columns.t[0] + period) + 1 || columns.t.length;
  return { ...rest, columns: Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, values.subarray(0, count)])) };
}

const PARTS = ["series", "gamma", "omega", "turning", "phase", "drift"];
/** Make what shows the last stretch grey until it shows the one that is asked for. */
export const stale = (isStale, ...names) => { for (const name of names.length ? names : PARTS) $(name).setAttribute("aria-busy", isStale); };

const NOTES = {
  lines: ({ columns: { t }, off }) => `${t.length} points, the lines between them are off by at most ${number(off, 1)} of the range of a variable`,
  dots: ({ columns: { t } }) => `${t.length} values; the motion oscillates too fast between them to be drawn as lines. Zoom in to see it`,
  band: ({ periods }) => `${number(periods, 4)} periods, too many to be drawn: the filled area is the range of each variable. Zoom in, or show one period`,
};

/** Draw a solution over time and keep it drawn; call ``seen(stretch)`` with each stretch. */
export async function overTime(solution, stretch, seen) {
  const form = $("stretch");
  let shown = null;
  let asking = null;
  let heights = {}; // what is shown of the two vertical axes, once somebody has zoomed into them
  let typed = false; // since the last stretch was asked for: what somebody types is not overwritten by a late answer
  const fields = [form.start, form.stop];

  /** Tell the stretch in the fields, except while somebody is in one: what they have marked to type over it would be marked no more. */
  function tellStretch() {
    if (typed || !shown || fields.includes(document.activeElement)) return;
    [form.start.value, form.stop.value] = [shown.columns.t[0], shown.columns.t.at(-1)];
  }

  async function show(place) {
    typed = false;
    asking?.abort();
    asking = new AbortController();
    const { signal } = asking;
    stale(true);
    try {
      shown = await stretchOf(solution, place, signal);
    } catch (error) {
      if (signal.aborted) return;
      stale(false);
      $("series-note").replaceChildren(troubleOf(error));
      return;
    }
    const { t } = shown.columns;
    tellStretch();
    remember({ start: place && place[0], stop: place && place[1] });
    await drawLines();
    stale(false, "series");
    const text = `From ${number(t[0], 10)} to ${number(t.at(-1), 10)}: ${NOTES[shown.kind](shown)}; their claimed error is at most ${number(shown.error, 2)}.`;
    $("series-note").textContent = text;
    say(text);
    seen(shown);
  }

  const whole = (place) => { heights = {}; return show(place); };
  const drawLines = () => draw($("series"), (colours) => ({ traces: tracesOf(shown, heights, colours), layout: {
    xaxis: { title: { text: "t" }, anchor: "y2", range: [shown.columns.t[0], shown.columns.t.at(-1)], exponentformat: "power" },
    yaxis: { domain: [1 - PANEL, 1], title: { text: "ω" }, ...heights.yaxis }, yaxis2: { domain: [0, PANEL], title: { text: "γ" }, ...heights.yaxis2 },
    dragmode: "zoom", hovermode: "closest", legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: MARGIN,
  } }));

  form.addEventListener("input", () => (typed = true));
  form.addEventListener("focusout", tellStretch);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    whole([form.start.value, form.stop.value]);
  });
  $("stored").addEventListener("click", () => whole(null));
  if (solution.period) {
    $("period").hidden = false;
    $("period").addEventListener("click", () => whole([shown.columns.t[0], shown.columns.t[0] + solution.period.value]));
  }
  await show(stretch);
  $("series").on?.("plotly_relayout", (change) => {
    for (const axis of ["yaxis", "yaxis2"]) {
      if (change[`${axis}.range[0]`] !== undefined) heights[axis] = { range: [change[`${axis}.range[0]`], change[`${axis}.range[1]`]] };
    }
    const [start, stop] = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    // The times before 0 are no part of a solution.
    if (start !== undefined && stop > start) show([Math.max(0, start), stop]);
    else if (change["yaxis.range[0]"] !== undefined || change["yaxis2.range[0]"] !== undefined) drawLines();
  });
}

/** Return the lines, dots or bands of the six variables, with their errors where these are wider than a pixel. */
function tracesOf({ kind, columns, error, ranges }, heights, colours) {
  const isWide = [[0, 3, "yaxis"], [3, 6, "yaxis2"]].map(([from, to, axis]) => {
    const values = NAMES.slice(from, to).filter((name) => columns[name]).flatMap((name) => [Math.min(...columns[name]), Math.max(...columns[name])]);
    const [low, high] = heights[axis]?.range ?? [Math.min(...values), Math.max(...values)];
    return 2 * error * PANEL * ($("series").clientHeight - MARGIN.t - MARGIN.b) > high - low;
  });
  return NAMES.filter((name) => columns[name]).flatMap((name) => {
    const k = NAMES.indexOf(name);
    const colour = colours[`c${(k % 3) + 1}`];
    const common = { name: SHOWN[name], yaxis: k < 3 ? "y" : "y2", legendgroup: name, mode: "lines" };
    const area = (x, low, high, style) => [{ ...common, x, y: low, line: { width: 0 }, showlegend: false, hoverinfo: "skip" },
      { ...common, x, y: high, line: { width: 0 }, fill: "tonexty", fillcolor: `${colour}40`, ...style }];
    if (kind === "band") {
      const [low, high] = ranges[name].map((end, side) => end + (side ? error : -error));
      return area([columns.t[0], columns.t.at(-1)], [low, low], [high, high],
        { line: { width: 1, color: colour }, hovertemplate: `${SHOWN[name]} from ${number(low, 8)} to ${number(high, 8)}<extra></extra>` });
    }
    const own = { x: columns.t, y: columns[name], hovertemplate: `${SHOWN[name]} = %{y:.10g}<br>t = %{x:.10g}<extra></extra>` };
    const curve = kind === "dots" ? { ...common, ...own, mode: "markers", marker: { size: 2.5, color: colour } } : { ...common, ...own, line: { color: colour, width: 1.6, simplify: false } };
    const bounds = isWide[k < 3 ? 0 : 1] ? area(columns.t, columns[name].map((y) => y - error), columns[name].map((y) => y + error), { showlegend: false, hoverinfo: "skip" }) : [];
    return [...bounds, curve];
  });
}

/** Return sizes as they are drawn on a logarithmic axis; the label of one that is exactly zero says so. */
export const logarithmic = (sizes, texts = null) => ({ y: sizes.map((size) => Math.max(LEAST, size)),
  text: Array.from(sizes, (size, k) => `${size === 0 ? "exactly 0" : number(size, 3)}${texts ? `, in ${texts[k]}` : ""}`), hovertemplate: "%{text}<br>t = %{x:.8g}<extra>%{fullData.name}</extra>" });

/** Draw how far the integrals that need no potential depart from their first values. */
export async function drifts(body, { columns, error }, clock) {
  const { t, p, q, r, g1, g2, g3 } = columns;
  if (!p || !g1 || body.A === null || body.C === null) return;
  const [A, B, C] = [exact(body.A), body.B == null ? null : exact(body.B), exact(body.C)];
  const at = (k) => A * p[k] * g1[k] + (B === null ? 0 : B * q[k] * g2[k]) + C * r[k] * g3[k];
  const areas = t.map((_, k) => Math.abs(at(k) - at(0)));
  const length = t.map((_, k) => Math.abs(g1[k] ** 2 + g2[k] ** 2 + g3[k] ** 2 - 1));
  await draw($("drift"), (colours) => ({
    traces: [
      { x: t, ...logarithmic(length), name: "|γ|² − 1", mode: "markers", marker: { size: 3.5, color: colours.c1 } },
      { x: t, ...logarithmic(areas), name: "I·ω·γ, change", mode: "markers", marker: { size: 3.5, color: colours.c2 } },
      { x: [t[0], t.at(-1)], y: [error, error], name: "claimed error", mode: "lines", line: { color: colours.soft, dash: "dash", width: 1.5 } },
    ],
    layout: { xaxis: { title: { text: "t" } }, yaxis: { type: "log", exponentformat: "power", dtick: 1 } },
  }));
  pointed($("drift"), clock);
}

/** Draw the phase plane of the reduced motion: γ₂ and its derivative, which the equations of Poisson give. */
export async function phasePlane({ columns }, clock, samples) {
  const { p, r, g1, g2, g3 } = columns;
  await draw($("phase"), (colours) => ({
    traces: [{ x: g2, y: g2.map((_, k) => g3[k] * p[k] - g1[k] * r[k]), mode: "lines", line: { color: colours.c1, width: 1.8, simplify: false }, hovertemplate: "γ₂ = %{x:.8g}<br>dγ₂/dt = %{y:.8g}<extra></extra>" }],
    layout: { xaxis: { title: { text: "γ₂" } }, yaxis: { title: { text: "dγ₂/dt" } }, hovermode: "closest", dragmode: false },
  }));
  pointed($("phase"), clock, (k) => [samples.g2[k], samples.g3[k] * samples.p[k] - samples.g1[k] * samples.r[k]]);
}
