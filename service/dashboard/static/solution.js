// One solution: facts, samples of any stretch, curves, drifts, comparisons, provenance, files.
import { $, ENDS, STABILITY, ago, asked, bodyText, copier, download, during, exact, fill, get, h, knownCases, measured, motionText, number, pause, potentialText, remember, run, troubleOf } from "./core.js";
import { centreOf, Clock, drawnBody, framesOf, momentsOf, multipliers, turningBody } from "./body.js";
import { pointed } from "./chart.js";
import { between, drifts, namesOf, overTime, phasePlane, samplesOf, SHOWN, stale } from "./series.js";
import { pointsOf, turnable } from "./sphere.js";

const FORMATS = { json: "JSON", csv: "CSV", ndjson: "NDJSON", npz: "NPZ (NumPy)", arrow: "Arrow", parquet: "Parquet" };

const ENDLESS = {
  separatrix: "on a separatrix: it approaches an equilibrium for ever", equilibrium: "an equilibrium: nothing moves",
  collision: "it runs into a singularity of the potential", pole: "it approaches a pole for ever",
};

const fact = (name, ...value) => h("div", {}, h("dt", {}, name), h("dd", {}, ...value.flat()));

/** Mark a number whose error is a theorem; the others say nothing. */
const proven = (kind) => (kind === "theorem" ? h("span", { class: "error", title: "proved by balls that contain every value" }, " proven") : "");

/** Return the facts of a solution, each with its error, as parts of a description list. */
function factsOf(solution, tolerances) {
  const { period, aperiodic, energy, window: range, invariants, cross_check: check, stability, precession, problem: { accuracy }, error_kind: kinds = {} } = solution;
  const known = (path) => proven(kinds?.[path]);
  const drift = Object.entries(invariants ?? {}).filter(([, value]) => value?.drift !== undefined);
  return [
    period ? fact("Period", measured(period), known("period")) : fact("Period", aperiodic ? `none, ${ENDLESS[aperiodic] ?? aperiodic}` : "none is known"),
    energy ? fact("Energy", measured(energy), known("energy")) : null,
    fact("Claimed error, stored samples", h("span", { class: "value" }, `≤ ${number(solution.error, 2)}`), known("samples"), relative(solution.errors)),
    range ? fact("Range of motion", [...new Set(range.ends)].map((end) => ENDS[end] ?? end).join(", "),
      h("span", { class: "error" }, ` γ₁ in [${range.g1.map((x) => number(x, 5)).join(", ")}]`)) : null,
    drift.length ? fact("Drift", drift.map(([name, value], k) => [k ? ", " : "", `${name} `, h("span", { class: "value" }, number(value.drift, 2))]).flat()) : null,
    precession ? fact("Precession ψ in a period", measured(precession.psi1), known("precession.psi1")) : null,
    stability ? fact(solution.problem.motion.type === "classical" ? "Against disturbances" : "Against leaving its plane", h("span", { class: "value" }, STABILITY[stability.verdict]), h("span", { class: "error" },
      " trace "), measured(stability.trace.value === undefined ? { value: stability.trace, error: stability.error } : stability.trace), known("stability")) : null,
    stability?.trusted_time ? fact(`Double precision keeps ${number(exact(accuracy?.tolerance ?? tolerances[solution.tier === "certified" ? "standard" : solution.tier] ?? solution.error), 2)} until`,
      h("span", { class: "value" }, `t ≈ ${number(stability.trusted_time, 4)}`), known("stability.trusted_time")) : null,
    check ? fact("Second method", `${check.method} ${check.agrees ? "agrees" : "disagrees"}`, h("span", { class: "error" }, ` within ${number(check.disagreement, 2)}`)) : null,
    fact("Method", `${solution.method}, tier ${solution.tier}`, h("span", { class: "error" }, ` ${number(solution.cost.compute_seconds, 2)} s`)),
  ].filter(Boolean);
}

/** The errors of ω and γ relative to their size: more useful where that is far from 1. */
function relative(errors) {
  const groups = [["ω", errors?.omega], ["γ", errors?.gamma]].filter(([, error]) => error?.relative);
  return groups.length ? h("span", { class: "error" }, ` relative ${groups.map(([name, error]) => `${number(error.relative, 2)} (${name})`).join(", ")}`) : "";
}

