// One solution: facts, samples of any stretch, curves, drifts, provenance, files.
import { $, ago, asked, bodyText, copier, fill, get, h, motionText, potentialText, request, run } from "./core.js";
import { multipliers, turningBody } from "./body.js";
import { factsOf } from "./facts.js";
import { drifts, overTime, phasePlane } from "./series.js";
import { pointsOf, turnable } from "./sphere.js";

const FORMATS = { json: "JSON", csv: "CSV", ndjson: "NDJSON", npz: "NPZ (NumPy)", arrow: "Arrow", parquet: "Parquet" };

function curves({ columns }) {
  if (columns.g1) {
    const points = pointsOf(columns, ["g1", "g2", "g3"]);
    turnable($("gamma"), { curves: [{ points }], marks: [{ point: points[0], title: "start" }], labels: ["γ₁", "γ₂", "γ₃"], alt: "Path of the vertical on the unit sphere" });
  }
  if (columns.p) {
    const largest = Math.max(1e-300, ...columns.p.map((_, k) => Math.hypot(columns.p[k], columns.q[k], columns.r[k])));
    const points = pointsOf(columns, ["p", "q", "r"], 1500, 1 / largest);
    turnable($("omega"), { curves: [{ points, kind: "curve second" }], marks: [{ point: points[0], title: "start" }], labels: ["p", "q", "r"], ball: false, alt: "Path of the angular velocity in the body" });
  }
}

function files(solution) {
  const path = `v1/solutions/${solution.id}/trajectory`;
  const url = new URL(path, document.baseURI).href;
  const form = $("stretch");
  const query = () => `start=${form.start.value}&stop=${form.stop.value}&samples=800`;
  fill($("downloads"),
    h("ul", { class: "buttons" }, Object.entries(FORMATS).map(([format, name]) =>
      h("li", {}, h("button", { type: "button", class: "button", onclick: () => download(`${path}?format=${format}`, `solution-${solution.id}.${format}`) }, name)))),
    h("p", { class: "hint" }, "The stored samples, in full precision. Or ask for what is on the screen:"),
    h("div", { class: "row" },
      copier("Copy as curl", () => `curl -s '${url}?${query()}' -H 'Accept: text/csv'`),
      copier("Copy as Python", () => `import json\nimport urllib.request\n\nwith urllib.request.urlopen("${url}?${query()}") as answer:\n    columns = json.load(answer)["columns"]\n`)));
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
  await overTime(solution, (trajectory) => {
    curves(trajectory);
    drifts(problem.body, trajectory);
    $("turn-title").parentElement.hidden = !turningBody($("turning"), problem.body, trajectory);
    $("stability").hidden = !solution.stability;
    $("space").hidden = $("turn-title").parentElement.hidden && $("stability").hidden;
    $("phase-section").hidden = !(trajectory.columns.p && trajectory.columns.g1 && problem.motion.type === "planar");
    if (!$("phase-section").hidden) phasePlane(trajectory);
  });
}

run(show, $("failure"));
