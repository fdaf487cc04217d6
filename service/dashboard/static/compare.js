// Solutions beside each other: the six variables of each over one stretch, and how far they are apart.
import { $, asked, exact, fill, get, h, motionText, number, potentialText, remember, say, troubleOf } from "./core.js";
import { draw, pointed } from "./chart.js";
import { between, logarithmic, namesOf, NAMES, samplesOf, SHOWN } from "./series.js";

const SAMPLES = 800;
const RECENT = 50;
const MOST = 5;
const MOST_PERIODS = 20; // of so many samples: of more, lines between them would not be the curve
const COLOURS = ["c2", "c3", "c4", "c5", "c6"];

const sameMotion = (one, other) => ["body", "potential", "motion"].every((part) => JSON.stringify(one.problem[part]) === JSON.stringify(other.problem[part]));
const short = ({ id, tier }) => `${tier} …${id.slice(-6)}`;

/** Prepare the comparison of a solution with others; return what renews it for a stretch of time. */
export async function comparison(solution, clock) {
  const form = $("compare");
  const known = new Map();
  let stretch = null;
  let asking = null;

  const chosen = () => [...new Set(asked().getAll("with"))].filter((id) => id !== solution.id).slice(0, MOST);
  const find = async (id) => {
    if (!known.has(id)) known.set(id, await get(`v1/solutions/${encodeURIComponent(id)}`));
    return known.get(id);
  };
  const choose = (ids) => { remember({ with: ids }); return renew(stretch); };

  async function renew(found) {
    stretch = found;
    asking?.abort();
    asking = new AbortController();
    const { signal } = asking;
    const ids = chosen();
    $("compare-charts").hidden = !ids.length;
    const { t } = stretch.columns;
    const names = namesOf(solution);
    const ask = (one, shared) => samplesOf(one.id, between(t[0], t.at(-1), `samples=${SAMPLES}`), shared, signal);
    let own = null;
    try {
      own = ids.length ? await ask(solution, names) : null;
    } catch (error) {
      if (signal.aborted) return;
      throw error;
    }
    const rows = await Promise.all(ids.map(async (id) => {
      try {
        const one = await find(id);
        const shared = names.filter((name) => namesOf(one).includes(name));
        if (!shared.length) return { id, one, refused: h("p", { class: "notice bad" }, "They have no variable in common.") };
        return { id, one, shared, isSame: sameMotion(solution, one), ...(await ask(one, shared)) };
      } catch (error) {
        if (signal.aborted) throw error;
        return { id, refused: troubleOf(error) };
      }
    })).catch(() => null);
    if (rows === null || signal.aborted) return;
    const others = rows.filter(({ refused }) => !refused).map((row) => ({ ...row, ...apart(own, row) }));
    fill($("compared"), rows.map(({ id, one }, k) => h("li", {}, h("button", { type: "button", class: "chip", "aria-label": `Compare no more with ${id}`,
      onclick: () => choose(chosen().filter((other) => other !== id)) },
    h("span", { class: `swatch ${COLOURS[k]}`, "aria-hidden": "true" }), one ? short(one) : id, h("span", { "aria-hidden": "true" }, " ×")))));
    fill($("compare-note"), rows.map((row) => row.refused ?? sentence(others.find(({ id }) => id === row.id))));
    $("compare-charts").hidden = !others.length;
    if (!others.length) return;
    const colour = ({ id }) => COLOURS[ids.indexOf(id)];
    await overlay(solution, names, own, others, colour, stretch);
    await differences(t, others, colour);
    for (const id of ["overlay", "apart"]) pointed($(id), clock);
    say($("compare-note").textContent);
  }

  const { items } = await get(`v1/solutions?limit=${RECENT}`);
  const others = items.filter(({ id }) => id !== solution.id);
  const option = (one) => h("option", { value: one.id }, `${potentialText(one.problem.potential)} · ${motionText(one.problem.motion)} · ${short(one)}`);
  const groups = [["The same motion", others.filter((one) => sameMotion(solution, one))], ["Other recent ones", others.filter((one) => !sameMotion(solution, one))]];
  fill(form.known, h("option", { value: "" }, others.length ? "a solution" : "there is no other yet"),
    groups.filter(([, found]) => found.length).map(([label, found]) => h("optgroup", { label }, found.map(option))));
  return renew;
}

