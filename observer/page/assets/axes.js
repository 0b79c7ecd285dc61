// All axes in one row, each with its state in a word, where this page shows more than one.
import { byId, make } from "./format.js";
import { onNews, store } from "./store.js";
import { asked } from "./views.js";

const SIGNS = { good: "✓", starting: "…", degraded: "!", stale: "×", invalid: "×" };
const nameOf = (row) => (row.machine ? `${row.machine}/${row.axis}` : row.address);

// which axis the address asks for; what cannot be found out is this server's own
export async function chooseAxis() {
  if (!asked.get("axis")) return;
  try {
    const rows = await (await fetch("/axes.json")).json(), k = rows.findIndex((row) => nameOf(row) === asked.get("axis"));
    if (k > 0) store.base = `/axes/${k}/`;
  } catch { /* connect() says what is wrong */ }
}

function draw() {
  const rows = store.documents.axes ?? [], box = byId("axes"), mine = `${store.hello?.machine}/${store.hello?.axis}`;
  box.hidden = rows.length < 2;
  const shown = JSON.stringify([rows, mine]);
  if (box.hidden || box.dataset.shown === shown) return;
  box.dataset.shown = shown;
  const held = box.contains(document.activeElement) ? document.activeElement.dataset.axis : null;
  box.replaceChildren(...rows.map((row) => make("a", {
    href: `#axis=${encodeURIComponent(nameOf(row))}`, "data-axis": nameOf(row), "data-state": row.state, "aria-current": nameOf(row) === mine ? "page" : null,
    // another hash alone loads nothing
    onclick: (event) => { event.preventDefault(); location.hash = `axis=${encodeURIComponent(nameOf(row))}`; location.reload(); },
  }, make("b", { text: `${SIGNS[row.state] ?? "?"} ${nameOf(row)}` }), make("small", { text: row.reason ?? (row.alarm && !row.quiet ? row.alarm : row.state) }))));
  if (held) box.querySelector(`[data-axis="${CSS.escape(held)}"]`)?.focus();
}

export function startAxes() { onNews(["axes", "hello"], draw); }
