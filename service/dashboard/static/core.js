// What all pages share: elements, numbers, requests with the key of the tab, faults as text.

/** Return an element; strings become text, never markup. */
export function h(tag, attributes = {}, ...children) {
  const svg = tag.startsWith("svg:");
  const element = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag.slice(4)) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const $ = (id) => document.getElementById(id);
export const fill = (element, ...children) => element.replaceChildren(...children.flat().filter((child) => child != null));
export const asked = () => new URLSearchParams(location.search);

/** Keep in the address what is shown, so that it can be sent to others: a list stands several times, null nowhere. */
export function remember(shown) {
  const found = asked();
  for (const [name, values] of Object.entries(shown)) {
    found.delete(name);
    for (const value of [values ?? []].flat()) found.append(name, value);
  }
  history.replaceState(null, "", `?${found}`);
}

/** Renew what an element holds; whoever is at one of its controls stays there, or at the element if that one is gone. */
export function refill(element, ...children) {
  const nameOf = ({ tagName, id, dataset, name, href, ariaLabel, textContent }) => [tagName, id, dataset.id, name, href, ariaLabel ?? textContent].join("\n");
  const held = element.contains(document.activeElement) && document.activeElement !== element ? nameOf(document.activeElement) : null;
  fill(element, ...children);
  if (held === null) return;
  const again = [...element.querySelectorAll("a, button, input, summary")].find((one) => !one.disabled && nameOf(one) === held);
  (again ?? element).focus({ preventScroll: true });
}

/** Do some work while buttons cannot be pressed; a browser takes the focus from such a button, and it gets it back. */
export async function during(buttons, work) {
  const held = buttons.find((button) => button === document.activeElement);
  for (const button of buttons) button.disabled = true;
  try {
    return await work();
  } finally {
    for (const button of buttons) button.disabled = false;
    if (held?.isConnected && [document.body, held].includes(document.activeElement)) held.focus();
  }
}

/** Tell those who cannot see that something has changed. */
export function say(text) {
  $("said").textContent = text;
}

/** A refusal of the service: a problem document (RFC 9457). */
export class Refusal extends Error {
  constructor(problem, status) {
    super(problem.detail || problem.title || `status ${status}`);
    this.problem = problem;
    this.status = status;
    this.faults = problem.errors || [];
  }
}

const KEY = "polhode.key";
const key = () => sessionStorage.getItem(KEY);

/** Send a request to the API; ask for a key where one is needed, and again where too much is being read.
 * Raises Refusal, or TypeError without a connection. */
export async function request(path, { method = "GET", body, headers = {}, signal } = {}) {
  for (;;) {
    const sent = { Accept: "application/json", ...headers };
    const used = key();
    if (used) sent.Authorization = `Bearer ${used}`;
    if (body !== undefined) sent["Content-Type"] = "application/json";
    const answer = await fetch(path.replace(/^\//, ""), {
      method, headers: sent, signal, body: body === undefined ? undefined : JSON.stringify(body),
    });
    if (answer.ok) return answer;
    const problem = await answer.json().catch(() => ({ title: answer.statusText }));
    // A late refusal of what was sent without the key that has been typed meanwhile asks nobody again.
    if (answer.status === 401 && ((key() && key() !== used) || (await askKey(problem.detail)))) continue;
    if (answer.status === 503 && problem.type?.endsWith(":busy")) {
      await waitForTurn(Number(answer.headers.get("Retry-After")) || 2);
      signal?.throwIfAborted();
      continue;
    }
    throw new Refusal(problem, answer.status);
  }
}

/** Wait, and say why nothing is shown yet. */
async function waitForTurn(seconds) {
  const notice = h("p", { class: "notice", role: "status" }, `The service is busy with other requests; trying again in ${seconds} s.`);
  $("content").before(notice);
  await pause(1000 * seconds);
  notice.remove();
}

export const get = async (path, options) => (await request(path, options)).json();
export const post = async (path, body, options) => (await request(path, { ...options, method: "POST", body })).json();

let asking = null;

