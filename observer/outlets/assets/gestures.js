// Zoom and pan of a chart along its x axis: wheel, drag, two fingers, keys. Where the page scrolls by the wheel, a chart
// zooms only once somebody has clicked into it, or with Ctrl.
const FINEST = 1e-6;

export function gestures(plot, frame, view) {
  const { over } = plot, at = new Map();
  // of several moves between two paintings each goes on from the one before
  const range = () => view.get() ?? [plot.scales.x.min, plot.scales.x.max];
  const xOf = (event) => event.clientX - over.getBoundingClientRect().left;
  function set(low, high) {
    const whole = view.whole?.();
    if (whole && high - low >= whole[1] - whole[0]) { view.set(null); return; }
    if (whole && low < whole[0]) { high += whole[0] - low; [low] = whole; }
    if (whole && high > whole[1]) { low -= high - whole[1]; [, high] = whole; }
    if (high - low > FINEST) view.set([low, high]);
  }
  function zoom(by, x = over.clientWidth / 2) {
    const [low, high] = range(), middle = low + x / over.clientWidth * (high - low);
    set(middle - (middle - low) * by, middle + (high - middle) * by);
  }
  function pan(share) { const [low, high] = range(), by = (high - low) * share; set(low + by, high + by); }
  function look(index) {
    const xs = plot.data[0];
    if (!xs.length) return;
    plot.setCursor({ left: plot.valToPos(xs[Math.max(0, Math.min(xs.length - 1, index))], "x"), top: plot.cursor.top > 0 ? plot.cursor.top : over.clientHeight / 2 });
  }
  frame.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !frame.contains(document.activeElement)) return;
    event.preventDefault();
    zoom(event.deltaY > 0 ? 1.25 : 0.8, xOf(event));
  }, { passive: false });
  over.addEventListener("dblclick", () => view.set(null));
  over.addEventListener("pointerdown", (event) => { at.set(event.pointerId, xOf(event)); over.setPointerCapture(event.pointerId); frame.focus({ preventScroll: true }); });
  for (const end of ["pointerup", "pointercancel"]) over.addEventListener(end, (event) => at.delete(event.pointerId));
  over.addEventListener("pointermove", (event) => {
    const before = at.get(event.pointerId), x = xOf(event);
    if (before === undefined) return;
    at.set(event.pointerId, x);
    if (at.size === 2) {
      const other = [...at].find(([id]) => id !== event.pointerId)[1];
      if (Math.abs(x - other) > 8) zoom(Math.abs(before - other) / Math.abs(x - other), other);
    } else if (view.get() || !view.whole) pan((before - x) / over.clientWidth);
    if (event.pointerType !== "mouse") plot.setCursor({ left: x, top: event.clientY - over.getBoundingClientRect().top });
  });
  frame.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const index = plot.cursor.idx ?? plot.data[0].length - 1;
    const acts = { ArrowLeft: () => (event.shiftKey ? pan(-0.25) : look(index - 1)), ArrowRight: () => (event.shiftKey ? pan(0.25) : look(index + 1)), "+": () => zoom(0.5), "-": () => zoom(2), Home: () => view.set(null) };
    if (!acts[event.key]) return;
    acts[event.key]();
    event.preventDefault();
  });
}
