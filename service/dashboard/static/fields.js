// The form of a problem: fields with the pointers of the document, and the document that they make.
import { $, fill, h } from "./core.js";

const LISTS = "numbers with commas between them";
const KINDS = {
  expression: [["expression", "V, a formula in g1, g2, g3", "formula"], ["parameters", "Parameters", "parameters"]],
  gravity: [["a", "a"], ["b", "b"], ["c", "c"]],
  rational: [["a", `a, ${LISTS}`, "list"], ["b", `b, ${LISTS}`, "list"], ["c", `c, ${LISTS}`, "list"]],
  homogeneous: [["A", `A, ${LISTS}`, "list"], ["B", `B, ${LISTS}`, "list"], ["C", `C, ${LISTS}`, "list"]],
  general: [["F", "F, a formula in w", "formula"], ["G", "G, a formula in g2", "formula"], ["parameters", "Parameters", "parameters"]],
};
const MOTIONS = {
  planar: [["lambda", "λ"], ["g1_sign", "Sign of γ₁"], ["g3_sign", "Sign of γ₃"], ["window", "Window"]],
  state: [["omega", `ω = (p, q, r), ${LISTS}`, "list"], ["gamma", `γ, ${LISTS}`, "list"]],
  other: [["", "The motion as JSON", "json"]],
};
const HINTS = { parameters: "a = -1, b = 1/20", g1_sign: "1", g3_sign: "1", window: "0" };

function field(base, [name, label, kind = "number"]) {
  const id = `field${base}/${name}`.replaceAll("/", "-");
  const common = { id, "data-pointer": name ? `${base}/${name}` : base, "data-kind": kind, spellcheck: "false", "aria-describedby": `${id}-fault` };
  const control = kind === "formula" || kind === "json" ? h("textarea", { ...common, rows: kind === "json" ? "6" : "2" })
    : h("input", { ...common, placeholder: HINTS[kind] ?? HINTS[name] ?? null });
  return h("div", { class: `field ${kind}` }, h("label", { for: id }, label), control, h("p", { class: "fault", id: `${id}-fault` }));
}

let wanted = "standard"; // the tier of the problem that was put into the form, until the tiers can be chosen

const controls = () => [...document.querySelectorAll("#form [data-pointer]")];
const at = (pointer) => controls().find((control) => control.dataset.pointer === pointer);

/** Build the fields of a kind of potential and of motion; what is of that kind already keeps what was typed. */
export function build(type, motion) {
  for (const [part, rows, kind] of [["potential", KINDS[type], type], ["motion", MOTIONS[motion], motion]]) {
    if ($(part).dataset.kind !== kind) fill($(part), rows.map((row) => field(`/${part}`, row)));
    $(part).dataset.kind = kind;
  }
  if (!$("moments").children.length) {
    fill($("moments"), ["A", "B", "C"].map((name) => field("/body", [name, name])));
    fill($("time"), [["periods", "Periods"], ["stop", "or until t ="], ["samples", "Samples"]].map((row) => field("/time", row)));
  }
}

const plain = (text) => (/^[-+]?(\d{1,15}|\d{0,12}\.\d{1,12}|\d{1,12}\.)$/.test(text) ? Number(text) : text);

function read(control) {
  const text = control.value.trim();
  if (!text) return undefined;
  if (control.dataset.kind === "list") return text.split(",").map((part) => plain(part.trim()));
  if (control.dataset.kind === "json") {
    try { return JSON.parse(text); } catch { return text; }
  }
  if (control.dataset.kind === "parameters") {
    return Object.fromEntries(text.split(",").map((part) => part.split("=").map((side) => side.trim())).filter(([name]) => name).map(([name, value = ""]) => [name, plain(value)]));
  }
  return control.dataset.kind === "formula" ? text : plain(text);
}

