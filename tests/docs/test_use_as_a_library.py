"""The page about the library and the lines of the README: their Python runs, one block after the other."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

import observer
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]


def _python(page: Path) -> list[str]:
    return [body for _, language, body in blocks(page) if language == "python"]


def test_the_page_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    matplotlib.use("agg")
    names: dict[str, object] = {}
    for code in _python(ROOT / "docs" / "how-to" / "use-as-a-library.md"):
        exec(code, names)
    pyplot.close("all")
    assert "W/m²K" in capsys.readouterr().out
    field, table = names["field"], names["table"]
    assert field.dims == ("time_s", "position_m")
    assert len(table) == len(names["estimates"])
    assert not np.array_equal(
        names["estimates_if"]["heat_nut_W"], table["heat_nut_W"].iloc[: len(names["estimates_if"])]
    )
    assert names["system"].input_labels[0] == "heat_nut_W"
    assert 0.0 < names["step"].outputs[-1] < names["bode"].magnitude[0], "an hour, then the steady rise per W"


def test_the_readme_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (code,) = (code for code in _python(ROOT / "README.md") if "import observer" in code)
    names: dict[str, object] = {}
    exec(code, names)
    assert isinstance(names["estimates"], observer.Estimates)


def test_the_reference_has_every_name_once() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    shown = re.findall(r"^::: observer\.(\w+)$", text, flags=re.M)
    assert sorted(shown) == sorted(set(observer.__all__) - {"__version__"})
    prose = re.sub(r"^:::.*$", "", text, flags=re.M)
    assert "observer.__version__" in prose
