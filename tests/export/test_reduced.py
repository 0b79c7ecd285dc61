"""The reduced observer is the product's constant gain, once that has settled, and the model's columns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.errors import ConfigError
from observer.estimators import build_estimator
from observer.estimators.fixed_gain import FixedGainEstimator
from observer.export.data import observer_form
from observer.export.form import FormRunner, identifiers
from observer.export.reference import sampled
from observer.files.logs import Log, read_log
from observer.files.writer import write_log
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.export.made import nut_machine
from tests.logs.machines import machine
from tests.logs.simulated import run_model


def _log(folder: Path, config: Config, rows: int, seed: int = 0) -> Log:
    """What the model itself would show of a nut that stands, with noise."""
    rng, time_s = np.random.default_rng(seed), 0.5 * np.arange(rows)
    columns = dict.fromkeys(config.channels, np.full(rows, 20.0)) | {
        "n_rpm": np.where(time_s < 50.0, 600.0, 900.0), "heater_W": np.where(time_s < 30.0, 5.0, 10.0),
        "air_degC": 20.0 + 0.2 * np.sin(time_s / 60.0), "on": np.ones(rows), "nut_m": np.full(rows, 0.2),
    }  # fmt: skip
    columns = {name: columns[name] for name in config.channels}
    plant = build_plant(config)
    write_log(folder / "log.csv", time_s, columns)
    (block,) = frames_of_log(read_log(folder / "log.csv", config.channels), AlignPlan.of(config))
    _, found = run_model(plant, Drive(config, plant), block, 20.0)
    for i, sensor in enumerate(config.sensor):
        columns[sensor.channel] = found[:, i] + 0.05 * rng.normal(size=rows)
    write_log(folder / "log.csv", time_s, columns)
    return read_log(folder / "log.csv", config.channels)


@pytest.mark.parametrize("kind", ["kalman", "luenberger"])
@pytest.mark.parametrize("make", [machine, nut_machine])
def test_the_reduced_observer_steps_as_the_settled_constant_gain(tmp_path: Path, make, kind: str) -> None:
    """From the same state, the same heats: within what sums in another order make of 1e-16 in 200 steps."""
    exact = {"offset_K": 0.0, "ambient_K": 0.0, "convection": 0.0, "conductivity": 0.0, "heat_capacity": 0.0,
             "position_m": 0.0, "lag_s": 0.0, "end_W_K": 0.0}  # fmt: skip
    slow = {"bandwidth_1_s": 0.003} if kind == "luenberger" else {}
    config = make(estimator={"kind": kind, "engine": "constant", "period_s": 0.5} | slow, tolerance=exact)
    log = _log(tmp_path, config, 400)
    runner, samples = FormRunner(observer_form(config)), sampled(log, config.channels, 0.5)
    inputs = zip(samples.reading.tolist(), samples.fresh.tolist(), strict=True)
    found, at = [], []
    for reading, fresh in inputs:
        found.append(runner.step({"reading": reading, "fresh": fresh}))
        at.append(list(runner.v.x))

    plant = build_plant(config)
    estimator = build_estimator(plant, config.estimator)
    assert isinstance(estimator, FixedGainEstimator)
    (block,) = frames_of_log(log, AlignPlan.of(config))
    drive = Drive(config, plant)
    _, steps = drive.run(drive.initial(), block)
    verdict = estimator.initial().verdict.copy()
    verdict["runs_s"] = 1e9  # the constant gain has long taken over
    state = replace(
        estimator.initial(),
        x_hat=np.array(at[199]),
        started=True,
        time_s=99.5,
        verdict=verdict,
        gain_sensors=(1 << plant.rows.sensors) - 1,
    )
    _, expected = estimator.run(state, steps.part(200))
    heat_W = np.array([row["heat_W"] for row in found[200:]])
    error_um = (
        np.array([row["error_um"] for row in found[200:]]) if plant.layout.has_error else expected.error_um
    )
    assert np.abs(expected.heat_W - heat_W).max() < 1e-9
    assert np.abs(expected.error_um - error_um).max(initial=0.0) < 1e-9
    assert np.abs(expected.field_degC - np.array([row["field_degC"] for row in found[200:]])).max() < 1e-9


def test_samples_are_those_since_the_last_step(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,a,b\n0,1,5\n0.2,2,\n0.4,3,\n1.0,,6\n")
    samples = sampled(read_log(tmp_path / "log.csv"), ("a", "b", "c"), 0.5)
    assert samples.reading.tolist() == [[1, 5, 0], [3, 5, 0], [3, 6, 0]]
    assert samples.fresh.tolist() == [[True, True, False], [True, False, False], [False, True, False]]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"effect": [{"kind": "radiation", "emissivity": 0.3}]}, 'effect "radiation"'),
        ({"effect": [{"kind": "natural_convection", "coefficient_W_m2K": 5.0}]}, "natural_convection"),
        ({"effect": [{"kind": "speed_convection", "gain": 0.1}]}, 'effect "speed_convection"'),
        ({"effect": [{"kind": "sensor_drift", "target": "a", "rate_K_h": 0.1}]}, "drifts"),
        ({"estimator": {"kind": "tests.export.test_reduced:Mine"}}, "external class"),
        ({"effect": [{"kind": "attached_mass", "target": "nut", "capacity_J_K": 900.0,
                      "conductance_W_K": 5.0}]}, "nut that moves"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_rejected_with_a_remedy(changes, named: str) -> None:
    with pytest.raises(ConfigError, match=named) as caught:
        observer_form(nut_machine(**changes))
    assert any(word in str(caught.value) for word in ("remove", "export with", "link it"))


class Mine:
    """An estimator from outside."""


def test_names_that_become_equal_are_rejected() -> None:
    assert identifiers(["t1_degC", "2nd.nut", "a__b"]) == ("t1_degC", "in_2nd_nut", "a_b")
    with pytest.raises(ConfigError, match="rename one"):
        identifiers(["t.1", "T_1"])
