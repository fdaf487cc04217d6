// Every planar motion over λ: windows as bands in γ₁, and the λ where they change.
import { $, ENDS, fill, h, number } from "./core.js";
import { draw } from "./chart.js";

// What a line is must be seen without colours, too: each kind of end has its mark, each kind of change its dashes.
const CHANGES = {
  window_appears: ["equilibrium", "a window appears"], window_vanishes: ["equilibrium", "a window vanishes"],
  windows_merge: ["separatrix", "two windows meet"], window_splits: ["separatrix", "a window splits"],
  end_crosses_equator: ["end crosses the equator"], end_at_pole: ["end comes to a pole"], several: ["several changes"],
};
const DASHES = { separatrix: "dash", equilibrium: "dot", "end crosses the equator": "dashdot", "end comes to a pole": "longdashdot", "several changes": "solid" };
const SYMBOLS = { rest: "circle", equator: "triangle-up", pole: "x", equilibrium: "diamond", standstill: "hexagon", edge: "square", collision: "star" };
const KINDS = {
  collision: ["/", "collision: reaches a singularity"], pole: ["\\", "tends to the pole for ever"],
  separatrix: ["x", "separatrix: tends to an equilibrium"], equilibrium: ["x", "an equilibrium"], standstill: ["+", "comes to a standstill"], edge: ["-", "reaches the edge of the domain"],
};
const MARKS = 12; // on a line that goes through the whole picture
const NAMED = 0.03; // of the width: closer together, names would lie over each other

const motion = ({ window, ends, kind, has_mirror_image: isDouble }) =>
  [`window ${window}, ${[...new Set(ends)].map((end) => ENDS[end]).join(", ")}`, KINDS[kind]?.[1], isDouble ? "with a mirror image" : null].filter(Boolean).join(", ");

/** Write what is drawn as a list, in the order of λ. */
function inWords({ parts, changes, undecided }) {
  const stretch = ([low, high]) => `λ from ${number(low, 6)} to ${number(high, 6)}: `;
  const lines = [
    ...parts.map(({ lambda, samples, reason }) => [lambda[0], stretch(lambda), samples ? samples.windows.map(motion).join("; ") || "no motion" : reason.detail]),
    ...undecided.map((lambda) => [lambda[0], stretch(lambda), "nothing is proved"]),
    ...changes.map(({ lambda: { value, error }, kind }) => [value, h("strong", {}, "λ = ", h("span", { class: "value" }, number(value, 10)), ` ± ${number(error, 1)}: ${CHANGES[kind][0]}`),
      CHANGES[kind][1] ? `, ${CHANGES[kind][1]}` : ""]),
  ];
  return lines.sort(([left], [right]) => left - right).map(([, ...line]) => h("li", {}, line));
}

/** Return the places of samples that are about ``gap`` apart; at least one. */
function spread(lambda, gap) {
  let last = lambda[0] - gap / 2;
  const kept = [...lambda.keys()].filter((k) => lambda[k] - last >= gap && ((last = lambda[k]) || true));
  return kept.length ? kept : [lambda.length >> 1];
}

/** Return the band of a window: its two ends, and the marks of what they are. */
function band(one, { lambda, energy }, gap, colours) {
  const colour = colours[`c${(one.window % 6) + 1}`];
  const text = energy.map((h0, k) => `${motion(one)}<br>energy ${h0 === null ? "without a bound" : h0.toPrecision(6)}`
    + `<br>γ₁ from ${one.g1[0][k]?.toPrecision(5)} to ${one.g1[1][k]?.toPrecision(5)}`);
  const [shape] = KINDS[one.kind] ?? [];
  const line = { x: lambda, mode: "lines", line: { color: colour, width: 1.2 }, showlegend: false, text, hovertemplate: "λ = %{x:.6g}<br>%{text}<extra></extra>" };
  const filled = shape ? { fillpattern: { shape, fgcolor: colour, bgcolor: `${colour}18`, size: 9, solidity: 0.16 } } : { fillcolor: `${colour}38` };
  const kept = spread(lambda, gap);
  const marks = one.ends.map((end, side) => ({ x: kept.map((k) => lambda[k]), y: kept.map((k) => one.g1[side][k]), mode: "markers", showlegend: false, hoverinfo: "skip", cliponaxis: false,
    end, marker: { symbol: SYMBOLS[end], size: 8, color: colours.paper, line: { color: colour, width: 1.6 } } }));
  return [{ ...line, y: one.g1[0] }, { ...line, y: one.g1[1], fill: "tonexty", ...filled }, ...marks];
}

