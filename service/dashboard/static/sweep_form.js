// A sweep is written here: its axes, what is kept of each point, and what it will cost, before it starts.
import { $, during, exact, fill, get, h, motionText, nameOf, number, onceKey, pause, post, potentialText, Refusal, say, troubleOf } from "./core.js";

const QUIET = 250; // milliseconds after the last key
const RECENT = 20;
const [ONE_AXIS, TWO_AXES] = [200, 40]; // values of an axis, until somebody types another number
const MOST_ROWS = 6;
/** What can be kept, in words, with the output that it needs beside γ and ω; of most the bound of the error is kept too. */
const KEPT = {
  period: ["period"], energy: ["energy"], error: ["error of the six variables"],
  "invariants.energy.drift": ["drift of the energy", "invariants"],
  "stability.trace": ["trace of the stability", "stability"], "stability.exponent": ["exponent of the stability", "stability"],
  "precession.psi1": ["precession ψ₁", "orientation"], "precession.psi3": ["precession ψ₃", "orientation"],
};
const BOUNDED = ["period", "energy", "stability.trace", "stability.exponent", "precession.psi1", "precession.psi3"];
const USUAL = ["period", "energy", "error"];

/** Return a number as it was typed; what a double writes in the same way is sent as one, the rest as exact text. */
const typed = (text) => (String(Number(text)) === text.trim() ? Number(text) : text.trim());

/** Return the pointers of the numbers of a problem that an axis may vary, first those that are varied most. */
function pointersOf({ body = {}, potential, motion, time = {} }) {
  const isNumber = (value) => value !== null && typeof value !== "object" && Number.isFinite(exact(value));
  const inside = (path, value) => (isNumber(value) ? [path]
    : value && typeof value === "object" ? Object.entries(value).flatMap(([name, part]) => inside(`${path}/${name.replaceAll("~", "~0").replaceAll("/", "~1")}`, part)) : []);
  const { type: kind, parameters = {}, ...parts } = potential;
  return [...inside("/motion", { lambda: motion.lambda, nu: motion.nu, omega: motion.omega }), ...inside("/potential/parameters", parameters),
    ...inside("/potential", kind === "expression" || kind === "general" ? {} : parts), ...inside("/body", body), ...inside("/time", { stop: time.stop, periods: time.periods })];
}

const valueAt = (problem, pointer) => pointer.split("/").slice(1).reduce((part, name) => part[name.replaceAll("~1", "/").replaceAll("~0", "~")], problem);

/** Return where an axis goes at first: around the number that is there. */
function around(problem, pointer) {
  const value = exact(valueAt(problem, pointer));
  if (value === 0) return [-1, 1];
  return [value / 2, 2 * value].sort((one, other) => one - other).map((end) => Number(end.toPrecision(6)));
}

let rows = [];
let base = null;
let asking = new AbortController();

/** Return one row of the form: an axis. */
function rowOf(place, chosen, ends) {
  const pointers = pointersOf(base);
  const select = h("select", { "aria-label": `Axis ${place + 1}` }, place ? h("option", { value: "" }, "nothing else") : null,
    pointers.map((pointer) => h("option", { value: pointer, selected: pointer === chosen }, nameOf(pointer))));
  const field = (label, size, value) => h("input", { size, value, spellcheck: "false", autocomplete: "off", "aria-label": `${label}, axis ${place + 1}` });
  const row = { select, from: field("from", 7, ends?.[0]), to: field("to", 7, ends?.[1]), count: field("number of values", 6, place ? TWO_AXES : ONE_AXIS),
    scale: h("select", { "aria-label": `Spacing, axis ${place + 1}` }, h("option", { value: "linspace" }, "equal steps"), h("option", { value: "logspace" }, "equal ratios")), fault: h("p", { class: "fault" }) };
  row.rest = h("span", { class: "row", hidden: !chosen }, "from ", row.from, " to ", row.to, ", ", row.count, " values in ", row.scale);
  row.element = h("div", { class: "plain" }, h("div", { class: "row" }, place ? "and" : "over", select, row.rest), row.fault);
  select.addEventListener("change", () => {
    row.rest.hidden = !select.value;
    if (select.value) [row.from.value, row.to.value] = around(base, select.value);
    if (place && rows[0].count.value === String(ONE_AXIS) && select.value) rows[0].count.value = TWO_AXES;
    if (place === rows.length - 1 && select.value && rows.length < Math.min(MOST_ROWS, pointers.length)) addRow();
  });
  return row;
}

function addRow(chosen = "", ends = null) {
  rows.push(rowOf(rows.length, chosen, ends));
  $("sweep-axes").append(rows.at(-1).element);
}

/** Put another problem into the form; the first axis is λ, or the first number that there is. */
function begin(problem, ends) {
  base = problem;
  rows = [];
  fill($("sweep-axes"));
  const [first] = pointersOf(base);
  if (first) addRow(first, ends ?? around(base, first));
  if (pointersOf(base).length > 1) addRow();
}

/** Return the document of the sweep that the form states. */
function stated() {
  const kept = [...document.querySelectorAll("#sweep-keep input:checked")].map(({ value }) => value);
  const outputs = [...new Set([...(base.outputs ?? ["gamma", "omega"]), ...kept.map((name) => KEPT[name][1]).filter(Boolean)])];
  const { labels: _, note: __, ...problem } = base;
  return {
    base: { ...problem, outputs },
    axes: rows.filter(({ select }) => select.value).map(({ select, from, to, count, scale }) => ({ pointer: select.value, [scale.value]: [typed(from.value), typed(to.value), typed(count.value)] })),
    combine: "grid", keep: kept.flatMap((name) => (BOUNDED.includes(name) ? [name, `${name}.error`] : [name])),
  };
}

