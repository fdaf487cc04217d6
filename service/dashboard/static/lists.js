// Solutions, jobs, studies and sweeps as tables; the address holds the question, so it can be sent to others.
import { $, ago, answerText, asked, download, during, fill, get, h, measured, motionText, number, potentialText, refill, Refusal, request, run, say, studyText } from "./core.js";
import { allBox, boxOf, labelsOf, listen, refused, settled } from "./chosen.js";
import { follow } from "./follow.js";

const LIVE = ["queued", "running"];
const LIMIT = 25;
/** Labels on the page that are counted, too. */
const MOST_LABELS = 3;

const states = { queued: "waits", running: "runs", succeeded: "solved", failed: "failed", cancelled: "cancelled" };
const state = (word) => h("span", { class: `state ${word}` }, states[word] ?? word);
const link = (path, ...content) => h("a", { href: path }, ...content);
const family = (problem) => h("span", { class: "formula" }, potentialText(problem.potential));

/** Each column: its title, the fact by which it is sorted, and its cell. */
const POTENTIAL = (path) => ["Potential", "family", (one) => (path(one) ? link(path(one), family(one.problem)) : family(one.problem))];
const MOTION = ["Motion", "/motion/lambda", (one) => motionText(one.problem.motion)];
const WHEN = ["When", "created_at", (one) => h("time", { datetime: one.created_at, title: one.created_at }, ago(one.created_at))];
const STATE = ["State", "state", (one) => state(one.state)];
const CANCEL = ["", null, (one) => (LIVE.includes(one.state) ? stopper(`v1/${name}/${one.id}/cancel`) : "")];
const SOLUTIONS = {
  example: "period<5, tier in (standard, high)",
  facets: ["family", "tier", "method", "aperiodic", "stability.verdict"],
  orders: { "created_at": "oldest first", period: "shortest period", "-period": "longest period", energy: "lowest energy", "-energy": "highest energy", error: "smallest error", "tier,-error": "by tier, in each the largest error" },
  columns: [POTENTIAL((one) => `./solution?id=${one.id}`), MOTION, ["Period", "period", (one) => (one.period ? measured(one.period) : one.aperiodic ?? "–")],
    ["Energy", "energy", (one) => (one.energy ? number(one.energy.value, 6) : "–")], ["Error", "error", (one) => h("span", { class: "value" }, number(one.error, 2))], ["Tier", "tier", (one) => one.tier], WHEN],
};
const JOBS = {
  example: "state in (failed, cancelled), family=expression",
  facets: ["state", "family", "error.code"],
  orders: { created_at: "oldest first", "-seconds": "slowest", seconds: "fastest", "-attempt": "most attempts", "state,-created_at": "by state" },
  columns: [STATE, POTENTIAL((one) => one.solution && `./solution?id=${one.solution}`), MOTION, ["What happened", "error.code", what], ["Attempts", "attempt", attempts], WHEN, CANCEL],
};
const STUDIES = {
  example: "state in (failed, cancelled), created_at>=2026-01-01",
  facets: [],
  orders: { created_at: "oldest first", "-seconds": "slowest", "-attempt": "most attempts", "state,-created_at": "by state" },
  columns: [STATE, ["Question", null, (one) => link(`./study?id=${one.id}`, h("span", { class: "formula" }, studyText(one.problem)))],
    ["What happened", "error.code", what], ["Attempts", "attempt", attempts], WHEN, CANCEL],
};
const SWEEPS = {
  example: "points>=1000, state in (running, succeeded)",
  facets: [],
  orders: { created_at: "oldest first", "-points": "most points", "-refused": "most refused points", "-seconds": "slowest" },
  columns: [STATE, ["Sweep", "family", (one) => sweepLink(one)], ["Points", "points", (one) => one.points.toLocaleString("en")],
    ["Refused", "refused", (one) => one.refused.toLocaleString("en")], ["Progress", "done", (one) => h("progress", { max: 1, value: one.progress, "aria-label": "Progress" })], WHEN, CANCEL],
};
const [list, kind] = { "/jobs": ["jobs", JOBS], "/studies": ["studies", STUDIES], "/sweeps": ["sweeps", SWEEPS] }[new URL(location).pathname.replace(/^.*(?=\/)/, "")] ?? ["solutions", SOLUTIONS];
const name = list === "studies" ? "jobs" : list; // of the resource
const ofKind = list === "studies" ? { kind: "study" } : {};
const { sweepLink } = name === "sweeps" ? await import("./sweeps.js") : {};

