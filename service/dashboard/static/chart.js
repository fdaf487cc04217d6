// Charts by plotly.js, which is loaded when the first one is needed.

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

/** Return the colours of the page, by their names in the style sheet. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const found = {};
  for (const name of ["ink", "soft", "line", "paper", "c1", "c2", "c3", "c4", "c5", "c6", "bad"]) found[name] = style.getPropertyValue(`--${name}`).trim();
  return found;
}

function dressed(layout) {
  const { ink, soft, line } = colours();
  const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, tickcolor: line, tickfont: { color: soft }, title: { font: { color: soft } } };
  const axes = Object.fromEntries([...new Set(["xaxis", "yaxis", ...Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name))])]
    .map((name) => [name, { ...axis, ...layout[name], title: { ...axis.title, ...layout[name]?.title } }]));
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true,
    font: { family: "system-ui, sans-serif", size: 12, color: ink }, margin: { l: 72, r: 14, t: 10, b: 44 },
    legend: { orientation: "h", y: 1.08, x: 0 }, hoverlabel: { font: { family: "system-ui, sans-serif" } }, ...layout, ...axes,
  };
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
    return library.react(place, traces, dressed(layout), { displayModeBar: false, responsive: true, doubleClick: false, showTips: false, scrollZoom: false });
  };
  await again();
  if (!place.dataset.drawn) {
    place.dataset.drawn = "yes";
    document.addEventListener("themechange", () => place.redraw());
  }
  place.redraw = again;
  return library;
}
