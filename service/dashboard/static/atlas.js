// Every planar motion over λ: windows as bands in γ₁, and the λ where they change.
import { $, fill, h, number } from "./core.js";
import { draw } from "./chart.js";

const CHANGES = {
  window_appears: "a window appears: an equilibrium", window_vanishes: "a window vanishes in an equilibrium",
  windows_merge: "two windows meet: a separatrix", window_splits: "a window splits: a separatrix",
  end_crosses_equator: "an end of a window crosses the equator", end_at_pole: "an end of a window is at a pole", several: "several changes",
};

/** Draw an atlas; ``pick(lambda, window)`` is called with the motion that was clicked. */
export async function showAtlas(atlas, chosen, pick) {
  const place = $("atlas");
  fill($("changes"), atlas.changes.map((change) => h("li", {}, "λ = ", h("span", { class: "value" }, number(change.lambda.value, 10)),
    ` ± ${number(change.lambda.error, 1)}: ${CHANGES[change.kind] ?? change.kind}`)));
  await draw(place, (colours) => {
    const traces = [];
    for (const { samples } of atlas.parts) {
      for (const one of samples?.windows ?? []) {
        const colour = colours[`c${(one.window % 6) + 1}`];
        const text = samples.energy.map((energy, k) => `window ${one.window}, ${one.ends.join(" to ")}${one.has_mirror_image ? ", with a mirror image" : ""}<br>energy ${energy.toPrecision(6)}`
          + `<br>γ₁ from ${one.g1[0][k]?.toPrecision(5)} to ${one.g1[1][k]?.toPrecision(5)}`);
        const line = { x: samples.lambda, mode: "lines", line: { color: colour, width: 1.2 }, showlegend: false, text, hovertemplate: "λ = %{x:.6g}<br>%{text}<extra></extra>" };
        traces.push({ ...line, y: one.g1[0] }, { ...line, y: one.g1[1], fill: "tonexty", fillcolor: `${colour}38` });
      }
    }
    const upright = (x, line) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1, line });
    return { traces, layout: {
      xaxis: { title: { text: "λ" }, range: atlas.lambda }, yaxis: { title: { text: "γ₁" }, rangemode: "tozero" }, hovermode: "closest", dragmode: false, showlegend: false,
      shapes: [
        ...atlas.undecided.map((part) => ({ type: "rect", x0: part.lambda?.[0] ?? part[0], x1: part.lambda?.[1] ?? part[1], yref: "paper", y0: 0, y1: 1, fillcolor: colours.line, opacity: 0.6, line: { width: 0 } })),
        ...atlas.changes.map((change) => upright(change.lambda.value, { color: colours.bad, width: 1, dash: "dot" })),
        ...(Number.isFinite(chosen) ? [upright(chosen, { color: colours.ink, width: 1.5 })] : []),
      ],
    } };
  });
  place.onclick = (event) => {
    const { xaxis, yaxis } = place._fullLayout;
    const box = place.getBoundingClientRect();
    const lambda = xaxis.p2d(event.clientX - box.left - xaxis._offset);
    const g1 = yaxis.p2d(event.clientY - box.top - yaxis._offset);
    if (lambda < atlas.lambda[0] || lambda > atlas.lambda[1]) return;
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
