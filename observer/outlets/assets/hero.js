// The first look: a verdict, the worst alarm with its remedy, the error at the nut and the largest within its stroke.
import { alarmWords, worst } from "./alarms.js";
import { byId, known, make, number, say } from "./format.js";
import { mm, nutChannel, onNews, silence, store, strokeOfNut, view } from "./store.js";

const WORDS = {
  good: ["✓", "Good", "Field and thermal error are estimated, and no test fails."],
  starting: ["…", "Starting", "Readings are judged before anything is good; bands are still wide."],
  degraded: ["!", "Degraded", "A sensor, an input or the model is in doubt, as the reasons say; bands are wider."],
  stale: ["×", "Stale", "No fresh measurement; the model runs alone."],
  invalid: ["×", "Invalid", "There is no estimate to rely on."],
};
// the service is gone: nobody reckons on
const SILENT = ["×", "Stale", "Nothing comes from the service; what is shown is the last that it said."];

// the headline of a good estimate names the sensors that it does not use
const accuracy = ({ error_known_to_um }) => known(error_known_to_um) ? ` to ±${number(error_known_to_um, 0)} µm at the nut` : "";
const headline = (word, unused, health) => `${word}${accuracy(health)}${unused.length ? `, but without ${unused.join(", ")} (${health.sensors_used} of ${health.sensors} sensors)` : ""}`;

export function drawState() {
  const { health, estimate, compensation } = store.documents;
  if (!health && !estimate) return;
  const silent = silence() !== null, state = silent ? "stale" : health?.state ?? estimate.quality;
  const [sign, verdict, words] = silent ? SILENT : WORDS[state] ?? ["?", state, ""];
  const word = health && state === "good" ? headline(verdict, health.degraded_sensors ?? [], health) : verdict;
  document.body.dataset.state = state;
  const released = state === "good" && known(compensation?.released_s) ? `Estimates are good. Compensation is off: ${compensation.reason}` : null;
  say("sign", sign); say("state", word); say("words", released ?? words);
  // what the alarm above says already is not said again
  const alarm = worst(), reasons = (health?.reasons ?? []).filter((reason) => reason !== alarm?.reason);
  if (byId("reasons").dataset.shown !== reasons.join("\n")) {
    byId("reasons").dataset.shown = reasons.join("\n");
    byId("reasons").replaceChildren(...reasons.map((reason) => make("li", { text: reason })));
  }
  document.title = `${sign} ${word} – ${store.hello?.machine ?? ""} ${store.hello?.axis ?? ""}`;
}

function drawAlarm() {
  const alarm = worst(), box = byId("hero-alarm"), more = (store.documents.alarms?.alarms.length ?? 0) - 1, shown = JSON.stringify([alarm, more]);
  if (box.dataset.shown === shown) return;
  const focused = box.contains(document.activeElement);
  box.dataset.shown = shown;
  box.hidden = !alarm;
  box.replaceChildren(...(alarm ? [alarmWords(alarm, false)] : []), ...(alarm && more > 0 ? [make("a", { href: "#p5", text: `and ${more} more` })] : []));
  if (focused) (box.querySelector("button") ?? byId("p0")).focus({ preventScroll: true });
}

// values at a place between two grid points
export function along(xs, values, x) {
  if (!xs?.length || !values?.length || !(x >= xs[0] && x <= xs.at(-1))) return null;
  let i = 1;
  while (i < xs.length - 1 && xs[i] < x) i++;
  const f = xs[i] === xs[i - 1] ? 0 : (x - xs[i - 1]) / (xs[i] - xs[i - 1]), [a, b] = [values[i - 1], values[i]];
  return known(a) && known(b) ? a + f * (b - a) : null;
}

function largest(now, position_m, stroke) {
  const places = stroke ? [...position_m.filter((x) => x > stroke[0] && x < stroke[1]), ...stroke] : position_m;
  let best = null;
  for (const x of places) {
    const value = along(position_m, now.error_um, x);
    if (known(value) && (best === null || Math.abs(value) > Math.abs(best.value))) best = { x, value };
  }
  return best;
}

const place = (x_m) => `at ${number(mm(x_m), 0)} mm`;
const doubts = (now, position_m, x) => {
  const [sigma, bound] = ["sigma_um", "bound_um"].map((key) => along(position_m, now[key], x));
  return [known(sigma) ? `± ${number(sigma)}` : "", known(bound) ? `bound ${number(bound)} µm` : "no bound known"].filter(Boolean).join(", ");
};

function drawFigures() {
  if (!store.appearance) return;
  const now = view(), { field, error, compensation, readings } = store.documents, position_m = error?.position_m ?? [];
  const figure = (id, value, more) => { const text = `${value}|${more}`, e = byId(id); if (e.dataset.shown !== text) { e.dataset.shown = text; e.replaceChildren(value, make("small", { text: ` ${more}` })); } };
  const speed = Object.keys(readings?.channels ?? {}).find((name) => name.endsWith("_rpm"));
  const lost = now.lost?.includes(nutChannel()), nut_m = lost ? null : now.channels[nutChannel()];
  const here = known(nut_m) ? along(position_m, now.error_um, nut_m) : null, far = largest(now, position_m, strokeOfNut());
  if (known(here)) figure("f-here", `${number(here)} µm`, doubts(now, position_m, nut_m));
  else figure("f-here", "–", lost ? "position lost" : position_m.length ? "no nut" : "no thermal error");
  if (far) figure("f-error", `${number(far.value)} µm`, `${place(far.x)}, ${doubts(now, position_m, far.x)}`);
  say("f-error-name", strokeOfNut() ? "largest error within the stroke" : "largest error");
  byId("force").hidden = !known(now.force_N); // only a screw that is held at both ends has one
  if (known(now.force_N)) figure("f-force", `${number(now.force_N, 0)} N`, `± ${number(now.force_sigma_N, 0)}, ${now.force_N > 0 ? "pulled" : now.force_N < 0 ? "pushed" : "no pre-tension left"}`);
  const hot = now.temperature_degC.reduce((best, t, i) => (known(t) && (best < 0 || t > now.temperature_degC[best]) ? i : best), -1);
  if (hot >= 0) figure("f-hot", `${number(now.temperature_degC[hot])} °C`, place(field.position_m[hot]));
  const heats = Object.values(now.heat_W).filter(known);
  if (heats.length) figure("f-heat", `${number(heats.reduce((a, b) => a + b, 0))} W`, `from ${heats.length}`);
  if (lost) figure("f-nut", "–", "position lost");
  else if (known(nut_m)) figure("f-nut", `${number(mm(nut_m), 0)} mm`, speed ? `${number(now.channels[speed], 0)} rpm` : "");
  figure("f-comp", compensation ? (compensation.armed ? "armed" : "off") : "not set up", { holding: "holds its last values", releasing: "goes to zero" }[compensation?.phase] ?? (compensation?.gradient_cut_um ? "cut by the gradient limit" : ""));
}

export function startHero() {
  onNews(["health", "estimate", "hello", "alarms", "compensation"], drawState);
  onNews(["alarms"], drawAlarm);
  onNews(["view", "field", "readings", "compensation", "error"], drawFigures);
}