/** Draw the paths of γ and ω; a mark on each follows the clock. */
function curves({ columns }, clock, samples) {
  const path = (id, names, scale, kind, more) => {
    const points = pointsOf(columns, names, Infinity, scale);
    const start = { point: points[0], kind: "start", title: "start" };
    const change = turnable($(id), { curves: [{ points, kind }], marks: [start], ...more });
    $(id).leave?.();
    $(id).leave = clock.follow(({ k }) => change({ marks: [start, { point: names.map((name) => samples[name][k] * scale), title: "at the time of the clock" }] }));
  };
  if (columns.g1) path("gamma", ["g1", "g2", "g3"], 1, "curve", { labels: ["γ₁", "γ₂", "γ₃"], alt: "Path of the vertical on the unit sphere" });
  if (columns.p) {
    const largest = columns.p.reduce((most, _, k) => Math.max(most, Math.hypot(columns.p[k], columns.q[k], columns.r[k])), 1e-300);
    path("omega", ["p", "q", "r"], 1 / largest, "curve second", { labels: ["p", "q", "r"], ball: false, alt: "Path of the angular velocity in the body" });
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

async function show() {
  const solution = await get(`v1/solutions/${encodeURIComponent(asked().get("id") ?? "none")}`);
  const { problem } = solution;
  const title = potentialText(problem.potential);
  document.title = `${title} · polhode`;
  $("title").textContent = title;
  $("subtitle").textContent = `${motionText(problem.motion)} · ${bodyText(problem.body)} · computed ${ago(solution.created_at)}`;
  const { tolerances } = solution.stability?.trusted_time ? await get("v1/accuracy") : { tolerances: {} };
  fill($("facts"), factsOf(solution, tolerances));
  fill($("warnings"), [knownCases(solution.known_cases), ...(solution.warnings ?? []).map((warning) => h("p", { class: "notice" }, warning.message ?? String(warning)))]);
  fill($("provenance"), Object.entries({ ...solution.provenance, solution: solution.id, job: solution.job }).map(([name, value]) =>
    h("div", {}, h("dt", {}, name), h("dd", {}, String(value)))));
  $("problem").textContent = JSON.stringify(problem, null, 2);
  $("again").href = `./workbench#${encodeURIComponent(JSON.stringify(problem))}`;
  files(solution);
  if (solution.stability) multipliers($("multipliers"), solution.stability);
  $("body").hidden = false;
  const [start, stop] = [asked().get("start"), asked().get("stop")];
  let [samples, claimed] = [null, null];
  const clock = new Clock($("clock"), (k) => (samples ? `t = ${number(samples.t[k], 6)}: ${namesOf(solution).map((name) => `${SHOWN[name]} = ${number(Math.abs(samples[name][k]) <= claimed ? 0 : samples[name][k], 7)}`).join(", ")}, each ± ${number(claimed, 2)}` : ""));
  const ofOthers = comparing(solution, clock);
  const ofBody = turning(solution, clock);
  let latest = null;
  $("stability").hidden = !solution.stability;
  await overTime(solution, start !== null && stop !== null ? [start, stop] : null, async (stretch) => {
    const { turn, kind } = stretch;
    const isFirst = latest === null;
    latest = stretch;
    ({ columns: samples, error: claimed } = kind === "band" ? turn : stretch);
    clock.span(samples.t);
    const isPlanar = turn.columns.p && turn.columns.g1 && problem.motion.type === "planar";
    $("phase-section").hidden = !isPlanar;
    const pictures = [() => ofBody(stretch, samples), () => curves(turn, clock, samples), () => pointed($("series"), clock),
      () => drifts(momentsOf(solution), stretch, clock), () => isPlanar && phasePlane(turn, clock, samples), () => ofOthers(stretch)];
    // One at a time, so that the browser can answer to people in between.
    for (const show of pictures) {
      await pause(0);
      if (latest === stretch) show();
    }
    if (latest === stretch) stale(false, "gamma", "omega", "phase", "drift");
    if (isFirst && !matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
  });
}

/** Return what shows how the body turns in a stretch; of too many periods in the first one. */
function turning(solution, clock) {
  const { problem } = solution;
  const outputs = problem.outputs ?? [];
  const isStored = outputs.includes("orientation");
  const { moments, note } = drawnBody(momentsOf(solution));
  const centre = centreOf(problem.potential);
  fill($("turning-more"), isStored ? null : h("button", { type: "button", class: "quiet", onclick: ({ currentTarget }) => during([currentTarget], prove) }, "With its proven error"));
  let asking = null;

  /** Submit the problem with the attitude among its outputs, and go to that solution. */
  async function prove() {
    fill($("turning-outcome"), h("p", { class: "hint" }, "Computing…"));
    try {
      const { solved, whyNot } = await import("./starting.js");
      const job = await solved({ ...problem, outputs: [...(outputs.length ? outputs : ["gamma", "omega"]), "orientation"] });
      if (job.solution) location.href = `./solution?id=${job.solution}`;
      else fill($("turning-outcome"), h("p", { class: "fault" }, whyNot(job)));
    } catch (error) {
      fill($("turning-outcome"), troubleOf(error));
    }
  }

  return async (stretch, { t }) => {
    asking?.abort();
    asking = new AbortController();
    const { signal } = asking;
    try {
      const ask = (count, names) => samplesOf(solution.id, between(t[0], t.at(-1), `samples=${count}`), names, signal);
      const periods = solution.period ? (t.at(-1) - t[0]) / solution.period.value : null;
      const found = namesOf(solution).length === 6 ? await framesOf(ask, periods, isStored) : null;
      if (signal.aborted) return;
      $("space").hidden = false;
      if (found) turningBody($("turning"), { moments, centre }, found, clock);
      else fill($("turning"), h("p", { class: "hint" }, "Over this time the body turns too often to be drawn. Zoom in, or show one period."));
      $("turning-note").textContent = `${note} ${centre ? "The dot is on the line to the centre of mass. " : ""}The second colour is the vertical. ${isStored
        ? `Its attitude is that of the solution, with a claimed error of at most ${number(solution.errors?.quaternion?.absolute ?? solution.error, 2)}.`
        : `Its attitude is integrated from ω on this page${found ? `, with steps of half the size ${number(found.apart, 1)} rad away` : ""}: less than a pixel off, but nothing is claimed.`}`;
    } catch (error) {
      if (error.name !== "AbortError") fill($("turning"), troubleOf(error));
    } finally {
      if (!signal.aborted) stale(false, "turning");
    }
  };
}

/** Return what compares each stretch with other solutions; its module comes when somebody looks there. */
function comparing(solution, clock) {
  let stretch = null;
  let shown = null;
  const open = () => {
    shown ??= import("./compare.js").then(({ comparison }) => comparison(solution, clock)).catch((error) => {
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
