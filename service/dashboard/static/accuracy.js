// What each tier reaches and costs here: the table of the latest calibration.
import { $, fill, get, h, number, run, say } from "./core.js";
import { draw } from "./chart.js";

const SYMBOLS = ["circle", "diamond", "square", "triangle-up", "x", "star"];
const LINES = ["solid", "dash", "dot", "dashdot"];
const WORTH = 0.8; // of the seconds of the next better tier: one that takes more saves no time
const QUIET = 1.5; // load average above which times are not those of a quiet machine
const HEADS = ["Tier", "Motion", "Family", "Error", "Claimed error", "Reference", "Its error", "Seconds for 1000 samples", "For each 1000 more"];
const form = $("choice");
let show = () => {};
form.addEventListener("change", () => show());
form.addEventListener("submit", (event) => event.preventDefault());

const table = (caption, heads, rows) => h("table", {}, h("caption", { class: "unseen" }, caption), h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
  h("tbody", {}, rows.map((cells) => h("tr", {}, cells.map((cell) => h("td", {}, cell))))));
const figure = (value) => h("span", { class: "value" }, number(value, 2));

/** The service's own estimate: fewer than 1000 samples cost as much as 1000. */
const secondsFor = (row, samples) => row.seconds + Math.max(0, samples / 1000 - 1) * row.seconds_per_1000;

/** Show the costs of a number of samples, from the fastest motion to the slowest, for each tier. */
function showCosts(rows, tiers, samples) {
  const lines = tiers.map((tier) => [tier, rows.filter((row) => row.tier === tier).map((row) => secondsFor(row, samples)).sort((left, right) => left - right)]).filter(([, all]) => all.length);
  fill($("costs"), table("Seconds of each tier", ["Tier", `Seconds for ${samples.toLocaleString("en")} samples`, "Milliseconds for each 1000 samples more"], lines.map(([tier, all]) => {
    const more = rows.filter((row) => row.tier === tier).map((row) => 1000 * row.seconds_per_1000).sort((left, right) => left - right);
    const span = (values) => h("span", { class: "value" }, values.length > 1 ? `${number(values[0], 2)} to ${number(values.at(-1), 2)}` : number(values[0], 2));
    return [tier, span(all), span(more)];
  })));
}

const where = ({ date, version, machine }) => `${date.slice(0, 10)}, version ${version}, on ${machine.cpus} × ${machine.model ?? "an unnamed processor"}, ${machine.system}`;

/** Say on how many of the shown problems a tier is worth its digits: on the others the next better one takes no longer. */
function showSavings(rows, tiers) {
  const of = (tier) => rows.filter((row) => row.tier === tier);
  const alike = (one) => (other) => one.kind === other.kind && one.family === other.family;
  fill($("savings"), tiers.slice(0, -1).map((tier, k) => {
    const pairs = of(tier).map((row) => [row, of(tiers[k + 1]).filter(alike(row))[of(tier).filter(alike(row)).indexOf(row)]]).filter(([, better]) => better);
    const faster = pairs.filter(([row, better]) => row.seconds < WORTH * better.seconds);
    const names = [...new Set(faster.map(([row]) => `${row.family}, ${row.kind}`))];
    return pairs.length ? h("li", {}, `${tier} is clearly faster than ${tiers[k + 1]} on ${faster.length} of ${pairs.length} problems${faster.length && faster.length < pairs.length ? ` (${names.join("; ")})` : ""}.`) : null;
  }).filter(Boolean));
}

/** Show ways to the same samples beside each other, each with a mark of its own, and what each output adds. */
async function showComparison(comparison) {
  const { ways, outputs, problem, load } = comparison;
  $("compared-where").textContent = `${problem} Measured before it was shipped, ${where(comparison)}, load ${number(load, 2)}${load > QUIET ? ": on a busy machine, where only ratios mean something" : ""}.`;
  fill($("ways-table"), table("Methods", ["Method", "Tier or tolerance", "Seconds", "Error"], ways.map(({ way, setting, seconds, error }) => [way, setting, figure(seconds), figure(error)])));
  fill($("outputs"), table("Outputs", ["Motion", "Output", "Seconds of the job", "Added"], outputs.map(({ problem: name, output, seconds, added }) =>
    [name, output, figure(seconds), added === null ? "–" : figure(added)])));
  const names = [...new Set(ways.map(({ way }) => way))];
  await draw($("ways"), (colours) => ({
    traces: names.map((name, k) => {
      const of = ways.filter(({ way }) => way === name);
      return { x: of.map(({ seconds }) => seconds), y: of.map(({ error }) => error), text: of.map(({ setting }) => setting), name, mode: "lines+markers",
        line: { color: colours[`c${k + 1}`], width: 1.4, dash: LINES[k % LINES.length] }, marker: { size: 9, symbol: SYMBOLS[k % SYMBOLS.length] },
        hovertemplate: `${name}, %{text}<br>%{x:.3g} s, error %{y:.2g}<extra></extra>` };
    }),
    layout: { xaxis: { type: "log", title: { text: "seconds" }, dtick: 1, exponentformat: "power" }, yaxis: { type: "log", title: { text: "largest error" }, exponentformat: "power" }, hovermode: "closest", dragmode: false },
  }));
}

