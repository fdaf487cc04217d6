// Pictures that leave the page: SVG, PNG and PDF at the width of a journal, GIF and WebM of what moves.
// They are drawn anew in the light colours on white, whatever the theme of the page is.
import { h, save } from "./core.js";

const DPI = 600;
const PIXELS = 96; // of an inch, in style sheets
const COLUMN = 340; // pixels, 90 mm: one column of a journal; what a chart takes is both of them
const PAGE = 680;
const FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif";
const FILM = 480; // pixels
const RATE = 25; // frames of a second: a GIF counts in hundredths
const MOST_COLOURS = 256;
const SEEN = [0, 0.25, 0.5, 0.75]; // the places in a film whose colours are those of all of it
/** The chunk of a PNG that tells its size in print: 23622 pixels a metre, with its checksum. */
const DENSITY = [0, 0, 0, 9, 0x70, 0x48, 0x59, 0x73, 0, 0, 0x5c, 0x46, 0, 0, 0x5c, 0x46, 1, 0x14, 0x94, 0x43, 0x41];
const HEAD_OF_PNG = 33; // bytes: the signature and the chunk IHDR

const millimetres = (pixels) => `${((25.4 * pixels) / PIXELS).toFixed(2)}mm`;

/** Run ``work`` with an element in the page, unseen, whose style sheet has the colours of print. */
async function onPaper(element, work) {
  const paper = h("div", { class: "print", "aria-hidden": "true" });
  paper.append(element);
  document.body.append(paper);
  try {
    return await work(paper);
  } finally {
    paper.remove();
  }
}

/** Return what the style sheet makes of the parts of a picture that is in the page: [[element, style, width of its line]]. */
function styled(svg, size) {
  const unit = svg.viewBox.baseVal.width / size;
  return [...svg.querySelectorAll("path, circle, text")].map((element) => {
    const style = getComputedStyle(element);
    const width = parseFloat(style.strokeWidth);
    return [element, style, style.vectorEffect === "none" ? width : width * unit];
  });
}

/** Return an SVG of the page as one that needs no style sheet. */
function standalone(source) {
  const svg = source.cloneNode(true);
  return onPaper(svg, () => {
    const { x, y, width, height } = svg.viewBox.baseVal;
    for (const [element, style, line] of styled(svg, COLUMN)) {
      const { fill, stroke, opacity } = style;
      const known = element.tagName === "text" ? { fill, opacity, "font-family": FONT, "font-size": style.fontSize.replace("px", ""), "text-anchor": style.textAnchor }
        : { fill, stroke, opacity, "stroke-width": line.toPrecision(3), "stroke-linejoin": "round" };
      element.removeAttribute("class");
      for (const [name, value] of Object.entries(known)) element.setAttribute(name, value);
    }
    for (const name of ["class", "tabindex", "role"]) svg.removeAttribute(name);
    svg.prepend(h("svg:rect", { x, y, width, height, fill: "#ffffff" }));
    const high = (COLUMN * height) / width;
    svg.setAttribute("width", millimetres(COLUMN));
    svg.setAttribute("height", millimetres(high));
    return { text: new XMLSerializer().serializeToString(svg), width: COLUMN, height: high };
  });
}

/** Return {text, width, height} of a picture: a chart is drawn again by its library. */
async function drawing(place) {
  if (!place.print) return standalone(place.querySelector("svg"));
  const height = place.clientHeight;
  const text = await onPaper(h("i"), (paper) => place.print({ paper, width: PAGE, height, font: FONT }));
  // As text: where it is parsed, the policy of the page would forbid its styles.
  const root = ([head]) => `${head.replace(/ (width|height|viewBox|style)="[^"]*"/g, "").slice(0, -1)} width="${millimetres(PAGE)}" height="${millimetres(height)}" viewBox="0 0 ${PAGE} ${height}">`;
  return { text: text.replace(/^<svg[^>]*>/, (...found) => root(found)), width: PAGE, height };
}

