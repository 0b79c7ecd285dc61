// The temperature over the last hour: time to the right, position upwards.
import { big, chart } from "./charts.js";
import { limits, shade, stops } from "./colours.js";
import { byId, clock, css, known, number, say, span, withDoubt } from "./format.js";
import { hold, mm, onNews, store } from "./store.js";
import { live } from "./views.js";

const COLUMNS = 480;
const picture = document.createElement("canvas");
let map = null;

// the row that was in force at a time, null in a gap
function rowAt(time_s, slack_s) {
  let low = 0, high = store.rows.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (store.rows[middle].time_s <= time_s) low = middle; else high = middle - 1; }
  const row = store.rows[low];
  return row && Math.abs(row.time_s - time_s) < 12 + slack_s ? row : null;
}

function paint(u) {
  const c = u.ctx, { left, top, width, height } = u.bbox, k = big() * devicePixelRatio;
  const { min, max } = u.scales.x, count = store.documents.field.position_m.length, [low, high] = limits(store.rows);
  picture.width = COLUMNS; picture.height = count;
  const context = picture.getContext("2d"), image = context.createImageData(COLUMNS, count);
  for (let x = 0; x < COLUMNS; x++) {
    const row = rowAt(min + (x + 0.5) / COLUMNS * (max - min), (max - min) / COLUMNS);
    for (let y = 0; row && y < count; y++) {
      const t = row.temperature_degC[y];
      if (known(t)) image.data.set([...shade((t - low) / (high - low)), 255], 4 * ((count - 1 - y) * COLUMNS + x));
    }
  }
  context.putImageData(image, 0, 0);
  c.save();
  c.imageSmoothingEnabled = true;
  if (count > 1) c.drawImage(picture, 0, 0.5, COLUMNS, count - 1, left, top, width, height);
  c.strokeStyle = css("--edge"); c.strokeRect(left, top, width, height);
  if (store.held) {
    const x = u.valToPos(store.held.time_s, "x", true);
    for (const [colour, wide] of [["#fff", 3], ["#000", 1]]) { c.strokeStyle = colour; c.lineWidth = wide * devicePixelRatio; c.beginPath(); c.moveTo(x, top); c.lineTo(x, top + height); c.stroke(); }
  }
  const scale = c.createLinearGradient(0, top + height, 0, top), at = left + width + 10 * k;
  stops().forEach((colour, i) => scale.addColorStop(i / (stops().length - 1), colour));
  c.fillStyle = scale; c.fillRect(at, top, 10 * k, height);
  c.fillStyle = css("--soft"); c.textAlign = "left"; c.textBaseline = "middle"; c.font = `${12 * k}px system-ui, sans-serif`;
  for (let i = 0; i <= 4; i++) c.fillText(`${number(low + i / 4 * (high - low))}${i === 4 ? " °C" : ""}`, at + 14 * k, top + height - i / 4 * height + (i === 0 ? -5 : i === 4 ? 6 : 0) * k);
  c.restore();
}

function read(_, u) {
  const { position_m } = store.documents.field, row = rowAt(u.posToVal(u.cursor.left, "x"), 0), at = u.posToVal(u.cursor.top, "y");
  const i = position_m.reduce((best, x, j) => (Math.abs(mm(x) - at) < Math.abs(mm(position_m[best]) - at) ? j : best), 0);
  return row ? `${withDoubt(row.temperature_degC[i], row.sigma_K?.[i], row.bound_K?.[i], "°C", 2, "K")}, at ${number(mm(position_m[i]), 0)} mm` : "nothing known";
}

function draw() {
  const rows = store.rows, position_m = store.documents.field?.position_m;
  if (!position_m?.length || !rows.length) return;
  map ??= chart(byId("c-map"), { x: "time", y: "position, mm", isTime: true, series: [{ label: "_", points: { show: false } }], legend: false, padding: [8, 74 * big(), 0, 0],
    range: () => { const places = store.documents.field.position_m; return [mm(places[0]), mm(places.at(-1))]; }, draw: paint, view: live, read });
  map.set([rows.map((r) => r.time_s), rows.map(() => null)]);
  const [from, to] = live.get() ?? live.whole();
  say("map-when", store.held ? `held at ${clock(store.held.time_s)}` : live.get() ? `${clock(from)} to ${clock(to)}; double-click for all` : `the last ${span(Math.max(1, to - from))}`);
}

function slider() {
  const moment = byId("moment");
  moment.max = String(store.rows.length);
  moment.value = String(store.held ? store.rows.indexOf(store.held) : store.rows.length);
  say("moment-said", store.held ? clock(store.held.time_s) : "now");
}

export function startHeatmap() {
  onNews(["rows", "view", "theme"], slider);
  onNews(["field", "rows", "view", "span", "config", "theme"], draw);
  byId("moment").addEventListener("input", (event) => hold(Number(event.target.value)));
}
