"""Draw the tutorial's picture, the `overview.png` of the shipped rig once calibrated: `make figures`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

import observer

HERE = Path(__file__).parent
RIG = HERE.parents[1] / "tests" / "data" / "rig"
LOG = RIG / "run_c.csv.gz"
COLOURS = 256


def draw_overview(target: Path) -> None:
    """Do what a user does with a new machine: `observer calibrate`, then `observer replay`."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        calibrated = observer.load(RIG / "config.toml").calibrate(LOG, progress=print).machine
        calibrated.replay(LOG).write(place, "parquet")
        _shrink(place / "overview.png", target)


def _shrink(source: Path, target: Path) -> None:
    """Write a PNG with a palette, a third of the size."""
    with Image.open(source) as picture:
        full = picture.convert("RGB")
    palette = full.quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    full.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)


if __name__ == "__main__":
    draw_overview(HERE / "overview.png")
