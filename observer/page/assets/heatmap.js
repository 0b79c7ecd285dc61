// The screw now, with its nut and sensors, and below it the last hour: position across, time down.
import { byId, clock, css, known, minute, number, say } from "./format.js";
import { hold, nutChannel, onNews, store, view } from "./store.js";

// viridis (van der Walt and Smith, 2015), at sixteenths
const MAP = [[68,1,84],[72,24,106],[71,45,123],[66,64,134],[59,82,139],[51,99,141],[44,114,142],[38,130,142],[33,145,140],[31,160,136],[40,174,128],[63,188,115],[94,201,98],[132,212,75],[173,220,48],[216,226,25],[253,231,37]];
const WINDOWS_S = [60, 120, 300, 600, 1200, 2400, 3600];
const ROWS = 240;
const canvas = byId("map");
const picture = document.createElement("canvas");

function shade(t) {
  const at = Math.min(0.9999, Math.max(0, t)) * (MAP.length - 1);
  const i = Math.floor(at), f = at - i;
  return MAP[i].map((c, k) => Math.round(c + f * (MAP[i + 1][k] - c)));
}

function limits(rows, now) {
  let low = Infinity, high = -Infinity;
  for (const row of [...rows, now]) for (const t of row.temperature_degC) if (known(t)) { low = Math.min(low, t); high = Math.max(high, t); }
  if (!known(low)) return [20, 21];
  const middle = (low + high) / 2, half = Math.max(1, (high - low) / 2);
  return [Math.floor((middle - half) * 2) / 2, Math.ceil((middle + half) * 2) / 2];
}

function paint(rows, end_s, window_s, low, high) {
  const columns = rows[0]?.temperature_degC.length ?? 0;
  if (!columns) return;
  picture.width = columns; picture.height = ROWS;
  const context = picture.getContext("2d"), image = context.createImageData(columns, ROWS);
  let at = rows.length - 1;
  for (let y = 0; y < ROWS; y++) {
    const time_s = end_s - (y + 0.5) / ROWS * window_s;
    while (at > 0 && rows[at].time_s > time_s) at--;
    const row = rows[at];
    const near = Math.abs(row.time_s - time_s) < 12 + window_s / ROWS;
    for (let x = 0; x < columns; x++) {
      const t = row.temperature_degC[x], k = 4 * (y * columns + x);
      if (!near || !known(t)) continue;
      const [r, g, b] = shade((t - low) / (high - low));
      image.data.set([r, g, b, 255], k);
    }
  }
  context.putImageData(image, 0, 0);
}

