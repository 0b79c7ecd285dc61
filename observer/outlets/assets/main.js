import { startAlarms } from "./alarms.js";
import { startCurves, views } from "./curves.js";
import { byId } from "./format.js";
import { startHeatmap } from "./heatmap.js";
import { startHero } from "./hero.js";
import { openPast, startPast } from "./past.js";
import { startScrew } from "./screw.js";
import { connect, hold, news, onNews, store } from "./store.js";
import { startTables } from "./tables.js";
import { startTools } from "./tools.js";
import { restore } from "./views.js";

for (const start of [startHero, startTables, startAlarms, startScrew, startHeatmap, startCurves, startPast, startTools]) start();
restore(views, openPast);
onNews(["view"], () => { byId("pause").setAttribute("aria-pressed", String(Boolean(store.held))); byId("pause").textContent = store.held ? "Go on" : "Hold"; });
byId("pause").addEventListener("click", () => hold(store.held ? null : store.rows.length - 1));
const dark = matchMedia("(prefers-color-scheme: dark)");
byId("theme").addEventListener("click", () => {
  const { dataset } = document.documentElement;
  dataset.theme = (dataset.theme ? dataset.theme === "dark" : dark.matches) ? "light" : "dark";
  try { localStorage.setItem("theme", dataset.theme); } catch { /* not kept, then */ }
  news("theme");
});
dark.addEventListener("change", () => news("theme"));
onNews(["hello"], () => { byId("logout").hidden = !store.hello.login; });
byId("logout").addEventListener("submit", async (event) => {
  event.preventDefault();
  await fetch("/logout", { method: "POST" });
  location.assign("/login");
});
connect();
