// A verdict: its proof or its counterexample, its formulas, and what it means on the sphere.
import { $, exact, fill, h, knownCases, number } from "./core.js";
import { turnable } from "./sphere.js";

const MATHML = "http://www.w3.org/1998/Math/MathML";
const ELEMENTS = new Set(["math", "mrow", "mi", "mn", "mo", "mtext", "mfrac", "msup", "msub", "msubsup", "msqrt", "mroot", "mover", "munder",
  "munderover", "mspace", "mstyle", "mtable", "mtr", "mtd", "mpadded"]);
const ATTRIBUTES = ["display", "form", "stretchy", "mathvariant", "fence", "separator", "lspace", "rspace", "width"];

/** Return MathML as elements, built one by one: nothing else that the text may hold becomes an element. */
export function formula(text) {
  const parsed = new DOMParser().parseFromString(text, "application/xml").documentElement;
  const copied = (node) => {
    if (node.nodeType === Node.TEXT_NODE) return document.createTextNode(node.textContent);
    if (node.nodeType !== Node.ELEMENT_NODE || node.namespaceURI !== MATHML || !ELEMENTS.has(node.localName)) return document.createTextNode("");
    const element = document.createElementNS(MATHML, node.localName);
    for (const name of ATTRIBUTES) if (node.hasAttribute(name)) element.setAttribute(name, node.getAttribute(name));
    element.append(...[...node.childNodes].map(copied));
    return element;
  };
  return copied(parsed);
}

const PROOFS = {
  symbolic: "the compatibility equation is satisfied identically: proved with exact numbers",
  counterexample: "at one point the residual of the compatibility equation is certainly not zero",
  numeric: "no counterexample was found, which is not a proof",
};
const LEAST_SIZE = 0.6; // of a formula's letters: smaller ones cannot be read
const FINE = 10n ** 40n; // parts of one
const WANTED = ["h", "F", "G", "curve", "p_squared"];

const PARTS = { potential: "the potential", body: "the body" };

/** Show a verdict, or what it waits for; ``use(formula)`` and ``useRatio(ratio)`` put a formula and A/C into the form. */
export function showVerdict(found, faults, use, useRatio) {
  if (found === null) {
    fill($("verdict"), h("p", { class: "notice" }, "The verdict waits for ", [...new Set(faults.map(({ pointer = "" }) => PARTS[pointer.split("/")[1]] ?? "the problem"))].join(" and ") || "the problem", "."),
      faults.slice(0, 3).map(({ message }) => h("p", { class: "hint" }, message)));
    return;
  }
  const { verdict, proof, counterexample, evidence, nearest, ratios, known_cases: known } = found;
  const words = { admissible: "Admissible", inadmissible: "Not admissible", undecided: "Undecided" };
  fill($("verdict"),
    h("p", { class: `verdict ${verdict}` }, h("strong", {}, words[verdict] ?? verdict), ` — ${PROOFS[proof] ?? proof}.`),
    counterexample ? h("p", {}, `At γ = (${counterexample.g.join(", ")}) the residual is `,
      h("span", { class: "value" }, `${number(Number(counterexample.residual.mid), 10)} ± ${number(Number(counterexample.residual.rad), 2)}`), ".") : null,
    evidence?.points ? h("p", { class: "hint" }, `Checked ${evidence.points} points with ${evidence.bits} bits; the largest enclosure of a residual is ${evidence.largest_enclosure}.`) : null,
    knownCases(known),
    nearest ? nearestOne(nearest, use) : null,
    ratios ? otherBodies(ratios, useRatio) : null);
}

/** Return the nearest admissible polynomial, how far it is, and what puts it into the form. */
function nearestOne({ expression, expression_named: named, relative_squared_distance: squared, degree }, use) {
  const [above, below = "1"] = squared.split("/").map(BigInt); // hundreds of digits, maybe: more than a double holds
  const distance = Math.sqrt(Number((above * FINE) / BigInt(below)) / Number(FINE));
  return h("p", {}, `The nearest admissible polynomial up to degree ${degree}: `, h("code", {}, named ?? expression),
    `. In the mean square over the sphere it differs from the potential by ${number(100 * distance, 2)} %. `,
    h("button", { type: "button", class: "small", onclick: () => use(named ?? expression) }, "Use this"));
}

