// Heats over time, the error along the travel, and what is to come.
import { again, chart, edge, line, redraw, tidyLegend } from "./charts.js";
import { byId, clock, colour, css, fade, known, make, number, say, span, withDoubt } from "./format.js";
import { along } from "./hero.js";
import { hasLaw, mm, nutChannel, onNews, store, view } from "./store.js";
import { liveTable, offer } from "./tools.js";
import { live, newView } from "./views.js";

const errorView = newView("p3", "span-error", () => [store.documents.error?.position_m[0], store.documents.error?.position_m.at(-1)].map(mm));
const aheadView = newView("p6", "span-forecast", () => [store.documents.forecast?.at_s[0], store.documents.forecast?.at_s.at(-1)]);
export const views = { p1: live, p2: live, p3: errorView, p6: aheadView };
let heats = null, names = "", error = null, hasCompensation = null, forecast = null;
const plus = (a, b, k) => (known(a) && known(b) ? a + k * b : null);
const orNull = (x) => (known(x) ? x : null);

function mark(plot, at, text) {
  if (!known(at)) return;
  const c = plot.ctx, x = plot.valToPos(at, "x", true), { top, height } = plot.bbox;
  c.save(); c.strokeStyle = css("--soft"); c.lineWidth = devicePixelRatio; c.setLineDash([4, 4]);
  c.beginPath(); c.moveTo(x, top); c.lineTo(x, top + height); c.stroke();
  c.textAlign = "left"; c.textBaseline = "alphabetic"; c.fillStyle = css("--soft"); c.font = `${11 * devicePixelRatio}px system-ui, sans-serif`; c.fillText(text, x + 5, top + 12 * devicePixelRatio); c.restore();
}

function drawHeats() {
  const now = view(), found = Object.keys(now.heat_W);
  if (!found.length) return;
  if (found.join() !== names) {
    names = found.join();
    heats?.end();
    byId("heats").replaceChildren(...found.map((name, i) => {
      const swatch = make("i", { class: "mark" });
      swatch.style.background = `var(--c${i})`;
      return make("li", {}, make("span", {}, swatch, name.replaceAll("_", " ")), make("b", { "data-heat": name }), make("i", { "data-law": name }));
    }));
    const series = found.flatMap((name, i) => [line(name.replaceAll("_", " "), () => colour(i), again(i)), edge("_"), edge("_"), line("_law", () => colour(i), { width: 1, dash: [5, 4] })]);
    const bands = found.map((_, i) => ({ series: [4 * i + 2, 4 * i + 3], fill: () => fade(colour(i), 0.18) }));
    heats = chart(byId("c-heats"), { x: "time", y: "W", isTime: true, series, bands, draw: (u) => store.held && mark(u, store.held.time_s, clock(store.held.time_s)), legend: false, view: live,
      read: (k) => found.map((name) => `${name.replaceAll("_", " ")} ${withDoubt(store.rows[k]?.heat_W[name], store.rows[k]?.sigma_W[name], store.rows[k]?.bound_W?.[name], "W")}`).join("; ") });
    drawHeatsPast();
  }
  const sequence = store.held ? "" : String(store.documents.heat?.sequence ?? "");
  byId("heats").dataset.sequence = sequence;
  for (const name of found) {
    say(byId("heats").querySelector(`[data-heat="${CSS.escape(name)}"]`), `${number(now.heat_W[name])} ± ${number(now.sigma_W[name])} W`);
    say(byId("heats").querySelector(`[data-law="${CSS.escape(name)}"]`), known(now.law_W[name]) && hasLaw(name) ? ` law ${number(now.law_W[name])} W` : "");
  }
}

function drawHeatsPast() {
  if (!heats || !store.rows.length) return;
  const rows = store.rows, found = names.split(",");
  heats.set([rows.map((r) => r.time_s), ...found.flatMap((name) => [
    rows.map((r) => orNull(r.heat_W[name])), rows.map((r) => plus(r.heat_W[name], r.sigma_W[name], 2)),
    rows.map((r) => plus(r.heat_W[name], r.sigma_W[name], -2)), rows.map((r) => (hasLaw(name) ? orNull(r.law_W[name]) : null)),
  ])]);
}

