// Sensors, what has been learnt, further keys, and whether the service is silent.
import { byId, clock, colour, css, known, make, number, say, span } from "./format.js";
import { drawState } from "./hero.js";
import { mm, onNews, silence, store } from "./store.js";
import { offer } from "./tools.js";

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
    const reading = readings.channels[channel], suffix = channel?.split("_").pop(), unit = sensor?.kind === "displacement" ? store.appearance.symbols[suffix] ?? suffix : "°C", small = sensor?.kind === "displacement" ? "µm" : "K";
    const quality = estimate.sensor_quality[i], why = (health?.conditions ?? []).filter(({ about }) => about.includes(channel) || about.includes(name)).map(({ reason }) => reason);
    // what came last, unless the service says that nothing comes: not every step has a reading
    const last = ["missing", "stale"].includes(quality) ? undefined : estimate.innovations?.[name];
    const fault = health?.channels?.[channel]?.fault;
    const lost = reading && reading.quality !== "good", old = lost && known(reading.age_s) && known(reading.value);
    rows.push(make("tr", { "data-sensor": name },
      make("th", { scope: "row" }, make("b", { text: name }), known(sensor?.position_m) ? ` ${number(mm(sensor.position_m), 0)} mm` : ""),
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

function sensorTable() {
  const { estimate, readings } = store.documents;
  return { columns: ["sensor", "channel", "position_mm", "reading", "unit", "residual", "residual_sigma", "quality"], rows: (estimate?.sensors ?? []).map((name, i) => {
    const sensor = store.config?.sensor?.find((s) => s.name === name), last = estimate.innovations?.[name], unit = sensor?.kind === "displacement" ? sensor.channel.split("_").pop() : "degC";
    return [name, sensor?.channel, known(sensor?.position_m) ? mm(sensor.position_m) : null, readings?.channels[sensor?.channel]?.value, unit, last?.value, last?.sigma, estimate.sensor_quality[i]];
  }) };
}

const learntTable = () => ({ columns: ["parameter", "value", "sigma"], rows: Object.entries(store.documents.learned?.parameters ?? {}).map(([key, { value, sigma }]) => [key, value, sigma]) });
const alarmTable = () => ({ columns: ["id", "severity", "state", "since_s", "reason", "remedy"], rows: (store.documents.alarms?.alarms ?? []).map((a) => [a.id, a.severity, a.state, a.since_s, a.reason, a.remedy]) });

export function startTables() {
  offer("p4", { table: sensorTable }); offer("p5", { table: alarmTable }); offer("p7", { table: learntTable });
  onNews(["estimate", "readings", "config", "theme"], drawSensors);
  onNews(["learned", "hello"], drawLearnt);
  onNews(["more"], drawMore);
  onNews(["estimate", "hello"], drawFoot);
  setInterval(watchSilence, 100);
  setInterval(() => say("clock", clock(Date.now() / 1000)), 1000);
}
