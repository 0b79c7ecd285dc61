// Health in words, sensors, what has been learnt, alarms.
import { byId, clock, colour, css, known, make, number, say, span, when } from "./format.js";
import { nutChannel, onNews, silence, store, view } from "./store.js";

const WORDS = {
  good: ["✓", "Good", "Every sensor and input is used, and all heats are estimated."],
  starting: ["…", "Starting", "Not all heats are estimated yet; bands are still wide."],
  degraded: ["!", "Degraded", "Some input is missing or in doubt; bands are wider."],
  stale: ["×", "Stale", "No fresh measurement; the model runs alone."],
  invalid: ["×", "Invalid", "There is no estimate to rely on."],
};
// the service is gone: nobody reckons on
const SILENT = ["×", "Stale", "Nothing comes from the service; what is shown is the last that it said."];
const reasonsOf = () => store.documents.health?.reasons ?? [];

function drawState() {
  const { health, estimate } = store.documents;
  if (!health && !estimate) return;
  const silent = silence() !== null, state = silent ? "stale" : health?.state ?? estimate.quality;
  const [sign, word, words] = silent ? SILENT : WORDS[state] ?? ["?", state, ""];
  document.body.dataset.state = state;
  say("sign", sign); say("state", word); say("words", words);
  const reasons = reasonsOf().join("\n");
  if (byId("reasons").dataset.shown !== reasons) {
    byId("reasons").dataset.shown = reasons;
    byId("reasons").replaceChildren(...reasonsOf().map((reason) => make("li", { text: reason })));
  }
  document.title = `${sign} ${word} – ${store.hello?.machine ?? ""} ${store.hello?.axis ?? ""}`;
}

function drawFigures() {
  const now = view(), { field, error, compensation, readings } = store.documents;
  const most = (values, by) => values.reduce((best, v, i) => (known(v) && (best < 0 || by(v) > by(values[best])) ? i : best), -1);
  const hot = most(now.temperature_degC, (t) => t), far = most(now.error_um, Math.abs);
  const figure = (id, value, more) => { const text = `${value}|${more}`; const e = byId(id); if (e.dataset.shown !== text) { e.dataset.shown = text; e.replaceChildren(value, make("small", { text: more })); } };
  if (hot >= 0) figure("f-hot", `${number(now.temperature_degC[hot])} °C`, ` at ${number(field.position_m[hot], 2)} m`);
  if (far >= 0) figure("f-error", `${number(now.error_um[far])} µm`, ` at ${number(error.position_m[far], 2)} m`);
  const heats = Object.values(now.heat_W).filter(known);
  if (heats.length) figure("f-heat", `${number(heats.reduce((a, b) => a + b, 0))} W`, ` from ${heats.length}`);
  const speed = Object.keys(readings?.channels ?? {}).find((name) => name.endsWith("_rpm"));
  if (now.lost?.includes(nutChannel())) figure("f-nut", "–", " position lost");
  else if (known(now.channels[nutChannel()])) figure("f-nut", `${number(now.channels[nutChannel()], 3)} m`, speed ? ` ${number(now.channels[speed], 0)} rpm` : "");
  figure("f-comp", compensation ? (compensation.armed ? "armed" : "off") : "not set up", "");
}

function deviation(innovation, sigma) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), bar = document.createElementNS(svg.namespaceURI, "rect"), mid = document.createElementNS(svg.namespaceURI, "rect");
  svg.setAttribute("class", "dev"); svg.setAttribute("viewBox", "-3 0 6 1"); svg.setAttribute("preserveAspectRatio", "none"); svg.setAttribute("aria-hidden", "true");
  const z = known(innovation) && sigma > 0 ? Math.max(-3, Math.min(3, innovation / sigma)) : 0;
  for (const [e, x, w, fill] of [[bar, Math.min(0, z), Math.abs(z), Math.abs(z) >= 3 ? css("--bad") : colour(0)], [mid, -0.04, 0.08, css("--soft")]]) {
    e.setAttribute("x", x); e.setAttribute("width", w); e.setAttribute("height", 1); e.setAttribute("fill", fill); svg.append(e);
  }
  return svg;
}

