// Many rows at once: which are chosen, what is done with each, and what became of it.
import { $, download, during, fill, get, h, onceKey, post, request, say, STUDIES } from "./core.js";

const TOGETHER = 4;
const LIVE = ["queued", "running"];
/** Solutions that one page compares. */
const MOST_COMPARED = 6;
/** Rows that one condition names. */
const MOST_NAMED = 200;

/** The chosen rows, by id; they stay chosen while the table is renewed. */
export const chosen = new Map();
/** What became of the last change of a row, by id, where it was refused. */
export const refused = new Map();

function showCount() {
  $("bulk").hidden = chosen.size === 0 && !$("bulk").contains(document.activeElement); // nobody loses the control that they are at
  $("chosen").textContent = chosen.size ? `${chosen.size} chosen` : "";
  const items = [...chosen.values()];
  for (const button of $("acts").children) button.disabled = !actions.find(({ id }) => id === button.id).fits(items);
}

/** Return the box by which a row is chosen. */
export function boxOf(item) {
  if (chosen.has(item.id)) chosen.set(item.id, item);
  return h("input", { type: "checkbox", class: "choose", "data-id": item.id, checked: chosen.has(item.id), "aria-label": `Choose ${item.id}`, onchange: ({ target }) => {
    if (target.checked) chosen.set(item.id, item);
    else chosen.delete(item.id);
    showCount();
    showAll();
    say($("chosen").textContent || "nothing chosen");
  } });
}

const boxes = () => [...document.querySelectorAll("input.choose")];

function showAll() {
  const all = $("choose-all");
  if (!all) return;
  const count = boxes().filter((box) => box.checked).length;
  all.checked = count > 0 && count === boxes().length;
  all.indeterminate = count > 0 && !all.checked;
}

/** Return the box by which all rows of a page are chosen. */
export const allBox = (items) => h("input", { type: "checkbox", id: "choose-all", "aria-label": "Choose all on this page", onchange: ({ target }) => {
  for (const item of items) {
    if (target.checked) chosen.set(item.id, item);
    else chosen.delete(item.id);
  }
  for (const box of boxes()) box.checked = target.checked;
  showCount();
  say($("chosen").textContent || "nothing chosen");
} });

export function settled() {
  showCount();
  showAll();
}

/** Return labels and note of a row; a label becomes a condition. */
export function labelsOf(item, quoted, ask) {
  const labels = Object.entries(item.labels ?? {}).map(([key, value]) => h("button", { type: "button", class: "chip", onclick: () => ask(`label.${key}=${quoted(value)}`) }, `${key}: ${value}`));
  return [...labels, item.note ? h("span", { class: "hint note" }, item.note) : null, refused.has(item.id) ? h("span", { class: "fault" }, refused.get(item.id)) : null].filter(Boolean);
}

/**
 * Change one thing: only if what stands there is what was shown. The tag of what was read goes with the change,
 * so that nobody's change is lost who comes in between.
 */
async function change(path, item, patch) {
  const answer = await request(path);
  const found = await answer.json();
  for (const key of Object.keys(patch.labels ?? {})) {
    if ((found.labels[key] ?? null) !== (item.labels[key] ?? null)) throw new Error(`somebody has changed ${key} meanwhile; it is now ${found.labels[key] ?? "not there"}`);
  }
  if ("note" in patch && (found.note ?? null) !== (item.note ?? null)) throw new Error(`somebody has changed the note meanwhile; it is now ${found.note ?? "empty"}`);
  await request(path, { method: "PATCH", body: patch, headers: { "If-Match": answer.headers.get("ETag") } });
}

const why = (error) => error.faults?.map(({ message }) => message).join("; ") || error.message;

/**
 * Do something for each row that is chosen, a few at a time, and say what became of it: ``done`` is what has happened to
 * the others, such as "deleted". What fails is shown in its row and stays chosen.
 */
async function each(items, done, work, renew) {
  const waiting = [...items];
  const count = waiting.length;
  refused.clear();
  await during([...$("bulk").querySelectorAll("button:enabled")], () => Promise.all(Array.from({ length: TOGETHER }, async () => {
    for (let item = waiting.pop(); item; item = waiting.pop()) {
      try {
        await work(item);
        chosen.delete(item.id);
      } catch (error) {
        refused.set(item.id, `Not ${done}: ${why(error)}`);
      }
    }
  })));
  const outcome = `${count - refused.size} ${done}${refused.size ? `, ${refused.size} failed: the reasons are in their rows` : ""}`;
  await renew();
  showCount();
  $("bulk").hidden = false;
  $("bulk-outcome").textContent = outcome;
  say(outcome);
}

/** The path of the resource that a list shows. */
const pathOf = (name) => `v1/${name === "studies" ? "jobs" : name}`;

