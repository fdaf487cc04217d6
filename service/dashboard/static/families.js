// The catalogue: families, named cases, classical cases; each with an example that runs with one click.
import { $, during, exact, fill, get, h, run, say, troubleOf } from "./core.js";
import { picture, pointsOf } from "./sphere.js";
import { solved, whyNot } from "./starting.js";

const POINTS = 201;

/** Return the curve of a planar motion on the unit sphere, |γ₃| = λ |γ₁|^(C/A), through the equator of γ₁ = 0 and back. */
function curveOf({ body, motion }) {
  if (motion?.type !== "planar") return null;
  // For A = 2C the curve is γ₃² = ν γ₁.
  const [A, C, size] = [body.A, body.C, motion.nu ?? motion.lambda].map(exact);
  const lambda = motion.nu === undefined ? size : Math.sqrt(Math.abs(size));
  const [one, three] = [motion.nu === undefined ? motion.g1_sign ?? 1 : Math.sign(size), motion.g3_sign ?? 1];
  const rest = (g1) => 1 - g1 * g1 - (lambda * g1 ** (C / A)) ** 2;
  let [low, high] = [0, 1];
  for (let k = 0; k < 60; k += 1) {
    const middle = (low + high) / 2;
    if (rest(middle) > 0) low = middle;
    else high = middle;
  }
  return Array.from({ length: POINTS }, (_, k) => {
    const turn = (Math.PI * k) / (POINTS - 1);
    const g1 = low * Math.sin(turn) ** 2;
    return [one * g1, Math.sign(Math.cos(turn)) * Math.sqrt(Math.max(0, rest(g1))), three * lambda * g1 ** (C / A)];
  });
}

async function runExample(example, place) {
  fill(place, h("p", { class: "hint" }, "Computing…"));
  try {
    const job = await solved(example);
    if (!job.solution) {
      fill(place, h("p", { class: "fault" }, whyNot(job)));
      return;
    }
    const { columns } = await get(`v1/solutions/${job.solution}/trajectory?columns=t,g1,g2,g3`);
    fill(place, h("a", { href: `./solution?id=${job.solution}` },
      h("span", { class: "thumb" }, picture([{ points: pointsOf(columns, ["g1", "g2", "g3"], POINTS) }], { alt: "Path of the vertical" })), h("span", {}, "See the solution")));
    say("the example is solved");
  } catch (error) {
    fill(place, troubleOf(error));
  }
}

function card({ title, formula, lines, source, example }) {
  const place = h("div", { class: "outcome", role: "status" });
  const curve = example && curveOf(example);
  if (curve) fill(place, h("span", { class: "thumb" }, picture([{ points: curve }], { alt: "The curve of the planar motions of the example" })));
  const button = h("button", { type: "button", class: "main small", onclick: ({ currentTarget }) => during([currentTarget], () => runExample(example, place)) }, "Run the example");
  return h("li", { class: "card" }, h("h3", {}, title), formula ? h("p", {}, h("span", { class: "formula" }, formula)) : null,
    h("ul", { class: "plain" }, lines.filter(Boolean).map((line) => h("li", {}, line))), h("p", { class: "hint" }, source), place,
    example && h("div", { class: "row" }, button, h("a", { href: `./workbench#${encodeURIComponent(JSON.stringify(example))}`, "aria-label": `${title}: open in the workbench` }, "Open in the workbench")));
}

run(async () => {
  const { items, cases, classical } = await get("v1/families");
  fill($("families"), items.map((one) => card({ ...one, formula: one.potential === one.type ? null : one.potential, lines: one.conditions })));
  fill($("cases"), cases.map((one) => card({ ...one, lines: [one.special] })));
  fill($("classical"), classical.map((one) => card({ ...one, formula: one.conditions.join(",  "), lines: [`Real for ${one.real}.`, `Functions: ${one.functions}.`, one.stability],
    source: [one.author, one.year].filter(Boolean).join(", ") })));
});