/** Return for which bodies the potential would be admissible, each with what puts it into the form. */
function otherBodies({ ratios, others }, useRatio) {
  const buttons = ratios.map((ratio) => h("button", { type: "button", class: "small", onclick: () => useRatio(ratio) }, `Use A/C = ${ratio}`));
  const found = [...ratios.map((ratio) => `A/C = ${ratio}`), ...others.map((polynomial) => `A at the roots of ${polynomial}`)];
  return h("p", {}, found.length ? `For ${found.join(" and ")} it would be admissible, for no other ratio of the moments. ` : "There is no ratio A/C for which it would be admissible.", buttons);
}

/** Show h, F, G and what else is known of the motion; of several ways to write one, that with the parameters' names comes first. */
export function showFormulas(formulas) {
  const shown = WANTED.map((name) => formulas.find((candidate) => candidate.name === name && candidate.formats.mathml)).filter(Boolean);
  fill($("formulas"), shown.map((one) => inLines(formula(one.formats.mathml))));
  for (const line of $("formulas").children) { // a long fraction has no place to be broken at
    const share = line.clientWidth / line.scrollWidth;
    if (share < 1) line.style.fontSize = `${Math.max(LEAST_SIZE, share)}em`;
  }
}

/** Return a formula whose sum goes on in the next line where it is too long for one. */
function inLines(math) {
  const terms = [[]];
  for (const node of [...math.childNodes]) {
    if (node.localName === "mo" && "+−-".includes(node.textContent) && node.getAttribute("form") !== "prefix") {
      node.setAttribute("form", "infix"); // at the beginning of a term it would be that of a sign
      terms.push([]);
    }
    terms.at(-1).push(node);
  }
  return h("div", { class: "formula-line" }, terms.map((nodes) => {
    const term = document.createElementNS(MATHML, "math");
    term.setAttribute("displaystyle", "true");
    term.append(...nodes);
    return term;
  }));
}

/** Draw the curve |γ₃| = λ |γ₁|^(C/A), the part that the motion fills, and a counterexample, on the sphere. */
export function showSphere(verdict, problem, range) {
  const curves = [];
  const marks = [];
  if (verdict?.counterexample) {
    const point = verdict.counterexample.g.map(exact);
    marks.push({ point, kind: "wrong", title: "the point that refutes it" });
  } else if (problem.motion?.type === "planar" && problem.motion.lambda !== undefined) {
    const [A, C, lambda] = [problem.body.A, problem.body.C, problem.motion.lambda].map(exact);
    if (A > 0 && C > 0 && lambda > 0) {
      const [one, three] = [problem.motion.g1_sign ?? 1, problem.motion.g3_sign ?? 1];
      for (const side of [1, -1]) {
        curves.push({ points: arc(lambda, C / A, [0, 1], one, three, side), kind: "faint" });
        if (range) curves.push({ points: arc(lambda, C / A, range.g1.map(Math.abs).sort((x, y) => x - y), one, three, side) });
      }
    }
  }
  turnable($("sphere"), { curves, marks, labels: ["γ₁", "γ₂", "γ₃"], alt: "The curve of the motion on the unit sphere" });
}

function arc(lambda, power, [low, high], one, three, side) {
  const points = [];
  for (let k = 0; k <= 160; k += 1) {
    const g1 = low + (high - low) * Math.sin((k * Math.PI) / 320) ** 2;
    const g3 = lambda * g1 ** power;
    const rest = 1 - g1 * g1 - g3 * g3;
    if (rest >= -1e-9) points.push([one * g1, side * Math.sqrt(Math.max(0, rest)), three * g3]);
  }
  return points;
}