/** Ask whether some rows shall be deleted. */
function mayDelete(name, { length }) {
  const dialog = $("delete-dialog");
  $("delete-what").textContent = `${length.toLocaleString("en")} ${length > 1 ? name : name === "studies" ? "study" : name.slice(0, -1)} will be deleted from the database, with all that belongs to ${length === 1 ? "it" : "them"}.`;
  dialog.returnValue = "cancel";
  dialog.showModal();
  return new Promise((resolve) => dialog.addEventListener("close", () => resolve(dialog.returnValue === "delete"), { once: true }));
}

/** Send the problem, the question or the sweep of a row once more, as new work. */
async function again(name, { id, problem, labels, note }) {
  const document = name === "sweeps" ? (await get(`v1/sweeps/${id}`)).document : problem;
  const { what, ...question } = document;
  if (name === "studies") await post(`v1/${STUDIES[what]}`, question, { headers: { Prefer: "respond-async", "Idempotency-Key": onceKey() } });
  else await post(pathOf(name), { ...document, labels, ...(note ? { note } : {}) }, { headers: { "Idempotency-Key": onceKey() } });
}

/** Delete a row; one that is gone already is no failure. */
async function remove(name, { id }) {
  try {
    await request(`${pathOf(name)}/${id}`, { method: "DELETE" });
  } catch (error) {
    if (error.status !== 404) throw error;
  }
}

const solutionOf = (name, item) => (name === "solutions" ? item.id : item.solution);
const isLive = ({ state }) => LIVE.includes(state);

/** Return what a list can do with rows: the name of each button, for which rows it is there, and what it does. */
const actionsOf = (name, renew) => [
  !["sweeps", "studies"].includes(name) && { id: "act-compare", label: "Compare", fits: (items) => items.length > 1 && items.length <= MOST_COMPARED && items.every((item) => solutionOf(name, item)),
    act: (items) => {
      const [first, ...others] = items.map((item) => solutionOf(name, item));
      location.href = `./solution?${new URLSearchParams([["id", first], ...others.map((id) => ["with", id])])}#compare-section`;
    } },
  name !== "solutions" && { id: "act-cancel", label: "Cancel", fits: (items) => items.some(isLive),
    act: (items) => each(items.filter(isLive), "cancelled", ({ id }) => request(`${pathOf(name)}/${id}/cancel`, { method: "POST" }), renew) },
  name !== "solutions" && { id: "act-again", label: name === "studies" ? "Ask again" : "Solve again", fits: (items) => items.length && !items.some(isLive), act: (items) => each(items, "sent again", (item) => again(name, item), renew) },
  { id: "act-csv", label: "Download as CSV", fits: (items) => items.length && items.length <= MOST_NAMED,
    act: (items) => download(`${pathOf(name)}?${new URLSearchParams({ format: "csv", ...(name === "studies" ? { kind: "study" } : {}), where: `id in (${items.map(({ id }) => id).join(",")})` })}`, `${name}.csv`) },
  { id: "act-delete", label: "Delete…", fits: (items) => items.length && !items.some(isLive),
    act: async (items) => { if (await mayDelete(name, items)) await each(items, "deleted", (item) => remove(name, item), renew); } },
].filter(Boolean);

let actions = [];

/** Listen to the form of what is done with the chosen rows. */
export function listen(name, renew) {
  const { elements } = $("bulk");
  actions = actionsOf(name, renew);
  fill($("acts"), actions.map(({ id, label, act }) => h("button", { type: "button", id, class: "small",
    onclick: () => Promise.resolve(act([...chosen.values()])).catch((error) => { $("bulk-outcome").textContent = why(error); }) }, label)));
  const act = (make) => async () => {
    const patch = make();
    $("bulk-outcome").textContent = chosen.size ? "" : "Choose some rows first.";
    if (chosen.size) await each(chosen.values(), "changed", (item) => change(`${pathOf(name)}/${item.id}`, item, patch), renew);
  };
  const needsKey = (work) => () => {
    if (elements.key.reportValidity()) work();
  };
  $("label-add").onclick = needsKey(act(() => ({ labels: { [elements.key.value.trim()]: elements.value.value } })));
  $("label-remove").onclick = needsKey(act(() => ({ labels: { [elements.key.value.trim()]: null } })));
  $("note-set").onclick = act(() => ({ note: elements.note.value || null }));
  $("choose-none").onclick = () => {
    chosen.clear();
    for (const box of boxes()) box.checked = false;
    $("bulk-outcome").textContent = "";
    settled();
    say("nothing chosen");
  };
  $("bulk").addEventListener("submit", (event) => {
    event.preventDefault();
    $(event.submitter?.id || "label-add").click();
  });
  fill($("bulk-outcome"));
}
