// A question about integrals, potentials or numbers: it is written here, asked as a job, and its answer is read here.
import { $, asked, copier, counted, during, fill, get, h, listed, measured, nameOf, onceKey, personText, post, run, say, STUDIES, troubleOf } from "./core.js";
import { follow } from "./follow.js";
import { put } from "./starting.js";

const LIVE = ["queued", "running"];
const formula = (text) => h("span", { class: "formula" }, text);
const expression = (text, parameters) => ({ type: "expression", expression: text, ...(parameters ? { parameters } : {}) });
const PLANAR = { body: { A: 2, C: 1 }, potential: expression("-g1 + 1/(20*g3^2)"), motion: { type: "planar", lambda: 1 } };

/** Each example: its kind, what it is called, and its document. */
const EXAMPLES = [
  ["integral", "Kovalevskaya's integral", { body: { A: "2*C", B: "2*C" }, potential: expression("k*g1", { k: null }), function: "(p^2 - q^2 - k*g1/C)^2 + (2*p*q - k*g2/C)^2" }],
  ["integral", "on the planar motions", { body: { A: "2*C" }, potential: expression("k*g1", { k: null }), function: "g3^2/g1", areas: 0, relations: ["q"] }],
  ["integral", "the relation of Hess", { body: { A: 3, B: 2, C: "3/2" }, potential: expression("g1 + g3"), function: "A*p + C*r", relation: true }],
  ["integrals", "of a heavy body", { body: { A: 2, B: 2, C: 1 }, potential: expression("-g1"), degree: { omega: 4, gamma: 2 } }],
  ["integrals", "of every heavy body", { potential: expression("k*g1", { k: null }), degree: { omega: 2, gamma: 1 } }],
  ["potentials", "of one body", { body: { A: 2, C: 1 }, degree: 4 }],
  ["potentials", "of every ratio A/C", { degree: 8 }],
  ["numbers", "a period", { base: PLANAR, unknowns: [{ pointer: "/motion/lambda", interval: ["9/10", "11/10"] }], wanted: [{ of: "period", equals: "6.34" }] }],
  ["numbers", "a period and an energy", { base: { ...PLANAR, potential: expression("a*g1 + 1/(20*g3^2)", { a: -1 }) },
    unknowns: [{ pointer: "/motion/lambda", interval: ["99/100", "101/100"] }, { pointer: "/potential/parameters/a", interval: ["-101/100", "-99/100"] }],
    wanted: [{ of: "period", equals: "6.34" }, { of: "energy", equals: "2/5" }] }],
];

// --- the form ---------------------------------------------------------------------------------

const trimmed = (text) => text.trim() || undefined;
const lines = (text) => text.split("\n").map((line) => line.trim()).filter(Boolean);
/** Parameters as people write them: "k, a = 1/2", in which k is a letter. */
const parametersText = (given) => Object.entries(given ?? {}).map(([name, value]) => (value === null ? name : `${name} = ${value}`)).join(", ");
const parametersOf = (text) => Object.fromEntries(text.split(/[,\n]/).map((part) => part.split("=").map((side) => side.trim())).filter(([name]) => name).map(([name, value]) => [name, value || null]));
const number = (text) => (/^\d+$/.test(text.trim()) ? Number(text) : trimmed(text));

