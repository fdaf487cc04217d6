// Reads the arrays of NumPy (.npz): numbers come as they are in memory, so a million of them need no parsing.

const DIRECTORY = 0x02014b50;
const END = 0x06054b50;
const NUMBERS = { "<f8": Float64Array, "<f4": Float32Array, "<i8": BigInt64Array, "<i4": Int32Array };

/** Return the arrays of an archive by their names: typed arrays of doubles, and lists of texts. */
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
  const count = Number(header.match(/'shape': \((\d*)/)[1] || 1);
  const data = begin + length;
  if (kind.startsWith("<U")) {
    const width = Number(kind.slice(2));
    const letters = new Uint32Array(buffer.slice(data, data + 4 * width * count));
    return Array.from({ length: count }, (_, k) => {
      const word = letters.subarray(k * width, (k + 1) * width);
      const over = word.indexOf(0);
      return String.fromCodePoint(...(over < 0 ? word : word.subarray(0, over)));
    });
  }
  const Numbers = NUMBERS[kind];
  const numbers = new Numbers(buffer.slice(data, data + count * Numbers.BYTES_PER_ELEMENT));
  return numbers instanceof BigInt64Array ? Float64Array.from(numbers, Number) : numbers;
}