// the compensation along the screw: the machine may count from another zero, and in the other direction
function compensationAlongScrew(compensation, places_m) {
  const { zero_m = 0, reverse = false } = store.config?.compensation ?? {}, sign = reverse ? -1 : 1;
  const points = (compensation?.position_m ?? []).map((x, i) => [zero_m + sign * x, sign * compensation.error_um[i]]).sort((a, b) => a[0] - b[0]);
  return places_m.map((x) => along(points.map((point) => point[0]), points.map((point) => point[1]), x));
}

function compensationWords({ armed, phase, reason, hold_reason, gradient_cut_um }) {
  if (!armed) return `compensation ${phase === "releasing" ? "goes to zero" : "off"}: ${reason ?? "not armed"}`;
  if (phase === "holding") return `compensation holds its last values: ${hold_reason}`;
  const limit = store.config?.compensation?.gradient_limit_um_m;
  return `compensation armed${gradient_cut_um ? `; the gradient limit${limit ? ` of ${number(limit, 0)} µm/m` : ""} cuts up to ${number(gradient_cut_um)} µm` : ""}`;
}

function drawError() {
  const now = view(), position_m = store.documents.error?.position_m, held = Boolean(store.held);
  const compensation = held ? null : store.documents.compensation;
  const box = byId("c-error");
  if (!position_m) {
    if (store.documents.estimate && !error && !box.firstChild) box.append(make("p", { class: "hint", text: "No thermal error: the configuration has no screw.expansion_1_K." }));
    return;
  }
  const has = Boolean(compensation?.position_m);
  if (!error || has !== hasCompensation) {
    error?.end(); box.replaceChildren(); hasCompensation = has;
    const series = [line("thermal error", () => colour(0)), edge("_"), edge("_"), ...(has ? [line("compensation", () => colour(1), { dash: [7, 4] })] : [])];
    error = chart(box, { x: "position, mm", y: "µm", series, bands: [{ series: [2, 3], fill: () => fade(colour(0), 0.2) }], draw: (u) => mark(u, view().lost?.includes(nutChannel()) || !known(view().channels[nutChannel()]) ? null : mm(view().channels[nutChannel()]), "nut"), view: errorView,
      read: (k) => withDoubt(view().error_um[k], view().sigma_um[k], view().bound_um?.[k], "µm"),
      range: (_, low, high) => { const pad = Math.max(1, (high - low) * 0.1); return [Math.min(0, low - pad), high + pad]; }, legend: has });
    if (has) tidyLegend(box);
  }
  const data = [position_m.map(mm), now.error_um.map(orNull), now.error_um.map((e, i) => plus(e, now.sigma_um[i], 2)), now.error_um.map((e, i) => plus(e, now.sigma_um[i], -2))];
  if (has) data.push(compensationAlongScrew(compensation, position_m));
  error.set(data);
  box.dataset.sequence = held ? "" : String(store.documents.error.sequence);
  say("comp-words", compensation ? compensationWords(compensation) : "");
}

// of all places the one that moves most
function liveliest(table) {
  const moves = (i) => Math.abs(table.at(-1)[i] - table[0][i]);
  return table[0].reduce((best, _, i) => (moves(i) > moves(best) ? i : best), 0);
}

function aheadNow() {
  const ahead = store.documents.forecast, table = ahead?.error_um ?? ahead?.temperature_degC;
  if (!table?.length) return { mean: [], sigma: [] };
  const at = liveliest(table), sigma = (ahead.error_um ? ahead.error_sigma_um : ahead.sigma_K) ?? [];
  return { at, mean: table.map((row) => orNull(row[at])), sigma: sigma.map((row) => row[at]), unit: ahead.error_um ? "um" : "degC" };
}

