// The recordings: a span of them, another laid over it.
import { chart, edge, line, tidyLegend } from "./charts.js";
import { byId, colour, fade, make, number, say, span, when } from "./format.js";

const UNITS = { degC: "°C", m: "m", rpm: "rpm", W: "W", um: "µm", mm: "mm" };
let files = [], to_s = null, length_s = 3600, charts = [], asked = 0;

const unitOf = (name) => name.slice(name.lastIndexOf("_") + 1);
const local = (s) => { const d = new Date(s * 1000); return new Date(d - d.getTimezoneOffset() * 60000).toISOString().slice(0, 19); };

async function read(from_s, until_s) {
  const answer = await fetch(`/history.json?from=${from_s}&to=${until_s}&points=${Math.min(800, Math.max(200, byId("c-past").clientWidth))}`);
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer.json();
}

function overBy() {
  const chosen = byId("over").value;
  byId("over-label").hidden = chosen !== "chosen";
  if (chosen !== "chosen") return Number(chosen);
  const until = Date.parse(byId("over-until").value) / 1000;
  return Number.isFinite(until) ? to_s - until : 0;
}

async function show() {
  const mine = ++asked, from_s = to_s - length_s, over_s = overBy();
  byId("until").value = local(to_s);
  for (const button of byId("spans").querySelectorAll("[data-span]")) button.setAttribute("aria-pressed", String(Number(button.dataset.span) === length_s));
  try {
    const [first, second] = await Promise.all([read(from_s, to_s), over_s ? read(from_s - over_s, to_s - over_s) : null]);
    if (mine !== asked) return;
    draw(first, second);
    const empty = Object.keys(first.channels).length === 0;
    say("past-words", empty ? "Nothing was recorded in this span." : `${when(from_s)} to ${when(to_s)} (${span(length_s)})${second ? `; dashed, laid over it: ${span(Math.abs(over_s))} ${over_s > 0 ? "earlier" : "later"}` : ""}. Drag to zoom.`);
    byId("c-past").dataset.from = String(from_s); byId("c-past").dataset.over = second ? String(over_s) : "";
  } catch (error) { say("past-words", error.message); }
}

function draw(first, second) {
  for (const made of charts) made.end();
  charts = [];
  const box = byId("c-past"), groups = new Map();
  for (const name of Object.keys(first.channels)) groups.set(unitOf(name), [...(groups.get(unitOf(name)) ?? []), name]);
  box.replaceChildren();
  for (const [unit, names] of groups) {
    const element = make("div", { class: "chart", "data-unit": unit }), series = [], bands = [], data = [first.time_s];
    box.append(element);
    names.forEach((name, i) => {
      const { least, most } = first.channels[name], middle = least.map((l, k) => (l === null ? null : (l + most[k]) / 2));
      const at = series.length + 1;
      series.push(line(name, () => colour(i), { width: 1.5, spanGaps: true }), edge("_"), edge("_"));
      bands.push({ series: [at + 1, at + 2], fill: () => fade(colour(i), 0.25) });
      data.push(middle, most, least);
      const other = second?.channels[name];
      if (other) { series.push(line("_over", () => colour(i), { width: 1.5, dash: [5, 4], spanGaps: true })); data.push(other.least.map((l, k) => (l === null ? null : (l + other.most[k]) / 2))); }
    });
    const made = chart(element, { x: "time", y: UNITS[unit] ?? unit, isTime: true, series, bands, select: zoomTo });
    made.set(data); tidyLegend(element); charts.push(made);
  }
}

function zoomTo(from, to) { if (to - from >= 2) { length_s = to - from; to_s = to; show(); } }
export function pan(by) { if (to_s !== null) { to_s += by * length_s / 4; show(); } }
export function zoom(by) { if (to_s !== null) { const middle = to_s - length_s / 2; length_s = Math.min(31e6, Math.max(2, length_s * by)); to_s = middle + length_s / 2; show(); } }

async function list(thenNewest) {
  const told = await (await fetch("/recordings.json")).json();
  files = told.files;
  if (!files.length) { say("past-words", told.reason ?? "Nothing has been recorded yet."); return; }
  if (to_s === null || thenNewest) {
    to_s = files.at(-1).to_s;
    const whole = to_s - files[0].from_s;
    if (!thenNewest) length_s = whole < 3600 ? Math.max(60, whole) : 3600;
  }
  await show();
}

export function startPast() {
  byId("spans").addEventListener("click", (event) => {
    const { span: chosen } = event.target.dataset;
    if (chosen) { length_s = Number(chosen); if (to_s === null) list(false); else show(); }
  });
  byId("earlier").addEventListener("click", () => pan(-1));
  byId("later").addEventListener("click", () => pan(1));
  byId("newest").addEventListener("click", () => list(true));
  byId("until").addEventListener("change", (event) => { const at = Date.parse(event.target.value) / 1000; if (Number.isFinite(at)) { to_s = at; show(); } });
  for (const id of ["over", "over-until"]) byId(id).addEventListener("change", () => { if (to_s !== null) show(); });
  const seen = new IntersectionObserver((entries) => { if (entries.some((e) => e.isIntersecting)) { seen.disconnect(); list(false); } });
  seen.observe(byId("p8"));
}