/** The codes of failures that say little by themselves. */
const WHY = {
  accuracy_not_met: "The accuracy was not reached", certified_unavailable: "This motion cannot be enclosed", motion_ended: "The motion ends before the last time",
  lost_worker: "Its workers died", time_limit: "It took too long", memory_limit: "It needed too much memory", internal_error: "A bug of the service",
};

/** Say in words why a job is where it is. */
function what(job) {
  if (job.error) {
    const code = String(job.error.code ?? "failed");
    const plain = code.replaceAll("_", " ");
    return [h("strong", {}, WHY[code] ?? plain[0].toUpperCase() + plain.slice(1)), h("span", {}, `: ${job.error.detail ?? ""} `), job.error.pointer ? h("code", {}, job.error.pointer) : "", mendings(job)];
  }
  if (job.state === "running") return h("progress", { max: 1, value: job.progress, "aria-label": "Progress" });
  if (job.state === "queued") return "waits for a worker";
  if (job.result) return answerText(job.result);
  return job.reused ? "had been solved before" : "";
}

/** Links that open the problem of a failed job in the workbench: as it is, or with an accuracy that would be met. */
function mendings({ problem, error: { accepted = {} } }) {
  const open = (changed, ...text) => h("a", { href: `./workbench#${encodeURIComponent(JSON.stringify({ ...problem, ...changed }))}` }, ...text);
  const proposed = Object.entries(accepted).map(([measure, value]) => open({ accuracy: { [measure]: value } }, `Open with the ${measure === "relative" ? "relative tolerance" : measure} ${number(value)}`));
  return problem.motion ? h("span", { class: "row" }, proposed.length ? proposed : open({}, "Open in the workbench")) : "";
}

/** The number of attempts; where there were several or it failed, each with its end. */
function attempts(job) {
  if (job.attempt < 2 && !job.error) return String(job.attempt);
  const list = h("ul", { class: "plain hint" });
  return h("details", { ontoggle: async ({ target }) => {
    if (!target.open || list.children.length) return;
    try {
      const { items } = await get(`v1/jobs/${job.id}/attempts`);
      fill(list, items.map((one) => h("li", {}, `${one.number}: ${one.outcome ?? "runs"}, by ${one.worker}${one.detail ? `: ${one.detail}` : ""}`)));
    } catch (error) { list.textContent = error.message; }
  } }, h("summary", { "aria-label": `${job.attempt} attempts` }, String(job.attempt)), list);
}

const stopper = (path) => h("button", { type: "button", class: "quiet", onclick: async (event) => {
  event.currentTarget.disabled = true;
  try { await request(path, { method: "POST" }); } catch (error) { $("where-fault").textContent = error.message; }
  await show();
} }, "Cancel");

/** Return the conditions of a text: divided at commas that are in no brackets and no quotation marks. */
function conditions(text) {
  const found = [""];
  let depth = 0;
  let isQuoted = false;
  for (const sign of text) {
    if (sign === '"') isQuoted = !isQuoted;
    if (!isQuoted && sign === "(") depth += 1;
    if (!isQuoted && sign === ")") depth -= 1;
    if (sign === "," && depth === 0 && !isQuoted) found.push("");
    else found[found.length - 1] += sign;
  }
  return found.map((part) => part.trim()).filter(Boolean);
}

/** Return a value as the language writes it. */
const quoted = (value) => (/^[\w.:+-]+$/.test(value) ? value : `"${String(value).replaceAll('"', '""')}"`);

/** Show each condition as a chip that can be taken away. */
function showChips(where, changed) {
  const all = conditions(where);
  refill($("chips"), all.map((condition, k) => h("li", {}, h("button", { type: "button", class: "chip", "aria-label": `Take away ${condition}`,
    onclick: () => changed(all.filter((_, other) => other !== k).join(",")) }, condition, h("span", { "aria-hidden": "true" }, " ×")))));
}

