// What somebody has written about a moment: on the time axis, in a list, and a form to write more.
import { byId, css, local, make, say, when } from "./format.js";
import { address, onNews, store } from "./store.js";

export const notes = () => store.documents.notes?.notes ?? [];
const short = (text, most) => (text.length > most ? `${text.slice(0, most - 1)}…` : text);

// its line, and unless another chart beside says it, its beginning
export function drawNotes(plot, labels) {
  const c = plot.ctx, { left, top, width, height } = plot.bbox, ratio = devicePixelRatio;
  const ends = [0, 0, 0];
  c.save(); c.font = `${11 * ratio}px system-ui, sans-serif`; c.textBaseline = "alphabetic";
  for (const note of notes()) {
    const x = plot.valToPos(note.time_s, "x", true), text = short(note.text, width < 400 * ratio ? 12 : 22), wide = c.measureText(text).width + 8 * ratio;
    if (x < left || x > left + width) continue;
    c.strokeStyle = css("--note"); c.lineWidth = 1.5 * ratio; c.beginPath(); c.moveTo(x, top); c.lineTo(x, top + height); c.stroke();
    const at = Math.min(x, left + width - wide), row = ends.findIndex((end) => end <= at);
    if (row < 0 || !labels) continue;
    ends[row] = at + wide;
    const y = top + height - (row + 1) * 16 * ratio;
    c.fillStyle = css("--note"); c.fillRect(at, y, wide, 15 * ratio);
    c.fillStyle = css("--panel"); c.textAlign = "left"; c.fillText(text, at + 4 * ratio, y + 11 * ratio);
  }
  c.restore();
}

export const notesNear = (plot, x) => notes().filter(({ time_s }) => Math.abs(plot.valToPos(time_s, "x") - plot.valToPos(x, "x")) < 7);

export function writeNote(time_s) {
  byId("note-time").value = local(time_s);
  say("note-words", "");
  byId("note").showModal();
  byId("note-text").focus();
}

async function keep(event) {
  event.preventDefault();
  const time_s = Date.parse(byId("note-time").value) / 1000;
  try {
    const answer = await fetch(address("notes"), { method: "POST", body: new URLSearchParams({ time_s, text: byId("note-text").value }) });
    if (!answer.ok) { say("note-words", await answer.text()); return; }
  } catch { say("note-words", "The server does not answer; the note has not been kept."); return; }
  byId("note-text").value = "";
  byId("note").close();
}

function list() {
  say("notes-title", `Notes (${notes().length})`);
  byId("notes-list").replaceChildren(...[...notes()].reverse().map(({ time_s, text, by }) => make("li", {}, make("small", { text: `${when(time_s)}, ${by}: ` }), text)));
}

export function startNotes() {
  byId("note-form").addEventListener("submit", keep);
  byId("note-close").addEventListener("click", () => byId("note").close());
  onNews(["notes"], list);
}