async function painted({ text, width, height }) {
  const address = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = address;
    await image.decode();
    const scale = DPI / PIXELS;
    const canvas = Object.assign(document.createElement("canvas"), { width: Math.round(width * scale), height: Math.round(height * scale) });
    const context = canvas.getContext("2d");
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    return canvas;
  } finally {
    URL.revokeObjectURL(address);
  }
}

async function png(picture) {
  const canvas = await painted(picture);
  const blob = await new Promise((resolve) => { canvas.toBlob(resolve, "image/png"); });
  return new Blob([blob.slice(0, HEAD_OF_PNG), new Uint8Array(DENSITY), blob.slice(HEAD_OF_PNG)], { type: "image/png" });
}

/** Return a page that is one picture, its pixels packed without loss (PDF 1.4, 7.4.4 and 8.9.5 of ISO 32000-1). */
async function pdf(picture, title) {
  const canvas = await painted(picture);
  const { data, width, height } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const colours = new Uint8Array(3 * width * height);
  for (let from = 0, to = 0; from < data.length; from += 4, to += 3) {
    colours[to] = data[from];
    colours[to + 1] = data[from + 1];
    colours[to + 2] = data[from + 2];
  }
  const packed = new Uint8Array(await new Response(new Blob([colours]).stream().pipeThrough(new CompressionStream("deflate"))).arrayBuffer());
  const [wide, high] = [picture.width, picture.height].map((pixels) => ((72 * pixels) / PIXELS).toFixed(3));
  const content = `q ${wide} 0 0 ${high} 0 0 cm /Picture Do Q`;
  const named = [...`\ufeff${title}`].flatMap((letter) => [...letter].map((_, k) => letter.charCodeAt(k).toString(16).padStart(4, "0"))).join("");
  const objects = [
    ["<< /Type /Catalog /Pages 2 0 R >>"], ["<< /Type /Pages /Kids [3 0 R] /Count 1 >>"],
    [`<< /Type /Page /Parent 2 0 R /MediaBox [0 0 ${wide} ${high}] /Contents 4 0 R /Resources << /XObject << /Picture 5 0 R >> >> >>`],
    [`<< /Length ${content.length} >>\nstream\n${content}\nendstream`],
    [`<< /Type /XObject /Subtype /Image /Width ${width} /Height ${height} /ColorSpace /DeviceRGB /BitsPerComponent 8 /Filter /FlateDecode /Length ${packed.length} >>\nstream\n`, packed, "\nendstream"],
    [`<< /Title <${named}> /Creator (polhode) >>`],
  ];
  const parts = ["%PDF-1.4\n"];
  const sizeOf = (list) => list.reduce((sum, part) => sum + part.length, 0);
  const places = objects.map((object, k) => {
    const place = sizeOf(parts);
    parts.push(`${k + 1} 0 obj\n`, ...object, "\nendobj\n");
    return place;
  });
  const table = places.map((place) => `${String(place).padStart(10, "0")} 00000 n \n`).join("");
  parts.push(`xref\n0 ${objects.length + 1}\n0000000000 65535 f \n${table}trailer\n<< /Size ${objects.length + 1} /Root 1 0 R /Info 6 0 R >>\nstartxref\n${sizeOf(parts)}\n%%EOF\n`);
  return new Blob(parts, { type: "application/pdf" });
}

