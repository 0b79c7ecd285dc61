// Everything by the keyboard.
import { byId } from "./format.js";
import { hold, news, onNews, step, store } from "./store.js";
import { pan, zoom } from "./past.js";

export function turnTheme() {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  try { localStorage.setItem("theme", root.dataset.theme); } catch { /* not kept, then */ }
  news("theme");
}

export function turnHold() { hold(store.held ? null : store.rows.length - 1); }

function go(panel) { panel.focus({ preventScroll: true }); panel.scrollIntoView({ block: "start" }); }

export function startKeys() {
  onNews(["view"], () => { byId("pause").setAttribute("aria-pressed", String(Boolean(store.held))); byId("pause").textContent = store.held ? "Go on" : "Hold"; });
  byId("pause").addEventListener("click", turnHold);
  byId("theme").addEventListener("click", turnTheme);
  byId("keys").addEventListener("click", () => byId("help").showModal());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => news("theme"));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const at = event.target, typing = at.matches("input, select, textarea"), pressing = at.matches("button, summary");
    const past = at.closest("#p8") !== null;
    const acts = { "?": () => byId("help").showModal(), t: turnTheme, " ": turnHold, ArrowLeft: () => (past ? pan(-1) : step(-1)), ArrowRight: () => (past ? pan(1) : step(1)), "+": () => zoom(0.5), "-": () => zoom(2) };
    if (typing || (pressing && event.key === " ")) return;
    if (/^[0-8]$/.test(event.key)) go(byId(`p${event.key}`));
    else if (acts[event.key]) acts[event.key]();
    else return;
    event.preventDefault();
  });
}
