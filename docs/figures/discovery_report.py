"""Take the picture of a discovery's report, the tutorial's: `make figures`. It takes Chromium."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

from observer import discover

HERE = Path(__file__).parent
TESTS = HERE.parents[1] / "tests"
RIG = Path("tests") / "data" / "rig"  # as the tutorial types it: the report repeats what was typed
LOGS = [RIG / "end_conduction-0.1" / f"run_{run}.csv.gz" for run in "abc"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1040, 965
SCALE, COLOURS = 1.5, 256


def draw_report(target: Path) -> None:
    """Do what the tutorial does, and photograph the top of the page."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"{target.name} stays as it is: none of {', '.join(BROWSERS)} is installed")
        return
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        Path("tests").symlink_to(TESTS)
        place = Path("found")
        discover(RIG / "config.toml", LOGS).write(place)
        photograph(browser, place / "report.html", place / "page.png")
        with Image.open(place / "page.png") as picture:
            picture.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(target, optimize=True)


def photograph(browser: str, page: Path, target: Path) -> None:
    """Take a picture of the top of a page in its light colours."""
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        f"--window-size={WIDTH},{HEIGHT}", f"--force-device-scale-factor={SCALE}",
        f"--screenshot={target}", page.resolve().as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=60)


if __name__ == "__main__":
    draw_report(HERE / "discovery-report.png")