/** Return a time for people. */
const spell = (seconds) => (seconds < 1 ? "less than a second" : seconds < 100 ? `about ${number(seconds, 2)} s` : seconds < 7200 ? `about ${Math.round(seconds / 60)} minutes` : `about ${Math.round(seconds / 3600)} hours`);
const size = (bytes) => (bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${number(bytes / 1e6, 2)} MB`);

function showFaults(faults) {
  for (const { fault } of rows) fault.textContent = "";
  const others = faults.filter(({ pointer = "", message }) => {
    const row = rows.filter(({ select }) => select.value)[pointer.match(/^\/axes\/(\d+)/)?.[1]];
    if (row) row.fault.textContent = [row.fault.textContent, message].filter(Boolean).join("; ");
    return !row;
  });
  $("sweep-fault").textContent = others.map(({ message }) => message).join("; ");
}

/** Ask what the sweep will cost; the button starts what has been estimated, and nothing else. */
async function estimate() {
  asking.abort();
  asking = new AbortController();
  const { signal } = asking;
  const sent = stated();
  $("sweep-start").disabled = true;
  $("sweep-cost").classList.add("stale");
  await pause(QUIET);
  if (signal.aborted) return;
  try {
    const found = await post("v1/sweeps?estimate=true", sent, { signal });
    if (signal.aborted) return;
    showFaults([]);
    const slow = [...new Set(found.slow.map(({ why }) => why))];
    fill($("sweep-cost"), h("p", {}, h("strong", {}, `${found.points.toLocaleString("en")} points`), `: ${spell(found.seconds)} of one worker, ${size(found.bytes)} stored.`),
      found.ready_in ? h("p", { class: "hint" }, `It begins when all is compiled: in ${spell(found.ready_in)}.`) : null,
      slow.length ? h("p", { class: "hint" }, `What takes long: ${slow.join("; ")}.`) : null);
    $("sweep-start").disabled = false;
    $("sweep-start").onclick = () => during([$("sweep-start")], () => start(sent, onceKey()));
  } catch (error) {
    if (signal.aborted) return;
    showFaults(error.faults ?? []);
    fill($("sweep-cost"), error instanceof Refusal && error.faults.length ? null : troubleOf(error));
  }
  $("sweep-cost").classList.remove("stale");
}

async function start(sent, key) {
  try {
    const { id } = await post("v1/sweeps", sent, { headers: { "Idempotency-Key": key } });
    location.href = `./sweep?id=${id}`;
  } catch (error) {
    showFaults(error.faults ?? []);
    fill($("sweep-cost"), troubleOf(error));
  }
}

/** Return problems that a sweep may begin from: those solved last, each once, and the examples of the families. */
async function problems() {
  const [{ items }, { items: families, cases }] = await Promise.all([get(`v1/solutions?limit=${RECENT}`), get("v1/families")]);
  const known = new Map();
  for (const { problem } of items) known.set(JSON.stringify([problem.body, problem.potential, problem.motion]), [`${potentialText(problem.potential)} · ${motionText(problem.motion)}`, problem]);
  const examples = [...families, ...cases].filter(({ example }) => example).map(({ title, example }) => [`Example: ${title}`, example]);
  return [...known.values(), ...examples];
}

/** Open the form with a problem, or with a choice of problems where none is given; ``ends`` are those of the first axis. */
export async function openForm({ problem = null, ends = null } = {}) {
  $("sweep-dialog")?.remove();
  const choices = problem ? [] : await problems();
  const chooser = h("select", { id: "sweep-base" }, choices.map(([text], k) => h("option", { value: k }, text)));
  const dialog = h("dialog", { id: "sweep-dialog", class: "wide", "aria-labelledby": "sweep-title" }, h("form", { method: "dialog", novalidate: true },
    h("h2", { id: "sweep-title" }, "A new sweep"),
    problem ? h("p", { class: "hint" }, `${potentialText(problem.potential)} · ${motionText(problem.motion)}`)
      : h("p", { class: "row" }, h("label", { for: "sweep-base" }, "Of the problem"), chooser, h("a", { href: "./workbench" }, "Write another one")),
    h("div", { id: "sweep-axes", class: "plain" }),
    h("fieldset", { id: "sweep-keep", class: "row checks" }, h("legend", {}, "Keep of each point"),
      Object.entries(KEPT).map(([name, [text]]) => h("label", {}, h("input", { type: "checkbox", value: name, checked: USUAL.includes(name) }), ` ${text}`))),
    h("p", { class: "fault", id: "sweep-fault", role: "alert" }), h("div", { id: "sweep-cost", class: "plain", role: "status" }),
    h("div", { class: "row end" }, h("button", { value: "cancel", class: "quiet", formnovalidate: true }, "Cancel"), h("button", { type: "button", id: "sweep-start", class: "main", disabled: true }, "Start the sweep"))));
  document.body.append(dialog);
  begin(problem ?? choices[0][1], ends);
  chooser.addEventListener("change", () => begin(choices[chooser.value][1], null));
  for (const event of ["input", "change"]) dialog.addEventListener(event, estimate);
  dialog.addEventListener("close", () => asking.abort());
  // Enter in a field must not cancel: the first button of a form is what it would press.
  dialog.addEventListener("keydown", (event) => { if (event.key === "Enter" && event.target.matches("input")) event.preventDefault(); });
  dialog.showModal();
  say("A new sweep");
  await estimate();
}
