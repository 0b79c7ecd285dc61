"""Draw the figure of near and far sensors: `make figures`."""

from __future__ import annotations

from pathlib import Path

import observer

HERE = Path(__file__).parent
CONFIG = HERE.parents[1] / "config"


def draw_lathe() -> None:
    """What near and far sensors leave unknown of the heats of a spindle's bearings."""
    observer.load(CONFIG / "lathe-spindle.toml").place(by="heat").draw(HERE / "place-lathe.png")


if __name__ == "__main__":
    draw_lathe()
