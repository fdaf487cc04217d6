// A problem is written here; verdict, motions and costs follow while one types.
import { $, copier, during, exact, fill, get, h, isNotAllowed, number, post, Refusal, run, say, troubleOf } from "./core.js";
import { asPython, build, fillForm, problemOf, showFaults, useFormula, useRatio } from "./fields.js";
import { showFormulas, showSphere, showVerdict } from "./verdict.js";

const QUIET = 40; // milliseconds after the last key: of what is typed fast not each letter is asked for
const FIRST = {
  body: { A: 2, C: 1 }, potential: { type: "expression", expression: "a*g1 + b/g3^2 + c*(g1^2 - g2^2)", parameters: { a: -1, b: "1/20", c: "3/2" } },
  motion: { type: "planar", lambda: 2 }, time: { periods: 1, samples: 201 },
};
const FORMULAS = "?formulas=mathml";
const WORTH = 0.8; // of the seconds of the next better tier: one that takes more saves no time
const OVER = ["succeeded", "failed", "cancelled"];

/** What answers a problem; each part is grey from a change to the answer that fits it. */
const PARTS = ["verdict", "formulas", "sphere", "plan", "tiers", "atlas-section"];
const stale = (isStale, ...names) => { for (const name of names) $(name).setAttribute("aria-busy", isStale); };
let usual = []; // what the tiers take and reach here on other problems
let timer = null;
let edits = 0; // so that nobody is taken away from a problem that they have begun to write
let asking = new AbortController();
let mayOnlyRead = false; // the key of the tab, as a refusal has told

/** Wait until nothing is typed; an answer to what was there before is of no use from now on. */
function changed() {
  edits += 1;
  asking.abort();
  stale(true, ...PARTS);
  if (!$("submit").disabled && !$("job").querySelector("a")) fill($("job")); // what became of the last job is not said of this problem
  clearTimeout(timer);
  timer = setTimeout(look, QUIET);
}

/** Ask for the verdict, which is shown at once, and for the plan of the job; answers to what was typed before are dropped. */
async function look() {
  clearTimeout(timer);
  asking.abort();
  asking = new AbortController();
  const { signal } = asking;
  const problem = problemOf();
  history.replaceState(null, "", `#${encodeURIComponent(JSON.stringify(problem))}`);
  const { body, potential } = problem;
  stale(true, ...PARTS);
  const ask = (document, query) => post(`v1/validations${query}`, document, { signal })
    .then((found) => ({ found, faults: [] }), (error) => {
      if (error instanceof Refusal) return { found: null, faults: error.faults, error };
      throw error;
    });
  try {
    // To write formulas takes ten times as long as the verdict, which therefore does not wait for them.
    const judged = await ask({ body, potential }, "");
    if (signal.aborted) return;
    showVerdict(judged.found, judged.faults, (text) => { useFormula(text); changed(); }, (ratio) => { useRatio(ratio); changed(); });
    const hasFormulas = judged.found?.verdict === "admissible";
    if (!hasFormulas) showFormulas([]);
    stale(false, "verdict", ...(hasFormulas ? [] : ["formulas"]));
    const planned = await ask(problem, FORMULAS);
    // Those of a problem are of its own curve; while it has faults, those of the potential are shown.
    const written = hasFormulas && !planned.found ? await ask({ body, potential }, FORMULAS) : planned;
    if (signal.aborted) return;
    showFormulas(written.found?.formulas ?? []);
    const faults = planned.faults.length ? planned.faults : judged.faults;
    showFaults(judged.found?.verdict === "inadmissible" ? faults.filter((fault) => fault.code !== "inadmissible_potential") : faults);
    if (planned.error && !faults.length) fill($("plan"), troubleOf(planned.error));
    else showPlan(planned.found?.plan);
    showSphere(judged.found, problem, planned.found?.plan?.window);
    stale(false, "formulas", "plan", "tiers", "sphere");
    await atlas(problem, judged.found, signal);
  } catch (error) {
    if (!signal.aborted) fill($("plan"), troubleOf(error));
  } finally {
    if (!signal.aborted) stale(false, ...PARTS);
  }
}

