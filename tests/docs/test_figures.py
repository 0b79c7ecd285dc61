"""What the pages about figures say is what the figures show."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def kim() -> ModuleType:
    """The script that draws Kim's figures."""
    return script("kim")


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"docs_figures_{name}", DOCS / "figures" / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_a_bed_that_warms_by_two_kelvins_makes_twenty_micrometres_in_a_metre() -> None:
    _, found = script("bed").errors_um()
    assert found["the screw alone"][-1] - found["against the bed"][-1] == pytest.approx(20.0)


def test_the_ball_screw_settles_within_about_twenty_steps(kim: ModuleType) -> None:
    run = kim.ball_screw_run()
    off = np.abs(run.estimate.heat_W - run.heat_W) / run.heat_W
    # the paper's plots cannot be read better than to about 5 % of a heat
    assert off[10].max() > 0.05, "it settles so early that the figure shows nothing"
    assert off[20:].max() < 0.05
    assert np.abs(run.estimate.field_degC[20:] - run.field_degC[20:]).max() < 0.05


def test_the_rod_with_one_unknown_heat(kim: ModuleType) -> None:
    run = kim.rod_run()
    off = np.abs(run.estimates["heat_heater_W"] / kim.HEAT_W - 1.0)
    assert off[10:17].max() > 0.05
    assert off[17:].max() < 0.05  # what a printed plot could show
    for step, within_K in ((20, 0.8), (40, 0.002)):
        assert np.abs(kim.field_at(run.estimates, step) - run.field_degC[step]).max() < within_K


def test_the_printed_poles_hold_with_sixty_digits_and_after_a_great_swing(kim: ModuleType) -> None:
    swing, *settled = kim.printed_rule([0.0005, 0.02, 0.03])
    assert swing == pytest.approx(21_855, rel=0.01)
    np.testing.assert_allclose(settled, 1.0, atol=0.05)


def test_one_thermocouple_finds_the_heat_of_nut_and_bearings_at_each_speed(kim: ModuleType) -> None:
    run, steps = kim.speeds_run(), kim.STAGE_STEPS
    off = np.abs(run.estimates["heat_nut_W"] / run.heat_W - 1.0)[1:].reshape(-1, steps)
    assert (off[:, :10].max(axis=1) > 0.05).all(), "nothing was to be found"
    assert off[:, 15:].max() < 0.05
    np.testing.assert_allclose(run.estimates["heat_left_bearing_W"], run.estimates["heat_nut_W"] / 3.0)
    for stage in range(1, 4):
        field = kim.field_at(run.estimates, stage * steps)
        assert np.abs(field - run.field_degC[stage * steps]).max() < 0.05
