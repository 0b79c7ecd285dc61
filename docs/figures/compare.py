"""Draw the pictures of the how-to about variants: Kuznetsov's mountings and Yu's drives."""

from __future__ import annotations

import tempfile
from pathlib import Path

import observer

HERE = Path(__file__).parent
CONFIG = HERE.parents[1] / "config"
PICTURES = {
    "compare-mountings": ("kuznetsov-screw", "kuznetsov-mountings"),
    "compare-drives": ("yu-dual-drive", "yu-drives"),
}


def found(name: str) -> observer.Comparison:
    """The comparison that a picture shows."""
    config, variants = PICTURES[name]
    machine = observer.load(CONFIG / f"{config}.toml")
    return machine.compare(CONFIG / "variants" / f"{variants}.toml", steady=True)


def draw(name: str, target: Path) -> None:
    """Draw it as `observer compare` does."""
    with tempfile.TemporaryDirectory() as folder:
        found(name).write(folder)
        target.write_bytes((Path(folder) / "compare.png").read_bytes())


if __name__ == "__main__":
    for picture in PICTURES:
        draw(picture, HERE / f"{picture}.png")
