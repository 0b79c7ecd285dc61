// Which stretch of its x axis each chart shows, and the link that shows the same again.
import { byId, known } from "./format.js";
import { news, onNews, store } from "./store.js";

// {get: [low, high] or null for all, set, whole: all there is}
export function newView(panel, key, whole) {
  let shown = null;
  return { panel, get: () => shown, whole, set: (range) => { shown = range; news(key); note(panel, range); } };
}
export const live = newView("p2", "span", () => [store.rows[0]?.time_s ?? 0, store.rows.at(-1)?.time_s ?? 1]);

const asked = new URLSearchParams(location.hash.slice(1));
const digits = (x) => String(Number(x.toFixed(3)));

export function link(panel, range) {
  const words = new URLSearchParams({ panel });
  if (range) { words.set("from", digits(range[0])); words.set("to", digits(range[1])); }
  return `${location.pathname}#${words}`;
}
export function note(panel, range) { if (store.hello) history.replaceState(null, "", link(panel, range)); }

// what the address asks for, once the machine is known; `views` by panel
export function restore(views, openPast) {
  const panel = byId(asked.get("panel") ?? ""), [from, to] = ["from", "to"].map((end) => Number(asked.get(end) ?? NaN));
  let done = !panel?.matches("section");
  const begin = () => {
    if (done || !store.hello || !store.rows.length) return;
    done = true;
    if (known(from) && known(to) && from < to) {
      const view = views[panel.id], past = view === live && to < store.rows[0].time_s;
      if (panel.id === "p8" || past) openPast(from, to);
      else view?.set([from, to]);
      if (past) { byId("p8").scrollIntoView({ behavior: "instant" }); return; }
    }
    panel.focus({ preventScroll: true }); panel.scrollIntoView({ behavior: "instant" });
  };
  onNews(["rows", "hello", "field"], begin);
}
