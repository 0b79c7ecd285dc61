// Heats over time, the error along the travel, and what is to come.
import { again, chart, edge, line, redraw, tidyLegend } from "./charts.js";
import { byId, clock, colour, css, fade, known, make, number, say, span } from "./format.js";
import { hasLaw, nutChannel, onNews, store, view } from "./store.js";

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
    heats = chart(byId("c-heats"), { x: "time", y: "W", isTime: true, series, bands, draw: (u) => store.held && mark(u, store.held.time_s, clock(store.held.time_s)), legend: false });
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

function nearest(xs, ys, x) {
  if (!xs?.length || x < xs[0] || x > xs.at(-1)) return null;
  let i = 1;
  while (i < xs.length - 1 && xs[i] < x) i++;
  const f = xs[i] === xs[i - 1] ? 0 : (x - xs[i - 1]) / (xs[i] - xs[i - 1]);
  return ys[i - 1] + f * (ys[i] - ys[i - 1]);
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
    error = chart(box, { x: "position in m", y: "µm", series, bands: [{ series: [2, 3], fill: () => fade(colour(0), 0.2) }], draw: (u) => mark(u, view().lost?.includes(nutChannel()) ? null : view().channels[nutChannel()], "nut"),
      range: (_, low, high) => { const pad = Math.max(1, (high - low) * 0.1); return [Math.min(0, low - pad), high + pad]; }, legend: has });
    if (has) tidyLegend(box);
  }
  const data = [position_m, now.error_um.map(orNull), now.error_um.map((e, i) => plus(e, now.sigma_um[i], 2)), now.error_um.map((e, i) => plus(e, now.sigma_um[i], -2))];
  if (has) data.push(position_m.map((x) => orNull(nearest(compensation.position_m, compensation.error_um, x))));
  error.set(data);
  box.dataset.sequence = held ? "" : String(store.documents.error.sequence);
  say("comp-words", compensation ? (compensation.armed ? "compensation armed" : `compensation off: ${compensation.reason ?? "not armed"}`) : "");
}

function drawForecast() {
  const ahead = store.documents.forecast, box = byId("c-forecast");
  if (!ahead) {
    const comes = store.hello?.forecast_s;
    if (store.hello) say("forecast-words", known(comes) ? `No forecast yet: a new one comes every ${span(comes)}.` : "No forecast comes: every estimated heat needs a law, or [forecast] enabled is false.");
    return;
  }
  const table = ahead.error_um ?? ahead.temperature_degC, sigma = ahead.error_um ? ahead.error_sigma_um : ahead.sigma_K;
  if (ahead.reason || !table?.length) { say("forecast-words", ahead.reason ?? "No forecast yet."); box.hidden = true; return; }
  const unit = ahead.error_um ? "µm" : "°C";
  // of all places the one that moves most
  const width = table[0].length, moves = (i) => Math.abs(table.at(-1)[i] - table[0][i]);
  let at = 0;
  for (let i = 1; i < width; i++) if (moves(i) > moves(at)) at = i;
  box.hidden = false;
  if (!forecast || forecast.unit !== unit) {
    forecast?.end(); box.replaceChildren();
    forecast = chart(box, { x: "time", y: unit, isTime: true, series: [line("expected", () => colour(0)), edge("_"), edge("_")], bands: [{ series: [2, 3], fill: () => fade(colour(0), 0.2) }], draw: (u) => mark(u, store.documents.forecast.settled_at_s, "settled"), legend: false });
    forecast.unit = unit;
  }
  const mean = table.map((row) => orNull(row[at])), width_of = (sigma ?? []).map((row) => row[at]);
  forecast.set([ahead.at_s, mean, mean.map((m, i) => plus(m, width_of[i], 2)), mean.map((m, i) => plus(m, width_of[i], -2))]);
  const [early, late] = ahead.settled_between_s ?? [], sentence = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}. ` : "");
  const between = known(early) ? `, between ${clock(early)} and ${clock(late)}` : "";
  const settled = known(ahead.settled_at_s) ? `Settled within ${number(ahead.settles_within_um)} µm at ${clock(ahead.settled_at_s)}${between}. ` : "";
  const place = `${ahead.error_um ? "Error" : "Temperature"} at ${number(ahead.position_m[at], 2)} m, where most is to come. `;
  say("forecast-words", `${settled}${place}${sentence(ahead.program?.text)}${sentence(ahead.warm_up?.text)}`.trim());
}

export function startCurves() {
  onNews(["heat", "estimate", "view", "hello"], drawHeats);
  onNews(["rows", "heat", "hello"], drawHeatsPast);
  onNews(["error", "compensation", "view", "rows"], drawError);
  onNews(["forecast", "hello"], drawForecast);
  onNews(["theme", "view"], redraw);
}
