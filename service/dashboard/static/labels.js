// Labels and notes of many rows at once: which are chosen, what is sent for each, what became of it.
import { $, during, fill, h, request, say } from "./core.js";

const TOGETHER = 4;

/** The chosen rows, by id; they stay chosen while the table is renewed. */
export const chosen = new Map();
/** What became of the last change of a row, by id, where it was refused. */
export const refused = new Map();

function showCount() {
  $("bulk").hidden = chosen.size === 0 && !$("bulk").contains(document.activeElement); // nobody loses the control that they are at
  $("chosen").textContent = chosen.size ? `${chosen.size} chosen` : "";
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

/** Send a patch for each chosen row, a few at a time; what fails is shown in its row and stays selected. */
async function send(name, patch, renew) {
  const waiting = [...chosen.values()];
  const count = waiting.length;
  refused.clear();
  await during([...$("bulk").querySelectorAll("button")], () => Promise.all(Array.from({ length: TOGETHER }, async () => {
    for (let item = waiting.pop(); item; item = waiting.pop()) {
      try {
        await change(`v1/${name}/${item.id}`, item, patch);
        chosen.delete(item.id);
      } catch (error) {
        refused.set(item.id, `Not changed: ${why(error)}`);
      }
    }
  })));
  const outcome = `${count - refused.size} changed${refused.size ? `, ${refused.size} failed: the reasons are in their rows` : ""}`;
  await renew();
  showCount();
  $("bulk").hidden = false;
  $("bulk-outcome").textContent = outcome;
  say(outcome);
}

/** Listen to the form of the marks. */
export function listen(name, renew) {
  const { elements } = $("bulk");
  const act = (make) => async () => {
    const patch = make();
    $("bulk-outcome").textContent = chosen.size ? "" : "Choose some rows first.";
    if (chosen.size) await send(name, patch, renew);
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
