// Of every panel its data as CSV, its picture as PNG, and a link to it as it is.
import { big } from "./charts.js";
import { byId, css, make } from "./format.js";
import { store, view } from "./store.js";
import { link, live } from "./views.js";

const panels = new Map();

// panel: {table(): {columns, rows}, view: of its x axis}
export function offer(panel, { table, view = null }) { panels.set(panel, { table, view }); }

// a spreadsheet runs what begins like this
const cell = (x) => {
  if (x === null || x === undefined || Number.isNaN(x)) return "";
  const text = typeof x === "string" && /^[=+\-@\t]/.test(x) ? `'${x}` : String(x);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
};

function csvOf({ columns, rows }) { return `${[columns, ...rows].map((row) => row.map(cell).join(",")).join("\r\n")}\r\n`; }

function save(panel, kind, blob) {
  const stamp = new Date((view().time_s ?? Date.now() / 1000) * 1000).toISOString().replace(/[-:]|\.\d+/g, "");
  const name = [store.hello?.machine, store.hello?.axis, panel, stamp].join("-").replace(/[^\w.-]+/g, "_");
  const a = make("a", { href: URL.createObjectURL(blob), download: `${name}.${kind}` });
  a.click();
  setTimeout(() => URL.revokeObjectURL(a.href), 10000);
}

function saveCsv(panel) {
  save(panel, "csv", new Blob([csvOf(panels.get(panel).table())], { type: "text/csv" }));
}

// title, what is drawn, and tables, one below the other
function savePng(panel) {
  const box = byId(panel), ratio = devicePixelRatio || 1, k = big(), line = 18 * k, edge = 12 * k;
  const drawn = [...box.querySelectorAll("canvas")].filter((c) => c.offsetWidth), width = Math.max(480, ...drawn.map((c) => c.clientWidth)) + 2 * edge;
  const words = [
    ...[...box.querySelectorAll(".tiles li, .u-legend .u-series:not([hidden])")].map((e) => e.innerText), ...[...box.querySelectorAll(".hint:not(.readout), .alarm b, .calm")].map((e) => e.innerText),
    ...[...box.querySelectorAll("table tr")].map((row) => [...row.cells].map((c) => c.innerText.trim()).join("   ")),
  ].map((text) => text.replace(/\s+/g, " ").trim()).filter(Boolean);
  const out = document.createElement("canvas"), c = out.getContext("2d"), font = `${12 * k}px system-ui, sans-serif`;
  c.font = font;
  const lines = words.flatMap((text) => text.split(" ").reduce((rows, word) => { const next = `${rows.at(-1)} ${word}`.trim(); return c.measureText(next).width < width - 2 * edge ? [...rows.slice(0, -1), next] : [...rows, word]; }, [""]));
  const height = 3 * line + drawn.reduce((sum, e) => sum + e.clientHeight + 6, 0) + lines.length * line + 2 * edge;
  out.width = width * ratio; out.height = height * ratio;
  c.scale(ratio, ratio); c.fillStyle = css("--panel"); c.fillRect(0, 0, width, height);
  c.fillStyle = css("--ink"); c.font = `600 ${14 * k}px system-ui, sans-serif`; c.fillText(box.querySelector("h2 b").textContent, edge, edge + line * 0.8);
  c.fillStyle = css("--soft"); c.font = font; c.fillText(`${store.hello?.machine ?? ""}, axis ${store.hello?.axis ?? ""}, ${new Date((view().time_s ?? 0) * 1000).toLocaleString()}`, edge, edge + line * 1.8);
  let y = edge + 2.3 * line;
  for (const e of drawn) { c.drawImage(e, edge, y, e.clientWidth, e.clientHeight); y += e.clientHeight + 6; }
  c.fillStyle = css("--ink");
  for (const text of lines) { y += line; c.fillText(text, edge, y - 4); }
  out.toBlob((blob) => save(panel, "png", blob));
}

async function copyLink(panel, button) {
  const range = panels.get(panel).view?.get(), to = link(panel, range);
  history.replaceState(null, "", to);
  try { await navigator.clipboard.writeText(new URL(to, location.href).href); button.textContent = "Copied"; } catch { button.textContent = "In the address bar"; }
  setTimeout(() => { button.textContent = "Link"; }, 2000);
}

export function startTools() {
  for (const panel of panels.keys()) {
    const button = (text, title, act) => { const made = make("button", { type: "button", text, title, onclick: () => act(made) }); return made; };
    byId(panel).querySelector("h2").append(make("span", { class: "tools" },
      button("CSV", "Save the data of this panel", () => saveCsv(panel)), button("PNG", "Save a picture of this panel", () => savePng(panel)), button("Link", "Copy a link to this view", (made) => copyLink(panel, made))));
  }
}

// what is shown of the last hour, a row each few seconds
export function liveTable(columnsOf, valuesOf) {
  const [from, to] = live.get() ?? [-Infinity, Infinity], rows = store.rows.filter((row) => row.time_s >= from && row.time_s <= to);
  return { columns: ["time_s", "time", ...columnsOf()], rows: rows.map((row) => [row.time_s, new Date(row.time_s * 1000).toISOString(), ...valuesOf(row)]) };
}
