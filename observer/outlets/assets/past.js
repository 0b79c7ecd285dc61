// The recordings: a span of them, another laid over it.
import { again, chart, edge, line, tidyLegend } from "./charts.js";
import { byId, colour, fade, known, local, make, number, say, span, when } from "./format.js";
import { onNews, store } from "./store.js";
import { offer } from "./tools.js";
import { newView, note } from "./views.js";

const LEAST_S = 2, MOST_S = 31e6;
let recorded = null, to_s = null, length_s = 3600, charts = [], shown = "", last = null, asked = new AbortController();
export const pastView = Object.assign(newView("p8", "span-past"), {
  get: () => (to_s === null ? null : [to_s - length_s, to_s]), days: () => length_s > 86400,
  set: (range) => { if (range === null) whole(); else move(...range); },
});

// positions are shown in one unit everywhere
const shownIn = (unit) => (unit === "m" ? ["mm", store.appearance.mm_per_m] : [store.appearance.symbols[unit] ?? unit, 1]);
const titleOf = (name) => name.slice(0, name.lastIndexOf("_")).replaceAll("_", " ");
const times = (values, by) => (by === 1 ? values : values.map((v) => (v === null ? null : v * by)));
const unitOf = (name) => name.slice(name.lastIndexOf("_") + 1);

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
      const notes = [...first.notes, ...(second?.notes ?? [])].map((note) => ` ${note}.`).join("");
      say("past-words", (share < 1 ? `Reading: ${Math.floor(100 * share)} % of what is there.` : empty ? "Nothing was recorded in this span." : `${when(from_s)} to ${when(from_s + length_s)} (${span(length_s)})${dashed}. Mean, and the band from least to most.`) + notes);
    }
    byId("c-past").dataset.from = String(from_s); byId("c-past").dataset.over = over_s ? String(over_s) : "";
  } catch (error) { if (!signal.aborted) say("past-words", error.message); }
}

function draw(first, second) {
  last = first;
  const groups = new Map();
  for (const name of Object.keys(first.channels)) groups.set(unitOf(name), [...(groups.get(unitOf(name)) ?? []), name]);
  const drawn = JSON.stringify([[...groups], Object.keys(second?.channels ?? {})]);
  if (drawn !== shown) { shown = drawn; build(groups, second); }
  [...groups].forEach(([unit, names], k) => {
    charts[k].set([first.time_s, ...names.flatMap((name) => {
      const { least, mean, most } = first.channels[name], other = second?.channels[name];
      return [mean, most, least, ...(other ? [other.mean] : [])].map((values) => times(values, shownIn(unit)[1]));
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
    box.append(make("div", {}, element));
    names.forEach((name, i) => {
      const at = series.length + 1;
      series.push(line(titleOf(name), () => colour(i), { width: 1.5, spanGaps: true, ...again(i) }), edge("_"), edge("_"));
      bands.push({ series: [at + 1, at + 2], fill: () => fade(colour(i), 0.25) });
      if (second?.channels[name]) series.push(line("_over", () => colour(i), { width: 1.5, dash: [5, 4], spanGaps: true }));
    });
    const made = chart(element, { x: "time", y: shownIn(unit)[0], isTime: true, series, bands, view: pastView, read: (k) => names.map((name) => words(name, k, unit)).join("; ") });
    tidyLegend(element);
    return made;
  });
}

function words(name, k, unit) {
  const { least, mean, most } = last?.channels[name] ?? {};
  if (!known(mean?.[k])) return `${titleOf(name)} –`;
  const [symbol, by] = shownIn(unit), between = most[k] > least[k] ? ` (${number(least[k] * by, 2)} to ${number(most[k] * by, 2)})` : "";
  return `${titleOf(name)} ${number(mean[k] * by, 2)} ${symbol}${between}`;
}

let waiting = 0;
// what is there is moved at once, and read anew once a gesture rests
function move(from, to) {
  length_s = Math.min(MOST_S, Math.max(LEAST_S, to - from)); to_s = (from + to + length_s) / 2;
  note("p8", [from, to]);
  for (const made of charts) made.again();
  clearTimeout(waiting);
  waiting = setTimeout(show, 120);
}
function whole() { if (recorded) move(recorded.from_s, Math.max(recorded.to_s, recorded.from_s + LEAST_S)); }
function pan(by) { if (to_s !== null) { to_s += by * length_s / 4; show(); } }
export function openPast(from, to) { length_s = Math.min(MOST_S, Math.max(LEAST_S, to - from)); to_s = to; if (seen) { seen.disconnect(); seen = null; } list(false).then(() => byId("p8").scrollIntoView({ behavior: "instant" })); }

function table() {
  const names = Object.keys(last?.channels ?? {});
  return { columns: ["time_s", "time", ...names.flatMap((n) => [`${n}_least`, `${n}_mean`, `${n}_most`])], rows: (last?.time_s ?? []).map((t, k) => [t, new Date(t * 1000).toISOString(), ...names.flatMap((n) => ["least", "mean", "most"].map((e) => last.channels[n][e][k]))]) };
}

async function list(thenNewest) {
  if (!store.appearance) await new Promise((heard) => { onNews(["rows"], heard); });
  const answer = await (await fetch("/past.json")).json();
  if (answer.reason) { say("past-words", answer.reason); return; }
  recorded = answer;
  if (to_s === null || thenNewest) {
    to_s = recorded.to_s;
    const all_s = to_s - recorded.from_s;
    if (!thenNewest) length_s = all_s < 3600 ? Math.max(60, all_s) : 3600;
  }
  await show();
}

let seen = null;
export function startPast() {
  offer("p8", { table, view: pastView });
  onNews(["theme"], () => { for (const made of charts) made.again(); });
  byId("spans").addEventListener("click", (event) => {
    const { span: chosen } = event.target.dataset;
    if (chosen) { length_s = Number(chosen); if (to_s === null) list(false); else show(); }
  });
  byId("earlier").addEventListener("click", () => pan(-1));
  byId("later").addEventListener("click", () => pan(1));
  byId("newest").addEventListener("click", () => list(true));
  byId("until").addEventListener("change", (event) => { const at = Date.parse(event.target.value) / 1000; if (Number.isFinite(at)) { to_s = at; show(); } });
  for (const id of ["over", "over-until"]) byId(id).addEventListener("change", () => { if (to_s !== null) show(); });
  seen = new IntersectionObserver((entries) => { if (entries.some((e) => e.isIntersecting)) { seen.disconnect(); seen = null; list(false); } });
  seen.observe(byId("p8"));
}
