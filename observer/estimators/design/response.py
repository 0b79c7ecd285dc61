"""How an estimator in its steady state follows a heat: its answer to a step of 1 W, and to each frequency."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.design.gains import (
    LuenbergerGain,
    Refusal,
    closed_loop,
    everything,
    poles_of,
    sensor_rows,
)
from observer.estimators.design.steady import gain_for
from observer.frames import FloatArray
from observer.model.discretise import step_matrices
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

TIMES, FREQUENCIES = 160, 240
SETTLED = 6.0
"""Time constants of the slowest pole that is shown."""


class HeatResponse(NamedTuple):
    """The estimate of each estimated heat (m_e) when that heat alone changes, the field being known before.

    `step` (T, m_e) in W at `time_s` (T,) after a step of 1 W; `transfer` (F, m_e) the complex ratio of
    estimated to true heat at `frequency_rad_s` (F,), up to half the sampling rate.
    """

    time_s: FloatArray
    step: FloatArray
    frequency_rad_s: FloatArray
    transfer: NDArray[np.complex128]


def heat_response(plant: Plant, settings: EstimatorSettings) -> HeatResponse | None:
    """Return the response of the estimator of the settings; None where it has no gain.

    The truth z and its estimate obey the same step, so that the error e = z - ẑ (Luenberger, 1971) follows
    e⁺ = M e + (I - K C) b w with M = (I - K C) A, b the heat's own state, and w = δ⁺ - γ δ what that heat
    gains beyond what the model has it keep.
    """
    step = step_matrices(plant, settings.period_s)
    found = gain_for(plant, step, everything(plant), settings)
    if isinstance(found, Refusal):
        return None
    K = found.K if isinstance(found, LuenbergerGain) else found
    M, heats = closed_loop(plant, step, K), len(step.heat_decay)
    into = (np.eye(len(M)) - K @ sensor_rows(plant))[:, -heats:]
    slowest_1_s = float(np.min(np.abs(poles_of(M, step.dt_s).real)))
    longest_s = SETTLED / max(slowest_1_s, 1e-7)
    count = np.unique(np.rint(np.geomspace(1.0, max(longest_s / step.dt_s, 2.0), TIMES)).astype(np.int64))
    omega = np.geomspace(0.1 / longest_s, np.pi / step.dt_s, FREQUENCIES)
    answers = [_of_heat(M, into[:, j], j - heats, float(step.heat_decay[j]), count) for j in range(heats)]
    z = np.exp(1j * omega * step.dt_s)
    error = np.linalg.solve(z[:, None, None] * np.eye(len(M)) - M, into[None].astype(np.complex128))
    own: NDArray[np.complex128] = np.stack(
        [error[:, j - heats, j] * (z - step.heat_decay[j]) for j in range(heats)], axis=1
    )
    return HeatResponse(
        np.asarray(count * step.dt_s, dtype=np.float64),
        np.stack(answers, axis=1),
        omega,
        np.asarray(1.0 - own, dtype=np.complex128),
    )


def _of_heat(M: FloatArray, into: FloatArray, row: int, keeps: float, count: NDArray[np.int64]) -> FloatArray:
    """The estimate (T,) of a heat of 1 W, so many steps after it began; `row` is the heat's own state."""
    n = len(M)
    whole = np.eye(n + 1)
    whole[:n, :n], whole[:n, n] = M, (1.0 - keeps) * into
    begin = np.append(into, 1.0)
    return np.array([1.0 - (np.linalg.matrix_power(whole, k - 1) @ begin)[row - 1] for k in count.tolist()])
