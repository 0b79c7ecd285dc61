// Curves with bands, drawn by uPlot in the colours of the page, with what the cursor is at in words below.
import { clock, css, make, number, when } from "./format.js";
import { gestures } from "./gestures.js";

const all = new Set();
const HINT = "← → read the values; the wheel or + − zoom, dragging moves, a double click shows all.";

// larger where the page is: a wall is read from afar
export const big = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 15;

function axis(label, size, more = {}) {
  const font = `${Math.round(12 * big())}px system-ui, sans-serif`;
  return {
    label, size: size * big(), labelSize: 18 * big(), font, labelFont: font, gap: 4,
    stroke: () => css("--soft"), grid: { stroke: () => css("--line"), width: 1 }, ticks: { stroke: () => css("--line"), width: 1, size: 4 },
    values: (_, ticks) => ticks.map((t) => String(Number(t.toPrecision(6))).replace("-", "−")), ...more,
  };
}

const times = () => {
  const short = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  const day = new Intl.DateTimeFormat([], { day: "numeric", month: "short" });
  const seconds = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });
  return (_, ticks, __, ___, increment) => ticks.map((t) => (increment >= 86400 ? day : increment < 60 ? seconds : short).format(t * 1000));
};

// element, {x, y: labels, isTime, series, bands, draw, range: of y, view: of x, read(index, plot): words at the cursor}
export function chart(element, { x, y, isTime = false, series, bands = [], draw = null, range = null, legend = true, view, read, padding = null }) {
  const size = () => ({ width: Math.max(200, element.clientWidth), height: Math.max(120, element.clientHeight) - (legend ? 30 : 0) });
  const readout = make("p", { class: "readout hint", text: "" });
  const place = (at) => (isTime ? (view.days?.() ? when(at) : clock(at)) : `${number(at, 0)} mm`);
  function readOut(plot) {
    const index = plot.cursor.idx, at = plot.data[0][index];
    if (plot.cursor.left < 0 || at === undefined) { readout.textContent = document.activeElement === element ? HINT : ""; return; }
    readout.textContent = `${place(at)}: ${read(index, plot)}`;
  }
  const options = {
    ...size(), series: [{ label: isTime ? "time" : x }, ...series], ...(padding ? { padding } : {}),
    bands, legend: { show: legend, live: false },
    scales: { x: { time: isTime, range: (_, low, high) => view.get() ?? (low < high ? [low, high] : [low - 1, high + 1]) }, y: range ? { range } : {} },
    axes: [axis(isTime ? null : x, 24, isTime ? { values: times(), space: 75 * big() } : {}), axis(y, 52)],
    cursor: { drag: { x: false, y: false, setScale: false }, points: { size: 6 } },
    hooks: { draw: draw ? [draw] : [], setCursor: [readOut] },
  };
  element.tabIndex = 0;
  element.setAttribute("role", "group");
  element.setAttribute("aria-label", `Chart in ${y}; arrow keys read it, plus and minus zoom, Home shows all`);
  element.after(readout);
  const plot = new uPlot(options, [[], ...series.map(() => [])], element);
  gestures(plot, element, view);
  element.addEventListener("focus", () => { readout.setAttribute("aria-live", "polite"); readOut(plot); });
  element.addEventListener("blur", () => { readout.removeAttribute("aria-live"); readOut(plot); });
  const watch = new ResizeObserver(() => { const s = size(); if (s.width !== plot.width || s.height !== plot.height) plot.setSize(s); });
  watch.observe(element);
  const made = { plot, set: (data) => { plot.setData(data); if (plot.cursor.left >= 0) readOut(plot); }, again: () => plot.setData(plot.data), end: () => { watch.disconnect(); plot.destroy(); readout.remove(); all.delete(made); } };
  all.add(made);
  return made;
}

export const line = (label, stroke, more = {}) => ({ label, stroke, width: 2, points: { show: false }, spanGaps: false, ...more });
// where there are more curves than colours
export const again = (i) => (i < 7 ? {} : { dash: [1, 3] });
export const edge = (label) => ({ label, stroke: "transparent", width: 0, points: { show: false } });
export function redraw() { for (const { plot } of all) plot.redraw(false, true); }

// the label of an edge of a band says nothing a reader needs
export function tidyLegend(element) {
  for (const row of element.querySelectorAll(".u-legend .u-series")) if (row.textContent.trim().startsWith("_")) row.hidden = true;
}
