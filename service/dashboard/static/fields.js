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
    place.textContent = [place.textContent, message].filter(Boolean).join("; ");
  }
}
