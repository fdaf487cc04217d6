// The language of lists: conditions as text and as chips, facets as conditions that can be added.
import { $, h, refill } from "./core.js";

/** Return the conditions of a text: divided at commas that are in no brackets and no quotation marks. */
export function conditions(text) {
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
export const quoted = (value) => (/^[\w.:+-]+$/.test(value) ? value : `"${String(value).replaceAll('"', '""')}"`);

/** Show each condition as a chip that can be taken away. */
export function showChips(where, changed) {
  const all = conditions(where);
  refill($("chips"), all.map((condition, k) => h("li", {}, h("button", { type: "button", class: "chip", "aria-label": `Take away ${condition}`,
    onclick: () => changed(all.filter((_, other) => other !== k).join(",")) }, condition, h("span", { "aria-hidden": "true" }, " ×")))));
}

/** Show facets; a click on a value adds it as a condition. */
export function showFacets(facets, where, changed) {
  const present = new Set(conditions(where));
  refill($("facets"), facets.filter(({ values }) => values.length).map(({ by, values, others }) => h("div", { class: "facet" }, h("span", { class: "hint" }, by),
    values.map(({ value, count }) => {
      const condition = value === null ? `${by} is null` : `${by}=${quoted(String(value))}`;
      return h("button", { type: "button", class: "quiet", disabled: present.has(condition),
        onclick: () => changed([...present, condition].join(",")) }, `${value ?? "none"} `, h("span", { class: "error" }, String(count)));
    }), others ? h("span", { class: "hint" }, `and ${others} others`) : null)));
}
