// Curves with bands, drawn by uPlot in the colours of the page.
import { clock, css } from "./format.js";

const all = new Set();

// larger where the page is: a wall is read from afar
const big = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 15;

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

// element, {x, y: labels, isTime, series, bands, hooks}; returns {set(data), plot}
export function chart(element, { x, y, isTime = false, series, bands = [], draw = null, select = null, range = null, legend = true, height = null }) {
  const size = () => ({ width: Math.max(200, element.clientWidth), height: Math.max(120, height ?? element.clientHeight) - (legend ? 30 : 0) });
  const options = {
    ...size(), series: [{ label: isTime ? "time" : x, value: (_, v) => (v == null ? "–" : isTime ? clock(v) : v.toFixed(3)) }, ...series],
    bands, legend: { show: legend, live: false },
    scales: { x: { time: isTime }, y: range ? { range } : {} },
    axes: [axis(isTime ? null : x, 24, isTime ? { values: times(), space: 95 * big() } : {}), axis(y, 48)],
    cursor: { drag: { x: Boolean(select), y: false, setScale: false }, points: { size: 6 } },
    hooks: { draw: draw ? [draw] : [], setSelect: select ? [(u) => u.select.width > 8 && select(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"), u)] : [] },
  };
  const plot = new uPlot(options, [[], ...series.map(() => [])], element);
  const watch = new ResizeObserver(() => { const s = size(); if (s.width !== plot.width || s.height !== plot.height) plot.setSize(s); });
  watch.observe(element);
  const made = { plot, set: (data) => plot.setData(data), end: () => { watch.disconnect(); plot.destroy(); all.delete(made); } };
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
