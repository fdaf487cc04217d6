// Follows what changes by the service's events, and finds the service again when it went away.
import { get, Refusal, pause, request } from "./core.js";

const LONGEST_PAUSE = 5000;

/**
 * Call ``seen(name, document)`` with each change until ``isOver(document)`` or the signal says stop.
 *
 * ``events`` is the path of the stream, ``path`` of the resource and ``name`` what its event is called.
 * ``lost(isLost)`` is called when the service stops answering, and when it answers again.
 */
export async function follow({ events, path, name, seen, isOver = () => false, lost = () => {}, signal, every = 1000 }) {
  let last = null;
  let wait = every;
  const look = async () => {
    const found = await get(path, { signal });
    lost(false);
    wait = every;
    seen(name, found);
    return isOver(found);
  };
  while (!signal?.aborted) {
    try {
      for await (const event of stream(events, last, signal)) {
        lost(false);
        wait = every;
        last = event.id ?? last;
        // The end of a stream need not be that of the thing: a service that stops ends all of them.
        if (event.name === "end") {
          if (await look()) return;
        } else {
          seen(event.name, event.data);
          if (event.name === name && isOver(event.data)) return;
        }
      }
    } catch (error) {
      if (signal?.aborted) return;
      if (error instanceof Refusal && error.status < 500 && error.status !== 429) throw error;
      // With all streams taken by others, what there is now is still shown.
      const isFull = String(error.problem?.type).endsWith("too_many_streams");
      if (isFull && (await look().catch(() => false))) return;
      if (!isFull) lost(true);
      wait = Math.min(2 * wait, LONGEST_PAUSE);
    }
    await pause(document.hidden ? LONGEST_PAUSE : wait);
  }
}

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
