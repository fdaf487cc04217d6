// What the installation does now, the last sweeps and the last solutions with a picture each, and three examples.
import { $, ago, bodyText, during, fill, get, h, measured, motionText, number, potentialText, refill, request, run, troubleOf } from "./core.js";
import { arraysOf } from "./arrays.js";
import { follow } from "./follow.js";
import { picture, pointsOf } from "./sphere.js";
import { curve, sweepLink } from "./sweeps.js";

const CARDS = 6;
const SWEEPS = 3;
const RECENT = 30; // solutions that are grouped by their problems
const LOOK_AGAIN = 5000; // milliseconds, until it is asked again whether all is compiled
const POINTS = 160;
const MOST_OFF = 0.02; // of a range, two pixels of a small picture: lines that may be further off are not drawn
const UNDERWAY = ["queued", "running"];
const SILENT = 10_000; // milliseconds without a word of a sweep, after which it is asked for

const latest = { job: new Map(), sweep: new Map() }; // the latest states of what is under way, by events
const rows = new Map();
let atWork = [];
let heard = 0;

const tile = (name, value) => h("div", {}, h("dt", {}, name), h("dd", {}, value));

const COUNTS = ["No", "One", "Two", "Three", "Four", "Five", "Six"];
const many = (count, word) => `${COUNTS[count] ?? count} ${word}${count === 1 ? "" : "s"}`;

/** Say who computes, whether at once, and what to do where nobody does. */
function workersInWords(working, ready) {
  const slots = working.reduce((sum, worker) => sum + worker.slots, 0);
  const busy = working.reduce((sum, worker) => sum + worker.running.length, 0);
  if (!working.length && ready?.workers !== "starting") return [h("strong", {}, "No worker"), ": nothing will be computed. Start one: ", h("code", {}, "polhode worker"), "."];
  const { compiling } = ready ?? {};
  const left = compiling?.seconds ? `ready in about ${number(compiling.seconds, 2)} s` : compiling?.waits ?? "until then jobs take longer";
  const state = compiling ? `compiling, ${compiling.done} of ${compiling.of} parts, ${left}` : ready?.workers === "starting" ? "still loading" : "ready";
  const clusters = new Map(working.filter(({ cluster }) => cluster).map(({ cluster }) => [cluster.scheduler, cluster]));
  const onClusters = [...clusters.values()].flatMap(({ scheduler, is_connected: on, workers, threads, left_out: out, dashboard }) => [
    ` Dask ${scheduler}: ${on ? `${workers} workers, ${threads} threads${out.length ? `, ${out.length} left out` : ""}` : "not connected"}. `,
    dashboard ? h("a", { href: dashboard }, "Its page") : null]);
  return [h("strong", {}, many(Math.max(1, working.length), "worker")), `, ${state}${slots ? `; ${busy} of ${slots} places at work` : ""}.`, ...onClusters.filter(Boolean)];
}

let ready = { asked: -Infinity, known: null };

function showStatus(status) {
  const count = (state) => status.queue.filter((part) => part.state === state).reduce((sum, part) => sum + part.jobs, 0);
  const working = status.workers.filter((worker) => worker.slots);
  const [minute] = status.rates;
  const ended = status.succeeded_by_minute;
  const rate = h("div", { id: "rate" }, h("dt", {}, "Solved in a minute"), h("dd", {}, String(minute.succeeded)));
  if (ended.some(Boolean)) rate.lastChild.append(curve(ended.map((value, k) => [k, value]), `Jobs solved in each of the last ${ended.length} minutes: ${ended.join(", ")}`));
  fill($("status"), tile("Waiting", String(count("queued"))), tile("Running", String(count("running"))), rate, tile("Failed in a minute", String(minute.failed)));
  $("status").setAttribute("aria-busy", "false");
  const tell = () => refill($("workers"), workersInWords(working, ready.known));
  tell();
  if (Date.now() - ready.asked > LOOK_AGAIN) {
    ready.asked = Date.now();
    get("readyz").then((known) => { ready.known = known; tell(); }, () => {}); // what is not ready says so by itself
  }
  atWork = working.flatMap((worker) => worker.running);
  const isStale = latest.sweep.size > 0 && Date.now() - heard > SILENT;
  if (isStale || atWork.some(({ sweep }) => sweep && !latest.sweep.has(sweep))) showSweeps().catch(() => {}); // the next status asks again
  showRunning();
}

/** Show a row for each sweep under way and each job at work; a row stays the same element, so nobody loses the focus. */
function showRunning() {
  const jobs = atWork.filter(({ kind }) => kind === "solve").map(({ id, seconds }) => {
    const { progress = 0 } = latest.job.get(id) ?? {};
    return { id, progress, name: h("span", {}, "Job ", h("code", {}, id)), text: `${number(100 * progress, 3)} %, for ${number(seconds, 2)} s` };
  });
  const sweeps = [...latest.sweep.values()].map(({ id, note, state, progress, done, points, remaining_seconds: left }) => ({
    id, progress, name: h("span", {}, h("a", { href: `./sweep?id=${id}` }, `Sweep ${note ?? id}`)),
    text: `${state}, ${done.toLocaleString("en")} of ${points.toLocaleString("en")} points${left ? `, about ${number(left, 2)} s more` : ""}` }));
  const shown = [...sweeps, ...jobs];
  for (const [id, { element }] of rows) {
    if (shown.some((one) => one.id === id)) continue;
    element.remove();
    rows.delete(id);
  }
  for (const { id, progress, name, text } of shown) {
    if (!rows.has(id)) {
      const row = { bar: h("progress", { max: 1, "aria-label": name.textContent }), state: h("span", { class: "hint" }) };
      row.element = h("li", { class: "row" }, row.bar, name, row.state);
      rows.set(id, row);
      $("running").append(row.element);
    }
    rows.get(id).bar.value = progress;
    rows.get(id).state.textContent = text;
  }
  $("running").hidden = rows.size === 0;
}

