// What discover found, and what it would change.
import { byId, make, when } from "./format.js";
import { address } from "./store.js";

const EVERY_MS = 60000;
let shown = "";

function show(name) {
  byId("report-frame").src = address(`reports/${encodeURIComponent(name)}/report.html`);
  byId("report").showModal();
}

function command(text) {
  const button = make("button", { type: "button", text: "Copy", onclick: async () => {
    try { await navigator.clipboard.writeText(text); button.textContent = "Copied"; } catch { getSelection().selectAllChildren(button.previousSibling); }
  } });
  return make("div", { class: "copy" }, make("code", { tabindex: "0", text }), button);
}

function entry(report, open) {
  const what = report.effects.length ? report.effects.join(", ") : "no effect";
  const box = make("details", { "data-report": report.name, open: open ? "" : null }, make("summary", {}, make("b", { text: report.verdict }), ` ${what} `, make("small", { text: `${report.name}, ${when(report.time_s)}` })));
  if (report.has_report) box.append(make("button", { type: "button", text: "Show the report", onclick: () => show(report.name) }));
  if (report.diff) {
    box.append(make("p", { class: "hint", text: "The proposed configuration beside the one in force:" }),
      make("pre", { tabindex: "0" }, ...report.diff.map((line) => make("span", { class: line.startsWith("+") ? "add" : line.startsWith("-") ? "del" : null, text: line || " " }))));
    if (report.command) box.append(make("p", { class: "hint", text: "To put it in force:" }), command(report.command));
  } else box.append(make("p", { class: "hint", text: "It proposes no configuration." }));
  return box;
}

async function list() {
  const box = byId("reports");
  try {
    const answer = await (await fetch(address("reports.json"))).text();
    if (answer === shown) return;
    shown = answer;
    const { folder, reports } = JSON.parse(answer);
    const open = [...box.querySelectorAll("details[open]")].map((e) => e.dataset.report);
    if (reports.length) box.replaceChildren(...reports.map((report) => entry(report, open.includes(report.name))));
    else box.replaceChildren(make("p", { class: "hint", text: folder === null
      ? "Nothing to show. Name a folder in page.reports and let observer discover write below it:"
      : `Nothing in ${folder} yet; let observer discover write below it:` }), make("code", { text: `observer discover LOG --config C --output ${folder ?? "REPORTS"}/today` }));
  } catch { shown = ""; box.textContent = "The reports cannot be loaded now."; }
}

// what is found while somebody looks appears by itself
export function startReports() {
  list();
  setInterval(() => { if (!document.hidden) list(); }, EVERY_MS);
  document.addEventListener("visibilitychange", () => { if (!document.hidden) list(); });
}
