// One solution: facts, samples of any stretch, curves, drifts, comparisons, provenance, files.
import { $, ago, asked, bodyText, copier, exact, fill, get, h, measured, motionText, number, pause, potentialText, remember, request, run, troubleOf } from "./core.js";
import { multipliers, turningBody } from "./body.js";
import { between, drifts, overTime, phasePlane, samplesOf } from "./series.js";
import { pointsOf, turnable } from "./sphere.js";

const FORMATS = { json: "JSON", csv: "CSV", ndjson: "NDJSON", npz: "NPZ (NumPy)", arrow: "Arrow", parquet: "Parquet" };
const FRAMES = 800; // of the turning body, equally far apart in time

const ENDS = { pole: "a pole", equator: "the equator", rest: "rest", equilibrium: "an equilibrium", collision: "a collision" };
const ENDLESS = {
  separatrix: "on a separatrix: it approaches an equilibrium for ever", equilibrium: "an equilibrium: nothing moves",
  collision: "it runs into a singularity of the potential", pole: "it approaches a pole for ever",
};

const fact = (name, ...value) => h("div", {}, h("dt", {}, name), h("dd", {}, ...value.flat()));

/** Mark a number whose error is a theorem; the others say nothing. */
const proven = (kind) => (kind === "theorem" ? h("span", { class: "error", title: "proved by balls that contain every value" }, " proven") : "");

/** Return the facts of a solution, each with its error, as parts of a description list. */
function factsOf(solution) {
  const { period, aperiodic, energy, window: range, invariants, cross_check: check, stability, precession, error_kind: kinds = {} } = solution;
  const known = (path) => proven(kinds?.[path]);
  const drift = Object.entries(invariants ?? {}).filter(([, value]) => value?.drift !== undefined);
  return [
    period ? fact("Period", measured(period), known("period")) : fact("Period", aperiodic ? `none, ${ENDLESS[aperiodic] ?? aperiodic}` : "none is known"),
    energy ? fact("Energy", measured(energy), known("energy")) : null,
    fact("Error of a sample", h("span", { class: "value" }, `≤ ${number(solution.error, 2)}`), known("samples"), relative(solution.errors)),
    range ? fact("Range", `from ${ENDS[range.ends[0]] ?? range.ends[0]} to ${ENDS[range.ends[1]] ?? range.ends[1]}`,
      h("span", { class: "error" }, ` γ₁ in [${range.g1.map((x) => number(x, 5)).join(", ")}]`)) : null,
    drift.length ? fact("Drift", drift.map(([name, value], k) => [k ? ", " : "", `${name} `, h("span", { class: "value" }, number(value.drift, 2))]).flat()) : null,
    precession ? fact("Precession ψ in a period", measured(precession.psi1), known("precession.psi1")) : null,
    stability ? fact("In its plane it is", h("span", { class: "value" }, stability.verdict), h("span", { class: "error" },
      " trace "), measured(stability.trace.value === undefined ? { value: stability.trace, error: stability.error } : stability.trace), known("stability")) : null,
    stability?.trusted_time ? fact("Numerical integration is reliable until", h("span", { class: "value" }, `t ≈ ${number(stability.trusted_time, 4)}`)) : null,
    check ? fact("Second method", `${check.method} ${check.agrees ? "agrees" : "disagrees"}`, h("span", { class: "error" }, ` within ${number(check.disagreement, 2)}`)) : null,
    fact("Method", `${solution.method}, tier ${solution.tier}`, h("span", { class: "error" }, ` ${number(solution.cost.compute_seconds, 2)} s`)),
  ].filter(Boolean);
}

/** The errors of ω and γ relative to their size: more useful where that is far from 1. */
function relative(errors) {
  const groups = [["ω", errors?.omega], ["γ", errors?.gamma]].filter(([, error]) => error?.relative);
  return groups.length ? h("span", { class: "error" }, ` relative ${groups.map(([name, error]) => `${number(error.relative, 2)} (${name})`).join(", ")}`) : "";
}

function curves({ columns }) {
  if (columns.g1) {
    const points = pointsOf(columns, ["g1", "g2", "g3"], Infinity);
    turnable($("gamma"), { curves: [{ points }], marks: [{ point: points[0], title: "start" }], labels: ["γ₁", "γ₂", "γ₃"], alt: "Path of the vertical on the unit sphere" });
  }
  if (columns.p) {
    const largest = columns.p.reduce((most, _, k) => Math.max(most, Math.hypot(columns.p[k], columns.q[k], columns.r[k])), 1e-300);
    const points = pointsOf(columns, ["p", "q", "r"], Infinity, 1 / largest);
    turnable($("omega"), { curves: [{ points, kind: "curve second" }], marks: [{ point: points[0], title: "start" }], labels: ["p", "q", "r"], ball: false, alt: "Path of the angular velocity in the body" });
  }
}

