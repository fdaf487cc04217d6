// Three examples: to judge a potential, to compute a motion, to sweep. Each runs as it is, or as a tour through the pages.
import { $, get, h, nameOf, onceKey, post, Refusal, request, say, troubleOf } from "./core.js";
import { solved, whyNot } from "./starting.js";

const STATE = "polhode.tour"; // in this tab: which tour, which step, and what it has made
const PATIENCE = 30_000; // milliseconds until what a step speaks of must be there
const PROBLEM = {
  body: { A: 2, C: 1 }, potential: { type: "expression", expression: "a*g1 + b/g3^2", parameters: { a: -1, b: "1/20" } },
  motion: { type: "planar", lambda: 1 }, time: { periods: 1, samples: 201 }, accuracy: { tier: "standard" },
};
const REFUTED = { ...PROBLEM, potential: { type: "expression", expression: "a*g1 + b/g3^2 + g2/10", parameters: { a: -1, b: "1/20" } } };
const B = "/potential/parameters/b";
const SWEEP = {
  base: PROBLEM, axes: [{ pointer: "/motion/lambda", linspace: ["1/2", 2, 60] }, { pointer: B, logspace: ["1/50", "1/5", 40] }],
  combine: "grid", keep: ["period", "period.error", "energy", "energy.error", "error"],
};
const workbench = (problem) => `./workbench#${encodeURIComponent(JSON.stringify(problem))}`;

/** Compute the example; return its page and what is to be deleted: of a solution that was there before, the new job only. */
async function computed(labels) {
  const job = await solved({ ...PROBLEM, labels });
  if (!job.solution) throw new Refusal({ title: "It could not be computed", detail: whyNot(job) }, 422);
  return { address: `./solution?id=${job.solution}`, made: job.reused ? `v1/jobs/${job.id}` : `v1/solutions/${job.solution}` };
}

async function swept(labels) {
  const { id } = await post("v1/sweeps", { ...SWEEP, labels }, { headers: { "Idempotency-Key": onceKey() } });
  return { address: `./sweep?id=${id}`, made: `v1/sweeps/${id}` };
}

/** Each tour: its title, what its example does without words, and its steps: [what is spoken of, the text, what Next does]. */
const TOURS = {
  judge: { title: "Judge a potential", run: () => ({ address: workbench(PROBLEM) }), steps: [
    ["#verdict .verdict.inadmissible", "A potential is written at the left. This one is refuted: the mark on the sphere is a point where its equation fails, and the residual there is proved not to be 0.", () => ({ address: workbench(PROBLEM) })],
    ["#verdict .verdict.admissible", "Without g2/10 it is admissible: proved for all points at once, not tested at some. The verdict follows while you type."],
    ["#formulas", "The energy h and the functions F and G that the potential is made of, as formulas."],
    ["#atlas-section", "All of its motions: for each λ the range of γ₁ that a motion covers, and where motions begin, meet and end. A click picks one."],
  ] },
  move: { title: "Compute a motion", run: computed, start: workbench(PROBLEM), steps: [
    ["#submit", "The potential, the body and λ make a problem; the tier says how accurate the numbers must be. Next computes it.", computed],
    ["#facts", "The period and the energy, each with a bound of its error."],
    ["#series", "The angular velocity ω and the vertical γ over time. Dragging shows a part closer: its samples are computed from the stored function of time."],
    ["#gamma", "The path of the vertical on the sphere, which turns when you drag it."],
    ["#downloads", "All numbers as files, for other programs."],
  ] },
  sweep: { title: "Sweep two numbers", run: swept, start: workbench(PROBLEM), steps: [
    [".sweep-open", `A sweep solves one problem many times. This button asks what varies and says what it will cost. Next starts one of 2400 motions, over λ and ${nameOf(B)}.`, swept],
    ["#picture .main-svg", "The period over both numbers. Stripes are points without a motion. Dragging shows a part closer, and offers a finer sweep of it."],
    ["#point-title", "A click into the picture shows a point; from here it opens as a solution."],
    ["#downloads", "All points as files, for other programs."],
  ] },
};

const stored = () => JSON.parse(sessionStorage.getItem(STATE) ?? "null");
const keep = (state) => sessionStorage.setItem(STATE, JSON.stringify(state));

/** Run the example of a tour, and go to what it has made, which stays. */
export async function run(name) {
  location.href = (await TOURS[name].run({})).address;
}

/** Begin a tour. */
export function begin(name) {
  keep({ name, step: 0, made: [] });
  go(TOURS[name].start ?? workbench(REFUTED));
}

/** Go to an address; where only its fragment changes no page is loaded, and the tour goes on at once. */
function go(address) {
  const url = new URL(address, document.baseURI);
  const isHere = url.pathname === location.pathname && url.search === location.search;
  location.href = url;
  if (isHere) resume();
}

/** End the tour and delete what it has made; what others use by now stays. */
async function end() {
  const { made } = stored();
  sessionStorage.removeItem(STATE);
  for (const path of made) {
    try {
      const { state } = await get(path);
      if (["queued", "running"].includes(state)) await post(`${path}/cancel`);
      await request(path, { method: "DELETE" });
    } catch (error) {
      if (!(error instanceof Refusal)) throw error; // others use it, or somebody has deleted it
    }
  }
  location.href = "./";
}

/** Return the element that a step speaks of, when it is there and can be seen. */
function found(selector) {
  return new Promise((resolve) => {
    const began = performance.now();
    const look = () => {
      const element = [...document.querySelectorAll(selector)].find((one) => one.checkVisibility());
      if (element || performance.now() - began > PATIENCE) resolve(element);
      else setTimeout(look, 100);
    };
    look();
  });
}

/** Show the step that the tour of this tab is at. */
export async function resume() {
  const state = stored();
  const { title, steps } = TOURS[state.name];
  const [selector, text, act] = steps[state.step];
  document.querySelector(".toured")?.classList.remove("toured");
  const outcome = h("div", { role: "status" });
  const isLast = state.step === steps.length - 1;
  const next = h("button", { type: "button", class: "main", disabled: true, onclick: async () => {
    next.disabled = true;
    try {
      const { address, made } = act ? await act({ tour: state.name }) : {};
      keep({ ...state, step: state.step + 1, made: [...state.made, made].filter(Boolean) });
      if (address) go(address);
      else await resume();
    } catch (error) {
      outcome.replaceChildren(troubleOf(error));
      next.disabled = false;
    }
  } }, "Next");
  const over = h("button", { type: "button", class: isLast ? "main" : "quiet", onclick: () => { over.disabled = true; end(); } }, state.made.length ? "End the tour and delete what it made" : "End the tour");
  const panel = h("aside", { id: "tour", class: "tour", "aria-label": `Tour: ${title}` },
    h("p", { class: "hint" }, `${title}: ${state.step + 1} of ${steps.length}`), h("p", {}, text), outcome, h("div", { class: "row end" }, over, isLast ? null : next));
  $("tour")?.remove();
  document.body.append(panel);
  const place = await found(selector);
  if (!panel.isConnected) return; // the tour is elsewhere by now
  next.disabled = false;
  if (place) {
    place.classList.add("toured");
    place.scrollIntoView({ block: "center", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
  }
  (isLast ? over : next).focus({ preventScroll: true });
  say(text);
}