function showPlan(plan) {
  const seconds = plan?.expected_seconds;
  describeTiers(plan?.tiers ?? usual);
  fill($("plan"), plan ? [`${plan.method}, ${plan.samples} samples`, seconds ? `, about ${number(1000 * seconds, 2)} ms` : "",
    plan.solution ? [". Solved before: ", h("a", { href: `./solution?id=${plan.solution}` }, "its solution")] : "",
    ...(plan.remarks ?? []).map((remark) => `. ${remark.message}`)].flat() : null);
}

async function atlas(problem, verdict, signal) {
  const isDrawn = !mayOnlyRead && verdict?.verdict === "admissible" && problem.motion.type === "planar";
  $("atlas-section").hidden = !isDrawn;
  if (!isDrawn) return;
  const { showAtlas } = await import("./atlas.js");
  const { body, potential, motion } = problem;
  const signs = Object.fromEntries(["g1_sign", "g3_sign"].filter((name) => motion[name] !== undefined).map((name) => [name, motion[name]]));
  try {
    let found = await post("v1/atlases", { body, potential, ...signs, lambda: [$("from").value.trim(), $("to").value.trim()], outputs: [] }, { signal });
    if (found.state) found = await drawn(found, signal);
    if (signal.aborted) return;
    $("fault-atlas").textContent = "";
    await showAtlas(found, exact(motion.lambda ?? "none"), pick);
  } catch (error) {
    if (signal.aborted) return;
    if (isNotAllowed(error)) notAllowed(error);
    else $("fault-atlas").textContent = error.message;
  }
}

/** Say once that the key of the tab may read only: nothing is offered that it would be refused. */
function notAllowed(error) {
  mayOnlyRead = true;
  $("atlas-section").hidden = true;
  for (const button of [$("submit"), ...document.querySelectorAll(".sweep-open")]) button.disabled = true;
  fill($("job"), troubleOf(error));
}

/** Wait for the job that draws an atlas; it is cancelled when this one is not wanted any more. */
async function drawn(job, signal) {
  const path = `v1/jobs/${job.id}`;
  const cancel = () => post(`${path}/cancel`).catch(() => {});
  if (signal.aborted) cancel();
  signal.addEventListener("abort", cancel, { once: true });
  $("fault-atlas").textContent = "This atlas takes long; a job draws it…";
  const { follow } = await import("./follow.js");
  await follow({
    events: `${path}/events`, path, name: "job", every: 400, signal, isOver: ({ state }) => OVER.includes(state),
    seen: (name, found) => { if (name === "job") job = found; },
  });
  if (!job.atlas) throw new Error(`The job ${job.state}${job.error ? `: ${job.error.detail ?? job.error.code}` : "."}`);
  return get(`v1/atlases/${job.atlas}`, { signal });
}

function pick(lambda, window) {
  const field = document.querySelector('[data-pointer="/motion/lambda"]');
  if (!field) return; // another kind of motion has been chosen, and the atlas is about to go
  edits += 1;
  field.value = lambda;
  document.querySelector('[data-pointer="/motion/window"]').value = window ?? "";
  say(`λ = ${lambda}`);
  look();
}

async function submit() {
  const mine = edits;
  fill($("job"), h("p", {}, "Submitted…"));
  try {
    let job = await post("v1/jobs", problemOf(), { headers: { Prefer: "wait=2" } });
    if (!OVER.includes(job.state)) {
      const { follow } = await import("./follow.js");
      await follow({
        events: `v1/jobs/${job.id}/events`, path: `v1/jobs/${job.id}`, name: "job", every: 400, isOver: ({ state }) => OVER.includes(state),
        seen: (name, found) => {
          if (name !== "job") return;
          job = found;
          fill($("job"), h("p", {}, `${job.state}, ${number(100 * job.progress, 3)} %`));
        },
        lost: (isLost) => { if (isLost) fill($("job"), h("p", {}, "The service does not answer; trying again.")); },
      });
    }
    const path = `./solution?id=${job.solution}`;
    if (job.solution && mine === edits) location.href = path;
    else if (job.solution) fill($("job"), h("p", {}, "What was submitted is solved: ", h("a", { href: path }, "see the solution"), ". The form has been changed since."));
    else fill($("job"), h("div", { class: "notice bad" }, `The job ${job.state}${job.error ? `: ${job.error.detail ?? job.error.code}` : "."}`));
  } catch (error) {
    showFaults(error.faults ?? []);
    if (isNotAllowed(error)) notAllowed(error);
    else fill($("job"), troubleOf(error));
  }
}