function files(solution) {
  const path = `v1/solutions/${solution.id}/trajectory`;
  const url = new URL(path, document.baseURI).href;
  const form = $("stretch");
  // Until the first samples have come the fields are empty: then the stored ones are what is meant.
  const stretch = () => [form.start, form.stop].map(({ value }) => value.trim()).filter(Boolean);
  const query = ([start, stop]) => (stop ? `?${between(start, stop, "samples=800").join("&").replaceAll("'", "%27")}` : "");
  const samples = ([start, stop]) => (stop ? `at(np.linspace(${exact(start)}, ${exact(stop)}, 800))` : "samples()");
  fill($("downloads"),
    h("ul", { class: "buttons" }, Object.entries(FORMATS).map(([format, name]) =>
      h("li", {}, h("button", { type: "button", class: "button", onclick: () => download(`${path}?format=${format}`, `solution-${solution.id}.${format}`) }, name)))),
    h("p", { class: "hint" }, "The stored samples, in full precision. Or ask for what is on the screen:"),
    h("div", { class: "row" },
      copier("Copy as curl", () => `curl -s '${url}${query(stretch())}' -H 'Accept: text/csv'`),
      copier("Copy as Python", () => `import numpy as np\nimport polhode as ph\n\nmotion = ph.connect(${JSON.stringify(new URL(".", document.baseURI).href)}).solution("${solution.id}")\n`
        + `samples = motion.${samples(stretch())}\nprint(samples.gamma, samples.error)\n`)));
}

async function download(path, name) {
  const content = await (await request(path, { headers: { Accept: "*/*" } })).blob();
  const link = h("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function show() {
  const solution = await get(`v1/solutions/${encodeURIComponent(asked().get("id") ?? "none")}`);
  const { problem } = solution;
  const title = potentialText(problem.potential);
  document.title = `${title} · polhode`;
  $("title").textContent = title;
  $("subtitle").textContent = `${motionText(problem.motion)} · ${bodyText(problem.body)} · computed ${ago(solution.created_at)}`;
  fill($("facts"), factsOf(solution));
  fill($("warnings"), (solution.warnings ?? []).map((warning) => h("p", { class: "notice" }, warning.message ?? String(warning))));
  fill($("provenance"), Object.entries({ ...solution.provenance, solution: solution.id, job: solution.job }).map(([name, value]) =>
    h("div", {}, h("dt", {}, name), h("dd", {}, String(value)))));
  $("problem").textContent = JSON.stringify(problem, null, 2);
  $("again").href = `./workbench#${encodeURIComponent(JSON.stringify(problem))}`;
  files(solution);
  if (solution.stability) multipliers($("multipliers"), solution.stability);
  $("body").hidden = false;
  const [start, stop] = [asked().get("start"), asked().get("stop")];
  const ofOthers = comparing(solution);
  const ofOrientation = turning(solution);
  let latest = null;
  await overTime(solution, start !== null && stop !== null ? [start, stop] : null, async (stretch) => {
    const { turn } = stretch;
    latest = stretch;
    $("phase-section").hidden = !(turn.columns.p && turn.columns.g1 && problem.motion.type === "planar");
    const pictures = [() => curves(turn), () => drifts(problem.body, stretch), () => $("phase-section").hidden || phasePlane(turn),
      () => ofOrientation(stretch), () => ofOthers(stretch)];
    // One at a time, so that the browser can answer to people in between.
    for (const show of pictures) {
      await pause(0);
      if (latest === stretch) show();
    }
  });
}

/** Return what shows how the body turns in a stretch; of too many periods in the first one. */
function turning(solution) {
  const hasOrientation = Boolean(solution.problem.outputs?.includes("orientation"));
  $("turn-title").parentElement.hidden = !hasOrientation;
  $("stability").hidden = !solution.stability;
  $("space").hidden = !hasOrientation && !solution.stability;
  let asking = null;
  return async ({ kind, columns, turn }) => {
    if (!hasOrientation) return;
    asking?.abort();
    asking = new AbortController();
    const { t } = kind === "band" ? turn.columns : columns;
    try {
      const names = ["q0", "q1", "q2", "q3"];
      turningBody($("turning"), solution.problem.body, await samplesOf(solution.id, between(t[0], t.at(-1), `samples=${FRAMES}`), names, asking.signal));
    } catch (error) {
      if (error.name !== "AbortError") fill($("turning"), troubleOf(error));
    }
  };
}

/** Return what compares each stretch with other solutions; its module comes when somebody looks there. */
function comparing(solution) {
  let stretch = null;
  let shown = null;
  const open = () => {
    shown ??= import("./compare.js").then(({ comparison }) => comparison(solution)).catch((error) => {
      shown = null; // the next one who asks may have more luck
      throw error;
    });
    shown.then((renew) => renew(stretch)).catch((error) => fill($("compare-note"), troubleOf(error)));
  };
  const seen = new IntersectionObserver(([{ isIntersecting }]) => { if (isIntersecting && stretch && !shown) open(); });
  // Whoever is faster than that module is heard, too: what is chosen stands in the address, where it looks.
  $("compare").addEventListener("submit", (event) => {
    event.preventDefault();
    const { other, known } = event.currentTarget.elements;
    const id = other.value.trim() || known.value;
    other.value = "";
    if (!id) return;
    remember({ with: [...new Set([...asked().getAll("with"), id])] });
    if (stretch) open();
  });
  return (found) => {
    stretch = found;
    if (shown || asked().has("with")) open();
    else seen.observe($("compare-section"));
  };
}

run(show, $("failure"));
