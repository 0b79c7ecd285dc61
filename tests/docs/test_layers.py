"""The page of the packages shows the layers that the import contracts enforce."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_has_every_layer_in_order() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (layers,) = (c["layers"] for c in contracts["contracts"] if c["type"] == "layers")
    enforced = [sorted(re.split(r"\s*\|\s*", layer)) for layer in layers]
    page = (ROOT / "docs" / "explanation" / "packages.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page, flags=re.M)
    shown = [sorted(re.findall(r"`(\w+)`", row)) for row in rows]
    assert shown == [layer for layer in enforced if layer != ["__main__"]]
