// The recordings: a span of them, another laid over it.
import { again, chart, edge, line, tidyLegend } from "./charts.js";
import { byId, colour, fade, make, number, say, span, when } from "./format.js";

const UNITS = { degC: "°C", m: "m", rpm: "rpm", W: "W", um: "µm", mm: "mm" };
let files = [], to_s = null, length_s = 3600, charts = [], shown = "", asked = new AbortController();

const unitOf = (name) => name.slice(name.lastIndexOf("_") + 1);
const middle = (least, most) => least.map((l, k) => (l === null ? null : (l + most[k]) / 2));
const local = (s) => { const d = new Date(s * 1000); return new Date(d - d.getTimezoneOffset() * 60000).toISOString().slice(0, 19); };

async function read(from_s, until_s, signal) {
  const points = Math.min(800, Math.max(200, byId("c-past").clientWidth));
  const answer = await fetch(`/history.json?from=${from_s}&to=${until_s}&points=${points}`, { signal });
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
  asked.abort(); // who scrubs on does not want what was asked for before
  const { signal } = asked = new AbortController();
  const from_s = to_s - length_s, over_s = overBy();
  byId("until").value = local(to_s);
  for (const button of byId("spans").querySelectorAll("[data-span]")) button.setAttribute("aria-pressed", String(Number(button.dataset.span) === length_s));
  try {
    // days are read bit by bit, and shown as far as they are
    for (let share = 0; share < 1;) {
      const [first, second] = await Promise.all([read(from_s, from_s + length_s, signal), over_s ? read(from_s - over_s, from_s + length_s - over_s, signal) : null]);
      if (signal.aborted) return;
      share = Math.min(first.read, second?.read ?? 1);
      draw(first, second);
      const empty = Object.keys(first.channels).length === 0;
      const dashed = second ? `; dashed, laid over it: ${span(Math.abs(over_s))} ${over_s > 0 ? "earlier" : "later"}` : "";
      say("past-words", share < 1 ? `Reading: ${Math.floor(100 * share)} % of what is there.` : empty ? "Nothing was recorded in this span." : `${when(from_s)} to ${when(from_s + length_s)} (${span(length_s)})${dashed}. Drag to zoom.`);
    }
    byId("c-past").dataset.from = String(from_s); byId("c-past").dataset.over = over_s ? String(over_s) : "";
  } catch (error) { if (!signal.aborted) say("past-words", error.message); }
}

function draw(first, second) {
  const groups = new Map();
  for (const name of Object.keys(first.channels)) groups.set(unitOf(name), [...(groups.get(unitOf(name)) ?? []), name]);
  const drawn = JSON.stringify([[...groups], Object.keys(second?.channels ?? {})]);
  if (drawn !== shown) { shown = drawn; build(groups, second); }
  [...groups.values()].forEach((names, k) => {
    charts[k].set([first.time_s, ...names.flatMap((name) => {
      const { least, most } = first.channels[name], other = second?.channels[name];
      return [middle(least, most), most, least, ...(other ? [middle(other.least, other.most)] : [])];
    })]);
  });
}

// new charts only where other channels are to be seen: nothing jumps while somebody scrubs
function build(groups, second) {
  for (const made of charts) made.end();
  const box = byId("c-past");
  box.replaceChildren();
  charts = [...groups].map(([unit, names]) => {
    const element = make("div", { class: "chart", "data-unit": unit }), series = [], bands = [];
    box.append(element);
    names.forEach((name, i) => {
      const at = series.length + 1;
      series.push(line(name, () => colour(i), { width: 1.5, spanGaps: true, ...again(i) }), edge("_"), edge("_"));
      bands.push({ series: [at + 1, at + 2], fill: () => fade(colour(i), 0.25) });
      if (second?.channels[name]) series.push(line("_over", () => colour(i), { width: 1.5, dash: [5, 4], spanGaps: true }));
    });
    const made = chart(element, { x: "time", y: UNITS[unit] ?? unit, isTime: true, series, bands, select: zoomTo });
    tidyLegend(element);
    return made;
  });
}

function zoomTo(from, to, plot) { plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false); if (to - from >= 2) { length_s = to - from; to_s = to; show(); } }
export function pan(by) { if (to_s !== null) { to_s += by * length_s / 4; show(); } }
export function zoom(by) { if (to_s !== null) { const middle = to_s - length_s / 2; length_s = Math.min(31e6, Math.max(2, length_s * by)); to_s = middle + length_s / 2; show(); } }

async function list(thenNewest) {
  const listed = await (await fetch("/recordings.json")).json();
  files = listed.files;
  if (!files.length) { say("past-words", listed.reason ?? "Nothing has been recorded yet."); return; }
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
