// What each tier reaches and costs here: the table of the latest calibration.
import { $, fill, get, h, number, run } from "./core.js";
import { draw } from "./chart.js";

const SYMBOLS = ["circle", "diamond", "square", "triangle-up", "x", "star"];
const HEADS = ["Tier", "Motion", "Family", "Error", "Claimed error", "Seconds", "Seconds for 1000 samples", "Reference"];

run(async () => {
  const { rows, unavailable, machine, date, source, version, tolerances } = await get("v1/accuracy");
  $("where").textContent = `${source === "shipped" ? "Measured before it was shipped" : "Measured here"}, ${date.slice(0, 10)}, version ${version}, on ${machine.cpus} × ${machine.model}.`;
  fill($("table"), h("table", {}, h("caption", { class: "unseen" }, "Errors and times of the tiers"), h("thead", {}, h("tr", {}, HEADS.map((head) => h("th", { scope: "col" }, head)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, [row.tier, row.kind, row.family, ...[row.error, row.claimed_error, row.seconds, row.seconds_per_1000].map((value) =>
      h("span", { class: "value" }, number(value, 2))), row.reference].map((cell) => h("td", {}, cell)))))));
  fill($("unavailable"), unavailable.map((row) => h("li", {}, `${row.tier}, ${row.kind}, ${row.family}: ${row.detail}`)));
  const kinds = [...new Set(rows.map((row) => row.kind))];
  await draw($("picture"), (colours) => ({
    traces: Object.keys(tolerances).map((tier, k) => {
      const of = rows.filter((row) => row.tier === tier);
      // An error of exactly zero, found by comparing with the same digits, has no logarithm: the proven bound stands in.
      return { x: of.map((row) => row.seconds), y: of.map((row) => row.error || row.claimed_error), name: tier, mode: "markers", type: "scatter",
        marker: { size: 9, color: colours[`c${k + 1}`], symbol: of.map((row) => SYMBOLS[kinds.indexOf(row.kind) % SYMBOLS.length]), opacity: 0.85 },
        text: of.map((row) => `${row.kind}, ${row.family}`), hovertemplate: "%{text}<br>%{x:.3g} s, error %{y:.2g}<extra></extra>" };
    }),
    layout: { xaxis: { type: "log", title: { text: "seconds" }, dtick: 1, exponentformat: "power" }, yaxis: { type: "log", title: { text: "largest error" }, exponentformat: "power" }, hovermode: "closest", dragmode: false },
  }));
});
