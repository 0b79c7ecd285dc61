"""How an estimator follows a heat, against the loop of truth and estimate written out."""

from __future__ import annotations

import numpy as np
import pytest

from observer.estimators.design.gains import LuenbergerGain, Refusal, design_step, everything, sensor_rows
from observer.estimators.design.response import heat_response
from observer.estimators.design.steady import gain_for
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.discretise import step_matrices
from tests.logs.machines import machine


def followed(config, heat_W: FloatArray, j: int) -> FloatArray:
    """The estimate of heat `j`, step by step, while it alone takes these values."""
    plant = build_plant(config)
    step = step_matrices(plant, config.estimator.period_s)
    found = gain_for(plant, step, everything(plant), config.estimator)
    assert not isinstance(found, Refusal)
    K = found.K if isinstance(found, LuenbergerGain) else found
    A, C = design_step(plant, step)[0], sensor_rows(plant)
    heats = len(step.heat_decay)
    z, estimate, out = np.zeros(len(A)), np.zeros(len(A)), []
    for value in heat_W:
        z = A @ z
        z[j - heats] = value
        estimate = A @ estimate
        estimate = estimate + K @ (C @ (z - estimate))
        out.append(estimate[j - heats])
    return np.array(out)


@pytest.mark.parametrize("kind", ["kalman", "luenberger"])
def test_the_estimate_of_a_step_is_that_of_the_loop(kind: str) -> None:
    config = machine(estimator={"kind": kind, "period_s": 5.0})
    answer = heat_response(build_plant(config), config.estimator)
    assert answer is not None
    steps = np.rint(answer.time_s / 5.0).astype(int)
    for j in range(answer.step.shape[1]):
        expected = followed(config, np.ones(steps[-1]), j)
        # rounding, of 2000 steps in one case and of powers of a matrix in the other
        assert answer.step[:, j] == pytest.approx(expected[steps - 1], abs=1e-6)
    assert answer.step[-1] == pytest.approx(1.0, abs=0.05)  # six time constants of the slowest pole
    assert np.abs(answer.transfer[0]) == pytest.approx(1.0, abs=0.05)


def test_a_sine_is_followed_as_the_transfer_says() -> None:
    config = machine(estimator={"kind": "luenberger", "period_s": 5.0})
    answer = heat_response(build_plant(config), config.estimator)
    assert answer is not None
    i = int(np.argmin(np.abs(np.abs(answer.transfer[:, 0]) - 0.7)))
    phase = answer.frequency_rad_s[i] * 5.0 * np.arange(1, 20_001)
    shown = followed(config, np.sin(phase), 0)[-10_000:]
    ratio = 2.0 * np.mean(shown * np.exp(-1j * phase[-10_000:])) * 1j
    assert ratio == pytest.approx(answer.transfer[i, 0], abs=0.01)  # the mean is not over whole periods
