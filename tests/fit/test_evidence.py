"""What the logs say: folds, the proof that nothing is fitted to, and noise that whitening makes even."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.fit.evidence import (
    FITTED_SHARE,
    MARGIN_SHARE,
)
from observer.fit.hypothesis import fit_null
from observer.frames import FrameBlock
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log

CONFIG = machine()
TRUTH = machine(surface={"convection_W_m2K": 14.0})


def logs(count: int, minutes: float = 60.0) -> list[FrameBlock]:
    return [made_log(TRUTH, seed, minutes=minutes) for seed in range(count)]


def warmer(log: FrameBlock, from_s: float) -> FrameBlock:
    """The log with sensors that show something else from some time on: warmer, and livelier."""
    values = log.values.copy()
    late = log.time_s >= from_s
    for i, channel in enumerate(log.channels):
        if channel.endswith("_degC"):
            values[late, i] += 3.0 + np.sin(log.time_s[late])
    return replace(log, values=values)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_no_fit_sees_the_proof(count: int) -> None:
    """Other values there leave the fit as it is, to the last bit."""
    honest = logs(count)
    begin_s = 3600.0 * (FITTED_SHARE + MARGIN_SHARE) if count == 1 else 0.0
    fits = []
    for runs in (honest, [*honest[:-1], warmer(honest[-1], begin_s)]):
        problem = problem_of(CONFIG, runs)
        fit = fit_null(problem, CONFIG)
        fits.append((problem.free_values(fit.config), fit.deviance, problem.evidence))
    (a, deviance, before), (b, other, after) = fits
    changed = before.measured_degC != after.measured_degC
    assert changed[before.proof].mean() > 0.99
    assert not changed[before.used].any()
    assert a.tolist() == b.tolist()
    assert deviance == other
