// The catalogue: families, named cases, classical cases; each with an example that runs with one click.
import { $, fill, get, h, run, say, troubleOf } from "./core.js";
import { picture, pointsOf } from "./sphere.js";
import { solved, whyNot } from "./starting.js";

const POINTS = 201;

async function runExample(example, place, button) {
  button.disabled = true;
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
  } finally {
    button.disabled = false;
  }
}

function card({ title, formula, lines, source, example }) {
  const place = h("div", { class: "outcome", role: "status" });
  const button = h("button", { type: "button", class: "main small", onclick: (event) => runExample(example, place, event.currentTarget) }, "Run the example");
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