/** A field: the pointer to its place in the document, its label, and how it is read and written. */
const text = (pointer, label, { hint = "", read = trimmed, write = String, isLong = false, list = null } = {}) => ({ pointer, label, hint, read, write, isLong, list });
const tick = (pointer, label, value) => ({ pointer, label, value });
const BODY = (names, hint, at = "") => ["Body", names.map((name) => text(`${at}/body/${name}`, name)), hint];
const POTENTIAL = (at, hint) => ["Potential", [text(`${at}/potential/expression`, "Formula in g1, g2, g3", { isLong: true }), text(`${at}/potential/parameters`, "Parameters", { hint, read: (typed) => (typed.trim() ? parametersOf(typed) : undefined), write: parametersText })]];
const LETTERED = [BODY(["A", "B", "C"], "A number, a formula such as 2*C, or nothing: then it is a letter, and the answer holds for all its values."), POTENTIAL("", "k, a = 1/2: one without a number is a letter")];
const AREAS = tick("/areas", "only where the areas integral is 0", 0);
const OF = { period: "the period", energy: "the energy", trace: "the trace of the multipliers", "precession.psi1": "the precession of axis 1", "precession.psi3": "the precession of axis 3" };
const UNKNOWN = (k, title) => [title, [text(`/unknowns/${k}/pointer`, "Place", { list: ["/motion/lambda", "/body/B", "/potential/parameters/a"] }), text(`/unknowns/${k}/interval/0`, "from"), text(`/unknowns/${k}/interval/1`, "to")]];
const WANTED = (k, title) => [title, [{ pointer: `/wanted/${k}/of`, label: "What", choices: OF, isLast: k > 0 }, text(`/wanted/${k}/equals`, "equals", { hint: "7, or 2*pi*3/7" })]];
/** The groups of fields of each kind of question. */
const GROUPS = {
  integral: [...LETTERED, ["Function", [text("/function", "Formula in p, q, r, g1, g2, g3", { isLong: true }), text("/relations", "Relations: what is 0, one a line", { isLong: true, read: (typed) => (lines(typed).length ? lines(typed) : undefined), write: (found) => found.join("\n") }), AREAS, tick("/relation", "ask whether it stays 0 where it is 0", true)]]],
  integrals: [...LETTERED, ["Largest degrees", [text("/degree/omega", "in p, q, r", { read: number }), text("/degree/gamma", "in g1, g2, g3", { read: number }), AREAS]]],
  potentials: [BODY(["A", "C"], "Left empty: every ratio A/C."), ["Largest degree", [text("/degree", "in g1, g2, g3", { read: number })]]],
  numbers: [BODY(["A", "B", "C"], "", "/base"), POTENTIAL("/base", "a = -1, b = 1/20"), ["Motion", [text("/base/motion/lambda", "λ")]], UNKNOWN(0, "Looked for"), UNKNOWN(1, "And (or nothing)"), WANTED(0, "Wanted"), WANTED(1, "And (or nothing)")],
};

let document_ = EXAMPLES[0][2]; // as sent or chosen last: what the form has no field for stays as it was
const parts = (pointer) => pointer.split("/").slice(1);
const at = (found, pointer) => parts(pointer).reduce((place, part) => place?.[part], found);

/** Show the fields of a kind of question, with what a document has. */
function showForm(what, found) {
  document_ = found;
  $("what").value = what;
  let count = 0;
  fill($("fields"), GROUPS[what].map(([title, fields, hint]) => h("fieldset", {}, h("legend", {}, title),
    h("div", { class: fields.length === 3 && !fields.some(({ isLong, value }) => isLong || value !== undefined) ? "fields three" : "fields" }, fields.map((field) => {
      const id = `field${count++}`;
      const value = at(found, field.pointer);
      if ("value" in field) return h("label", { class: "row" }, h("input", { type: "checkbox", id, "data-pointer": field.pointer, checked: value === field.value }), field.label);
      const given = value === undefined || value === null ? "" : field.write?.(value) ?? String(value);
      const attributes = { id, "data-pointer": field.pointer, spellcheck: "false", autocomplete: "off", "aria-describedby": field.hint ? `${id}-hint` : null };
      const input = field.choices ? h("select", attributes, field.isLast ? h("option", { value: "" }, "nothing") : null, Object.entries(field.choices).map(([name, words]) => h("option", { value: name, selected: name === given }, words)))
        : field.isLong ? h("textarea", { ...attributes, rows: Math.min(6, Math.max(given.split("\n").length, Math.ceil(given.length / 36), 1)) }, given) : h("input", { ...attributes, value: given, list: field.list ? `${id}-list` : null });
      return h("div", { class: field.list ? "field list" : "field" }, h("label", { for: id }, field.label), input, field.list ? h("datalist", { id: `${id}-list` }, field.list.map((one) => h("option", { value: one }))) : null,
        field.hint ? h("span", { class: "hint", id: `${id}-hint` }, field.hint) : null);
    })), hint ? h("p", { class: "hint" }, hint) : null)));
  fill($("examples"), EXAMPLES.filter(([kind]) => kind === what).map(([, title, example]) => h("button", { type: "button", class: "chip", onclick: () => { showForm(what, example); $("examples").querySelector("button").focus(); } }, title)));
  showDocument();
}

