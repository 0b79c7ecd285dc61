"""The page that shows how to add an estimator: its file, named by the configuration, estimates a log."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer import installation
from observer.config.estimator import EstimatorSettings
from observer.estimate.pipeline import MachineModel
from observer.estimators.protocol import Estimator
from observer.files.logs import read_log
from observer.frames import EstimateQuality, Inputs
from observer.model.plant import Plant
from tests.reference.service_path import inputs_of

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "snapshot.py"
RIG = ROOT / "tests" / "data" / "rig"
KIND = "snapshot:SnapshotEstimator"


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[Plant, Estimator, Inputs]:
    """A real machine's plant, the page's estimator of it, and ten minutes of a log."""
    (tmp_path / "snapshot.py").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "snapshot", raising=False)
    config = installation.load(RIG / "config.toml")
    settings = type(config.estimator).model_validate(config.estimator.model_dump() | {"kind": KIND})
    config = config.model_copy(update={"estimator": settings})
    machine = MachineModel.of(config, learns=True)
    log = read_log(RIG / "run_c.csv.gz", config.channels)
    log = replace(log, time_s=log.time_s[:1200], values=log.values[:1200])
    return machine.plant, machine.estimator(), Inputs.joined(inputs_of(config, machine.plant, log))


@pytest.mark.parametrize(
    ("kind", "said"),
    [("kalmann", "give one of kalman, luenberger, or"), ("nowhere:A", "install its package beside")],
)
def test_an_unknown_kind_is_rejected(kind: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        EstimatorSettings(kind=kind)


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
