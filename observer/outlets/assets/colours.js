// The colours of temperature, the same as in pictures and reports.
import { known } from "./format.js";
import { store } from "./store.js";

export const stops = () => store.appearance.temperature;
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

export function shade(t) {
  const map = stops(), at = Math.min(0.9999, Math.max(0, t)) * (map.length - 1), i = Math.floor(at), f = at - i, next = rgb(map[i + 1]);
  return rgb(map[i]).map((c, k) => Math.round(c + f * (next[k] - c)));
}

export function limits(rows) {
  let low = Infinity, high = -Infinity;
  for (const row of rows) for (const t of row.temperature_degC) if (known(t)) { low = Math.min(low, t); high = Math.max(high, t); }
  if (!known(low)) return [20, 21];
  const middle = (low + high) / 2, half = Math.max(1, (high - low) / 2);
  return [Math.floor((middle - half) * 2) / 2, Math.ceil((middle + half) * 2) / 2];
}
