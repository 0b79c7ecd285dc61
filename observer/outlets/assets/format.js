// Numbers with their units, times of this place, and elements: text from outside is only ever text.
export const known = (x) => typeof x === "number" && Number.isFinite(x);
export const number = (x, digits = 1) => (known(x) ? x.toFixed(digits).replace("-", "−") : "–");
const SECONDS = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });
const MINUTES = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
const DAY = new Intl.DateTimeFormat([], { day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
export const clock = (s) => (known(s) ? SECONDS.format(s * 1000) : "–");
export const minute = (s) => MINUTES.format(s * 1000);
export const when = (s) => (known(s) ? DAY.format(s * 1000) : "–");
export const local = (s) => { const d = new Date(s * 1000); return new Date(d - d.getTimezoneOffset() * 60000).toISOString().slice(0, 19); };
// "1.2 ± 0.1 W, bound 3 W", as much of it as is known
export const withDoubt = (value, sigma, bound, unit, digits = 1, doubtUnit = unit) => `${number(value, digits)}${known(sigma) ? ` ± ${number(sigma, digits)}` : ""} ${unit}${known(bound) ? `, bound ${number(bound, digits)} ${doubtUnit}` : ""}`;
export const byId = (id) => document.getElementById(id);
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const colour = (i) => css(`--c${i % 7}`);
export const fade = (hex, alpha) => hex + Math.round(alpha * 255).toString(16).padStart(2, "0");

export function span(seconds) {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return seconds < 172800 ? `${number(seconds / 3600)} h` : `${number(seconds / 86400)} days`;
}

export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") element.textContent = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

export function say(id, text) {
  const element = typeof id === "string" ? byId(id) : id;
  if (element.textContent !== text) element.textContent = text;
}