const fieldsOf = (what) => GROUPS[what].flatMap(([, fields]) => fields);

/** Return the document that the form states. */
function documentOf() {
  const what = $("what").value;
  const kept = what === "numbers" ? { base: structuredClone(document_.base ?? {}) } : {};
  const found = { ...kept };
  const set = (pointer, value) => {
    const path = parts(pointer);
    path.slice(0, -1).forEach((part, k) => { at(found, `/${path.slice(0, k).join("/")}`.replace(/\/$/, ""))[part] ??= /^\d/.test(path[k + 1]) ? [] : {}; });
    put(found, pointer, value);
  };
  for (const input of $("fields").querySelectorAll("[data-pointer]")) {
    const { pointer } = input.dataset;
    const field = fieldsOf(what).find((one) => one.pointer === pointer);
    const value = input.type === "checkbox" ? (input.checked ? field.value : undefined) : (field.read ?? trimmed)(input.value);
    if (value !== undefined) set(pointer, value);
    else if (at(found, pointer) !== undefined) delete at(found, `/${parts(pointer).slice(0, -1).join("/")}`)[parts(pointer).at(-1)];
  }
  if (found.potential) found.potential = { type: "expression", ...found.potential };
  if (found.base) {
    (found.base.potential ??= {}).type ??= "expression";
    (found.base.motion ??= {}).type ??= "planar";
  }
  if (found.wanted?.[1] && found.wanted[1].of === undefined) found.wanted.length = 1;
  return found;
}

const showDocument = () => { $("document").textContent = JSON.stringify(documentOf(), null, 2); };

/** Mark the fields that a refusal points to, and go to the first of them. */
function mark(faults) {
  const fields = [...$("fields").querySelectorAll("[data-pointer]")];
  for (const field of fields) field.removeAttribute("aria-invalid");
  const wrong = faults.map(({ pointer = "" }) => fields.filter(({ dataset }) => pointer && (pointer.startsWith(dataset.pointer) || dataset.pointer.startsWith(pointer)))[0]).filter(Boolean);
  for (const field of wrong) field.setAttribute("aria-invalid", "true");
  wrong[0]?.focus();
}

// --- the answer -------------------------------------------------------------------------------

const facts = (...rows) => h("dl", { class: "facts" }, rows.filter(Boolean).map(([name, ...value]) => h("div", {}, h("dt", {}, name), h("dd", {}, ...value))));
const ball = ({ mid, rad }) => measured({ value: mid, radius: rad });
const table = (heads, rows) => h("div", { class: "table", role: "group", tabindex: "0", "aria-label": heads.join(", ") }, h("table", {}, h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))), h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, ...[cell].flat())))))));
const workbench = (problem) => h("a", { href: `./workbench#${encodeURIComponent(JSON.stringify({ time: { periods: 1, samples: 201 }, ...problem }))}` }, "Open in the workbench");
const said = (isGood, strong, rest) => h("p", { class: `verdict ${isGood === null ? "" : isGood ? "admissible" : "inadmissible"}` }, h("strong", {}, strong), rest);

const ALONG = { always: "along every motion", zero_areas: "along every motion whose areas integral is 0", relations: "along every motion that keeps the relations for ever" };
const VERDICTS = {
  integral: (holds) => said(true, "It is an integral", `: constant ${ALONG[holds]}.`),
  not_integral: () => said(false, "It is no integral", ": it changes at the state below."),
  invariant_relation: (holds) => said(true, "It is an invariant relation", `: where it is 0 it stays 0, ${ALONG[holds]}.`),
  not_invariant: () => said(false, "It is no invariant relation", ": it is 0 at the state below, and changes there."),
  undecided: () => said(null, "Undecided", ": neither a proof nor a counterexample was found."),
};

