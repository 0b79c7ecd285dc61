import { startAlarms } from "./alarms.js";
import { startCurves, views } from "./curves.js";
import { byId } from "./format.js";
import { startHeatmap } from "./heatmap.js";
import { startHero } from "./hero.js";
import { startKeys } from "./keys.js";
import { openPast, startPast } from "./past.js";
import { startScrew } from "./screw.js";
import { connect, onNews, store } from "./store.js";
import { startTables } from "./tables.js";
import { startTools } from "./tools.js";
import { restore } from "./views.js";

for (const start of [startHero, startTables, startAlarms, startScrew, startHeatmap, startCurves, startKeys, startPast, startTools]) start();
restore(views, openPast);
onNews(["hello"], () => { byId("logout").hidden = !store.hello.login; });
byId("logout").addEventListener("submit", async (event) => {
  event.preventDefault();
  await fetch("/logout", { method: "POST" });
  location.assign("/login");
});
connect();