function draw() {
  const box = canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
  const now = view(), rows = store.rows, position_m = store.documents.field?.position_m ?? [];
  if (!box.width || !position_m.length) return;
  if (canvas.width !== Math.round(box.width * ratio) || canvas.height !== Math.round(box.height * ratio)) {
    canvas.width = Math.round(box.width * ratio); canvas.height = Math.round(box.height * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, box.width, box.height);
  const big = parseFloat(getComputedStyle(document.documentElement).fontSize) / 15;
  const left = 62 * big, right = 64 * big, top = 34 * big, strip = 30 * big, below = 34 * big, gap = 14 * big;
  const width = box.width - left - right, mapTop = top + strip + gap, mapHeight = box.height - mapTop - below;
  const first = position_m[0], last = position_m.at(-1), x = (m) => left + (m - first) / (last - first) * width;
  const [low, high] = limits(rows, now);
  const end_s = rows.at(-1)?.time_s ?? now.time_s, age_s = end_s - (rows[0]?.time_s ?? end_s);
  const window_s = WINDOWS_S.find((w) => w >= age_s - 5) ?? 3600;
  c.font = `${12 * big}px system-ui, sans-serif`; c.textBaseline = "middle";

  // the screw itself
  const bar = c.createLinearGradient(left, 0, left + width, 0);
  now.temperature_degC.forEach((t, i) => known(t) && bar.addColorStop(i / (position_m.length - 1), `rgb(${shade((t - low) / (high - low))})`));
  c.fillStyle = bar; c.beginPath(); c.roundRect(left, top + strip * 0.2, width, strip * 0.6, 4); c.fill();
  c.strokeStyle = css("--edge"); c.lineWidth = 1; c.stroke();
  c.save(); c.clip(); c.strokeStyle = "#0003"; c.beginPath();
  for (let k = -1; k < width / 9 / big; k++) { c.moveTo(left + k * 9 * big, top + strip); c.lineTo(left + (k + 1) * 9 * big, top); }
  c.stroke(); c.restore();
  const stroke = store.config?.source?.find((s) => s.position_channel)?.stroke_m;
  if (stroke) { c.fillStyle = css("--soft"); c.fillRect(x(stroke[0]), top + strip + 3, x(stroke[1]) - x(stroke[0]), 2); }

  // sensors, with what they read
  c.textAlign = "center";
  let free = -Infinity;
  const silent = [];
  for (const sensor of [...(store.config?.sensor ?? [])].sort((a, b) => a.position_m - b.position_m)) {
    if (!known(sensor.position_m) || sensor.kind === "displacement") continue;
    // one that says nothing now is hollow and grey, and without the number that it said last
    const lost = now.lost?.includes(sensor.channel), at = x(sensor.position_m), value = lost ? null : now.channels[sensor.channel];
    c.fillStyle = c.strokeStyle = css(lost ? "--soft" : "--ink"); c.lineWidth = 1; c.beginPath(); c.moveTo(at, top + 3); c.lineTo(at - 4 * big, top - 4 * big); c.lineTo(at + 4 * big, top - 4 * big); c.closePath(); if (lost) c.stroke(); else c.fill();
    if (lost) silent.push(sensor.name);
    // with its name where there is room, else the number alone
    const name = sensor.name.length > 12 ? `${sensor.name.slice(0, 11)}…` : sensor.name;
    for (const text of [`${name} ${number(value)}`, number(value)]) {
      const half = c.measureText(text).width / 2, middle = Math.min(box.width - half, Math.max(half, at));
      if (middle - half > free + 4) { c.fillText(text, middle, top - 14 * big); free = middle + half; break; }
    }
  }
  // the nut
  const nut_m = now.lost?.includes(nutChannel()) ? null : now.channels[nutChannel()];
  if (known(nut_m)) {
    const length = store.config?.source?.find((s) => s.position_channel)?.length_m ?? 0.06, w = Math.max(14, length / (last - first) * width);
    c.fillStyle = css("--panel"); c.strokeStyle = css("--ink"); c.lineWidth = 2;
    c.beginPath(); c.roundRect(x(nut_m) - w / 2, top - 1, w, strip + 2, 4); c.globalAlpha = 0.82; c.fill(); c.globalAlpha = 1; c.stroke();
    c.fillStyle = css("--ink"); c.textAlign = "center"; c.font = `600 ${11 * big}px system-ui, sans-serif`; if (w > 26 * big) c.fillText("nut", x(nut_m), top + strip / 2 + 1);
    c.font = `${12 * big}px system-ui, sans-serif`;
  }
  // the past
  paint(rows, end_s, window_s, low, high);
  c.imageSmoothingEnabled = true;
  if (picture.width > 1 && rows.length) c.drawImage(picture, 0.5, 0, picture.width - 1, ROWS, left, mapTop, width, mapHeight);
  c.strokeStyle = css("--edge"); c.strokeRect(left, mapTop, width, mapHeight);
  c.fillStyle = css("--soft"); c.textAlign = "right";
  for (let k = 0; k <= 4; k++) c.fillText(k ? (window_s < 240 ? clock : minute)(end_s - k / 4 * window_s) : "now", left - 6, mapTop + k / 4 * mapHeight + (k === 0 ? 5 : k === 4 ? -5 : 0));
  c.textAlign = "center";
  for (let k = 0; k <= 5; k++) c.fillText(number(first + k / 5 * (last - first), 1), left + k / 5 * width, mapTop + mapHeight + 10 * big);
  c.fillText("position in m", left + width / 2, mapTop + mapHeight + 25 * big);
  if (store.held) {
    const y = mapTop + (end_s - now.time_s) / window_s * mapHeight;
    c.strokeStyle = "#fff"; c.lineWidth = 3; c.beginPath(); c.moveTo(left, y); c.lineTo(left + width, y); c.stroke();
    c.strokeStyle = "#000"; c.lineWidth = 1; c.stroke();
  }
  // the scale
  const scale = c.createLinearGradient(0, mapTop + mapHeight, 0, mapTop);
  MAP.forEach((rgb, i) => scale.addColorStop(i / (MAP.length - 1), `rgb(${rgb})`));
  c.fillStyle = scale; c.fillRect(left + width + 14, mapTop, 12, mapHeight);
  c.fillStyle = css("--soft"); c.textAlign = "left";
  for (let k = 0; k <= 4; k++) c.fillText(number(low + k / 4 * (high - low)), left + width + 30, mapTop + mapHeight - k / 4 * mapHeight + (k === 0 ? -5 : k === 4 ? 5 : 0));
  c.fillText("°C", left + width + 14, mapTop - 9 * big);
  say("map-when", store.held ? `held at ${clock(now.time_s)}` : `the last ${Math.round(window_s / 60)} min, newest above`);
  const shown = now.temperature_degC.filter(known);
  canvas.setAttribute("aria-label", `Temperature over position and time; now ${number(Math.min(...shown))} to ${number(Math.max(...shown))} °C, nut at ${number(nut_m, 3)} m${silent.length ? `; no reading of ${silent.join(", ")}` : ""}`);
}

function slider() {
  const moment = byId("moment");
  moment.max = String(store.rows.length);
  moment.value = String(store.held ? store.rows.indexOf(store.held) : store.rows.length);
  say("moment-said", store.held ? clock(store.held.time_s) : "now");
}

export function startHeatmap() {
  onNews(["rows", "view", "theme"], slider);
  onNews(["field", "readings", "rows", "view", "config", "theme"], draw);
  byId("moment").addEventListener("input", (event) => hold(Number(event.target.value)));
  new ResizeObserver(draw).observe(canvas);
}