function drawSensors() {
  const { estimate, readings, health } = store.documents;
  if (!estimate?.sensors || !readings) return;
  if (store.held) return;
  const body = byId("sensors"), rows = [];
  estimate.sensors.forEach((name, i) => {
    const sensor = store.config?.sensor?.find((s) => s.name === name), channel = sensor?.channel;
    const reading = readings.channels[channel], unit = sensor?.kind === "displacement" ? "µm" : "°C", small = sensor?.kind === "displacement" ? "µm" : "K";
    const quality = estimate.sensor_quality[i], why = (health?.conditions ?? []).filter(({ about }) => about.includes(channel) || about.includes(name)).map(({ reason }) => reason);
    // what came last, unless the service says that nothing comes: not every step has a reading
    const last = ["missing", "stale"].includes(quality) ? undefined : estimate.innovations?.[name];
    const fault = health?.channels?.[channel]?.fault;
    const lost = reading && reading.quality !== "good", old = lost && known(reading.age_s) && known(reading.value);
    rows.push(make("tr", { "data-sensor": name },
      make("th", { scope: "row" }, make("b", { text: name }), known(sensor?.position_m) ? ` ${number(sensor.position_m, 2)} m` : ""),
      make("td", { class: "n", "data-late": lost ? "" : null }, make("small", { class: "age", text: old ? `${span(reading.age_s)} old` : "" }),
        make("span", { "data-field": "reading", text: `${number(reading?.value, 2)} ${unit}` })),
      make("td", { class: "n", "data-late": last?.late ? "" : null }, make("small", { class: "age", text: last?.late ? `${span(last.age_s)} old` : "" }),
        make("span", { "data-field": "innovation", "data-sequence": last?.sequence, text: `${number(last?.value, 3)} ${small}` }), deviation(last?.value, last?.sigma)),
      make("td", {}, make("span", { class: "q", "data-q": quality, "data-field": "quality", text: quality }))));
    const text = [...new Set([fault, ...(quality === "good" ? [] : why)].filter(Boolean))].join("; ");
    if (text) rows.push(make("tr", { class: "why" }, make("td", { colspan: 4, text })));
  });
  body.replaceChildren(...rows);
  body.dataset.sequence = String(readings.sequence);
  body.dataset.estimate = String(estimate.sequence);
}

function drawLearnt() {
  const learned = store.documents.learned?.parameters, box = byId("learnt");
  if (!learned) { if (!box.firstChild) box.append(make("p", { class: "hint", text: "Nothing has been learnt yet, or learning is off." })); return; }
  const rows = Object.entries(learned).map(([key, { value, sigma }]) => {
    const digits = sigma > 0 ? Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(sigma)))) : 3;
    return make("tr", {}, make("th", { scope: "row", text: key }), make("td", { class: "n", "data-learnt": key, text: `${number(value, digits)} ± ${number(sigma, digits)}` }));
  });
  box.replaceChildren(make("table", {}, make("tbody", {}, ...rows)));
}

// keys without a panel of their own: their figures
function drawMore() {
  const rows = Object.entries(store.documents).flatMap(([key, published]) => (published.rows ?? []).map(([words, name, value]) =>
    make("tr", { "data-key": key }, make("th", { scope: "row", text: [key, name].filter(Boolean).join(" ") }), make("td", { text: words }),
      make("td", { class: "n", text: known(value) ? String(Number(value.toPrecision(5))) : value ?? "–" }))));
  byId("more").parentElement.hidden = rows.length === 0;
  byId("more").replaceChildren(make("table", {}, make("tbody", {}, ...rows)));
}

async function acknowledge(id, button) {
  button.disabled = true;
  const answer = await fetch("/acknowledge", { method: "POST", body: new URLSearchParams({ id }) });
  button.textContent = answer.ok ? "sent" : `refused (${answer.status})`;
  if (!answer.ok) button.disabled = false;
}