/** Show facets; a click on a value adds it as a condition. */
function showFacets(facets, where, changed) {
  const present = new Set(conditions(where));
  refill($("facets"), facets.filter(({ values }) => values.length).map(({ by, values, others }) => h("div", { class: "facet" }, h("span", { class: "hint" }, by),
    values.map(({ value, count }) => {
      const condition = value === null ? `${by} is null` : `${by}=${quoted(String(value))}`;
      return h("button", { type: "button", class: "quiet", disabled: present.has(condition),
        onclick: () => changed([...present, condition].join(",")) }, `${value ?? "none"} `, h("span", { class: "error" }, String(count)));
    }), others ? h("span", { class: "hint" }, `and ${others} others`) : null)));
}

let next = null;

const query = () => {
  const found = asked();
  const sent = new URLSearchParams({ limit: String(LIMIT), ...ofKind });
  for (const part of ["where", "order", "after"]) if (found.get(part)) sent.set(part, found.get(part));
  return sent;
};

let turn = 0; // of the last question; the answer to an older one would show what is no longer asked
let underWay = 0;
let hasChanged = false; // while a question was under way

/** Somebody is at a row, or reads what it unfolds: it must not be replaced. */
const isBusy = () => $("table").querySelector("tbody :focus, :active, details[open]") !== null
  || (!getSelection().isCollapsed && getSelection().containsNode($("table"), true));

/** Show what there is now, unless somebody is at a row. */
function refresh() {
  if (underWay) hasChanged = true;
  else if (!isBusy()) show(isBusy).catch(() => {});
}

async function show(isUnwanted = () => false) {
  const mine = ++turn;
  underWay++;
  try {
    return await showAnswer(() => mine !== turn || isUnwanted());
  } finally {
    underWay--;
    if (!underWay && hasChanged) {
      hasChanged = false;
      refresh();
    }
  }
}

async function showAnswer(isUnwanted) {
  const sent = query();
  const where = sent.get("where") ?? "";
  let page;
  try {
    page = await get(`v1/${name}?${sent}`);
    if (isUnwanted()) return null;
  } catch (error) {
    if (isUnwanted()) return null;
    if (!(error instanceof Refusal) || error.status >= 500) throw error;
    const of = (field) => error.faults.filter(({ pointer }) => pointer === `?${field}`).map(({ message }) => message).join("; ");
    const isOrder = of("order") !== "";
    showChips(where, go); // a condition that is refused can be taken away
    $("table").classList.add("stale"); // rows of the question before
    for (const id of ["more", "first"]) $(id).hidden = true;
    $("count").textContent = "The rows above are those of the previous question.";
    tellFaults(isOrder ? of("where") : of("where") || error.faults.map(({ message }) => message).join("; ") || error.message, of("order"));
    return null;
  }
  tellFaults("", "");
  $("table").classList.remove("stale");
  ({ next } = page);
  $("more").hidden = !next;
  $("count").textContent = page.total === null ? `${page.items.length} on this page` : `${page.total.toLocaleString("en")} in all`;
  $("first").hidden = !sent.get("after");
  $("first").href = `?${new URLSearchParams(["where", "order"].filter((part) => sent.get(part)).map((part) => [part, sent.get(part)]))}`;
  const add = (condition) => go([...new Set([...conditions(where), condition])].join(","));
  const rows = page.items.map((item) => h("tr", {}, h("td", {}, boxOf(item)), kind.columns.map(([, , cell]) => h("td", {}, ...[cell(item)].flat())), h("td", { class: "marks" }, labelsOf(item, quoted, add))));
  refill($("table"), page.items.length ? h("table", {}, h("caption", { class: "unseen" }, `${document.title}. A click on a head sorts by it; with Shift it is one more column to sort by.`),
    h("thead", {}, h("tr", {}, h("td", {}, allBox(page.items)), kind.columns.map(head), h("th", { scope: "col" }, "Labels and note"))), h("tbody", {}, rows))
    : h("p", { class: "empty" }, where ? "Nothing meets these conditions." : "There is nothing yet."));
  settled();
  showChips(where, go);
  return page.items;
}

function tellFaults(where, order) {
  for (const [field, text] of [["where", where], ["order", order]]) {
    $(`${field}-fault`).textContent = text;
    if (text) $(field).setAttribute("aria-invalid", "true");
    else $(field).removeAttribute("aria-invalid");
  }
}

