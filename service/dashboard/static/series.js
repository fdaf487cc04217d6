// The six variables over time: any stretch of it, computed by the service when one zooms.
import { $, exact, get, number, say, troubleOf } from "./core.js";
import { draw } from "./chart.js";

const NAMES = ["p", "q", "r", "g1", "g2", "g3"];
const SHOWN = { p: "p", q: "q", r: "r", g1: "γ₁", g2: "γ₂", g3: "γ₃" };
const SAMPLES = 800;
const LEAST_DRIFT = 1e-17; // what is exactly zero has no logarithm

/** Draw a solution over time and keep it drawn; call ``seen(trajectory)`` with the samples of each stretch. */
export async function overTime(solution, seen) {
  const path = `v1/solutions/${solution.id}/trajectory`;
  const form = $("stretch");
  let shown = null;
  let asking = null;
  let typed = false; // since the last stretch was asked for: what somebody types is not overwritten by a late answer

  async function show(query) {
    typed = false;
    asking?.abort();
    asking = new AbortController();
    const { signal } = asking;
    try {
      shown = await get(`${path}${query}`, { signal });
    } catch (error) {
      if (signal.aborted) return;
      $("series-note").replaceChildren(troubleOf(error));
      return;
    }
    const { t } = shown.columns;
    if (!typed) {
      form.start.value = t[0];
      form.stop.value = t.at(-1);
    }
    await drawLines();
    const text = `${t.length} samples from ${number(t[0], 10)} to ${number(t.at(-1), 10)}; no value is off by more than ${number(shown.error, 2)}.`;
    $("series-note").textContent = text;
    say(text);
    seen(shown);
  }

  const between = (start, stop) => show(`?start=${encodeURIComponent(start)}&stop=${encodeURIComponent(stop)}&samples=${SAMPLES}`);

  async function drawLines() {
    await draw($("series"), (colours) => {
      const { columns, error } = shown;
      const size = Math.max(...NAMES.flatMap((name) => (columns[name] ? columns[name].map(Math.abs) : [0])));
      const traces = NAMES.filter((name) => columns[name]).map((name) => {
        const k = NAMES.indexOf(name);
        const bars = error > 2e-3 * size ? { error_y: { type: "constant", value: error, thickness: 0.6, width: 0 } } : {};
        return { x: columns.t, y: columns[name], name: SHOWN[name], mode: "lines", line: { color: colours[`c${(k % 3) + 1}`], width: 1.6, dash: "solid" },
          yaxis: k < 3 ? "y" : "y2", legendgroup: name, hovertemplate: `${SHOWN[name]} = %{y:.10g}<br>t = %{x:.10g}<extra></extra>`, ...bars };
      });
      return { traces, layout: {
        xaxis: { title: { text: "t" }, anchor: "y2", range: [columns.t[0], columns.t.at(-1)], exponentformat: "power" },
        yaxis: { domain: [0.54, 1], title: { text: "ω" } }, yaxis2: { domain: [0, 0.46], title: { text: "γ" } },
        dragmode: "zoom", hovermode: "closest", legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 58, r: 14, t: 34, b: 44 },
      } };
    });
  }

  form.addEventListener("input", () => (typed = true));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    between(form.start.value, form.stop.value);
  });
  $("stored").addEventListener("click", () => show(""));
  if (solution.period) {
    $("period").hidden = false;
    $("period").addEventListener("click", () => between(0, solution.period.value));
  }
  await show("");
  $("series").on?.("plotly_relayout", (change) => {
    const [start, stop] = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    // The times before 0 are no part of a solution.
    if (start !== undefined && stop > start) between(Math.max(0, start), stop);
  });
}

/** Draw how far the integrals that need no potential depart from their first values. */
export async function drifts(body, { columns, error }) {
  const { t, p, q, r, g1, g2, g3 } = columns;
  if (!p || !g1) return;
  const [A, B, C] = [exact(body.A), body.B == null ? null : exact(body.B), exact(body.C)];
  const at = (k) => A * p[k] * g1[k] + (B === null ? 0 : B * q[k] * g2[k]) + C * r[k] * g3[k];
  const areas = t.map((_, k) => Math.max(LEAST_DRIFT, Math.abs(at(k) - at(0))));
  const length = t.map((_, k) => Math.max(LEAST_DRIFT, Math.abs(g1[k] ** 2 + g2[k] ** 2 + g3[k] ** 2 - 1)));
  await draw($("drift"), (colours) => ({
    traces: [
      { x: t, y: length, name: "|γ|² − 1", mode: "markers", marker: { size: 3.5, color: colours.c1 } },
      { x: t, y: areas, name: "I·ω·γ, change", mode: "markers", marker: { size: 3.5, color: colours.c2 } },
      { x: [t[0], t.at(-1)], y: [error, error], name: "told error", mode: "lines", line: { color: colours.soft, dash: "dot", width: 1.5 } },
    ],
    layout: { xaxis: { title: { text: "t" } }, yaxis: { type: "log", exponentformat: "power", dtick: 1 } },
  }));
}

/** Draw the phase plane of the reduced motion: γ₂ and its derivative, which the equations of Poisson give. */
export async function phasePlane({ columns }) {
  const { p, r, g1, g2, g3 } = columns;
  await draw($("phase"), (colours) => ({
    traces: [{ x: g2, y: g2.map((_, k) => g3[k] * p[k] - g1[k] * r[k]), mode: "lines", line: { color: colours.c1, width: 1.8 }, hovertemplate: "γ₂ = %{x:.8g}<br>dγ₂/dt = %{y:.8g}<extra></extra>" }],
    layout: { xaxis: { title: { text: "γ₂" } }, yaxis: { title: { text: "dγ₂/dt" } }, hovermode: "closest", dragmode: false },
  }));
}
