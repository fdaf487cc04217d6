// What the installation does now, and the last solutions with a picture each.
import { $, ago, bodyText, fill, get, h, measured, motionText, number, potentialText, refill, request, run } from "./core.js";
import { arraysOf } from "./arrays.js";
import { follow } from "./follow.js";
import { picture, pointsOf } from "./sphere.js";

const CARDS = 6;
const POINTS = 160;
const MOST_OFF = 0.02; // of a range, two pixels of a small picture: lines that may be further off are not drawn
const UNDERWAY = ["queued", "running"];
const SILENT = 10_000; // milliseconds without a word of a sweep, after which it is asked for

const latest = { job: new Map(), sweep: new Map() }; // the latest states of what is under way, by events
const rows = new Map();
let atWork = [];
let heard = 0;

const tile = (name, value, note = "", more = []) => h("div", {}, h("dt", {}, name), h("dd", {}, value, note ? h("span", { class: "error" }, ` ${note}`, ...more.filter(Boolean)) : null));

function showStatus(status) {
  const count = (state) => status.queue.filter((part) => part.state === state).reduce((sum, part) => sum + part.jobs, 0);
  const working = status.workers.filter((worker) => worker.slots);
  const busy = working.reduce((sum, worker) => sum + worker.running.length, 0);
  const slots = working.reduce((sum, worker) => sum + worker.slots, 0);
  const clusters = new Map(working.filter(({ cluster }) => cluster).map(({ cluster }) => [cluster.scheduler, cluster]));
  const onClusters = [...clusters.values()].flatMap(({ scheduler, is_connected: on, workers, threads, left_out: out, dashboard }) => [
    `; Dask ${scheduler}: ${on ? `${workers} workers, ${threads} threads${out.length ? `, ${out.length} left out` : ""}` : "not connected"} `,
    dashboard ? h("a", { href: dashboard }, "its page") : null]);
  const [minute] = status.rates;
  fill($("status"),
    tile("Waiting", String(count("queued"))), tile("Running", String(count("running"))),
    tile("Workers", String(working.length), [`${busy} of ${slots} slots at work`, ...new Set(working.map((worker) => worker.kernels).filter(Boolean))].join("; "), onClusters),
    tile("Solved in a minute", String(minute.succeeded)), tile("Failed in a minute", String(minute.failed)));
  $("status").setAttribute("aria-busy", "false");
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

/** Take the state of a job or a sweep from an event. */
function hear(name, found) {
  if (name === "sweep") heard = Date.now();
  if (UNDERWAY.includes(found.state)) latest[name].set(found.id, found);
  else latest[name].delete(found.id);
  showRunning();
}

function card(solution) {
  const { problem, period } = solution;
  const place = h("div", { class: "thumb" });
  const title = potentialText(problem.potential);
  return { solution, place, title, element: h("li", { class: "card" }, h("a", { href: `./solution?id=${solution.id}` }, place,
    h("span", { class: "formula" }, title)),
    h("p", {}, `${motionText(problem.motion)} · ${bodyText(problem.body)}`),
    h("p", { class: "hint" }, period ? ["period ", measured(period)].flat() : solution.aperiodic ?? "no period", " · ", ago(solution.created_at))) };
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
  const { items } = await get(`v1/solutions?limit=${CARDS}`);
  if (mine !== turn) return; // asked for again meanwhile
  if (newest === (items[0]?.id ?? "")) return;
  newest = items[0]?.id ?? "";
  const cards = items.map(card);
  refill($("cards"), cards.length ? cards.map(({ element }) => element)
    : h("li", { class: "empty" }, "Nothing has been solved yet. ", h("a", { href: "./workbench" }, "Start in the workbench"), "."));
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
  const [status] = await Promise.all([get("v1/status"), showSweeps()]);
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