/** Return the problem that the form states. */
export function problemOf() {
  const problem = { body: {}, potential: { type: $("type").value }, motion: {}, time: {} };
  if ($("motion-type").value !== "other") problem.motion.type = $("motion-type").value;
  for (const control of controls()) {
    const value = read(control);
    const [, part, name] = control.dataset.pointer.split("/");
    if (value === undefined) continue;
    if (name === undefined) problem[part] = value;
    else problem[part][name] = value;
  }
  const measures = ["tolerance", "relative"].filter((name) => $(name).value.trim());
  problem.accuracy = measures.length ? Object.fromEntries(measures.map((name) => [name, plain($(name).value.trim())])) : { tier: document.querySelector("input[name=tier]:checked")?.value ?? wanted };
  const further = [...document.querySelectorAll("input[name=outputs]:checked")].map((box) => box.value);
  problem.outputs = ["gamma", "omega", ...further];
  return problem;
}

/** Put a problem into the form; what the form has no field for is left out. */
export function fillForm(problem) {
  const type = KINDS[problem.potential.type] ? problem.potential.type : "expression";
  const motion = ["planar", "state"].includes(problem.motion?.type) && problem.motion.nu === undefined && !problem.motion.start ? problem.motion.type : "other";
  $("type").value = type;
  $("motion-type").value = motion;
  build(type, motion);
  for (const control of controls()) {
    const [, part, name] = control.dataset.pointer.split("/");
    const value = name === undefined ? problem[part] : problem[part]?.[name];
    control.value = value === undefined || value === null ? "" : written(value, control.dataset.kind);
  }
  wanted = problem.accuracy?.tier ?? "standard";
  for (const name of ["tolerance", "relative"]) $(name).value = problem.accuracy?.[name] ?? "";
  const tier = document.querySelector(`input[name=tier][value="${CSS.escape(wanted)}"]`);
  if (tier) tier.checked = true;
  for (const box of document.querySelectorAll("input[name=outputs]")) box.checked = (problem.outputs ?? []).includes(box.value);
}

function written(value, kind) {
  if (kind === "json") return JSON.stringify(value, null, 1);
  if (kind === "parameters") return Object.entries(value).map(([name, number]) => `${name} = ${number}`).join(", ");
  return Array.isArray(value) ? value.join(", ") : String(value);
}

/** Put a formula into the field of the potential, of whatever kind that was; its parameters stay. */
export function useFormula(text) {
  const parameters = at("/potential/parameters")?.value;
  $("type").value = "expression";
  build("expression", $("motion-type").value);
  at("/potential/expression").value = text;
  if (parameters !== undefined) at("/potential/parameters").value = parameters;
}

/** Put the moments of a ratio A/C into the form: C stays if it is a number, and A is as exact as they are. */
export function useRatio(ratio) {
  const [above, below = "1"] = ratio.split("/");
  const C = /^\d+$/.test(at("/body/C").value.trim()) ? at("/body/C").value.trim() : "1";
  const product = BigInt(above) * BigInt(C);
  at("/body/C").value = C;
  at("/body/A").value = below === "1" ? String(product) : `${product}/${below}`;
}

const MEANT = /; did you mean '(.*)'\?$/;

/** Show each fault at the field that its pointer names, or at the part of the document that it is in. */
export function showFaults(faults) {
  for (const place of document.querySelectorAll("#form .fault")) place.textContent = "";
  for (const control of controls()) control.removeAttribute("aria-invalid");
  for (const { pointer = "", message } of faults) {
    let path = pointer;
    while (path.includes("/") && !at(path)) path = path.slice(0, path.lastIndexOf("/"));
    const control = at(path);
    control?.setAttribute("aria-invalid", "true");
    const place = (control && $(`${control.id}-fault`)) ?? $(`fault-${pointer.split("/")[1]}`) ?? $("fault-rest");
    place.append(place.textContent ? "; " : "", message);
    const meant = control?.dataset.kind === "formula" && message.match(MEANT);
    if (meant) {
      place.append(" ", h("button", { type: "button", class: "small", onclick: () => {
        control.value = meant[1];
        control.dispatchEvent(new Event("input", { bubbles: true }));
        control.focus();
      } }, "Use it"));
    }
  }
}

