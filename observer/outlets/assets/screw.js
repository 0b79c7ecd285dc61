// The screw at the moment that is looked at: its temperature, the nut, and each sensor where it sits.
import { big } from "./charts.js";
import { limits, shade } from "./colours.js";
import { byId, css, known, number, say } from "./format.js";
import { mm, nutChannel, onNews, store, strokeOfNut, view } from "./store.js";

const WORDS = { missing: "no reading", stale: "stale", rejected: "rejected", excluded: "excluded" };
const canvas = byId("screw");

// sensors in their order along the screw, each with its reading, or the word why it is crossed out
function sensors(now) {
  const placed = (store.config?.sensor ?? []).filter((s) => known(s.position_m) && s.kind !== "displacement");
  return placed.sort((a, b) => a.position_m - b.position_m).map((sensor) => {
    const quality = now.crossed?.[sensor.name], lost = now.lost?.includes(sensor.channel);
    const reading = store.documents.readings?.channels?.[sensor.channel]?.quality;
    return { ...sensor, value: now.channels[sensor.channel], word: WORDS[lost && !store.held ? reading : quality] ?? (lost ? "no reading" : null) };
  });
}

function cross(c, x, y, r) {
  c.strokeStyle = css("--bad"); c.lineWidth = 3; c.beginPath();
  c.moveTo(x - r, y - r); c.lineTo(x + r, y + r); c.moveTo(x + r, y - r); c.lineTo(x - r, y + r); c.stroke();
}

function draw() {
  const box = canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
  const now = view(), position_m = store.documents.field?.position_m ?? [];
  if (!box.width || !position_m.length || !store.appearance) return;
  const wide = Math.round(box.width * ratio), tall = Math.round(box.height * ratio);
  if (canvas.width !== wide || canvas.height !== tall) { canvas.width = wide; canvas.height = tall; }
  const c = canvas.getContext("2d"), k = big();
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, box.width, box.height);
  const left = 22 * k, width = box.width - 2 * left, top = 52 * k, strip = 26 * k;
  const first = position_m[0], last = position_m.at(-1), x = (m) => left + (m - first) / (last - first) * width;
  const [low, high] = limits([...store.rows, now]), font = `${12 * k}px system-ui, sans-serif`;
  c.font = font; c.textBaseline = "middle";
  const bar = c.createLinearGradient(left, 0, left + width, 0);
  now.temperature_degC.forEach((t, i) => known(t) && bar.addColorStop(i / (position_m.length - 1), `rgb(${shade((t - low) / (high - low))})`));
  c.fillStyle = bar; c.beginPath(); c.roundRect(left, top, width, strip, 4); c.fill();
  c.strokeStyle = css("--soft"); c.lineWidth = 1; c.stroke();
  c.save(); c.clip(); c.strokeStyle = "#8886"; c.beginPath();
  for (let i = -1; i < width / 9 / k; i++) { c.moveTo(left + i * 9 * k, top + strip); c.lineTo(left + (i + 1) * 9 * k, top); }
  c.stroke(); c.restore();
  const stroke = strokeOfNut();
  if (stroke) { c.fillStyle = css("--soft"); c.fillRect(x(stroke[0]), top + strip + 4, x(stroke[1]) - x(stroke[0]), 2); }
  const nut_m = now.lost?.includes(nutChannel()) ? null : now.channels[nutChannel()];
  if (known(nut_m)) {
    const length = store.config?.source?.find((s) => s.position_channel)?.length_m ?? 0.06, w = Math.max(14, length / (last - first) * width);
    c.fillStyle = css("--panel"); c.strokeStyle = css("--ink"); c.lineWidth = 2;
    c.beginPath(); c.roundRect(x(nut_m) - w / 2, top - 3, w, strip + 6, 4); c.globalAlpha = 0.82; c.fill(); c.globalAlpha = 1; c.stroke();
    c.fillStyle = css("--ink"); c.textAlign = "center"; c.font = `600 ${11 * k}px system-ui, sans-serif`; if (w > 26 * k) c.fillText("nut", x(nut_m), top + strip / 2 + 1);
    c.font = font;
  }
  // names and readings in two rows, those crossed out first: of them the words must be seen
  const found = sensors(now), free = [[], []];
  c.textAlign = "center";
  for (const sensor of [...found].sort((a, b) => Number(Boolean(b.word)) - Number(Boolean(a.word)))) {
    const at = x(sensor.position_m), name = sensor.name.length > 12 ? `${sensor.name.slice(0, 11)}…` : sensor.name, said = sensor.word ?? number(sensor.value);
    c.fillStyle = css(sensor.word ? "--bad" : "--ink"); c.beginPath(); c.moveTo(at, top - 4); c.lineTo(at - 5 * k, top - 12 * k); c.lineTo(at + 5 * k, top - 12 * k); c.closePath();
    if (sensor.word) { c.strokeStyle = css("--soft"); c.lineWidth = 1; c.stroke(); cross(c, at, top - 8 * k, 7 * k); } else c.fill();
    place: for (const text of [`${name} ${said}`, said]) {
      for (const [row, taken] of free.entries()) {
        const half = c.measureText(text).width / 2 + 3, middle = Math.min(box.width - half, Math.max(half, at));
        if (taken.some(([from, to]) => middle - half < to && middle + half > from)) continue;
        taken.push([middle - half, middle + half]);
        c.fillText(text, middle, top - (24 + 15 * row) * k);
        break place;
      }
    }
  }
  c.fillStyle = css("--soft");
  for (let i = 0; i <= 5; i++) {
    const text = number(mm(first + i / 5 * (last - first)), 0) + (i === 5 ? " mm" : ""), half = c.measureText(text).width / 2 + 1;
    c.fillText(text, Math.min(left + i / 5 * width, box.width - half), top + strip + 16 * k);
  }
  const crossed = found.filter(({ word }) => word).map(({ name, word }) => `${name} ${word}`), shown = now.temperature_degC.filter(known);
  say("crossed", crossed.length ? `Crossed out: ${crossed.join(", ")}.` : "");
  canvas.setAttribute("aria-label", `The screw; now ${number(Math.min(...shown))} to ${number(Math.max(...shown))} °C, nut at ${known(nut_m) ? number(mm(nut_m), 0) : "–"} mm${crossed.length ? `; crossed out: ${crossed.join(", ")}` : ""}`);
}

export function startScrew() {
  onNews(["field", "readings", "estimate", "rows", "view", "config", "theme"], draw);
  new ResizeObserver(draw).observe(canvas);
}
