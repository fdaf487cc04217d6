// What is known of a solution, in words and numbers.
import { h, measured, number } from "./core.js";

const ENDS = { pole: "a pole", equator: "the equator", rest: "rest", separatrix: "a separatrix", collision: "a collision" };
const ENDLESS = {
  separatrix: "on a separatrix: it approaches an equilibrium for ever", equilibrium: "an equilibrium: nothing moves",
  collision: "it runs into a singularity of the potential", pole: "it approaches a pole for ever",
};

const fact = (name, ...value) => h("div", {}, h("dt", {}, name), h("dd", {}, ...value.flat()));

/** Return the facts of a solution, each with its error, as parts of a description list. */
export function factsOf(solution) {
  const { period, aperiodic, energy, window: range, invariants, cross_check: check, stability, precession } = solution;
  const drift = Object.entries(invariants ?? {}).filter(([, value]) => value?.drift !== undefined);
  return [
    period ? fact("Period", measured(period)) : fact("Period", aperiodic ? `none, ${ENDLESS[aperiodic] ?? aperiodic}` : "none is known"),
    energy ? fact("Energy", measured(energy)) : null,
    fact("Error of a sample", h("span", { class: "value" }, `≤ ${number(solution.error, 2)}`)),
    range ? fact("Fills", `from ${ENDS[range.ends[0]] ?? range.ends[0]} to ${ENDS[range.ends[1]] ?? range.ends[1]}`,
      h("span", { class: "error" }, ` γ₁ in [${range.g1.map((x) => number(x, 5)).join(", ")}]`)) : null,
    drift.length ? fact("Drift", drift.map(([name, value], k) => [k ? ", " : "", `${name} `, h("span", { class: "value" }, number(value.drift, 2))]).flat()) : null,
    precession ? fact("Precession ψ in a period", measured(precession.psi1)) : null,
    stability ? fact("In its plane it is", h("span", { class: "value" }, stability.verdict), h("span", { class: "error" },
      ` trace ${number(stability.trace, 8)} ± ${number(stability.error, 2)}`)) : null,
    stability?.trusted_time ? fact("An integration holds until", h("span", { class: "value" }, `t ≈ ${number(stability.trusted_time, 4)}`)) : null,
    check ? fact("Second method", `${check.method} ${check.agrees ? "agrees" : "disagrees"}`, h("span", { class: "error" }, ` within ${number(check.disagreement, 2)}`)) : null,
    fact("How", `${solution.method}, tier ${solution.tier}`, h("span", { class: "error" }, ` ${number(solution.cost.compute_seconds, 2)} s`)),
  ].filter(Boolean);
}
