// Charts by plotly.js, which is loaded when the first one is needed.
import { exportable, fill, h } from "./core.js";

const HERE = new URL(".", import.meta.url);
/** What the maps in plotly.js look for before they add their styles; there are no maps here. */
const STYLE_OF_MAPS = "9f215cf04c5486422605d13261cb87401f4e7763b6296af81e98efbc0130da53";
let loading = null;

/**
 * Make plotly.js keep to a policy without inline styles: what it writes as text goes through the object model.
 * Its rules go into the style sheet of the page, which has the id that it looks for.
 */
function restrain() {
  const set = Element.prototype.setAttribute;
  Element.prototype.setAttribute = function setAttribute(name, value) {
    if (name === "style") this.style.cssText = value;
    else set.call(this, name, value);
  };
  document.head.append(Object.assign(document.createElement("meta"), { id: STYLE_OF_MAPS }));
}

function plotly() {
  loading ??= new Promise((resolve, reject) => {
    restrain();
    const script = document.createElement("script");
    script.src = new URL("plotly.min.js", HERE).href;
    script.onload = () => resolve(globalThis.Plotly);
    script.onerror = () => { loading = null; reject(new TypeError("the charts could not be loaded")); };
    document.head.append(script);
  });
  return loading;
}

/** Return the colours of the page, or of a part of it, by their names in the style sheet. */
export function colours(element = document.documentElement) {
  const style = getComputedStyle(element);
  const found = {};
  for (const name of ["ink", "soft", "line", "paper", "c1", "c2", "c3", "c4", "c5", "c6", "bad"]) found[name] = style.getPropertyValue(`--${name}`).trim();
  return found;
}

const SYMBOL = 3; // letters: a longer title of a vertical axis is text, which is read from the side

/** Return the names of short vertical axes as annotations above them, and the axes without: plotly turns every title by 90°. */
function uprightNames(axes, layout, ink) {
  const named = Object.entries(axes).filter(([name, axis]) => name.startsWith("y") && axis.title.text && axis.title.text.length <= SYMBOL);
  const names = named.map(([name, { title, anchor }]) => ({ text: title.text, xref: `${anchor ?? "x"} domain`, yref: `${name.replace("axis", "")} domain`, x: 0, y: 1, xshift: -8, yshift: 4,
    xanchor: "right", yanchor: "bottom", showarrow: false, font: { size: 14, color: ink } }));
  // Above the highest panel there is room for a name.
  return { margin: { l: 72, r: 14, t: named.length ? 30 : 10, b: 44 }, ...layout, ...axes, ...Object.fromEntries(named.map(([name, axis]) => [name, { ...axis, title: { text: "" } }])), annotations: [...(layout.annotations ?? []), ...names] };
}

function dressed(layout, { ink, soft, line }) {
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, tickcolor: line, tickfont: { color: soft }, title: { font: { color: soft } } };
  const axes = Object.fromEntries([...new Set(["xaxis", "yaxis", ...Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name))])]
    .map((name) => [name, { ...axis, ...layout[name], title: { ...axis.title, ...layout[name]?.title } }]));
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true,
    font: { family: "system-ui, sans-serif", size: 12, color: ink },
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, hoverlabel: { font: { family: "system-ui, sans-serif" } }, ...uprightNames(axes, layout, ink),
  };
}

/** Return a chart as the text of an SVG, in the colours of ``paper``; what is painted beneath its axes comes along. */
async function printed(library, place, make, { paper, width, height, font }) {
  const { traces, layout } = make(colours(paper));
  const sheet = dressed(layout, colours(paper));
  const beneath = place.parentElement.querySelector(":scope > canvas:not([hidden])");
  const images = beneath ? [{ source: beneath.toDataURL(), xref: "paper", yref: "paper", x: 0, y: 1, sizex: 1, sizey: 1, sizing: "stretch", layer: "below" }] : [];
  const figure = { data: traces, layout: { ...sheet, images, paper_bgcolor: "#ffffff", font: { ...sheet.font, family: font } } };
  const text = await library.toImage(figure, { format: "svg", width, height, imageDataOnly: true });
  return text.startsWith("<") ? text : decodeURIComponent(text);
}

/**
 * Draw into an element; ``make(colours)`` returns {traces, layout} and is called again when the theme changes.
 *
 * Resolves to Plotly, for events of the element.
 */
export async function draw(place, make) {
  const library = await plotly();
  const again = () => {
    const { traces, layout } = make(colours());
    return library.react(place, traces, dressed(layout, colours()), { displayModeBar: false, responsive: true, doubleClick: false, showTips: false, scrollZoom: false });
  };
  exportable(place);
  place.print = (wanted) => printed(library, place, make, wanted);
  await again();
  if (!place.dataset.drawn) {
    place.dataset.drawn = "yes";
    place.on("plotly_afterplot", () => place.point?.());
    document.addEventListener("themechange", () => place.redraw());
  }
  place.redraw = again;
  return library;
}

/**
 * Show the time of a clock in a chart, as a line across each of its panels, and send the clock to where the pointer is.
 *
 * ``at(k)``, if given, is the point of a chart without a time axis that belongs to the k-th sample.
 */
export function pointed(place, clock, at = null) {
  place.leave?.();
  const lines = place.parentElement.querySelector(".cursor") ?? h("div", { class: "cursor", "aria-hidden": "true" });
  place.after(lines);
  const axes = (side) => Object.entries(place._fullLayout ?? {}).filter(([name, axis]) => new RegExp(`^${side}axis\\d*$`).test(name) && axis._length).map(([, axis]) => axis);
  const panels = () => axes("x").filter((axis, k, all) => all.findIndex((other) => other._offset === axis._offset) === k);
  const line = (left, top, kind, height = null) => {
    const element = h("i", { class: kind });
    Object.assign(element.style, { left: `${left}px`, top: `${top}px` }, height === null ? {} : { height: `${height}px` });
    return element;
  };
  place.point = () => {
    if (!place._fullLayout?._size) return;
    const { t: top, h: height } = place._fullLayout._size;
    const [x] = panels();
    const [y] = axes("y");
    if (at) {
      const [across, up] = at(clock.k);
      fill(lines, line(x._offset + x.d2p(across), y._offset + y.d2p(up), "dot"));
    } else {
      fill(lines, panels().map((axis) => [axis, axis.d2p(clock.time)]).filter(([axis, left]) => left >= -1 && left <= axis._length + 1)
        .map(([axis, left]) => line(axis._offset + left, top, "line", height)));
    }
  };
  place.onpointermove = (event) => {
    if (event.buttons || at) return;
    const left = event.clientX - place.getBoundingClientRect().left;
    const panel = panels().find(({ _offset: from, _length: length }) => left >= from && left <= from + length);
    if (panel) clock.seek(panel.p2d(left - panel._offset));
  };
  place.leave = clock.follow(place.point);
}