/** Open the dialog for the key; resolve to whether there is a new one. Requests that wait share one dialog. */
function askKey(why) {
  asking ??= new Promise((resolve) => {
    const dialog = $("key-dialog");
    if (why) $("key-why").textContent = `${why}. It is kept in this tab until you close it, and nowhere else.`;
    $("key-field").value = "";
    dialog.returnValue = "cancel";
    dialog.addEventListener("close", () => {
      const typed = $("key-field").value.trim();
      $("key-field").value = "";
      if (dialog.returnValue === "forget") sessionStorage.removeItem(KEY);
      if (dialog.returnValue === "use" && typed) sessionStorage.setItem(KEY, typed);
      asking = null;
      resolve(dialog.returnValue === "use" && typed !== "");
    }, { once: true });
    dialog.showModal();
  });
  return asking;
}

$("key-button").addEventListener("click", async () => {
  if (await askKey(key() ? "A key is in use. Type another one" : "Type a key")) location.reload();
});
// The first button of a form is what Enter presses: here that would forget the key.
$("key-field").addEventListener("keydown", (event) => {
  if (event.key !== "Enter") return;
  event.preventDefault();
  $("key-dialog").close("use");
});

/** Whether the key of the tab may not do what was asked: no fault of what was sent. */
export const isNotAllowed = (error) => error instanceof Refusal && error.status === 403 && Boolean(error.problem.needed_role);

/** Return what went wrong as text, each fault with the place it points to. */
export function troubleOf(error) {
  if (isNotAllowed(error)) return h("div", { class: "notice" }, `This needs a key with the role ${error.problem.needed_role}; the one in use may do less.`);
  if (error instanceof Refusal) {
    const faults = error.faults.map((fault) => h("li", {}, h("code", {}, fault.pointer || "/"), " ", fault.message));
    return h("div", { class: "notice bad" },
      h("p", {}, h("strong", {}, error.problem.title || "Refused"), error.faults.length ? "" : `: ${error.message}`),
      error.faults.length ? h("ul", {}, faults) : null);
  }
  return h("div", { class: "notice bad" }, h("p", {}, h("strong", {}, "No answer from the service"), ` (${error.message})`));
}

/** Run what fills a page; show its failure where the page would be, and try again when the service is back. */
export async function run(work, place = $("content")) {
  let shown = null;
  for (;;) {
    try {
      await work();
      shown?.remove();
      place.closest("main").setAttribute("aria-busy", "false");
      return;
    } catch (error) {
      shown?.remove();
      shown = error instanceof Refusal && error.status === 404 ? missing(error) : troubleOf(error);
      place.prepend(shown);
      place.closest("main").setAttribute("aria-busy", "false");
      if (error instanceof Refusal && error.status < 500) return;
      if (!(error instanceof Refusal || error instanceof TypeError)) throw error;
      await pause(2000);
    }
  }
}

/** Make the page say that there is no such thing, and where to look for it. */
function missing({ message }) {
  const list = document.querySelector("nav a[aria-current]");
  const what = document.querySelector("main .eyebrow")?.textContent.toLowerCase() ?? "thing";
  document.querySelector("main h1").textContent = `There is no such ${what}`;
  document.title = `Not found · polhode`;
  return h("p", {}, `It may have been deleted, or the address is incomplete: ${message}. `, h("a", { href: list.href }, `All ${list.textContent.toLowerCase()}`), ".");
}

