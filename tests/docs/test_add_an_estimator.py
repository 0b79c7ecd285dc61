"""The page that shows how to add an estimator: its file and its lines, put into the house, estimate a log."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from observer import estimators, installation
from observer.estimators.protocol import Estimator
from observer.files.logs import read_log
from observer.frames import EstimateQuality, Inputs
from observer.model.build import build_plant
from observer.model.plant import Plant
from tests.docs.console import blocks
from tests.reference.service_path import inputs_of

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-an-estimator.md"
RIG = ROOT / "tests" / "data" / "rig"
NAME = "observer.estimators.snapshot"
BEFORE = '    if settings.engine == "constant":\n'


def page() -> list[str]:
    """The page's three pieces of code."""
    return [body for _, language, body in blocks(PAGE) if language == "python"]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> tuple[Plant, Estimator, Inputs]:
    """A real machine's plant, the page's estimator of it, and ten minutes of a log."""
    code, _, branch = page()
    module = ModuleType(NAME)
    monkeypatch.setitem(sys.modules, NAME, module)
    exec(compile(code, str(PAGE), "exec"), module.__dict__)
    source = Path(estimators.__file__).read_text(encoding="utf-8")
    assert source.count(BEFORE) == 1
    house: dict[str, Any] = {"__name__": estimators.__name__}
    exec(compile(source.replace(BEFORE, f"{branch}\n{BEFORE}"), str(PAGE), "exec"), house)
    config = installation.load(RIG / "config.toml")
    plant = build_plant(config)
    settings = config.estimator.model_copy(update={"kind": "snapshot"})
    log = read_log(RIG / "run_c.csv.gz", config.channels)
    log = replace(log, time_s=log.time_s[:1200], values=log.values[:1200])
    return plant, house["build_estimator"](plant, settings), Inputs.joined(inputs_of(config, plant, log))


def test_the_kind_is_shown_as_it_would_stand_in_the_configuration() -> None:
    _, kind, _ = page()
    code = (ROOT / "observer" / "tables" / "estimator.py").read_text(encoding="utf-8")
    assert code.count(kind.replace(', "snapshot"', "") + "\n") == 1, (
        "the page shows other kinds than there are"
    )


def test_it_estimates_a_log(rig: tuple[Plant, Estimator, Inputs]) -> None:
    plant, estimator, inputs = rig
    _, estimates = estimator.run(estimator.initial(), inputs)
    assert len(estimates) == len(inputs) > 1000
    assert np.isfinite(estimates.field_degC).all()
    assert (estimates.field_sigma_K > 0).all()
    prior_K = np.sqrt(np.einsum("ri,ij,rj->r", plant.rows.C, plant.prior_P, plant.rows.C))
    assert (estimates.field_sigma_K < prior_K[plant.rows.field_slice] + 1e-9).all()
    noise_K = np.sqrt(plant.noise_R_K2)
    assert (np.sqrt(np.mean(estimates.innovation_K**2, axis=0)) < 3 * noise_K).all()
    assert set(estimates.quality) == {EstimateQuality.DEGRADED}


def test_a_block_is_its_steps_to_the_last_bit(rig: tuple[Plant, Estimator, Inputs]) -> None:
    _, estimator, inputs = rig
    _, whole = estimator.run(estimator.initial(), inputs.part(0, 20))
    for k in range(20):
        _, one = estimator.run(estimator.initial(), inputs.part(k, k + 1))
        np.testing.assert_array_equal(one.field_degC[0], whole.field_degC[k])
        np.testing.assert_array_equal(one.field_sigma_K[0], whole.field_sigma_K[k])


def test_masking_a_sensor_is_deleting_its_row(rig: tuple[Plant, Estimator, Inputs]) -> None:
    _, estimator, inputs = rig
    usable = np.ones_like(inputs.usable[:1])
    usable[0, 0] = False
    values = [inputs.y_degC[:1].copy() for _ in range(2)]
    values[1][0, 0] = 1e6
    found = [
        estimator.run(estimator.initial(), inputs.part(0, 1)._replace(usable=usable, y_degC=y_degC))[1]
        for y_degC in values
    ]
    np.testing.assert_array_equal(found[0].field_degC, found[1].field_degC)
    nothing = inputs.part(0, 1)._replace(usable=np.zeros_like(usable))
    _, blind = estimator.run(estimator.initial(), nothing)
    assert np.isnan(blind.field_degC).all()
    assert set(blind.quality) == {EstimateQuality.INVALID}
