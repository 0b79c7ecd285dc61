// What the service said last, the last hour, and which moment is looked at.
import { known } from "./format.js";

const HOUR_S = 3600;
// of a sensor whose reading is not used now
const CROSSED = ["missing", "stale", "rejected", "excluded"];
export const store = {
  appearance: null, hello: null, documents: {}, rows: [], held: null, heard: 0, beat: 0, config: null, serverSaysStale: false,
};
const wanted = new Map();
const dirty = new Set();
let waiting = false;

// draw(keys...) whenever one of the keys is new, at most as often as the browser paints
export function onNews(keys, draw) {
  for (const key of keys) wanted.set(key, [...(wanted.get(key) ?? []), draw]);
}

export function news(key) {
  for (const draw of wanted.get(key) ?? []) dirty.add(draw);
  if (waiting || document.hidden) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    const now = [...dirty];
    dirty.clear();
    for (const draw of now) draw();
  });
}
document.addEventListener("visibilitychange", () => news("view"));

export function source(name) { return store.config?.source?.find((s) => s.name === name); }
const nut = () => store.config?.source?.find((s) => s.position_channel);
export function nutChannel() { return nut()?.position_channel ?? null; }
export const strokeOfNut = () => nut()?.stroke_m ?? null;
export const mm = (x_m) => x_m * store.appearance.mm_per_m;

// without a law the estimate says 0 W of it, which is no law
export function hasLaw(name) { return store.hello?.laws.includes(name) ?? false; }

function live() {
  const { field, heat, error, estimate, readings } = store.documents;
  const heats = heat?.sources ?? {}, of = (key) => Object.fromEntries(Object.entries(heats).map(([name, h]) => [name, h[key]]));
  return {
    time_s: estimate?.time_s ?? field?.time_s, quality: estimate?.quality,
    temperature_degC: field?.temperature_degC ?? [], sigma_K: field?.sigma_K ?? [], bound_K: field?.bound_K ?? [],
    error_um: error?.error_um ?? [], sigma_um: error?.sigma_um ?? [], bound_um: error?.bound_um ?? [],
    force_N: error?.force_N, force_sigma_N: error?.force_sigma_N,
    heat_W: of("heat_W"), sigma_W: of("sigma_W"), bound_W: of("bound_W"),
    law_W: Object.fromEntries((estimate?.sources ?? []).map((name, i) => [name, estimate.law_W?.[i]]).filter(([name]) => hasLaw(name))),
    channels: Object.fromEntries(Object.entries(readings?.channels ?? {}).map(([name, c]) => [name, c.value])),
    crossed: Object.fromEntries((estimate?.sensors ?? []).map((name, i) => [name, estimate.sensor_quality[i]]).filter(([, quality]) => CROSSED.includes(quality))),
    lost: Object.entries(readings?.channels ?? {}).filter(([, c]) => c.quality !== "good").map(([name]) => name),
  };
}

// the moment that is looked at: held, or now
export function view() { return store.held ?? live(); }

export function hold(index) {
  store.held = index === null || index >= store.rows.length ? null : store.rows[Math.max(0, index)];
  news("view");
}

function remember() {
  const row = live();
  const last = store.rows.at(-1);
  if (!known(row.time_s) || !row.temperature_degC.length) return;
  if (last && row.time_s < last.time_s) store.rows = [];
  if (last && row.time_s - last.time_s < 2) return;
  store.rows.push(row);
  while (store.rows[0].time_s < row.time_s - HOUR_S) store.rows.shift();
  news("rows");
}

export async function connect() {
  let keys;
  try {
    const answer = await fetch("/recent.json");
    if (answer.status === 401) { location.assign("/login"); return; }
    if (!answer.ok) throw new Error(await answer.text());
    ({ rows: store.rows, keys, appearance: store.appearance } = await answer.json());
  } catch { setTimeout(connect, 1000); return; }
  news("rows");
  const events = new EventSource("/events");
  for (const key of [...keys, "hello", "beat"]) {
    events.addEventListener(key, (event) => take(key, JSON.parse(event.data)));
  }
  events.addEventListener("error", () => {
    if (events.readyState !== EventSource.CLOSED) return;
    setTimeout(connect, 1000);
  });
}

function take(key, document_) {
  store.beat = performance.now();
  if (document_ === null) { // another start of the service, which may not publish it
    delete store.documents[key];
    for (const changed of [key, "more"]) news(changed);
    return;
  }
  if (key === "hello") store.hello = document_;
  else if (key === "beat") store.serverSaysStale = document_.stale;
  else if (key === "config") store.config = document_.config;
  // what is sent again at a new connection is not news of the service
  if (key === "estimate" && document_.sequence !== store.documents.estimate?.sequence) store.heard = performance.now();
  store.documents[key] = document_;
  if (key === "field") remember();
  news(key);
  if (document_.rows) news("more");
  if (!store.held && ["estimate", "field"].includes(key)) news("view");
}

// seconds of silence where that is too long, else null; two periods, and what a busy computer needs
export function silence() {
  if (!store.hello) return null;
  const since_s = (performance.now() - store.heard) / 1000;
  if (store.heard === 0) return null;
  return store.serverSaysStale || since_s > 2 * store.hello.period_s + 0.4 ? since_s : null;
}