function integralAnswer(found) {
  const { counterexample: other } = found;
  const independence = found.independent === null ? null : found.independent
    ? ["Independent of energy and areas", "yes: a determinant of derivatives is ", ball(found.minor)] : ["Independent of energy and areas", "no: ", formula(found.dependence), " is 0"];
  const isWider = ["integral", "invariant_relation"].includes(found.verdict);
  return [VERDICTS[found.verdict](found.holds),
    found.name || independence || found.multiplier || found.except_where.length ? facts(found.name && ["Known as", personText(found.name)], independence,
      found.multiplier && ["Its rate is this times itself", formula(found.multiplier)], found.except_where.length && ["Nothing is claimed where", formula(found.except_where.join(" = 0 or ")), " is 0"]) : null,
    other && h("h3", {}, isWider ? "A state outside of these motions, at which the function changes" : "The state"),
    other && table(["p", "q", "r", "g1", "g2", "g3"], [[...other.state.omega, ...other.state.gamma]]),
    other && facts(["Its rate there, which is not 0", ...ball(other.rate)], other.state.radius && ["Each number of the state is known to", other.state.radius],
      Object.keys(other.letters).length && ["With", formula(Object.entries(other.letters).map(([name, value]) => `${name} = ${value}`).join(", "))])];
}

const integralRows = (found) => found.map(({ expression: one, name, degree }) => [formula(one), name ? personText(name) : "no known one", `${degree.omega} in p, q, r; ${degree.gamma} in g1, g2, g3`]);
const INTEGRAL_HEADS = ["Integral", "Known as", "Degree"];

function integralsAnswer(found) {
  const { integrals, special } = found;
  return [said(integrals.length || special.length ? true : null, integrals.length ? counted(integrals.length, "more integral") : "No more integrals", " than the energy and the areas, for all values of the letters; what depends on others is left out."),
    integrals.length ? table(INTEGRAL_HEADS, integralRows(integrals)) : null,
    ...special.map(({ conditions, integrals: more, resolved }) => h("section", {}, h("h3", {}, "Where ", formula(conditions.map((one) => `${one} = 0`).join(", "))),
      resolved ? table(INTEGRAL_HEADS, integralRows(more)) : h("p", { class: "hint" }, "Whether there are more here was not decided."))),
    found.complete ? null : h("p", { class: "hint" }, "The time limit was reached: there may be more special values.")];
}

function potentialsAnswer(found, { body }) {
  const rows = (potentials, given) => potentials.map(({ expression: one }) => [formula(one), given ? workbench({ body: given, potential: expression(one), motion: { type: "planar", lambda: 1 } }) : ""]);
  return [said(true, counted(found.dimension, "potential"), `: all others up to this degree ${body?.A ? "" : "for every A ≠ C "}are sums of multiples of ${found.dimension === 1 ? "it" : "these"}.`),
    table(["Potential", ""], rows(found.potentials, body?.A && { A: body.A, C: body.C })),
    ...found.ratios.map(({ ratio, potentials }) => h("section", {}, h("h3", {}, `Also for A/C = ${ratio}`), table(["Potential", ""], rows(potentials, { A: ratio, C: 1 }))))];
}

function numbersAnswer(found, { base, unknowns }) {
  const rows = found.solutions.map(({ values, window: place, proof }) => {
    const problem = structuredClone(base);
    for (const [pointer, { value }] of Object.entries(values)) put(problem, pointer, Number(value));
    return [...unknowns.map(({ pointer }) => measured(values[pointer])), String(place), proof === "proved" ? "proved" : "possible: seen in doubles", workbench({ ...problem, motion: { ...problem.motion, window: place } })];
  });
  const isWhole = found.rest === "proved_empty";
  return [said(rows.length || isWhole ? true : null, rows.length ? counted(rows.length, "solution") : "No solution found", isWhole ? "; it is proved that there are no others." : "; whether there are others is not decided everywhere."),
    rows.length ? table([...unknowns.map(({ pointer }) => nameOf(pointer)), "Window", "Proof", ""], rows) : null,
    found.undecided.length ? h("details", {}, h("summary", {}, "Where it is not decided"), h("ul", { class: "plain hint" }, found.undecided.map((box) => h("li", {}, listed(box.map(([low, high], k) => `${nameOf(unknowns[k].pointer)} from ${low} to ${high}`)))))) : null];
}