/** Say beside each tier what it is expected to cost and to reach, and where it saves no time; or why it is not to be had. */
function describeTiers(tiers) {
  tiers.forEach(({ tier, expected_seconds: seconds, expected_error: error, unavailable }, k) => {
    const better = tiers[k + 1];
    const saves = !better?.expected_seconds || seconds < WORTH * better.expected_seconds;
    const cost = seconds === null ? "not measured here" : `${number(1000 * seconds, 2)} ms, reaches ${number(error, 1)}${saves ? "" : `; no faster than ${better.tier}`}`;
    document.querySelector(`#tiers [data-tier=${tier}]`)?.replaceChildren(unavailable ?? cost);
  });
}

/** Show the tiers; until there is a plan of this problem, with the medians of the installation's table. */
async function showTiers() {
  const { rows, tolerances } = await get("v1/accuracy");
  const chosen = problemOf().accuracy.tier;
  const median = (values) => values.sort((x, y) => x - y)[Math.floor(values.length / 2)] ?? null;
  fill($("tiers"), Object.keys(tolerances).map((tier) => h("label", { class: "tier" }, h("input", { type: "radio", name: "tier", value: tier, checked: tier === chosen }),
    h("span", {}, h("strong", {}, tier), ` ≤ ${number(tolerances[tier], 1)}`), h("span", { class: "error", "data-tier": tier }))));
  usual = Object.keys(tolerances).map((tier) => {
    const of = rows.filter((row) => row.tier === tier && row.kind !== "any state");
    return { tier, expected_seconds: median(of.map((row) => row.seconds)), expected_error: median(of.map((row) => row.claimed_error)), unavailable: null };
  });
  describeTiers(usual);
}

function asCurl() {
  const text = JSON.stringify(problemOf()).replaceAll("'", "'\\''");
  return `curl -s '${new URL("v1/jobs", document.baseURI).href}' -H 'Content-Type: application/json' -H 'Prefer: wait=30' -d '${text}'`;
}

function stated() {
  try { return location.hash ? JSON.parse(decodeURIComponent(location.hash.slice(1))) : FIRST; } catch { return FIRST; }
}

const problem = { ...FIRST, ...stated() };
build("expression", "planar");
fillForm(problem);
fill($("copies"), copier("Copy as curl", asCurl), copier("Copy as Python", () => asPython(problemOf(), new URL(".", document.baseURI).href)));
$("form").addEventListener("input", changed);
$("form").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!$("submit").disabled) during([$("submit")], submit);
});
for (const button of document.querySelectorAll(".sweep-open")) {
  button.addEventListener("click", () => during([button], async () => {
    const { openForm } = await import("./sweep_form.js");
    const isDrawn = !$("atlas-section").hidden;
    await openForm({ problem: problemOf(), ends: isDrawn ? [$("from").value.trim(), $("to").value.trim()] : null }).catch((error) => fill($("job"), troubleOf(error)));
  }));
}
$("submit").disabled = false; // who pressed it before somebody listens would lose the problem
for (const id of ["type", "motion-type"]) $(id).addEventListener("change", () => { build($("type").value, $("motion-type").value); changed(); });
for (const id of ["from", "to"]) $(id).addEventListener("input", changed);
addEventListener("hashchange", () => { fillForm({ ...FIRST, ...stated() }); look(); });
run(async () => {
  await showTiers();
  await look();
});
