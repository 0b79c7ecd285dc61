"""What viewers cost and see: the outlets' share of a core, the first paint, and how much the page jumps.

`python -m campaigns.page_viewers` prints a row for each; it takes two minutes and a half on a quiet computer.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING

from tests.page.browser import SIZES, chromium, service
from tests.patience import until
from tests.system.plant import children_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext

MEASURED_S = 20.0
VIEWERS = 5
PAINTS = 5
_JUMPS = """() => new Promise(done => {
  let first = 0, later = 0;
  const add = e => e.startTime < 2000 ? first += e.value : later += e.value;
  const seen = new PerformanceObserver(list => list.getEntries().forEach(add));
  seen.observe({type: 'layout-shift', buffered: true});
  setTimeout(() => done([first, later]), SECONDS);
})"""


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder, service(Path(folder)) as (url, daemon, _):
        (pid,) = [child for child in children_of(daemon.process.pid) if _is_outlets(child)]
        print(f"no viewer: {_share(pid):.1%} of a core")
        read = [0]
        for _ in range(VIEWERS):
            threading.Thread(target=_look, args=(f"{url}events", read), daemon=True).start()
        until(lambda: read[0] > 0)
        before = read[0]
        share = _share(pid)
        rate_kB_s = (read[0] - before) / MEASURED_S / 1000
        print(f"{VIEWERS} viewers: {share:.1%} of a core, {rate_kB_s:.0f} kB/s in all")
        with chromium() as browser:
            paints_ms = [_first_paint_ms(browser, url) for _ in range(PAINTS)]
            print(f"first paint: {min(paints_ms):.0f} to {max(paints_ms):.0f} ms in {PAINTS} new windows")
            for name in SIZES:
                first, later = _jumps(browser, url, name)
                print(f"layout shift, {name}: {first:.3f} in the first two seconds, {later:.3f} in the next")


def _is_outlets(pid: int) -> bool:
    return "observer.outlets" in Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")


def _share(pid: int) -> float:
    """The part of a core that a process uses."""
    start_s, used_s = time.monotonic(), _used_s(pid)
    threading.Event().wait(MEASURED_S)
    return (_used_s(pid) - used_s) / (time.monotonic() - start_s)


def _used_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _look(url: str, read: list[int]) -> None:
    with urllib.request.urlopen(url) as events:
        for line in events:
            read[0] += len(line)


def _window(browser: Browser, size: str) -> BrowserContext:
    width, height = SIZES[size]
    return browser.new_context(viewport={"width": width, "height": height})


def _jumps(browser: Browser, url: str, size: str) -> tuple[float, float]:
    """How far what stands on the page moves, weighted by its part of the window, as browsers report it."""
    with _window(browser, size) as context:
        page = context.new_page()
        page.goto(url)
        first, later = page.evaluate(_JUMPS.replace("SECONDS", f"{1000 * MEASURED_S}"))
    return first, later


def _first_paint_ms(browser: Browser, url: str) -> float:
    with _window(browser, "desktop") as context:
        page = context.new_page()
        page.goto(url)
        page.wait_for_selector("tr[data-sensor]")
        paint = page.evaluate("() => performance.getEntriesByName('first-contentful-paint')[0].startTime")
    return float(paint)


if __name__ == "__main__":
    main()
