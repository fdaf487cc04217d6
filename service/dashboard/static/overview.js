// What the installation does now, and the last solutions with a picture each.
import { $, ago, bodyText, fill, get, h, measured, motionText, number, potentialText, run } from "./core.js";
import { follow } from "./follow.js";
import { picture, pointsOf } from "./sphere.js";

const CARDS = 6;
const POINTS = 161;

const tile = (name, value, note = "") => h("div", {}, h("dt", {}, name), h("dd", {}, value, note ? h("span", { class: "error" }, ` ${note}`) : null));

function showStatus(status) {
  const count = (state) => status.queue.filter((part) => part.state === state).reduce((sum, part) => sum + part.jobs, 0);
  const working = status.workers.filter((worker) => worker.slots);
  const busy = working.reduce((sum, worker) => sum + worker.running.length, 0);
  const slots = working.reduce((sum, worker) => sum + worker.slots, 0);
  const [minute] = status.rates;
  fill($("status"),
    tile("Waiting", String(count("queued"))), tile("Running", String(count("running"))),
    tile("Workers", String(working.length), `${busy} of ${slots} slots at work`),
    tile("Solved in a minute", String(minute.succeeded)), tile("Failed in a minute", String(minute.failed)));
  $("status").setAttribute("aria-busy", "false");
  const jobs = working.flatMap((worker) => worker.running);
  fill($("running"), jobs.length ? h("ul", { class: "plain" }, jobs.map((job) => h("li", {}, h("code", {}, job.id ?? job.job), ` ${number(100 * (job.progress ?? 0), 3)} %`))) : null);
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
  const stretch = solution.period ? `start=0&stop=${solution.period.value}&samples=${POINTS}&` : "";
  const { columns } = await get(`v1/solutions/${solution.id}/trajectory?${stretch}columns=t,g1,g2,g3`);
  place.replaceChildren(picture([{ points: pointsOf(columns, ["g1", "g2", "g3"], 400) }], { alt: `Path of the vertical: ${title}` }));
}

let newest = null;

async function showLast() {
  const { items } = await get(`v1/solutions?limit=${CARDS}`);
  if (newest === (items[0]?.id ?? "")) return;
  newest = items[0]?.id ?? "";
  const cards = items.map(card);
  fill($("cards"), cards.length ? cards.map(({ element }) => element)
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
  showStatus(await get("v1/status"));
  await showLast();
});
follow({
  events: "v1/events", path: "v1/status", name: "status", every: 2000,
  seen: (name, found) => {
    if (name === "status") showStatus(found);
    showLast().catch(() => {}); // the next change brings them
  },
  lost: (isLost) => { $("pulse").textContent = isLost ? "the service does not answer; asking again" : ""; },
});