run(async () => {
  const answer = await get("v1/accuracy");
  const { rows: all, unavailable, source, repetitions, tolerances } = answer;
  $("where").textContent = `${source === "shipped" ? "Measured before it was shipped" : "Measured here"}, ${where(answer)}; medians of ${repetitions}.`;
  fill($("unavailable"), unavailable.map((row) => h("li", {}, `${row.tier}, ${row.kind}, ${row.family}: ${row.detail}`)));
  const tiers = Object.keys(tolerances);
  const values = (name) => [...new Set(all.map((row) => row[name]))];
  // Once: somebody may have chosen by the time that this is tried again.
  for (const name of ["kind", "family"]) if (!form[name].options.length) fill(form[name], h("option", { value: "" }, "any"), values(name).map((value) => h("option", { value }, value)));
  const kinds = values("kind");

  show = async () => {
    const { kind, family, samples: typed } = Object.fromEntries(new FormData(form));
    if (!form.reportValidity()) return;
    const samples = Number(typed);
    const rows = all.filter((row) => (!kind || row.kind === kind) && (!family || row.family === family));
    fill($("table"), table("Errors and times of the tiers", HEADS, rows.map((row) =>
      [row.tier, row.kind, row.family, figure(row.error), figure(row.claimed_error), row.reference, figure(row.reference_error), figure(row.seconds), figure(row.seconds_per_1000)])));
    showCosts(rows, tiers, samples);
    showSavings(rows, tiers);
    say(`${rows.length} measurements`);
    await draw($("picture"), (colours) => ({
      traces: [...tiers.map((tier, k) => {
        const of = rows.filter((row) => row.tier === tier);
        // An error of exactly zero, found by comparing with the same digits, has no logarithm: the proven bound stands in.
        const errors = of.map((row) => row.error || row.claimed_error);
        return { x: of.map((row) => secondsFor(row, samples)), y: errors, name: tier, mode: "markers", type: "scatter",
          marker: { size: 9, color: colours[`c${k + 1}`], symbol: of.map((row) => SYMBOLS[kinds.indexOf(row.kind) % SYMBOLS.length]), opacity: 0.85 },
          error_y: { type: "data", symmetric: false, array: of.map((row, n) => Math.max(0, row.claimed_error - errors[n])), arrayminus: of.map(() => 0), thickness: 1, width: 3, color: colours[`c${k + 1}`] },
          showlegend: true, text: of.map((row) => `${row.kind}, ${row.family}<br>claimed ${row.claimed_error.toExponential(1)}`), hovertemplate: "%{text}<br>%{x:.3g} s, error %{y:.2g}<extra></extra>" };
      }), ...kinds.filter((one) => rows.some((row) => row.kind === one)).map((one) => ({ x: [null], y: [null], name: one, mode: "markers", hoverinfo: "skip",
        marker: { size: 9, color: colours.paper, symbol: SYMBOLS[kinds.indexOf(one) % SYMBOLS.length], line: { color: colours.ink, width: 1.6 } } }))],
      layout: { xaxis: { type: "log", title: { text: `seconds for ${samples.toLocaleString("en")} samples` }, dtick: 1, exponentformat: "power" }, yaxis: { type: "log", title: { text: "largest error" }, exponentformat: "power" }, hovermode: "closest", dragmode: false,
        shapes: tiers.map((tier, k) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: tolerances[tier], y1: tolerances[tier], line: { color: colours[`c${k + 1}`], width: 1, dash: "dot" } })) },
    }));
  };
  await show();
  await showComparison(answer.comparison);
});