/** The head of a column: a click sorts by it, another one the other way; with Shift it is one more column to sort by. */
function head([title, fact]) {
  if (!title) return h("td", {});
  if (!fact) return h("th", { scope: "col" }, title);
  const order = (asked().get("order") ?? "").split(",").map((part) => part.trim()).filter(Boolean);
  const place = order.findIndex((part) => part.replace("-", "") === fact);
  const [isSorted, isDown] = [place >= 0, order[place]?.startsWith("-")];
  const turned = isSorted && !isDown ? `-${fact}` : fact;
  const sort = (event) => go(asked().get("where") ?? "", event.shiftKey ? (isSorted ? order.with(place, turned) : [...order, fact]).join(",") : turned);
  return h("th", { scope: "col", "aria-sort": isSorted ? (isDown ? "descending" : "ascending") : null },
    h("button", { type: "button", class: "sort", "data-id": fact, "aria-label": title, onclick: sort }, title, isSorted ? h("span", { "aria-hidden": "true" }, ` ${isDown ? "↓" : "↑"}${order.length > 1 ? place + 1 : ""}`) : ""));
}

async function facets(items) {
  const { where } = Object.fromEntries(query());
  if (!kind.facets.length) return;
  const labels = [...new Set(items.flatMap(({ labels: given }) => Object.keys(given ?? {})))].slice(0, MOST_LABELS).map((key) => `label.${key}`);
  const sent = new URLSearchParams({ by: [...kind.facets, ...labels].join(","), limit: "6", ...(where ? { where } : {}) });
  showFacets((await get(`v1/${name}/facets?${sent}`)).facets, where ?? "", go);
}

/** Ask another question: a new entry of the history, whose address can be shared. */
function go(where, order = $("order").value.trim(), after = null) {
  refused.clear();
  const address = new URLSearchParams();
  if (where) address.set("where", where);
  if (order) address.set("order", order);
  if (after) address.set("after", after);
  if (`?${address}` !== location.search) history.pushState(null, "", `?${address}`);
  return arrive();
}

/** Write the question of the address into the form; only where the address has changed, since somebody may be typing there. */
function writeQuestion() {
  $("where").value = asked().get("where") ?? "";
  $("order").value = asked().get("order") ?? "";
}

function arrive() {
  writeQuestion();
  return renew();
}

let renewing = 0;

async function renew() {
  renewing++;
  $("facets").ariaBusy = "true"; // what is below them may still move
  try {
    const items = await show();
    if (items !== null) {
      await facets(items);
      say(`${items.length} ${list}`);
    }
    return items;
  } finally {
    renewing--;
    $("facets").ariaBusy = String(renewing > 0);
  }
}

fill($("orders"), Object.entries(kind.orders).map(([order, words]) => h("option", { value: order }, words)));
Object.assign($("where"), { placeholder: kind.example });
Object.assign($("order"), { placeholder: "-created_at" });
listen(list, renew);
$("all-csv").addEventListener("click", () => {
  const sent = new URLSearchParams({ format: "csv", ...ofKind });
  for (const part of ["where", "order"]) if (asked().get(part)) sent.set(part, asked().get(part));
  download(`v1/${name}?${sent}`, `${list}.csv`).catch((error) => tellFaults(error.message, ""));
});
$("asking").addEventListener("submit", (event) => {
  event.preventDefault();
  go($("where").value.trim());
});
$("order").addEventListener("change", () => go($("where").value.trim()));
$("more").addEventListener("click", () => {
  const following = new URLSearchParams(next.split("?")[1]); // of the rows that are seen, even if others are asked for by now
  go(following.get("where") ?? "", following.get("order") ?? "", following.get("after"));
});
addEventListener("popstate", arrive);
$("new-sweep")?.addEventListener("click", () => during([$("new-sweep")], async () => {
  const { openForm } = await import("./sweep_form.js");
  await openForm().catch((error) => tellFaults(error.message, ""));
}));
writeQuestion();
await run(renew);
if (name !== "solutions") {
  follow({ events: "v1/events", path: "v1/status", name: "status", every: 3000, seen: refresh });
}
