import { startCurves } from "./curves.js";
import { byId } from "./format.js";
import { startHeatmap } from "./heatmap.js";
import { startKeys } from "./keys.js";
import { startPast } from "./past.js";
import { startReports } from "./reports.js";
import { connect, onNews, store } from "./store.js";
import { startTables } from "./tables.js";

startTables();
startHeatmap();
startCurves();
startKeys();
startPast();
startReports();
onNews(["hello"], () => { byId("logout").hidden = !store.hello.login; });
byId("logout").addEventListener("submit", async (event) => {
  event.preventDefault();
  await fetch("/logout", { method: "POST" });
  location.assign("/login");
});
connect();