function drawForecast() {
  const ahead = store.documents.forecast, box = byId("c-forecast");
  if (!ahead) {
    box.hidden = true;
    const comes = store.hello?.forecast_s;
    if (store.hello) say("forecast-words", known(comes) ? `No forecast yet: a new one comes every ${span(comes)}.` : "No forecast comes: every estimated heat needs a law, or [forecast] enabled is false.");
    return;
  }
  const table = ahead.error_um ?? ahead.temperature_degC;
  if (ahead.reason || !table?.length) { say("forecast-words", ahead.reason ?? "No forecast yet."); box.hidden = true; return; }
  const unit = ahead.error_um ? "µm" : "°C";
  const at = liveliest(table), shown = (k) => { const { mean, sigma: s } = aheadNow(); return [mean[k], s[k], null]; };
  box.hidden = false;
  if (!forecast || forecast.unit !== unit) {
    forecast?.end(); box.replaceChildren();
    forecast = chart(box, { x: "time", y: unit, isTime: true, series: [line("expected", () => colour(0)), edge("_"), edge("_")], bands: [{ series: [2, 3], fill: () => fade(colour(0), 0.2) }], draw: (u) => mark(u, store.documents.forecast?.settled_at_s, "settled"), legend: false, view: aheadView,
      read: (k) => withDoubt(...shown(k), unit) });
    forecast.unit = unit;
  }
  const { mean, sigma: width_of } = aheadNow();
  forecast.set([ahead.at_s, mean, mean.map((m, i) => plus(m, width_of[i], 2)), mean.map((m, i) => plus(m, width_of[i], -2))]);
  const [early, late] = ahead.settled_between_s ?? [], sentence = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}. ` : "");
  const between = known(early) ? `, between ${clock(early)} and ${clock(late)}` : "";
  const settled = known(ahead.settled_at_s) ? `Settled within ${number(ahead.settles_within_um)} µm at ${clock(ahead.settled_at_s)}${between}. ` : "";
  const place = `${ahead.error_um ? "Error" : "Temperature"} at ${number(mm(ahead.position_m[at]), 0)} mm, where most is to come. `;
  say("forecast-words", `${settled}${place}${sentence(ahead.program?.text)}`.trim());
}

const heatTable = () => liveTable(() => names.split(",").flatMap((n) => [`heat_${n}_W`, `heat_${n}_sigma_W`, `heat_${n}_bound_W`, `law_${n}_W`]),
  (row) => names.split(",").flatMap((n) => [row.heat_W[n], row.sigma_W[n], row.bound_W?.[n], hasLaw(n) ? row.law_W[n] : null]));
const places = () => store.documents.field?.position_m.map((x) => Number(mm(x).toFixed(3))) ?? [];
const fieldTable = () => liveTable(() => places().flatMap((x) => [`field_${x}_degC`, `field_${x}_sigma_K`, `field_${x}_bound_K`]),
  (row) => places().flatMap((_, i) => [row.temperature_degC[i], row.sigma_K?.[i], row.bound_K?.[i]]));
const errorTable = () => {
  const position_m = store.documents.error?.position_m ?? [], compensation_um = compensationAlongScrew(store.held ? null : store.documents.compensation, position_m);
  return { columns: ["position_mm", "error_um", "sigma_um", "bound_um", "compensation_um"], rows: position_m.map((x, i) => [Number(mm(x).toFixed(3)), view().error_um[i], view().sigma_um[i], view().bound_um?.[i], compensation_um[i]]) };
};
const aheadTable = () => { const { at, mean, sigma, unit } = aheadNow(), { at_s, position_m } = store.documents.forecast ?? {}; return { columns: ["time_s", "position_mm", `expected_${unit}`, "sigma"], rows: mean.map((m, k) => [at_s[k], mm(position_m[at]), m, sigma[k]]) }; };

export function startCurves() {
  offer("p1", { table: fieldTable, view: live }); offer("p2", { table: heatTable, view: live });
  offer("p3", { table: errorTable, view: errorView }); offer("p6", { table: aheadTable, view: aheadView });
  onNews(["heat", "estimate", "view", "hello"], drawHeats);
  onNews(["rows", "heat", "hello", "span"], drawHeatsPast);
  onNews(["error", "span-error", "compensation", "config", "view", "rows"], drawError);
  onNews(["forecast", "span-forecast", "hello"], drawForecast);
  onNews(["theme", "view"], redraw);
}
