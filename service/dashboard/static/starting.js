// What a click starts: the computation of a problem, of a point of a sweep, of a finer sweep.
import { $, exact, fill, get, h, lengthOf, number, onceKey, post, say, troubleOf } from "./core.js";
import { follow } from "./follow.js";

const OVER = ["succeeded", "failed", "cancelled"];

/** Solve a problem; return the finished job. Its solution may have been there before. */
export async function solved(problem) {
  let job = await post("v1/jobs", problem, { headers: { Prefer: "wait=5" } });
  if (!OVER.includes(job.state)) {
    await follow({ events: `v1/jobs/${job.id}/events`, path: `v1/jobs/${job.id}`, name: "job", isOver: ({ state }) => OVER.includes(state),
      seen: (name, found) => { if (name === "job") job = found; } });
  }
  return job;
}

/** Return why a job has no solution, in words. */
export const whyNot = (job) => (job.error ? `${job.error.title ?? String(job.error.code ?? "failed").replaceAll("_", " ")}: ${job.error.detail ?? ""}` : job.state);

/** Put a value where a pointer (RFC 6901) points to. */
export function put(document, pointer, value) {
  const parts = pointer.split("/").slice(1).map((part) => part.replaceAll("~1", "/").replaceAll("~0", "~"));
  const last = parts.pop();
  parts.reduce((place, part) => place[part], document)[last] = value;
}

/** Return a double as the axis has it: its listed values and its ends are exact, such as "1/3". */
function stated(axis, value) {
  const listed = axis.values ?? (axis.linspace ?? axis.logspace ?? []).slice(0, 2);
  return listed.find((text) => exact(text) === value) ?? value;
}

/** Return the problem of a point, whose row of numbers has the values of the axes by their pointers. */
export function problemOf({ base, axes }, row) {
  const problem = structuredClone(base);
  for (const axis of axes) put(problem, axis.pointer, stated(axis, row[axis.pointer]));
  return problem;
}

let latest = 0;

/** Show a point with its kept numbers; a click computes it and lands on its solution. */
export async function showPoint(path, document, index) {
  const place = $("point");
  const mine = ++latest;
  const { items: [row] } = await get(`${path}/points?where=${encodeURIComponent(`index=${index}`)}&limit=1`);
  if (mine !== latest) return; // another point has been asked for meanwhile
  if (!row) {
    fill(place, h("p", { class: "hint" }, `Point ${index} is not computed yet, or there is no such point.`));
    return;
  }
  const problem = problemOf(document, row);
  const outcome = h("div", { class: "outcome", role: "status" });
  const hidden = ["index", "outcome"];
  const button = h("button", { type: "button", class: "main", onclick: async () => {
    button.disabled = true;
    fill(outcome, h("p", { class: "hint" }, "Computing…"));
    try {
      const job = await solved(problem);
      if (job.solution) location.href = `./solution?id=${job.solution}`;
      else fill(outcome, h("p", { class: "fault" }, whyNot(job)));
    } catch (error) {
      fill(outcome, troubleOf(error));
    }
    button.disabled = false;
  } }, row.outcome === "solved" ? "Open as a solution" : "Compute it alone, and see why");
  fill(place, h("h3", {}, `Point ${index.toLocaleString("en")}`), h("dl", { class: "facts" },
    Object.entries(row).filter(([name, value]) => !hidden.includes(name) && !Array.isArray(value)).map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", { class: "value" }, number(value, 12)))),
    h("div", {}, h("dt", {}, "outcome"), h("dd", {}, String(row.outcome).replaceAll("_", " ")))),
  h("div", { class: "row" }, button, h("a", { href: `./workbench#${encodeURIComponent(JSON.stringify(problem))}` }, "Open in the workbench")), outcome);
  say(`point ${index}: ${String(row.outcome).replaceAll("_", " ")}`);
}

const field = (name, label, value, step = "any") => h("label", {}, `${label} `, h("input", { name, type: "number", step, value, required: true, min: step === "1" ? 1 : null }));

let offered = null;

/** Fill the form of a finer sweep. ``stretches``: [{axis, from, to}] are what the picture shows of its axes. */
export function showStretches(stretches, short) {
  const offer = JSON.stringify(stretches);
  if (offer === offered) return; // what somebody has typed stays, however often the picture is drawn anew
  offered = offer;
  fill($("stretches"), stretches.map(({ axis, from, to }, n) => h("fieldset", { class: "row" }, h("legend", { class: "unseen" }, axis.pointer), h("span", { class: "formula" }, short(axis.pointer)),
    field(`from${n}`, "from", from), field(`to${n}`, "to", to), field(`count${n}`, "points", lengthOf(axis), "1"))));
}

/** Return the document of a sweep over narrower stretches; ``held`` has the numbers of the axes that are left out. */
export function narrowed(document, stretches, held) {
  const base = structuredClone(document.base);
  for (const [pointer, value] of held) put(base, pointer, stated(document.axes.find((axis) => axis.pointer === pointer), value));
  const narrow = new Map(stretches.map(({ axis, from, to, count, isLog }) =>
    [axis.pointer, { pointer: axis.pointer, [isLog ? "logspace" : "linspace"]: [stated(axis, from), stated(axis, to), count] }]));
  const left = new Set(held.map(([pointer]) => pointer));
  return { ...document, base, axes: document.axes.filter(({ pointer }) => !left.has(pointer)).map((axis) => narrow.get(axis.pointer) ?? axis) };
}

/** Ask whether a sweep shall be started; start it once, however often it is sent, and go to it. */
export function askAndStart(document, note) {
  const dialog = $("finer-dialog");
  const count = document.axes.reduce((product, axis) => product * lengthOf(axis), 1);
  const spans = document.axes.map((axis) => `${axis.pointer}: ${lengthOf(axis).toLocaleString("en")} values`
    + (axis.linspace || axis.logspace ? ` from ${(axis.linspace ?? axis.logspace)[0]} to ${(axis.linspace ?? axis.logspace)[1]}` : ""));
  fill($("finer-what"), h("p", {}, `A new sweep of ${count.toLocaleString("en")} points will be computed.`), h("ul", { class: "plain" }, spans.map((span) => h("li", {}, span))));
  const key = onceKey();
  $("finer-start").onclick = async () => {
    $("finer-start").disabled = true;
    try {
      const { id } = await post("v1/sweeps", { ...document, note }, { headers: { "Idempotency-Key": key } });
      location.href = `./sweep?id=${id}`;
    } catch (error) {
      fill($("finer-what"), troubleOf(error));
    }
    $("finer-start").disabled = false;
  };
  dialog.showModal();
}