/** Return what paints the SVG of a film on a canvas, for any place in it from 0 to 1. */
function projector({ scene, box }, paper) {
  const svg = h("svg:svg", { viewBox: box });
  paper.append(svg);
  const canvas = Object.assign(document.createElement("canvas"), { width: FILM, height: FILM });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const { x, y, width } = svg.viewBox.baseVal;
  const scale = FILM / width;
  const show = (share) => {
    svg.replaceChildren(...scene(share));
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, FILM, FILM);
    context.setTransform(scale, 0, 0, scale, -x * scale, -y * scale);
    context.lineJoin = "round";
    for (const [element, style, line] of styled(svg, FILM)) {
      context.globalAlpha = Number(style.opacity);
      context.lineWidth = line;
      context.fillStyle = style.fill;
      context.strokeStyle = style.stroke;
      if (element.tagName === "text") {
        context.font = `${style.fontSize} ${FONT}`;
        context.textAlign = { middle: "center", end: "right" }[style.textAnchor] ?? "left";
        context.fillText(element.textContent, Number(element.getAttribute("x")), Number(element.getAttribute("y")));
        continue;
      }
      const [cx, cy, r] = ["cx", "cy", "r"].map((name) => Number(element.getAttribute(name)));
      const path = new Path2D(element.getAttribute("d") ?? "");
      if (element.tagName === "circle") path.arc(cx, cy, r, 0, 2 * Math.PI);
      if (style.fill !== "none") context.fill(path);
      if (style.stroke !== "none") context.stroke(path);
    }
  };
  return { canvas, context, show };
}

function gif(film, progress) {
  return onPaper(h("i"), async (paper) => {
    const { GIFEncoder, quantize, applyPalette } = await import("./gifenc.js");
    const { context, show } = projector(film, paper);
    const count = Math.round(film.seconds * RATE);
    const file = GIFEncoder();
    const pixels = (share) => {
      show(share);
      return context.getImageData(0, 0, FILM, FILM).data;
    };
    const some = new Uint8ClampedArray(SEEN.length * 4 * FILM * FILM);
    SEEN.forEach((share, k) => some.set(pixels(share), k * 4 * FILM * FILM));
    const palette = quantize(some, MOST_COLOURS);
    for (let k = 0; k < count; k += 1) {
      const data = pixels(k / count);
      file.writeFrame(applyPalette(data, palette), FILM, FILM, { palette: k ? undefined : palette, delay: 1000 / RATE, repeat: 0 });
      if (k % RATE === 0) {
        progress(k / count);
        await new Promise((resolve) => { setTimeout(resolve); });
      }
    }
    file.finish();
    return new Blob([file.bytes()], { type: "image/gif" });
  });
}

/** Return a film that is recorded while it runs: it takes as long as it lasts. */
function webm(film, progress) {
  return onPaper(h("i"), async (paper) => {
    if (!globalThis.MediaRecorder?.isTypeSupported("video/webm")) throw new Error("this browser records no WebM");
    const { canvas, show } = projector(film, paper);
    show(0);
    const recorder = new MediaRecorder(canvas.captureStream(), { mimeType: "video/webm", videoBitsPerSecond: 4e6 });
    const parts = [];
    recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
    const isOver = new Promise((resolve) => { recorder.addEventListener("stop", resolve); });
    recorder.start();
    const began = performance.now();
    let share = 0;
    while (share < 1) {
      show(share);
      progress(share);
      await new Promise((resolve) => { requestAnimationFrame(resolve); });
      share = (performance.now() - began) / (1000 * film.seconds);
    }
    recorder.stop();
    await isOver;
    return new Blob(parts, { type: "video/webm" });
  });
}

const WRITERS = {
  svg: async (place) => new Blob([(await drawing(place)).text], { type: "image/svg+xml" }),
  png: async (place) => png(await drawing(place)),
  pdf: async (place, title) => pdf(await drawing(place), title),
  gif: (place, title, progress) => gif(place.film(), progress),
  webm: (place, title, progress) => webm(place.film(), progress),
};

/** Save a picture as a file. ``names``: of the page, of what it shows, of the picture; ``progress(share)`` hears how far it is. */
export async function saved(place, kind, names, progress) {
  save(await WRITERS[kind](place, names[0], progress), `polhode-${names.slice(1).filter(Boolean).join("-")}.${kind}`);
}