/** Return how far two sets of samples are apart: at each time the largest difference, and in which variable. */
function apart(own, other) {
  const { t } = own.columns;
  const gap = new Float64Array(t.length);
  const where = new Array(t.length);
  for (const name of other.shared) {
    t.forEach((_, k) => {
      const off = Math.abs(own.columns[name][k] - other.columns[name][k]);
      if (where[k] === undefined || off > gap[k]) [gap[k], where[k]] = [off, name];
    });
  }
  const at = gap.reduce((most, value, k) => (value > gap[most] ? k : most), 0);
  return { gap, where, claimed: own.error + other.error, largest: gap[at], at: t[at], in: where[at] };
}

function sentence({ one, isSame, largest, claimed, at, in: name }) {
  const isWithin = largest <= claimed;
  const both = `the sum of both claimed errors, ${number(claimed, 2)}`;
  const verdict = isWithin ? `within ${both}: they agree.` : `more than ${both}: ${isSame ? "one of them is wrong" : "they are different motions"}.`;
  return h("p", { class: isSame && !isWithin ? "notice bad" : "notice" }, h("a", { href: `./solution?id=${one.id}` }, short(one)),
    `: the largest difference is ${number(largest, 2)}, in ${SHOWN[name]} at t = ${number(at, 6)}, ${verdict}`);
}

/** Draw each variable of all solutions in a picture of its own. */
function overlay(solution, names, own, others, colour, { columns: { t } }) {
  const period = Math.min(...[solution, ...others.map(({ one }) => one)].map(({ period: known }) => known?.value ?? Infinity));
  const isJoined = (exact(t.at(-1)) - exact(t[0])) / period <= MOST_PERIODS;
  return draw($("overlay"), (colours) => {
    const axes = {};
    const traces = [];
    names.forEach((name) => {
      const k = NAMES.indexOf(name);
      const [row, column] = [k % 3, k < 3 ? 0 : 1];
      const axis = k ? String(k + 1) : "";
      axes[`xaxis${axis}`] = { anchor: `y${axis}`, domain: column ? [0.56, 1] : [0, 0.44], range: [own.columns.t[0], own.columns.t.at(-1)], showticklabels: row === 2 };
      axes[`yaxis${axis}`] = { anchor: `x${axis}`, domain: [(2 - row) * 0.35, (2 - row) * 0.35 + 0.29], title: { text: SHOWN[name] }, nticks: 4 };
      const trace = (columns, word, shade, width, dash) => ({ x: columns.t, y: columns[name], xaxis: `x${axis}`, yaxis: `y${axis}`, name: word, legendgroup: word, showlegend: name === names[0],
        mode: isJoined ? "lines" : "markers", line: { color: shade, width, dash, simplify: false }, marker: { color: shade, size: 2.5 }, hovertemplate: `${SHOWN[name]} = %{y:.10g}<br>t = %{x:.8g}<extra>${word}</extra>` });
      traces.push(trace(own.columns, "this one", colours.c1, 3, "solid"));
      for (const other of others) if (other.columns[name]) traces.push(trace(other.columns, short(other.one), colours[colour(other)], 1.5, "dash"));
    });
    return { traces, layout: { ...axes, hovermode: "closest", dragmode: false, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, margin: { l: 58, r: 14, t: 34, b: 34 } } };
  });
}

/** Draw the largest difference at each time on a logarithmic axis, under the sum of both claimed errors. */
function differences(t, others, colour) {
  return draw($("apart"), (colours) => ({
    traces: others.flatMap((other) => {
      const shade = colours[colour(other)];
      const { columns, gap, where, claimed, one } = other;
      return [
        { x: columns.t, ...logarithmic(gap, where.map((name) => SHOWN[name])), name: short(one), mode: "markers", marker: { size: 3.5, color: shade } },
        { x: [t[0], t.at(-1)], y: [claimed, claimed], name: "sum of both claimed errors", mode: "lines", line: { color: shade, dash: "dash", width: 1.5 }, hovertemplate: `both claim ${number(claimed, 2)}<extra></extra>` },
      ];
    }),
    layout: { xaxis: { title: { text: "t" } }, yaxis: { type: "log", exponentformat: "power", title: { text: "difference" } }, hovermode: "closest", dragmode: false },
  }));
}
