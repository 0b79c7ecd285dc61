"""What the page about Kim's figures says is what the figures show."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def kim() -> ModuleType:
    """The script that draws the figures."""
    spec = importlib.util.spec_from_file_location("docs_figures_kim", DOCS / "figures" / "kim.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_kims_numbers_of_modes(kim: ModuleType) -> None:
    assert {place: len(kim.modes_kept(place)) for place in (0.05, 0.1, 0.3, 0.35)} == {
        0.05: 12, 0.1: 7, 0.3: 5, 0.35: 2,
    }  # fmt: skip
    assert kim.modes_kept(0.5) == [1, 3, 5]


def test_both_formulas_give_the_same_gains_and_the_poles_are_far_off(kim: ModuleType) -> None:
    gains = kim.example_gains()
    # eight nearly equal poles: each coefficient is exact to some 1e-15, and their differences cancel little
    np.testing.assert_allclose(gains.printed, gains.closed, rtol=1e-11)
    assert np.abs(gains.closed).max() > 1e12
    assert np.abs(gains.reached.real - gains.requested.mean()).max() > 1000


def test_the_ball_screw_settles_within_about_twenty_steps(kim: ModuleType) -> None:
    run = kim.ball_screw_run()
    off = np.abs(run.estimate.heat_W - run.heat_W) / run.heat_W
    # the paper's plots cannot be read better than to about 5 % of a heat
    assert off[10].max() > 0.05, "it settles so early that the figure shows nothing"
    assert off[20:].max() < 0.05
    assert np.abs(run.estimate.field_degC[20:] - run.field_degC[20:]).max() < 0.05


def test_every_figure_of_the_page_is_drawn_by_the_script() -> None:
    page = (DOCS / "explanation" / "kims-figures.md").read_text(encoding="utf-8")
    script = (DOCS / "figures" / "kim.py").read_text(encoding="utf-8")
    shown = set(re.findall(r"\(\.\./figures/([\w-]+\.png)\)", page))
    assert shown == set(re.findall(r'"([\w-]+\.png)"', script))
    assert all((DOCS / "figures" / name).exists() for name in shown)