/** Return what the legend names: each mark, each hatching and each kind of line that is drawn, once. */
function legend(windows, changes, colours) {
  const nowhere = { x: [null], y: [null], hoverinfo: "skip", showlegend: true };
  const ends = new Set(windows.flatMap(({ ends: both }) => both));
  const kinds = new Set(windows.map(({ kind }) => kind));
  return [
    ...Object.entries(ENDS).filter(([end]) => ends.has(end)).map(([end, name]) =>
      ({ ...nowhere, name, mode: "markers", marker: { symbol: SYMBOLS[end], size: 8, color: colours.paper, line: { color: colours.ink, width: 1.6 } } })),
    ...Object.entries(KINDS).filter(([kind]) => kinds.has(kind)).map(([, [shape, name]]) =>
      ({ ...nowhere, name, type: "bar", marker: { color: colours.paper, line: { color: colours.ink, width: 1 }, pattern: { shape, fgcolor: colours.ink, size: 5, solidity: 0.3 } } })),
    ...Object.entries(DASHES).filter(([name]) => changes.some(({ kind }) => CHANGES[kind][0] === name)).map(([name, dash]) =>
      ({ ...nowhere, name, mode: "lines", line: { color: colours.bad, width: 1.6, dash } })),
  ];
}

/** Return the names of changes, each beside its line; of some that are close together the first. */
function named(changes, [low, high], colours) {
  let last = -Infinity;
  return changes.filter(({ lambda: { value } }) => (value - last) / (high - low) > NAMED && ((last = value) || true)).map(({ lambda: { value }, kind }) => ({
    x: value, yref: "paper", y: 1, text: CHANGES[kind][0], textangle: -90, xanchor: "right", yanchor: "top", showarrow: false, font: { size: 11, color: colours.bad } }));
}

/** Draw an atlas; ``pick(lambda, window)`` is called with the motion that was clicked. */
export async function showAtlas(atlas, chosen, pick) {
  const place = $("atlas");
  fill($("changes"), inWords(atlas));
  const gap = (atlas.lambda[1] - atlas.lambda[0]) / MARKS;
  const followed = atlas.parts.map(({ samples }) => samples).filter(Boolean);
  await draw(place, (colours) => {
    const upright = (x, line) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1, line });
    return { traces: [
      ...followed.flatMap((samples) => samples.windows.flatMap((one) => band(one, samples, gap, colours))),
      ...legend(followed.flatMap(({ windows }) => windows), atlas.changes, colours),
    ], layout: {
      xaxis: { title: { text: "λ" }, range: atlas.lambda }, yaxis: { title: { text: "γ₁" }, rangemode: "tozero" }, hovermode: "closest", dragmode: false, showlegend: true,
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, itemclick: false, itemdoubleclick: false }, annotations: named(atlas.changes, atlas.lambda, colours),
      shapes: [
        ...atlas.undecided.map(([x0, x1]) => ({ type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, fillcolor: colours.line, opacity: 0.6, line: { width: 0 } })),
        ...atlas.changes.map(({ lambda: { value }, kind }) => upright(value, { color: colours.bad, width: 1.3, dash: DASHES[CHANGES[kind][0]] })),
        ...(Number.isFinite(chosen) ? [upright(chosen, { color: colours.ink, width: 1.5 })] : []),
      ],
    } };
  });
  place.onclick = (event) => {
    const { xaxis, yaxis } = place._fullLayout;
    const box = place.getBoundingClientRect();
    const lambda = xaxis.p2d(event.clientX - box.left - xaxis._offset);
    const g1 = yaxis.p2d(event.clientY - box.top - yaxis._offset);
    const [low, high] = yaxis.range;
    if (lambda < atlas.lambda[0] || lambda > atlas.lambda[1] || g1 < low || g1 > high) return; // beside the picture, as on its legend
    pick(Number(lambda.toPrecision(5)), windowAt(atlas, lambda, g1));
  };
}

/** Return the number of the window that holds γ₁ at the sample nearest to λ; null if it is the only one, or there is none. */
function windowAt(atlas, lambda, g1) {
  const part = atlas.parts.find(({ lambda: [low, high] }) => low <= lambda && lambda <= high);
  const windows = part?.samples?.windows ?? [];
  if (windows.length < 2) return null;
  const gap = part.samples.lambda.map((value) => Math.abs(value - lambda));
  const k = gap.indexOf(Math.min(...gap));
  return windows.find((one) => one.g1[0][k] <= g1 && g1 <= one.g1[1][k])?.window ?? null;
}
