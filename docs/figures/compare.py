"""Draw the picture of Kuznetsov's mountings for the how-to about variants: `make figures`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import observer

HERE = Path(__file__).parent
CONFIG = HERE.parents[1] / "config"


def draw(target: Path) -> None:
    """Draw it as `observer compare` does."""
    machine = observer.load(CONFIG / "kuznetsov-screw.toml")
    compared = machine.compare(CONFIG / "variants" / "kuznetsov-mountings.toml", steady=True)
    with tempfile.TemporaryDirectory() as folder:
        compared.write(folder)
        target.write_bytes((Path(folder) / "compare.png").read_bytes())


if __name__ == "__main__":
    draw(HERE / "compare-mountings.png")