function drawAlarms() {
  const published = store.documents.alarms, box = byId("alarms");
  if (!published) { if (!box.firstChild) box.append(make("p", { class: "hint", text: "This service publishes no alarms; the reasons are at the top." })); return; }
  const key = JSON.stringify(published.alarms) + JSON.stringify(published.bands ?? {});
  if (box.dataset.shown === key) return;
  box.dataset.shown = key;
  const held = box.contains(document.activeElement) ? document.activeElement.closest("[data-alarm]")?.dataset.alarm : null;
  const alarms = published.alarms.map((alarm) => {
    const item = make("div", { class: "alarm", "data-severity": alarm.severity, "data-state": alarm.state, "data-alarm": alarm.id },
      make("b", { text: alarm.reason }), make("p", { text: alarm.remedy }),
      make("p", { class: "hint", text: `${alarm.severity}, ${alarm.state}, since ${when(alarm.since_s)}` }));
    if (alarm.state === "unacknowledged") {
      const button = make("button", { type: "button", text: "Acknowledge", onclick: () => acknowledge(alarm.id, button) });
      item.append(button, " ", make("code", { text: `observer acknowledge ${alarm.id}` }));
    }
    return item;
  });
  const bands = Object.entries(published.bands ?? {}).map(([name, band]) => make("tr", {}, make("th", { scope: "row", text: name.replaceAll("_", " ") }), ...(band.known ? [
    make("td", { class: "n", text: `${number(band.ratio, 2)} ± ${number(band.sigma, 2)} of its usual` }),
    make("td", { class: "n", text: known(band.trend_per_day) ? `${number(100 * band.trend_per_day, 2)} %/day` : "" }),
  ] : [make("td", { colspan: "2", class: "hint", text: `still learning what is usual: ${band.learning ?? `${number(band.running_h)} h of running`}` })])));
  box.replaceChildren(...(alarms.length ? alarms : [make("p", { class: "calm", text: "No alarm." })]), ...(bands.length ? [make("div", { class: "scroll" }, make("table", {}, make("tbody", {}, ...bands)))] : []));
  // who was about to press something is still there
  if (held) (box.querySelector(`[data-alarm="${CSS.escape(held)}"] button`) ?? byId("p5")).focus({ preventScroll: true });
}

function drawFoot() {
  const { estimate, health } = store.documents;
  if (store.hello) { say("machine", store.hello.machine); say("axis", `axis ${store.hello.axis}`); }
  if (estimate && !store.held) say("foot", `estimate ${estimate.sequence} of ${clock(estimate.time_s)}, service ${estimate.instance}${health?.overruns ? `, ${health.overruns} ticks left out` : ""}`);
}

// every tenth of a second: a service that is frozen sends nothing that could say so
export function watchSilence() {
  const since_s = silence(), banner = byId("stale"), was = "silent" in document.body.dataset;
  if (since_s === null) { if (was) { delete document.body.dataset.silent; banner.hidden = true; drawState(); } return; }
  const alive = performance.now() - store.beat < 2500;
  say(banner, `STALE – ${alive ? "the service is silent" : "this page hears nothing from its server"} for ${span(since_s)}; what is shown is old`);
  if (!was) { document.body.dataset.silent = ""; banner.hidden = false; drawState(); }
}

export function startTables() {
  onNews(["health", "estimate", "hello"], drawState);
  onNews(["view", "field", "readings", "compensation"], drawFigures);
  onNews(["estimate", "readings", "config", "theme"], drawSensors);
  onNews(["learned", "hello"], drawLearnt);
  onNews(["alarms", "hello"], drawAlarms);
  onNews(["more"], drawMore);
  onNews(["estimate", "hello"], drawFoot);
  setInterval(watchSilence, 100);
  setInterval(() => say("clock", clock(Date.now() / 1000)), 1000);
}