/** Return a key for a request that must not happen twice. (randomUUID is there on secure origins only.) */
export const onceKey = () => [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");

/** Save some content as a file. */
export function save(content, name) {
  const link = h("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Save what the service answers as a file. */
export const download = async (path, name) => save(await (await request(path, { headers: { Accept: "*/*" } })).blob(), name);

export const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

/** Write a number for people: 2.4 × 10⁻¹⁶. */
export function number(value, digits = 6) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e7) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const [mantissa, exponent] = value.toExponential(Math.min(digits, 20) - 1).split("e");
  const short = String(Number(mantissa)).replace("-", "−");
  return `${short} × 10${[...String(Number(exponent))].map((sign) => RAISED[sign]).join("")}`;
}

/** Return a measured value with as many digits as its error leaves, and the error. */
export function measured({ value, error, radius }, unit = "") {
  const known = radius ?? error;
  const bound = Number(known);
  const digits = bound > 0 && Number(value) !== 0
    ? Math.max(1, Math.min(16, Math.ceil(Math.log10(Math.abs(Number(value)) / bound)) + 1)) : 16;
  const shown = typeof value === "string" && value.length > 17 ? `${value.slice(0, 17)}…` : number(Number(value), digits);
  return [h("span", { class: "value", title: String(value) }, shown, unit), " ",
    h("span", { class: "error" }, known === 0 ? "exact" : `± ${number(bound, 2)}`)];
}

/** Return how long ago an instant was, in words. */
export function ago(instant) {
  const seconds = Math.max(0, (Date.now() - Date.parse(instant)) / 1000);
  for (const [size, word] of [[86400, "day"], [3600, "hour"], [60, "minute"]]) {
    const count = Math.floor(seconds / size);
    if (count) return `${count} ${word}${count > 1 ? "s" : ""} ago`;
  }
  return "just now";
}

/** Return what a potential is, in a line, without the numbers that vary: those at ``pointers``. */
export function potentialText(potential, pointers = []) {
  const isFixed = (path) => !pointers.includes(`/potential/${path}`);
  const known = Object.entries(potential.parameters || {}).filter(([name]) => isFixed(`parameters/${name}`)).map(([name, value]) => (value === null ? name : `${name} = ${value}`));
  if (potential.type === "expression") return [potential.expression, ...known].join(",  ");
  const parts = Object.entries(potential).filter(([name]) => !["type", "parameters"].includes(name) && isFixed(name))
    .map(([name, value]) => `${name} = ${Array.isArray(value) ? `[${value.map((part, k) => (isFixed(`${name}/${k}`) ? part : "…")).join(", ")}]` : value}`);
  return `${potential.type}: ${[...parts, ...known].join(", ")}`;
}

/** Return how people call the number at a pointer. */
export function nameOf(pointer) {
  const parts = pointer.split("/").filter((part) => !["", "potential", "parameters", "body", "motion"].includes(part));
  const [first, place] = parts;
  return { lambda: "λ", nu: "ν", omega: "pqr"[place], gamma: `γ${"₁₂₃"[place]}` }[first] ?? (parts.join(" ") || pointer);
}

export const lengthOf = (axis) => axis.values?.length ?? (axis.linspace ?? axis.logspace ?? axis.uniform)[2];

/** Return words as a list in a sentence: a, b and c. */
export const listed = (words) => [words.slice(0, -1).join(", "), words.at(-1)].filter(Boolean).join(" and ");

/** Return what a sweep is, in a line: its potential without what varies, and its axes. */
export const sweepText = ({ base, axes }) => `${potentialText(base.potential, axes.map(({ pointer }) => pointer))}, over ${listed(axes.map(({ pointer }) => nameOf(pointer)))}`;

/** Return what an axis goes through, in a line. */
export function axisText(axis) {
  const count = lengthOf(axis);
  const [low, high] = axis.values ? [axis.values[0], axis.values.at(-1)] : axis.linspace ?? axis.logspace ?? axis.uniform;
  const how = axis.logspace ? ", logarithmic" : axis.uniform ? ", drawn" : "";
  return `${nameOf(axis.pointer)} ${count > 1 ? `from ${low} to ${high}` : `= ${low}`} (${count.toLocaleString("en")} ${count > 1 ? "values" : "value"}${how})`;
}

/** Return what a motion is, in a line. */
export function motionText(motion) {
  if (motion.type === "classical") return `classical case: ${motion.case}`;
  if (motion.type === "state") return `from the state ω = (${motion.omega.join(", ")}), γ = (${motion.gamma.join(", ")})`;
  return motion.nu === undefined ? `planar, λ = ${motion.lambda}` : `planar, ν = ${motion.nu}`;
}

/** What a motion does at an end of its range, in the words of the API and the glossary. */
export const ENDS = {
  rest: "turns at rest", equator: "crosses the equator", pole: "passes a pole", equilibrium: "tends to an equilibrium", standstill: "comes to a standstill",
  collision: "runs into a collision", edge: "reaches the edge of the domain",
};

/** What a motion is against leaving its plane. */
export const STABILITY = { stable: "linearly stable", unstable: "linearly unstable", marginal: "not decided by the linear equation" };

export const bodyText = (body) => ["A", "B", "C"].filter((name) => body[name] != null).map((name) => `${name} = ${body[name]}`).join(", ");

/** Return a button that copies what ``text`` returns. */
export function copier(label, text) {
  return h("button", { type: "button", class: "quiet", onclick: async (event) => {
    const button = event.currentTarget;
    try {
      await navigator.clipboard.writeText(text());
      button.textContent = "Copied";
    } catch {
      button.textContent = "Not allowed by the browser";
    }
    say(button.textContent);
    setTimeout(() => { button.textContent = label; }, 1500);
  } }, label);
}

/** Return the nearest double to a number as documents write it: 3, "17/10", "1e-3". */
export function exact(value) {
  const [above, below = "1"] = String(value).split("/");
  return Number(above) / Number(below);
}

const PICTURES = { svg: "SVG, lines and text", png: "PNG, 600 dpi", pdf: "PDF, a picture of 600 dpi" };
const FILMS = { gif: "GIF, moving", webm: "WebM, moving" };

/** Give a picture a menu that saves it as a file; the module that writes files comes when the first one is wanted. */
export function exportable(place, { moves = false } = {}) {
  const host = place.closest(".heat") ?? place;
  if (host.parentElement.classList.contains("figure")) return;
  const note = h("span", { class: "hint", role: "status" });
  const save = (kind) => async ({ currentTarget }) => {
    note.textContent = kind in FILMS ? "Drawing…" : "";
    await during([currentTarget], async () => {
      const { saved } = await import("./export.js");
      await saved(place, kind, [document.querySelector("main h1").textContent, asked().get("id")?.slice(-6), place.id], (share) => { note.textContent = `${Math.round(100 * share)} %`; });
      note.textContent = "";
      menu.open = false;
      menu.firstChild.focus();
    }).catch((error) => { note.textContent = `Not saved: ${error.message}`; });
  };
  const menu = h("details", { class: "export",
    onkeydown: (event) => { if (event.key === "Escape") { menu.open = false; menu.firstChild.focus(); } },
    onfocusout: ({ relatedTarget }) => { if (relatedTarget && !menu.contains(relatedTarget)) menu.open = false; } },
  h("summary", { "data-export": "", "aria-label": "Save this picture", title: "Save this picture" }, "⤓"),
  h("ul", {}, Object.entries({ ...PICTURES, ...(moves ? FILMS : {}) }).map(([kind, name]) => h("li", {}, h("button", { type: "button", class: "quiet", "data-export": kind, onclick: save(kind) }, name)))), note);
  const figure = h("div", { class: "figure" });
  host.replaceWith(figure);
  figure.append(host, menu);
}

/** Return the name of a known case or integral for people. */
export const personText = (name) => name.split("_").map((word) => word[0].toUpperCase() + word.slice(1)).join(" and ");

/** Return a line with the cases that a problem is, by their names; `null` if it is none. */
export function knownCases(known) {
  if (!known?.length) return null;
  return h("p", { class: "hint" }, `Known: ${known.map(({ name, source }) => `the case of ${personText(name)} (${source})`).join(", ")}.`);
}

/** The path of each kind of question. */
export const STUDIES = { integral: "integrals", integrals: "integrals/searches", potentials: "potentials/searches", numbers: "searches" };

/** Return a number with its noun, which has an s unless it is one. */
export const counted = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;

/** Return what the answer to a question is, in some words. */
export function answerText({ verdict, integrals, special, dimension, solutions, rest }) {
  if (verdict) return verdict.replaceAll("_", " ");
  if (integrals) return `${counted(integrals.length, "integral")}, ${counted(special.length, "special case")}`;
  return solutions ? `${counted(solutions.length, "solution")}${rest === "proved_empty" ? ", no others" : ""}` : counted(dimension, "potential");
}

/** Return what a question is, in a line. */
export function studyText({ what, potential, degree, body, base, unknowns, wanted, relation, function: asked }) {
  if (what === "integral") return `${relation ? "does this stay 0:" : "is this an integral:"} ${asked}`;
  if (what === "integrals") return `integrals to degree ${degree.omega} in ω, ${degree.gamma} in γ: ${potentialText(potential)}`;
  if (what === "potentials") return `potentials to degree ${degree}, ${bodyText(body ?? {}) || "every A/C"}`;
  return `${listed(wanted.map(({ of, equals }) => `${of} = ${equals}`))} over ${listed(unknowns.map(({ pointer }) => nameOf(pointer)))}: ${potentialText(base.potential)}`;
}

// On narrow screens the names of the pages stand in one line that scrolls.
const here = document.querySelector("nav [aria-current]");
if (here) document.querySelector("nav").scrollLeft = here.offsetLeft - 60;

// A tour goes through several pages.
if (sessionStorage.getItem("polhode.tour")) import("./tours.js").then(({ resume }) => resume());
