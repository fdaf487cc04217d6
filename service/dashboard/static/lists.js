// Solutions, jobs and sweeps as tables; the address holds the question, so it can be sent to others.
import { $, ago, asked, fill, get, h, measured, motionText, number, potentialText, Refusal, request, run, say } from "./core.js";
import { follow } from "./follow.js";
import { showChips, showFacets } from "./query.js";

const LIVE = ["queued", "running"];
const LIMIT = 25;

const states = { queued: "waits", running: "runs", succeeded: "solved", failed: "failed", cancelled: "cancelled" };
const state = (word) => h("span", { class: `state ${word}` }, states[word] ?? word);
const link = (path, ...content) => h("a", { href: path }, ...content);
const family = (problem) => h("span", { class: "formula" }, potentialText(problem.potential));

const SOLUTIONS = {
  facets: ["family", "tier", "method", "aperiodic", "stability.verdict"],
  orders: { "": "newest first", created_at: "oldest first", period: "period", "-period": "longest period", energy: "energy", "-energy": "highest energy", error: "smallest error", "-error": "largest error" },
  columns: ["Potential", "Motion", "Period", "Energy", "Error", "Tier", "When"],
  row: (one) => [link(`./solution?id=${one.id}`, family(one.problem)), motionText(one.problem.motion), one.period ? measured(one.period) : one.aperiodic ?? "–",
    one.energy ? number(one.energy.value, 6) : "–", h("span", { class: "value" }, number(one.error, 2)), one.tier, ago(one.created_at)],
};
const JOBS = {
  facets: ["state", "family", "error.code"],
  orders: { "": "newest first", created_at: "oldest first", "-seconds": "slowest", seconds: "fastest", "-attempt": "most attempts" },
  columns: ["State", "Potential", "Motion", "What happened", "Attempts", "When", ""],
  row: (one) => [state(one.state), one.solution ? link(`./solution?id=${one.solution}`, family(one.problem)) : family(one.problem), motionText(one.problem.motion),
    what(one), String(one.attempt), ago(one.created_at), LIVE.includes(one.state) ? stopper(`v1/jobs/${one.id}/cancel`) : ""],
};
const SWEEPS = {
  facets: [],
  orders: { "": "newest first", created_at: "oldest first", "-points": "most points", "-refused": "most refused points", "-seconds": "slowest" },
  columns: ["State", "Sweep", "Points", "Refused", "Progress", "When", ""],
  row: (one) => [state(one.state), link(`./sweep?id=${one.id}`, h("code", {}, one.id.slice(0, 13))), one.points.toLocaleString("en"), one.refused.toLocaleString("en"),
    h("progress", { max: 1, value: one.progress, "aria-label": "Progress" }), ago(one.created_at), LIVE.includes(one.state) ? stopper(`v1/sweeps/${one.id}/cancel`) : ""],
};
const [name, kind] = { "/jobs": ["jobs", JOBS], "/sweeps": ["sweeps", SWEEPS] }[new URL(location).pathname.replace(/^.*(?=\/)/, "")] ?? ["solutions", SOLUTIONS];

/** Say in words why a job is where it is. */
function what(job) {
  if (job.error) return `${job.error.title ?? job.error.code ?? "failed"}: ${job.error.detail ?? job.error.message ?? ""}`;
  if (job.state === "running") return h("progress", { max: 1, value: job.progress, "aria-label": "Progress" });
  if (job.state === "queued") return "waits for a worker";
  return job.reused ? "had been solved before" : "";
}

const stopper = (path) => h("button", { type: "button", class: "quiet", onclick: async (event) => {
  event.currentTarget.disabled = true;
  try { await request(path, { method: "POST" }); } catch (error) { $("where-fault").textContent = error.message; }
  await show();
} }, "Cancel");

let next = null;

const query = () => {
  const found = asked();
  const sent = new URLSearchParams({ limit: String(LIMIT) });
  for (const part of ["where", "order", "after"]) if (found.get(part)) sent.set(part, found.get(part));
  return sent;
};

async function show() {
  const sent = query();
  const where = sent.get("where") ?? "";
  let page;
  try {
    page = await get(`v1/${name}?${sent}`);
  } catch (error) {
    if (!(error instanceof Refusal) || error.status >= 500) throw error;
    $("where-fault").textContent = error.faults.map(({ message }) => message).join("; ") || error.message;
    $("where").setAttribute("aria-invalid", "true");
    return null;
  }
  $("where-fault").textContent = "";
  $("where").removeAttribute("aria-invalid");
  ({ next } = page);
  $("more").hidden = !next;
  $("count").textContent = page.total === null ? `${page.items.length} on this page` : `${page.total.toLocaleString("en")} in all`;
  fill($("table"), page.items.length ? h("table", {}, h("caption", { class: "unseen" }, document.title),
    h("thead", {}, h("tr", {}, kind.columns.map((title) => (title ? h("th", { scope: "col" }, title) : h("td", {}))))),
    h("tbody", {}, page.items.map((item) => h("tr", {}, kind.row(item).map((cell) => h("td", {}, ...[cell].flat()))))))
    : h("p", { class: "empty" }, where ? "Nothing meets these conditions." : "There is nothing yet."));
  showChips(where, go);
  return page.items;
}

async function facets() {
  const { where } = Object.fromEntries(query());
  if (!kind.facets.length) return;
  const sent = new URLSearchParams({ by: kind.facets.join(","), limit: "6", ...(where ? { where } : {}) });
  showFacets((await get(`v1/${name}/facets?${sent}`)).facets, where ?? "", go);
}

/** Ask another question: a new entry of the history, whose address can be shared. */
function go(where, order = $("order").value, after = null) {
  const address = new URLSearchParams();
  if (where) address.set("where", where);
  if (order) address.set("order", order);
  if (after) address.set("after", after);
  history.pushState(null, "", `?${address}`);
  return renew();
}

async function renew() {
  $("where").value = asked().get("where") ?? "";
  $("order").value = asked().get("order") ?? "";
  const items = await show();
  if (items !== null) {
    await facets();
    say(`${items.length} ${name}`);
  }
  return items;
}

fill($("order"), Object.entries(kind.orders).map(([order, words]) => h("option", { value: order }, words)));
$("asking").addEventListener("submit", (event) => {
  event.preventDefault();
  go($("where").value.trim());
});
$("order").addEventListener("change", () => go(asked().get("where") ?? ""));
$("more").addEventListener("click", () => go(asked().get("where") ?? "", $("order").value, new URLSearchParams(next.split("?")[1]).get("after")));
addEventListener("popstate", renew);
await run(renew);
if (name !== "solutions") {
  follow({ events: "v1/events", path: "v1/status", name: "status", every: 3000, seen: () => { if (!$("table").contains(document.activeElement)) show().catch(() => {}); } });
}