const DEFAULT_OUTPUTS = ["gamma", "omega"];
const NAME = /^[A-Za-z_]\w*$/;
/** Names that cannot be those of parameters in a call: its own, and words of Python. */
const TAKEN = new Set(["base", "body", "potential", "motion", "lam", "nu", "time", "start", "stop", "samples", "periods", "times", "accuracy", "tolerance", "relative", "tier", "method", "outputs", "parameters",
  "labels", "note", "and", "as", "assert", "async", "await", "break", "class", "continue", "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import", "in", "is", "lambda",
  "nonlocal", "not", "or", "pass", "raise", "return", "try", "while", "with", "yield", "None", "True", "False"]);
const LINE = 100;

function literal(value) {
  if (Array.isArray(value)) return `[${value.map(literal).join(", ")}]`;
  if (value === null) return "None";
  if (typeof value === "object") return `{${Object.entries(value).map(([name, part]) => `${JSON.stringify(name)}: ${literal(part)}`).join(", ")}}`;
  return typeof value === "boolean" ? (value ? "True" : "False") : JSON.stringify(value);
}

/** Return the arguments of a call that states a problem: [[name, text]]. */
function argumentsOf({ body, potential, motion = {}, time = {}, accuracy = null, outputs = DEFAULT_OUTPUTS, ...rest }) {
  const has = (object, ...names) => Object.keys(object).sort().join() === names.sort().join();
  const plainly = (name, object) => [[name, literal(object)]];
  const moments = ["AC", "ABC"].find((names) => has(body, ...names));
  const { type, expression, parameters = {}, ...more } = potential;
  const isFormula = type === "expression" && typeof expression === "string" && !Object.keys(more).length;
  const named = Object.entries(parameters);
  const short = named.every(([name]) => NAME.test(name) && !TAKEN.has(name) && new RegExp(`\\b${name}\\b`).test(expression));
  const curve = [["lam", "lambda"], ["nu", "nu"]].find(([, name]) => has(motion, "type", name) && motion.type === "planar");
  const spans = ["stop", "periods", "times"].filter((name) => time[name] !== undefined);
  const isSpan = spans.length === 1 && Object.keys(time).every((name) => [...spans, "samples"].includes(name)) && (spans[0] !== "times" || !time.samples);
  const [measure] = Object.keys(accuracy ?? {});
  return [
    ["body", moments ? `(${[...moments].map((name) => literal(body[name])).join(", ")})` : literal(body)],
    ["potential", literal(isFormula ? expression : potential)],
    ...(isFormula && named.length ? (short ? named.map(([name, value]) => [name, literal(value)]) : plainly("parameters", parameters)) : []),
    ...(curve ? [[curve[0], literal(motion[curve[1]])]] : plainly("motion", motion)),
    ...(isSpan ? Object.entries(time).map(([name, value]) => [name, literal(value)]) : plainly("time", time)),
    ...(accuracy === null ? [] : ["tolerance", "relative", "tier"].includes(measure) && has(accuracy, measure) ? [[measure, literal(accuracy[measure])]] : plainly("accuracy", accuracy)),
    ...(outputs.join() === DEFAULT_OUTPUTS.join() ? [] : plainly("outputs", outputs)),
    ...Object.entries(rest).map(([name, value]) => [name, literal(value)]),
  ];
}

/** Return the program that a person would write to solve a problem. */
export function asPython(problem, address) {
  const parts = argumentsOf(problem).map(([name, text]) => `${name}=${text}`);
  const inline = `m = c.solve(${parts.join(", ")})`;
  const call = inline.length <= LINE ? inline : `m = c.solve(\n${parts.map((part) => `    ${part},\n`).join("")})`;
  return `import polhode as ph\n\nc = ph.connect(${JSON.stringify(address)})\n${call}\nprint(m.period, m.energy, m.error)\n`;
}