async function showSweeps() {
  const { items } = await get(`v1/sweeps?limit=${CARDS}&where=${encodeURIComponent(`state in (${UNDERWAY.join(", ")})`)}`);
  heard = Date.now();
  latest.sweep = new Map(items.map((sweep) => [sweep.id, sweep]));
  showRunning();
}

let lastSweeps = null;

/** Show the last sweeps that have points, each with its picture when it is finished. */
async function showLastSweeps() {
  const { items } = await get(`v1/sweeps?limit=${SWEEPS}`);
  const shown = items.map(({ id, state }) => `${id} ${state}`).join();
  if (shown === lastSweeps) return;
  lastSweeps = shown;
  $("last-sweeps").closest("section").hidden = items.length === 0;
  refill($("sweeps"), items.map((sweep) => h("li", { class: "card" }, sweepLink(sweep),
    h("p", { class: "hint" }, `${sweep.state}, ${sweep.points.toLocaleString("en")} points${sweep.note ? ` · ${sweep.note}` : ""} · ${ago(sweep.created_at)}`))));
}

/** Take the state of a job or a sweep from an event. */
function hear(name, found) {
  if (name === "sweep") heard = Date.now();
  if (name === "sweep") showLastSweeps().catch(() => {}); // the next event brings them
  if (UNDERWAY.includes(found.state)) latest[name].set(found.id, found);
  else latest[name].delete(found.id);
  showRunning();
}

/** Return solutions of the same problem together, whatever their times and their accuracy; the newest first. */
function grouped(solutions) {
  const groups = new Map();
  for (const one of solutions) {
    const key = JSON.stringify(["body", "potential", "motion"].map((part) => one.problem[part]));
    groups.set(key, [...(groups.get(key) ?? []), one]);
  }
  return [...groups.values()].slice(0, CARDS);
}

function card([solution, ...others]) {
  const { problem, period } = solution;
  const place = h("div", { class: "thumb" });
  const title = potentialText(problem.potential);
  return { solution, place, title, element: h("li", { class: "card" }, h("a", { href: `./solution?id=${solution.id}` }, place,
    h("span", { class: "formula" }, title)),
    h("p", {}, `${motionText(problem.motion)} · ${bodyText(problem.body)}`),
    h("p", { class: "hint" }, period ? ["period ", measured(period)].flat() : solution.aperiodic ?? "no period", " · ", ago(solution.created_at)),
    others.length ? h("p", { class: "group" }, `${others.length} more: `, others.slice(0, CARDS).map((one) => h("a", { href: `./solution?id=${one.id}`, title: ago(one.created_at) }, `${one.tier}, error ${number(one.error, 1)}`))) : null) };
}

async function paint({ solution, place, title }) {
  const stretch = solution.period ? `start=0&stop=${solution.period.value}&` : "";
  const answer = await request(`v1/solutions/${solution.id}/trajectory?${stretch}preview=${POINTS}&columns=t,g1,g2,g3`, { headers: { Accept: "application/x-npz" } });
  if (Number(answer.headers.get("Polhode-Deviation")) > MOST_OFF) {
    place.replaceChildren(h("p", { class: "hint" }, "It oscillates too fast for a small picture."));
    return;
  }
  const columns = arraysOf(await answer.arrayBuffer());
  place.replaceChildren(picture([{ points: pointsOf(columns, ["g1", "g2", "g3"], POINTS) }], { alt: `Path of the vertical: ${title}` }));
}

let newest = null;
let turn = 0;

async function showLast() {
  const mine = ++turn;
  const { items } = await get(`v1/solutions?limit=${RECENT}`);
  if (mine !== turn) return; // asked for again meanwhile
  if (newest === (items[0]?.id ?? "")) return;
  newest = items[0]?.id ?? "";
  const cards = grouped(items).map(card);
  // Who has nothing yet sees first how to begin.
  const isFirst = $("begin").previousElementSibling.matches(".hero");
  if (cards.length && isFirst) document.querySelector("main").append($("begin"));
  else if (!cards.length && !isFirst) document.querySelector(".hero").after($("begin"));
  refill($("cards"), cards.length ? cards.map(({ element }) => element)
    : h("li", { class: "empty" }, "Nothing has been solved yet. Run one of the examples, or ", h("a", { href: "./workbench" }, "start in the workbench"), "."));
  $("cards").setAttribute("aria-busy", "false");
  // Pictures come when the cards are looked at, one after the other.
  const seen = new IntersectionObserver(async (entries) => {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      await paint(cards.find(({ element }) => element === target)).catch(() => {});
    }
  });
  cards.forEach(({ element }) => seen.observe(element));
}

await run(async () => {
  const [status] = await Promise.all([get("v1/status"), showSweeps(), showLastSweeps()]);
  showStatus(status);
  await showLast();
});
follow({
  events: "v1/events", path: "v1/status", name: "status", every: 2000,
  seen: (name, found) => {
    if (name === "status") showStatus(found);
    else hear(name, found);
    if (name !== "sweep") showLast().catch(() => {}); // the next change brings them
  },
  lost: (isLost) => { $("pulse").textContent = isLost ? "the service does not answer; trying again" : ""; },
});

for (const button of $("begin").querySelectorAll("button")) {
  button.addEventListener("click", () => during([button], async () => {
    fill($("begin-outcome"), "…");
    try {
      const tours = await import("./tours.js");
      await (button.dataset.run ? tours.run(button.dataset.run) : tours.begin(button.dataset.tour));
    } catch (error) { fill($("begin-outcome"), troubleOf(error)); }
  }));
}
