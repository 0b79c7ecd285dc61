"""Draws `page.png`: the demo's page in Debian's Chromium after five minutes, as the README begins with it.

`python docs/figures/page.py` starts the demo and stops it again.
"""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path

from playwright.sync_api import sync_playwright

HERE = Path(__file__).parent
MINUTES = 5
CHROMIUM = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]


def main() -> None:
    command = [sys.executable, "-m", "observer", "demo", "--plain", "--seconds", str(60 * MINUTES + 60)]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=HERE.parents[1])
    try:
        found = next(m for line in demo.stdout if (m := re.match(r"page: (http\S+)", line)))
        threading.Thread(target=demo.stdout.read, daemon=True).start()
        threading.Event().wait(60 * MINUTES)
        draw(found[1], HERE / "page.png")
    finally:
        demo.terminate()
        demo.wait()


def draw(url: str, path: Path) -> None:
    """A picture of a page that is served, on a desktop's screen."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=CHROMIUM)
        page = browser.new_page(viewport={"width": 1440, "height": 900}, color_scheme="dark")
        page.goto(url)
        page.wait_for_selector("tr[data-sensor]")
        page.wait_for_timeout(2000)
        page.screenshot(path=path)
        browser.close()


if __name__ == "__main__":
    main()
