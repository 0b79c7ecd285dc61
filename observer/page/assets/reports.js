// What discover found, and what it would change.
import { byId, make, when } from "./format.js";

function show(name) {
  byId("report-frame").src = `/reports/${encodeURIComponent(name)}/report.html`;
  byId("report").showModal();
}

function command(text) {
  const button = make("button", { type: "button", text: "Copy", onclick: async () => {
    try { await navigator.clipboard.writeText(text); button.textContent = "Copied"; } catch { getSelection().selectAllChildren(button.previousSibling); }
  } });
  return make("div", { class: "copy" }, make("code", { tabindex: "0", text }), button);
}

function entry(report) {
  const what = report.effects.length ? report.effects.join(", ") : "no effect";
  const box = make("details", {}, make("summary", {}, make("b", { text: report.verdict }), ` ${what} `, make("small", { text: `${report.name}, ${when(report.time_s)}` })));
  if (report.has_report) box.append(make("button", { type: "button", text: "Show the report", onclick: () => show(report.name) }));
  if (report.diff) {
    box.append(make("p", { class: "hint", text: "The proposed configuration beside the one in force:" }),
      make("pre", { tabindex: "0" }, ...report.diff.map((line) => make("span", { class: line.startsWith("+") ? "add" : line.startsWith("-") ? "del" : null, text: line || " " }))));
    if (report.command) box.append(make("p", { class: "hint", text: "To put it in force:" }), command(report.command));
  } else box.append(make("p", { class: "hint", text: "It proposes no configuration." }));
  return box;
}

export async function startReports() {
  const box = byId("reports");
  try {
    const { folder, reports } = await (await fetch("/reports.json")).json();
    if (reports.length) box.replaceChildren(...reports.map(entry));
    else box.replaceChildren(make("p", { class: "hint", text: folder === null
      ? "Nothing to show. Name a folder in page.reports and let observer discover write below it:"
      : `Nothing in ${folder} yet; let observer discover write below it:` }), make("code", { text: `observer discover LOG --config C --output ${folder ?? "REPORTS"}/today` }));
  } catch { box.textContent = "The reports cannot be asked for now."; }
}