const ANSWERS = { integral: integralAnswer, integrals: integralsAnswer, potentials: potentialsAnswer, numbers: numbersAnswer };
const WORDS = { queued: "Waits for a worker", running: "Is computed", cancelled: "Cancelled", failed: "No answer" };

/** Show a job: what it is at, or its answer. */
function showJob(job) {
  const { what, ...question } = job.problem;
  const stop = h("button", { type: "button", class: "quiet", onclick: () => during([stop], () => post(`v1/jobs/${job.id}/cancel`)).catch((error) => fill($("answer"), troubleOf(error))) }, "Cancel");
  fill($("state"), job.state === "succeeded" ? null : [h("span", { class: `state ${job.state}` }, WORDS[job.state]),
    ...(LIVE.includes(job.state) ? [h("progress", { max: 1, value: job.progress, "aria-label": "Progress" }), stop] : [])]);
  $("answer").ariaBusy = String(LIVE.includes(job.state));
  if (job.state === "succeeded") fill($("answer"), ANSWERS[what](job.result, question));
  else if (job.error) {
    fill($("answer"), h("div", { class: "notice bad" }, h("strong", {}, String(job.error.code).replaceAll("_", " ")), `: ${job.error.detail ?? ""} `, job.error.pointer ? h("code", {}, job.error.pointer) : ""));
    mark([job.error]);
  } else fill($("answer"));
}

let following = new AbortController();

/** Follow the study of the address until it has its answer. */
async function arrive() {
  following.abort();
  following = new AbortController();
  const { signal } = following;
  const id = asked().get("id");
  if (!id) {
    const [what, , example] = EXAMPLES.find(([kind]) => kind === asked().get("what")) ?? EXAMPLES[0];
    showForm(what, example);
    return;
  }
  const job = await get(`v1/jobs/${id}`, { signal });
  const { what, ...question } = job.problem;
  if (!(what in GROUPS)) throw new TypeError("this job answers no question");
  showForm(what, question);
  watch(job, signal);
}

function watch(job, signal) {
  showJob(job);
  if (!LIVE.includes(job.state)) return;
  const seen = (name, found) => { if (name === "job") showJob(found); };
  follow({ events: `v1/jobs/${job.id}/events`, path: `v1/jobs/${job.id}`, name: "job", seen, signal, isOver: ({ state }) => !LIVE.includes(state) })
    .then(() => { if (!signal.aborted) say($("answer").querySelector(".verdict")?.textContent ?? $("answer").textContent); }, (error) => { if (!signal.aborted) fill($("answer"), troubleOf(error)); });
}

async function ask() {
  const what = $("what").value;
  fill($("trouble-form"));
  mark([]);
  try {
    const job = await post(`v1/${STUDIES[what]}`, documentOf(), { headers: { Prefer: "respond-async", "Idempotency-Key": onceKey() } });
    following.abort();
    following = new AbortController();
    history.pushState(null, "", `?id=${job.id}`);
    watch(job, following.signal);
  } catch (error) {
    fill($("trouble-form"), troubleOf(error));
    mark(error.faults ?? []);
  }
}

$("form").addEventListener("submit", (event) => {
  event.preventDefault();
  during([$("submit")], ask);
});
$("fields").addEventListener("input", showDocument);
$("what").addEventListener("change", () => {
  const [what, , example] = EXAMPLES.find(([kind]) => kind === $("what").value);
  showForm(what, example);
});
fill($("copies"), copier("Copy it", () => $("document").textContent));
addEventListener("popstate", () => run(arrive));
await run(arrive);
