// Follows what changes: by the service's events where it has them, else by asking again.
import { get, Refusal, pause, request } from "./core.js";

const LONGEST_PAUSE = 5000;
const NO_EVENTS = [404, 405, 406];

/**
 * Call ``seen(name, document)`` with each change until ``isOver(document)`` or the signal says stop.
 *
 * ``events`` is the path of the stream, ``path`` of the resource and ``name`` what its event is called.
 * ``lost(isLost)`` is told when the service stops answering, and when it answers again.
 */
export async function follow({ events, path, name, seen, isOver = () => false, lost = () => {}, signal, every = 1000 }) {
  let hasEvents = true;
  let last = null;
  let wait = every;
  while (!signal?.aborted) {
    try {
      if (hasEvents) {
        for await (const event of stream(events, last, signal)) {
          lost(false);
          wait = every;
          last = event.id ?? last;
          // The end of a stream need not be that of the thing: a service that stops ends all of them.
          const [what, found] = event.name === "end" ? [name, await get(path, { signal })] : [event.name, event.data];
          seen(what, found);
          if (what === name && isOver(found)) return;
        }
      } else {
        const found = await get(path, { signal });
        lost(false);
        seen(name, found);
        if (isOver(found)) return;
        wait = every;
      }
    } catch (error) {
      if (signal?.aborted) return;
      if (error instanceof Refusal && hasEvents && hasNone(error)) {
        hasEvents = false;
        continue;
      }
      if (error instanceof Refusal && error.status < 500 && error.status !== 429) throw error;
      lost(true);
      wait = Math.min(2 * wait, LONGEST_PAUSE);
    }
    await pause(document.hidden ? LONGEST_PAUSE : wait);
  }
}

/** Tell whether a refusal means that there are no events to be had: none at all, or not one more stream. */
const hasNone = ({ status, problem }) => NO_EVENTS.includes(status) || String(problem.type).endsWith("too_many_streams");

/** Read a text/event-stream with the key of the tab, which an EventSource cannot send. */
async function* stream(path, last, signal) {
  const headers = { Accept: "text/event-stream", ...(last === null ? {} : { "Last-Event-ID": last }) };
  const answer = await request(path, { headers, signal });
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      const blocks = (text + value.replaceAll("\r\n", "\n")).split("\n\n");
      text = blocks.pop();
      for (const block of blocks) {
        const event = { name: "message", id: undefined, data: "" };
        for (const line of block.split("\n")) {
          const [, field, content] = line.match(/^([^:]*):? ?(.*)$/);
          if (field === "event") event.name = content;
          else if (field === "id") event.id = content;
          else if (field === "data") event.data += content;
        }
        if (event.data) yield { ...event, data: JSON.parse(event.data) };
        else if (event.name === "end") yield event;
      }
    }
  } finally {
    await reader.cancel().catch(() => {});
  }
}
