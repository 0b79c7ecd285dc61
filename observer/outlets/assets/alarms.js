// Alarms: the worst of them, each with its remedy, and the button that says somebody has seen it.
import { byId, known, make, number, when } from "./format.js";
import { onNews, store } from "./store.js";

// the service publishes the worst first: what nobody has acknowledged, then by severity
export const worst = () => store.documents.alarms?.alarms[0] ?? null;

async function acknowledge(id, button) {
  button.disabled = true;
  try {
    const answer = await fetch("/acknowledge", { method: "POST", body: new URLSearchParams({ id }) });
    button.textContent = answer.ok ? "sent" : `refused (${answer.status})`;
    if (!answer.ok) button.disabled = false;
  } catch { button.textContent = "not sent; try again"; button.disabled = false; }
}

export function alarmWords(alarm, withCommand) {
  const item = make("div", { class: "alarm", "data-severity": alarm.severity, "data-state": alarm.state, "data-alarm": withCommand ? alarm.id : null },
    make("b", { text: alarm.reason }), make("p", { text: alarm.remedy }),
    make("p", { class: "hint", text: `${alarm.severity}, ${alarm.state}, since ${when(alarm.since_s)}` }));
  if (alarm.state !== "acknowledged") {
    const button = make("button", { type: "button", text: "Acknowledge", onclick: () => acknowledge(alarm.id, button) });
    item.append(button);
    if (withCommand) item.append(" ", make("code", { text: `observer acknowledge ${alarm.id}` }));
  }
  return item;
}

function draw() {
  const published = store.documents.alarms, box = byId("alarms");
  if (!published) { delete box.dataset.shown; box.replaceChildren(make("p", { class: "hint", text: "This service publishes no alarms; the reasons are at the top." })); return; }
  const key = JSON.stringify(published.alarms) + JSON.stringify(published.bands ?? {});
  if (box.dataset.shown === key) return;
  box.dataset.shown = key;
  const held = box.contains(document.activeElement) ? document.activeElement.closest("[data-alarm]")?.dataset.alarm : null;
  const alarms = published.alarms.map((alarm) => alarmWords(alarm, true));
  const bands = Object.entries(published.bands ?? {}).map(([name, band]) => make("tr", {}, make("th", { scope: "row", text: name.replaceAll("_", " ") }), ...(band.known ? [
    make("td", { class: "n", text: `${number(band.ratio, 2)} ± ${number(band.sigma, 2)} of its usual${band.unsure ? `; ${band.unsure}` : ""}` }),
    make("td", { class: "n", text: known(band.trend_per_day) ? `${number(100 * band.trend_per_day, 2)} %/day` : "" }),
  ] : [make("td", { colspan: "2", class: "hint", text: `still learning what is usual: ${band.learning ?? `${number(band.running_h)} h of running`}` })])));
  box.replaceChildren(...(alarms.length ? alarms : [make("p", { class: "calm", text: "No alarm." })]), ...(bands.length ? [make("div", { class: "scroll" }, make("table", {}, make("tbody", {}, ...bands)))] : []));
  // who was about to press something is still there
  if (held) (box.querySelector(`[data-alarm="${CSS.escape(held)}"] button`) ?? byId("p5")).focus({ preventScroll: true });
}

export function startAlarms() { onNews(["alarms", "hello"], draw); }
