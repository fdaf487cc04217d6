// The points of a sweep as arrays of NumPy (.npz): numbers come as they are in memory, so a million of them need no parsing.
import { request } from "./core.js";

const DIRECTORY = 0x02014b50;
const END = 0x06054b50;
const NUMBERS = { "<f8": Float64Array, "<f4": Float32Array, "<i8": BigInt64Array, "<i4": Int32Array, "<i2": Int16Array };

/** Return the arrays of an archive by their names: typed arrays, rows one after the other, and texts as {words, codes}. */
export function arraysOf(buffer) {
  const view = new DataView(buffer);
  const text = (from, length) => new TextDecoder().decode(new Uint8Array(buffer, from, length));
  let end = buffer.byteLength - 22;
  while (view.getUint32(end, true) !== END) end -= 1;
  let at = view.getUint32(end + 16, true);
  const found = {};
  while (view.getUint32(at, true) === DIRECTORY) {
    const [nameLength, extraLength, commentLength] = [28, 30, 32].map((place) => view.getUint16(at + place, true));
    const local = view.getUint32(at + 42, true);
    const name = text(at + 46, nameLength).replace(/\.npy$/, "");
    found[name] = arrayAt(buffer, local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true));
    at += 46 + nameLength + extraLength + commentLength;
  }
  return found;
}

/** Return the array of a .npy file that begins at ``start``. */
function arrayAt(buffer, start) {
  const view = new DataView(buffer);
  const isLong = view.getUint8(start + 6) > 1;
  const length = isLong ? view.getUint32(start + 8, true) : view.getUint16(start + 8, true);
  const begin = start + (isLong ? 12 : 10);
  const header = new TextDecoder().decode(new Uint8Array(buffer, begin, length));
  const kind = header.match(/'descr': '([^']*)'/)[1];
  const shape = header.match(/'shape': \(([^)]*)\)/)[1].split(",").filter((part) => part.trim()).map(Number);
  const count = shape.reduce((product, side) => product * side, 1);
  const data = begin + length;
  if (kind.startsWith("<U")) {
    const width = Number(kind.slice(2));
    return texts(new Uint32Array(buffer.slice(data, data + 4 * width * count)), width, count);
  }
  const Numbers = NUMBERS[kind];
  const numbers = new Numbers(buffer.slice(data, data + count * Numbers.BYTES_PER_ELEMENT));
  return numbers instanceof BigInt64Array ? Float64Array.from(numbers, Number) : numbers;
}

/** Return the few words among many texts, and for each text the place of its word: most are like the one before. */
function texts(letters, width, count) {
  const [words, seen] = [[], []];
  const codes = new Int16Array(count);
  const isAt = (start, k) => {
    for (let n = 0; n < width; n += 1) if (letters[start + n] !== letters[k * width + n]) return false;
    return true;
  };
  let last = -1;
  for (let k = 0; k < count; k += 1) {
    if (last < 0 || !isAt(seen[last], k)) last = seen.findIndex((start) => isAt(start, k));
    if (last < 0) {
      const word = letters.subarray(k * width, (k + 1) * width);
      const over = word.indexOf(0);
      words.push(String.fromCodePoint(...(over < 0 ? word : word.subarray(0, over))));
      last = seen.push(k * width) - 1;
    }
    codes[k] = last;
  }
  return { words, codes };
}

async function packed(address) {
  const answer = await request(address, { headers: { Accept: "application/x-npz" } });
  const content = await answer.arrayBuffer();
  performance.mark("points-arrived");
  return arraysOf(content);
}

/** Ask for the points of a picture: a matrix of a grid, with the others of its ``axes`` held at ``places``, or the rows of a list. */
export async function planeOf(path, axes, isGrid, { of, x, y, group, held }, places) {
  const pointers = axes.map(({ pointer }) => pointer);
  if (!isGrid) {
    const found = await packed(`${path}/points?format=npz&columns=${encodeURIComponent(["index", ...pointers, of, "outcome"].join(","))}`);
    return { numbers: found[of], ...found.outcome, columns: (pointer) => found[pointer.slice(1)], index: (cell) => found.index[cell] };
  }
  const at = held.map((pointer) => `&at=${encodeURIComponent(`${pointer}=${places.get(pointer)}`)}`).join("");
  const found = await packed(`${path}/grid?format=npz&of=${encodeURIComponent(of)}${at}`);
  const free = pointers.filter((pointer) => [x, y, group].includes(pointer));
  const values = Object.fromEntries(free.map((pointer) => [pointer, found[pointer.slice(1)]]));
  const width = values[free.at(-1)].length;
  const step = (pointer) => (pointer === free.at(-1) ? 1 : width);
  const [first, byRow, byColumn] = found.indices;
  return { numbers: found[of], codes: found.outcome, words: found.outcomes.words, values, step, steps: [step(x), y ? step(y) : 0],
    index: (cell) => first + Math.floor(cell / width) * byRow + (cell % width) * byColumn };
}

/** Return the places of values in their order; mostly they are in order already. */
function sorted(values) {
  const order = Uint32Array.from(values, (_, k) => k);
  for (let k = 1; k < values.length; k += 1) if (values[k] < values[k - 1]) return order.sort((left, right) => values[left] - values[right]);
  return order;
}

/** Return the cells of each line over x in their order: of a matrix a line for each value of the other axis, of a list one. */
export function linesOf(plane, { x, group }) {
  if (plane.columns) return [{ value: null, rows: sorted(plane.columns(x)) }];
  const order = sorted(plane.values[x]);
  return Array.from(group ? plane.values[group] : [null], (value, n) =>
    ({ value, rows: order.map((k) => k * plane.step(x) + (group ? n * plane.step(group) : 0)) }));
}
